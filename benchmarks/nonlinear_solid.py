"""A solid of St. Venant–Kirchhoff's material on the project's own mesh: strain energy, forces and tangent stiffness.

Strain is Green's, ``E = ½ (H + Hᵀ + Hᵀ H)`` of the displacement gradient H, stress is ``S = C E``; so the energy
``½ ∫ E·C E dV`` is a quartic polynomial of the displacements. Integrals are taken at the points of the linear
stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu, spsolve

from fmd.fem.gradients import gradients
from fmd.fem.markers import Marker
from fmd.fem.model import FEModel

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # components of strain and stress, shears doubled
STEPS, CORRECTIONS, SETTLED = 4, 30, 1e-10
RHO, SLOW, CLOSE = 0.8, 0.2, 1e-7  # of marches: spectral radius, when a tangent is renewed, and what counts as found


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
        g, det = gradients(space, X, slice(None))
        return g, det * w

    @property
    def volumes(self) -> Any:
        """Volume of each quadrature point [m³], shape (n_elements, n_q)."""
        return self._points[1]

    @cached_property
    def free(self) -> Any:
        """Unknowns that aren't held: all but those of the root's nodes."""
        held = (3 * self.root.nodes[:, None] + np.arange(3)).ravel()
        return np.setdiff1d(np.arange(3 * len(self.fe.x)), held)

    def displacement_gradients(self, u: Any) -> Any:
        """Return ``H[…, i, j, :] = ∂u_i/∂x_j`` of fields u (n_nodes, 3, k), shape (n_elements, n_q, 3, 3, k)."""
        g, local = self._points[0], self.fe.discretisation.element_nodes
        flat = u[local].reshape(len(local), 1, local.shape[1], -1)
        H = (g.swapaxes(2, 3) @ flat).reshape(*g.shape[:2], 3, 3, -1)
        return H.swapaxes(2, 3)

    def _stress(self, u: Any) -> tuple[Any, Any]:
        """Return the deformation gradient F and the second Piola–Kirchhoff stress S of a field u (n_nodes, 3)."""
        F = self.displacement_gradients(u[:, :, None])[..., 0] + np.eye(3)
        E = 0.5 * (F.swapaxes(2, 3) @ F - np.eye(3))
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

    def march(self, u: Any, times: Any, step: float) -> Any:
        """Return the displacement (n_times, 3) of the tip after the solid is let go at displacements u (n_nodes, 3).

        The generalised-α method of `fmd.integrators.generalized_alpha`, on all unknowns, without loads.

        Raises
        ------
        RuntimeError
            Newton's method doesn't converge in a step.
        """
        alpha_m, alpha_f = (2 * RHO - 1) / (RHO + 1), RHO / (RHO + 1)
        beta, gamma = 0.25 * (1 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f
        share, free = step**2 * beta * (1 - alpha_f) / (1 - alpha_m), self.free
        M = self.fe.M[free][:, free].tocsc()
        v, acc = np.zeros(len(free)), -splu(M).solve(self.force(u).ravel()[free])
        a, tips, solve = acc.copy(), [self.tip.translation(u)], None
        for _ in range(round(times[-1] / step)):
            mean = (alpha_f * acc - alpha_m * a) / (1 - alpha_m)
            still = u.ravel()[free] + step * v + step**2 * ((0.5 - beta) * a + beta * mean)
            q = u.ravel()[free] + step * v  # a guess: accelerations of stiff shapes would carry it far out
            ahead = (q - still) / share
            before = np.inf
            for trial in range(CORRECTIONS):
                moved = np.zeros(u.size)
                moved[free] = q
                moved = moved.reshape(u.shape)
                if solve is None:
                    solve = splu((M / share + self.tangent(moved)[free][:, free]).tocsc()).solve
                change = solve(-(M @ ahead + self.force(moved).ravel()[free]))
                q, ahead, size = q + change, ahead + change / share, float(np.abs(change).max())
                if size < CLOSE * np.abs(q).max():
                    break
                if trial and size > SLOW * before:
                    solve = None
                before = size
            else:
                raise RuntimeError("Newton's method doesn't converge; take a smaller step")
            ahead_a = mean + (1 - alpha_f) / (1 - alpha_m) * ahead
            v = v + step * ((1 - gamma) * a + gamma * ahead_a)
            a, acc, u = ahead_a, ahead, np.zeros(u.size)
            u[free] = q
            u = u.reshape(self.fe.x.shape)
            tips.append(self.tip.translation(u))
        grid = step * np.arange(len(tips))
        return np.stack([np.interp(times, grid, column) for column in np.array(tips).T], axis=1)
