"""Central difference method in leapfrog form: ``v_{n+½} = v_{n−½} + h a_n``, ``q_{n+1} = q_n + h v_{n+½}``.

Velocity-dependent forces take ``v_n ≈ v_{n−½} + ½ h a_{n−1}``, which keeps the method explicit and of second order.
Stable for ω_max h < 2.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.clock import read_clocks, seconds_since
from fmd.core.data_classes import dataclass
from fmd.core.limits.stepping import LANE_STEPS
from fmd.dynamics.system import System, advance, leapfrog_step
from fmd.integrators.fixed_step import (
    FixedMarch,
    FixedStepIntegrator,
    SingleSteps,
    make_samples,
    runs_away,
    sample_within,
    take_steps,
)
from fmd.integrators.lanes import arrange_lanes, make_lanes, march_lanes
from fmd.integrators.march_tables import make_starts
from fmd.integrators.protocol import Integrator, State, Trajectory, require_step, start_state
from fmd.kernels.arrays import copy
from fmd.kernels.table import aligned


@dataclass(frozen=True)
class CentralDifference(FixedStepIntegrator):
    """Central difference method with a constant step [s]: explicit, of order 2."""

    step: float

    name = "central-difference"
    marches_tangents = True
    marches_touching_tangents = True
    takes_contacts = True

    def __post_init__(self) -> None:
        require_step(self.step)

    def order(self, system: System) -> int:
        """Return 2."""
        return 2

    def largest_step(self, system: System) -> float:
        """Return ``2/ω_max`` of the coupled system, less what its dampers take [s]."""
        return system.largest_step

    @classmethod
    def ladders(cls, explicit: Sequence[float], coarse: Sequence[float]) -> Iterator[Sequence[Integrator]]:
        """Yield the method with every stable step."""
        yield [cls(step) for step in explicit]

    def start(self, system: System, q0: Array, v0: Array) -> State:
        """Return the state at time 0, its rates half a step before it."""
        return start_state(self, system, q0, v0, self.lag(system))

    def lag(self, system: System) -> Array:
        """Return half a step."""
        return np.full(system.n, 0.5 * self.step)

    def describe(self, times: Array, q: Array, v: Array, end: State, n_steps: int, seconds: float) -> Trajectory:
        """Return the trajectory of a march with so many steps."""
        return Trajectory(self.name, self.step, 1, times, q, v, n_steps, 0, seconds, end)

    def fixed_march(self, system: System) -> FixedMarch:
        """Return what a system is marched with."""

        def make(state: State) -> LeapfrogSteps:
            return LeapfrogSteps(self.step, state.q, state.v, state.a, *aligned(system.n_positions, system.n))

        return FixedMarch(self.name, make, system, system.leapfrog(), self.step)

    def maps_slopes(self, system: System) -> bool:
        """Return true where positions are as many as rates, and nothing else acts at the end of a step."""
        own = system.n_positions == system.n and not (system.has_loops or system.is_sampled)
        return own and not system.n_contact_values

    def map_slopes(self, slopes: Array) -> Array:
        """Return the maps over a step: ``a`` at ``v + ½ h a``, then ``v += h a``, ``q += h v``."""
        h, n = self.step, slopes.shape[1] // 2
        by_q, by_v = slopes[:, n:, :n], slopes[:, n:, n:]
        unit, nothing = np.broadcast_to(np.eye(n), by_q.shape), np.zeros(by_q.shape)
        a = np.concatenate([by_q, by_v, 0.5 * h * by_v], axis=2)
        v = np.concatenate([nothing, unit, nothing], axis=2) + h * a
        q = np.concatenate([unit, nothing, nothing], axis=2) + h * v
        return np.concatenate([q, v, a], axis=1)

    def march_each(
        self, system: System, start: State, values: Array, first: IntArray, n_cycles: int, times: Array
    ) -> tuple[Array, Array, Array, IntArray, float]:
        """March from each of many `State.values`, eight at once where they are many and have numbers of their own."""
        groups, alone = arrange_lanes(first)
        several = values.shape[1] > start.values.size and groups.size * n_cycles >= LANE_STEPS
        leap = system.leap_in_lanes if several else 0
        if not leap:
            return super().march_each(system, start, values, first, n_cycles, times)
        p, samples = system.parameters, make_samples(start, times, self.step)
        starts = make_starts(start, values, first, times, p)
        tick = read_clocks()
        march_lanes(make_lanes(leap, p, self.step, start.v.size), samples, starts, groups, n_cycles)
        found = starts.values, starts.sampled_q, starts.sampled_v, starts.done
        if len(alone):
            *few, _ = super().march_each(system, start, values[alone], first[alone], n_cycles, times)
            for whole, own in zip(found, few, strict=True):
                whole[alone] = own
        return *found, seconds_since(tick) / len(first)


@dataclass(frozen=True)
class LeapfrogSteps(SingleSteps):
    """State of a leapfrog march, and room for what its samples begin with."""

    h: float
    q: Array
    v: Array
    a: Array
    q_now: Array
    v_now: Array


@take_steps.register(LeapfrogSteps)
def _take_steps(m: LeapfrogSteps, p: Any, leapfrog: Any, first: int, done: int, count: int, sampled: bool) -> int:
    if sampled:
        copy(m.q, m.q_now)
    h, q, v, a = m.h, m.q, m.v, m.a
    for k in range(count):
        leapfrog_step(p, leapfrog, (first + done + k) * h, h, q, v, a)
        if runs_away(v):
            return k
    return count


@sample_within.register(LeapfrogSteps)
def _sample_within(m: LeapfrogSteps, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    for i in range(v.size):  # Taylor's polynomial, which the next step continues
        m.v_now[i] = m.v[i] - 0.5 * m.h * m.a[i] + 0.5 * s * m.a[i]
        v[i] = m.v_now[i] + 0.5 * s * m.a[i]
    copy(m.q_now, q)
    advance(p, q, m.v_now, s, 0, v.size)
