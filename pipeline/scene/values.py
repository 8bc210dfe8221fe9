"""Values that several tables of a scene share: names, counts, points, directions, units and files.

The first sentence of a validator's docstring describes the values that pass it; the page on the scene file prints it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field

from pipeline.core.units import Length, to_si, unit_ratio


def _check_name(name: str) -> str:
    """Name of a letter and up to 39 letters, digits, ``_`` or ``-``; ``ground`` is taken."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,39}", name) or name == "ground":
        raise ValueError("a name is a letter and up to 39 letters, digits, '_' or '-'; 'ground' is taken")
    return name


def _check_direction(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    """Direction of three numbers; its length doesn't count, but must not be zero."""
    if not any(axis):
        raise ValueError("has no direction; [0, 0, 1] is the z axis")
    return axis


def _read_plane(text: object) -> tuple[int, float]:
    """Plane across one of the body's axes, e.g. ``"x = 0"`` or ``"z = 12 mm"``."""
    match = re.fullmatch(r"\s*([xyz])\s*=\s*(.+?)\s*", text) if isinstance(text, str) and len(text) < 100 else None
    if match is None:
        raise ValueError("must look like 'x = 0' or 'z = 12 mm'")
    return "xyz".index(match[1]), 0.0 if re.fullmatch(r"[+-]?0+(\.0*)?", match[2]) else to_si(match[2], "length")


@dataclass(frozen=True, slots=True)
class UnitCheck:
    """Check for the name of a unit that converts to a given one.

    Parameters
    ----------
    si : str
        The unit that it must convert to, e.g. ``"m"``.
    """

    si: str

    def __call__(self, unit: str) -> str:
        """Return the unit, or raise ``ValueError`` if it is unknown or of another dimension."""
        unit_ratio(self.si, unit)
        return unit

    @property
    def description(self) -> str:
        """Words for the values that pass the check."""
        return f"unit that converts to {self.si}"


@dataclass(frozen=True, slots=True)
class FileCheck:
    """Check for a plain file name with one of the given suffixes.

    Parameters
    ----------
    suffixes : tuple of str
        Suffixes that are allowed, e.g. ``(".png", ".pdf")``.
    """

    suffixes: tuple[str, ...]

    def __call__(self, file: str) -> str:
        """Return the name, or raise ``ValueError`` if it holds a folder or has another suffix."""
        plain = re.fullmatch(r"\w[\w .-]{0,99}", file.replace("{mode}", "1"))
        if not plain or ".." in file or not file.endswith(self.suffixes):
            raise ValueError(f"must be a plain file name without a folder, ending in {' or '.join(self.suffixes)}")
        return file

    @property
    def description(self) -> str:
        """Words for the values that pass the check."""
        return f"file name without a folder, ending in {' or '.join(f'``{suffix}``' for suffix in self.suffixes)}"


Name = Annotated[str, AfterValidator(_check_name)]
Place = Annotated[str, Field(max_length=100)]
SourceFile = Annotated[str, Field(min_length=1, max_length=1000)]
LengthUnit = Annotated[str, AfterValidator(UnitCheck("m"))]
Number = Annotated[float, Field(strict=True)]
Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Order = Annotated[int, Field(strict=True, ge=1, le=2)]
Point = tuple[Length, Length, Length]
Axis = Annotated[tuple[Number, Number, Number], AfterValidator(_check_direction)]
Plane = Annotated[tuple[int, float], BeforeValidator(_read_plane)]
