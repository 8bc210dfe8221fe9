"""Adjoint of a march by the exponential method, step by step.

Stages and ends of a step are linear in its begin and in the rests N of its stages, by the functions of its oscillators;
what weights these have goes from the end back, and through the equations at each stage.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiled_system.adjoint_kernels import (
    StepsBack,
    accelerate_back,
    project_back,
)
from fmd.dynamics.system import accelerations, choose_constraints_anew
from fmd.integrators.adjoint import Sums, WeightedMarch, WeightedOutput, has_next, make_room, sections_back, take_back
from fmd.integrators.exponential import Exponential, ExponentialSteps, fill_functions, move_oscillator, take_step
from fmd.kernels.kernel import inner, kernel
from fmd.kernels.table import Table


@dataclass(frozen=True)
class _StagesBack(Table):
    """Begins of a section's steps, the march's output, and weights in a step."""

    begin: Array  # (n_kept, 2, n): positions and rates
    output: WeightedOutput
    q: Array  # (n,): a state, weights of it, and accelerations there
    v: Array
    dq: Array
    dv: Array
    a: Array
    dN: Array  # (4, n): weights of the rests at the begin and at the stages
    of_begin_q: Array  # (n,): and of the step's begin, and of its first stage
    of_begin_v: Array
    of_stage_q: Array
    of_stage_v: Array


@kernel
def _take_steps(m: ExponentialSteps, p: Any, r: _StagesBack, first: int, count: int) -> None:
    """Take some steps, and keep their begins."""
    for k in range(count):
        for i in range(m.v.size):
            r.begin[k, 0, i], r.begin[k, 1, i] = m.q[i], m.v[i]
        take_step(m, p, (first + k) * m.h)


@kernel
def _take_back(m: ExponentialSteps, p: Any, s: StepsBack, r: _StagesBack, first: int, count: int) -> None:
    """Take the kept steps back, weights ``dq`` and ``dv`` of the section's end to those of its begin."""
    for back in range(count):
        k = count - 1 - back
        t = (first + k) * m.h
        for i in range(m.v.size):
            m.q[i], m.v[i] = r.begin[k, 0, i], r.begin[k, 1, i]
            r.of_begin_q[i], r.of_begin_v[i], r.of_stage_q[i], r.of_stage_v[i] = 0.0, 0.0, 0.0, 0.0
            r.dq[i], r.dv[i] = s.dq[i], s.dv[i]
            for stage in range(4):
                r.dN[stage, i] = 0.0
        choose_constraints_anew(p)
        take_step(m, p, t)
        _flow_back(m, p, s, r, t + m.h, m.h, 1.0, m.full)
        while has_next(r.output, first + k):
            r.output.left[0] -= 1
            at = r.output.left[0]
            ahead = r.output.offset[at]
            for i in range(m.v.size):
                r.dq[i], r.dv[i] = r.output.by_q[at, i], r.output.by_v[at, i]
                fill_functions(m.stiffness[i], ahead, m.phi[i])
            _flow_back(m, p, s, r, r.output.t[at], ahead, ahead / m.h, m.phi)
        if s.none.size > 0:  # projections have chosen constraints of their own
            choose_constraints_anew(p)
            accelerations(p, t, m.q_now, m.v_now, r.a)
        _stages_back(m, p, s, r, t)


@inner
def _flow_back(
    m: ExponentialSteps, p: Any, s: StepsBack, r: _StagesBack, t: float, ahead: float, x: float, phi: Array
) -> None:
    """Add what a state a time after the step's begin has of it and of the rests, with weights ``dq`` and ``dv``."""
    for i in range(m.v.size):
        r.q[i], r.v[i] = move_oscillator(m, i, ahead, x, phi[i])
    project_back(p, s, t, r.q, r.v, r.dq, r.dv)
    for i in range(m.v.size):
        dq, dv, own = r.dq[i], r.dv[i], phi[i]
        r.of_begin_q[i] += own[0] * dq - m.stiffness[i] * own[1] * dv
        r.of_begin_v[i] += own[1] * dq + own[0] * dv
        c1 = ahead * (own[3] * dq + own[2] * dv)
        c2 = ahead * x * (own[5] * dq + own[4] * dv)
        c3 = 4.0 * ahead * x * x * (own[7] * dq + own[6] * dv)
        r.dN[0, i] += c1 - 3.0 * c2 + c3
        r.dN[1, i] += 2.0 * c2 - c3
        r.dN[2, i] += 2.0 * c2 - c3
        r.dN[3, i] += c3 - c2


@inner
def _stages_back(m: ExponentialSteps, p: Any, s: StepsBack, r: _StagesBack, t: float) -> None:
    h = m.h
    _rest_back(m, p, s, r, t + h, m.qb, m.vb, m.Nc, 3)
    for i in range(m.v.size):
        e, c, f, g = m.half[i, 0], m.half[i, 1], 0.5 * h * m.half[i, 2], 0.5 * h * m.half[i, 3]
        r.of_stage_q[i] += e * r.dq[i] - m.stiffness[i] * c * r.dv[i]
        r.of_stage_v[i] += c * r.dq[i] + e * r.dv[i]
        by_rest = g * r.dq[i] + f * r.dv[i]
        r.dN[2, i] += 2.0 * by_rest
        r.dN[0, i] -= by_rest
        m.qb[i], m.vb[i] = m.qa[i] + g * (m.Na[i] - m.N0[i]), m.va[i] + f * (m.Na[i] - m.N0[i])
    _rest_back(m, p, s, r, t + 0.5 * h, m.qb, m.vb, m.Nb, 2)
    for i in range(m.v.size):
        r.of_stage_q[i] += r.dq[i]
        r.of_stage_v[i] += r.dv[i]
        by_rest = 0.5 * h * (m.half[i, 3] * r.dq[i] + m.half[i, 2] * r.dv[i])
        r.dN[1, i] += by_rest
        r.dN[0, i] -= by_rest
    _rest_back(m, p, s, r, t + 0.5 * h, m.qa, m.va, m.Na, 1)
    for i in range(m.v.size):
        e, c, f, g = m.half[i, 0], m.half[i, 1], 0.5 * h * m.half[i, 2], 0.5 * h * m.half[i, 3]
        dq, dv = r.of_stage_q[i] + r.dq[i], r.of_stage_v[i] + r.dv[i]
        r.of_begin_q[i] += e * dq - m.stiffness[i] * c * dv
        r.of_begin_v[i] += c * dq + e * dv
        r.dN[0, i] += g * dq + f * dv
    _rest_back(m, p, s, r, t, m.q_now, m.v_now, m.N0, 0)
    for i in range(m.v.size):
        s.dq[i] = r.of_begin_q[i] + r.dq[i]
        s.dv[i] = r.of_begin_v[i] + r.dv[i]


@inner
def _rest_back(
    m: ExponentialSteps, p: Any, s: StepsBack, r: _StagesBack, t: float, q: Array, v: Array, N: Array, stage: int
) -> None:
    """Differentiate a weighted rest N at a state by the state: ``dq`` and ``dv``."""
    for i in range(v.size):
        r.a[i] = N[i] - m.stiffness[i] * q[i]
        s.da[i] = r.dN[stage, i]
    accelerate_back(p, s, t, q, v, r.a)
    for i in range(v.size):
        r.dq[i] = s.of_q[i] + m.stiffness[i] * r.dN[stage, i]
        r.dv[i] = s.of_v[i]


@take_back.register
def _take_march_back(method: Exponential, march: WeightedMarch, sums: Sums) -> tuple[Array, Array, float]:
    system, p, n = march.system, march.parameters, march.system.n
    output, per_step = march.locate_output(method.step), 4 * march.n_kept + 2 * march.n_projected
    n_steps, kept, projected = march.divide(output, per_step)
    s = make_room(system, method.step, 1, per_step * kept + projected)
    m = method.make_steps(system.stiffness, 0.0, method.start(system, march.q0, march.v0))
    r = _StagesBack(
        begin=np.zeros((kept, 2, n)),
        output=output,
        **{name: np.zeros(n) for name in ("q", "v", "dq", "dv", "a", "of_begin_q", "of_begin_v")},
        **{name: np.zeros(n) for name in ("of_stage_q", "of_stage_v")},
        dN=np.zeros((4, n)),
    )

    def keep(state: Array, first: int, count: int) -> None:
        m.q[:], m.v[:] = state
        _take_steps(m, p, r, first, count)
        state[:] = m.q, m.v

    for first, count in sections_back(n_steps, kept, np.array([m.q, m.v]), keep):
        _take_back(m, p, s, r, first, count)
        sums.take(s.known)
    return s.dq, s.dv, float(s.left[0])
