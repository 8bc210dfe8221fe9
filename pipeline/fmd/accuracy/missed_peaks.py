"""Peaks between output times, found by marching the same steps again with many more times in between."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from fmd.accuracy.details import detail_variables, is_place, round_off_sizes
from fmd.accuracy.error_estimates import OrientationQuantity, angles_between
from fmd.accuracy.quantities import element_stresses, modal_coordinates, motion_quantities, name_of_whole
from fmd.accuracy.requested_stress import EXTREMES, RequestedStress
from fmd.core.arrays import Array, BoolArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.recovery import MISSED_PEAK
from fmd.recovery.motion_file import OF_FORMULA, Variable
from fmd.recovery.stress import von_mises
from fmd.stages.other_motions import with_motions
from fmd.stages.plan import is_long_again

if TYPE_CHECKING:
    from fmd.recovery.motion import Motion
    from fmd.stages.pipeline import Pipeline

UNSOUGHT = {
    "code": "coarse-output-times",
    "text": "peaks between output times, but for contacts' largest forces and what fatigue counts, weren't looked for, "
    "for which the motion is marched again; a shorter simulation.output_step shows more of them",
}
"""Warning where a march with contacts would take long again."""

_FROM_START = ", from its start"


@dataclass
class MissedPeak:
    """Largest size of a quantity at a motion's output times, of a body's stress with shocks', and at many more."""

    unit: str
    at_outputs: float = 0.0  # largest at the output times
    size: float = 0.0  # largest of all
    at_half: float = 0.0  # largest at every second one of all times
    step: float = math.inf  # time between outputs that resolves the largest size [s]
    nothing: float = 0.0  # what solving leaves of nothing

    @property
    def part(self) -> float:
        """Part of the largest size at output times by which it is larger between them.

        What half of the times in between miss is added once more: the others miss about a third of that.
        """
        if self.size <= self.nothing:
            return 0.0
        missed = self.size - self.at_outputs + (self.size - self.at_half if self.size > self.at_outputs else 0.0)
        return missed / self.at_outputs if self.at_outputs else math.inf * missed if missed else 0.0

    def add(self, values: Array, times: Array, at_outputs: BoolArray) -> None:
        """Count the values (n_times, …) at some more times [s]."""
        sizes = np.linalg.norm(values.reshape(len(times), -1), axis=1)
        self.at_outputs = max(self.at_outputs, float(sizes[at_outputs].max(initial=0.0)))
        self.at_half = max(self.at_half, float(sizes[::2].max()))
        k = int(sizes.argmax())
        if not sizes[k] > self.size:
            return
        self.size, self.step = float(sizes[k]), math.inf
        if 0 < k < len(times) - 1:  # through a peak and its neighbours goes a parabola
            before, after = times[k] - times[k - 1], times[k + 1] - times[k]
            bent = ((sizes[k] - sizes[k - 1]) / before + (sizes[k] - sizes[k + 1]) / after) * 2.0 / (before + after)
            self.step = math.sqrt(8.0 * MISSED_PEAK * self.size / bent) if bent > 0.0 else math.inf


def is_too_long(run: Pipeline) -> bool:
    """Return true if a march with contacts would take long again, and no other result has wanted it.

    Contacts have their own largest values of all steps.
    """
    known = type(run).fine_motion.name in run.results and run.motion.tip_size.any()
    return is_long_again(run.motion) and not known


def find_missed_peaks(run: Pipeline, variables_of: Callable[[Motion], Iterable[Variable]]) -> dict[str, MissedPeak]:
    """Return the largest sizes of variables of the first run's motion at output times and between them, by name.

    Those that were found of a run before serve again. None are looked for where only a long march with contacts would
    tell them, see `is_too_long`.
    """
    if is_too_long(run):
        return {}
    known: dict[str, MissedPeak] = run.results.setdefault("missed peaks", {})
    wanted = {variable.name: variable.units for variable in variables_of(run.motion)} if known else {}
    if wanted and all(name in known and known[name].unit == unit for name, unit in wanted.items()):
        return {name: known[name] for name in wanted}
    found = _find(run, variables_of)
    known |= found
    return found


def _find(run: Pipeline, variables_of: Callable[[Motion], Iterable[Variable]]) -> dict[str, MissedPeak]:
    found: dict[str, MissedPeak] = {}
    largest, fine = dict.fromkeys(("N", "N m", "m/s^2"), 0.0), run.fine_motion
    at_outputs, at_instants = np.zeros((2, len(fine.times)), dtype=bool)
    at_outputs[run.fine_times[1]] = True
    at_instants[np.searchsorted(fine.times, run.at_instants.motion.times)] = True
    for first, part in fine.parts() if not at_outputs.all() else [(0, fine.part(0, 1))]:  # nothing is between
        for variable in variables_of(part):
            peak = found.setdefault(variable.name, MissedPeak(variable.units))
            known = at_instants if variable.name.endswith(EXTREMES["von Mises"]) else at_outputs
            peak.add(variable.values, part.times, known[first : first + len(part.times)])
        if "joint_loads" in vars(part):  # something follows from the equations of motion
            for unit, size in _sizes_of_loads(part):
                largest[unit] = max(largest[unit], size)
    for peak in found.values():
        if peak.unit != OF_FORMULA:
            largest[peak.unit] = max(largest.get(peak.unit, 0.0), peak.size)
    least = round_off_sizes(largest, run.motion.mechanism)
    for peak in found.values():
        peak.nothing = least.get(peak.unit, 0.0)
    return found


def largest_between(run: Pipeline) -> dict[str, float]:
    """Return the largest sizes of rows of the budget at all output times and between them, by name.

    The largest stress of a body is that where it is largest at the output times.
    """
    stressed = {name: run.stress_of(name) for name, part in run.wholes.items() if part.has_stress}
    worst = {name: stress.worst()[1] for name, stress in stressed.items()}
    starts: dict[str, Array] = {}  # of places and orientations, whose sizes are how far they are from there
    requested = RequestedStress(run)

    def turned(name: str, orientation: Array) -> Variable:
        start = starts.setdefault(name, orientation[0])
        return Variable(name + _FROM_START, angles_between(start[None], orientation), (), "rad", "")

    def variables_of(motion: Motion) -> Iterator[Variable]:
        for variable in detail_variables(run.scene, motion):
            if is_place(variable):
                start = starts.setdefault(variable.name, variable.values[0])
                yield variable._replace(name=variable.name + _FROM_START, values=variable.values - start)
            elif variable.dims == ("quaternion",):
                yield turned(variable.name, variable.values)
            else:
                yield variable
        for name, row in motion_quantities(motion, motion).items():
            if isinstance(row, OrientationQuantity):
                yield turned(name, row.values)
            else:
                yield Variable(name, row.values, (), row.unit, "")
        q = modal_coordinates(run, motion)
        for row in (*element_stresses(run, q), *requested.of_places(run, q)):
            yield Variable(name_of_whole(row.name), row.values, (), row.unit, "")
        yield from (stress_variable(run, body, node, motion) for body, node in worst.items())

    peaks = {name.removesuffix(_FROM_START): peak for name, peak in find_missed_peaks(run, variables_of).items()}
    return {name: peak.at_outputs * (1.0 + peak.part) for name, peak in peaks.items() if peak.part < math.inf}


def stress_variable(run: Pipeline, body: str, node: int, motion: Motion) -> Variable:
    """Return a body's von Mises stress at a surface node over time, under the name of its largest one's row."""
    if motion is not run.motion and motion.mechanism.contacts:  # what these deform beside modes counts, too
        run = with_motions(run, {next(iter(run.motions)): motion})
    stress = run.stress_of(body, motion)
    values = von_mises((stress.modal[node] @ stress.q.T)[None])[0]
    return Variable(f"{body}, {EXTREMES['von Mises']}", values, (), "Pa", "")


def _sizes_of_loads(motion: Motion) -> Iterator[tuple[str, float]]:
    loads = np.reshape([*motion.joint_loads.reactions.values()], (-1, 2, 3))
    yield from zip(("N", "N m"), np.abs(loads).max(axis=(0, 2), initial=0.0).tolist(), strict=True)
    for number, link in enumerate(motion.mechanism.links):
        if link.markers:
            far = max(link.markers, key=lambda name: float(np.linalg.norm(link.markers[name].position)))
            values = motion.kinematics.marker_acceleration(number, far, motion.joint_loads.accelerations)
            yield "m/s^2", float(np.linalg.norm(values, axis=1).max())
