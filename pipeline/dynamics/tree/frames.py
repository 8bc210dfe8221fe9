"""The walk from the ground outwards: each body's frame, its Jacobian and its bias, from the body that carries it."""

from __future__ import annotations

import math

from pipeline.core.arrays import Array
from pipeline.dynamics.jit.compiled import addressed, inner
from pipeline.dynamics.links import FREE, PRISMATIC, REVOLUTE, SPHERICAL
from pipeline.dynamics.signals.signal import evaluate_signal
from pipeline.dynamics.tree.arrays import TreeParameters


@inner
def cross_add(out: Array, a0: float, a1: float, a2: float, b0: float, b1: float, b2: float) -> None:
    """``out += a × b``."""
    out[0] += a1 * b2 - a2 * b1
    out[1] += a2 * b0 - a0 * b2
    out[2] += a0 * b1 - a1 * b0


@inner
def _turn(R: Array, axis: Array, angle: float, out: Array) -> None:
    """``out = R rot(axis, angle)`` by Rodrigues' formula, row by row."""
    c, s = math.cos(angle), math.sin(angle)
    for i in range(3):
        r0, r1, r2 = R[i, 0], R[i, 1], R[i, 2]
        along = (r0 * axis[0] + r1 * axis[1] + r2 * axis[2]) * (1.0 - c)
        out[i, 0] = c * r0 + along * axis[0] + s * (r1 * axis[2] - r2 * axis[1])
        out[i, 1] = c * r1 + along * axis[1] + s * (r2 * axis[0] - r0 * axis[2])
        out[i, 2] = c * r2 + along * axis[2] + s * (r0 * axis[1] - r1 * axis[0])


@inner
def _turn_quaternion(R: Array, e: Array, out: Array) -> None:
    """``out = R rot(e)`` for a unit quaternion e, scalar part last."""
    x, y, z, w = e[0], e[1], e[2], e[3]
    for i in range(3):
        r0, r1, r2 = R[i, 0], R[i, 1], R[i, 2]
        out[i, 0] = r0 * (1 - 2 * (y * y + z * z)) + r1 * 2 * (x * y + w * z) + r2 * 2 * (x * z - w * y)
        out[i, 1] = r0 * 2 * (x * y - w * z) + r1 * (1 - 2 * (x * x + z * z)) + r2 * 2 * (y * z + w * x)
        out[i, 2] = r0 * 2 * (x * z + w * y) + r1 * 2 * (y * z - w * x) + r2 * (1 - 2 * (x * x + y * y))


@inner
def tangent(size2: float, out: Array) -> None:
    """Coefficients of ``A(θ) = 1 + out₀ θ̃ + out₁ θ̃²`` for |θ|² = size2, and their slopes over θ·θ̇, into out (4,)."""
    size = math.sqrt(size2)
    if size > 0.05:
        out[0], out[1] = (1.0 - math.cos(size)) / size2, (size - math.sin(size)) / (size * size2)
        out[2] = (size * math.sin(size) - 2.0 * (1.0 - math.cos(size))) / (size2 * size2)
        out[3] = (3.0 * math.sin(size) - size * (2.0 + math.cos(size))) / (size2 * size2 * size)
    else:  # series: the differences above cancel
        out[0] = 0.5 - size2 / 24.0 + size2**2 / 720.0 - size2**3 / 40320.0
        out[1] = 1.0 / 6.0 - size2 / 120.0 + size2**2 / 5040.0 - size2**3 / 362880.0
        out[2] = -1.0 / 12.0 + size2 / 180.0 - size2**2 / 6720.0
        out[3] = -1.0 / 60.0 + size2 / 1260.0 - size2**2 / 60480.0


@addressed
def place_joint(p: TreeParameters, b: int, q: Array, v: Array, R0: Array) -> None:
    """Frame of the joint on the parent, moved and turned by the parent's modes, into body b's own; R0 (3, 3)."""
    origin, spin, bias, J, place = p.origin[b], p.spin[b], p.bias[b], p.J[b], p.place[b]
    n = v.size
    parent = p.parent[b]
    if parent < 0:
        for i in range(3):
            origin[i] = place[i]
            spin[i] = 0.0
            bias[i] = -p.gravity[i]
            bias[3 + i] = 0.0
            for j in range(3):
                R0[i, j] = 1.0 if i == j else 0.0
        for i in range(6):
            for j in range(n):
                J[i, j] = 0.0
        return
    R, w, above = p.R[parent], p.spin[parent], p.J[parent]
    mode, n_modes, shapes, rotations = p.mode[parent], p.n_modes[parent], p.place_shapes[b], p.place_rotations[b]
    origin_above, bias_above = p.origin[parent], p.bias[parent]
    arm, moving, angle, rate = p.small[0], p.small[1], p.small[2], p.small[3]
    for i in range(3):
        r, u, a, da = place[i], 0.0, 0.0, 0.0
        for k in range(n_modes):
            coordinate, its_rate = q[mode[k] + p.shift], v[mode[k]]
            r += shapes[i, k] * coordinate
            u += shapes[i, k] * its_rate
            a += rotations[i, k] * coordinate
            da += rotations[i, k] * its_rate
        arm[3 + i], moving[3 + i], angle[i], rate[i] = r, u, a, da
    # The marker turns by the vector θ = Ψ q: R exp(θ̃); its rotation rate is A(θ) θ̇.
    size2 = angle[0] ** 2 + angle[1] ** 2 + angle[2] ** 2
    size, c = math.sqrt(size2), p.small[8]
    tangent(size2, c)
    one, two, d_one, d_two = c[0], c[1], c[2], c[3]
    for i in range(3):
        arm[i] = R[i, 0] * arm[3] + R[i, 1] * arm[4] + R[i, 2] * arm[5]
        moving[i] = R[i, 0] * moving[3] + R[i, 1] * moving[4] + R[i, 2] * moving[5]
    for i in range(3):
        origin[i] = origin_above[i] + arm[i]
        bias[i], bias[3 + i] = bias_above[i], bias_above[3 + i]
        spin[i] = w[i]
        for j in range(n):
            J[3 + i, j] = above[3 + i, j]
    w_arm = p.small[4]
    for i in range(3):
        w_arm[i] = 2.0 * moving[i]
    cross_add(w_arm, w[0], w[1], w[2], arm[0], arm[1], arm[2])
    cross_add(bias, w[0], w[1], w[2], w_arm[0], w_arm[1], w_arm[2])
    cross_add(bias, bias[3], bias[4], bias[5], arm[0], arm[1], arm[2])
    for j in range(n):
        J[0, j] = above[0, j] + above[4, j] * arm[2] - above[5, j] * arm[1]
        J[1, j] = above[1, j] + above[5, j] * arm[0] - above[3, j] * arm[2]
        J[2, j] = above[2, j] + above[3, j] * arm[1] - above[4, j] * arm[0]
    for i in range(3):
        for k in range(n_modes):
            total = 0.0
            for j in range(3):
                total += R[i, j] * shapes[j, k]
            J[i, mode[k]] += total
    if n_modes == 0:
        for i in range(3):
            for j in range(3):
                R0[i, j] = R[i, j]
        return
    # A θ̇ and its derivative with θ̈ = 0, in the parent's axes: A = 1 + one θ̃ + two θ̃².
    t, dt, turned, turning = angle, rate, p.small[5], p.small[6]
    tdt = t[0] * dt[0] + t[1] * dt[1] + t[2] * dt[2]
    dt2 = dt[0] ** 2 + dt[1] ** 2 + dt[2] ** 2
    for i in range(3):
        # θ̃²θ̇ = θ(θ·θ̇) − θ̇ θ², and its derivative θ̇(θ·θ̇) + θ θ̇² − 2 θ̇ (θ·θ̇)
        turned[i] = dt[i] + two * (t[i] * tdt - dt[i] * size2)
        turning[i] = two * (t[i] * dt2 - dt[i] * tdt) + d_two * tdt * (t[i] * tdt - dt[i] * size2)
    cross_add(turned, one * t[0], one * t[1], one * t[2], dt[0], dt[1], dt[2])
    scale = d_one * tdt
    cross_add(turning, scale * t[0], scale * t[1], scale * t[2], dt[0], dt[1], dt[2])
    for k in range(n_modes):
        s0, s1, s2 = rotations[0, k], rotations[1, k], rotations[2, k]
        ts = t[0] * s0 + t[1] * s1 + t[2] * s2
        column = p.small[7]
        column[0] = s0 + two * (t[0] * ts - s0 * size2)
        column[1] = s1 + two * (t[1] * ts - s1 * size2)
        column[2] = s2 + two * (t[2] * ts - s2 * size2)
        cross_add(column, one * t[0], one * t[1], one * t[2], s0, s1, s2)
        for i in range(3):
            J[3 + i, mode[k]] += R[i, 0] * column[0] + R[i, 1] * column[1] + R[i, 2] * column[2]
    for i in range(3):
        moving[i] = R[i, 0] * turned[0] + R[i, 1] * turned[1] + R[i, 2] * turned[2]
        bias[3 + i] += R[i, 0] * turning[0] + R[i, 1] * turning[1] + R[i, 2] * turning[2]
    cross_add(bias[3:], w[0], w[1], w[2], moving[0], moving[1], moving[2])
    for i in range(3):
        spin[i] += moving[i]
    if size > 0.0:
        for i in range(3):
            turned[i] = t[i] / size
    else:
        turned[0], turned[1], turned[2] = 0.0, 0.0, 1.0
    _turn(R, turned, size, R0)


@addressed
def move_through_joint(p: TreeParameters, t: float, b: int, q: Array, v: Array, R0: Array) -> None:
    """Move body b's frame through its joint; R0 is the joint's frame on the parent."""
    R, spin, bias, J, axis = p.R[b], p.spin[b], p.bias[b], p.J[b], p.axis[b]
    kind, rate, position = p.joint[b], p.rate[b], p.position[b]
    a, relative, known = p.small[0], p.small[1], p.small[2]
    prescribed = p.motion[b] >= 0
    if kind in (REVOLUTE, PRISMATIC):
        if prescribed:
            evaluate_signal(p.signals, p.motion[b], t, known)
        else:
            known[0], known[1], known[2] = q[position], v[rate], 0.0
        for i in range(3):
            a[i] = R0[i, 0] * axis[0] + R0[i, 1] * axis[1] + R0[i, 2] * axis[2]
    if kind == REVOLUTE:
        w = known[1]
        cross_add(bias[3:], spin[0], spin[1], spin[2], a[0] * w, a[1] * w, a[2] * w)
        for i in range(3):
            spin[i] += a[i] * w
            bias[3 + i] += a[i] * known[2]
            if not prescribed:
                J[3 + i, rate] += a[i]
        _turn(R0, axis, known[0], R)
        return
    if kind in (SPHERICAL, FREE):
        first = position + (3 if kind == FREE else 0)
        turn = rate + (3 if kind == FREE else 0)
        if kind == FREE:  # the ground's frame or a moving one: positions and rates along its axes
            for i in range(3):
                a[i] = R0[i, 0] * q[position] + R0[i, 1] * q[position + 1] + R0[i, 2] * q[position + 2]
                relative[i] = R0[i, 0] * v[rate] + R0[i, 1] * v[rate + 1] + R0[i, 2] * v[rate + 2]
            _shift(p, b, a, relative)
            for i in range(3):
                for k in range(3):
                    J[i, rate + k] += R0[i, k]
        _turn_quaternion(R0, q[first : first + 4], R)
        for i in range(3):
            relative[i] = 0.0
            for k in range(3):  # rates about the body's own axes
                J[3 + i, turn + k] += R[i, k]
                relative[i] += R[i, k] * v[turn + k]
        cross_add(bias[3:], spin[0], spin[1], spin[2], relative[0], relative[1], relative[2])
        for i in range(3):
            spin[i] += relative[i]
        return
    for i in range(3):
        for j in range(3):
            R[i, j] = R0[i, j]
    if kind == PRISMATIC:
        for i in range(3):
            along = a[i]
            R0[i, 0] = along
            bias[i] += along * known[2]
            a[i], relative[i] = along * known[0], along * known[1]
        _shift(p, b, a, relative)
        if not prescribed:
            for i in range(3):
                J[i, rate] += R0[i, 0]


@inner
def _shift(p: TreeParameters, b: int, arm: Array, relative: Array) -> None:
    """Move body b's origin by ``arm``, which turns with its frame and changes at the rate ``relative``."""
    origin, spin, bias, J = p.origin[b], p.spin[b], p.bias[b], p.J[b]
    w_arm = p.small[4]
    for i in range(3):
        origin[i] += arm[i]
        w_arm[i] = 2.0 * relative[i]
    cross_add(w_arm, spin[0], spin[1], spin[2], arm[0], arm[1], arm[2])
    cross_add(bias, spin[0], spin[1], spin[2], w_arm[0], w_arm[1], w_arm[2])
    cross_add(bias, bias[3], bias[4], bias[5], arm[0], arm[1], arm[2])
    for j in range(J.shape[1]):
        J[0, j] += J[4, j] * arm[2] - J[5, j] * arm[1]
        J[1, j] += J[5, j] * arm[0] - J[3, j] * arm[2]
        J[2, j] += J[3, j] * arm[1] - J[4, j] * arm[0]
