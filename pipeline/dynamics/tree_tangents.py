"""Derivatives of an open chain's Q̂ by its rates: the walk of `tree_kernels` along directions u of the rates.

Frames and Jacobians are those of the last `mass_and_force`. Spins follow the rates by the Jacobians; each bias is of
degree 2 in the rates, and its derivative follows that of the body before. With ``'`` for derivatives along u, the
body's own force and moment (see `tree_kernels`) give::

    F' = −m a' − ω' × (ω × c + 2 ċ) − ω × (ω' × c + 2 ċ') − α' × c
    N' = −J α' − ω' × J ω − ω × J ω' − 2 (1 tr N_s − N_s)' ω − 2 (1 tr N_s − N_s) ω' + (ω × h)' − c × a'
"""

from __future__ import annotations

from pipeline.checks import Array
from pipeline.dynamics.compiled import inlined, kernel
from pipeline.dynamics.link import FREE, PRISMATIC, REVOLUTE, SPHERICAL
from pipeline.dynamics.signal import evaluate_signal
from pipeline.dynamics.tree_arrays import TreeParameters
from pipeline.dynamics.tree_frames import cross_add, tangent
from pipeline.dynamics.tree_kernels import modal_products, times_symmetric


@kernel
def velocity_tangents(
    p: TreeParameters, t: float, q: Array, v: Array, U: Array, first: int, biases: Array, out: Array
) -> None:
    """Fill the rows of ``out`` (n, n) from ``first`` on with ``−∂Q̂/∂v u`` for those rows u of U (n, n).

    ``biases`` (n_bodies, n, 6) is room for the derivatives of the bodies' biases.
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
        for j in range(first, n):
            _carry_bias(p, t, b, q, v, U[j], j, biases)
            _subtract_force(p, b, v, U[j], biases[b, j], out[j])


@inlined
def _turned(R: Array, x: Array, out: Array) -> None:
    """``out = R x``."""
    for i in range(3):
        out[i] = R[i, 0] * x[0] + R[i, 1] * x[1] + R[i, 2] * x[2]


@inlined
def _add_cross(out: Array, a: Array, b: Array) -> None:
    cross_add(out, a[0], a[1], a[2], b[0], b[1], b[2])


@kernel
def _carry_along(bias: Array, w: Array, dw: Array, arm: Array, moving: Array, d_moving: Array, room: Array) -> None:
    """Carry a bias's derivative on by an arm that changes at the rate ``moving`` in a frame of spin w."""
    for i in range(3):
        room[i], room[3 + i] = 2.0 * moving[i], 2.0 * d_moving[i]
    _add_cross(room, w, arm)
    _add_cross(room[3:], dw, arm)
    _add_cross(bias, dw, room)
    _add_cross(bias, w, room[3:])
    _add_cross(bias, bias[3:], arm)


@kernel
def _carry_bias(p: TreeParameters, t_now: float, b: int, q: Array, v: Array, u: Array, j: int, biases: Array) -> None:
    """Derivative along u of body b's bias from that of its parent, into ``biases[b, j]``."""
    bias, s, room = biases[b, j], p.small, p.small[8]
    w, dw, arm, moving, d_moving = s[0], s[1], s[2], s[3], s[4]
    parent, kind, rate, position = p.parent[b], p.joint[b], p.rate[b], p.position[b]
    for i in range(6):
        bias[i] = 0.0 if parent < 0 else biases[parent, j, i]
    for i in range(3):
        w[i], dw[i] = 0.0, 0.0
    if parent >= 0:
        R, J, mode, n_modes = p.R[parent], p.J[parent], p.mode[parent], p.n_modes[parent]
        t, dt, ut, x = s[5], s[5][3:], s[5][6:], s[5][9:]
        for i in range(3):
            w[i] = p.spin[parent, i]
            for k in range(u.size):
                dw[i] += J[3 + i, k] * u[k]
            arm[3 + i], moving[3 + i], d_moving[3 + i] = p.place[b, i], 0.0, 0.0
            t[i], dt[i], ut[i] = 0.0, 0.0, 0.0
            for k in range(n_modes):
                shape, turn = p.place_shapes[b, i, k], p.place_rotations[b, i, k]
                arm[3 + i] += shape * q[mode[k] + p.shift]
                moving[3 + i] += shape * v[mode[k]]
                d_moving[3 + i] += shape * u[mode[k]]
                t[i] += turn * q[mode[k] + p.shift]
                dt[i] += turn * v[mode[k]]
                ut[i] += turn * u[mode[k]]
        _turned(R, arm[3:], arm)
        _turned(R, moving[3:], moving)
        _turned(R, d_moving[3:], d_moving)
        _carry_along(bias, w, dw, arm, moving, d_moving, room)
        if n_modes > 0:  # the joint turns on its parent by θ: A θ̇, and half the second derivative's two parts
            size2 = t[0] * t[0] + t[1] * t[1] + t[2] * t[2]
            tdt = t[0] * dt[0] + t[1] * dt[1] + t[2] * dt[2]
            tut = t[0] * ut[0] + t[1] * ut[1] + t[2] * ut[2]
            both = dt[0] * ut[0] + dt[1] * ut[1] + dt[2] * ut[2]
            c = s[7]
            tangent(size2, c)
            one, two, d_one, d_two = c[0], c[1], c[2], c[3]
            turned, d_turned, turning = s[6], s[6][3:], s[6][6:]
            for i in range(3):
                along, d_along = t[i] * tdt - dt[i] * size2, t[i] * tut - ut[i] * size2
                turned[i], d_turned[i] = dt[i] + two * along, ut[i] + two * d_along
                turning[i] = two * (2.0 * t[i] * both - ut[i] * tdt - dt[i] * tut) + d_two * (
                    tut * along + tdt * d_along
                )
                x[i] = d_one * (tut * dt[i] + tdt * ut[i])
            _add_cross(turning, t, x)
            cross_add(turned, one * t[0], one * t[1], one * t[2], dt[0], dt[1], dt[2])
            cross_add(d_turned, one * t[0], one * t[1], one * t[2], ut[0], ut[1], ut[2])
            _turned(R, turned, arm)
            _turned(R, d_turned, moving)
            _turned(R, turning, d_moving)
            for i in range(3):
                bias[3 + i] += d_moving[i]
            _add_cross(bias[3:], dw, arm)
            _add_cross(bias[3:], w, moving)
            for i in range(3):
                w[i] += arm[i]
                dw[i] += moving[i]
    if kind == REVOLUTE:  # the spin that the joint adds is what the body's differs by
        for i in range(3):
            x_now, d_now = p.spin[b, i] - w[i], 0.0
            if p.motion[b] < 0:
                d_now = p.J[b, 3 + i, rate] * u[rate]
            arm[i], moving[i] = x_now, d_now
        _add_cross(bias[3:], dw, arm)
        _add_cross(bias[3:], w, moving)
    if kind in (PRISMATIC, FREE):
        _slide(p, t_now, b, q, v, u, arm, moving, d_moving)
        _carry_along(bias, w, dw, arm, moving, d_moving, room)
    if kind in (SPHERICAL, FREE):
        turn = rate + (3 if kind == FREE else 0)
        _turned(p.R[b], v[turn : turn + 3], arm)
        _turned(p.R[b], u[turn : turn + 3], moving)
        _add_cross(bias[3:], dw, arm)
        _add_cross(bias[3:], w, moving)


@kernel
def _slide(
    p: TreeParameters, t: float, b: int, q: Array, v: Array, u: Array, arm: Array, moving: Array, d_moving: Array
) -> None:
    """How far a prismatic or free joint has moved its body, at what rate, and the rate's derivative along u."""
    J, rate, position, known = p.J[b], p.rate[b], p.position[b], p.small[5]
    if p.joint[b] == FREE:
        for i in range(3):
            arm[i], moving[i], d_moving[i] = 0.0, 0.0, 0.0
            for k in range(3):
                arm[i] += J[i, rate + k] * q[position + k]
                moving[i] += J[i, rate + k] * v[rate + k]
                d_moving[i] += J[i, rate + k] * u[rate + k]
        return
    if p.motion[b] >= 0:
        evaluate_signal(p.signals, p.motion[b], t, known)
        known[2] = 0.0
    else:
        known[0], known[1], known[2] = q[position], v[rate], u[rate]
    _turned(p.R[b], p.axis[b], d_moving)
    for i in range(3):
        along = d_moving[i]
        arm[i], moving[i], d_moving[i] = along * known[0], along * known[1], along * known[2]


@kernel
def _subtract_force(p: TreeParameters, b: int, v: Array, u: Array, bias: Array, out: Array) -> None:
    """Take the derivative along u of body b's inertial forces from ``out`` (n,); `modal_products` has run for it."""
    n, n_modes, mode, m, mass, R, J, s = v.size, p.n_modes[b], p.mode[b], p.modal, p.mass[b], p.R[b], p.J[b], p.small
    w, dw, accel, c, rate, d_rate, h, dh = s[0], s[0][3:], s[1], s[2], s[2][3:], s[2][6:], s[3], s[3][3:]
    P, N, dN, F, x, y = s[4], s[4][6:], s[5], s[6], s[7], s[7][3:]
    spin = s[8]
    for i in range(3):
        spin[i] = 0.0
        for k in range(n):
            spin[i] += J[3 + i, k] * u[k]
    for i in range(3):  # in the body's axes
        w[i] = R[0, i] * p.spin[b, 0] + R[1, i] * p.spin[b, 1] + R[2, i] * p.spin[b, 2]
        dw[i] = R[0, i] * spin[0] + R[1, i] * spin[1] + R[2, i] * spin[2]
        accel[i] = R[0, i] * bias[0] + R[1, i] * bias[1] + R[2, i] * bias[2]
        accel[3 + i] = R[0, i] * bias[3] + R[1, i] * bias[4] + R[2, i] * bias[5]
        c[i], rate[i], d_rate[i], h[i], dh[i] = p.S[b, i, 0], 0.0, 0.0, 0.0, 0.0
        for k in range(n_modes):
            ui = u[mode[k]]
            c[i] += 0.5 * (p.S[b, i, 1 + k] + m[14 + i, 1 + k]) * m[0, 1 + k]
            rate[i] += m[14 + i, 1 + k] * m[1, 1 + k]
            d_rate[i] += m[14 + i, 1 + k] * ui
            h[i] += m[8 + i, 1 + k] * m[1, 1 + k]
            dh[i] += m[8 + i, 1 + k] * ui
    for i in range(6):
        P[i], N[i], dN[i] = m[2 + i, 0], 0.0, 0.0
        for k in range(n_modes):
            P[i] += m[2 + i, 1 + k] * m[0, 1 + k]
            N[i] += m[2 + i, 1 + k] * m[1, 1 + k]
            dN[i] += m[2 + i, 1 + k] * u[mode[k]]
    # Forces on the modes.
    wdw = w[0] * dw[0] + w[1] * dw[1] + w[2] * dw[2]
    yz, xz, xy = w[1] * dw[2] + dw[1] * w[2], w[0] * dw[2] + dw[0] * w[2], w[0] * dw[1] + dw[0] * w[1]
    for k in range(1, 1 + n_modes):
        total = 2.0 * (yz * m[5, k] + xz * m[6, k] + xy * m[7, k])
        for a in range(3):
            total += 2.0 * (w[a] * dw[a] - wdw) * m[2 + a, k] + m[14 + a, k] * accel[a]
            total -= accel[3 + a] * m[8 + a, k] + 2.0 * dw[a] * m[11 + a, k]
        out[mode[k - 1]] += total
    for a in range(3):
        if p.active[b, 6 + a] and w[a] != 0.0:
            for i in range(n_modes):
                ui = 2.0 * w[a] * u[mode[i]]  # the columns of A are its rows turned round
                if ui != 0.0:
                    for k in range(n_modes):
                        out[mode[k]] += ui * p.A[b, a, 1 + i, 1 + k]
    # Force on the origin and moment about it.
    for i in range(3):
        x[i], y[i] = 2.0 * rate[i], 2.0 * d_rate[i]
        F[i] = -mass * accel[i]
    _add_cross(x, w, c)
    _add_cross(y, dw, c)
    _add_cross(F, x, dw)
    _add_cross(F, y, w)
    _add_cross(F, c, accel[3:])
    _add_moment(P, w, dw, accel[3:], N, dN, F[3:], x, y)
    _add_cross(F[3:], dw, h)
    _add_cross(F[3:], w, dh)
    _add_cross(F[3:], accel, c)
    _turned(R, F, x)
    _turned(R, F[3:], y)
    for k in range(n):
        out[k] -= J[0, k] * x[0] + J[1, k] * x[1] + J[2, k] * x[2] + J[3, k] * y[0] + J[4, k] * y[1] + J[5, k] * y[2]


@kernel
def _add_moment(
    P: Array, w: Array, dw: Array, d_accel: Array, N: Array, dN: Array, M: Array, x: Array, y: Array
) -> None:
    """What the second moments P and N give to the derivative of a body's moment, into M."""
    trace, trace_N, trace_dN = P[0] + P[1] + P[2], N[0] + N[1] + N[2], dN[0] + dN[1] + dN[2]
    times_symmetric(P, w, x)
    times_symmetric(P, dw, y)
    for i in range(3):
        x[i], y[i] = trace * w[i] - x[i], trace * dw[i] - y[i]
        M[i] = 0.0
    _add_cross(M, x, dw)
    _add_cross(M, y, w)
    times_symmetric(P, d_accel, x)
    for i in range(3):
        M[i] += x[i] - trace * d_accel[i] - 2.0 * (trace_dN * w[i] + trace_N * dw[i])
    times_symmetric(dN, w, x)
    times_symmetric(N, dw, y)
    for i in range(3):
        M[i] += 2.0 * (x[i] + y[i])
