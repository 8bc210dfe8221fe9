"""Sectors of a cyclic body, which turns about z carry into one another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError
from fmd.core.limits.mesh import SAME_PLACE
from fmd.fem.assembly import assemble
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel


@dataclass(frozen=True)
class Sector:
    """One sector of a cyclic body.

    Attributes
    ----------
    fe : FEModel
        The sector, its cuts free.
    images : ndarray, shape (N, n_nodes)
        Node of the whole body to which each turn carries each node of the sector.
    low, high : ndarray, shape (n_cut,)
        The sector's nodes on its cuts; a turn carries ``low`` onto ``high``.
    """

    fe: FEModel
    images: IntArray
    low: IntArray
    high: IntArray

    @property
    def count(self) -> int:
        """Number N of sectors in the whole body."""
        return len(self.images)

    def is_paired(self, harmonic: int) -> bool:
        """Return true if the modes of a harmonic come in pairs of equal frequency."""
        return 0 < 2 * harmonic < self.count

    def phases(self, harmonic: int) -> NDArray[Any]:
        """Return the factor of each sector's field over the first one's, shape (N,); real unless paired."""
        if self.is_paired(harmonic):
            return np.asarray(np.exp(2j * np.pi * harmonic * np.arange(self.count) / self.count))
        return np.where(harmonic * np.arange(self.count) % self.count, -1.0, 1.0)

    def turn(self, u: Array, k: int) -> Array:
        """Turn fields u (n_nodes, 3, …) by k sectors about z."""
        return np.asarray(np.einsum("ab,ib...->ia...", rotation_about_z(2 * np.pi * k / self.count), u))

    def expand(self, z: Array, harmonic: int) -> Array:
        """Expand fields z (n_nodes, 3, n) of one harmonic to the whole body; real parts (n_all, 3, n)."""
        own = np.setdiff1d(np.arange(len(z)), self.high)
        whole = np.empty((self.images.max() + 1, *z.shape[1:]))
        for k, (phase, image) in enumerate(zip(self.phases(harmonic), self.images, strict=True)):
            whole[image[own]] = self.turn((phase * z[own]).real, k)
        return whole

    def harmonic_part(self, f: Array, harmonic: int) -> Array:
        """Part of one harmonic in loads f (n_all, 3, n), as loads on the sector (n_nodes, 3, n), real unless paired.

        Loads on the cuts stand on the lower one.
        """
        phases = self.phases(harmonic).conj()
        part = np.zeros((self.images.shape[1], *f.shape[1:]), dtype=phases.dtype)
        for k, (phase, image) in enumerate(zip(phases, self.images, strict=True)):
            part += phase * self.turn(f[image], -k)
        part[self.high] = 0.0
        return part / self.count


def cut_first_sector(fe: FEModel, sectors: int) -> Sector:
    """Cut the first of a number of sectors off a cyclic body: the first cells of each of its parts.

    Raises
    ------
    ValueError
        There are fewer than three sectors: two have both cuts in common.
    AccuracyError
        Turns of the sector don't make up the body.
    """
    if sectors < 3:
        raise ValueError(f"a cyclic body needs at least 3 sectors, not {sectors}")
    mesh, x = fe.discretisation.mesh, fe.x
    cells = np.concatenate([numbers[: len(numbers) // sectors] for numbers in mesh.parts.values()])
    points, corners = np.unique(mesh.cells[cells], return_inverse=True)
    own = SolidMesh(mesh.points[points], corners.reshape(len(cells), -1), mesh.cell_type, {}, {})
    space = fe.discretisation
    sector = assemble(own, space.order, fe.material, space.formulation)
    tree = cKDTree(x)
    nearest = [tree.query(sector.x @ rotation_about_z(2 * np.pi * k / sectors).T) for k in range(sectors)]
    images = np.stack([image for _, image in nearest])
    distance = max(float(away.max()) for away, _ in nearest) / np.ptp(x, axis=0).max()
    place = np.full(len(x), -1)
    place[images[1]] = np.arange(len(sector.x))
    high = np.flatnonzero(place[images[0]] >= 0)
    whole = len(np.unique(images)) == len(x) == sectors * (len(sector.x) - len(high))
    if not (whole and distance < SAME_PLACE):
        raise AccuracyError(
            f"{sectors} turns of the mesh's first sector don't make the mesh: a node is {distance:.1e} of its size off "
            "its image"
        )
    return Sector(sector, images, place[images[0][high]], high)


def rotation_about_z(angle: float) -> Array:
    """Rotation matrix about z for an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
