"""M̂ and Q̂ of an open chain (eq. 4 of Miao et al. 2008): one walk from the ground outwards, body by body.

The frame of each body has a Jacobian (6, n) in space, how its origin and its rotation follow the rates, and a bias,
its acceleration while no rate accelerates. With the body's own mass matrix and velocity-dependent forces from the
inertia Gram tensor (in the body's axes), ``M̂ = Σ_b J_bᵀ M_b J_b`` and ``Q̂ = Σ_b J_bᵀ (Q_b − M_b bias_b) + loads``.
Gravity is an upward acceleration of the ground.
"""

from __future__ import annotations

import math

from pipeline.checks import Array
from pipeline.dynamics.compiled import inlined, kernel
from pipeline.dynamics.tree import FREE, PRISMATIC, REVOLUTE, SPHERICAL, TreeParameters


@inlined
def _cross_add(out: Array, a0: float, a1: float, a2: float, b0: float, b1: float, b2: float) -> None:
    """``out += a × b``."""
    out[0] += a1 * b2 - a2 * b1
    out[1] += a2 * b0 - a0 * b2
    out[2] += a0 * b1 - a1 * b0


@kernel
def _turn(R: Array, axis: Array, angle: float, out: Array) -> None:
    """``out = R rot(axis, angle)`` by Rodrigues' formula, row by row."""
    c, s = math.cos(angle), math.sin(angle)
    for i in range(3):
        r0, r1, r2 = R[i, 0], R[i, 1], R[i, 2]
        along = (r0 * axis[0] + r1 * axis[1] + r2 * axis[2]) * (1.0 - c)
        out[i, 0] = c * r0 + along * axis[0] + s * (r1 * axis[2] - r2 * axis[1])
        out[i, 1] = c * r1 + along * axis[1] + s * (r2 * axis[0] - r0 * axis[2])
        out[i, 2] = c * r2 + along * axis[2] + s * (r0 * axis[1] - r1 * axis[0])


@kernel
def _turn_quaternion(R: Array, e: Array, out: Array) -> None:
    """``out = R rot(e)`` for a unit quaternion e, scalar part last."""
    x, y, z, w = e[0], e[1], e[2], e[3]
    for i in range(3):
        r0, r1, r2 = R[i, 0], R[i, 1], R[i, 2]
        out[i, 0] = r0 * (1 - 2 * (y * y + z * z)) + r1 * 2 * (x * y + w * z) + r2 * 2 * (x * z - w * y)
        out[i, 1] = r0 * 2 * (x * y - w * z) + r1 * (1 - 2 * (x * x + z * z)) + r2 * 2 * (y * z + w * x)
        out[i, 2] = r0 * 2 * (x * z + w * y) + r1 * 2 * (y * z - w * x) + r2 * (1 - 2 * (x * x + y * y))


@kernel
def _place(p: TreeParameters, b: int, q: Array, v: Array, R0: Array) -> None:
    """Frame of the joint on the parent, moved and turned by the parent's modes, into body b's own; R0 (3, 3)."""
    origin, spin, bias, J = p.origin[b], p.spin[b], p.bias[b], p.J[b]
    n = v.size
    parent = p.parent[b]
    if parent < 0:
        for i in range(3):
            origin[i] = p.place[b, i]
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
    first, n_modes = p.mode[parent], p.n_modes[parent]
    arm, moving, angle, rate = p.body[0], p.body[1], p.body[2], p.body[3]
    for i in range(3):
        r, u, a, da = p.place[b, i], 0.0, 0.0, 0.0
        for k in range(n_modes):
            r += p.place_shapes[b, i, k] * q[first + k + p.shift]
            u += p.place_shapes[b, i, k] * v[first + k]
            a += p.place_rotations[b, i, k] * q[first + k + p.shift]
            da += p.place_rotations[b, i, k] * v[first + k]
        arm[3 + i], moving[3 + i], angle[i], rate[i] = r, u, a, da
    # The marker turns by the vector θ = Ψ q: R exp(θ̃); its rotation rate is A(θ) θ̇.
    size2 = angle[0] ** 2 + angle[1] ** 2 + angle[2] ** 2
    size = math.sqrt(size2)
    if size > 0.05:
        one, two = (1.0 - math.cos(size)) / size2, (size - math.sin(size)) / (size * size2)
        d_one = (size * math.sin(size) - 2.0 * (1.0 - math.cos(size))) / (size2 * size2)
        d_two = (3.0 * math.sin(size) - size * (2.0 + math.cos(size))) / (size2 * size2 * size)
    else:  # series: the differences above cancel
        one = 0.5 - size2 / 24.0 + size2**2 / 720.0 - size2**3 / 40320.0
        two = 1.0 / 6.0 - size2 / 120.0 + size2**2 / 5040.0 - size2**3 / 362880.0
        d_one = -1.0 / 12.0 + size2 / 180.0 - size2**2 / 6720.0
        d_two = -1.0 / 60.0 + size2 / 1260.0 - size2**2 / 60480.0
    for i in range(3):
        arm[i] = R[i, 0] * arm[3] + R[i, 1] * arm[4] + R[i, 2] * arm[5]
        moving[i] = R[i, 0] * moving[3] + R[i, 1] * moving[4] + R[i, 2] * moving[5]
    for i in range(3):
        origin[i] = p.origin[parent, i] + arm[i]
        bias[i], bias[3 + i] = p.bias[parent, i], p.bias[parent, 3 + i]
        spin[i] = w[i]
        for j in range(n):
            J[3 + i, j] = above[3 + i, j]
    w_arm = p.body[4]
    for i in range(3):
        w_arm[i] = 2.0 * moving[i]
    _cross_add(w_arm, w[0], w[1], w[2], arm[0], arm[1], arm[2])
    _cross_add(bias, w[0], w[1], w[2], w_arm[0], w_arm[1], w_arm[2])
    _cross_add(bias, bias[3], bias[4], bias[5], arm[0], arm[1], arm[2])
    for j in range(n):
        J[0, j] = above[0, j] + above[4, j] * arm[2] - above[5, j] * arm[1]
        J[1, j] = above[1, j] + above[5, j] * arm[0] - above[3, j] * arm[2]
        J[2, j] = above[2, j] + above[3, j] * arm[1] - above[4, j] * arm[0]
    for i in range(3):
        for k in range(n_modes):
            total = 0.0
            for j in range(3):
                total += R[i, j] * p.place_shapes[b, j, k]
            J[i, first + k] += total
    if n_modes == 0:
        for i in range(3):
            for j in range(3):
                R0[i, j] = R[i, j]
        return
    # A θ̇ and its derivative with θ̈ = 0, in the parent's axes: A = 1 + one θ̃ + two θ̃².
    t, dt, turned, turning = angle, rate, p.body[5], p.body[6]
    tdt = t[0] * dt[0] + t[1] * dt[1] + t[2] * dt[2]
    dt2 = dt[0] ** 2 + dt[1] ** 2 + dt[2] ** 2
    for i in range(3):
        # θ̃²θ̇ = θ(θ·θ̇) − θ̇ θ², and its derivative θ̇(θ·θ̇) + θ θ̇² − 2 θ̇ (θ·θ̇)
        turned[i] = dt[i] + two * (t[i] * tdt - dt[i] * size2)
        turning[i] = two * (t[i] * dt2 - dt[i] * tdt) + d_two * tdt * (t[i] * tdt - dt[i] * size2)
    _cross_add(turned, one * t[0], one * t[1], one * t[2], dt[0], dt[1], dt[2])
    scale = d_one * tdt
    _cross_add(turning, scale * t[0], scale * t[1], scale * t[2], dt[0], dt[1], dt[2])
    for k in range(n_modes):
        s0, s1, s2 = p.place_rotations[b, 0, k], p.place_rotations[b, 1, k], p.place_rotations[b, 2, k]
        ts = t[0] * s0 + t[1] * s1 + t[2] * s2
        column = p.body[7]
        column[0] = s0 + two * (t[0] * ts - s0 * size2)
        column[1] = s1 + two * (t[1] * ts - s1 * size2)
        column[2] = s2 + two * (t[2] * ts - s2 * size2)
        _cross_add(column, one * t[0], one * t[1], one * t[2], s0, s1, s2)
        for i in range(3):
            J[3 + i, first + k] += R[i, 0] * column[0] + R[i, 1] * column[1] + R[i, 2] * column[2]
    for i in range(3):
        moving[i] = R[i, 0] * turned[0] + R[i, 1] * turned[1] + R[i, 2] * turned[2]
        bias[3 + i] += R[i, 0] * turning[0] + R[i, 1] * turning[1] + R[i, 2] * turning[2]
    _cross_add(bias[3:], w[0], w[1], w[2], moving[0], moving[1], moving[2])
    for i in range(3):
        spin[i] += moving[i]
    if size > 0.0:
        for i in range(3):
            turned[i] = t[i] / size
    else:
        turned[0], turned[1], turned[2] = 0.0, 0.0, 1.0
    _turn(R, turned, size, R0)


@kernel
def _joint(p: TreeParameters, b: int, q: Array, v: Array, R0: Array) -> None:
    """Move body b's frame through its joint; R0 is the joint's frame on the parent."""
    R, spin, bias, J, axis = p.R[b], p.spin[b], p.bias[b], p.J[b], p.axis[b]
    kind, rate, position = p.joint[b], p.rate[b], p.position[b]
    a, relative = p.body[0], p.body[1]
    if kind == REVOLUTE:
        for i in range(3):
            a[i] = R0[i, 0] * axis[0] + R0[i, 1] * axis[1] + R0[i, 2] * axis[2]
            J[3 + i, rate] += a[i]
        w = v[rate]
        _cross_add(bias[3:], spin[0], spin[1], spin[2], a[0] * w, a[1] * w, a[2] * w)
        for i in range(3):
            spin[i] += a[i] * w
        _turn(R0, axis, q[position], R)
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
        _cross_add(bias[3:], spin[0], spin[1], spin[2], relative[0], relative[1], relative[2])
        for i in range(3):
            spin[i] += relative[i]
        return
    for i in range(3):
        for j in range(3):
            R[i, j] = R0[i, j]
    if kind == PRISMATIC:
        for i in range(3):
            along = R0[i, 0] * axis[0] + R0[i, 1] * axis[1] + R0[i, 2] * axis[2]
            a[i], relative[i] = along * q[position], along * v[rate]
            R0[i, 0] = along
        _shift(p, b, a, relative)
        for i in range(3):
            J[i, rate] += R0[i, 0]


@kernel
def _shift(p: TreeParameters, b: int, arm: Array, relative: Array) -> None:
    """Move body b's origin by ``arm``, which turns with its frame and changes at the rate ``relative``."""
    origin, spin, bias, J = p.origin[b], p.spin[b], p.bias[b], p.J[b]
    w_arm = p.body[4]
    for i in range(3):
        origin[i] += arm[i]
        w_arm[i] = 2.0 * relative[i]
    _cross_add(w_arm, spin[0], spin[1], spin[2], arm[0], arm[1], arm[2])
    _cross_add(bias, spin[0], spin[1], spin[2], w_arm[0], w_arm[1], w_arm[2])
    _cross_add(bias, bias[3], bias[4], bias[5], arm[0], arm[1], arm[2])
    for j in range(J.shape[1]):
        J[0, j] += J[4, j] * arm[2] - J[5, j] * arm[1]
        J[1, j] += J[5, j] * arm[0] - J[3, j] * arm[2]
        J[2, j] += J[3, j] * arm[1] - J[4, j] * arm[0]


@kernel
def _add_body(p: TreeParameters, b: int, q: Array, v: Array) -> None:
    """Add body b's mass and force, formed in its own axes, to M̂ and Q̂."""
    n, first, n_modes = v.size, p.mode[b], p.n_modes[b]
    G, S, mass, R, J, M, Q, work = p.G[b], p.S[b], p.mass[b], p.R[b], p.J[b], p.M, p.Q, p.body
    shift = p.shift
    w, linear = work[0], work[1]
    for i in range(3):  # spin and bias in the body's axes
        w[i] = R[0, i] * p.spin[b, 0] + R[1, i] * p.spin[b, 1] + R[2, i] * p.spin[b, 2]
        linear[i] = R[0, i] * p.bias[b, 0] + R[1, i] * p.bias[b, 1] + R[2, i] * p.bias[b, 2]
        linear[3 + i] = R[0, i] * p.bias[b, 3] + R[1, i] * p.bias[b, 4] + R[2, i] * p.bias[b, 5]
    # W = ω̃ω̃ + α̃ with the bias rotation α, T = 2 ω̃: acceleration of a point is a₀ + W x + T u̇.
    w2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    W, T, c, F = work[2], work[3], work[4], work[5]
    for i in range(3):
        for j in range(3):
            W[3 * i + j] = w[i] * w[j] - (w2 if i == j else 0.0)
            T[3 * i + j] = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        W[3 * j + i] += linear[3 + k]
        W[3 * i + j] -= linear[3 + k]
        T[3 * j + i] += 2.0 * w[k]
        T[3 * i + j] -= 2.0 * w[k]
    for i in range(3):  # first moment and its rate; force on the origin
        c[i], c[3 + i] = S[i, 0], 0.0
        for k in range(n_modes):
            c[i] += S[i, 1 + k] * q[first + k + shift]
            c[3 + i] += S[i, 1 + k] * v[first + k]
    for i in range(3):
        F[i] = -mass * linear[i]
        F[3 + i] = 0.0
        for j in range(3):
            F[i] -= W[3 * i + j] * c[j] + T[3 * i + j] * c[3 + j]
    _cross_add(F[3:], linear[0], linear[1], linear[2], c[0], c[1], c[2])
    for k in range(n_modes):
        Q[first + k] -= S[0, 1 + k] * linear[0] + S[1, 1 + k] * linear[1] + S[2, 1 + k] * linear[2]
    P = work[6]
    # Row by row of G[d, a]: Y = G p, Z = G ṗ give second moments P, the forces on modes, and those on rotation.
    A01 = A02 = A10 = A12 = A20 = A21 = 0.0
    for d in range(3):
        for a in range(3):
            Wad, Tad = W[3 * d + a], T[3 * d + a]
            pY, pZ = 0.0, 0.0
            for i in range(1 + n_modes):
                y, z = G[d, a, i, 0], 0.0
                for k in range(n_modes):
                    y += G[d, a, i, 1 + k] * q[first + k + shift]
                    z += G[d, a, i, 1 + k] * v[first + k]
                if i == 0:
                    pY, pZ = pY + y, pZ + z
                else:
                    pY += q[first + i - 1 + shift] * y
                    pZ += q[first + i - 1 + shift] * z
                    # points accelerate by W x + T u̇ along d: Σ_a W_da x_a + T_da u̇_a
                    Q[first + i - 1] -= Wad * y + Tad * z
            P[3 * d + a] = pY
            for row in range(3):  # A[d, row] = ∫ρ x_d ẍ_row
                Wra, Tra = W[3 * row + a], T[3 * row + a]
                part = Wra * pY + Tra * pZ
                if d == 0 and row == 1:
                    A01 += part
                elif d == 0 and row == 2:
                    A02 += part
                elif d == 1 and row == 0:
                    A10 += part
                elif d == 1 and row == 2:
                    A12 += part
                elif d == 2 and row == 0:
                    A20 += part
                elif d == 2 and row == 1:
                    A21 += part
    F[3] -= A12 - A21
    F[4] -= A20 - A02
    F[5] -= A01 - A10
    trace = P[0] + P[4] + P[8]
    # Mass: for each rate j the frame's motion V = Rᵀ J_j, its momentum h = M6 V, and the products with all others.
    V, h = work[0], work[1]
    for j in range(n):
        some = 0.0
        for i in range(6):
            some += abs(J[i, j])
        if some == 0.0:
            continue
        for i in range(3):
            V[i] = R[0, i] * J[0, j] + R[1, i] * J[1, j] + R[2, i] * J[2, j]
            V[3 + i] = R[0, i] * J[3, j] + R[1, i] * J[4, j] + R[2, i] * J[5, j]
        for i in range(3):
            h[i] = mass * V[i]
            h[3 + i] = trace * V[3 + i] - P[3 * i] * V[3] - P[3 * i + 1] * V[4] - P[3 * i + 2] * V[5]
        _cross_add(h, V[3], V[4], V[5], c[0], c[1], c[2])
        _cross_add(h[3:], c[0], c[1], c[2], V[0], V[1], V[2])
        for i in range(3):  # back to space, where the Jacobian is
            h[6 + i] = R[i, 0] * h[0] + R[i, 1] * h[1] + R[i, 2] * h[2]
            h[9 + i] = R[i, 0] * h[3] + R[i, 1] * h[4] + R[i, 2] * h[5]
        for k in range(j + 1):
            M[j, k] += (
                J[0, k] * h[6] + J[1, k] * h[7] + J[2, k] * h[8] + J[3, k] * h[9] + J[4, k] * h[10] + J[5, k] * h[11]
            )
        Q[j] += V[0] * F[0] + V[1] * F[1] + V[2] * F[2] + V[3] * F[3] + V[4] * F[4] + V[5] * F[5]
        for k in range(n_modes):  # H_dk = ε_dbc pᵀ G[b, c] e_k
            coupling = S[0, 1 + k] * V[0] + S[1, 1 + k] * V[1] + S[2, 1 + k] * V[2]
            for d in range(3):
                if V[3 + d] == 0.0:
                    continue
                x, y = (d + 1) % 3, (d + 2) % 3
                total = G[x, y, 0, 1 + k] - G[y, x, 0, 1 + k]
                for i in range(n_modes):
                    total += q[first + i + shift] * (G[x, y, 1 + i, 1 + k] - G[y, x, 1 + i, 1 + k])
                coupling += total * V[3 + d]
            M[max(first + k, j), min(first + k, j)] += coupling
    for k in range(n_modes):
        M[first + k, first + k] += 1.0


@kernel
def mass_and_force(p: TreeParameters, t: float, q: Array, v: Array) -> None:
    """Form M̂ (p.M, symmetric) and Q̂ (p.Q), and the frames, at positions q and rates v."""
    n, M, Q = v.size, p.M, p.Q
    for i in range(n):
        Q[i] = p.load[i] - p.damping[i] * v[i]
        if p.scalar_position[i] >= 0:
            Q[i] -= p.stiffness[i] * (q[p.scalar_position[i]] - p.rest[i])
        for j in range(i + 1):
            M[i, j] = 0.0
    for b in range(p.parent.size):
        if p.joint[b] == REVOLUTE and p.n_modes[b] > 0:
            _turn_section(p, b, q, v)
        _place(p, b, q, v, p.R0)
        _joint(p, b, q, v, p.R0)
        _add_body(p, b, q, v)
    for i in range(n):
        for j in range(i):
            M[j, i] = M[i, j]


@inlined
def _turn_section(p: TreeParameters, b: int, q: Array, v: Array) -> None:
    """Let the load of a revolute joint work on the section that it grips, which turns with the body's modes."""
    i, first, Q = p.rate[b], p.mode[b], p.Q
    for k in range(p.n_modes[b]):
        Q[i] -= p.joint_rotation[b, k] * (p.stiffness[i] * q[first + k + p.shift] + p.damping[i] * v[first + k])
    for k in range(p.n_modes[b]):
        Q[first + k] += p.joint_rotation[b, k] * Q[i]
