"""Types of arrays, the permutation tensor, checks of shape and finite values, short texts of objects with arrays."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fmd.core.errors import AccuracyError
from fmd.core.limits.shown import LONGEST_TEXT

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
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


def short_repr(dataclass: Any) -> str:
    """Write a dataclass with the shapes of its arrays in place of their values; to be used as its ``__repr__``."""
    shown = ", ".join(f"{field.name}={_shorten(getattr(dataclass, field.name))}" for field in fields(dataclass))
    return f"{type(dataclass).__name__}({shown})"


def _shorten(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"<{value.dtype} {' × '.join(map(str, value.shape)) or 'scalar'}>"
    if isinstance(value, Mapping):
        names = ", ".join(map(str, value))
        return f"<{len(value)}: {names}>" if len(names) < LONGEST_TEXT else f"<{len(value)} items>"
    if isinstance(value, bool | int | float | str) or value is None:
        text = repr(value)
        return text if len(text) <= LONGEST_TEXT else f"{text[:LONGEST_TEXT]}…"
    if isinstance(value, tuple | list):
        return f"<{len(value)} items>"
    return f"<{type(value).__name__}>"
