"""The errors a user can meet and the checks that raise them."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
T = TypeVar("T", bound=NDArray[Any])


class InputError(Exception):
    """What the user gave is wrong; the command line ends with exit status 2.

    Parameters
    ----------
    file : str
        The file (or command-line option) at fault.
    key : str
        Dotted path of the value in it, e.g. ``body.beam.length``; may be empty.
    value : object
        The offending value; ``None`` if there is none.
    mend : str
        What is wrong and what would work.
    """

    def __init__(self, file: str, key: str, value: object, mend: str) -> None:
        self.file, self.key, self.value, self.mend = file, key, value, mend
        place = f"{file}: {key}" if key else file
        given = "" if value is None else f" = {value!r}"
        super().__init__(f"{place}{given}: {mend}")


class AccuracyError(Exception):
    """A computed number failed its check and can't be trusted; the command line ends with exit status 3."""


class StabilityError(AccuracyError):
    """A time step is beyond the stability limit, or a march diverged."""


def require_shape(name: str, array: NDArray[Any], shape: tuple[int | None, ...]) -> None:
    """Raise ``ValueError`` unless ``array`` has ``shape``; ``None`` matches any length."""
    if array.ndim != len(shape) or any(
        want is not None and got != want for got, want in zip(array.shape, shape, strict=True)
    ):
        wanted = "(" + ", ".join("any" if s is None else str(s) for s in shape) + ")"
        raise ValueError(f"{name} has shape {array.shape}, expected {wanted}")


def require_finite(name: str, array: NDArray[Any]) -> None:
    """Raise ``AccuracyError`` if ``array`` holds a NaN or an infinity; the message says how many."""
    bad = int(array.size - np.count_nonzero(np.isfinite(array)))
    if bad:
        raise AccuracyError(f"{name} holds {bad} values that are not finite, of {array.size}")


def read_only(array: T) -> T:
    """Return ``array`` itself, made read-only."""
    array.flags.writeable = False
    return array
