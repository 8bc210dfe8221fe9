"""Equations of a planar rotor held at the middle of a major cycle, for reversible sub-cycling.

With ``p = (1, q)`` as in `kernels` and the torque left out, the tangents of the generalised forces are::

    Q_θ = −2 θ̇ pᵀ D ṗ                    −∂Q_θ/∂(θ̇, q̇, q) = 2 pᵀ D ṗ,         2 θ̇ D p,   2 θ̇ D ṗ
    Q_q = θ̇² D p + 2 θ̇ A ṗ − ω² q        −∂Q_q/∂(θ̇, q̇, q) = −2 θ̇ D p − 2 A ṗ,  −2 θ̇ A,   ω² − θ̇² D

The angle reacts by ``T = (−Hᵀ/J, 1)``, and ``S̄ = 1 − H Hᵀ/J`` is inverted by ``S̄⁻¹ = 1 + H Hᵀ/(J − HᵀH)``.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.jit.compiled import inlined, meaning
from pipeline.dynamics.rotor.kernels import is_over, leap, torque
from pipeline.dynamics.rotor.parameters import MiddlePlanar, PlanarParameters
from pipeline.dynamics.system import hold_middle, reacting_steps, slow_response


@meaning(hold_middle, PlanarParameters)
def _hold_middle(p: PlanarParameters, t: float, q: Array, v: Array, D: Array, middle: MiddlePlanar) -> None:
    G, A, Dp, Dv = p.D, p.A, p.Dp, p.Dv
    angle, H, lever, turn, k_angle, c_angle = middle.angle, middle.H, middle.lever, middle.turn, middle.k, middle.c
    q_middle, v_middle = middle.q, middle.v
    constant, k, K, C = middle.frozen.constant, middle.frozen.k, middle.frozen.K, middle.frozen.C
    n, rate = q.size, v[0]
    J, half_dJ, HH = G[0, 0], 0.0, 0.0
    for i in range(1, n):
        y, z = G[i, 0], 0.0
        for j in range(1, n):
            y += G[i, j] * q[j]
            z += G[i, j] * v[j]
        Dp[i], Dv[i] = y, z
        J += G[0, i] * q[i] + q[i] * y
        half_dJ += G[0, i] * v[i] + q[i] * z
        q_middle[i], v_middle[i] = q[i], v[i]
    angle[0], angle[1] = J, -2.0 * rate * half_dJ
    middle.frozen.time[0] = np.inf  # of the first step, which is to come
    if not p.gyroscopic:  # the angle doesn't react
        for i in range(1, n):
            D[i, 0], lever[i] = 0.0, p.lever[i]
            k_angle[i], c_angle[i] = 2.0 * rate * Dv[i], 2.0 * rate * Dp[i]
            constant[i] = rate * rate * Dp[i]
            if p.diagonal:
                k[i] = p.stiffness[i] - rate * rate * G[i, i]
                constant[i] -= rate * rate * G[i, i] * q[i]
            else:
                for j in range(1, n):
                    K[j, i] = -rate * rate * G[i, j]
                    constant[i] += K[j, i] * q[j]
                K[i, i] += p.stiffness[i]
        return
    for i in range(1, n):
        y = A[0, i]
        for j in range(1, n):
            y += A[j, i] * q[j]
        H[i], D[i, 0] = y, y / J
        HH += y * y
    for i in range(1, n):
        k_angle[i], c_angle[i] = 2.0 * rate * Dv[i], 2.0 * (rate * Dp[i] - half_dJ * D[i, 0])
    for i in range(1, n):
        g = 0.0
        for j in range(1, n):
            g += A[i, j] * v[j]
        turn[i] = 2.0 * (rate * Dp[i] + g)
        lever[i] = p.lever[i] - D[i, 0]
        total = rate * (rate * Dp[i] + 2.0 * g) - p.stiffness[i] * q[i] - D[i, 0] * angle[1]
        if p.diagonal:
            k[i] = p.stiffness[i] - rate * rate * G[i, i]
            constant[i] = total + k[i] * q[i]
            continue
        for j in range(1, n):
            K[j, i] = -rate * rate * G[i, j] - D[i, 0] * k_angle[j]
            C[j, i] = 2.0 * rate * A[i, j] - turn[i] * D[j, 0] + D[i, 0] * c_angle[j]
            if i == j:
                K[j, i] += p.stiffness[i]
            total += K[j, i] * q[j] - C[j, i] * v[j]
        constant[i] = total
    over = 1.0 / (J - HH)
    angle[2] = over
    if p.diagonal:
        at_angle, turned = _at_angle(q, v, H, k_angle, c_angle)
        for i in range(1, n):
            constant[i] += (turn[i] * turned - H[i] * at_angle) / J
        return
    _divide(H, over, constant)
    _divide(H, over, lever)
    for j in range(1, n):
        _divide(H, over, K[j])
        _divide(H, over, C[j])


@inlined
def _at_angle(q: Array, v: Array, H: Array, k: Array, c: Array) -> tuple[float, float]:
    """How modes that don't couple with each other act on the angle, and how they turn it times J."""
    total, turned = 0.0, 0.0
    for j in range(1, v.size):
        total += k[j] * q[j] + c[j] * v[j]
        turned += H[j] * v[j]
    return total, turned


@inlined
def _react(
    p: PlanarParameters, middle: MiddlePlanar, first: float, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    """Take steps with modes that couple with each other by the angle's reaction alone: O(n) each."""
    angle, H, lever, turn, k_angle, c_angle = middle.angle, middle.H, middle.lever, middle.turn, middle.k, middle.c
    constant, k, v_now = middle.frozen.constant, middle.frozen.k, middle.frozen.v_now
    n = q.size
    for step in range(count):
        tau = torque(p.pulse, (first + step) * h)
        for i in range(1, n):
            v_now[i] = v[i] + 0.5 * h * a[i]
        at_angle, turned = _at_angle(q, v_now, H, k_angle, c_angle)
        at_angle, turned = at_angle / angle[0], turned / angle[0]
        total = 0.0
        for i in range(1, n):
            a[i] = constant[i] + tau * lever[i] - k[i] * q[i] + H[i] * at_angle - turn[i] * turned
            total += H[i] * a[i]
        total *= angle[2]
        for i in range(1, n):
            a[i] += total * H[i]
            v[i] += h * a[i]
            q[i] += h * v[i]


@inlined
def _divide(H: Array, over: float, x: Array) -> None:
    """``x ← S̄⁻¹ x``."""
    total = 0.0
    for i in range(1, x.size):
        total += H[i] * x[i]
    total *= over
    for i in range(1, x.size):
        x[i] += total * H[i]


@meaning(reacting_steps, PlanarParameters)
def _reacting_steps(
    p: PlanarParameters, middle: MiddlePlanar, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    time = middle.frozen.time
    time[0] = min(time[0], first * h)
    if p.diagonal and p.gyroscopic:
        _react(p, middle, first + 0.5, h, count, q, v, a)
    elif p.diagonal and is_over(p.pulse, time[0]):
        constant, k = middle.frozen.constant, middle.frozen.k
        for i in range(1, q.size):  # mode by mode: the processor works on several at once
            qi, vi, last, ki, load = q[i], v[i], 0.0, h * k[i], h * constant[i]
            for _ in range(count):
                last = qi
                vi = (vi + load) - ki * qi
                qi += h * vi
            a[i], v[i], q[i] = constant[i] - k[i] * last, vi, qi
    else:
        leap(p, middle.lever, p.diagonal, middle.frozen, first + 0.5, h, count, q, v, a)


@meaning(slow_response, PlanarParameters)
def _slow_response(
    p: PlanarParameters, middle: MiddlePlanar, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    total = 0.0
    if not is_over(p.pulse, first * h):
        for step in range(count):
            total += torque(p.pulse, (first + step + 0.5) * h)
        total /= count
    angle, k, c, q_middle, v_middle = middle.angle, middle.k, middle.c, middle.q, middle.v
    total += angle[1]
    for i in range(1, v.size):
        total -= k[i] * (q[i] - q_middle[i]) + c[i] * (v[i] - v_middle[i])
    a[0] = total / angle[0]
