"""Error of results by the squares of rotation and strain, which deformation that is small within a frame leaves out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pipeline.accuracy.quantities import Quantities
    from pipeline.stages.pipeline import Pipeline

TOO_LARGE = 0.01  # relative error from which on a run warns of large deflection
# Pieces of a part over the root of the error that they are to divide: a chain of n bodies leaves about 1/n² of it.
_PIECES = 1.25


def deflection_errors(run: Pipeline, quantities: Quantities) -> dict[str, float]:
    """Estimate the relative error of each quantity of a motion by the squares of rotation and strain.

    A body's stress is off by what this body leaves out, all else by what the worst body does. The tip's deflection
    lacks the shortening of its body too where displacements of second order are left out.
    """
    errors = {name: deformation.second_order_error for name, deformation in run.deformations.items()}
    worst = max(errors.values(), default=0.0)
    of_bodies = {
        name: next((errors[body] for body in errors if name.startswith((f"{body},", f"{body}."))), worst)
        for name in quantities
    }
    if "tip, deflection" in of_bodies:
        of_bodies["tip, deflection"] = math.hypot(worst, tip_shortening(run))
    return of_bodies


def tip_shortening(run: Pipeline) -> float:
    """Return how far the tip comes nearer to its joint beyond what its motion has, over the largest deflection."""
    body, _, marker = run.scene.simulation.tip.partition(".")
    if body not in run.deformations or run.bodies[body].markers[marker].bow.size:
        return 0.0
    largest = float(run.motion.tip_size.max())
    shortening = run.deformations[body].shortening.get(marker, np.zeros(1))
    return float(shortening.max()) / largest if largest else 0.0


def deflection_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warn of each body whose deflection makes results wrong by more than `TOO_LARGE`, with the remedy."""
    tip = run.scene.simulation.tip.partition(".")[0]
    warnings = []
    for body, deformation in run.deformations.items():
        others = deformation.second_order_error
        of_tip = math.hypot(others, tip_shortening(run)) if body == tip else 0.0
        error = max(others, of_tip)
        if not error > TOO_LARGE:
            continue
        pieces = max(2, math.ceil(_PIECES * math.sqrt(error / TOO_LARGE)))
        tips = f"the tip's deflection is off by about {100 * of_tip:.2g} %, mostly along the body; " if of_tip else ""
        text = (
            f"{body} turns by up to {math.degrees(deformation.rotation):.3g}° within its frame, where deformation is "
            f"linear: {tips}sizes, stress, joints and energies are off by about {100 * others:.2g} %; a chain of "
            f"{pieces} bodies on fixed joints in place of it lowers this to {100 * TOO_LARGE:g} %"
        )
        warnings.append({"code": "large-deflection", "body": body, "text": text})
    return warnings
