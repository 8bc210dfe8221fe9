"""Instants between output times at which contacts press more than at these, for stress that output times miss."""

from __future__ import annotations

import math
from copy import copy
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.contact import BETWEEN_OUTPUTS, SHOCK_TIMES
from fmd.core.limits.round_off import SUMMED

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fmd.recovery.motion import Motion
    from fmd.stages.pipeline import Pipeline

SHOCKS = "instants of shocks"


def find_shock_times(motion: Motion) -> Array:
    """Return instants of a motion between its output times, about each shock that these miss, ascending [s].

    There are steps of the march, of many some, wherever a contact's largest force or pressure since the output time
    before is larger than those at both ends by a part of the largest of all, and the very steps of these.
    """
    outputs, step = motion.times, motion.trajectory.step
    missed, found = np.zeros(len(outputs) - 1, dtype=bool), [np.zeros(0)]
    for own in motion.contacts.values():
        sizes = np.column_stack([np.linalg.norm(own.force, axis=1), own.peak_pressure])
        tops = own.tops[:, [0, 2]]
        beyond = tops[1:] - np.maximum(sizes[1:], sizes[:-1]) > BETWEEN_OUTPUTS * tops.max(axis=0)
        found.append(own.tops_at[1:][beyond])
        missed |= beyond.any(axis=1)
    for k in np.flatnonzero(missed):
        found.append(_spread(outputs[k], outputs[k + 1], step, SHOCK_TIMES // int(missed.sum())))
    return np.unique(np.concatenate(found))


def _spread(begin: float, end: float, step: float, most: int) -> Array:
    """Return times between two others, evenly, which are steps' ends of a march in equal ones [s]."""
    if not step:
        return np.linspace(begin, end, most + 2)[1:-1]
    first, last = math.floor(begin / step) + 1, math.ceil(end / step) - 1
    count = max(min(most, last - first + 1), 0)
    return np.asarray(step * np.unique(np.linspace(first, last, count).round()))


def add_shock_times(run: Pipeline, times: Array) -> tuple[Array, IntArray]:
    """Return times of a run with those of shocks (n_times,) [s], and the numbers of its output times among them."""
    shocks = _shock_times(run)
    if len(shocks):
        ends = np.r_[-math.inf, times, math.inf]
        after = np.searchsorted(times, shocks)
        apart = np.minimum(shocks - ends[after], ends[after + 1] - shocks)
        times = np.union1d(times, shocks[apart > SUMMED * times[-1]])
    return times, np.searchsorted(times, run.motion.times)


def _shock_times(run: Pipeline) -> Array:
    """Return the instants of shocks of a run's first motion [s]; none where nothing has stress."""
    if SHOCKS not in run.results:
        stressed = any(part.has_stress for part in run.wholes.values())
        run.results[SHOCKS] = find_shock_times(run.motion) if stressed else np.zeros(0)
    found: Array = run.results[SHOCKS]
    return found


def march_through_shocks(run: Pipeline) -> Pipeline:
    """Return a run with its first motion at the output times and at instants of shocks, marched again in its steps."""
    shocks = _shock_times(run)
    if not len(shocks):
        return run
    times, outputs = run.fine_times
    at = np.searchsorted(times, shocks - SUMMED * times[-1])  # they may be there but for round-off
    return with_motions(run, {next(iter(run.motions)): run.fine_motion.at(np.union1d(outputs, at))})


def with_motions(run: Pipeline, motions: Mapping[str, Motion]) -> Pipeline:
    """Return a run with other motions in the place of its own, all of whose times count."""
    other = copy(run)
    for name in ("stress", "fine_times"):  # of the run's own
        vars(other).pop(name, None)
    other.at_instants, other._envelopes = other, {}
    other.results = run.results | {type(run).motions.name: motions, SHOCKS: np.zeros(0)}
    other.results.pop(type(run).contact_stress.name, None)
    return other
