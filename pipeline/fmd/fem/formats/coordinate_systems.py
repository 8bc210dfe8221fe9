"""Coordinate systems of Nastran decks, CORD2R, CORD2C and CORD2S, each given in another or in the basic one."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.fortran import read_field
from fmd.core.limits.files import SAME_LINE
from fmd.fem.formats.raw_mesh import MeshFileError


def _as_given(x: Array) -> Array:
    return x


def _of_cylinder(x: Array) -> Array:
    """Return the rectangular coordinates of a radius, an angle [degrees] and a height."""
    return np.array([x[0] * np.cos(np.radians(x[1])), x[0] * np.sin(np.radians(x[1])), x[2]])


def _of_sphere(x: Array) -> Array:
    """Return the rectangular coordinates of a radius, an angle from the pole and one around it [degrees]."""
    polar = np.radians(x[1])
    return _of_cylinder(np.array([x[0] * np.sin(polar), x[2], x[0] * np.cos(polar)]))


_KINDS = {"CORD2R": _as_given, "CORD2C": _of_cylinder, "CORD2S": _of_sphere}


class Axes(NamedTuple):
    """Origin (3,), in the file's unit, and axes (3, 3) of a system, its axes the columns, in the basic one."""

    origin: Array
    axes: Array
    rectangular: Callable[[Array], Array] = _as_given

    @property
    def is_straight(self) -> bool:
        """True if its directions are the same everywhere."""
        return self.rectangular is _as_given

    def place(self, x: Array) -> Array:
        """Return the basic coordinates of a point (3,)."""
        return np.asarray(self.origin + self.axes @ self.rectangular(x))


BASIC = Axes(np.zeros(3), np.eye(3))


class CoordinateSystems:
    """The systems of a deck by their numbers, found on demand."""

    def __init__(self, cards: Iterable[tuple[str, list[str]]]) -> None:
        self._cards = {fields[0]: (name, fields) for name, fields in cards if name.startswith("CORD") and fields}
        self._known = {"": BASIC, "0": BASIC}

    def find(self, number: str) -> Axes:
        """Return a system; raises ``MeshFileError`` if it isn't there or isn't by three points."""
        chain = list[tuple[str, str, list[str]]]()
        within = number
        while within not in self._known:
            name, fields = self._cards.pop(within, ("", []))  # popped: a system within itself isn't found again
            if name not in _KINDS:
                what = f"is a {name}" if name else "isn't there, or hangs on itself"
                raise MeshFileError(
                    f"coordinate system {within} {what}; {', '.join(_KINDS)} are read, and the basic one"
                )
            chain.append((within, name, fields))
            within = fields[1]
        for inner, name, fields in reversed(chain):
            self._known[inner] = self._by_three_points(inner, name, fields)
        return self._known[number]

    def directions(self, number: str) -> Array | None:
        """Return a system's axes, the columns, (3, 3); ``None`` if they differ from place to place."""
        found = self.find(number)
        return found.axes if found.is_straight else None

    def _by_three_points(self, number: str, name: str, fields: list[str]) -> Axes:
        try:
            points = np.array([read_field(field) for field in fields[2:11]]).reshape(3, 3)
        except ValueError:
            raise MeshFileError(f"coordinate system {number}: {name} takes three points, of nine numbers") from None
        a, b, c = (self._known[fields[1]].place(x) for x in points)
        z, y = b - a, np.cross(b - a, c - a)
        across = float(np.linalg.norm(y))
        if not across > SAME_LINE * np.linalg.norm(z) * np.linalg.norm(c - a):
            raise MeshFileError(f"coordinate system {number}: its three points lie on a line")
        z, y = z / np.linalg.norm(z), y / across
        return Axes(a, np.stack([np.cross(y, z), y, z], axis=1), _KINDS[name])
