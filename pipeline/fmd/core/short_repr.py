"""Short texts of objects that hold large arrays, for consoles, notebooks and debuggers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from fmd.core.limits.shown import LONGEST_TEXT


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
