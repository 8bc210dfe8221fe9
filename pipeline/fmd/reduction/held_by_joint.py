"""Static responses of a body as a joint holds it, from those of the free body: the joint's reaction balances loads."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.linalg import null_space

from fmd.core.arrays import Array, IntArray
from fmd.reduction.eigen import FreeBodySolver

if TYPE_CHECKING:
    from collections.abc import Callable

    from fmd.fem.model import FEModel


class JointHeldSolver:
    """Static responses of a free body that a joint holds by constraints ``Bᵀ u = 0``, with columns (n_nodes, 3, k).

    Rigid motions Z that these leave, `rigid_modes`, are accelerated by a load f, whose reaction r follows from
    ``Rᵀ (f + B r) = Rᵀ M Z a`` with all rigid motions R. The response is that to ``f + B r``, moved rigidly until the
    constraints hold; so it does no work on r, and is symmetric.
    """

    def __init__(self, fe: FEModel, solver: FreeBodySolver, constraints: Array) -> None:
        R = solver.rigid_modes
        self._solver, self._B, self._R = solver, constraints.reshape(len(R), -1), R
        self.rigid_modes = R @ null_space(self._B.T @ R)
        whole = np.concatenate([-R.T @ self._B, R.T @ (fe.M @ self.rigid_modes)], axis=1)
        self._reaction = np.linalg.inv(whole)[: self._B.shape[1]]  # (k, 6): to forces and moments of a load

    def static_response(self, f: Array) -> Array:
        """Return displacements (n_nodes, 3, n_loads) [m] by nodal loads [N] and the reaction to them."""
        return self._held(f, self._solver.static_response)

    def remembered_response(self, f: Array) -> Array:
        """Return `static_response` of loads, of which only those are solved for that it hasn't had before."""
        return self._held(f, self._solver.remembered_response)

    def _held(self, f: Array, respond: Callable[[Array], Array]) -> Array:
        flat = f.reshape(len(self._R), -1)
        loads = (flat + self._B @ (self._reaction @ (self._R.T @ flat))).reshape(f.shape)
        u = respond(loads).reshape(flat.shape)
        return np.asarray((u + self._R @ (self._reaction.T @ (self._B.T @ u))).reshape(f.shape))

    def flexibility(self, nodes: IntArray) -> Array:
        """Return the displacements of nodes by unit forces on each, (3 n, 3 n) [m/N]."""
        moved, reaction = self._by_reaction(nodes)
        turned = moved @ reaction
        return np.asarray(self._solver.flexibility(nodes) + turned + turned.T)

    def responder(self) -> Callable[[IntArray, Array], Array]:
        """Return what finds displacements of nodes by forces on them, (3 n, k) each, one solution a column."""
        free = self._solver.responder()

        def respond(nodes: IntArray, forces: Array) -> Array:
            moved, reaction = self._by_reaction(nodes)
            return free(nodes, forces) + moved @ (reaction @ forces) + reaction.T @ (moved.T @ forces)

        return respond

    def _by_reaction(self, nodes: IntArray) -> tuple[Array, Array]:
        """Return X (3 n, k) and the reactions ρ (k, 3 n) to forces on nodes: ``X ρ + ρᵀ Xᵀ`` is what these add."""
        u = self._solver.remembered_response(self._B.reshape(-1, 3, self._B.shape[1]))
        moved = u[nodes].reshape(3 * len(nodes), -1)
        reaction = self._reaction @ self._R.reshape(-1, 3, 6)[nodes].reshape(len(moved), 6).T
        return moved + 0.5 * reaction.T @ (self._B.T @ u.reshape(self._B.shape)), reaction


StaticSolver: TypeAlias = FreeBodySolver | JointHeldSolver
