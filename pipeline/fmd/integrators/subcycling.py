"""Sub-cycled central difference method of Miao, Zhu, Shi & Chen, Comput Mech 41 (2008), eqs. (8)–(11).

At the start of a major cycle of length ``H = m h`` both sets are solved together, ``M̂ a = Q̂``. The slow coordinates
then take one step H; the fast ones take m steps h, the first with that acceleration, the others with
``a_S = M_SS⁻¹ (Q_S − K_S q_S − M_SL a_L)``. Over the cycle M̂ and a_L are frozen (the "instantaneous structure"). A
mechanism holds the tangents of Q̂ by the fast coordinates and rates, and lets Q̂ change with its loads and with the slow
motion: a force frozen for a cycle would lag behind the mode that makes it and damp it at first order in H.

m = 1 is central difference, bit for bit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import field, replace
from functools import partial
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.dynamics.system import (
    System,
    accelerations,
    advance,
    begin_whole_cycles,
    cross_cycle,
    fast_steps,
    freeze_slow,
    project_onto_constraints,
)
from fmd.integrators.carried import DEGREES, CarriedSteps, carried_steps, whole_carried_steps
from fmd.integrators.central_difference import CentralDifference, LeapfrogSteps
from fmd.integrators.fixed_step import (
    FixedMarch,
    FixedStepIntegrator,
    begin_cycle,
    end_cycle,
    runs_away,
    sample_within,
    take_cycles,
    take_steps,
)
from fmd.integrators.march_tables import Samples
from fmd.integrators.protocol import Integrator, Progress, State, Trajectory, require_ratio, start_state
from fmd.kernels.arrays import copy
from fmd.kernels.kernel import inlined
from fmd.kernels.table import Table, aligned


@dataclass(frozen=True)
class Subcycling(FixedStepIntegrator):
    """Sub-cycling by a fast step [s] and a number of fast steps to a major cycle.

    Where slow and fast coordinates couple through the mass matrix, the slow acceleration frozen over the cycle makes
    the method weakly unstable; joint-conforming modes remove the coupling in the reference state.

    Over a cycle the fast coordinates' forces follow their ``"tangents"``, are ``"carried"`` on from the cycles before,
    or ``"frozen"``, see `carried`.
    """

    step: float
    substeps: int = field()  # none by default
    forces: str = "tangents"

    name = "sub-cycling"
    takes_contacts = True

    def __post_init__(self) -> None:
        require_ratio(self.step, self.substeps)
        if self.forces not in ("tangents", *DEGREES):
            raise ValueError(f"forces is {self.forces!r}, expected 'tangents', 'carried' or 'frozen'")

    def order(self, system: System) -> int:
        """Return 2, or 1 if a cycle freezes forces, or slow accelerations that couple with the fast coordinates."""
        return 1 if self.substeps > 1 and (system.coupled or self.forces == "frozen") else 2

    def suits(self, system: System) -> bool:
        """Tell whether forces can go on as wanted: those of loops answer each fast step, so they need tangents."""
        return self.forces == "tangents" or not system.has_loops

    @property
    def remembered(self) -> bool:
        """True if a cycle depends on what a state's memory has of the cycles before."""
        return self.substeps > 1 and self.forces != "tangents"

    def largest_step(self, system: System) -> float:
        """Return the step at which fast or slow coordinates reach their own steps' limit [s]; all if m = 1."""
        if self.substeps == 1:
            return system.largest_step
        return min(system.largest_fast_step, system.largest_slow_step / self.substeps)

    @classmethod
    def ladders(cls, explicit: Sequence[float], coarse: Sequence[float]) -> Iterator[Sequence[Integrator]]:
        """Yield two ratios, each with every step that plain central difference takes."""
        yield from ([cls(step, m) for step in explicit] for m in (5, 10))

    def load_cycle(self, system: System) -> int:
        """Return the steps of a cycle, over which loads are frozen, if there are slow coordinates."""
        return self.substeps if system.n_slow else 1

    def fast_frequency(self, system: System) -> float:
        """Return the highest angular frequency of the fast coordinates alone [rad/s]."""
        return system.highest_fast_frequency if self.substeps > 1 else system.highest_frequency

    def start(self, system: System, q0: Array, v0: Array) -> State:
        """Return the state at time 0, rates half a step before it, those of slow coordinates half a cycle."""
        start = start_state(self, system, q0, v0, self.lag(system))
        return replace(start, memory=np.zeros(self._own_memory(system)))

    def _own_memory(self, system: System) -> int:
        """Return how many values a state remembers: of kinds of cycles where surfaces touch, and of carried forces."""
        touching = 2 if self.substeps > 1 and system.n_contact_values else 0
        return touching + (2 * system.n + 1 if self.remembered else 0)

    def history_size(self, state: State) -> int:
        """Return the number of forces carried on from the cycles before, but for how many of these are known."""
        return state.memory.size - 1 if self.remembered else 0

    def carries_tangent(self, system: System, others: Sequence[System]) -> bool:
        """Tell whether tangents can be marched: where forces follow theirs, and nothing touches."""
        return not system.n_contact_values and (self.substeps == 1 or self.forces == "tangents")

    def lag(self, system: System) -> Array:
        """Return half a step, for slow coordinates half a cycle."""
        own = system.motion
        lag = np.full(own.n, 0.5 * self.step)
        lag[: own.n_slow] *= self.substeps
        with_tangents: Any = system
        return lag if own is system else np.asarray(with_tangents.spread(lag))

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN."""
        if self.substeps == 1:
            return replace(CentralDifference(self.step).resume(system, start, times, progress), integrator=self.name)
        march = super().resume(system, start, times, progress)
        if not system.n_contact_values:
            return march
        single = (self.substeps - 1) * int(march.end.memory[1] - start.memory[1])
        fast = max(0, march.fast_evaluations - single)
        return replace(march, evaluations=march.evaluations + single, fast_evaluations=fast)

    def describe(self, times: Array, q: Array, v: Array, end: State, n_steps: int, seconds: float) -> Trajectory:
        """Return the trajectory of a march with so many fast steps."""
        m = self.substeps
        fast = 0 if self.remembered else n_steps - n_steps // m
        return Trajectory(self.name, self.step, m, times, q, v, n_steps // m, fast, seconds, end)

    def fixed_march(self, system: System) -> FixedMarch:
        """Return what a system is marched with."""
        if system.motion is not system:
            return self._march_with_tangents(system)
        h, m, n = self.step, self.substeps, system.n
        if m == 1:
            return replace(CentralDifference(h).fixed_march(system), name=self.name)
        if system.n_contact_values:
            return self._touching_march(system)
        whole = system.carried_cycle() if self.remembered else system.cycle(h, m)

        def make(state: State) -> FrozenSteps | WholeSteps | CarriedSteps:
            if self.remembered:
                steps = carried_steps(system, h, m, DEGREES[self.forces], state)
                return steps if whole is None else whole_carried_steps(steps)
            now = aligned(system.n_positions, n)
            if whole is None:
                return FrozenSteps(h, m, system.fast_places, state.q, state.v, state.a, *now)
            return WholeSteps(h, m, system.n_slow, state.q, state.v, state.a, *now, *aligned(n, n, n, n, n))

        stepwise = system.leapfrog if self.remembered else partial(system.frozen, m * h)
        return FixedMarch(self.name, make, system, stepwise() if whole is None else whole, h, m)

    def _march_with_tangents(self, system: Any) -> FixedMarch:
        """Return what a system with tangents of its motion is marched with."""
        h, m = self.step, self.substeps

        def make(state: State) -> CyclesWithTangents:
            now = aligned(system.n_positions, system.n)
            return CyclesWithTangents(h, m, system.fast_places, state.q, state.v, state.a, *now)

        return FixedMarch(self.name, make, system, system.cycle_tangents(h, m), h, m)

    def _touching_march(self, system: System) -> FixedMarch:
        """Return what a system with contacts is marched with, whose module only such systems load."""
        from fmd.integrators.touching_cycles import TouchingCycles

        h, m, n = self.step, self.substeps, system.n

        def make(state: State) -> TouchingCycles:
            own, room = (state.q, state.v, state.a), aligned(system.n_positions, n, n, n)
            cycles: FrozenSteps | CarriedSteps
            if self.remembered:
                remembered = replace(state, memory=state.memory[2 : self._own_memory(system)])
                cycles = carried_steps(system, h, m, DEGREES[self.forces], remembered)
            else:
                cycles = FrozenSteps(h, m, system.fast_places, *own, *aligned(system.n_positions, n))
            singles = LeapfrogSteps(h, *own, *aligned(system.n_positions, n))
            known = cycles.memory[-1:] if isinstance(cycles, CarriedSteps) else np.zeros(1)
            kind = np.zeros(1, dtype=np.int64)
            return TouchingCycles(
                system.n_slow, *own, cycles, singles, system.leapfrog(), state.memory[:2], known, kind, *room
            )

        storage = system.leapfrog() if self.remembered else system.frozen(m * h)
        return FixedMarch(self.name, make, system, storage, h, m, own_memory=self._own_memory(system))


@dataclass(frozen=True)
class FrozenSteps(Table):
    """State of a sub-cycled march, and room for what its samples begin with; fast coordinates are scalars."""

    h: float
    substeps: int
    place: IntArray  # (n,): position that each fast rate moves, -1 for slow ones
    q: Array
    v: Array
    a: Array
    q_now: Array
    v_now: Array


@dataclass(frozen=True)
class CyclesWithTangents(FrozenSteps):
    """State of a sub-cycled march with its tangents, whose slow coordinates stand between its fast ones."""


@begin_cycle.register(FrozenSteps)
@inlined
def _begin_cycle(m: FrozenSteps, p: Any, frozen: Any, first: int, sampled: bool) -> None:
    """Evaluate all accelerations, freeze the fast equation, and take the slow step."""
    t, H = first * m.h, m.substeps * m.h
    for i in range(m.v.size):
        m.v_now[i] = m.v[i] + 0.5 * (H if m.place[i] < 0 else m.h) * m.a[i]
    for i in range(m.q.size if sampled else 0):
        m.q_now[i] = m.q[i]
    accelerations(p, t, m.q, m.v_now, m.a)
    freeze_slow(p, t, m.q, m.v_now, m.a, frozen)
    for i in range(m.v.size):
        m.v_now[i] = 0.0
        if m.place[i] < 0:
            m.v[i] += H * m.a[i]
            m.v_now[i] = m.v[i]
    advance(p, m.q, m.v_now, H, 0, m.v.size)


@begin_cycle.register(CyclesWithTangents)
def _begin_with_tangents(m: CyclesWithTangents, p: Any, frozen: Any, first: int, sampled: bool) -> None:
    copy(m.v, frozen.behind)
    _begin_cycle(m, p, frozen, first, sampled)


@take_steps.register(FrozenSteps)
def _take_steps(m: FrozenSteps, p: Any, frozen: Any, first: int, done: int, count: int, sampled: bool) -> int:
    for i in range(m.v.size if sampled else 0):
        if m.place[i] >= 0:
            m.q_now[m.place[i]] = m.q[m.place[i]]
    taken = 0
    if done == 0:  # with the accelerations of the cycle's begin
        for i in range(m.v.size):
            if m.place[i] >= 0:
                m.v[i] += m.h * m.a[i]
                m.q[m.place[i]] += m.h * m.v[i]
        taken = 1
    if count > taken:
        fast_steps(p, frozen, first + done + taken, m.h, count - taken, m.q, m.v, m.a)
    return 0 if runs_away(m.v) else count


@sample_within.register(FrozenSteps)
def _sample_within(m: FrozenSteps, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    s_slow, H = s + done * m.h, m.substeps * m.h
    copy(m.q_now, q)
    for i in range(v.size):  # Taylor's polynomial, which the next step continues
        step, ahead = (H, s_slow) if m.place[i] < 0 else (m.h, s)
        rate = m.v[i] - 0.5 * step * m.a[i] + 0.5 * ahead * m.a[i]
        v[i] = rate + 0.5 * ahead * m.a[i]
        m.v_now[i] = rate
        if m.place[i] >= 0:
            q[m.place[i]] += ahead * rate
            m.v_now[i] = 0.0
    advance(p, q, m.v_now, s_slow, 0, v.size)


@end_cycle.register(FrozenSteps)
def _end_cycle(m: FrozenSteps, p: Any, frozen: Any, first: int, samples: Samples, first_sample: int) -> None:
    project_onto_constraints(p, (first + m.substeps) * m.h, m.substeps * m.h, m.q, m.v, m.a)


@dataclass(frozen=True)
class WholeSteps(Table):
    """State of a sub-cycled march that takes cycles as a whole, and the begin of one with samples.

    To a sample the cycle is taken anew, so that it ends by the same operations with samples or without.
    """

    h: float
    substeps: int
    n_slow: int
    q: Array
    v: Array
    a: Array
    q_begin: Array
    v_begin: Array
    a_begin: Array
    q_now: Array
    v_now: Array
    a_now: Array
    begin: Array


@begin_cycle.register(WholeSteps)
def _begin_whole_cycle(m: WholeSteps, p: Any, cycle: Any, first: int, sampled: bool) -> None:
    """Take the cycle."""
    if sampled:
        for i in range(m.v.size):
            m.q_begin[i], m.v_begin[i], m.a_begin[i] = m.q[i], m.v[i], m.a[i]
    begin_whole_cycles(p, cycle, first, m.h, 1)
    cross_cycle(p, cycle, m.substeps, m.q, m.v, m.a, m.begin)


@take_cycles.register(WholeSteps)
def _take_whole_cycles(m: WholeSteps, p: Any, cycle: Any, first: int, count: int) -> int:
    done = 0
    while done < count:
        last = done + begin_whole_cycles(p, cycle, first + done * m.substeps, m.h, count - done)
        while done < last:
            done += 1
            if cross_cycle(p, cycle, m.substeps, m.q, m.v, m.a, m.begin):
                return done
    return count


@take_steps.register(WholeSteps)
def _take_whole_steps(m: WholeSteps, p: Any, cycle: Any, first: int, done: int, count: int, sampled: bool) -> int:
    if sampled and done > 0:
        for i in range(m.v.size):
            m.q_now[i], m.v_now[i], m.a_now[i] = m.q_begin[i], m.v_begin[i], m.a_begin[i]
        cross_cycle(p, cycle, done + 1, m.q_now, m.v_now, m.a_now, m.begin)
        for i in range(m.v.size):
            m.q_now[i] = m.q_begin[i] if i < m.n_slow else m.q_now[i] - m.h * m.v_now[i]
    return 0 if done == 0 and runs_away(m.v) else count


@sample_within.register(WholeSteps)
def _sample_whole(m: WholeSteps, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    H = m.substeps * m.h
    for i in range(v.size):  # Taylor's polynomial, which the next step continues
        step, ahead = (H, s + done * m.h) if i < m.n_slow else (m.h, s)
        if done == 0:
            a, rate, q[i] = m.begin[i], m.v_begin[i] + 0.5 * (step + ahead) * m.begin[i], m.q_begin[i]
        else:
            a, rate, q[i] = m.a_now[i], m.v_now[i] - 0.5 * (step - ahead) * m.a_now[i], m.q_now[i]
        v[i] = rate + 0.5 * ahead * a
        q[i] += ahead * rate
