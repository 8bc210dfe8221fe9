"""Reference state of a compiled mechanism, undeformed: its matrices, frequencies and longest stable steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.rank import DEPENDENT_CONSTRAINT
from fmd.dynamics.compiled_system.equations import Equations
from fmd.dynamics.linear_forces import LinearForces, gather_linear_forces, linearise_forces
from fmd.dynamics.vibration import highest_frequency, largest_leapfrog_step

if TYPE_CHECKING:
    from fmd.dynamics.mechanism import Mechanism


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


_OF_INERTIA = {"_reference_mass", "lightest_motion"}


class ReferenceState(Equations):
    """A mechanism's small motions about its undeformed state at rest.

    Its own stiffness and damping count, and its mass with all joints at 0 or where the loops close.
    """

    def share_structure(self, like: ReferenceState) -> None:
        """Take code, and what has been found, of a system that differs in numbers of its code alone."""
        self.compiled.take_code_of(like.compiled)
        self.mechanism.share_structure(like.mechanism)
        if not self.mechanism.lifted:  # of which inertia is a number, too
            vars(self).update({name: vars(like)[name] for name in _OF_INERTIA & vars(like).keys()})

    @cached_property
    def _reference_mass(self) -> Array:
        return self.mass_matrix(self.mechanism.rest_positions)

    @cached_property
    def lightest_motion(self) -> tuple[float, Array]:
        """Least inertia of a motion in the reference state, over that of its coordinates alone, and its rates (n,)."""
        M = self._reference_mass
        sizes = np.sqrt(np.maximum(M.diagonal(), 0.0))
        sizes[sizes == 0.0] = 1.0
        least, vectors = np.linalg.eigh(M / np.outer(sizes, sizes))
        return float(least[0]), vectors[:, 0] / sizes

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


@dataclass(frozen=True)
class FastestPart:
    """Stiffness or damper that sets the shortest time in a mechanism's reference state."""

    name: str
    damps: bool  # true if it is a damper that stops a motion, false if it is a stiffness that makes a vibration
    # Angular frequency of that vibration, or one over the time in which the motion falls to 37 % [rad/s or 1/s].
    rate: float


def find_fastest_part(system: ReferenceState) -> FastestPart | None:
    """Find the part with the largest share in the fastest vibration or the fastest decay, with all end stops touched.

    Loops are left open. None stands for a mechanism without stiffness and dampers.
    """
    M, K, C = system.stiffest_matrices
    if not len(M) or not (K.any() or C.any()):
        return None
    (squared, swings), (decay, stops) = _largest(K, M), _largest(C, M)
    omega = float(np.sqrt(max(squared, 0.0)))
    damps = decay > 2.0 * omega
    shape = stops if damps else swings
    shares = {name: abs(float(shape @ (part[1] if damps else part[0]) @ shape)) for name, part in _parts(system)}
    return FastestPart(max(shares, key=lambda name: shares[name]), damps, decay if damps else omega)


def _largest(A: Array, M: Array) -> tuple[float, Array]:
    """Return the largest eigenvalue of ``A x = λ M x`` and its vector."""
    from scipy.linalg import eigh

    values, shapes = eigh(0.5 * (A + A.T), M)
    return float(values[-1]), np.asarray(shapes[:, -1])


def _parts(system: ReferenceState) -> Iterator[tuple[str, tuple[Array, Array]]]:
    """Yield each joint, each body and each force element by its name, with its stiffness and damping (n, n)."""
    mechanism = system.mechanism
    links = list(mechanism.links)
    whole = gather_linear_forces(links, mechanism.layout)
    for k, link in enumerate(links):
        loose = [*links[:k], replace(link, spring=0.0, damper=0.0, laws=()), *links[k + 1 :]]
        without = gather_linear_forces(loose, mechanism.layout)
        yield f"joint '{link.joint_name or link.name}'", _difference(whole, without)
        modes, own = mechanism.modes_of(k), np.zeros((2, mechanism.n, mechanism.n))
        own[0, modes, modes] = link.omega**2
        own[1, modes, modes] = 2.0 * link.damping * link.omega if len(link.damping) else 0.0
        yield f"the modes of body '{link.part or link.name}'", (own[0], own[1])
    yield from _elements(mechanism, whole)


def _elements(mechanism: Mechanism, without: LinearForces) -> Iterator[tuple[str, tuple[Array, Array]]]:
    """Yield each force element by its name, with its stiffness and damping."""
    for element in mechanism.elements:
        yield (
            f"{element.title} '{element.name}'",
            _difference(linearise_forces(replace(mechanism, elements=[element])), without),
        )


def _difference(a: LinearForces, b: LinearForces) -> tuple[Array, Array]:
    """Return by how much stiffness and damping differ, with end stops."""
    return a.K + a.stop_K - b.K - b.stop_K, a.C + a.stop_C - b.C - b.stop_C
