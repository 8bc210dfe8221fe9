"""Geoms of an MJCF file: mass, centre and inertia of simple solids, and their shapes in pictures."""

import math
from collections.abc import Iterable

import numpy as np

from fmd.cli.robot import Pose, Shape
from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass


@dataclass(frozen=True)
class SolidMass:
    """Mass [kg], its centre (3,) [m], and the inertia about it (3, 3) [kg m²], in the axes of a body."""

    mass: float
    centre: Array
    inertia: Array


def add_masses(parts: Iterable[SolidMass]) -> SolidMass:
    """Return mass, centre and inertia of parts together, by Steiner's rule."""
    found = [*parts]
    mass = sum(part.mass for part in found)
    if not mass:
        return SolidMass(0.0, np.zeros(3), np.zeros((3, 3)))
    centre = sum((part.mass * part.centre for part in found), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for part in found:
        d = part.centre - centre
        inertia += part.inertia + part.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return SolidMass(mass, centre, inertia)


@dataclass(frozen=True)
class Geom:
    """A geom: its kind, its pose in the body, its sizes [m], halves as MJCF has them, and a mesh's file and scale."""

    kind: str
    pose: Pose
    size: tuple[float, ...]
    file: str
    scale: tuple[float, ...]

    def __post_init__(self) -> None:
        """Raise ``ValueError`` for a solid without its sizes."""
        needed = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}.get(self.kind, 0)
        if len(self.size) < needed or not all(x > 0.0 for x in self.size[:needed]):
            words = " ".join(f"{x:g}" for x in self.size)
            raise ValueError(f"a {self.kind} of {needed} sizes above 0 has {words or 'none'}")

    def part(self, mass: float | None, density: float) -> SolidMass:
        """Return the solid's mass, centre and inertia, by its mass [kg] or by its density [kg/m³]."""
        volume, own = self._moments()
        mass = density * volume if mass is None else mass
        R = self.pose.axes
        return SolidMass(mass, self.pose.at, mass * R @ np.diag(own) @ R.T)

    def _moments(self) -> tuple[float, Array]:
        """Return the volume [m³], and the moments of inertia about the centre over the mass, (3,) [m²]."""
        if self.kind == "sphere":
            r = self.size[0]
            return 4 / 3 * math.pi * r**3, np.full(3, 0.4 * r**2)
        if self.kind == "cylinder":
            r, h = self.size[:2]
            across = r**2 / 4 + h**2 / 3
            return 2 * math.pi * r**2 * h, np.array([across, across, r**2 / 2])
        if self.kind == "capsule":
            r, h = self.size[:2]
            tube, ball = 2 * math.pi * r**2 * h, 4 / 3 * math.pi * r**3
            across = tube * (r**2 / 4 + h**2 / 3) + ball * (0.4 * r**2 + h**2 + 0.75 * h * r)
            along = tube * r**2 / 2 + ball * 0.4 * r**2
            return tube + ball, np.array([across, across, along]) / (tube + ball)
        a, b, c = self.size[:3]
        squares = np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2])
        if self.kind == "box":
            return 8 * a * b * c, squares / 3
        if self.kind == "ellipsoid":
            return 4 / 3 * math.pi * a * b * c, squares / 5
        raise ValueError(f"a geom of type {self.kind} has no inertia here")

    def shape(self, pose: Pose) -> Shape:
        """Return the shape in pictures, at a pose in the link."""
        if self.kind == "box":
            return Shape("box", pose, tuple(2 * x for x in self.size[:3]))
        if self.kind in ("cylinder", "capsule"):
            return Shape("cylinder", pose, (self.size[0], 2 * self.size[1]))
        if self.kind == "mesh":
            return Shape("mesh", pose, file=self.file, scale=self.scale)
        return Shape(self.kind, pose, self.size)
