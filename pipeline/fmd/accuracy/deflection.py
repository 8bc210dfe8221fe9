"""Error of results by the squares of rotation and strain, which deformation that is small within a frame leaves out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.limits.errors import OF_FOURTH, OF_SQUARE, PIECES_OF_ERROR, TOO_LARGE
from fmd.core.limits.recovery import OF_LARGEST_STRAIN
from fmd.stages.division import part_of

if TYPE_CHECKING:
    from fmd.accuracy.quantities import Quantities
    from fmd.stages.pipeline import Pipeline


def deflection_errors(run: Pipeline, quantities: Quantities) -> dict[str, float]:
    """Estimate the relative error of each quantity of a motion by the squares of rotation and strain.

    A body's stress is off by what this body leaves out, all else by what the worst body does. The tip's deflection
    lacks the shortening of its body too where displacements of second order are left out.
    """
    errors = {name: _error_in_frame(run, name) for name in run.deformations}
    worst = max(errors.values(), default=0.0)
    of_parts = {
        name: max((errors[part.name] for part in run.pieces_of(name) if part.name in errors), default=worst)
        for name in run.wholes
    }
    of_bodies = {
        name: next((of_parts[body] for body in of_parts if name.startswith((f"{body},", f"{body}."))), worst)
        for name in quantities
    }
    if "tip, deflection" in of_bodies:
        of_bodies["tip, deflection"] = math.hypot(worst, tip_shortening(run))
    return of_bodies


def tip_shortening(run: Pipeline) -> float:
    """Return how far the tip comes nearer to its joint beyond what its motion has, over the largest deflection.

    Of a part in pieces every piece on the way to the tip adds its own.
    """
    largest = float(run.motion.tip_size.max())
    names = {link.name: k for k, link in enumerate(run.mechanism.links)}
    body, _, marker = run.divided_scene.simulation.tip.partition(".")
    total, first = 0.0, run.mechanism.first_piece(names[body])
    while body in run.deformations and not run.bodies[body].markers[marker].displacement2.size:
        total += float(run.deformations[body].shortening.get(marker, np.zeros(1)).max())
        if names[body] == first:
            break
        weld = run.divided_scene.joint[run.divided_scene.carrying[body]].parent
        body, _, marker = weld.partition(".")
    return total / largest if largest else 0.0


def find_deflection_error(run: Pipeline, body: str) -> float:
    """Return the relative error of results by large deflection of one of a scene's bodies, whole or in pieces."""
    found = [run.deformations[part.name] for part in run.pieces_of(body) if part.name in run.deformations]
    others = max((_error_in_frame(run, part.name) for part in run.pieces_of(body) if found), default=0.0)
    on_tip = body == run.scene.simulation.tip.partition(".")[0]
    return math.hypot(others, tip_shortening(run)) if on_tip and found else others


def deflection_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warn of each body whose deflection makes results wrong by more than `TOO_LARGE`, with the remedy."""
    tip = run.scene.simulation.tip.partition(".")[0]
    warnings = []
    for body in run.wholes:
        error = find_deflection_error(run, body)
        if not error > TOO_LARGE:
            continue
        found = [run.deformations[part.name] for part in run.pieces_of(body)]
        others = max(_error_in_frame(run, part.name) for part in run.pieces_of(body))
        of_tip = error if body == tip else 0.0
        turned, now = math.degrees(max(deformation.rotation for deformation in found)), len(found)
        tips = f"the tip's deflection is off by about {100 * of_tip:.2g} %, mostly along the body; " if of_tip else ""
        within = "its frame" if now == 1 else f"the frames of its {now} pieces"
        pieces = count_pieces(error, now, 4 if now > 1 and is_of_second_order(run, body) else 2)
        remedy = f"pieces = {pieces} in place of {now}" if now > 1 else f"pieces = {pieces} of [body.{body}]"
        if not run.wholes[body].has_mesh:
            remedy = f"a body with a mesh, cut into {pieces} pieces,"
        text = (
            f"{body} turns by up to {turned:.3g}° within {within}, where deformation is linear: {tips}sizes, stress, "
            f"joints and energies are off by about {100 * others:.2g} %; {remedy} lowers this to {100 * TOO_LARGE:g} %"
        )
        warnings.append({"code": "large-deflection", "body": body, "text": text})
    return warnings


def count_pieces(error: float, now: int, order: int) -> int:
    """Return the number of pieces that would lower an error to `TOO_LARGE`, where it falls as ``1/n`` to an order."""
    return max(
        now + 1, math.ceil(now * (PIECES_OF_ERROR if now == 1 else 1.0) * math.pow(error / TOO_LARGE, 1.0 / order))
    )


def is_of_second_order(run: Pipeline, body: str) -> bool:
    """Return true if displacements of second order are those of a body, or of all pieces that carry another one."""
    bodies = [run.bodies[part.name] for part in run.pieces_of(body)]
    return all(
        any(marker.displacement2.size for marker in reduced.markers.values()) for reduced in bodies[:-1] or bodies
    )


def _error_in_frame(run: Pipeline, part: str) -> float:
    """Return the relative error of results by what a body, or a piece of one, leaves out within its frame."""
    deformation = run.deformations[part]
    if not part_of(part):
        return deformation.second_order_error
    theta = deformation.rotation
    second = is_of_second_order(run, part_of(part))
    return (OF_FOURTH * theta**4 if second else OF_SQUARE * theta**2) + OF_LARGEST_STRAIN * deformation.strain
