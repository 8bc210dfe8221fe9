"""Warnings about stress: at places, at loads on points, and between output times that are too far apart."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from fmd.accuracy.missed_peaks import UNSOUGHT, MissedPeak, find_missed_peaks, stress_variable
from fmd.core.limits.recovery import APART, MISSED_PEAK
from fmd.recovery.motion_file import Variable
from fmd.recovery.stress import von_mises
from fmd.stages.instants import choose_vibrating, count_vibration_times
from fmd.stages.point_loads import loaded_points

if TYPE_CHECKING:
    from fmd.recovery.motion import Motion
    from fmd.stages.pipeline import Pipeline


def stress_warnings(run: Pipeline, worst: Mapping[str, tuple[float, int, float]]) -> list[dict[str, str]]:
    """Return all warnings about a run's stress, of which each body has a worst time, surface node, and value."""
    nodes = {name: node for name, (_, node, _) in worst.items()}
    of_times = [*output_time_warnings(run, nodes), *vibration_warnings(run)]
    return [*spot_stress_warnings(run), *limitless_warnings(run, worst), *of_times]


def vibration_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Return a warning where fatigue counts vibrations at some of the instants alone that would resolve them."""
    if run.at_vibrations is run.at_instants:
        return []
    counts, shares = count_vibration_times(run)
    chosen = choose_vibrating(counts, shares)
    left = (counts > 0) & ~chosen
    if not left.any():
        return []
    step = _one_digit_below(1e3 * float((np.diff(run.motion.times)[left] / (counts[left] + 1)).min()))
    text = (
        f"fatigue counts vibrations between output times in {chosen.sum()} of {(counts > 0).sum()} intervals alone, "
        f"where they are largest, since all would take {counts.sum()} instants; elsewhere modes vibrate by "
        f"up to {shares[left].max():.2g} of the largest stress; simulation.output_step = '{step} ms' counts them"
    )
    return [{"code": "coarse-output-times", "text": text}]


def output_time_warnings(run: Pipeline, worst: Mapping[str, int]) -> list[dict[str, str]]:
    """Return warnings about output times too far apart for a body's largest stress, at the node of a place."""

    def stress_of(motion: Motion) -> Iterator[Variable]:
        return (stress_variable(run, body, node, motion) for body, node in worst.items())

    peaks = find_missed_peaks(run, stress_of) if worst else {}
    if worst and not peaks:
        return [UNSOUGHT]
    return [
        {
            "code": "coarse-output-times",
            "body": body,
            "text": f"{body}: its largest stress {say_output_step(run, missed)}",
        }
        for body, missed in zip(worst, peaks.values(), strict=True)
        if missed.part > MISSED_PEAK
    ]


def say_missed(missed: float) -> str:
    """Say what of a largest value lies between output times."""
    if math.isinf(missed):
        return "is 0 at all output times, and not between them"
    return f"is {f'{100 * missed:.2g} %' if missed < 1.0 else f'{missed:.3g} times'} larger between output times"


def say_output_step(run: Pipeline, missed: MissedPeak) -> str:
    """Say what of a largest value lies between output times, and which step resolves it."""
    step = _one_digit_below(1e3 * min(missed.step, run.scene.simulation.output_step / 2.0))
    return f"{say_missed(missed.part)}; simulation.output_step = '{step} ms' resolves it to {100 * MISSED_PEAK:g} %"


def _one_digit_below(value: float) -> str:
    """Write the largest number of one digit that isn't above a value."""
    unit = 10.0 ** math.floor(math.log10(value))
    return f"{math.floor(value / unit) * unit:.1g}"


def spot_stress_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Return warnings about named elements whose largest stress differs from that at their points by over a tenth.

    Stress of a named element is that in its middle, which long or thick elements have far from the point.
    """
    found = []
    for body, part in run.wholes.items():
        if not part.elements or body not in run.parts:
            continue
        points = np.array([element.at for element in part.shape.element.values()])
        q = run.motion.modal(body)
        for name, point, middle, of_point, of_middle in zip(
            part.elements, points, part.element_places, part.spot_stress, part.element_stress, strict=True
        ):
            there, here = (float(von_mises((modal @ q.T)[None])[0].max()) for modal in (of_point, of_middle))
            if abs(there - here) > APART * max(there, here):
                text = (
                    f"{body}.{name}: the element's middle, where its stress is taken, is "
                    f"{1e3 * np.linalg.norm(middle - point):.2g} mm from its point; the largest von Mises stress is "
                    f"{1e-6 * here:.3g} MPa there and {1e-6 * there:.3g} MPa at the point; smaller elements lie nearer"
                )
                found.append({"code": "element-off-point", "body": body, "text": text})
    return found


def limitless_warnings(run: Pipeline, worst: Mapping[str, tuple[float, int, float]]) -> list[dict[str, str]]:
    """Return warnings about loads at points and on edges, around which stress has no limit.

    Each body's largest stress elsewhere has time, place and value, as `StressHistory.worst` has it.
    """
    found = []
    for body, (time, _, value) in worst.items():
        stress = run.stress_of(body)
        if stress.limitless is None or not stress.limitless.any():
            continue
        frame = np.array([int(np.abs(stress.times - time).argmin())])
        there = float(stress.measure_at(frame)[0][stress.limitless].max())
        if there > value:
            names = ", ".join(f"{body}.{name}" for name in loaded_points(run.scene, run.parts[body]))
            if not names:  # under a contact's grid, which has a stress of its own
                continue
            text = (
                f"forces enter at points or edges ({names}), where stress has no limit: {1e-6 * there:.3g} MPa on this "
                f"mesh, more on a finer one; the largest stress is that elsewhere; markers on faces have a limit"
            )
            found.append({"code": "point-load", "body": body, "text": text})
    return found
