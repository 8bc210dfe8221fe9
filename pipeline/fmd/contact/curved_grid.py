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

from fmd.contact.half_space import rectangle_flexibility, shear_modulus
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
    others: IntArray  # (n_others,): numbers of those that other faces have
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

    def is_on_face(self, x: Array, axes: Array) -> bool:
        """Return true if all places x (n, 3) have nodes of the face around them."""
        if not np.isfinite(x).all():
            return False
        apart = self.points.x[self.nodes] - x[:, None]
        near = np.linalg.norm(apart, axis=2) < limits.AROUND * self.spacing
        u, v = (apart @ axes[1:].T).transpose(2, 0, 1)
        for own, angles in zip(near, np.arctan2(v, u), strict=True):
            around = np.sort(angles[own])
            if not len(around) or np.diff(around, append=around[0] + 2.0 * np.pi).max() > np.pi:
                return False
        return True

    def weights(self, x: Array, axes: Array) -> Array:
        """Return rows that interpolate from the mesh's points to places, exactly what is linear along the face.

        Places are (n, 3), weights (n, n_points).
        """
        apart = self.points.x[self.nodes] - x[:, None]
        distance = np.linalg.norm(apart, axis=2)
        sixth = np.partition(distance, min(5, len(self.nodes) - 1), axis=1)[:, min(5, len(self.nodes) - 1)]
        size = np.maximum(limits.SMOOTHED * self.spacing, sixth)
        w = np.exp(-0.5 * (distance / size[:, None]) ** 2)  # roots of the weights
        rows = np.concatenate([np.ones((*distance.shape, 1)), apart @ axes[1:].T / self.spacing], axis=2) * w[..., None]
        found = np.linalg.pinv(rows, rcond=1e-3)[:, 0] * w
        found = np.where(np.abs(found) > limits.UNSEEN_WEIGHT, found, 0.0)
        all_points = np.zeros((len(x), len(self.points.x)))
        all_points[:, self.nodes] = found / found.sum(axis=1, keepdims=True)
        return all_points

    def flexibility(self, cells: IntArray, weights: Array, axes: Array) -> tuple[Array, Array]:
        """Return the flexibility between rectangles, (n, 3, n, 3), and by which forces on other points move them."""
        used = np.flatnonzero(weights.any(axis=0))
        u, v = (cells[:, None] - cells[None] + self._most).transpose(2, 0, 1)
        between = np.einsum("ac,uvab,bd->uvcd", axes, self._half_space, axes)
        own = between[u, v].transpose(0, 2, 1, 3)
        smooth = weights[:, used]
        far = np.einsum("ip,pajb,kj->iakb", smooth, self._far_field(used), smooth, optimize=True)
        beside = np.einsum("ip,pajb->iajb", smooth, self.points.G[used][:, :, self.others])
        return own + far, beside

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
    def _normals(self) -> Array:
        """Inward normals at the mesh's points on the face, (n_points, 3); 0 at others."""
        normals = np.zeros(self.points.x.shape)
        normals[self.nodes] = self.inward(self.points.x[self.nodes])
        return normals

    @cached_property
    def _around(self) -> Array:
        """What the mesh's flexibility about a node has beside a half-space's, by nodes around, (n_points, 3, 3)."""
        found, x = np.zeros((len(self.points.x), 3, 3)), self.points.x[self.nodes]
        for k in self.nodes:
            distance = np.linalg.norm(x - self.points.x[k], axis=1)
            beyond = distance >= limits.APART * self.spacing
            ring = beyond & (distance < limits.RING * self.spacing)
            ring = self.nodes[ring if ring.any() else beyond]
            if len(ring):
                far = self._beside_half_space(np.array([k]), ring)[0].mean(axis=1)
                found[k] = 0.5 * (far + far.T)
        return found

    def _beside_half_space(self, some: IntArray, others: IntArray) -> Array:
        """Return what the mesh's flexibility has beside a half-space's, (n, 3, m, 3), of nodes that are apart."""
        x, (E, nu) = self.points.x, self.points.elastic or (1.0, 0.0)
        apart = x[some][:, None] - x[others][None]
        distance = np.maximum(np.linalg.norm(apart, axis=2), self.spacing)[..., None]
        normal = self._normals[some][:, None] + self._normals[others][None]
        size = np.linalg.norm(normal, axis=2, keepdims=True)
        normal = np.where(size > limits.LEAST_RIDGE, normal, self._normals[some][:, None])
        normal = normal / np.linalg.norm(normal, axis=2, keepdims=True)
        along = apart - (apart * normal).sum(axis=2, keepdims=True) * normal
        size = np.linalg.norm(along, axis=2, keepdims=True)
        along = np.where(size > 0.0, along / np.where(size > 0.0, size, 1.0), 0.0)
        tangential = 1.0 / (2.0 * np.pi * shear_modulus(E, nu)) / distance[..., None]
        towards = 0.5 * (1.0 - 2.0 * nu) * tangential
        H = tangential * ((1.0 - nu) * np.eye(3) + nu * along[..., None] * along[..., None, :])
        H += towards * (normal[..., None] * along[..., None, :] - along[..., None] * normal[..., None, :])
        return np.asarray(self.points.G[some][:, :, others] - H.transpose(0, 2, 1, 3))

    def _far_field(self, nodes: IntArray) -> Array:
        """Return what nodes have of the mesh's flexibility beside a half-space's, (n, 3, n, 3).

        Of nodes that are near each other elements tell little; there it is that of pairs somewhat farther away.
        """
        distance = np.linalg.norm(self.points.x[nodes][:, None] - self.points.x[nodes][None], axis=2)
        around = self._around[nodes]
        mean = 0.5 * (around[:, None] + around[None]).transpose(0, 2, 1, 3)
        near = distance < limits.APART * self.spacing
        return np.asarray(np.where(near[:, None, :, None], mean, self._beside_half_space(nodes, nodes)))
