"""A body of mass points with random shapes, whose integrals and forces are plain sums."""

from dataclasses import dataclass, replace

import numpy as np

from fmd.core.arrays import Array
from fmd.reduction.body import MarkerShapes
from fmd.reduction.inertia import InertiaIntegrals, inertia_integrals
from fmd.reduction.modal_data import ModalData

N_MODES = 3


@dataclass(frozen=True)
class PointBody:
    """Points at x (n_points, 3) of masses m (n_points,) that move by shapes Phi (n_points, 3, n)."""

    x: Array
    m: Array
    Phi: Array

    @property
    def integrals(self) -> InertiaIntegrals:
        return inertia_integrals(self.x, np.diag(self.m), self.Phi)

    @property
    def data(self) -> ModalData:
        """The body with stiffness, damping and two nodes, the first two points."""
        rng = np.random.default_rng(3)
        nodes = {
            name: MarkerShapes(self.x[k], self.Phi[k], rng.standard_normal((3, N_MODES)))
            for k, name in enumerate(("left end", "right"))
        }
        A = rng.standard_normal((2, N_MODES, N_MODES))
        K, D = A @ A.swapaxes(1, 2) + np.eye(N_MODES)
        return ModalData(self.integrals, K, D, nodes)

    def inertia_forces(self, q: Array, v: Array, spin: Array) -> Array:
        """Sum ``m δr · (ω × (ω × r) + 2 ω × u̇)`` over the points: translation, rotation, modes."""
        r, u = self.x + self.Phi @ q, self.Phi @ v
        f = self.m[:, None] * (np.cross(spin, np.cross(spin, r)) + 2 * np.cross(spin, u))
        return np.concatenate([f.sum(axis=0), np.cross(r, f).sum(axis=0), np.einsum("ia,iaj->j", f, self.Phi)])


def point_body() -> PointBody:
    rng = np.random.default_rng(0)
    return PointBody(rng.standard_normal((30, 3)), rng.uniform(0.1, 1.0, 30), rng.standard_normal((30, 3, N_MODES)))


def stiffened(data: ModalData) -> ModalData:
    """Add any terms of second order that have the symmetries of true ones."""
    rng = np.random.default_rng(4)

    def forms(*shape: int) -> Array:
        A = 0.1 * rng.standard_normal((*shape, N_MODES, N_MODES))
        return np.asarray(A + A.swapaxes(-1, -2))

    KG = forms(3, 3)
    KG = KG + KG.transpose(1, 0, 2, 3)
    G = data.integrals.G.copy()
    G[:, :, 1:, 1:] -= KG
    integrals = replace(data.integrals, G=G, stiffening=KG, displacement2=forms(3), rotation2=forms(3))
    nodes = {name: replace(node, displacement2=forms(6)) for name, node in data.nodes.items()}
    return replace(data, integrals=integrals, nodes=nodes, in_own_frame=True)
