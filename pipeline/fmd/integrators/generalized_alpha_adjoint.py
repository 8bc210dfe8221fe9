"""Adjoint of a march by the generalised-α method.

A step's end depends on its accelerations ``ä = f(t, q, v)`` there, which depend on it: their weights λ are
``λ = w + (∂ end/∂ä)ᵀ (weights of the end + (∂f/∂(q, v))ᵀ λ)``, linear equations that are solved by corrections with a
matrix which is kept from step to step while it serves.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits.newton import STALLED, STEP_ITERATIONS
from fmd.core.limits.round_off import EXACT, SUMMED
from fmd.dynamics.compiled_system.adjoint_kernels import (
    StepsBack,
    accelerate_back,
    advance_back,
    project_back,
)
from fmd.dynamics.system import accelerations, advance, choose_constraints_anew
from fmd.integrators.adjoint import Sums, WeightedMarch, WeightedOutput, has_next, make_room, sections_back, take_back
from fmd.integrators.fixed_step import take_steps
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.newmark_steps import NewmarkSteps, factor_tangent, move_to_end, solve_part
from fmd.integrators.protocol import State
from fmd.kernels.arrays import clear, copy
from fmd.kernels.kernel import inner, kernel
from fmd.kernels.table import Table


@dataclass(frozen=True)
class _NewmarkBack(Table):
    """Kept steps, the march's output, and the sum's derivatives by a step's begin or end."""

    h: float
    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    q: Array  # (n_kept, n_positions): each step's begin
    v: Array  # (n_kept, n)
    a: Array  # (n_kept, 2 n): auxiliary and true accelerations
    new: Array  # (n_kept, n): true ones at its end
    output: WeightedOutput
    matrix: Array  # (n, n): factors of that of the corrections
    valid: Array  # (1,): 1 while it serves, 2 if it is this step's own
    da: Array  # (2 n,): derivatives by accelerations, those by positions and rates being in `StepsBack`
    of_new: Array  # (n,): by the true ones at the end
    of_v: Array  # (n,): by the begin, of what is in the step
    of_a: Array  # (n,)
    of_q: Array  # (n_positions,)
    weights: Array  # (n,): λ, and what is left of its equations
    rest: Array
    kept_weights: Array  # the same while the matrix is renewed
    kept_rest: Array
    q_end: Array  # (n_positions,): a state in the step, or at its end
    v_end: Array  # (n,)
    mean: Array  # (n,): rates that move positions there
    dq: Array  # (n_positions,): derivatives by it
    dv: Array  # (n,)
    by_mean: Array  # (n,): derivatives by the rates that move positions, and by the auxiliary accelerations at the end
    by_ahead: Array
    room: Array  # (n,)


@kernel
def _keep_steps(m: NewmarkSteps, p: Any, b: _NewmarkBack, first: int, count: int) -> int:
    """Take some steps and keep them; return how many."""
    for k in range(count):
        copy(m.q, b.q[k])
        copy(m.v, b.v[k])
        copy(m.a, b.a[k])
        if take_steps(m, p, 0, first + k, 0, 1, False) == 0:
            return k
        copy(m.new, b.new[k])
        move_to_end(m, p, (first + k + 1) * m.h)
    return count


@inner
def _set_end(b: _NewmarkBack, p: Any, k: int, new: Array) -> None:
    """Set a kept step's end by accelerations there."""
    for i in range(new.size):
        a, true = b.a[k, i], b.a[k, new.size + i]
        ahead = ((1.0 - b.alpha_f) * new[i] + b.alpha_f * true - b.alpha_m * a) / (1.0 - b.alpha_m)
        b.mean[i] = b.v[k, i] + b.h * ((0.5 - b.beta) * a + b.beta * ahead)
        b.v_end[i] = b.v[k, i] + b.h * ((1.0 - b.gamma) * a + b.gamma * ahead)
    copy(b.q[k], b.q_end)
    advance(p, b.q_end, b.mean, b.h, 0, new.size)


@inner
def _add_output(b: _NewmarkBack, p: Any, s: StepsBack, number: int, k: int) -> None:
    """Add what an output has of its step's begin and of the accelerations at both ends: its cubic, projected."""
    n, ahead = b.new.shape[1], b.output.offset[number]
    x = ahead / b.h
    for i in range(n):
        true, rise = b.a[k, n + i], b.new[k, i] - b.a[k, n + i]
        b.v_end[i] = b.v[k, i] + ahead * (true + 0.5 * x * rise)
        b.mean[i] = b.v[k, i] + ahead * (0.5 * true + x * rise / 6.0)
        b.dv[i], b.by_mean[i] = b.output.by_v[number, i], 0.0
    copy(b.q[k], b.q_end)
    copy(b.output.by_q[number], b.dq)
    advance(p, b.q_end, b.mean, ahead, 0, n)
    project_back(p, s, b.output.t[number], b.q_end, b.v_end, b.dq, b.dv)
    advance_back(p, b.q[k], b.mean, ahead, b.dq, b.by_mean)
    for i in range(b.dq.size):
        b.of_q[i] += b.dq[i]
    for i in range(n):
        b.of_v[i] += b.dv[i] + b.by_mean[i]
        b.of_a[i] += ahead * ((1.0 - 0.5 * x) * b.dv[i] + (0.5 - x / 6.0) * b.by_mean[i])
        b.of_new[i] += ahead * x * (0.5 * b.dv[i] + b.by_mean[i] / 6.0)


@inner
def _weigh(b: _NewmarkBack, p: Any, s: StepsBack, k: int, t: float, part: float) -> None:
    """Set ``rest`` to what weights λ should be, by a part of the end's own weights and by λ."""
    n = b.new.shape[1]
    copy(b.weights, s.da)
    copy(b.new[k], b.room)
    accelerate_back(p, s, t, b.q_end, b.v_end, b.room)
    for i in range(b.dq.size):
        b.dq[i] = part * s.dq[i] + s.of_q[i]
    for i in range(n):
        b.dv[i] = part * s.dv[i] + s.of_v[i]
        b.by_mean[i] = 0.0
    advance_back(p, b.q[k], b.mean, b.h, b.dq, b.by_mean)
    for i in range(n):
        b.by_ahead[i] = part * b.da[i] + b.h * (b.beta * b.by_mean[i] + b.gamma * b.dv[i])
        b.rest[i] = part * b.of_new[i] + (1.0 - b.alpha_f) / (1.0 - b.alpha_m) * b.by_ahead[i]


@inner
def _renew_matrix(b: _NewmarkBack, p: Any, s: StepsBack, k: int, t: float) -> None:
    """Factor the matrix of the corrections at a step's end."""
    n, count = b.new.shape[1], s.known.count[0]
    for j in range(n):
        for i in range(n):
            b.weights[i] = 1.0 if i == j else 0.0
        _weigh(b, p, s, k, t, 0.0)
        s.known.count[0] = count
        for i in range(n):
            b.matrix[i, j] = b.weights[i] - b.rest[i]
    factor_tangent(b.matrix)
    b.valid[0] = 1.0


@inner
def _find_weights(b: _NewmarkBack, p: Any, s: StepsBack, k: int, t: float) -> None:
    """Find the weights λ of a step's accelerations, and note what is left of their equations."""
    n, count, last, left = b.new.shape[1], s.known.count[0], 0.0, 0.0
    copy(b.of_new, b.weights)
    for iteration in range(2 * STEP_ITERATIONS):
        s.known.count[0] = count
        _weigh(b, p, s, k, t, 1.0)
        largest, size = 0.0, 0.0
        for i in range(n):
            size = max(size, abs(b.rest[i]), abs(b.weights[i]))
            b.rest[i] -= b.weights[i]
            largest += abs(b.rest[i])  # a sum: it keeps a NaN, which max would lose
        left = largest / size if size > 0.0 else 0.0
        slow = iteration > 0 and largest > STALLED * last
        if left <= EXACT or (slow and (left <= SUMMED or b.valid[0] == 2.0)):
            break
        if slow or b.valid[0] == 0.0:
            copy(b.weights, b.kept_weights)
            copy(b.rest, b.kept_rest)
            _renew_matrix(b, p, s, k, t)
            copy(b.kept_weights, b.weights)
            copy(b.kept_rest, b.rest)
            b.valid[0] = 2.0
        last = largest
        solve_part(b.matrix, b.rest, 0, 1)
        for i in range(n):
            b.weights[i] += b.rest[i]
    b.valid[0] = min(b.valid[0], 1.0)
    if not left <= s.left[0]:
        s.left[0] = left


@kernel
def _take_steps_back(b: _NewmarkBack, p: Any, s: StepsBack, first: int, count: int) -> None:
    """Take the kept steps back."""
    n = b.new.shape[1]
    for back in range(count):
        k = count - 1 - back
        t = (first + k) * b.h + b.h
        clear(b.of_q)
        for i in range(n):
            b.of_new[i], b.of_v[i], b.of_a[i] = b.da[n + i], 0.0, 0.0
        while has_next(b.output, first + k):
            b.output.left[0] -= 1
            _add_output(b, p, s, b.output.left[0], k)
        copy(b.new[k], b.room)
        _set_end(b, p, k, b.room)
        project_back(p, s, t, b.q_end, b.v_end, s.dq, s.dv)
        if s.none.size > 0:  # constraints were chosen at the first guess, by the accelerations at the begin
            copy(b.a[k, n:], b.room)
            _set_end(b, p, k, b.room)
            choose_constraints_anew(p)
            accelerations(p, t, b.q_end, b.v_end, b.room)
            copy(b.new[k], b.room)
            _set_end(b, p, k, b.room)
        _find_weights(b, p, s, k, t)
        for i in range(b.of_q.size):
            s.dq[i] = b.of_q[i] + b.dq[i]
        for i in range(n):
            s.dv[i] = b.of_v[i] + b.dv[i] + b.by_mean[i]
            b.da[i] = b.h * ((0.5 - b.beta) * b.by_mean[i] + (1.0 - b.gamma) * b.dv[i])
            b.da[i] -= b.alpha_m / (1.0 - b.alpha_m) * b.by_ahead[i]
            b.da[n + i] = b.of_a[i] + b.alpha_f / (1.0 - b.alpha_m) * b.by_ahead[i]


@kernel
def _take_start_back(b: _NewmarkBack, p: Any, s: StepsBack, q: Array, v: Array, a: Array) -> None:
    """Go back to the start, at which both accelerations are those of its state."""
    for i in range(v.size):
        s.da[i] = b.da[i] + b.da[v.size + i]
    choose_constraints_anew(p)
    accelerate_back(p, s, 0.0, q, v, a)
    for i in range(q.size):
        s.dq[i] += s.of_q[i]
    for i in range(v.size):
        s.dv[i] += s.of_v[i]


@take_back.register
def _take_march_back(method: GeneralizedAlpha, march: WeightedMarch, sums: Sums) -> tuple[Array, Array, float]:
    system, per_step, output = march.system, march.n_kept + march.n_projected, march.locate_output(method.step)
    n_steps, kept, projected = march.divide(output, per_step)
    s = make_room(system, method.step, 1, per_step * kept + projected + 2 * march.n_kept)
    b = _make_back(method, march, kept, output)
    p, state, counts = march.parameters, method.start(system, march.q0, march.v0), np.array([0.0, np.nan])
    start = [np.array(x) for x in (march.q0, march.v0, state.a[: system.n])]

    def keep(state: State, first: int, count: int) -> None:
        done = _keep_steps(method.steps(system, p, counts, state), p, b, first, count)
        if done < count:
            at = f"t = {(first + done) * method.step:.6g} s"
            raise AccuracyError(f"{method.name}: the step at {at} was not found; take a smaller step")

    for first, count in sections_back(n_steps, kept, state, keep):
        _take_steps_back(b, p, s, first, count)
        sums.take(s.known)
    _take_start_back(b, p, s, *start)
    sums.take(s.known)
    return s.dq, s.dv, float(s.left[0])


def _make_back(method: GeneralizedAlpha, march: WeightedMarch, kept: int, output: WeightedOutput) -> _NewmarkBack:
    """Return room for so many steps."""
    n, n_positions = march.system.n, march.system.n_positions
    moving = ["of_new", "of_v", "of_a", "weights", "rest", "kept_weights", "kept_rest"]
    moving += ["v_end", "mean", "dv", "by_mean", "by_ahead", "room"]
    alpha_m, alpha_f, beta, gamma = method.weights.tolist()
    return _NewmarkBack(
        h=method.step,
        alpha_m=alpha_m,
        alpha_f=alpha_f,
        beta=beta,
        gamma=gamma,
        q=np.zeros((kept, n_positions)),
        v=np.zeros((kept, n)),
        a=np.zeros((kept, 2 * n)),
        new=np.zeros((kept, n)),
        output=output,
        matrix=np.zeros((n, n)),
        valid=np.zeros(1),
        da=np.zeros(2 * n),
        **{name: np.zeros(n_positions) for name in ("of_q", "q_end", "dq")},
        **{name: np.zeros(n) for name in moving},
    )
