"""Reference state of a compiled mechanism, undeformed: its matrices, frequencies and longest stable steps."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.rank import DEPENDENT_CONSTRAINT
from fmd.dynamics.compiled_system.equations import Equations
from fmd.dynamics.linear_forces import LinearForces, linearise_forces
from fmd.dynamics.vibration import highest_frequency, largest_leapfrog_step


class FreeMotion(NamedTuple):
    """Mass, stiffness and damping (n, n) of the motions that are free, the slow ones first, and their number."""

    M: Array
    K: Array
    C: Array
    n_slow: int


def free_motion(M: Array, K: Array, C: Array, n_slow: int, J: Array) -> FreeMotion:
    """Reduce matrices (n, n) to the motions that constraints ``J v = 0``, (n_rows, n), leave free.

    These are the motions of slow coordinates alone, and those of fast ones to which the slow ones react at once, by
    their inertia and by the constraints: ``M_LL D + J_Lᵀ μ = M_LS``, ``J_L D = J_S``. The two don't couple by the mass.
    Without constraints the matrices stay as they are.
    """
    if not len(J):
        return FreeMotion(M, K, C, n_slow)
    slow, fast = slice(0, n_slow), slice(n_slow, None)
    alone = _null_space(J[:, slow])
    D = np.linalg.pinv(J[:, slow], rcond=DEPENDENT_CONSTRAINT) @ J[:, fast]
    if alone.shape[1]:
        left = alone.T @ (M[slow, fast] - M[slow, slow] @ D)
        D = D + alone @ np.linalg.solve(alone.T @ M[slow, slow] @ alone, left)
    answered = _null_space(J[:, fast] - J[:, slow] @ D)  # constraints that no slow coordinate can keep
    T = np.block([[alone, -D @ answered], [np.zeros((len(M) - n_slow, alone.shape[1])), answered]])
    return FreeMotion(T.T @ M @ T, T.T @ K @ T, T.T @ C @ T, alone.shape[1])


def _null_space(A: Array) -> Array:
    """Return an orthonormal basis (n, k) of what a matrix (m, n) takes to zero."""
    if not A.size:
        return np.eye(A.shape[1])
    _, sizes, directions = np.linalg.svd(A)
    rank = int((sizes > DEPENDENT_CONSTRAINT * max(1.0, float(sizes.max()))).sum())
    return np.asarray(directions[rank:].T)


class ReferenceState(Equations):
    """A mechanism's small motions about its undeformed state at rest.

    Its own stiffness and damping count, and its mass with all joints at 0 or where the loops close.
    """

    @cached_property
    def _reference_mass(self) -> Array:
        return self.mass_matrix(self.mechanism.rest_positions)

    @cached_property
    def linear_forces(self) -> LinearForces:
        """Constant stiffness and damping of modes, joints and force elements in the reference state."""
        return linearise_forces(self.mechanism)

    @property
    def stiffest_matrices(self) -> tuple[Array, Array, Array]:
        """Mass, stiffness and damping of the undeformed mechanism with all its end stops touched, (n, n) each."""
        forces = self.linear_forces
        return self._reference_mass, forces.K + forces.stop_K, forces.C + forces.stop_C

    @property
    def linear_matrices(self) -> tuple[Array, Array, Array]:
        """Mass, stiffness and damping of the undeformed mechanism, (n, n) each, without its loops."""
        return self._reference_mass, self.linear_forces.K, self.linear_forces.C

    @cached_property
    def free_motion(self) -> FreeMotion:
        """Mass, stiffness and damping of the motions of the undeformed mechanism that its loops leave free."""
        return free_motion(*self.linear_matrices, self.n_slow, self._reference_constraints)

    @cached_property
    def stiffest_motion(self) -> FreeMotion:
        """Mass, stiffness and damping of the motions that loops leave free, with all end stops touched."""
        return free_motion(*self.stiffest_matrices, self.n_slow, self._reference_constraints)

    @cached_property
    def _reference_constraints(self) -> Array:
        """J of the loops' constraints in the reference state, shape (n_rows, n)."""
        return self.constraint_jacobian(self.mechanism.rest_positions)

    @property
    def stiffness(self) -> Array:
        """Squared modal frequencies, and springs over what they move in the undeformed mechanism [1/s²]."""
        return self.linear_forces.own / self._reference_mass.diagonal()

    @property
    def frequencies_hz(self) -> Array:
        """Of each mode and of each joint by itself, undeformed [Hz], shape (n,); 0 where it has no stiffness."""
        mechanism = self.mechanism
        own = np.sqrt(self.linear_forces.K.diagonal() / self._reference_mass.diagonal())
        for k, link in enumerate(mechanism.links):
            own[mechanism.modes_of(k)] = link.omega
        return np.asarray(own / (2 * np.pi))

    @cached_property
    def highest_frequency(self) -> float:
        """Highest coupled angular frequency in the reference state [rad/s]."""
        return highest_frequency(*self.free_motion[:2])

    @cached_property
    def highest_fast_frequency(self) -> float:
        """Highest angular frequency of the fast coordinates with the slow ones frozen, or reacting where loops are."""
        return self._highest(slice(self.free_motion.n_slow, None))

    @cached_property
    def largest_step(self) -> float:
        """Longest stable leapfrog step in the reference state [s]."""
        return largest_leapfrog_step(*self.stiffest_motion[:3])

    @cached_property
    def largest_fast_step(self) -> float:
        """Longest stable leapfrog step of the fast coordinates with the slow ones frozen [s]."""
        *matrices, n_slow = self.stiffest_motion
        return largest_leapfrog_step(*(A[n_slow:, n_slow:] for A in matrices))

    @cached_property
    def largest_slow_step(self) -> float:
        """Longest stable leapfrog step of the slow coordinates with the fast ones frozen [s]."""
        *matrices, n_slow = self.stiffest_motion
        return largest_leapfrog_step(*(A[:n_slow, :n_slow] for A in matrices))

    @cached_property
    def highest_slow_frequency(self) -> float:
        """Highest angular frequency of the slow coordinates with the fast ones frozen [rad/s]."""
        return self._highest(slice(0, self.free_motion.n_slow))

    def _highest(self, part: slice) -> float:
        M, K, _, _ = self.free_motion
        return highest_frequency(M[part, part], K[part, part])
