"""Equations of motion of a planar rotor, and its fast steps with the angle's motion held.

With ``p = (1, q)``, ``ṗ = (0, q̇)`` and the inertia Gram tensor G of the body about the joint, spin about e needs
only two combinations of it::

    D = Σ_ab (δ_ab − e_a e_b) G[a, b]        A = ε_abc e_a G[b, c]

    inertia   J = pᵀ D p            coupling   H = (pᵀ A)_modes        modal mass   1
    Q_θ = τ − 2 θ̇ pᵀ D ṗ           Q_q = θ̇² (D p) + 2 θ̇ (A ṗ) − ω² q + τ ψ
"""

from __future__ import annotations

import math

from pipeline.core.arrays import Array
from pipeline.dynamics.jit.compiled import inlined, meaning
from pipeline.dynamics.rotor.parameters import FrozenPlanar, PlanarParameters, TorquePulse
from pipeline.dynamics.system import accelerations, advance, fast_steps, hold_slow, velocities


@inlined
def is_over(pulse: TorquePulse, t: float) -> bool:
    """Return true if no torque acts from time t [s] on."""
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
