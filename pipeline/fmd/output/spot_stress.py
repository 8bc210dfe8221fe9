"""Warnings about named elements in whose middle stress isn't what it is at the point that they are named by."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.limits.recovery import APART
from fmd.recovery.stress import von_mises

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
