"""Adjoint of a march by central difference, step by step."""

from __future__ import annotations

from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiled_system.adjoint_kernels import (
    StepsBack,
    accelerate_back,
    advance_back,
    keep_step,
    project_back,
    step_back,
)
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.system import advance, choose_constraints_anew
from fmd.integrators.adjoint import Sums, WeightedMarch, WeightedOutput, has_next, make_room, sections_back, take_back
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import State
from fmd.kernels.arrays import clear
from fmd.kernels.kernel import inlined, kernel
from fmd.kernels.table import Table


@dataclass(frozen=True)
class _Output(Table):
    """A march's output, and derivatives by a step's begin of what is in it."""

    of: WeightedOutput
    q: Array  # (n_positions,): the output itself
    v: Array  # (n,)
    dq: Array  # (n_positions,): its derivatives
    dv: Array  # (n,)
    rate: Array
    sum_q: Array  # (n_positions,): of all in a step


@kernel
def _take_steps(p: Any, s: StepsBack, q: Array, v: Array, a: Array, first: int, count: int) -> None:
    """Take some steps, and keep them."""
    for k in range(count):
        keep_step(p, s, (first + k) * s.h, k, q, v, a)


@kernel
def _take_back(p: Any, s: StepsBack, output: _Output, first: int, count: int) -> None:
    """Take the kept steps back."""
    for back in range(count):
        k = count - 1 - back
        clear(output.sum_q)
        while has_next(output.of, first + k):
            output.of.left[0] -= 1
            _add_output(p, s, output, output.of.left[0], k)
        step_back(p, s, (first + k) * s.h, k)
        for i in range(s.dq.size):
            s.dq[i] += s.of_q[i] + output.sum_q[i]
        for i in range(s.dv.size):
            s.dv[i] += s.of_v[i]
            s.da[i] = 0.5 * s.h * s.of_v[i]


@kernel
def _take_start_back(p: Any, s: StepsBack, q: Array, v: Array, a: Array) -> None:
    """Go back to time 0 from half a step before it."""
    for i in range(s.dv.size):
        s.da[i] -= 0.5 * s.h * s.dv[i]
    choose_constraints_anew(p)
    accelerate_back(p, s, 0.0, q, v, a)
    for i in range(s.dq.size):
        s.dq[i] += s.of_q[i]
    for i in range(s.dv.size):
        s.dv[i] += s.of_v[i]


@inlined
def _add_output(p: Any, s: StepsBack, output: _Output, number: int, k: int) -> None:
    """Add what an output has of its step's begin, rates and accelerations: Taylor's polynomial, projected."""
    ahead = output.of.offset[number]
    for i in range(s.dq.size):
        output.dq[i] = output.of.by_q[number, i]
        output.q[i] = s.q[k, i]
    for i in range(s.dv.size):
        output.dv[i] = output.of.by_v[number, i]
        output.rate[i] = s.ahead[k, i] + 0.5 * (ahead - s.h) * s.a[k, i]
        output.v[i] = output.rate[i] + 0.5 * ahead * s.a[k, i]
    advance(p, output.q, output.rate, ahead, 0, s.dv.size)
    project_back(p, s, output.of.t[number], output.q, output.v, output.dq, output.dv)
    for i in range(s.dv.size):
        s.da[i] += 0.5 * ahead * output.dv[i]
        output.rate[i] = s.ahead[k, i] + 0.5 * (ahead - s.h) * s.a[k, i]
        output.v[i] = output.dv[i]
    advance_back(p, s.q[k], output.rate, ahead, output.dq, output.v)
    for i in range(s.dq.size):
        output.sum_q[i] += output.dq[i]
    for i in range(s.dv.size):
        s.dv[i] += output.v[i]
        s.da[i] += 0.5 * (ahead - s.h) * output.v[i]


@take_back.register
def _take_march_back(method: CentralDifference, march: WeightedMarch, sums: Sums) -> tuple[Array, Array, float]:
    system, q0, v0, p = march.system, march.q0, march.v0, march.parameters
    per_step, of = _evaluations_in_step(system), march.locate_output(method.step)
    n_steps, kept, projected = march.divide(of, per_step)
    s = make_room(system, method.step, kept, max(2, per_step * kept + projected))
    output = _Output(
        of=of,
        **{name: np.zeros(system.n_positions) for name in ("q", "dq", "sum_q")},
        **{name: np.zeros(system.n) for name in ("v", "dv", "rate")},
    )

    def keep(state: State, first: int, count: int) -> None:
        _take_steps(p, s, state.q, state.v, state.a, first, count)

    for first, count in sections_back(n_steps, kept, method.start(system, q0, v0), keep):
        _take_back(p, s, output, first, count)
        sums.take(s.known)
    start = [np.array(x, dtype=float) for x in (q0, v0, method.start(system, q0, v0).a)]
    _take_start_back(p, s, *start)
    sums.take(s.known)
    return s.dq, s.dv, float(s.left[0])


def _evaluations_in_step(system: CompiledSystem) -> int:
    if not system.has_loops:
        return 1
    return 2 if system.n_positions == system.n else 4
