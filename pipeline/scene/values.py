"""Kinds of values in a scene file that several tables share: names, counts, points and directions."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field

from pipeline.core.units import Length, to_si


def _name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,39}", name) or name == "ground":
        raise ValueError("a name is a letter and up to 39 letters, digits, '_' or '-'; 'ground' is taken")
    return name


def _direction(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(axis):
        raise ValueError("has no direction; [0, 0, 1] is the z axis")
    return axis


def _plane(text: object) -> tuple[int, float]:
    match = re.fullmatch(r"\s*([xyz])\s*=\s*(.+?)\s*", text) if isinstance(text, str) and len(text) < 100 else None
    if match is None:
        raise ValueError("must look like 'x = 0' or 'z = 12 mm'")
    return "xyz".index(match[1]), 0.0 if re.fullmatch(r"[+-]?0+(\.0*)?", match[2]) else to_si(match[2], "length")


Name = Annotated[str, AfterValidator(_name)]
Plane = Annotated[tuple[int, float], BeforeValidator(_plane)]
Place = Annotated[str, Field(max_length=100)]
Number = Annotated[float, Field(strict=True)]
Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Point = tuple[Length, Length, Length]
Axis = Annotated[tuple[Number, Number, Number], AfterValidator(_direction)]
