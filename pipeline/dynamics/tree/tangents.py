"""Derivatives of an open chain's Q̂ by its rates: the walk of `kernels` along directions u of the rates.

Frames and Jacobians are those of the last `mass_and_force`. Each frame's spin and bias are of degree 1 and 2 in the
rates, and their derivatives follow those of the frame before. With ``'`` for derivatives along u, the body's own force
and moment (see `kernels`) give::

    F' = −m a' − ω' × (ω × c + 2 ċ) − ω × (ω' × c + 2 ċ') − α' × c
    N' = −J α' − ω' × J ω − ω × J ω' − 2 (1 tr N_s − N_s)' ω − 2 (1 tr N_s − N_s) ω' + (ω × h)' − c × a'
"""

from __future__ import annotations

from pipeline.core.arrays import Array
from pipeline.dynamics.jit.compiled import inner, kernel
from pipeline.dynamics.links import FREE, PRISMATIC, REVOLUTE, SPHERICAL
from pipeline.dynamics.signals.signal import evaluate_signal
from pipeline.dynamics.tree.arrays import TreeParameters
from pipeline.dynamics.tree.frames import cross_add, tangent
from pipeline.dynamics.tree.kernels import add_scaled, modal_products, times_symmetric


@kernel
def velocity_tangents(
    p: TreeParameters, t: float, q: Array, v: Array, U: Array, first: int, carried: Array, room: Array, out: Array
) -> None:
    """Fill the rows of ``out`` (n, n) from ``first`` on with ``−∂Q̂/∂v u`` for those rows u of U (n, n).

    ``carried`` (n_bodies, n, 9) is room for the derivatives of the bodies' biases and spins, ``room`` (9, 12) for what
    is the same for all u.
    """
    n = v.size
    for j in range(first, n):
        for i in range(n):
            out[j, i] = 0.0
    for i in range(n):
        for k in range(n):
            if p.C[i, k] != 0.0:
                for j in range(first, n):
                    out[j, i] += p.C[i, k] * U[j, k]
    for b in range(p.parent.size):
        modal_products(p, b, q, v)
        _joint_now(p, t, b, q, v, room)
        _body_now(p, b, room)
        for j in range(first, n):
            _carry(p, b, U[j], j, carried, room)
            _subtract_force(p, b, U[j], carried[b, j], room, out[j])


@inner
def _turned(R: Array, x: Array, out: Array) -> None:
    """``out = R x``."""
    x0, x1, x2 = x[0], x[1], x[2]
    for i in range(3):
        out[i] = R[i, 0] * x0 + R[i, 1] * x1 + R[i, 2] * x2


@inner
def _add_cross(out: Array, a: Array, b: Array) -> None:
    cross_add(out, a[0], a[1], a[2], b[0], b[1], b[2])


@inner
def _joint_now(p: TreeParameters, t: float, b: int, q: Array, v: Array, room: Array) -> None:
    """Fill what `_carry` reads: spins, arms and how they sway, before and in body b's joint (rows 0 … 4)."""
    parent, kind, rate, position, J = p.parent[b], p.joint[b], p.rate[b], p.position[b], p.J[b]
    w, arm, sway = room[0], room[0][3:], room[0][6:]
    angle, turning, turned, c = room[1], room[1][3:], room[1][6:], room[2]
    w_joint, slide, slide_sway, own, axis = room[3], room[3][3:], room[3][6:], room[4], room[4][3:]
    for i in range(3):
        w[i], w_joint[i], turned[i] = 0.0, 0.0, 0.0
    if parent >= 0:
        R, mode = p.R[parent], p.mode[parent]
        for i in range(3):
            w[i], w_joint[i] = p.spin[parent, i], p.spin[parent, i]
            arm[i], sway[i], angle[i], turning[i] = p.place[b, i], 0.0, 0.0, 0.0
            for k in range(p.n_modes[parent]):
                arm[i] += p.place_shapes[b, i, k] * q[mode[k] + p.shift]
                sway[i] += 2.0 * p.place_shapes[b, i, k] * v[mode[k]]
                angle[i] += p.place_rotations[b, i, k] * q[mode[k] + p.shift]
                turning[i] += p.place_rotations[b, i, k] * v[mode[k]]
        _turned(R, arm, arm)
        _turned(R, sway, sway)
        _add_cross(sway, w, arm)
        size2 = angle[0] * angle[0] + angle[1] * angle[1] + angle[2] * angle[2]
        tangent(size2, c)
        along = angle[0] * turning[0] + angle[1] * turning[1] + angle[2] * turning[2]
        c[4], c[5] = size2, along
        for i in range(3):
            turned[i] = turning[i] + c[1] * (angle[i] * along - turning[i] * size2)
        cross_add(turned, c[0] * angle[0], c[0] * angle[1], c[0] * angle[2], turning[0], turning[1], turning[2])
        _turned(R, turned, turned)
        for i in range(3):
            w_joint[i] += turned[i]
    for i in range(3):
        own[i] = p.spin[b, i] - w_joint[i]
    if kind == FREE:
        for i in range(3):
            slide[i], slide_sway[i] = 0.0, 0.0
            for k in range(3):
                slide[i] += J[i, rate + k] * q[position + k]
                slide_sway[i] += 2.0 * J[i, rate + k] * v[rate + k]
        _add_cross(slide_sway, w_joint, slide)
    if kind == PRISMATIC:
        known = p.small[0]
        if p.motion[b] >= 0:
            evaluate_signal(p.signals, p.motion[b], t, known)
        else:
            known[0], known[1] = q[position], v[rate]
        _turned(p.R[b], p.axis[b], axis)
        for i in range(3):
            slide[i], slide_sway[i] = axis[i] * known[0], 2.0 * axis[i] * known[1]
        _add_cross(slide_sway, w_joint, slide)


@inner
def _body_now(p: TreeParameters, b: int, room: Array) -> None:
    """Fill what `_subtract_force` reads, in body b's axes (rows 5 … 8); `modal_products` has run for it."""
    m, R, n_modes = p.modal, p.R[b], p.n_modes[b]
    w, c, sway, h = room[5], room[5][3:], room[5][6:], room[5][9:]
    momentum, P, N = room[6], room[7], room[7][6:]
    for i in range(3):
        w[i] = R[0, i] * p.spin[b, 0] + R[1, i] * p.spin[b, 1] + R[2, i] * p.spin[b, 2]
        c[i], sway[i], h[i] = p.S[b, i, 0], 0.0, 0.0
        for k in range(1, 1 + n_modes):
            c[i] += 0.5 * (p.S[b, i, k] + m[14 + i, k]) * m[0, k]
            sway[i] += 2.0 * m[14 + i, k] * m[1, k]
            h[i] += m[8 + i, k] * m[1, k]
    _add_cross(sway, w, c)
    for i in range(6):
        P[i], N[i] = m[2 + i, 0], 0.0
        for k in range(1, 1 + n_modes):
            P[i] += m[2 + i, k] * m[0, k]
            N[i] += m[2 + i, k] * m[1, k]
    times_symmetric(P, w, momentum)
    trace = P[0] + P[1] + P[2]
    for i in range(3):
        momentum[i] = trace * w[i] - momentum[i]


@inner
def _carry_along(bias: Array, w: Array, sway: Array, arm: Array, dw: Array, d_sway: Array) -> None:
    """Carry a bias's derivative on by an arm; ``d_sway`` is twice its rate's own derivative, and then its sway's."""
    _add_cross(d_sway, dw, arm)
    _add_cross(bias, dw, sway)
    _add_cross(bias, w, d_sway)
    _add_cross(bias, bias[3:], arm)


@inner
def _carry(p: TreeParameters, b: int, u: Array, j: int, carried: Array, room: Array) -> None:
    """Derivatives along u of body b's bias and spin from those of its parent, into ``carried[b, j]``."""
    parent, kind, rate = p.parent[b], p.joint[b], p.rate[b]
    bias, dw, s = carried[b, j], carried[b, j, 6:], p.small
    x, d_sway, du = s[0], s[1], s[2]
    for i in range(9):
        bias[i] = 0.0 if parent < 0 else carried[parent, j, i]
    if parent >= 0:
        w, arm, sway = room[0], room[0][3:], room[0][6:]
        R, mode = p.R[parent], p.mode[parent]
        moved = False
        for i in range(3):
            d_sway[i], du[i] = 0.0, 0.0
        for k in range(p.n_modes[parent]):
            if u[mode[k]] != 0.0:
                moved = True
                for i in range(3):
                    d_sway[i] += 2.0 * p.place_shapes[b, i, k] * u[mode[k]]
                    du[i] += p.place_rotations[b, i, k] * u[mode[k]]
        if moved:
            _turned(R, d_sway, d_sway)
        _carry_along(bias, w, sway, arm, dw, d_sway)
        _add_cross(bias[3:], dw, room[1][6:])
        if moved:  # the joint turns on its parent by θ, at the rate A(θ) θ̇
            angle, turning, c = room[1], room[1][3:], room[2]
            one, two, d_one, d_two, size2, along = c[0], c[1], c[2], c[3], c[4], c[5]
            d_along = angle[0] * du[0] + angle[1] * du[1] + angle[2] * du[2]
            both = turning[0] * du[0] + turning[1] * du[1] + turning[2] * du[2]
            d_turned, change = s[3], s[4]
            for i in range(3):
                rest, d_rest = angle[i] * along - turning[i] * size2, angle[i] * d_along - du[i] * size2
                d_turned[i] = du[i] + two * d_rest
                change[i] = two * (2.0 * angle[i] * both - du[i] * along - turning[i] * d_along)
                change[i] += d_two * (d_along * rest + along * d_rest)
                x[i] = d_one * (d_along * turning[i] + along * du[i])
            _add_cross(change, angle, x)
            cross_add(d_turned, one * angle[0], one * angle[1], one * angle[2], du[0], du[1], du[2])
            _turned(R, d_turned, d_turned)
            _turned(R, change, change)
            for i in range(3):
                bias[3 + i] += change[i]
            _add_cross(bias[3:], w, d_turned)
            for i in range(3):
                dw[i] += d_turned[i]
    w_joint, own = room[3], room[4]
    if kind in (PRISMATIC, FREE):
        for i in range(3):
            d_sway[i] = 0.0
            if kind == FREE:
                for k in range(3):
                    d_sway[i] += 2.0 * p.J[b, i, rate + k] * u[rate + k]
            elif p.motion[b] < 0:
                d_sway[i] = 2.0 * room[4, 3 + i] * u[rate]
        _carry_along(bias, w_joint, room[3][6:], room[3][3:], dw, d_sway)
    _add_cross(bias[3:], dw, own)
    turn = rate + (3 if kind == FREE else 0)
    count = 3 if kind in (SPHERICAL, FREE) else (1 if kind == REVOLUTE and p.motion[b] < 0 else 0)
    if count > 0:
        for i in range(3):
            x[i] = 0.0
            for k in range(count):
                x[i] += p.J[b, 3 + i, turn + k] * u[turn + k]
        _add_cross(bias[3:], w_joint, x)
        for i in range(3):
            dw[i] += x[i]


@inner
def _subtract_force(p: TreeParameters, b: int, u: Array, carried: Array, room: Array, out: Array) -> None:
    """Take the derivative along u of body b's inertial forces from ``out`` (n,)."""
    n, n_modes, mode, m, mass, R, J, s = u.size, p.n_modes[b], p.mode[b], p.modal, p.mass[b], p.R[b], p.J[b], p.small
    w, c, sway, h, momentum, P, N = (
        room[5],
        room[5][3:],
        room[5][6:],
        room[5][9:],
        room[6],
        room[7],
        room[7][6:],
    )
    dw, a, d_sway, dh, dN, F, x, y = s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7]
    for i in range(3):  # in the body's axes
        a[i] = R[0, i] * carried[0] + R[1, i] * carried[1] + R[2, i] * carried[2]
        a[3 + i] = R[0, i] * carried[3] + R[1, i] * carried[4] + R[2, i] * carried[5]
        dw[i] = R[0, i] * carried[6] + R[1, i] * carried[7] + R[2, i] * carried[8]
        d_sway[i], dh[i], dN[i], dN[3 + i] = 0.0, 0.0, 0.0, 0.0
    for k in range(n_modes):
        change = u[mode[k]]
        if change != 0.0:
            for i in range(3):
                d_sway[i] += 2.0 * m[14 + i, 1 + k] * change
                dh[i] += m[8 + i, 1 + k] * change
                dN[i] += m[2 + i, 1 + k] * change
                dN[3 + i] += m[5 + i, 1 + k] * change
            for i in range(3):
                if p.active[b, 6 + i] and w[i] != 0.0:  # the columns of A are its rows turned round
                    factor = 2.0 * w[i] * change
                    for other in range(n_modes):
                        out[mode[other]] += factor * p.A[b, i, 1 + k, 1 + other]
    if n_modes > 0:
        _subtract_modal(p, b, w, dw, a, out)
    # Force on the origin and moment about it.
    for i in range(3):
        F[i] = -mass * a[i]
    _add_cross(d_sway, dw, c)
    _add_cross(F, sway, dw)
    _add_cross(F, d_sway, w)
    _add_cross(F, c, a[3:])
    times_symmetric(P, dw, x)
    times_symmetric(P, a[3:], y)
    trace, trace_N, trace_dN = P[0] + P[1] + P[2], N[0] + N[1] + N[2], dN[0] + dN[1] + dN[2]
    for i in range(3):
        x[i] = trace * dw[i] - x[i]
        F[3 + i] = y[i] - trace * a[3 + i] - 2.0 * (trace_dN * w[i] + trace_N * dw[i])
    _add_cross(F[3:], momentum, dw)
    _add_cross(F[3:], x, w)
    _add_cross(F[3:], dw, h)
    _add_cross(F[3:], w, dh)
    _add_cross(F[3:], a, c)
    times_symmetric(dN, w, x)
    times_symmetric(N, dw, y)
    for i in range(3):
        F[3 + i] += 2.0 * (x[i] + y[i])
    _turned(R, F, F)
    _turned(R, F[3:], F[3:])
    for i in range(6):
        if F[i] != 0.0:
            add_scaled(out, J[i], -F[i], n)


@inner
def _subtract_modal(p: TreeParameters, b: int, w: Array, dw: Array, a: Array, out: Array) -> None:
    """Take what body b's change of spin and bias do to its modes from ``out``."""
    m, mode, n_modes, factors, total = p.modal, p.mode[b], p.n_modes[b], p.small[8], p.modal[17]
    wdw = w[0] * dw[0] + w[1] * dw[1] + w[2] * dw[2]
    factors[3] = 2.0 * (w[1] * dw[2] + dw[1] * w[2])
    factors[4] = 2.0 * (w[0] * dw[2] + dw[0] * w[2])
    factors[5] = 2.0 * (w[0] * dw[1] + dw[0] * w[1])
    for i in range(3):
        factors[i] = 2.0 * (w[i] * dw[i] - wdw)
        factors[6 + i] = -a[3 + i]
        factors[9 + i] = -2.0 * dw[i]
    for k in range(1 + n_modes):
        total[k] = 0.0
    for i in range(12):
        if factors[i] != 0.0:
            add_scaled(total, m[2 + i], factors[i], 1 + n_modes)
    for i in range(3):
        if a[i] != 0.0:
            add_scaled(total, m[14 + i], a[i], 1 + n_modes)
    for k in range(n_modes):
        out[mode[k]] += total[1 + k]
