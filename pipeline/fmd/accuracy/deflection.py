"""Error of results by large deflection: squares of rotation and strain that a frame leaves out, and stretch.

A strip that is free to shorten bends without stretching. One between supports, or a plate that bends to a shape that no
flat sheet can take, stretches already when it deflects by its thickness.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.cache import stage_key
from fmd.core.limits.errors import HARDLY_TURNED, OF_BENDING, OF_FOURTH, OF_SQUARE, PIECES_OF_ERROR, TOO_LARGE
from fmd.core.limits.recovery import OF_LARGEST_STRAIN
from fmd.stages.division import part_of

if TYPE_CHECKING:
    from fmd.accuracy.quantities import Quantities
    from fmd.stages.part import FlexiblePart
    from fmd.stages.pipeline import Pipeline


def deflection_errors(run: Pipeline, quantities: Quantities) -> dict[str, float]:
    """Estimate the relative error of each quantity of a motion by the squares of rotation and strain.

    A body's stress is off by what this body leaves out, all else by what the worst body does. The tip's deflection
    lacks the shortening of its body too where displacements of second order are left out, and so does a marker's place.
    """
    errors = {name: error_in_frame(run, name) for name in run.deformations}
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
    for name, quantity in quantities.items():
        marker, _, kind = name.rpartition(".")
        if kind in ("position", "deflection") and "." in marker and quantity.scale:
            of_bodies[name] = math.hypot(of_bodies[name], shortening_towards(run, marker) / quantity.scale)
    return of_bodies


def tip_shortening(run: Pipeline) -> float:
    """Return how far the tip comes nearer to its joint beyond what its motion has, over the largest deflection."""
    largest = float(run.motion.tip_size.max())
    return shortening_towards(run, run.divided_scene.simulation.tip) / largest if largest else 0.0


def shortening_towards(run: Pipeline, tip: str) -> float:
    """Return how far a marker ``"body.marker"`` comes nearer to its body's joint beyond what its motion has [m].

    Of a part in pieces every piece on the way to the marker adds its own.
    """
    body, _, marker = tip.partition(".")
    link = run.mechanism.links[run.mechanism.find_marker(run.mechanism.number_of(body), marker)]
    names, body = {link.name: k for k, link in enumerate(run.mechanism.links)}, link.name
    total, first = 0.0, run.mechanism.first_piece(names[body])
    while body in run.deformations and not run.bodies[body].markers[marker].displacement2.size:
        total += float(run.deformations[body].shortening.get(marker, np.zeros(1)).max())
        if names[body] == first:
            break
        weld = run.divided_scene.joint[run.divided_scene.carrying[body]].parent
        body, _, marker = weld.partition(".")
    return total


def find_deflection_error(run: Pipeline, body: str) -> float:
    """Return the relative error of results by large deflection of one of a scene's bodies, whole or in pieces."""
    found = [run.deformations[part.name] for part in run.pieces_of(body) if part.name in run.deformations]
    others = max((error_in_frame(run, part.name) for part in run.pieces_of(body) if found), default=0.0)
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
        others = max(error_in_frame(run, part.name) for part in run.pieces_of(body))
        of_tip = error if body == tip else 0.0
        tips = f"the tip's deflection is off by about {100 * of_tip:.2g} %, mostly along the body; " if of_tip else ""
        off = f"{tips}sizes, stress, joints and energies are off by about {100 * others:.2g} %"
        strain, now = max(deformation.strain for deformation in found), len(found)
        if 2 * OF_LARGEST_STRAIN * strain > error:
            text = (
                f"{body} is strained by up to {100 * strain:.3g} %, where deformation is linear: {off}; smaller loads "
                "or a stiffer material lower this, pieces don't"
            )
        else:
            turned = math.degrees(max(deformation.rotation for deformation in found))
            within = "its frame" if now == 1 else f"the frames of its {now} pieces"
            pieces = count_pieces(error, now, 4 if now > 1 and is_of_second_order(run, body) else 2)
            remedy = f"pieces = {pieces} in place of {now}" if now > 1 else f"pieces = {pieces} of [body.{body}]"
            if not run.wholes[body].has_mesh:
                remedy = f"a body with a mesh, cut into {pieces} pieces,"
            text = (
                f"{body} turns by up to {turned:.3g}° within {within}, where deformation is linear: {off}; {remedy} "
                f"lowers this to {100 * TOO_LARGE:g} %"
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


def error_in_frame(run: Pipeline, part: str) -> float:
    """Return the relative error of results by what a body, or a piece of one, leaves out within its frame."""
    deformation = run.deformations[part]
    if not part_of(part):
        return deformation.second_order_error
    theta = deformation.rotation
    second = is_of_second_order(run, part_of(part))
    return (OF_FOURTH * theta**4 if second else OF_SQUARE * theta**2) + OF_LARGEST_STRAIN * deformation.strain


_SOURCES, _PACKAGES = ("fmd/fem", "fmd/reduction", "fmd/accuracy/deflection.py"), ("numpy", "scipy")
TEXT = (
    "a body that can't shorten as it deflects, between supports or as a plate that twists, stretches, and is stiffer "
    "than linear bending has it; smaller deflections are right, and so is a bar whose far end a fixed joint on the "
    "ground holds instead of a support"
)


def stretching_bodies(run: Pipeline) -> list[str]:
    """Return the names of meshed bodies and pieces that may be stretched by their deflection."""
    return [
        name
        for name, deformation in run.deformations.items()
        if run.parts[name].has_mesh and (run.parts[name].shape.support or deformation.rotation > HARDLY_TURNED)
    ]


def stiffening_by_stretch(run: Pipeline, name: str) -> float:
    """Return how much stiffer stretching makes a body at its largest deflection, relative to its linear stiffness."""
    part, q = run.parts[name], run.motion.modal(name)
    worst = q[((q * run.bodies[name].omega) ** 2).sum(axis=1).argmax()]
    if not worst.any():
        return 0.0
    key = stage_key("stretch", [part.key("body"), worst.tolist()], _SOURCES, _PACKAGES)
    ratio = part.store.read_or_keep(key, lambda: _ratio(part, run.bodies[name].shapes @ worst), "float")
    return max(ratio - OF_BENDING * run.deformations[name].rotation ** 2, 0.0)


def _ratio(part: FlexiblePart, u: Array) -> float:
    """Return the stiffening by stretch of a displacement u (n_nodes, 3)."""
    from fmd.fem.geometric_stiffness import membrane_ratio, quadratic_strain_load

    f, energy = quadratic_strain_load(part.fe, u)
    turned = _second_order_of_rigid_faces(part, u)
    relief = (part.fe.K @ turned.ravel()).reshape(u.shape)
    energy += float((turned * (f + 0.5 * relief)).sum())
    f += relief
    v = part.model.solver.static_response(-f[:, :, None])[:, :, 0]
    return membrane_ratio(part.fe, u, v, f, energy)


def _second_order_of_rigid_faces(part: FlexiblePart, u: Array) -> Array:
    """Return the displacement of second order of rigid faces and links that a displacement turns, (n_nodes, 3) [m].

    A face that turns by θ comes nearer to its axis by ``½ θ × (θ × r)``. The linear motion of its nodes can't, and the
    elements behind would count as stretched.
    """
    moved = np.zeros_like(u) if part.fe.arms is None else part.fe.arms.second_order(u)
    for marker in (marker for marker in part.markers.values() if marker.rigid):
        theta, r = marker.rotation(u), part.fe.x[marker.nodes] - marker.position
        moved[marker.nodes] += 0.5 * np.cross(theta, np.cross(theta, r))
    return moved


def excess_deflection(ratio: float) -> float:
    """Return by how much the linear deflection is too large, over the right one.

    With a cubic force of relative size r at the linear deflection, one s times as large has ``s + r s³ = 1``.
    """
    if not ratio:
        return 0.0
    roots = np.roots([ratio, 0.0, 1.0, -1.0])
    return 1 / float(roots.real[np.abs(roots.imag).argmin()]) - 1


def stretching_warnings(run: Pipeline, too_large: float) -> list[dict[str, str]]:
    """Warn of each body whose stretch makes results wrong by more than a part of them."""
    errors = {name: excess_deflection(stiffening_by_stretch(run, name)) for name in stretching_bodies(run)}
    return [
        {
            "code": "large-deflection",
            "body": part_of(name) or name,
            "text": f"{name}: {TEXT}; results are off by about {100 * error:.2g} %",
        }
        for name, error in errors.items()
        if error > too_large
    ]
