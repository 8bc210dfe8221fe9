"""Tangents of a run: how its motion changes with numbers that are inputs of its equations, marched beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.fitting import TRIED_TIMES
from fmd.core.limits.round_off import SOLVED
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiled_system.tangents import Direction, TangentSystem
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.protocol import Trajectory
from fmd.stages.plan import Plan


class Tangent(NamedTuple):
    """Derivative of a motion by a number: of all positions (n_times, n_positions) and rates (n_times, n)."""

    q: Array
    v: Array

    def move(self, own: Trajectory, side: float, mechanism: Mechanism) -> Trajectory:
        """Return the motion beside a mechanism's own, by so much of this; quaternions stay unit ones."""
        q = own.q + side * self.q
        for link, first in zip(mechanism.links, mechanism.layout.position, strict=True):
            if link.joint.turns_in_space:
                at = int(first) + link.n_scalars
                q[:, at : at + 4] /= np.linalg.norm(q[:, at : at + 4], axis=1, keepdims=True)
        return replace(own, q=q, v=own.v + side * self.v)


def find_direction(plan: Plan, sides: Sequence[tuple[Plan, float]]) -> Direction | None:
    """Find how a run's equations and start change with a number.

    Parameters
    ----------
    plan : Plan
        The run.
    sides : sequence of tuple
        The same run at other values of the number, four at most, with weights: the weighted sum of what is smooth is
        its derivative.

    Returns
    -------
    Direction or None
        ``None`` where the number changes more than inputs of the equations, such as a body's shapes, or where tangents
        can't be marched by the run's method.
    """
    system, q0, v0 = plan.marched
    if not (plan.integrator.marches_tangents and system.has_tangents):
        return None
    own, marched = system.compiled, [side.marched for side, _ in sides]
    for (other, q, _), (side, _) in zip(marched, sides, strict=True):
        same = other.compiled.digest == own.digest and other.compiled.numbers.shape == own.numbers.shape
        if not (same and q.shape == q0.shape and _leaves_out_the_same(plan, side)):
            return None
    weights = np.array([weight for _, weight in sides])
    numbers = weights @ [other.compiled.numbers - own.numbers for other, _, _ in marched]
    beside = [(other.compiled.signals, weight) for (other, _, _), (_, weight) in zip(marched, sides, strict=True)]
    vary = any(signals != own.signals for signals, _ in beside)
    q, v = weights @ [q - q0 for _, q, _ in marched], weights @ [v - v0 for _, _, v in marched]
    return Direction(numbers, beside if vary else [], q, v)


def changes_in_line(plan: Plan, low: Plan, high: Plan) -> bool:
    """Return whether a run's equations and start lie in the middle between those at two values of a number."""
    (own, q0, v0), *others = (each.marched for each in (plan, low, high))
    times = np.random.default_rng(0).uniform(0.0, plan.mechanism.horizon or 1.0, TRIED_TIMES)

    def values(system: CompiledSystem, q: Array, v: Array) -> list[Array]:
        return [system.compiled.numbers, q, v, *(signal.values(times) for signal in system.compiled.signals)]

    triples = zip(values(own, q0, v0), *(values(*each) for each in others), strict=True)
    return all(np.abs(a + b - 2.0 * x).max(initial=0.0) <= SOLVED * np.abs(x).max(initial=0.0) for x, a, b in triples)


def march_tangents(plan: Plan, directions: Sequence[Direction], times: Array) -> list[Tangent]:
    """March the tangents of a run along some directions, eight at a time.

    Raises
    ------
    StabilityError
        A tangent grows without bounds.
    """
    system, q0, v0 = plan.marched
    found: list[Tangent] = []
    for first in range(0, len(directions), LANES):
        chosen = directions[first : first + LANES]
        both: Any = TangentSystem(system, chosen)
        q1, v1 = both.join(q0, v0)
        march = plan.integrator.march(both, q1, v1, times)
        q, v = both.part(march.q, march.v)
        found += [Tangent(_spread(plan, q[:, :, k], 0), _spread(plan, v[:, :, k], 1)) for k in range(len(chosen))]
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
