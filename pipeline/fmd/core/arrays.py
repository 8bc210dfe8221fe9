"""Types of arrays, the permutation tensor, and checks of shape and of finite values."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fmd.core.errors import AccuracyError

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
AnyArray = TypeVar("AnyArray", bound=NDArray[Any])


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


def read_only(array: AnyArray) -> AnyArray:
    """Return ``array`` itself, made read-only."""
    array.flags.writeable = False
    return array


def _permutation_tensor() -> Array:
    tensor = np.zeros((3, 3, 3))
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        tensor[a, b, c], tensor[a, c, b] = 1.0, -1.0
    return read_only(tensor)


EPSILON: Array = _permutation_tensor()
"""The permutation tensor ε_abc, shape (3, 3, 3)."""
