"""State of a march whose step follows the error, and what its methods do in a step.

A method is a `Table` of its numbers and room to work in, for which the functions here are registered.
"""

from __future__ import annotations

from functools import singledispatch
from typing import Any

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.stepping import HARDLY_MOVING
from fmd.dynamics.step_bounds import StepBounds
from fmd.dynamics.system import advance, project
from fmd.integrators.step_control import keep_largest
from fmd.kernels.arrays import clear, copy
from fmd.kernels.kernel import inlined, inner
from fmd.kernels.table import Table


@inner
def set_trial(s: AdaptiveMarch) -> None:
    """Set ``s.trial`` to the largest values with the trial step's end.

    A group that hardly moves counts for a small part of the largest of its kind: else a far link's first nanometres
    would have to be as exact, beside themselves, as the motion of those that drive it.
    """
    copy(s.largest, s.trial)
    keep_largest(s.groups, s.trial, s.new)
    clear(s.most)
    for k in range(s.kinds.size):
        s.most[s.kinds[k]] = max(s.most[s.kinds[k]], s.trial[k])
    for k in range(s.kinds.size):
        s.trial[k] = max(s.trial[k], HARDLY_MOVING * s.most[s.kinds[k]])


@dataclass(frozen=True)
class AdaptiveMarch(Table):
    """State of a march whose step follows the error, the step that is tried, and the output."""

    tolerance: float  # of each step, relative to the largest value of a coordinate's group
    order: int  # of the step's error
    longest: float  # step [s] beyond which none grows, unless nothing moves
    settles: bool  # true if states settle after each step: loops close, or quaternions become unit ones
    q: Array  # positions, rates and accelerations
    v: Array
    a: Array
    clock: Array  # (2,): present time, and the step to try next [s]
    groups: IntArray  # (n_positions + n + 3 n_contacts,): group of each position and rate, -1 of impulses
    # (n_groups,) and (n_kinds,): kind of each group, and room for the largest value of each kind; empty where each kind
    # has one group
    kinds: IntArray
    most: Array
    # (n_groups,): accelerations that balance at the march's start, as `balance_of_groups` has them, or that constraints
    # have held of groups that haven't moved
    balance: Array
    # Largest values of the groups so far, with numbers of the method's own behind, and with the trial step's end.
    largest: Array
    trial: Array
    # (n_positions + n + 3 n_contacts,): positions and rates at a step's begin, at its end, and at an output time
    begin: Array
    new: Array
    out: Array
    times: Array  # output times [s], and positions and rates there
    sample_q: Array
    sample_v: Array
    cursor: IntArray  # (1,): how many output times are passed
    evaluations: Array  # (1,): how often the whole system was solved
    # (1,): 1 where the accelerations ``a`` are not those of the present state: loads jump there, none are known yet, or
    # the state has settled since
    fresh: Array
    # (1,): how many more of the smallest steps may be taken before the next breakpoint although their error is too
    # large: where a load's rate is infinite, it is always the same part of what has moved since rest
    spare: Array
    bounds: StepBounds  # of a step by force laws with short pieces
    # Contacts; without any their arrays are empty. Behind positions and rates ``begin``, ``new`` and ``out`` have the
    # impulses of contacts, three each.
    apart: float  # [s]: contacts are looked at within a step in times that are no farther apart
    contacts: Array  # (n_times, n_values): their values at the output times
    answers: Array  # (n,): largest acceleration of each rate by a unit force of contact
    pressed: Array  # (2,): 1 in a step that begins with surfaces that touch; how often it was cut where these change
    q_within: Array  # (n_positions,) and (n,): a state within a step
    v_within: Array


@singledispatch
def begin_step(m: Any, p: Any, s: AdaptiveMarch, t: float, h: float) -> None:
    """Prepare a step from ``s.begin`` at time t [s], of which h is the first trial."""
    raise NotImplementedError


@singledispatch
def try_step(m: Any, p: Any, s: AdaptiveMarch, t: float, h: float, reached: float) -> float:
    """Take a trial step into ``s.new``; return its error over the largest values, NaN if the step is no good."""
    raise NotImplementedError


@singledispatch
@inlined
def prepare_samples(m: Any, p: Any, s: AdaptiveMarch, t: float, h: float) -> None:
    """Prepare what `sample_step` needs of an accepted step."""


@singledispatch
def sample_step(m: Any, p: Any, s: AdaptiveMarch, ahead: float, h: float) -> None:
    """Evaluate positions and rates a time ``ahead`` [s] after the step's begin, into ``s.out``."""
    raise NotImplementedError


@singledispatch
def end_step(m: Any, p: Any, s: AdaptiveMarch) -> None:
    """Keep accelerations, and numbers of the method's own, of an accepted step."""
    raise NotImplementedError


@inner
def set_state(p: Any, t: float, both: Array, q: Array, v: Array) -> None:
    """Set positions, whose quaternions become unit ones, and rates; loops close."""
    copy(both, q)
    for i in range(v.size):
        v[i] = both[q.size + i]
    advance(p, q, v, 0.0, 0, v.size)
    project(p, t, q, v)
