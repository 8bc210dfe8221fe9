"""Two marches beside a run, a little below and above a number, that are drawn back to it again and again.

Differences of whole motions lose accuracy as their phases part. So after each part of the motion both neighbours are
set to the run's state less and more half of their difference. What is carried on is the derivative of the steps as they
are taken; what a difference leaves out does not grow with time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.fitting import PARTS
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.fixed_step import locate_samples
from fmd.integrators.protocol import ResumableIntegrator, State, Trajectory
from fmd.stages.plan import Plan


@dataclass(frozen=True)
class PartedMarch:
    """A march in parts, with the states at their ends."""

    times: Array  # (n_all,): output times and those between which parts end [s]
    stops: tuple[int, ...]  # number of the first time of each part's successor
    ends: tuple[State, ...]
    trajectory: Trajectory  # at the output times
    draws_back: bool  # true if positions, rates and accelerations are all that the method remembers of the motion


def goes_in_parts(plan: Plan) -> bool:
    """Return whether a run's method takes fixed steps and continues from a state."""
    return isinstance(plan.integrator, ResumableIntegrator) and plan.integrator.step > 0.0


def march_in_parts(plan: Plan, times: Array) -> PartedMarch:
    """March a run whose method `goes_in_parts`; its numbers are those of one march without a break."""
    cycle = plan.integrator.step * plan.integrator.substeps
    whole = np.union1d(times, np.linspace(0.0, times[-1], PARTS + 1))
    number, _ = locate_samples(whole, cycle)
    begins = 1 + np.flatnonzero(np.diff(number))  # where no time of a cycle that is done is left
    chosen = np.linspace(0, len(begins), PARTS + 1)[1:-1].astype(int)
    stops = (*(int(k) for k in np.unique(begins[chosen])), len(whole)) if len(begins) else (len(whole),)
    ends: list[State] = []
    found: list[Trajectory] = []
    for first, stop in zip((0, *stops[:-1]), stops, strict=True):
        part = _march_part(plan, whole[first:stop], ends[-1] if ends else None)
        ends.append(part.end)
        found.append(part)
    method = plan.integrator
    assert isinstance(method, ResumableIntegrator)
    forgets = not any(method.memory_of_motion(state).size for state in ends)
    return PartedMarch(whole, stops, tuple(ends), _join(plan, found, whole, times), forgets)


def march_neighbours(
    run: PartedMarch, plans: Sequence[Plan], signs: Sequence[Mapping[str, Array]], times: Array
) -> list[Trajectory]:
    """March a run for numbers as far below its own as above it, drawn back to it after each part.

    There is a plan for each of both numbers, and for each body what its modal coordinates are multiplied by for those
    of the run itself, whose march is between them; output times in s.
    """
    found: list[list[Trajectory]] = [[], []]
    states: list[State | None] = [None, None]
    turns = [find_turns(plan, own) for plan, own in zip(plans, signs, strict=True)]
    for first, stop, middle in zip((0, *run.stops[:-1]), run.stops, run.ends, strict=True):
        for own, plan, state in zip(found, plans, states, strict=True):
            own.append(_march_part(plan, run.times[first:stop], state))
        low, high = (_turn(own[-1].end, turn) for own, turn in zip(found, turns, strict=True))
        drawn = (_draw_back(middle, low, high, side) for side in (-0.5, 0.5))
        states = [_turn(state, turn) for state, turn in zip(drawn, turns, strict=True)]
    return [_join(plan, own, run.times, times) for plan, own in zip(plans, found, strict=True)]


def _draw_back(middle: State, low: State, high: State, side: float) -> State:
    """Return a state beside another, by a part of the difference of two neighbours."""
    moved = {
        name: getattr(middle, name) + side * (getattr(high, name) - getattr(low, name)) for name in ("q", "v", "a")
    }
    return replace(middle, **moved)


def find_turns(plan: Plan, signs: Mapping[str, Array]) -> dict[str, Array]:
    """Return the signs of all coordinates that are integrated, by the arrays of a state."""
    whole, part = find_all_turns(plan.mechanism, signs), plan.excited
    if part is None or plan.excited_system is None:
        return whole
    positions, rates = whole["q"][part.positions], whole["v"][part.rates]
    return {"q": positions, "v": rates, "a": rates}


def find_all_turns(mechanism: Mechanism, signs: Mapping[str, Array]) -> dict[str, Array]:
    """Return the signs of all coordinates of a mechanism for those of its bodies' modes, by the arrays of a state."""
    rates = np.ones(mechanism.n)
    for number, link in enumerate(mechanism.links):
        if link.name in signs:
            rates[mechanism.modes_of(number)] = signs[link.name]
    joints = mechanism.position_shift
    modes = [rates[mechanism.modes_of(mechanism.number_of(body.body))] for body in mechanism.contacts]
    noted = mechanism.contacts[0].signs(mechanism.contacts, modes) if modes else np.ones(0)
    return {
        "q": np.r_[np.ones(joints), rates],
        "v": rates,
        "a": rates,
        "contacts": noted,
    }  # modes come last, and joints have no sign


def _turn(state: State, turns: Mapping[str, Array]) -> State:
    """Return a state with the signs of other shapes."""
    arrays = {
        name: getattr(state, name) for name in ("q", "v", "a")
    }  # a method may have several accelerations of a coordinate
    return replace(state, **{name: x * np.resize(turns[name], x.shape) for name, x in arrays.items()})


def _march_part(plan: Plan, times: Array, state: State | None) -> Trajectory:
    system, q0, v0 = plan.marched
    method = plan.integrator
    assert isinstance(method, ResumableIntegrator)
    assert isinstance(system, CompiledSystem)
    return method.march(system, q0, v0, times) if state is None else method.resume(system, state, times)


def _join(plan: Plan, parts: Sequence[Trajectory], whole: Array, times: Array) -> Trajectory:
    """Return the trajectory of all parts at the output times, with all of the run's coordinates."""
    chosen = np.searchsorted(whole, times)
    q, v, contacts = (np.concatenate([getattr(part, name) for part in parts]) for name in ("q", "v", "contacts"))
    contacts = contacts[chosen] if len(contacts) else contacts
    evaluations, seconds = sum(part.evaluations for part in parts), sum(part.seconds for part in parts)
    joined = replace(parts[-1], times=times, q=q[chosen], v=v[chosen], contacts=contacts)
    return plan.spread_out(replace(joined, evaluations=evaluations, seconds=seconds))
