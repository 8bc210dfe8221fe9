"""Sub-cycling of a compiled mechanism with loops: its fast equation, frozen from a major cycle's begin on.

Multipliers that are frozen over a cycle make the method one of first order that diverges with long cycles. So they
answer each fast step, and the slow coordinates, on which they act, with them: what the slow motion and the loads change
in a cycle is taken in to first order in time, by the accelerations a little later.

With ``D = M_LL⁻¹ M_LS`` and ``T = (−D, 1)`` it is ``S̄ a_S = Tᵀ Q̂`` with ``S̄ = M_SS − M_SL D``, and Q̂ is carried on by
its exact tangents along T. Its solution is the fast part of ``M̂⁻¹ Q̂``, so no matrix is factored: compiled functions
solve for eight columns at once.
"""

from __future__ import annotations

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.closed import begin_reaction, close_reaction, close_response
from fmd.dynamics.compiled_system.frozen import complete_constant, keep_columns, step_all
from fmd.dynamics.compiled_system.kernels import set_inputs
from fmd.dynamics.compiled_system.parameters import ClosedCycle, ClosedParameters, MiddleCycle
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import accelerations, advance, fast_steps, freeze_slow, velocities
from fmd.kernels.arrays import copy
from fmd.kernels.kernel import inlined
from fmd.kernels.vectors import call_native


@freeze_slow.register(ClosedParameters)
def _freeze_slow(p: ClosedParameters, t: float, q: Array, v: Array, a: Array, closed: ClosedCycle) -> None:
    middle, D, frozen = closed.middle, closed.D, closed.middle.frozen
    n, n_slow, ahead = v.size, frozen.n_slow, closed.ahead[0]
    set_inputs(p, float(t))
    frozen.time[0] = t
    copy(q, closed.q)
    freeze_reacting(p, q, v, D, middle, a)
    for i in range(n_slow):  # the motion of q_L + D q_S, which leaves the fast coordinates where they are
        closed.a[i] = v[i]
        closed.v[i] = v[i] + ahead * middle.y[i]
        for j in range(n_slow, n):
            closed.a[i] += D[j, i] * v[j]
    for j in range(n_slow, n):
        closed.v[j] = v[j]
    advance(p, closed.q, closed.a, ahead, 0, n_slow)
    accelerations(p, t + ahead, closed.q, closed.v, closed.a)
    p.whole.fresh[0] = 1.0  # for the next cycle
    for j in range(n_slow, n):
        frozen.slope[j] = (closed.a[j] - a[j]) / ahead


@fast_steps.register(ClosedParameters)
def _fast_steps(
    p: ClosedParameters, frozen: ClosedCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    step_all(p, frozen.middle.frozen, first, h, count, q, v, a)


@inlined
def _find_reaction(p: ClosedParameters, q: Array, block: int, D: Array, middle: MiddleCycle) -> None:
    """Compute D and how all coordinates follow a block of fast ones."""
    frozen, along = middle.frozen, middle.along_rates[block]
    first, n, n_slow = frozen.n_slow + LANES * block, along.shape[0], frozen.n_slow
    count = min(LANES, n - first)
    call_native(middle.inertia, (p.inputs, q, frozen.unit_rates[block], frozen.f))
    call_native(middle.solve_slow, (p.inputs, q, frozen.f, frozen.x))
    close_reaction(p, frozen.x, first, count, n_slow)
    for i in range(n_slow):
        for lane in range(LANES):
            along[i, lane] = -frozen.x[i, lane]
    for lane in range(count):
        for i in range(n_slow):
            D[first + lane, i] = frozen.x[i, lane]
    for lane in range(count if p.quaternions.shape[0] else 0):
        for i in range(n):
            middle.row[i] = along[i, lane]
        velocities(p, q, middle.row, frozen.moved)
        for i in range(q.size):
            middle.along_positions[block, i, lane] = frozen.moved[i]


@inlined
def _keep_response(p: ClosedParameters, q: Array, block: int, middle: MiddleCycle, on_fast: Array) -> None:
    """Keep what a block of columns of −Q̂, in ``frozen.f``, does to the fast accelerations."""
    frozen = middle.frozen
    call_native(middle.solve, (p.inputs, q, frozen.f, frozen.x))
    close_response(p, frozen.f, frozen.x)
    keep_columns(frozen.x, block, frozen.n_slow, on_fast)


@inlined
def freeze_reacting(p: ClosedParameters, q: Array, v: Array, D: Array, middle: MiddleCycle, a: Array) -> None:
    """Freeze the fast equation at a state with accelerations a, the slow coordinates reacting to the fast ones."""
    frozen, n_slow = middle.frozen, middle.frozen.n_slow
    plain = p.quaternions.shape[0] == 0  # positions follow as rates do
    begin_reaction(p, middle.inertia, middle.solve_slow, q, n_slow)
    for block in range(middle.along_rates.shape[0]):
        _find_reaction(p, q, block, D, middle)
    for block in range(middle.along_rates.shape[0]):
        rates = middle.along_rates[block]
        positions = rates if plain else middle.along_positions[block]
        call_native(frozen.stiffness, (p.inputs, q, v, middle.rest, positions, frozen.f))
        _keep_response(p, q, block, middle, frozen.K)
        if frozen.damped:
            call_native(frozen.damping, (p.inputs, q, v, rates, frozen.f))
            _keep_response(p, q, block, middle, frozen.C)
    for i in range(n_slow):
        middle.y[i] = a[i]
        for j in range(n_slow, v.size):
            middle.y[i] += D[j, i] * a[j]
    complete_constant(frozen, q, v, a)
