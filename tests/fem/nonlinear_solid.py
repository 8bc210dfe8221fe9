"""A solid of St. Venant–Kirchhoff's material on the project's own mesh: strain energy, forces and tangent stiffness.

Strain is Green's, ``E = ½ (H + Hᵀ + Hᵀ H)`` of the displacement gradient H, stress is ``S = C E``; so the energy
``½ ∫ E·C E dV`` is a quartic polynomial of the displacements. Integrals are taken at the points of the linear
stiffness.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from fmd.fem.markers import Marker
from fmd.fem.model import FEModel

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # components of strain and stress, shears doubled
STEPS, CORRECTIONS, SETTLED = 4, 30, 1e-10


@dataclass(frozen=True)
class NonlinearSolid:
    """A solid held at a face and pulled at another.

    Parameters
    ----------
    fe : FEModel
        Mesh, material, stiffness and mass; of one isotropic material, without enhanced strain.
    root, tip : Marker
        The face whose nodes are held, and that which is pulled.
    """

    fe: FEModel
    root: Marker
    tip: Marker

    @cached_property
    def _points(self) -> tuple[Any, Any]:
        """Gradients of the shape functions (n_elements, n_q, n_local, 3) and the points' volumes (n_elements, n_q)."""
        space = self.fe.discretisation
        X, w = space.kind.quadrature(space.kind.stiffness_order)
        g, det = space.gradients(X, slice(None))
        return g, det * w

    @cached_property
    def free(self) -> Any:
        """Unknowns that aren't held: all but those of the root's nodes."""
        held = (3 * self.root.nodes[:, None] + np.arange(3)).ravel()
        return np.setdiff1d(np.arange(3 * len(self.fe.x)), held)

    def _stress(self, u: Any) -> tuple[Any, Any]:
        """Return the deformation gradient F and the second Piola–Kirchhoff stress S of a field u (n_nodes, 3)."""
        H = self._points[0].swapaxes(2, 3) @ u[self.fe.discretisation.element_nodes][:, None]  # [..., j, i]: ∂u_i/∂x_j
        F = H.swapaxes(2, 3) + np.eye(3)
        E = 0.5 * (H + H.swapaxes(2, 3) + H @ H.swapaxes(2, 3))  # of H, as F would round small strains off
        lam, mu = self.fe.material.lame
        return F, lam * np.trace(E, axis1=2, axis2=3)[..., None, None] * np.eye(3) + 2 * mu * E

    def force(self, u: Any) -> Any:
        """Return the internal forces of a field u (n_nodes, 3) [N], shape (n_nodes, 3)."""
        g, volumes = self._points
        F, S = self._stress(u)
        entries = (g @ (F @ S).swapaxes(2, 3) * volumes[..., None, None]).sum(axis=1)
        forces = np.zeros_like(u)
        np.add.at(forces, self.fe.discretisation.element_nodes, entries)
        return forces

    def tangent(self, u: Any) -> sp.csr_array:
        """Return the derivative of the internal forces by a field u (n_nodes, 3) [N/m], (3 n_nodes, 3 n_nodes)."""
        g, volumes = self._points
        F, S = self._stress(u)
        n_elements, n_q, n_local, _ = g.shape
        B = np.empty((n_elements, n_q, 6, n_local, 3))
        for row, (a, b) in enumerate(PAIRS):
            B[:, :, row] = g[..., a, None] * F[:, :, None, :, b]
            if a != b:
                B[:, :, row] += g[..., b, None] * F[:, :, None, :, a]
        B = B.reshape(n_elements, n_q, 6, -1)
        C = self.fe.material.stiffness
        K = np.einsum("eqsi,eqsj->eij", B, (C @ B) * volumes[..., None, None], optimize=True)
        by_stress = np.einsum("eqma,eqab,eqnb,eq->emn", g, S, g, volumes, optimize=True)
        blocks = K.reshape(n_elements, n_local, 3, n_local, 3).swapaxes(2, 3).copy()
        blocks += by_stress[..., None, None] * np.eye(3)
        structure = self.fe.discretisation.structure
        return structure.block_matrix(structure.sums(blocks))

    def load(self, force: Any) -> Any:
        """Return the nodal loads of a force (3,) [N] that pulls the tip's face evenly, shape (n_nodes, 3)."""
        loads = np.zeros_like(self.fe.x)
        loads[self.tip.nodes] = np.outer(self.tip.translation_weights, force)
        return loads

    def rest(self, force: Any) -> Any:
        """Return the displacements (n_nodes, 3) [m] at rest under a dead force (3,) [N], by Newton's method.

        Raises
        ------
        RuntimeError
            Newton's method doesn't converge.
        """
        load, u = self.load(np.array(force)), np.zeros_like(self.fe.x)
        for part in np.arange(1, STEPS + 1) / STEPS:
            for _ in range(CORRECTIONS):
                left = (part * load - self.force(u)).ravel()[self.free]
                K = self.tangent(u)[self.free][:, self.free]
                change = np.zeros(u.size)
                change[self.free] = spsolve(K.tocsc(), left)
                u = u + change.reshape(u.shape)
                if np.abs(change).max() < SETTLED * np.abs(u).max():
                    break
            else:
                raise RuntimeError(f"the solid's rest under {force} N was not found")
        return u
