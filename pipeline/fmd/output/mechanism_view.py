"""A run's mechanism as pictures and films show it: all bodies, joints, springs and the ground."""

from __future__ import annotations

from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.core.limits.shown import FLAT_MOTION, HARDLY_TURNS, WEIGHTLESS
from fmd.fem.sections import NUMBERS_ALONE
from fmd.output.joint_marks import Marks
from fmd.output.rigid_shapes import shape_surfaces
from fmd.recovery.stress import stress_measure

if TYPE_CHECKING:
    from fmd.render.moving_bodies import MovingBody, MovingLine, MovingMechanism, MovingShape
    from fmd.render.surface import Surface
    from fmd.stages.pipeline import Pipeline

# Pale, so that none is taken for a stress.
BODY_COLOURS = ("#b3bdc9", "#cbbf9f", "#abc0b0", "#c6adb1", "#aeb2cb", "#c9c6a4", "#a9c1c6", "#c2b3a5")


def view_mechanism(
    run: Pipeline,
    chosen: IntArray,
    *,
    coloured: str | None = None,
    component: str = "von Mises",
    scale: float = 1.0,
    alone: bool = False,
    stressed: bool = True,
    loads: bool = False,
) -> MovingMechanism:
    """Gather a mechanism at some output times of a run's motion, by their numbers (n_frames,).

    All flexible bodies are coloured by a component of their stress, as `stress_measure` takes it, or one alone, without
    everything else if it is ``alone``; stress takes the run's motion, unless it isn't wanted. Deformations have a
    scale. Loads are arrows where forces and torques act, and one along gravity.
    """
    from fmd.render.moving_bodies import MovingMechanism

    meshed = [name for name, part in run.wholes.items() if part.is_drawn and (not alone or name == coloured)]
    bodies = tuple(
        _flexible(run, name, chosen, scale, component if stressed and coloured in (None, name) else None)
        for name in meshed
    )
    up, shapes, lines = None, [], []
    if not alone:
        places = _around(run, chosen, bodies)
        size = float(np.linalg.norm(np.ptp(places, axis=0))) or 1.0
        up = _upwards(run, places)
        marks = Marks(run, chosen, size, up)
        shapes = [*_rigid(run, chosen, size), *marks.shapes(), *marks.planes(places)]
        shapes += [*marks.loads(), *marks.gravity(places)] if loads else []
        lines = [*_sticks(run, marks), *marks.lines()]
    notes = _rates(run, chosen) if len(run.scene.body) == 1 else ()
    return MovingMechanism(run.motion.times[chosen], bodies, tuple(shapes), tuple(lines), notes, up)


def body_surface(run: Pipeline, body: str) -> Surface:
    """Return the surface of a flexible body in its frame, or, of a scene without motion, in its mesh's.

    Raises
    ------
    InputError
        Its surface has no triangles, with what it lacks.
    """
    from fmd.render.surface import Surface

    part = run.wholes[body]
    if not part.is_drawn:
        fields = None if part.has_mesh else part.given_model.fields
        mend = fields.not_drawn if fields else "has no surface" if not part.has_mesh else NUMBERS_ALONE
        raise InputError(run.scene.file, f"body.{body}.{part.shape.shape}", None, f"{mend}, so it has no picture")
    x = part.space.x if not run.scene.moves else run.node_positions(body)  # a part alone isn't reduced
    return Surface(x[part.surface.nodes], part.surface.triangles, part.surface.edges)


def _flexible(run: Pipeline, body: str, chosen: IntArray, scale: float, component: str | None) -> MovingBody:
    """Gather a flexible body, with a measure of its stress if it is to be coloured."""
    from fmd.render.moving_bodies import MovingBody

    frame = run.motion.kinematics.frames[run.motion.mechanism.number_of(body)]
    history, nodes = run.stress_of(body) if component is not None else None, run.wholes[body].surface.nodes
    if len(run.pieces_of(body)) > 1:  # not linear in its coordinates: a shape for each time
        shapes, coordinates = np.moveaxis(run.deform(body, chosen, nodes), 0, 2), np.eye(len(chosen))
    else:
        shapes, coordinates = run.bodies[body].shapes[nodes], run.motion.modal(body)[chosen]
        if (own := run.contact_deformation(body, run.motion)) is not None:
            shapes = np.concatenate([shapes, own.fields.shapes[nodes]], axis=2)
            coordinates = np.concatenate([coordinates, own.fields.sizes[chosen]], axis=1)
    return MovingBody(
        surface=body_surface(run, body),
        shapes=shapes,
        coordinates=coordinates,
        origin=frame.origin[chosen],
        rotation=frame.rotation[chosen],
        scale=scale,
        stress=history.measure_at(chosen, stress_measure(component)) if history is not None and component else None,
        name=body,
    )


def _rigid(run: Pipeline, chosen: IntArray, size: float) -> list[MovingShape]:
    """Gather the shapes of the rigid bodies, each body in its own pale colour unless the scene gives one."""
    from fmd.render.moving_bodies import MovingShape

    found, colours = [], cycle(BODY_COLOURS)
    for body in (name for name in run.scene.body if name not in run.wholes):
        number, colour = run.mechanism.number_of(body), next(colours)
        frame, link = run.motion.kinematics.frames[number], run.mechanism.links[number]
        table: Any = run.scene.body[body]
        name, marker = next(iter(link.markers.items()))
        origin = np.array(table.marker[name].at) - marker.position  # of the frame, in the scene's coordinates
        place = frame.origin[chosen] - np.einsum("tij,j->ti", frame.rotation[chosen], origin)
        for surface, own in shape_surfaces(run, body, size):
            found.append(MovingShape(surface, own or colour, place, frame.rotation[chosen], body))
    return found


def _sticks(run: Pipeline, marks: Marks) -> list[MovingLine]:
    """Return lines through the markers of flexible bodies that have no surface."""
    from fmd.render.moving_bodies import MovingLine

    found = []
    for name, part in run.wholes.items():
        if not part.is_drawn:
            places = [marks.position(f"{name}.{marker}") for marker in run.bodies[name].markers]
            found.append(MovingLine(np.stack([*places, places[0]], axis=1), BODY_COLOURS[0], 5.0))
    return found


def _around(run: Pipeline, chosen: IntArray, bodies: tuple[MovingBody, ...]) -> Array:
    """Return all markers and points around the flexible bodies over the motion, shape (n, 3) [m]."""
    kinematics, places = run.motion.kinematics, [body.around() for body in bodies]
    for number, link in enumerate(run.mechanism.links):
        places += [kinematics.marker_position(number, name)[chosen] for name in link.markers]
        table: Any = run.divided_scene.body[link.name]
        if getattr(table, "shape", "") == "rod":  # may have a marker at one end alone
            frame = kinematics.frames[number]
            places.append(frame.origin[chosen] + table.length * frame.rotation[chosen][:, :, 0])
    return np.concatenate(places)


def _upwards(run: Pipeline, places: Array) -> Array | None:
    """Return the direction against gravity; without gravity, z for a motion in space and none for one in a plane."""
    gravity = np.array(run.scene.simulation.gravity)
    size = float(np.linalg.norm(gravity))
    if size > WEIGHTLESS:
        return np.asarray(-gravity / size)
    extents = np.ptp(places, axis=0)
    return (
        np.array([0.0, 0.0, 1.0]) if extents.min() > FLAT_MOTION * extents.max() and len(run.scene.body) > 1 else None
    )


def _rates(run: Pipeline, chosen: IntArray) -> tuple[str, ...]:
    """Return the rate of rotation of the scene's one body as texts, none of a body that doesn't turn."""
    spin = run.motion.spin(next(iter(run.scene.body)))[chosen]
    if spin.max() < HARDLY_TURNS:
        return ()
    return tuple(f"{turns * 60 / (2 * np.pi):,.0f} rpm".replace(",", " ") for turns in spin)
