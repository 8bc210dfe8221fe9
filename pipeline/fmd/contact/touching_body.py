"""A flexible body with the points of its faces that may touch, and the planes that they may touch."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fmd.contact.histories import ContactHistory, read_history
from fmd.core.arrays import Array, IntArray, require_shape


@dataclass(frozen=True)
class ContactPoints:
    """Points of a reduced body's faces, and how they move.

    A force ``f_d`` on point d moves point c by ``shapes_c q`` through the modes and by ``G_cd f_d`` beside them; what
    the modes leave out is static and has no mass (massless-boundary reduction; Monjaraz-Tec, Gross & Krack, J Sound
    Vib 534, 2022).

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Undeformed positions in the body's frame [m].
    areas : ndarray, shape (n,)
        Force on each point by a pressure of 1 on its face [m²].
    shapes : ndarray, shape (n, 3, n_modes)
        Displacements for unit modal coordinates [kg^-1/2].
    G : ndarray, shape (n, 3, n, 3)
        Residual flexibility [m/N], symmetric and positive definite.
    faces : mapping of str to ndarray
        Numbers of the points on each face, by its marker's name.
    raised : float
        Share of its directions in which modes left too little, and G has been raised.
    """

    x: Array
    areas: Array
    shapes: Array
    G: Array
    faces: Mapping[str, IntArray]
    raised: float = 0.0

    def __post_init__(self) -> None:
        n = len(self.x)
        require_shape("x", self.x, (None, 3))
        require_shape("areas", self.areas, (n,))
        require_shape("shapes", self.shapes, (n, 3, None))
        require_shape("G", self.G, (n, 3, n, 3))


@dataclass(frozen=True)
class ContactPlane:
    """A plane of the ground that some of a body's points may touch.

    Parameters
    ----------
    name : str
        The contact's name.
    position : ndarray, shape (3,)
        A point of the plane in space [m].
    normal : ndarray, shape (3,)
        Unit vector out of the ground.
    friction : float
        Coefficient of Coulomb's friction.
    points : ndarray, shape (n,)
        Numbers of the points.
    """

    name: str
    position: Array
    normal: Array
    friction: float
    points: IntArray

    @property
    def axes(self) -> Array:
        """Normal and two tangents, a row each, shape (3, 3)."""
        other = np.eye(3)[int(np.abs(self.normal).argmin())]
        first = np.cross(self.normal, other)
        first /= np.linalg.norm(first)
        return np.stack([self.normal, first, np.cross(self.normal, first)])


@dataclass(frozen=True)
class TouchingBody:
    """A body of a mechanism that touches planes.

    Parameters
    ----------
    body : str
        The link's name.
    points : ContactPoints
        Its points.
    planes : tuple of ContactPlane
        Each with points of its own.
    """

    body: str
    points: ContactPoints
    planes: tuple[ContactPlane, ...]

    @property
    def digest(self) -> str:
        """Digest of all numbers."""
        own = [*(getattr(self.points, name) for name in ("x", "areas", "shapes", "G"))]
        own += [x for plane in self.planes for x in (plane.position, plane.normal, plane.friction, plane.points)]
        content = b"".join(np.ascontiguousarray(x).tobytes() for x in own)
        names = repr([self.body, *(plane.name for plane in self.planes)])
        return hashlib.blake2b(content + names.encode(), digest_size=16).hexdigest()

    def stiffness(self, J: Array) -> Array:
        """Return the stiffness of all points held, ``Jᵀ G⁻¹ J``, (n, n), of velocities J (n_points, 3, n).

        Velocities are in the body's axes. Any fewer points, and any of their directions alone, are less stiff.
        """
        n = 3 * len(self.points.x)
        rows = J.reshape(n, -1)
        return np.asarray(rows.T @ np.linalg.solve(self.points.G.reshape(n, n), rows))

    def histories(self, values: Array) -> dict[str, ContactHistory]:
        """Return the histories of its contacts by name, of values (n_times, n_planes, N_VALUES)."""
        return {plane.name: read_history(values[:, k]) for k, plane in enumerate(self.planes)}
