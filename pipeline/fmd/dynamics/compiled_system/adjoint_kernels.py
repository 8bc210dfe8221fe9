"""Steps of a mechanism by central difference taken back: how a sum changes with a step's begin, once with its end.

With ``a = f(t, q, v + ½ h a₋)``, ``v₊ = v + h a``, ``q₊ = q + h v₊`` and the sum's derivatives q̄, v̄, ā by a step's
end, those by its begin are

    v̄ ← v̄ + h q̄,   ā ← ā + h v̄,   (q̂, v̂) = ā ∂f/∂(q, v),   q̄ ← q̄ + q̂,   v̄ ← v̄ + v̂,   ā₋ = ½ h v̂

Where a quaternion turns, the transpose of that turn stands for the first of these. Each evaluation of the equations is
kept with its weights: the sum's derivative by whatever else is in them follows from these.
"""

from __future__ import annotations

from functools import singledispatch
from typing import Any

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiled_system.kernels import set_inputs
from fmd.dynamics.compiled_system.parameters import CompiledParameters, TreeParameters
from fmd.dynamics.compiled_system.tangent_kernels import MechanismVariants, take_state
from fmd.dynamics.system import accelerations, advance
from fmd.kernels.arrays import copy
from fmd.kernels.kernel import inlined, inner, kernel
from fmd.kernels.table import Table
from fmd.kernels.vectors import call_native


@dataclass(frozen=True)
class Evaluations(Table):
    """Equations that were evaluated, with weights: the sum has their derivatives by all that is in them.

    ``−x · r(q, v, a, f) + g · residuals(q, v) + rates · their rates + w · their accelerations``
    """

    count: IntArray  # (1,): how many there are
    t: Array  # (most,): time [s]
    q: Array  # (most, n_positions)
    v: Array  # (most, n)
    a: Array
    f: Array  # (most, n_rows): multipliers
    x: Array  # (most, n)
    g: Array  # (most, n_rows)
    rates: Array
    w: Array
    inputs: Array  # (most, n_inputs): derivatives by the argument ``inputs``


@dataclass(frozen=True)
class StepsBack(Table):
    """Steps of a section, and the sum's derivatives by the end of a step."""

    acceleration: int  # addresses of the compiled functions
    residuals: int
    closing: int
    h: float
    q: Array  # (n_kept + 1, n_positions): positions at each step's begin, of loops also at the last one's end
    v: Array  # (n_kept, n): rates and accelerations there, and the rates half a step later
    a: Array
    ahead: Array
    f: Array  # (n_kept, n_rows): multipliers of its accelerations, and those that project it
    pushes: Array
    dq: Array  # (n_positions,): derivatives by positions
    dv: Array  # (n,): by rates half a step before them, and accelerations
    da: Array
    of_inputs: Array  # of an evaluation of the equations, by its arguments
    of_q: Array
    of_v: Array
    of_a: Array
    x: Array  # (n,)
    moved_q: Array  # (n_positions,), room to work in
    moved_v: Array  # (n,)
    rate: Array
    q_ahead: Array  # (n_positions,), room for steps of loops
    projected_q: Array
    v_ahead: Array  # (n,)
    a_free: Array
    push: Array
    weights: Array
    g: Array  # (n_rows,): weights of residuals, of their rates, and multipliers
    rates: Array
    w: Array
    multiplier: Array
    other: Array
    none: Array
    left: Array  # (2,): largest part of weights that corrections have left, and their size in the last
    known: Evaluations


@singledispatch
def keep_step(p: Any, s: StepsBack, t: float, k: int, q: Array, v: Array, a: Array) -> None:
    """Take a step, and keep it as number k."""
    raise NotImplementedError


@singledispatch
def step_back(p: Any, s: StepsBack, t: float, k: int) -> None:
    """Take a kept step back."""
    raise NotImplementedError


@singledispatch
def accelerate_back(p: Any, s: StepsBack, t: float, q: Array, v: Array, a: Array) -> None:
    """Differentiate accelerations at a state by it, with the weights ``da``: ``of_q`` and ``of_v``."""
    raise NotImplementedError


@singledispatch
@inlined
def project_back(p: Any, s: StepsBack, t: float, q: Array, v: Array, dq: Array, dv: Array) -> None:
    """Take derivatives by a state that is projected onto the constraints back to those by the state itself."""


@keep_step.register(TreeParameters)
def _keep_step(p: TreeParameters, s: StepsBack, t: float, k: int, q: Array, v: Array, a: Array) -> None:
    copy(q, s.q[k])
    for i in range(v.size):
        s.v[k, i] = v[i] + 0.5 * s.h * a[i]
    accelerations(p, t, s.q[k], s.v[k], a)
    for i in range(v.size):
        s.a[k, i] = a[i]
        v[i] += s.h * a[i]
        s.ahead[k, i] = v[i]
    advance(p, q, v, s.h, 0, v.size)


@step_back.register(TreeParameters)
def _step_back(p: TreeParameters, s: StepsBack, t: float, k: int) -> None:
    advance_back(p, s.q[k], s.ahead[k], s.h, s.dq, s.dv)
    for i in range(s.dv.size):
        s.da[i] += s.h * s.dv[i]
    pull_back(p, s, t, s.q[k], s.v[k], s.a[k], s.none, s.da)


@accelerate_back.register(TreeParameters)
def _accelerate_back(p: TreeParameters, s: StepsBack, t: float, q: Array, v: Array, a: Array) -> None:
    pull_back(p, s, t, q, v, a, s.none, s.da)


@inlined
def pull_back(
    p: CompiledParameters, s: StepsBack, t: float, q: Array, v: Array, a: Array, f: Array, weights: Array
) -> None:
    """Differentiate accelerations at fixed multipliers f by all else that they depend on, and keep their evaluation."""
    set_inputs(p, t)
    call_native(s.acceleration, (p.inputs, q, v, a, f, weights, s.x, s.of_inputs, s.of_q, s.of_v))
    k = keep_evaluation(s, t, q, v)
    copy(a, s.known.a[k])
    copy(f, s.known.f[k])
    copy(s.x, s.known.x[k])


@inner
def keep_evaluation(s: StepsBack, t: float, q: Array, v: Array) -> int:
    """Keep an evaluation of the equations at a state, without weights yet, with its derivatives by inputs."""
    known = s.known
    k: int = known.count[0]
    known.count[0] += 1
    known.t[k] = t
    copy(q, known.q[k])
    copy(v, known.v[k])
    copy(s.of_inputs, known.inputs[k])
    for i in range(v.size):
        known.a[k, i], known.x[k, i] = 0.0, 0.0
    for row in range(s.none.size):
        known.f[k, row], known.g[k, row], known.rates[k, row], known.w[k, row] = 0.0, 0.0, 0.0, 0.0
    return k


@kernel
def sum_variants(m: MechanismVariants, known: Evaluations, clock: Array, sums: Array) -> None:
    """Add what the sum changes by along numbers that change the equations, sums (8,): of weighted variants of these."""
    for e in range(known.count[0]):
        for k in range(m.residual.size):
            if m.residual[k] != 0:
                clock[0] = known.t[e]
                if m.signals[k] != 0:
                    call_native(m.signals[k], (clock, m.inputs[k]))
                sums[k // 4] += m.weights[k] * _evaluate(m, known, e, k)


@inlined
def _evaluate(m: MechanismVariants, known: Evaluations, e: int, k: int) -> float:
    take_state(m, k, known.q[e], known.v[e], known.a[e])
    found = 0.0
    if _counts(known.x[e]):
        call_native(m.residual[k], (m.inputs[k], m.q, m.v, known.f[e], m.a, m.r))
        for i in range(m.r.size):
            found -= m.signs_v[k, i] * m.r[i] * known.x[e, i]
    if _counts(known.g[e]) or _counts(known.rates[e]):
        call_native(m.residuals[k], (m.inputs[k], m.q, m.v, m.g, m.rates))
        for row in range(m.g.size):
            found += m.g[row] * known.g[e, row] + m.rates[row] * known.rates[e, row]
    if _counts(known.w[e]):
        call_native(m.closing[k], (m.inputs[k], m.q, m.v, m.a, m.g))
        for row in range(m.g.size):
            found += m.g[row] * known.w[e, row]
    return found


@inlined
def _counts(weights: Array) -> bool:
    largest = 0.0
    for i in range(weights.size):
        largest = max(largest, abs(weights[i]))
    return largest > 0.0


@inlined
def advance_back(p: CompiledParameters, q: Array, v: Array, h: float, dq: Array, dv: Array) -> None:
    """Take derivatives by positions that rates v have moved for a time h back to those by positions q and by rates."""
    if p.quaternions.shape[0] == 0:
        for i in range(dv.size):
            dv[i] += h * dq[i]
        return
    for i in range(dv.size):
        if p.position[i] >= 0:
            dv[i] += h * dq[p.position[i]]
    for k in range(p.quaternions.shape[0]):
        turn, at = p.quaternions[k, 0], p.quaternions[k, 1]
        p.turns.step[0] = h
        call_native(p.turns.turn_back, (p.turns.step, q[at:], v[turn:], dq[at:], dq[at:], dv[turn:]))


@inlined
def velocities_back(p: CompiledParameters, q: Array, v: Array, weights: Array, dq: Array, dv: Array) -> None:
    """Add what weighted time derivatives of positions change by with positions q and rates v."""
    if p.quaternions.shape[0] == 0:
        for i in range(dv.size):
            dv[i] += weights[i]
        return
    for i in range(dv.size):
        if p.position[i] >= 0:
            dv[i] += weights[p.position[i]]
    for k in range(p.quaternions.shape[0]):
        turn, at = p.quaternions[k, 0], p.quaternions[k, 1]
        call_native(p.turns.rate_back, (p.turns.step, q[at:], v[turn:], weights[at:], dq[at:], dv[turn:]))
