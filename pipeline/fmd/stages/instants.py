"""Instants between output times for stress that these miss: of contacts' shocks, and vibrations that fatigue counts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, BoolArray, IntArray
from fmd.core.limits.contact import BETWEEN_OUTPUTS, SHOCK_TIMES
from fmd.core.limits.recovery import INTERVALS_BESIDE, MISSED_PEAK, TIMES_A_PERIOD, VIBRATION_TIMES
from fmd.core.limits.round_off import SUMMED
from fmd.recovery.stress import von_mises
from fmd.scene.stress_outputs import Fatigue
from fmd.stages.other_motions import with_motions
from fmd.stages.plan import find_fine_times

if TYPE_CHECKING:
    from fmd.recovery.motion import Motion
    from fmd.stages.pipeline import Pipeline

SHOCKS, VIBRATIONS = "instants of shocks", "instants of vibrations"


def find_shock_times(motion: Motion) -> Array:
    """Return instants of a motion between its output times, about each shock that these miss, ascending [s].

    There are steps of the march, of many some, wherever a contact's largest force or pressure since the output time
    before is larger than those at both ends by a part of the largest of all, and the very steps of these. Of more than
    500 such intervals these are those in which it is larger by most.
    """
    outputs, step = motion.times, motion.trajectory.step
    over, tops_at, found = np.zeros(len(outputs) - 1), [np.zeros((len(outputs) - 1, 0))], [np.zeros(0)]
    for own in motion.contacts.values():
        sizes = np.column_stack([np.linalg.norm(own.force, axis=1), own.peak_pressure])
        tops = own.tops[:, [0, 2]]
        largest = np.where(tops.any(axis=0), tops.max(axis=0), 1.0)
        beyond = (tops[1:] - np.maximum(sizes[1:], sizes[:-1])) / largest
        tops_at.append(np.where(beyond > BETWEEN_OUTPUTS, own.tops_at[1:], np.nan))
        over = np.maximum(over, beyond.max(axis=1))
    missed = np.argsort(-over, kind="stable")[: min(SHOCK_TIMES // 2, int((over > BETWEEN_OUTPUTS).sum()))]
    found += [at[~np.isnan(at)] for at in np.hstack(tops_at)[missed]]
    for k in missed:
        found.append(_spread(outputs[k], outputs[k + 1], step, SHOCK_TIMES // len(missed)))
    return np.unique(np.concatenate(found))


def _spread(begin: float, end: float, step: float, most: int) -> Array:
    """Return at most so many times between two others, evenly, steps' ends of a march in equal ones [s]."""
    if not step:
        return np.linspace(begin, end, most + 2)[1:-1]
    first, last = math.floor(begin / step) + 1, math.ceil(end / step) - 1
    count = max(min(most, last - first + 1), 0)
    return np.asarray(step * np.unique(np.linspace(first, last, count).round()))


def count_vibration_times(run: Pipeline) -> tuple[IntArray, Array]:
    """Return how many times in each interval of outputs resolve the stress that fatigue counts, and how much that is.

    There are 24 to a period of each mode whose vibration, of amplitude |dq/dt|/ω, has more than 2 % of the largest
    stress of any mode, and as many as stress that changes otherwise needs. The second are the largest shares of that
    stress by which a mode's changes in 1/ω, (n_intervals,) both.
    """
    motion = run.motion
    h = np.diff(motion.times)
    counts, shares = np.zeros((2, len(h)))
    for body in {output.body for output in run.scene.output if isinstance(output, Fatigue)}:
        parts = [part for part in run.pieces_of(body) if len(run.bodies[part.name].omega)]
        sizes = [von_mises(part.surface_stress).max(axis=0) for part in parts]  # of modes, the largest anywhere
        stress = [size * motion.modal(part.name) for size, part in zip(sizes, parts, strict=True)]
        largest = max((float(np.abs(own).max()) for own in stress), default=0.0)
        for size, own, part in zip(sizes, stress, parts, strict=True) if largest else ():
            number = motion.mechanism.number_of(part.name)
            rates = size * np.abs(motion.kinematics.modal_rates(number)) / largest  # [1/s]
            rates = np.maximum(np.maximum(rates[1:], rates[:-1]), np.abs(np.diff(own, axis=0)) / (largest * h[:, None]))
            wide = np.pad(rates, ((INTERVALS_BESIDE, INTERVALS_BESIDE), (0, 0)))
            rates = np.max([wide[k : k + len(h)] for k in range(2 * INTERVALS_BESIDE + 1)], axis=0)
            omega = motion.mechanism.links[number].omega
            frequencies = np.maximum(rates, np.where(rates > MISSED_PEAK * omega, omega, 0.0)).max(axis=1)
            counts = np.maximum(counts, h * frequencies * TIMES_A_PERIOD / (2.0 * math.pi))
            shares = np.maximum(shares, (rates / omega).max(axis=1))
    most = np.ceil(h / motion.trajectory.step) if motion.trajectory.step else math.inf
    return np.maximum(np.minimum(np.ceil(counts), most) - 1.0, 0.0).astype(np.int64), shares


def choose_vibrating(counts: IntArray, shares: Array) -> BoolArray:
    """Return which intervals have times of vibrations: of too many those in which stress changes most."""
    chosen, order = np.zeros(len(counts), dtype=bool), np.argsort(-shares, kind="stable")
    chosen[order] = np.cumsum(counts[order]) <= VIBRATION_TIMES
    return chosen & (counts > 0)


def _vibration_times(run: Pipeline) -> Array:
    """Return times between a run's output times that resolve the stress that its outputs count cycles of [s]."""
    if VIBRATIONS not in run.results:
        outputs, step = run.motion.times, run.motion.trajectory.step
        counts, shares = count_vibration_times(run)
        chosen = choose_vibrating(counts, shares)
        found = [_spread(outputs[k], outputs[k + 1], step, int(counts[k])) for k in np.flatnonzero(chosen)]
        run.results[VIBRATIONS] = np.concatenate([np.zeros(0), *found])
    times: Array = run.results[VIBRATIONS]
    return times


def find_all_times(run: Pipeline) -> tuple[Array, IntArray]:
    """Return a run's `find_fine_times`, and those of its shocks and vibrations, and which of all are output times."""
    times, _ = find_fine_times(next(iter(run.plans.values())), run.motion)
    more = np.sort(np.concatenate([_shock_times(run), _vibration_times(run)]))
    if len(more):
        apart = np.diff(more, prepend=-math.inf) > SUMMED * times[-1]
        ends, more = np.r_[-math.inf, times, math.inf], more[apart]
        after = np.searchsorted(times, more)
        apart = np.minimum(more - ends[after], ends[after + 1] - more) > SUMMED * times[-1]
        times = np.union1d(times, more[apart])
    return times, np.searchsorted(times, run.motion.times)


def _shock_times(run: Pipeline) -> Array:
    """Return the instants of shocks of a run's first motion [s]; none where nothing has stress."""
    if SHOCKS not in run.results:
        stressed = run.scene.contact and any(part.has_stress for part in run.wholes.values())
        run.results[SHOCKS] = find_shock_times(run.motion) if stressed else np.zeros(0)
    found: Array = run.results[SHOCKS]
    return found


def march_through_shocks(run: Pipeline) -> Pipeline:
    """Return a run with its first motion at the output times and at instants of shocks, marched again in its steps."""
    return _march_through(run, _shock_times(run))


def march_through_vibrations(run: Pipeline) -> Pipeline:
    """Return a run like `march_through_shocks`, at instants that resolve the stress that fatigue counts, too."""
    return (
        _march_through(run, np.union1d(_shock_times(run), more))
        if len(more := _vibration_times(run))
        else run.at_instants
    )


def _march_through(run: Pipeline, more: Array) -> Pipeline:
    if not len(more):
        return run
    times, outputs = run.fine_times
    at = np.searchsorted(times, more - SUMMED * times[-1])  # they may be there but for round-off
    return with_motions(run, {next(iter(run.motions)): run.fine_motion.at(np.union1d(outputs, at))})
