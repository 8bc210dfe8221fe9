"""Peaks between output times, found by marching the same steps again with many more times in between."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, BoolArray
from fmd.core.limits.errors import NOTHING
from fmd.core.limits.recovery import LONG_AGAIN, MISSED_PEAK
from fmd.recovery.motion_file import Variable

if TYPE_CHECKING:
    from fmd.recovery.motion import Motion
    from fmd.stages.pipeline import Pipeline


@dataclass
class MissedPeak:
    """Largest size of a quantity at a motion's output times and at many more between them."""

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
    """Return true if a march with contacts would take long again, and no other result wants it.

    Contacts have their own largest values of all steps.
    """
    known = type(run).fine_motion.name in run.results
    return bool(run.scene.contact) and not known and run.motion.trajectory.seconds > LONG_AGAIN


def find_missed_peaks(run: Pipeline, variables_of: Callable[[Motion], Iterable[Variable]]) -> dict[str, MissedPeak]:
    """Return the largest sizes of variables of the first run's motion at output times and between them, by name.

    None are looked for where only a long march with contacts would tell them, see `is_too_long`.
    """
    found: dict[str, MissedPeak] = {}
    forces: list[Array] = []
    if is_too_long(run):
        return found
    at_outputs = np.zeros(len(run.fine_motion.times), dtype=bool)
    at_outputs[run.fine_times[1]] = True
    for first, part in run.fine_motion.parts():
        for variable in variables_of(part):
            peak = found.setdefault(variable.name, MissedPeak(variable.units))
            peak.add(variable.values, part.times, at_outputs[first : first + len(part.times)])
        if "joint_loads" in vars(part):  # something follows from the equations of motion
            loads = [*part.joint_loads.reactions.values()]
            forces.append(np.max(np.abs(np.reshape(loads, (-1, 2, 3))), axis=(0, 2), initial=0.0))
    if forces:
        mechanism, (force, moment) = run.motion.mechanism, np.max(forces, axis=0)
        moment = max(moment, force * mechanism.reach)
        nothing = {"N": force, "N m": moment, "m/s^2": force / mechanism.mass}
        for peak in found.values():
            peak.nothing = NOTHING * float(nothing.get(peak.unit, 0.0))
    return found
