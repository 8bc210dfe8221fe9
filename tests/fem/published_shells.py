"""Published shell problems as data: midsurface, supports, loads and the deflection that is compared."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fmd.core.arrays import Array
from fmd.fem.material import Material
from tests.fem.sheets import ShellProblem, unit_grid


@dataclass(frozen=True)
class PublishedShell:
    """A part of a symmetric shell over the unit square of parameters.

    Attributes
    ----------
    place : callable
        Takes parameters (n, 2) to places (n, 3).
    weight : float
        Force along −z for each volume.
    mirrors : tuple of int
        Axes across planes of symmetry through the origin.
    held : tuple of (int or None, float, tuple of int)
        Parameter and its value on an edge, or for ``None`` the corner (0, value), and the axes held there.
    forces : tuple of (tuple, int, float)
        Corner, axis and force.
    corner, axis : tuple of float, int
        Where the deflection is compared, along what.
    target : float
        The published deflection.
    """

    place: Callable[[Array], Array]
    thickness: float
    material: Material
    mirrors: tuple[int, ...]
    held: tuple[tuple[int | None, float, tuple[int, ...]], ...]
    corner: tuple[float, float]
    axis: int
    target: float
    forces: tuple[tuple[tuple[float, float], int, float], ...] = ()
    weight: float = 0.0

    def deflection(self, n: int, element: str) -> float:
        """Return the deflection over the published one, by n elements each way."""
        p, cells = unit_grid(n, n, element)
        shell = ShellProblem(self.place(p), cells, self.thickness, self.material)
        for axis in self.mirrors:
            shell.mirror(axis)
        for nodes, axes in self.supports(p):
            shell.hold(nodes, axes)
        f = shell.load()
        f[:, 2] = -self.weight / self.material.rho * shell.fe.m.sum(axis=1)
        for corner, axis, force in self.forces:
            f[shell.n_points + nearest(p, corner), axis] += force
        return float(shell.solve(f)[nearest(p, self.corner), self.axis] / self.target)

    def supports(self, p: Array) -> list[tuple[Array, tuple[int, ...]]]:
        """Return the nodes of each support that is no symmetry, and the axes along which they are held."""
        return [
            (np.array([nearest(p, (0, at))]) if edge is None else np.flatnonzero(p[:, edge] == at), axes)
            for edge, at, axes in self.held
        ]


def nearest(p: Array, corner: tuple[float, float]) -> int:
    """Return the node at a corner of the parameters."""
    return int(np.abs(p - np.array(corner)).sum(axis=1).argmin())


def _roof(p: Array) -> Array:
    angle = np.radians(40) * p[:, 1]
    return np.column_stack([25 * p[:, 0], 25 * np.sin(angle), 25 * np.cos(angle)])


def _cylinder(p: Array) -> Array:
    angle = np.pi / 2 * p[:, 1]
    return np.column_stack([300 * p[:, 0], 300 * np.sin(angle), 300 * np.cos(angle)])


def _hemisphere(p: Array) -> Array:
    polar, around = np.radians(18 + 72 * p[:, 1]), np.pi / 2 * p[:, 0]
    return 10 * np.column_stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)])


ROOF = PublishedShell(  # Scordelis and Lo's, on diaphragms by its own weight: middle of the free edge
    _roof, 0.25, Material(4.32e8, 0.0, 1.0), (0, 1), ((0, 1, (1, 2)),), (0, 1), 2, -0.3024, weight=360.0
)
CYLINDER = PublishedShell(  # with diaphragms, under two forces: deflection there
    *(_cylinder, 3.0, Material(3e6, 0.3, 1.0), (0, 1, 2), ((0, 1, (1, 2)),), (0, 0), 2, -1.8248e-5),
    forces=(((0, 0), 2, -0.25),),
)
HEMISPHERE = PublishedShell(  # with a hole of 18°, under four forces: deflection under one
    *(_hemisphere, 0.04, Material(6.825e7, 0.3, 1.0), (0, 1), ((None, 1, (2,)),), (0, 1), 0, 0.0924),
    forces=(((0, 1), 0, 1.0), ((1, 1), 1, -1.0)),
)
