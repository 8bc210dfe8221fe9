"""M̂ and Q̂ of an open chain (eq. 4 of Miao et al. 2008): one walk from the ground outwards, body by body.

The frame of each body has a Jacobian (6, n) in space, how its origin and its rotation follow the rates, and a bias,
its acceleration while no rate accelerates; a prescribed joint moves the bias alone. With the body's own mass matrix and
velocity-dependent forces from the inertia Gram tensor (in the body's axes), ``M̂ = Σ_b J_bᵀ M_b J_b`` and
``Q̂ = Σ_b J_bᵀ (Q_b − M_b bias_b) + loads``. Gravity is an upward acceleration of the ground.

With p = (1, q), the symmetric products ``G_k p`` of the Gram tensor and the antisymmetric ones ``A_a p``, ``A_a ṗ``
are all that a body needs: second moment P, ``N = ∫ρ x ⊗ u̇`` and ``h_a = ṗ·A_a p`` give

    J = tr(P) 1 − P      Q_rot = −(ω × J ω + J α + 2 (ω tr N_s − N_s ω + ½ h × ω) + c × a₀)
    H_a = −A_a p         Q_modal = −Σ (ω_d ω_a − δ_da ω²) G_da p + Σ α_a A_a p + 2 Σ ω_a A_a ṗ − S_effᵀ a₀
"""

from __future__ import annotations

from pipeline.core.arrays import Array
from pipeline.dynamics.jit.compiled import addressed, inner, kernel
from pipeline.dynamics.jit.table import call
from pipeline.dynamics.links import REVOLUTE
from pipeline.dynamics.signals.signal import signal_value
from pipeline.dynamics.tree.arrays import TreeParameters
from pipeline.dynamics.tree.frames import cross_add, tangent


@inner
def modal_products(p: TreeParameters, b: int, q: Array, v: Array) -> None:
    """Fill p.modal for body b: p, ṗ, the products G_k p (2 … 7), A_a p (8 … 10), A_a ṗ (11 … 13), S_eff (14 … 16).

    Column by column, so that the inner loops run over memory in order; the matrices are (anti)symmetric.
    """
    m, n_modes, mode, active, S = p.modal, p.n_modes[b], p.mode[b], p.active[b], p.S[b]
    m[0, 0], m[1, 0] = 1.0, 0.0
    for k in range(n_modes):
        m[0, 1 + k], m[1, 1 + k] = q[mode[k] + p.shift], v[mode[k]]
    for i in range(2, 14):
        for k in range(1 + n_modes):
            m[i, k] = 0.0
    for i in range(6):
        if active[i]:
            for j in range(1 + n_modes):
                add_scaled(m[2 + i], p.G[b, i, j], m[0, j], 1 + n_modes)
    for a in range(3):
        if active[6 + a]:
            for j in range(1 + n_modes):  # the columns of A are its rows turned round
                add_scaled(m[8 + a], p.A[b, a, j], -m[0, j], 1 + n_modes)
            for j in range(1, 1 + n_modes):
                add_scaled(m[11 + a], p.A[b, a, j], -m[1, j], 1 + n_modes)
    for a in range(3):
        for k in range(1 + n_modes):
            m[14 + a, k] = S[a, k]
        if p.bowed[b]:
            for j in range(n_modes):
                add_scaled(m[14 + a, 1:], p.bow[b, a, j], m[0, 1 + j], n_modes)


@inner
def add_scaled(y: Array, x: Array, factor: float, n: int) -> None:
    """``y += factor x`` for the first n."""
    for k in range(n):
        y[k] += factor * x[k]


@addressed
def add_body(p: TreeParameters, b: int, q: Array, v: Array) -> None:
    """Add body b's mass and force, formed in its own axes, to M̂ and Q̂."""
    modal_products(p, b, q, v)
    n, n_modes, mode = v.size, p.n_modes[b], p.mode[b]
    m, mass, R, J, M, Q, S = p.modal, p.mass[b], p.R[b], p.J[b], p.M, p.Q, p.S[b]
    spin, bias = p.spin[b], p.bias[b]
    w, accel, F, c, Jw = p.small[0], p.small[1], p.small[2], p.small[3], p.small[4]
    P, Ns, h = p.small[5], p.small[6], p.small[7]
    for i in range(3):  # spin and bias in the body's axes
        w[i] = R[0, i] * spin[0] + R[1, i] * spin[1] + R[2, i] * spin[2]
        accel[i] = R[0, i] * bias[0] + R[1, i] * bias[1] + R[2, i] * bias[2]
        accel[3 + i] = R[0, i] * bias[3] + R[1, i] * bias[4] + R[2, i] * bias[5]
        c[i], c[3 + i], h[i] = S[i, 0], 0.0, 0.0
        for k in range(1, 1 + n_modes):
            c[i] += 0.5 * (S[i, k] + m[14 + i, k]) * m[0, k]
            c[3 + i] += m[14 + i, k] * m[1, k]
            h[i] += m[8 + i, k] * m[1, k]
    for i in range(6):
        P[i], Ns[i] = m[2 + i, 0], 0.0
        for k in range(1, 1 + n_modes):
            P[i] += m[2 + i, k] * m[0, k]
            Ns[i] += m[2 + i, k] * m[1, k]
    trace, trace_N = P[0] + P[1] + P[2], Ns[0] + Ns[1] + Ns[2]
    w2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    # Forces on the modes.
    for k in range(1, 1 + n_modes):
        i = mode[k - 1]
        for a in range(3):
            Q[i] -= (w[a] * w[a] - w2) * m[2 + a, k] + m[14 + a, k] * accel[a]
            Q[i] += accel[3 + a] * m[8 + a, k] + 2.0 * w[a] * m[11 + a, k]
        Q[i] -= 2.0 * (w[1] * w[2] * m[5, k] + w[0] * w[2] * m[6, k] + w[0] * w[1] * m[7, k])
        M[i, i] += 1.0
    # Force on the origin and moment about it.
    turning = p.small[8]
    for i in range(3):
        turning[i] = 2.0 * c[3 + i]
        F[i] = -mass * accel[i]
    cross_add(turning, w[0], w[1], w[2], c[0], c[1], c[2])  # ω × c + 2 ċ
    cross_add(F, turning[0], turning[1], turning[2], w[0], w[1], w[2])
    cross_add(F, c[0], c[1], c[2], accel[3], accel[4], accel[5])
    times_symmetric(P, w, Jw)
    times_symmetric(Ns, w, turning)
    times_symmetric(P, accel[3:], Jw[3:])
    for i in range(3):
        Jw[i] = trace * w[i] - Jw[i]
        F[3 + i] = -(trace * accel[3 + i] - Jw[3 + i]) - 2.0 * (trace_N * w[i] - turning[i])
    cross_add(F[3:], Jw[0], Jw[1], Jw[2], w[0], w[1], w[2])
    cross_add(F[3:], w[0], w[1], w[2], h[0], h[1], h[2])
    cross_add(F[3:], accel[0], accel[1], accel[2], c[0], c[1], c[2])
    # Mass: for each rate j the frame's motion V = Rᵀ J_j, its momentum g = M6 V, and the products with all others.
    V, g = w, accel
    for j in range(n):
        some = 0.0
        for i in range(6):
            some += abs(J[i, j])
        if some == 0.0:
            continue
        for i in range(3):
            V[i] = R[0, i] * J[0, j] + R[1, i] * J[1, j] + R[2, i] * J[2, j]
            V[3 + i] = R[0, i] * J[3, j] + R[1, i] * J[4, j] + R[2, i] * J[5, j]
        times_symmetric(P, V[3:], g[3:])
        for i in range(3):
            g[i] = mass * V[i]
            g[3 + i] = trace * V[3 + i] - g[3 + i]
        cross_add(g, V[3], V[4], V[5], c[0], c[1], c[2])
        cross_add(g[3:], c[0], c[1], c[2], V[0], V[1], V[2])
        for i in range(3):  # back to space, where the Jacobian is
            g[6 + i] = R[i, 0] * g[0] + R[i, 1] * g[1] + R[i, 2] * g[2]
            g[9 + i] = R[i, 0] * g[3] + R[i, 1] * g[4] + R[i, 2] * g[5]
        row = M[j]
        for i in range(6):
            if g[6 + i] != 0.0:
                add_scaled(row, J[i], g[6 + i], j + 1)
        Q[j] += V[0] * F[0] + V[1] * F[1] + V[2] * F[2] + V[3] * F[3] + V[4] * F[4] + V[5] * F[5]
        coupling = m[17]
        for k in range(1, 1 + n_modes):
            coupling[k] = 0.0
        for a in range(3):
            if V[a] != 0.0:
                add_scaled(coupling, m[14 + a], V[a], 1 + n_modes)
            if V[3 + a] != 0.0:
                add_scaled(coupling, m[8 + a], -V[3 + a], 1 + n_modes)
        for k in range(1, 1 + n_modes):
            i = mode[k - 1]
            M[max(i, j), min(i, j)] += coupling[k]


@inner
def times_symmetric(A: Array, x: Array, out: Array) -> None:
    """``out = A x`` for a symmetric matrix given as xx, yy, zz, yz, xz, xy."""
    x0, x1, x2 = x[0], x[1], x[2]
    out[0] = A[0] * x0 + A[5] * x1 + A[4] * x2
    out[1] = A[5] * x0 + A[1] * x1 + A[3] * x2
    out[2] = A[4] * x0 + A[3] * x1 + A[2] * x2


@addressed
def add_point_load(p: TreeParameters, t: float, k: int, q: Array) -> None:
    """Let point load k do its work on every rate that moves its point."""
    b = p.at_body[k]
    R, J, Q, mode, n_modes = p.R[b], p.J[b], p.Q, p.mode[b], p.n_modes[b]
    arm, angle, c, d, f = p.small[0], p.small[1], p.small[2], p.small[3], p.small[4]
    shapes, rotations = p.at_shapes[k], p.at_rotations[k]
    for i in range(3):
        arm[3 + i], angle[i] = p.at_place[k, i], 0.0
        for j in range(n_modes):
            arm[3 + i] += shapes[i, j] * q[mode[j] + p.shift]
            angle[i] += rotations[i, j] * q[mode[j] + p.shift]
    size2 = angle[0] ** 2 + angle[1] ** 2 + angle[2] ** 2
    tangent(size2, c)
    size = signal_value(p.signals, p.at_signal[k], t)
    for i in range(3):
        arm[i] = R[i, 0] * arm[3] + R[i, 1] * arm[4] + R[i, 2] * arm[5]
        d[i] = size * p.at_direction[k, i]
    if p.at_following[k]:  # exp(θ̃) d = d + sin|θ|/|θ| θ × d + (1 − cos|θ|)/|θ|² θ × (θ × d)
        sine = 1.0 - size2 * c[1]
        d[3], d[4], d[5], f[3], f[4], f[5] = d[0], d[1], d[2], 0.0, 0.0, 0.0
        cross_add(f[3:], angle[0], angle[1], angle[2], d[3], d[4], d[5])
        for i in range(3):
            d[3 + i] += sine * f[3 + i]
        cross_add(d[3:], c[0] * angle[0], c[0] * angle[1], c[0] * angle[2], f[3], f[4], f[5])
        for i in range(3):
            d[i] = R[i, 0] * d[3] + R[i, 1] * d[4] + R[i, 2] * d[5]
    f[0], f[1], f[2], f[3], f[4], f[5] = d[0], d[1], d[2], 0.0, 0.0, 0.0
    if p.at_torque[k]:
        f[0], f[1], f[2], f[3], f[4], f[5] = 0.0, 0.0, 0.0, d[0], d[1], d[2]
    else:
        cross_add(f[3:], arm[0], arm[1], arm[2], d[0], d[1], d[2])
    for i in range(6):
        if f[i] != 0.0:
            add_scaled(Q, J[i], f[i], Q.size)
    for i in range(3):  # in the body's axes, onto its modes
        d[3 + i] = R[0, i] * d[0] + R[1, i] * d[1] + R[2, i] * d[2]
    if p.at_torque[k]:  # A(θ)ᵀ d = d − out₀ θ × d + out₁ θ × (θ × d)
        f[0], f[1], f[2] = 0.0, 0.0, 0.0
        cross_add(f, angle[0], angle[1], angle[2], d[3], d[4], d[5])
        for i in range(3):
            d[3 + i] -= c[0] * f[i]
        cross_add(d[3:], c[1] * angle[0], c[1] * angle[1], c[1] * angle[2], f[0], f[1], f[2])
    for j in range(n_modes):
        for i in range(3):
            Q[mode[j]] += (rotations[i, j] if p.at_torque[k] else shapes[i, j]) * d[3 + i]


@kernel
def mass_and_force(p: TreeParameters, t: float, q: Array, v: Array) -> None:
    """Form M̂ (p.M, its lower triangle) and Q̂ (p.Q), and the frames, at positions q and rates v."""
    n, M, Q = v.size, p.M, p.Q
    for i in range(n):
        Q[i] = -p.damping[i] * v[i]
        if p.load[i] >= 0:
            Q[i] += signal_value(p.signals, p.load[i], t)
        if p.scalar_position[i] >= 0:
            Q[i] -= p.stiffness[i] * (q[p.scalar_position[i]] - p.rest[i])
        for j in range(i + 1):
            M[i, j] = 0.0
    for b in range(p.parent.size):
        if p.joint[b] == REVOLUTE and p.motion[b] < 0 and p.n_modes[b] > 0:
            _turn_section(p, b, q, v)
        call(p.place_joint, (p, b, q, v, p.R0))
        call(p.move_through_joint, (p, float(t), b, q, v, p.R0))
        call(p.add_body, (p, b, q, v))
    for k in range(p.at_body.size):
        call(p.add_point_load, (p, float(t), k, q))


@inner
def _turn_section(p: TreeParameters, b: int, q: Array, v: Array) -> None:
    """Let the load of a revolute joint work on the section that it grips, which turns with the body's modes."""
    i, mode, Q = p.rate[b], p.mode[b], p.Q
    for k in range(p.n_modes[b]):
        turn = p.joint_rotation[b, k]
        Q[i] -= turn * (p.stiffness[i] * q[mode[k] + p.shift] + p.damping[i] * v[mode[k]])
    for k in range(p.n_modes[b]):
        Q[mode[k]] += p.joint_rotation[b, k] * Q[i]
