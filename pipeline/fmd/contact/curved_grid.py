"""Lattice of rectangles on a curved face, of which a grid's are there, as a contact goes along the face.

A rectangle stays where it is on the body. As the grid goes on, those it leaves behind become those ahead; between any
two the half-space's flexibility depends on how many rectangles they are apart, and the mesh's on where they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fmd.contact.half_space import point_flexibility, rectangle_flexibility
from fmd.core.arrays import Array, BoolArray, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits import contact as limits

if TYPE_CHECKING:
    from fmd.contact.surface_fit import Quadric


class MeshPoints(Protocol):
    """Points of a mesh, as a grid needs them: `fmd.contact.touching_body.ContactPoints`."""

    @property
    def x(self) -> Array:
        """Places (n, 3) [m]."""

    @property
    def shapes(self) -> Array:
        """Displacements by modes (n, 3, n_modes)."""

    @property
    def G(self) -> Array:
        """Residual flexibility (n, 3, n, 3) [m/N]."""

    @property
    def yields(self) -> Mapping[str, Array]:
        """Displacements by forces and moments on markers (n, 3, 6)."""

    @property
    def elastic(self) -> tuple[float, float] | None:
        """Young's modulus [Pa] and Poisson's ratio."""


@dataclass(frozen=True)
class GridFrame:
    """Place of a face that a grid is about."""

    place: Array  # (3,) [m]
    axes: Array  # (3, 3): inward normal and the two directions along the face, a row each, in the body's frame


@dataclass(frozen=True)
class CurvedGrid:
    """Grid of rectangles on a curved face, each with a point in its middle."""

    points: MeshPoints  # of the mesh, without the grid
    nodes: IntArray  # (n_nodes,): numbers of the face's among them
    surface: Quadric
    curvatures: tuple[float, float]  # along the two directions [1/m]
    spacing: float  # distance of the mesh's points [m]
    start: GridFrame
    cells: IntArray  # (n, 2): rectangles' places in the lattice at the start
    cell: tuple[float, float]  # sides [m]
    first: Array  # (2,): middle of the lattice's first rectangle along the face [m]
    edge: BoolArray  # (n,): rectangles at the grid's border
    travels: tuple[bool, bool]  # true of directions along which it follows the contact
    functions: list[Any] = field(default_factory=list)  # that kernels call by their addresses

    def __getstate__(self) -> dict[str, Any]:
        """Leave out functions, which are this process's own."""
        return {**self.__dict__, "functions": []}

    @cached_property
    def _number_of(self) -> IntArray:
        found = np.full(self._most + 1, -1)
        found[tuple(self.cells.T)] = np.arange(len(self.cells))
        return found

    def numbers(self, cells: IntArray) -> IntArray:
        """Return the numbers of rectangles (n, 2) in the grid, -1 of those beyond it, shape (n,)."""
        inside = np.all((cells >= 0) & (cells <= self._most), axis=1)
        u, v = np.where(inside[:, None], cells, 0).T
        return np.asarray(np.where(inside, self._number_of[u, v], -1))

    def places(self, frame: GridFrame, cells: IntArray) -> Array:
        """Return the middles of rectangles (n, 2), counted from the grid's first one, on the face, (n, 3) [m]."""
        flat = frame.place + (self.first + cells * self.cell) @ frame.axes[1:]
        return np.asarray(flat + self.surface.heights(flat, frame.axes[0])[:, None] * frame.axes[0])

    def goes_on(self, frame: GridFrame, steps: IntArray) -> GridFrame:
        """Return a place so many rectangles (2,) farther on the face, with its axes as little turned as they can be."""
        flat = frame.place + (steps * self.cell) @ frame.axes[1:]
        place = flat + self.surface.heights(flat[None], frame.axes[0])[0] * frame.axes[0]
        normal = self.inward(place[None])[0]
        first = frame.axes[1] - (frame.axes[1] @ normal) * normal
        first /= np.linalg.norm(first)
        return GridFrame(place, np.stack([normal, first, np.cross(normal, first)]))

    def inward(self, x: Array) -> Array:
        """Return the unit normals into the body at places of the face (n, 3)."""
        slopes = self.surface.gradients(x)
        sign = np.sign(self.surface.gradients(self.start.place[None])[0] @ self.start.axes[0])
        return np.asarray(sign * slopes / np.linalg.norm(slopes, axis=1, keepdims=True))

    def axes_about(self, x: Array) -> Array:
        """Return the normal at the middle of places of the face (n, 3), and two directions across it, a row each."""
        (normal,) = self.inward(x.mean(axis=0)[None])
        first = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
        first /= np.linalg.norm(first)
        return np.stack([normal, first, np.cross(normal, first)])

    def is_on_face(self, x: Array) -> bool:
        """Return true if all places x (n, 3) have nodes of the face around them."""
        if not np.isfinite(x).all():
            return False
        apart = self.points.x[self.nodes] - x[:, None]
        near = np.linalg.norm(apart, axis=2) < limits.AROUND * self.spacing
        u, v = (apart @ self.axes_about(x)[1:].T).transpose(2, 0, 1)
        for own, angles in zip(near, np.arctan2(v, u), strict=True):
            around = np.sort(angles[own])
            if not len(around) or np.diff(around, append=around[0] + 2.0 * np.pi).max() > np.pi:
                return False
        return True

    def weights(self, x: Array) -> Array:
        """Return rows that interpolate from the mesh's points to places, exactly what is linear along the face.

        Places are (n, 3), weights (n, n_points).
        """
        nodes, along = self.points.x[self.nodes], self.axes_about(x)[1:].T / self.spacing
        distance, sixth = np.linalg.norm(nodes - x[:, None], axis=2), min(5, len(nodes) - 1)
        size = np.maximum(limits.SMOOTHED * self.spacing, np.partition(distance, sixth, axis=1)[:, sixth])
        w = np.exp(-0.5 * (distance / size[:, None]) ** 2)  # roots of the weights
        rows = np.stack(
            [w, *(w * (a[None] - b[:, None]) for a, b in zip((nodes @ along).T, (x @ along).T, strict=True))]
        )
        squares = np.einsum("anp,bnp->nab", rows, rows)
        found = np.einsum("anp,na->np", rows, np.linalg.pinv(squares, rcond=1e-6, hermitian=True)[:, 0]) * w
        found = np.where(np.abs(found) > limits.UNSEEN_WEIGHT, found, 0.0)
        all_points = np.zeros((len(x), len(self.points.x)))
        all_points[:, self.nodes] = found / found.sum(axis=1, keepdims=True)
        return all_points

    def flexibility(self, cells: IntArray, weights: Array, axes: Array) -> Array:
        """Return the flexibility between rectangles, (n, n, 3, 3), of which each has the mesh's weights (n, n_points).

        It is symmetric; about the grid's middle the face has the axes.
        """
        used = np.flatnonzero(weights[:, self.nodes].any(axis=0))
        smooth, (n, p) = weights[:, self.nodes[used]], (len(cells), len(used))
        by_node = (smooth @ self._far_field[np.ix_(used, used)].reshape(p, 9 * p)).reshape(n, p, 9)
        u, v = (cells[:, None] - cells[None] + self._most).transpose(2, 0, 1)
        return np.asarray((axes.T @ self._half_space @ axes)[u, v] + (smooth @ by_node).reshape(n, n, 3, 3))

    @property
    def _most(self) -> IntArray:
        return np.asarray(np.ptp(self.cells, axis=0))

    @cached_property
    def _half_space(self) -> Array:
        """Flexibility between rectangles by how many they are apart, in the grid's axes, (any, any, 3, 3)."""
        elastic = self.points.elastic
        assert elastic is not None  # or the face has no grid
        apart = [np.arange(-most, most + 1) * side for most, side in zip(self._most, self.cell, strict=True)]
        found = rectangle_flexibility(np.stack(np.meshgrid(*apart, indexing="ij"), axis=-1), self.cell, *elastic)
        return found.transpose(0, 2, 1, 3)

    @cached_property
    def _far_field(self) -> Array:
        """Flexibility between the face's nodes that the mesh has beside a half-space's, (n_nodes, n_nodes, 3, 3).

        Of nodes that are near each other elements tell little; there it is that of pairs somewhat farther away.
        """
        x, (E, nu) = self.points.x[self.nodes], self.points.elastic or (1.0, 0.0)
        apart, normals = x[:, None] - x[None], self.inward(x)
        distance = np.linalg.norm(apart, axis=2)
        normal = normals[:, None] + normals[None]
        opposite = np.linalg.norm(normal, axis=2, keepdims=True) < limits.LEAST_RIDGE
        normal = _units(np.where(opposite, normals[:, None], normal))
        along = _units(apart - (apart * normal).sum(axis=2, keepdims=True) * normal)
        mesh = self.points.G[self.nodes][:, :, self.nodes].transpose(0, 2, 1, 3)
        far = mesh - point_flexibility(np.maximum(distance, self.spacing), along, normal, E, nu)
        near = distance < limits.APART * self.spacing
        ring = ~near & (distance < limits.RING * self.spacing)
        ring = np.where(ring.any(axis=1, keepdims=True), ring, ~near)
        around = np.einsum("ij,ijab->iab", ring, far) / np.maximum(ring.sum(axis=1), 1)[:, None, None]
        around = 0.5 * (around + around.transpose(0, 2, 1))
        return np.where(near[..., None, None], 0.5 * (around[:, None] + around[None]), far)


def _units(x: Array) -> Array:
    """Return directions of vectors (..., 3); 0 of those without a length."""
    size = np.linalg.norm(x, axis=-1, keepdims=True)
    return np.asarray(x / np.where(size > 0.0, size, 1.0))
