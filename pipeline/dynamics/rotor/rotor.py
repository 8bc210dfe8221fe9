"""One flexible body turning about a fixed axis, driven by a torque at its joint.

With ``p = (1, q)``, ``ṗ = (0, q̇)`` and the inertia Gram tensor G of the body about the joint, spin about e needs
only two combinations of it::

    D = Σ_ab (δ_ab − e_a e_b) G[a, b]        A = ε_abc e_a G[b, c]

    inertia   J = pᵀ D p            coupling   H = (pᵀ A)_modes        modal mass   1
    Q_θ = τ − 2 θ̇ pᵀ D ṗ           Q_q = θ̇² (D p) + 2 θ̇ (A ṗ) − ω² q + τ ψ

Coordinate 0 is the frame's angle θ, the others are the modal coordinates q.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pipeline.core.arrays import EPSILON, Array, IntArray
from pipeline.dynamics.jit.compiled import aligned, inlined, meaning
from pipeline.dynamics.system import accelerations, advance, fast_steps, hold_slow, velocities
from pipeline.dynamics.vibration import highest_frequency
from pipeline.reduction.body import FlexibleBody

# Below this part of the modal mass a coupling between modes is too small to tell within a major cycle.
_DIAGONAL = 1e-5
_ROUND_OFF = 1e-9


class TorquePulse(NamedTuple):
    """A half-sine torque, ``peak sin(π (t − start)/duration)``, of angular impulse ``2/π peak duration``.

    Attributes
    ----------
    start, duration : float
        When it acts [s].
    peak : float
        Largest torque [N m].
    """

    start: float
    duration: float
    peak: float


class PlanarParameters(NamedTuple):
    """What the kernels read; arrays of length 1 + n begin with the frame's angle."""

    D: Array
    A: Array
    stiffness: Array  # (1 + n,) ω², 0 for the angle
    lever: Array  # (1 + n,) work of the torque on each coordinate: 1, ψ
    pulse: TorquePulse
    gyroscopic: bool  # A is not zero
    diagonal: bool  # modes don't couple with each other through the spin
    Dp: Array  # (1 + n,), room to work in: D p and D ṗ of the last solution
    Dv: Array


class FrozenPlanar(NamedTuple):
    """The fast coordinates' equation over a major cycle: ``a_S = constant + slope s − K q_S − C v_S + τ ψ``.

    ``s`` is the time since the cycle began; the slope is what is known then of the held terms' rate of change.
    """

    time: Array  # (1,), when the cycle began
    constant: Array  # (1 + n,)
    slope: Array  # (1 + n,)
    v_now: Array  # (1 + n,), room to work in
    k: Array  # (1 + n,), instead of K and C where modes don't couple with each other
    K: Array  # (1 + n, 1 + n), transposed
    C: Array  # (1 + n, 1 + n), transposed and negative
    d: Array  # (1 + n,), of the last step where modes don't couple: h v
    load: Array  # (1 + n,), of the next step: h² (constant + slope s)


class MiddlePlanar(NamedTuple):
    """The equations at a major cycle's middle: the fast ones, with S̄ divided out unless diagonal, and the angle's.

    ``J a_y = force − k (q_S − q*_S) − c (v_S − v*_S) + τ``.
    """

    frozen: FrozenPlanar  # of the fast coordinates
    angle: Array  # (3,): J, force, 1/(J − HᵀH)
    H: Array  # (1 + n,)
    lever: Array  # (1 + n,), work of the torque on the fast coordinates, the angle reacting
    turn: Array  # (1 + n,), 2 θ̇ D p + 2 A ṗ
    k: Array  # (1 + n,)
    c: Array  # (1 + n,)
    q: Array  # (1 + n,): q*, v*
    v: Array  # (1 + n,)


@dataclass(frozen=True)
class PlanarRotor:
    """A flexible body on a torque-driven revolute joint, as the integrators see it.

    Parameters
    ----------
    body : FlexibleBody
        Referenced to the joint.
    pulse : TorquePulse
        The drive.
    """

    body: FlexibleBody
    pulse: TorquePulse

    n_slow = 1
    holds_forces = False

    def frozen(self) -> FrozenPlanar:
        """Fresh storage for the frozen coefficients of a major cycle."""
        n = self.n
        constant, slope, v_now, k, d, load = aligned(*6 * [n])
        return FrozenPlanar(
            time=np.zeros(1),
            constant=constant,
            slope=slope,
            v_now=v_now,
            k=k,
            K=np.zeros((n, n)),
            C=np.zeros((n, n)),
            d=d,
            load=load,
        )

    def middle(self) -> MiddlePlanar:
        """Fresh storage for what a major cycle's middle holds."""
        import pipeline.dynamics.rotor.middle  # noqa: F401 - gives the functions of `system` their meaning here

        return MiddlePlanar(self.frozen(), np.zeros(3), *aligned(*7 * [self.n]))

    @property
    def n(self) -> int:
        """Number of coordinates: the angle and the modes."""
        return 1 + len(self.body.omega)

    @property
    def n_positions(self) -> int:
        """The same."""
        return self.n

    @property
    def stiffness(self) -> Array:
        """Squared modal frequencies at the rate that the drive leads to from rest, 0 for the angle [1/s²]."""
        parameters = self._parameters
        softer = parameters.stiffness[1:] - self.driven_rate**2 * parameters.D.diagonal()[1:]
        return np.asarray(np.r_[0.0, np.maximum(softer, 0.0)])

    @property
    def driven_rate(self) -> float:
        """Rate to which the pulse brings the undeformed body from rest [rad/s]."""
        return float(2 / np.pi * self.pulse.peak * self.pulse.duration / self._parameters.D[0, 0])

    @property
    def groups(self) -> tuple[IntArray, IntArray]:
        """Group of like coordinates that each position and each rate belongs to: the angle, all modes together."""
        kind = np.minimum(np.arange(self.n), 1)
        return kind, kind

    @property
    def parameters(self) -> PlanarParameters:
        """Flat arrays for the kernels, with room to work in that is the caller's own."""
        Dp, Dv = aligned(self.n, self.n)
        return self._parameters._replace(Dp=Dp, Dv=Dv)

    @cached_property
    def _parameters(self) -> PlanarParameters:
        e, G = self.body.axis, self.body.gram.G
        D = np.einsum("ab,abij->ij", np.eye(3) - np.outer(e, e), G)
        A = np.einsum("a,abc,bcij->ij", e, EPSILON, G)
        modes = D[1:, 1:]
        off_diagonal = np.abs(modes - np.diag(modes.diagonal())).max(initial=0.0)
        # Modal masses are 1, the inertia is D[0, 0]: what a coupling is small against.
        coupling = max(np.abs(A[0]).max() / np.sqrt(D[0, 0]), np.abs(A[1:, 1:]).max(initial=0.0))
        return PlanarParameters(
            D=np.ascontiguousarray(D),
            A=np.ascontiguousarray(A),
            stiffness=np.r_[0.0, self.body.omega**2],
            lever=np.r_[1.0, self.body.joint_rotation],
            pulse=self.pulse,
            gyroscopic=bool(coupling > _ROUND_OFF),
            diagonal=bool(off_diagonal < _DIAGONAL and np.abs(A[1:, 1:]).max(initial=0.0) < _ROUND_OFF),
            Dp=np.empty(0),
            Dv=np.empty(0),
        )

    @cached_property
    def reference_mass(self) -> Array:
        """Mass matrix of angle and modes in the reference state, shape (n, n)."""
        parameters = self._parameters
        M = np.eye(self.n)
        M[0, 0] = parameters.D[0, 0]
        M[0, 1:] = M[1:, 0] = parameters.A[0, 1:]
        return M

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Begin and end of the torque [s]."""
        return (self.pulse.start, self.pulse.start + self.pulse.duration)

    @property
    def coupled(self) -> bool:
        """Whether angle and modes couple through the mass matrix in any state."""
        return self._parameters.gyroscopic

    @property
    def highest_frequency(self) -> float:
        """Highest coupled angular frequency in the reference state [rad/s]; it limits the plain explicit step."""
        K = np.diag(self._parameters.stiffness)
        return highest_frequency(self.reference_mass, K)

    @property
    def highest_fast_frequency(self) -> float:
        """Highest angular frequency of the modes with the frame held [rad/s]."""
        return float(self.body.omega.max())

    @property
    def highest_reacting_frequency(self) -> float:
        """The same as that of the whole: nothing holds the angle."""
        return self.highest_frequency

    @property
    def highest_slow_frequency(self) -> float:
        """Nothing holds the angle: all but 0."""
        return 1e-150

    def energies(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Kinetic and strain energy [J] of states q, v, shape (n_times, n)."""
        p = np.concatenate([np.ones((len(q), 1)), q[:, 1:]], axis=1)
        rate, modal_rates = v[:, 0], v[:, 1:]
        J = np.einsum("ti,ij,tj->t", p, self._parameters.D, p)
        H = (p @ self._parameters.A)[:, 1:]
        kinetic = 0.5 * (J * rate**2 + (modal_rates**2).sum(axis=1)) + rate * (H * modal_rates).sum(axis=1)
        return kinetic, 0.5 * (q**2 @ self._parameters.stiffness)


@inlined
def is_over(pulse: TorquePulse, t: float) -> bool:
    """Whether no torque acts from time t [s] on."""
    return t >= pulse.start + pulse.duration or pulse.peak == 0.0


@inlined
def torque(pulse: TorquePulse, t: float) -> float:
    """Torque at time t [s], [N m]."""
    s = t - pulse.start
    if s <= 0.0 or s >= pulse.duration:
        return 0.0
    return pulse.peak * math.sin(math.pi * s / pulse.duration)


@meaning(accelerations, PlanarParameters)
def _accelerations(p: PlanarParameters, t: float, q: Array, v: Array, a: Array) -> None:
    D, A, stiffness, lever, Dp, Dv = p.D, p.A, p.stiffness, p.lever, p.Dp, p.Dv
    n = q.size
    rate = v[0]
    tau = torque(p.pulse, t)
    J, half_dJ = D[0, 0], 0.0
    for j in range(1, n):
        J += D[0, j] * q[j]
        half_dJ += D[0, j] * v[j]
    HQ, HH = 0.0, 0.0
    for i in range(1, n):
        y, z = D[i, 0], 0.0
        for j in range(1, n):
            y += D[i, j] * q[j]
            z += D[i, j] * v[j]
        Dp[i], Dv[i] = y, z
        J += q[i] * y
        half_dJ += q[i] * z
        Q = rate * rate * y - stiffness[i] * q[i] + tau * lever[i]
        if p.gyroscopic:
            g, H = 0.0, A[0, i]
            for j in range(1, n):
                g += A[i, j] * v[j]
                H += A[j, i] * q[j]
            Q += 2.0 * rate * g
            HQ += H * Q
            HH += H * H
        a[i] = Q
    a[0] = (tau - 2.0 * rate * half_dJ - HQ) / (J - HH)
    if p.gyroscopic:
        for i in range(1, n):
            H = A[0, i]
            for j in range(1, n):
                H += A[j, i] * q[j]
            a[i] -= H * a[0]


@meaning(hold_slow, PlanarParameters)
def _hold_slow(p: PlanarParameters, t: float, q: Array, v: Array, a: Array, frozen: FrozenPlanar) -> None:
    D, A, stiffness, lever, Dp, Dv = p.D, p.A, p.stiffness, p.lever, p.Dp, p.Dv
    constant, slope, k, K, C = frozen.constant, frozen.slope, frozen.k, frozen.K, frozen.C
    n = q.size
    rate, acceleration = v[0], a[0]
    tau = torque(p.pulse, t)
    frozen.time[0] = t
    for i in range(1, n):
        slope[i] = 2.0 * rate * acceleration * Dp[i]
        if p.diagonal:  # modes couple with hardly anything but themselves: the rest changes linearly
            k[i] = stiffness[i] - rate * rate * D[i, i]
            constant[i] = a[i] + k[i] * q[i] - tau * lever[i]
            slope[i] += rate * rate * (Dv[i] - D[i, i] * v[i])
        else:
            H = A[0, i]
            for j in range(1, n):
                K[i, j] = -rate * rate * D[i, j]
                C[j, i] = 2.0 * rate * A[i, j]
                H += A[j, i] * q[j]
            K[i, i] += stiffness[i]
            constant[i] = rate * rate * D[i, 0] - H * acceleration


@meaning(fast_steps, PlanarParameters)
def _fast_steps(
    p: PlanarParameters, frozen: FrozenPlanar, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    if p.diagonal and is_over(p.pulse, frozen.time[0]):
        # Mode by mode, in increments d = h v: the processor works on several modes at once, and each waits for two
        # operations a step instead of four. A later call goes on with increments as they are, not by way of v.
        constant, slope, k = frozen.constant, frozen.slope, frozen.k
        square, over, begins = h * h, 1.0 / h, (first - 1) * h == frozen.time[0]
        since = (first + count - 1) * h - frozen.time[0]
        for i in range(1, q.size):
            qi, d, ki, rise = q[i], h * v[i], square * k[i], h * slope[i]
            load, more = square * (constant[i] + rise), square * rise
            if not begins:
                d, load = frozen.d[i], frozen.load[i]
            for _ in range(count - 1):
                d = (d + load) - ki * qi
                qi += d
                load += more
            a[i] = constant[i] + since * slope[i] - k[i] * qi
            d = (d + load) - ki * qi
            v[i], q[i] = over * d, qi + d
            frozen.d[i], frozen.load[i] = d, load + more
        return
    leap(p, p.lever, p.diagonal, frozen, float(first), h, count, q, v, a)


@inlined
def leap(
    p: PlanarParameters, lever: Array, diagonal: bool, frozen: FrozenPlanar,
    first: float, h: float, count: int, q: Array, v: Array, a: Array,
) -> None:  # fmt: skip
    """Take leapfrog steps h with the frozen equation and the torque by its lever, from time ``first · h``."""
    constant, slope, k, K, C = frozen.constant, frozen.slope, frozen.k, frozen.K, frozen.C
    v_now = frozen.v_now
    n = q.size
    for step in range(count):
        now = (first + step) * h
        tau = torque(p.pulse, now)
        since = now - frozen.time[0]
        if diagonal:
            for i in range(1, n):
                a[i] = constant[i] + since * slope[i] + tau * lever[i] - k[i] * q[i]
                v[i] += h * a[i]
                q[i] += h * v[i]
        else:
            for i in range(1, n):
                v_now[i] = v[i] + 0.5 * h * a[i]
                a[i] = constant[i] + since * slope[i] + tau * lever[i]
            for j in range(1, n):  # the first index is the column: row by row, in the order of memory
                for i in range(1, n):
                    a[i] -= K[j, i] * q[j]
            if p.gyroscopic:
                for j in range(1, n):
                    for i in range(1, n):
                        a[i] += C[j, i] * v_now[j]
            for i in range(1, n):
                v[i] += h * a[i]
                q[i] += h * v[i]


@meaning(advance, PlanarParameters)
def _advance(p: PlanarParameters, q: Array, v: Array, h: float, first: int, last: int) -> None:
    for i in range(first, last):
        q[i] += h * v[i]


@meaning(velocities, PlanarParameters)
def _velocities(p: PlanarParameters, q: Array, v: Array, dq: Array) -> None:
    for i in range(v.size):
        dq[i] = v[i]
