"""Steps of a mechanism with loops by central difference taken back, and projections onto its constraints.

Multipliers λ push the mechanism by ``X λ``, ``X = M̂⁻¹ Jᵀ``: so accelerations, rates and positions come onto the
constraints. Their number is free, so whatever has weights w̄ where they push is free of their change: ``Xᵀ w̄ = 0``. A
weight ν of the constraints' residuals (of their rates, or accelerations), which adds ``Jᵀ ν`` to w̄, makes it so, and is
found as the multipliers themselves are, by ``S = J X`` of the step's begin.
"""

from __future__ import annotations

import math

from fmd.core.arrays import Array
from fmd.core.limits.newton import PROJECTIONS, STALLED
from fmd.dynamics.compiled_system.adjoint_kernels import (
    StepsBack,
    accelerate_back,
    advance_back,
    keep_evaluation,
    keep_step,
    project_back,
    pull_back,
    step_back,
)
from fmd.dynamics.compiled_system.closed import factor_constraints, project_positions, project_rates, pull, push
from fmd.dynamics.compiled_system.kernels import set_inputs
from fmd.dynamics.compiled_system.parameters import ClosedParameters
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import accelerations, advance, project_onto_constraints
from fmd.kernels.arrays import clear, copy
from fmd.kernels.kernel import inner
from fmd.kernels.vectors import call_native


@inner
def _add(x: Array, out: Array) -> None:
    for i in range(out.size):
        out[i] += x[i]


@keep_step.register(ClosedParameters)
def _keep_step(p: ClosedParameters, s: StepsBack, t: float, k: int, q: Array, v: Array, a: Array) -> None:
    copy(q, s.q[k])
    for i in range(v.size):
        s.v[k, i] = v[i] + 0.5 * s.h * a[i]
    p.whole.fresh[0] = 1.0
    accelerations(p, t, s.q[k], s.v[k], a)
    copy(p.whole.multiplier, s.f[k])
    for i in range(v.size):
        v[i] += s.h * a[i]
    advance(p, q, v, s.h, 0, v.size)
    clear(p.whole.total)
    project_onto_constraints(p, t + s.h, s.h, q, v, a)
    copy(p.whole.total, s.pushes[k])
    copy(a, s.a[k])
    copy(v, s.ahead[k])
    copy(q, s.q[k + 1])


@step_back.register(ClosedParameters)
def _step_back(p: ClosedParameters, s: StepsBack, t: float, k: int) -> None:
    h, n = s.h, s.dv.size
    set_inputs(p, t)
    factor_constraints(p, s.q[k])
    pull(p.whole, s.pushes[k], s.push)
    for i in range(n):
        s.v_ahead[i] = s.ahead[k, i] - s.push[i] / h
        s.a_free[i] = s.a[k, i] - s.push[i] / (h * h)
        s.rate[i] = s.dv[i] / h + s.da[i] / (h * h)
    copy(s.q[k], s.q_ahead)
    advance(p, s.q_ahead, s.v_ahead, h, 0, n)
    clear(s.rates)
    _close_back(p, s, t + h, s.q[k + 1], s.ahead[k], s.dq)
    advance_back(p, s.q[k], s.v_ahead, h, s.dq, s.dv)
    for i in range(n):
        s.da[i] += h * s.dv[i]
    if p.quaternions.shape[0] != 0:
        _turn_step_back(p, s, t, k)
    else:  # where pushes add up, only their sum counts
        for row in range(s.multiplier.size):
            s.multiplier[row] = s.f[k, row] + s.pushes[k, row] / (h * h)
        pull_back(p, s, t, s.q[k], s.v[k], s.a[k], s.multiplier, s.da)


@inner
def _turn_step_back(p: ClosedParameters, s: StepsBack, t: float, k: int) -> None:
    """Take accelerations and the projection that follows them back one after the other."""
    h, n = s.h, s.dv.size
    copy(s.weights, s.push)
    for i in range(n):
        s.push[i] *= h * h
        s.da[i] -= s.push[i]
    for row in range(s.multiplier.size):
        s.multiplier[row] = s.f[k, row] + s.pushes[k, row] / (h * h)
    pull_back(p, s, t, s.q[k], s.v[k], s.a[k], s.multiplier, s.push)
    _add(s.of_q, s.dq)
    copy(s.of_v, s.rate)
    _accelerate_by(p, s, t, s.q[k], s.v[k], s.a_free, s.f[k])
    _add(s.rate, s.of_v)


@accelerate_back.register(ClosedParameters)
def _accelerate_back(p: ClosedParameters, s: StepsBack, t: float, q: Array, v: Array, a: Array) -> None:
    accelerations(p, t, q, v, s.a_free)
    copy(p.whole.multiplier, s.multiplier)
    _accelerate_by(p, s, t, q, v, a, s.multiplier)


@inner
def _accelerate_by(p: ClosedParameters, s: StepsBack, t: float, q: Array, v: Array, a: Array, f: Array) -> None:
    """Differentiate accelerations that keep loops closed, by multipliers f, with the weights ``da``."""
    set_inputs(p, t)
    _find_weights(p, s, s.da)
    copy(p.whole.multiplier, s.w)
    call_native(s.closing, (p.inputs, q, v, a, s.w, s.of_inputs, s.of_q, s.of_v, s.of_a))
    copy(s.w, s.known.w[_keep(s, t, q, v, a)])
    _add(s.of_a, s.da)
    copy(s.of_q, s.moved_q)
    copy(s.of_v, s.moved_v)
    pull_back(p, s, t, q, v, a, f, s.da)
    _add(s.moved_q, s.of_q)
    _add(s.moved_v, s.of_v)


@inner
def _keep(s: StepsBack, t: float, q: Array, v: Array, a: Array) -> int:
    k = keep_evaluation(s, t, q, v)
    copy(a, s.known.a[k])
    return k


@inner
def _find_weights(p: ClosedParameters, s: StepsBack, weights: Array) -> float:
    """Find weights of constraints so that ``Xᵀ`` of others and of theirs is 0; return the largest that was not."""
    whole, widest = p.whole, 0.0
    for k in range(whole.rank[0]):
        row = whole.order[k]
        total, size = 0.0, 0.0
        for i in range(weights.size):
            part = whole.x[row // LANES, i, row % LANES] * weights[i]
            total += part
            size += abs(part)
        p.w[row] = total
        widest = max(widest, abs(total) * whole.scale[row])
        s.left[1] = max(s.left[1], size * whole.scale[row])
    push(whole, p.w)
    return widest


@inner
def _note_left(s: StepsBack, widest: float) -> None:
    """Note what the last correction has left of weights, beside the largest sum of parts of any correction.

    Of a mechanism without a freedom the last one's are 0 themselves.
    """
    if not widest <= s.left[0] * s.left[1]:
        s.left[0] = widest / s.left[1]


@inner
def _close_back(p: ClosedParameters, s: StepsBack, t: float, q: Array, v: Array, dq: Array) -> None:
    """Take derivatives dq by positions q, to which ``push`` has moved ``q_ahead``, back to those by the latter.

    Those by the push itself, with its own weights ``rate``, are ``weights`` after; rates of the constraints, at rates
    v, have the weights ``rates``.
    """
    last, widest = math.inf, 0.0
    s.left[1] = 0.0
    set_inputs(p, t)
    clear(s.g)
    for _ in range(2 * PROJECTIONS):
        call_native(s.residuals, (p.inputs, q, v, s.g, s.rates, s.of_inputs, s.of_q, s.of_v))
        copy(dq, s.moved_q)
        _add(s.of_q, s.moved_q)
        copy(s.rate, s.weights)
        advance_back(p, s.q_ahead, s.push, 1.0, s.moved_q, s.weights)
        widest = _find_weights(p, s, s.weights)
        if widest == 0.0 or not widest < STALLED * last:
            break
        last = widest
        _add(p.whole.multiplier, s.g)
    _note_left(s, widest)
    k = keep_evaluation(s, t, q, v)
    copy(s.g, s.known.g[k])
    copy(s.rates, s.known.rates[k])
    copy(s.moved_q, dq)


@project_back.register(ClosedParameters)
def _project_back(p: ClosedParameters, s: StepsBack, t: float, q: Array, v: Array, dq: Array, dv: Array) -> None:
    copy(q, s.projected_q)
    copy(v, s.v_ahead)
    clear(p.whole.total)
    project_positions(p, t, s.projected_q, s.v_ahead)
    copy(p.whole.total, s.multiplier)
    clear(p.whole.total)
    project_rates(p, s.projected_q, s.v_ahead)
    copy(p.whole.total, s.other)
    _close_rates_back(p, s, s.projected_q, s.v_ahead, dv)
    pull(p.whole, s.multiplier, s.push)
    copy(q, s.q_ahead)
    clear(s.rate)
    _close_back(p, s, t, s.projected_q, s.v_ahead, dq)
    _pushes_back(p, s, t, q, v, dv)
    _add(s.moved_q, dq)


@inner
def _close_rates_back(p: ClosedParameters, s: StepsBack, q: Array, v: Array, dv: Array) -> None:
    """Take derivatives by rates that are projected back to those by the rates before it."""
    last, widest = math.inf, 0.0
    s.left[1] = 0.0
    clear(s.g)
    clear(s.rates)
    for _ in range(2 * PROJECTIONS):
        call_native(s.residuals, (p.inputs, q, v, s.g, s.rates, s.of_inputs, s.of_q, s.of_v))
        copy(dv, s.weights)
        _add(s.of_v, s.weights)
        widest = _find_weights(p, s, s.weights)
        if widest == 0.0 or not widest < STALLED * last:
            break
        last = widest
        _add(p.whole.multiplier, s.rates)
    _note_left(s, widest)
    copy(s.weights, dv)


@inner
def _pushes_back(p: ClosedParameters, s: StepsBack, t: float, q: Array, v: Array, dv: Array) -> None:
    """Set ``moved_q`` to derivatives by positions of how multipliers push positions, weights ``weights``, and rates."""
    set_inputs(p, t)
    call_native(p.closed, (p.inputs, q, v, p.units[0], s.a_free, p.w, p.whole.x[0], p.whole.s[0]))
    copy(dv, s.rate)
    copy(s.a_free, s.v_ahead)
    _add(s.push, s.v_ahead)
    pull_back(p, s, t, q, v, s.v_ahead, s.multiplier, s.weights)
    copy(s.of_q, s.moved_q)
    pull(p.whole, s.other, s.push)
    copy(s.a_free, s.v_ahead)
    _add(s.push, s.v_ahead)
    pull_back(p, s, t, q, v, s.v_ahead, s.other, s.rate)
    _add(s.of_q, s.moved_q)
    for i in range(s.rate.size):
        s.rate[i] = -(s.rate[i] + s.weights[i])
    pull_back(p, s, t, q, v, s.a_free, s.none, s.rate)
    _add(s.of_q, s.moved_q)
