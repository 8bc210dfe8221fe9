"""Adjoint of a march by the Runge–Kutta method, whose steps stay those that it has chosen.

With stages ``u_k = u + h Σ_j a_kj K_j``, ``K_k = f(t_k, u_k)`` both a step's end and an output in it are
``u + h Σ_k c_k K_k``. Their weights w add ``h c_k w`` to those of K_k, and w to those of u; then, from the last stage
back, ``ū_k = (∂f/∂u)ᵀ K̄_k`` adds ``h a_kj ū_k`` to K̄_j and ū_k to those of u.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.memory import MOST_BEGINS_KEPT
from fmd.dynamics.compiled_system.adjoint_kernels import (
    StepsBack,
    accelerate_back,
    advance_back,
    project_back,
    velocities_back,
)
from fmd.dynamics.system import accelerations, advance, choose_constraints_anew, velocities
from fmd.integrators import dop853
from fmd.integrators.adaptive import begin_steps, march_steps, require_steps
from fmd.integrators.adjoint import (
    NotTakenBackError,
    Sums,
    WeightedMarch,
    WeightedOutput,
    has_next,
    make_room,
    take_back,
)
from fmd.integrators.runge_kutta import RungeKutta
from fmd.integrators.step_control import just_after, just_before
from fmd.kernels.arrays import copy
from fmd.kernels.kernel import inner, kernel
from fmd.kernels.table import Table

_STAGES, _OF_END = 16, 12  # slopes, also those of the dense output; the last stage of a step is at its end


@dataclass(frozen=True)
class _StagesBack(Table):
    """Steps of a march by their begins, its output, and the stages of one step."""

    C: Array  # (16,): times of the stages in a step
    A: Array  # (16, 16): weights of the slopes in each
    t: Array  # (n_steps,): begins of steps, and their lengths [s]
    h: Array
    begin: Array  # (n_steps, n_positions + n)
    output: WeightedOutput
    slopes: Array  # (n_times, 16): weights of the slopes at its times
    u: Array  # (16, n_positions + n): states at the stages
    K: Array  # (16, n_positions + n): slopes there, and the sum's derivatives by them
    dK: Array
    state: Array  # (n_positions + n,): a state before it settles
    q: Array  # (n_positions,), room to work in
    v: Array  # (n,)
    dq: Array  # (n_positions,): the sum's derivatives by a state
    dv: Array  # (n,)
    none: Array  # (n,)


@inner
def _combine(r: _StagesBack, k: int, weights: Array, out: Array) -> None:
    """Set ``out`` to step k's begin and a weighted sum of its slopes."""
    for i in range(out.size):
        total = 0.0
        for j in range(weights.size):
            total += weights[j] * r.K[j, i]
        out[i] = r.begin[k, i] + r.h[k] * total


@inner
def _evaluate_stages(r: _StagesBack, p: Any, k: int, count: int) -> None:
    """Evaluate the first stages of step k anew."""
    n_positions = r.q.size
    for stage in range(_STAGES):
        for i in range(r.state.size):
            r.K[stage, i], r.dK[stage, i] = 0.0, 0.0
    choose_constraints_anew(p)
    for stage in range(count):
        _combine(r, k, r.A[stage], r.u[stage])
        velocities(p, r.u[stage, :n_positions], r.u[stage, n_positions:], r.K[stage, :n_positions])
        accelerations(
            p, _time(r, k, stage), r.u[stage, :n_positions], r.u[stage, n_positions:], r.K[stage, n_positions:]
        )


@inner
def _time(r: _StagesBack, k: int, stage: int) -> float:
    """Return the time of a stage as the march has it: after a jump at the step's begin, before one at its end."""
    if stage == 0:
        return just_after(r.t[k])
    return just_before(r.t[k] + r.h[k]) if r.C[stage] == 1.0 else r.t[k] + r.C[stage] * r.h[k]


@inner
def _settle_back(r: _StagesBack, p: Any, s: StepsBack, t: float) -> None:
    """Take derivatives ``dq`` and ``dv`` by a settled state back to those by ``state``, as it was before."""
    n_positions = r.q.size
    copy(r.state, r.q)
    for i in range(r.v.size):
        r.v[i], r.none[i] = r.state[n_positions + i], 0.0
    advance(p, r.q, r.v, 0.0, 0, r.v.size)
    project_back(p, s, t, r.q, r.v, r.dq, r.dv)
    for i in range(r.v.size):
        r.v[i] = r.state[n_positions + i]
    advance_back(p, r.state[:n_positions], r.v, 0.0, r.dq, r.none)


@inner
def _spread(r: _StagesBack, s: StepsBack, k: int, weights: Array) -> None:
    """Add ``dq`` and ``dv`` of a state by weighted slopes to derivatives by these and by the step's begin."""
    n_positions = r.q.size
    for stage in range(weights.size):
        size = r.h[k] * weights[stage]
        if size != 0.0:
            for i in range(n_positions):
                r.dK[stage, i] += size * r.dq[i]
            for i in range(r.v.size):
                r.dK[stage, n_positions + i] += size * r.dv[i]
    for i in range(n_positions):
        s.dq[i] += r.dq[i]
    for i in range(r.v.size):
        s.dv[i] += r.dv[i]


@kernel
def _take_steps_back(r: _StagesBack, p: Any, s: StepsBack, first: int, count: int) -> None:
    """Take some steps back, from the last one on."""
    n_positions, n = r.q.size, r.v.size
    for back in range(count):
        k = first + count - 1 - back
        used = _STAGES if has_next(r.output, k) else _OF_END
        _evaluate_stages(r, p, k, used)
        for i in range(n_positions):
            r.dq[i], s.dq[i] = s.dq[i], 0.0
        for i in range(n):
            r.dv[i], s.dv[i] = s.dv[i], 0.0
        _combine(r, k, r.A[_OF_END], r.state)
        _settle_back(r, p, s, r.t[k] + r.h[k])
        _spread(r, s, k, r.A[_OF_END])
        while has_next(r.output, k):
            r.output.left[0] -= 1
            at = r.output.left[0]
            for i in range(n_positions):
                r.dq[i] = r.output.by_q[at, i]
            for i in range(n):
                r.dv[i] = r.output.by_v[at, i]
            _combine(r, k, r.slopes[at], r.state)
            _settle_back(r, p, s, r.output.t[at])
            _spread(r, s, k, r.slopes[at])
        if s.none.size > 0:  # projections have chosen constraints of their own
            choose_constraints_anew(p)
            accelerations(p, _time(r, k, 0), r.u[0, :n_positions], r.u[0, n_positions:], r.v)
        for later in range(used):
            _take_stage_back(r, p, s, k, used - 1 - later)


@inner
def _take_stage_back(r: _StagesBack, p: Any, s: StepsBack, k: int, stage: int) -> None:
    n_positions, n = r.q.size, r.v.size
    for i in range(n_positions):
        r.q[i], r.dq[i] = r.u[stage, i], 0.0
    for i in range(n):
        r.v[i], r.dv[i] = r.u[stage, n_positions + i], 0.0
        s.da[i], r.none[i] = r.dK[stage, n_positions + i], r.K[stage, n_positions + i]
    velocities_back(p, r.q, r.v, r.dK[stage, :n_positions], r.dq, r.dv)
    accelerate_back(p, s, _time(r, k, stage), r.q, r.v, r.none)
    for i in range(n_positions):
        r.dq[i] += s.of_q[i]
    for i in range(n):
        r.dv[i] += s.of_v[i]
    _spread(r, s, k, r.A[stage])


def _record_steps(method: RungeKutta, march: WeightedMarch) -> tuple[Array, Array, Array]:
    """March once; return the begins of all steps [s], the end of the last one with them, their lengths, and states."""
    state = method.start(march.system, march.q0, march.v0).copy()
    m, p, steps = method.room(march.system), march.parameters, method.begin(march.system, state, march.times[-1:])
    begins, states = list[float](), list[Array]()
    most = MOST_BEGINS_KEPT // max(1, state.q.size + state.v.size)
    while steps.cursor[0] < 1:
        stop = begin_steps(march.system, p, steps, None)
        if len(begins) == most:
            raise NotTakenBackError(f"{method.name}: more than {most} steps aren't kept to go back along them")
        begins.append(float(steps.clock[0]))
        states.append(np.concatenate([state.q, state.v]))
        require_steps(method.name, steps, int(march_steps(m, p, steps, stop, 1)))
    t = np.array([*begins, float(steps.clock[0])])
    return t, np.diff(t), np.array(states)


def _slopes_at(x: Array) -> Array:
    """Return the weights of the slopes at parts x of a step, (n, 16): of the dense output, of its end at 1."""
    rows = _tableau()
    unit, end = np.eye(_STAGES), rows[_OF_END]
    dense = [end, unit[0] - end, 2.0 * end - unit[12] - unit[0], *_tableau(dop853.ROWS[18:22])]
    found = np.zeros((len(x), _STAGES))
    for row in range(6, -1, -1):
        found = (found + dense[row]) * ((1.0 - x) if row % 2 else x)[:, None]
    return np.where(x[:, None] < 1.0, found, end)


def _tableau(rows: tuple[dict[int, float], ...] = dop853.ROWS[:_STAGES]) -> Array:
    return np.array([[row.get(k, 0.0) for k in range(_STAGES)] for row in rows])


@take_back.register
def _take_march_back(method: RungeKutta, march: WeightedMarch, sums: Sums) -> tuple[Array, Array, float]:
    system, times = march.system, march.times
    t, h, begin = _record_steps(method, march)
    own = np.searchsorted(t[1:], times)
    output, per_step = march.output_in(own, times - t[own]), _STAGES * march.n_kept + march.n_projected
    n_steps, kept, projected = march.divide(output, per_step)
    s = make_room(system, math.nan, 1, per_step * kept + projected)
    n_positions, n, n_all = system.n_positions, system.n, begin.shape[1]
    ends = t[own + 1]
    r = _StagesBack(
        C=np.array(dop853.C),
        A=_tableau(),
        t=t,
        h=h,
        begin=begin,
        output=output,
        slopes=_slopes_at(np.where(times < ends, output.offset / h[own], 1.0)),
        **{name: np.zeros((_STAGES, n_all)) for name in ("u", "K", "dK")},
        **{name: np.zeros(size) for name, size in (("state", n_all), ("q", n_positions), ("dq", n_positions))},
        **{name: np.zeros(n) for name in ("v", "dv", "none")},
    )
    for first in reversed(range(0, n_steps, kept)):
        _take_steps_back(r, march.parameters, s, first, min(kept, n_steps - first))
        sums.take(s.known)
    return s.dq, s.dv, float(s.left[0])
