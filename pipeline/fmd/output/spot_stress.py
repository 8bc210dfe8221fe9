"""Warnings about stress at places: elements whose middle is off their point, and loads at points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.limits.recovery import APART
from fmd.recovery.stress import von_mises
from fmd.stages.point_loads import loaded_points

if TYPE_CHECKING:
    from fmd.stages.pipeline import Pipeline


def spot_stress_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Return warnings about named elements whose largest stress differs from that at their points by over a tenth.

    Stress of a named element is that in its middle, which long or thick elements have far from the point.
    """
    found = []
    for body, part in run.wholes.items():
        if not part.elements or body not in run.parts:
            continue
        points = np.array([part.shape.element[name].at for name in part.elements])
        q = run.motion.modal(body)
        for name, point, middle, of_point, of_middle in zip(
            part.elements, points, part.element_places, part.stress_at(points), part.element_stress, strict=True
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

    Parameters
    ----------
    worst : mapping of str to tuple
        Time, place and value of each body's largest stress elsewhere, as `StressHistory.worst` has it.
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
