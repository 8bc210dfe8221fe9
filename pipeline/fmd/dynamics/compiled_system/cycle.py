"""Sub-cycling of a compiled mechanism by one function a major cycle: by tangents of uncoupled coordinates, or carried.

Loads and motions that vary are evaluated at all fast steps of a cycle together, before it is taken. Times in which none
of them changes are known, and the last values serve there.
"""

from __future__ import annotations

from fmd.core.arrays import Array
from fmd.core.limits.stepping import RUNAWAY
from fmd.dynamics.compiled_system.kernels import inputs_at, set_inputs
from fmd.dynamics.compiled_system.parameters import CarriedCycle, TreeParameters, WholeCycle
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import begin_whole_cycles, cross_by_carried_forces, cross_cycle
from fmd.kernels.kernel import inlined
from fmd.kernels.vectors import call_native


@begin_whole_cycles.register(TreeParameters)
def _begin_whole_cycles(p: TreeParameters, cycle: WholeCycle, first: int, h: float, count: int) -> int:
    """Evaluate loads and motions at a cycle's begin and, if any of them varies in it, at its fast steps."""
    if p.signals == 0:
        return count
    t, end, still = first * h, (first + cycle.count) * h, 1
    cycle.varying[0] = cycle.count
    for k in range(cycle.quiet.shape[0]):
        if cycle.quiet[k, 0] < t and end <= cycle.quiet[k, 1]:  # what ends acts at its end, too
            cycle.varying[0] = 0
            still = _whole_cycles_before(cycle.quiet[k, 1], first, h, cycle.count, count)
            if cycle.quiet[k, 0] < p.clock[0] < cycle.quiet[k, 1]:
                p.clock[0] = t
    if cycle.varying[0] == 0:
        set_inputs(p, t)
        if cycle.known[1] >= 0:  # the last step is by the loads that are known ahead, too
            cycle.known[1], cycle.steps[4] = -1, 0.0
            for k in range(cycle.now.size):
                cycle.ahead[0, k, 0] = p.inputs[k]
        return still
    if first < cycle.known[0] or cycle.known[1] < first + cycle.count:
        _look_ahead(p, cycle, first, h)
    place = first - cycle.known[0]
    cycle.steps[4] = place
    for k in range(cycle.now.size):
        p.inputs[k] = cycle.ahead[place // LANES, k, place % LANES]
    p.clock[0] = t
    return 1


@inlined
def _whole_cycles_before(end: float, first: int, h: float, steps: int, most: int) -> int:
    """Return how many cycles, ``most`` at most, end before a time [s], one at least."""
    if (first + most * steps) * h <= end:
        return most
    count = int((end / h - first) / steps)
    return max(1, min(most, count - 1))


@inlined
def _look_ahead(p: TreeParameters, cycle: WholeCycle, first: int, h: float) -> None:
    """Evaluate loads and motions at some steps."""
    cycle.known[0] = first
    if cycle.signals_ahead:
        cycle.known[1] = first + LANES * cycle.ahead.shape[0]
        cycle.start[1] = h
        for block in range(cycle.ahead.shape[0]):
            cycle.start[0] = first + LANES * block
            call_native(cycle.signals_ahead, (cycle.start, cycle.numbers, cycle.ahead[block]))
    else:
        cycle.known[1] = first + cycle.count
        for step in range(cycle.count):
            inputs_at(p, (first + step) * h, cycle.now)
            for k in range(cycle.now.size):
                cycle.ahead[step // LANES, k, step % LANES] = cycle.now[k]


@cross_cycle.register(TreeParameters)
def _cross_cycle(p: TreeParameters, cycle: WholeCycle, count: int, q: Array, v: Array, a: Array, begin: Array) -> bool:
    cycle.steps[2] = count
    cycle.steps[3] = min(count - 1, cycle.varying[0])
    call_native(cycle.cross, (p.inputs, cycle.steps, cycle.inverse_mass, cycle.ahead, q, v, a, begin))
    return not cycle.steps[5] < RUNAWAY * RUNAWAY


@cross_by_carried_forces.register(TreeParameters)
def _cross_by_carried_forces(
    p: TreeParameters,
    carried: CarriedCycle,
    t: float,
    maps: Array,
    q: Array,
    v: Array,
    a: Array,
    memory: Array,
    begin: Array,
) -> bool:
    set_inputs(p, float(t))
    call_native(carried.cross, (p.inputs, maps, q, v, a, memory, begin, carried.square))
    return not carried.square[0] < RUNAWAY * RUNAWAY
