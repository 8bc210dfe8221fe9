"""Linear systems ``M q̈ + C q̇ + K q = 0`` in the form that integrators take, to measure their stability on."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fmd.core.arrays import Array, require_shape
from fmd.dynamics.compiled_system.parameters import Responses
from fmd.dynamics.system import (
    PlainSystem,
    accelerations,
    advance,
    fast_steps,
    find_responses,
    freeze_slow,
    leapfrog_step,
    velocities,
)
from fmd.dynamics.vibration import highest_frequency, largest_leapfrog_step
from fmd.kernels.table import Table


@dataclass(frozen=True)
class LinearParameters(Table):
    """Constants of ``a = −A q − B v`` and of the fast coordinates' ``a_S = −W (K_SS q_S + C_SS v_S + frozen)``.

    B, C and C_SS have no columns if no term depends on the rates.
    """

    n_slow: int
    A: Array  # (n, n) M⁻¹ K
    B: Array  # (n, n or 0) M⁻¹ C
    M: Array  # (n, n)
    C: Array  # (n, n or 0)
    K: Array  # (n, n)
    K_SS: Array  # (n_fast, n_fast)
    C_SS: Array  # (n_fast, n_fast or 0)
    W: Array  # (n_fast, n_fast) M_SS⁻¹
    v_now: Array  # (n_fast,), room to work in


@dataclass(frozen=True)
class FrozenLinear(Table):
    """Forces of the slow coordinates on the fast ones over a cycle: ``frozen = K_SL q_L + C_SL v_L + M_SL a_L``."""

    frozen: Array  # (n_fast,)
    right: Array  # (n_fast,), room to work in


@dataclass(frozen=True)
class LinearSystem(PlainSystem):
    """Mass, stiffness and rate coefficients of a linear system, its slow coordinates first.

    Parameters
    ----------
    M, K : ndarray, shape (n, n)
        Mass, positive definite, and stiffness.
    n_slow : int
        Number of slow coordinates.
    C : ndarray, shape (n, n), optional
        Coefficients of the rates: damping, gyroscopic terms.
    """

    M: Array
    K: Array
    n_slow: int
    C: Array | None = None

    breakpoints = ()
    shortest_action = np.inf

    def __post_init__(self) -> None:
        for name in ("M", "K"):
            require_shape(name, getattr(self, name), (len(self.M), len(self.M)))
        if not 0 <= self.n_slow <= self.n:
            raise ValueError(f"n_slow is {self.n_slow}, expected 0 … {self.n}")

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.M)

    @property
    def n_positions(self) -> int:
        """Number of position coordinates, here one for each rate."""
        return self.n

    def resolving_step(self, step: float) -> tuple[float, float]:
        """Return the step itself, for there is no load to step over."""
        return step, np.inf

    @property
    def coupled(self) -> bool:
        """True if slow and fast coordinates couple through the mass matrix."""
        return bool(self.M[: self.n_slow, self.n_slow :].any())

    @property
    def stiffness(self) -> Array:
        """Diagonal of ``M⁻¹ K`` [1/s²], shape (n,)."""
        return np.asarray(self._packed.A.diagonal())

    @property
    def linear_matrices(self) -> tuple[Array, Array, Array]:
        """Mass, stiffness and damping, (n, n) each."""
        return self.M, self.K, np.zeros_like(self.K) if self.C is None else self.C

    @property
    def parameters(self) -> LinearParameters:
        """Flat arrays for the kernels, with a work array that no other caller has."""
        return replace(self._packed, v_now=np.zeros(self.n - self.n_slow))

    @cached_property
    def _packed(self) -> LinearParameters:
        C = np.zeros((self.n, 0)) if self.C is None else self.C
        inverse = np.linalg.inv(self.M)
        S = slice(self.n_slow, None)
        of_fast = self.K[S, S], C[S, S], np.linalg.inv(self.M[S, S])
        arrays = (inverse @ self.K, inverse @ C, self.M, C, self.K, *of_fast, np.empty(0))
        return LinearParameters(self.n_slow, *(np.ascontiguousarray(a, dtype=float) for a in arrays))

    def leapfrog(self) -> Array:
        """Return room for rates."""
        return np.zeros(self.n)

    def frozen(self, cycle: float) -> FrozenLinear:
        """Return new arrays for the coefficients that `freeze_slow` freezes over a major cycle."""
        return FrozenLinear(np.zeros(self.n - self.n_slow), np.zeros(self.n - self.n_slow))

    def responses(self) -> Responses:
        """Return the inverse mass matrix in blocks of eight columns, as if it were unit forces."""
        blocks = np.zeros((-(-self.n // 8), self.n, 8))
        inverse = np.linalg.inv(self.M)
        for i in range(self.n):
            blocks[i // 8, :, i % 8] = inverse[i]
        return Responses(0, 0, 0, 0, blocks)

    @property
    def highest_frequency(self) -> float:
        """Highest angular frequency of the undamped system [rad/s]."""
        return self._highest(slice(0, None))

    @property
    def highest_fast_frequency(self) -> float:
        """Highest angular frequency of the fast coordinates with the slow ones frozen [rad/s]."""
        return self._highest(slice(self.n_slow, None))

    @property
    def largest_step(self) -> float:
        """Longest stable leapfrog step [s]."""
        return largest_leapfrog_step(*self.linear_matrices)

    @property
    def largest_fast_step(self) -> float:
        """Longest stable leapfrog step of the fast coordinates with the slow ones frozen [s]."""
        return largest_leapfrog_step(*(A[self.n_slow :, self.n_slow :] for A in self.linear_matrices))

    @property
    def largest_slow_step(self) -> float:
        """Longest stable leapfrog step of the slow coordinates with the fast ones frozen [s]."""
        return largest_leapfrog_step(*(A[: self.n_slow, : self.n_slow] for A in self.linear_matrices))

    @property
    def highest_slow_frequency(self) -> float:
        """Highest angular frequency of the slow coordinates with the fast ones frozen [rad/s]."""
        return self._highest(slice(0, self.n_slow))

    def _highest(self, part: slice) -> float:
        return highest_frequency(self.M[part, part], self.K[part, part])


@accelerations.register(LinearParameters)
def _accelerations(p: LinearParameters, t: float, q: Array, v: Array, a: Array) -> None:
    A, B = p.A, p.B
    for i in range(v.size):
        a[i] = 0.0
    for j in range(v.size):
        for i in range(v.size):
            a[i] -= A[i, j] * q[j]
    for j in range(B.shape[1]):
        for i in range(v.size):
            a[i] -= B[i, j] * v[j]


@leapfrog_step.register(LinearParameters)
def _leapfrog_step(p: LinearParameters, leapfrog: Array, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    for i in range(v.size):
        leapfrog[i] = v[i] + 0.5 * h * a[i]
    accelerations(p, t, q, leapfrog, a)
    for i in range(v.size):
        v[i] += h * a[i]
        q[i] += h * v[i]


@freeze_slow.register(LinearParameters)
def _freeze_slow(p: LinearParameters, t: float, q: Array, v: Array, a: Array, frozen: FrozenLinear) -> None:
    M, C, K, force, n_slow = p.M, p.C, p.K, frozen.frozen, p.n_slow
    for i in range(n_slow, v.size):
        force[i - n_slow] = 0.0
        for j in range(n_slow):
            force[i - n_slow] += K[i, j] * q[j] + M[i, j] * a[j]
        for j in range(min(n_slow, C.shape[1])):
            force[i - n_slow] += C[i, j] * v[j]


@fast_steps.register(LinearParameters)
def _fast_steps(
    p: LinearParameters, frozen: FrozenLinear, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    K, C, W, v_now, force, right, n_fast = p.K_SS, p.C_SS, p.W, p.v_now, frozen.frozen, frozen.right, frozen.right.size
    q, v, a = q[p.n_slow :], v[p.n_slow :], a[p.n_slow :]
    for _ in range(count):
        for i in range(n_fast):
            v_now[i] = v[i] + 0.5 * h * a[i]
            right[i] = -force[i]
            a[i] = 0.0
        for j in range(n_fast):
            for i in range(n_fast):
                right[i] -= K[i, j] * q[j]
        for j in range(C.shape[1]):
            for i in range(n_fast):
                right[i] -= C[i, j] * v_now[j]
        for j in range(n_fast):
            for i in range(n_fast):
                a[i] += W[i, j] * right[j]
        for i in range(n_fast):
            v[i] += h * a[i]
            q[i] += h * v[i]


@advance.register(LinearParameters)
def _advance(p: LinearParameters, q: Array, v: Array, h: float, first: int, last: int) -> None:
    for i in range(first, last):
        q[i] += h * v[i]


@velocities.register(LinearParameters)
def _velocities(p: LinearParameters, q: Array, v: Array, dq: Array) -> None:
    for i in range(v.size):
        dq[i] = v[i]


@find_responses.register(LinearParameters)
def _find_responses(
    p: LinearParameters, responses: Responses, t: float, q: Array, v: Array, a: Array, X: Array
) -> None:
    accelerations(p, t, q, v, a)
    for block in range(X.shape[0]):
        for j in range(X.shape[1]):
            for k in range(X.shape[2]):
                X[block, j, k] = responses.units[block, j, k]
