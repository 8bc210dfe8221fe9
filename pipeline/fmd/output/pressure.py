"""Picture of a contact's pressure when it is largest, or of its slip or wear, on a body that touches."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from fmd.core.arrays import Array, BoolArray, IntArray
from fmd.core.errors import InputError
from fmd.core.limits.contact import ASLANT
from fmd.output.mechanism_view import body_surface
from fmd.output.output_kinds import OutputKind, key_of
from fmd.output.pictures import camera_of
from fmd.recovery.wear import worn_faces
from fmd.render.calls import Drawer, draw_here

if TYPE_CHECKING:
    from fmd.contact.touching_body import TouchingBody
    from fmd.recovery.motion import Motion
    from fmd.render.surface import Surface
    from fmd.scene.stress_outputs import ContactPressure
    from fmd.stages.pipeline import Pipeline


def draw_pressure(run: Pipeline, output: ContactPressure, folder: Path, draw: Drawer = draw_here) -> None:
    """Draw a contact's pressure when it is largest of all steps, or slip or wear at the output time at which it is.

    A near field's grid is smaller than elements: nodes beside it have its pressure, and the label the area it is on.
    """
    motion = run.at_instants.motion if output.quantity == "pressure" else run.motion
    (touching,) = (own for own in motion.mechanism.contacts if output.contact in own.names)
    quantity, unit, scale = output.quantity, *(("MPa", 1e-6) if output.quantity == "pressure" else ("µm", 1e6))
    body, face, own, found = _find_field(run, motion, touching, output)
    (points,) = (each.points for each in motion.mechanism.contacts if each.body == body)
    found = scale * found
    frame = int(found.max(axis=1).argmax())
    if not found[frame].any():
        what = "presses" if quantity == "pressure" else "rubs"
        message = f"{what} nothing at any output time; a longer duration, or a shorter output_step, may show it"
        raise InputError(run.scene.file, key_of(run, output, "contact"), output.contact, message)
    surface, part = body_surface(run, body), run.wholes[body]
    there = motion.touched.places[body] if motion.touched else np.zeros((0, 0, 3))
    x = there[frame, own] if there.shape[1] else points.x[own]
    _, places = cKDTree(run.bodies[body].x[part.surface.nodes]).query(x)
    values, known = np.zeros(len(surface.points)), np.zeros(len(surface.points), dtype=bool)
    np.maximum.at(values, places, found[frame])  # of a near field's grid several are at a node
    known[places] = True
    on_face = np.isin(part.surface.nodes, part.markers[face].nodes)
    values = _fill(values, known, on_face, surface.triangles)
    peak, time = found[frame].max(), motion.times[frame]
    wide = f", on {1e6 * motion.contacts[output.contact].area[frame]:.3g} mm²" if face in points.grids else ""
    draw(
        "pictures.draw_field",
        surface,
        values,
        folder / output.file,
        title=output.title or f"{run.scene.title}: {quantity} of {output.contact} on {body}",
        quantity=f"{quantity} [{unit}]",
        limits=(0.0, float(values.max())),
        weights=values,
        label=f"{peak:.4g} {unit} at {1e3 * time:.4g} ms{wide}",
        camera=camera_of(run, _facing(output, surface, places)),
    )


def _find_field(
    run: Pipeline, motion: Motion, touching: TouchingBody, output: ContactPressure
) -> tuple[str, str, IntArray, Array]:
    """Return body, face and points of what is drawn, and its values at these (n_times, n_points) [Pa or m]."""
    if output.quantity == "wear":
        for worn in worn_faces(motion, output.contact):
            if worn.body in run.parts and output.body in (None, worn.body):
                return worn
    if touching.body not in run.parts:
        message = "is of points of a rigid body, which has no mesh to draw it on; motion.nc has it over time"
        raise InputError(run.scene.file, key_of(run, output, "contact"), output.contact, message)
    fields = motion.contact_pressures if output.quantity == "pressure" else motion.contact_slips
    face = touching.face_of(output.contact)
    own = touching.points.faces[face]
    return touching.body, face, own, fields[touching.body][:, own]


def _facing(output: ContactPressure, surface: Surface, face: IntArray) -> ContactPressure:
    """Return an output whose camera looks aslant onto a face, unless the scene has one."""
    if output.camera is not None:
        return output
    corners = surface.points[surface.triangles[np.isin(surface.triangles, face).any(axis=1)]]
    x, y, z = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    elevation = np.clip(np.arctan2(z, np.hypot(x, y)) + ASLANT, -1.4, 1.4)
    return output.model_copy(update={"camera": (float(np.arctan2(y, x) + ASLANT), float(elevation))})


def _fill(values: Array, known: BoolArray, on_face: BoolArray, triangles: IntArray) -> Array:
    """Give nodes of a face that carry no pressure the mean of those around that do."""
    total, count = np.zeros(len(values)), np.zeros(len(values))
    for k in range(3):
        for other in ((k + 1) % 3, (k + 2) % 3):
            np.add.at(total, triangles[:, k], np.where(known, values, 0.0)[triangles[:, other]])
            np.add.at(count, triangles[:, k], known[triangles[:, other]])
    return np.where(known | ~on_face, values, total / np.maximum(count, 1.0))


def _read(run: Pipeline, output: ContactPressure) -> Iterator[tuple[str, str]]:
    for name, body, _ in run.scene.touching_faces:
        if name == output.contact:
            yield from ((stage, body) for stage in ("mesh", "surface", "body"))


KINDS = {"pressure": OutputKind(draw_pressure, reads=_read)}
