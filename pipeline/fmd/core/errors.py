"""Errors that a user can meet, and how the command line ends with each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from fmd.core.limits.shown import MOST_FAULTS


class InputError(Exception):
    """A scene, a file or an option is wrong; the command line ends with exit status 2.

    Its message has a line for each fault.

    Parameters
    ----------
    file : str
        The file (or command-line option) at fault.
    key : str
        Dotted path of the value in it, e.g. ``body.beam.length``; may be empty.
    value : object
        The offending value; ``None`` if there is none.
    mend : str
        Fault and mend: what is wrong and what would work.
    line : int, optional
        Line of the file, from 1.
    others : sequence of InputError
        Further faults, found with it.
    """

    def __init__(
        self,
        file: str,
        key: str,
        value: object,
        mend: str,
        line: int | None = None,
        others: Sequence[InputError] = (),
    ) -> None:
        self.file, self.key, self.value, self.mend, self.line, self.others = file, key, value, mend, line, tuple(others)
        place = ": ".join(part for part in (f"{file}:{line}" if line else file, key) if part)
        given = "" if value is None else f" = {value!r}"
        lines = [f"{place}{given}: {mend}", *map(str, others[: MOST_FAULTS - 1])]
        left_out = len(others) + 1 - len(lines)
        super().__init__("\n".join([*lines, f"and {left_out} more"] if left_out > 0 else lines))


@contextmanager
def as_input_error(
    file: str,
    key: str = "",
    value: object = None,
    of: type[Exception] | tuple[type[Exception], ...] = ValueError,
    what: str = "",
) -> Iterator[None]:
    """Raise errors of some kinds as faults of a file, of its key and the value there: what is wrong, and what they say.

    Those that are faults of a file already stay as they are.
    """
    try:
        yield
    except InputError:
        raise
    except of as error:
        said = str(error)
        raise InputError(file, key, value, f"{what}: {' '.join(said.split())}" if what else said) from error


class AccuracyError(Exception):
    """A computed number failed its check and can't be trusted; the command line ends with exit status 3."""


class ConvergenceError(AccuracyError):
    """The iteration of an implicit step didn't converge; a shorter step may."""


class InertiaError(AccuracyError):
    """A motion has lost its inertia, so that the mass matrix isn't positive definite."""


class StabilityError(AccuracyError):
    """A time step is beyond the stability limit or passes a force unseen, or a march diverged.

    ``time`` [s] is when the march ended, ``positions`` are those it had then, None if they aren't known.
    """

    def __init__(self, message: str, time: float = 0.0, positions: object = None) -> None:
        super().__init__(message)
        self.time, self.positions = time, positions
