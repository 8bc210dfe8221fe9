"""Tangents of a run: how its motion changes with numbers that are inputs of its equations, marched beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.contact import MOST_POINTS
from fmd.core.limits.fitting import TRIED_MOVES, TRIED_TIMES
from fmd.core.limits.round_off import SOLVED
from fmd.dynamics.compiled_system.closed_tangents import require_one_linearisation
from fmd.dynamics.compiled_system.shared import lift_system
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiled_system.tangents import Direction, TangentSystem, Variant, system_along
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.mechanism import Mechanism
from fmd.fitting.neighbours import find_turns
from fmd.integrators.protocol import Progress, Trajectory
from fmd.stages.plan import Plan

CONTACT = "contact"  # what of a run has no tangents begins with this where bodies touch


class Tangent(NamedTuple):
    """Derivative of a motion by a number: of all positions (n_times, n_positions) and rates (n_times, n)."""

    q: Array
    v: Array
    contacts: Array  # (n_times, n_values): of forces of contacts and what they push by; 0 of what adds up over steps

    def move(self, own: Trajectory, side: float, mechanism: Mechanism, turns: Mapping[str, Array]) -> Trajectory:
        """Return the motion beside a mechanism's own, by so much of this and with other signs of modal coordinates.

        Quaternions stay unit ones.
        """
        q = own.q + side * self.q
        for link, first in zip(mechanism.links, mechanism.layout.position, strict=True):
            if link.joint.turns_in_space:
                at = int(first) + link.n_scalars
                q[:, at : at + 4] /= np.linalg.norm(q[:, at : at + 4], axis=1, keepdims=True)
        contacts = (own.contacts + side * self.contacts) * turns["contacts"]
        return replace(own, q=q * turns["q"], v=(own.v + side * self.v) * turns["v"], contacts=contacts)


@dataclass(frozen=True)
class Side:
    """A run at another value of a number."""

    plan: Plan
    weight: float  # in the weighted sum of what is smooth that is its derivative
    # By what to multiply modal coordinates there for those of the run itself, by bodies; ``None`` if shapes differ by
    # more than their sign.
    signs: Mapping[str, Array] | None


def find_direction(plan: Plan, sides: Sequence[Side]) -> Direction | None:
    """Find how a run's equations and start change with a number, by the run at other values of it, four at most.

    There is none where the number turns a body's shapes into others, or where the run's method marches no tangents.
    """
    system, q0, v0 = plan.marched
    own, marched = system.compiled, [side.plan.marched for side in sides]
    if not (system.has_tangents and plan.integrator.carries_tangent(system, [other for other, _, _ in marched])):
        return None
    if not all(_has_like_coordinates(plan, side.plan) for side in sides):
        return None
    weights = np.array([side.weight for side in sides])
    turns = [find_turns(side.plan, side.signs or {}) for side in sides]
    q = weights @ [turn["q"] * (there - turn["q"] * q0) for (_, there, _), turn in zip(marched, turns, strict=True)]
    v = weights @ [turn["v"] * (there - turn["v"] * v0) for (_, _, there), turn in zip(marched, turns, strict=True)]
    sides_of = zip((system for system, _, _ in marched), turns, strict=True)
    touching = [other.contact_numbers(turn["v"]) for other, turn in sides_of]
    if any([x.shape for x in each] != [x.shape for x in touching[0]] for each in touching):
        return None
    contact = tuple(np.tensordot(weights, np.array(each), 1) for each in zip(*touching, strict=True))
    others, lifted = [other.compiled for other, _, _ in marched], False
    if any(other.digest != own.digest for other in others):
        if any(side.signs is None for side in sides):
            return None
        all_lifted = [lift_system(each).compiled for each in (system, *(other for other, _, _ in marched))]
        lifted = len({each.numbers.size for each in all_lifted}) == 1  # what is 0 at one value isn't among its numbers
        own, *others = all_lifted if lifted else (own, *others)
        if any(other.digest != own.digest for other in others):
            triples = zip(others, weights, turns, strict=True)
            variants = [Variant(other, weight, turn["q"], turn["v"]) for other, weight, turn in triples]
            return Direction(np.zeros(own.numbers.shape), [], q, v, variants, contact, lifted)
    numbers = weights @ [other.numbers - own.numbers for other in others]
    beside = [(other.signals, weight) for other, weight in zip(others, weights, strict=True)]
    vary = any(signals != own.signals for signals, _ in beside)
    return Direction(numbers, beside if vary else [], q, v, contact=contact, lifted=lifted)


def say_what_lacks_tangents(plan: Plan) -> str:
    """Return what of a run has no tangents by any number, or by this one."""
    system = plan.marched[0]
    if system.is_sampled:
        return "sampled controllers"
    if not system.has_tangents:
        return f"{CONTACT} that loses energy, or of more than {MOST_POINTS} points of a body"
    if not plan.integrator.carries_tangent(system, [system]):
        if system.n_contact_values:
            return f"{CONTACT} by {plan.integrator.name}"
        return str(plan.integrator.name)
    return "shapes of bodies, or oscillators, that change with it"


def _has_like_coordinates(plan: Plan, other: Plan) -> bool:
    """Return whether two runs have as many positions, constraints and inputs of their equations."""
    (own, q, _), (theirs, there, _) = plan.marched, other.marched
    mine, its = own.compiled, theirs.compiled
    sizes = [(len(each.rows), each.numbers.size, len(each.signals)) for each in (mine, its)]
    return q.shape == there.shape and sizes[0] == sizes[1] and _leaves_out_the_same(plan, other)


def changes_in_line(plan: Plan, direction: Direction, low: Plan, high: Plan) -> bool:
    """Return whether a run's equations and start lie in the middle between those at two values of a number."""
    (own, q0, v0), *others = (
        (system_along(system, [direction]), q, v) for system, q, v in (each.marched for each in (plan, low, high))
    )
    rng = np.random.default_rng(0)
    times = rng.uniform(0.0, plan.mechanism.horizon or 1.0, TRIED_TIMES)
    states = q0 + TRIED_MOVES * rng.normal(size=(TRIED_TIMES, len(q0)))
    rest = rng.normal(size=(TRIED_TIMES, 2 * len(v0) + max(len(own.compiled.rows), 1)))
    turned = [(each.signs_q, each.signs_v) for each in direction.variants]
    turns = [(np.ones(len(q0)), np.ones(len(v0))), *(turned or 2 * [(np.ones(len(q0)), np.ones(len(v0)))])]

    def residuals(system: CompiledSystem, signs_q: Array, signs_v: Array) -> Array:
        found, n = np.zeros((TRIED_TIMES, len(v0))), len(v0)
        for r, t, q, more in zip(found, times, states, rest, strict=True):
            state = (np.array(signs_q * q), np.array(signs_v * more[:n]))
            known = [np.array(more[2 * n :]), np.array(signs_v * more[n : 2 * n])]
            if plan.mechanism.contacts:
                known[1:1] = np.ones(6 * len(plan.mechanism.links)), np.array(signs_v * more[n : 2 * n])
            program = "pushed_residual" if plan.mechanism.contacts else "pulled_residual"
            system.compiled.call(program, system.compiled.signal_values(t), *state, *known, r)
        return np.asarray(signs_v * found)

    def values(number: int, system: CompiledSystem, q: Array, v: Array) -> list[Array]:
        signs_q, signs_v = turns[number]
        touching = system.contact_numbers(signs_v)
        if direction.variants:
            return [signs_q * q, signs_v * v, *residuals(system, signs_q, signs_v).T, *touching]
        return [*touching, system.compiled.numbers, q, v, *(signal.values(times) for signal in system.compiled.signals)]

    triples = zip(values(0, own, q0, v0), *(values(k, *each) for k, each in enumerate(others, start=1)), strict=True)
    return all(np.abs(a + b - 2.0 * x).max(initial=0.0) <= SOLVED * np.abs(x).max(initial=0.0) for x, a, b in triples)


def march_tangents(
    plan: Plan, directions: Sequence[Direction], times: Array, advance: Progress | None = None
) -> list[Tangent]:
    """March the tangents of a run along some directions, eight at a time, each time from no progress to all.

    Raises
    ------
    StabilityError
        A tangent grows without bounds.
    LinearisedAnewError
        Steps are too long for tangents of loops.
    """
    system, q0, v0 = plan.marched
    found: list[Tangent] = []
    for first in range(0, len(directions), LANES):
        chosen = directions[first : first + LANES]
        both: Any = TangentSystem(system, chosen)
        q1, v1 = both.join(q0, v0)
        march = plan.integrator.march(both, q1, v1, times, advance)
        require_one_linearisation(both.parameters, plan.integrator.refinement)
        q, v = both.part(march.q, march.v)
        rows = both.part_rows(march.contacts)
        for k in range(len(chosen)):
            found.append(Tangent(_spread(plan, q[:, :, k], 0), _spread(plan, v[:, :, k], 1), rows[:, k]))
    return found


def _spread(plan: Plan, tangent: Array, kind: int) -> Array:
    """Return the tangent of all positions, or rates: those of modes that stay at rest are 0."""
    part = plan.excited
    if part is None or plan.excited_system is None:
        return np.ascontiguousarray(tangent)
    whole = np.zeros((len(tangent), plan.start[kind].size))
    whole[:, (part.positions, part.rates)[kind]] = tangent
    return whole


def _leaves_out_the_same(plan: Plan, other: Plan) -> bool:
    """Return whether two runs leave out the same modes, and start the others from where they are."""
    mine, theirs = plan.excited, other.excited
    if mine is None or theirs is None:
        return mine is theirs
    return np.array_equal(mine.positions, theirs.positions) and np.array_equal(mine.rates, theirs.rates)
