"""A run's mechanism as pictures and films show it: all bodies, joints, springs and the ground.

Rigid bodies have the shapes of the scene, or what their markers and inertia suggest.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.core.limits.shown import BORE_WALL, FLAT_MOTION, HARDLY_TURNS, WEIGHTLESS
from fmd.core.rotations import rotation_by
from fmd.fem.sections import NUMBERS_ALONE
from fmd.output.joint_marks import Marks
from fmd.recovery.stress import stress_measure
from fmd.stages.visual_files import read_shape

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
    history, nodes = run.stress_of(body, run.motion) if component is not None else None, run.wholes[body].surface.nodes
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


_SLENDER = 6.0  # least length of a rod over its radius
_BALL = 2.2  # radius of a point mass over that of a rod
_SAME = 1e-3  # of the mechanism's size: places that count as one
_FLAT = 0.08  # least extent of places that lie in a plane, over the largest
_THIN = 0.25  # least edge of a box over its longest: a body without inertia about an axis would be a line


def shape_surfaces(run: Pipeline, body: str, size: float) -> list[tuple[Surface, str | None]]:
    """Return the shapes of a rigid body in its scene's coordinates, with their colours if the scene gives them.

    Rods are as thick as can be seen in a mechanism of an extent [m].
    """
    table: Any = run.scene.body[body]
    if table.visual:
        return [(_given_surface(run, body, number), visual.colour) for number, visual in enumerate(table.visual)]
    if table.surface:
        return [(_touching_surface(run, body, name), None) for name in table.surface]
    return [(_usual_surface(table, size), None)]


def _touching_surface(run: Pipeline, body: str, name: str) -> Surface:
    from fmd.render.solids import make_ball, make_box, make_cylinder, make_tube
    from fmd.render.surface import Surface

    table: Any = run.scene.body[body]
    table = table.surface[name]
    if table.type == "file":
        shape = read_shape(run.scene, body, f"surface.{name}", run.store.cache)
        return Surface(*shape, np.empty((0, 2), dtype=np.int64))
    if table.type == "ball":
        return make_ball(np.array(table.at), table.radius)
    if table.type == "box":
        return make_box(np.array(table.size), np.array(table.at), rotation_by(table.rotation))
    ends = np.array(table.start), np.array(table.end)
    if table.type == "pin":
        return make_cylinder(*ends, table.radius)
    return make_tube(*ends, table.radius, BORE_WALL * table.radius)


def _given_surface(run: Pipeline, body: str, number: int) -> Surface:
    from fmd.render.solids import join_surfaces, make_box, make_cylinder
    from fmd.render.surface import Surface

    table: Any = run.scene.body[body]
    visual = table.visual[number]
    match visual.type:
        case "box":
            return make_box(np.array(visual.size), np.array(visual.at), rotation_by(visual.rotation))
        case "cylinder":
            return make_cylinder(np.array(visual.start), np.array(visual.end), visual.radius)
        case "rod":
            places = _distinct([np.array(marker.at) for marker in table.marker.values()], 1e-9)
            if len(places) < 2:
                key = f"body.{body}.visual.{number}.type"
                raise InputError(run.scene.file, key, "rod", "needs two markers at different places; the body has one")
            return join_surfaces([make_cylinder(one, other, visual.radius) for one, other in pairwise(places)])
    return Surface(*read_shape(run.scene, body, f"visual.{number}", run.store.cache), np.empty((0, 2), dtype=np.int64))


def _usual_surface(table: Any, size: float) -> Surface:
    """Return a rod of a body's length, a ball for a point mass, or what suits a body's markers and inertia."""
    from fmd.render.solids import join_surfaces, make_ball, make_cylinder

    radius = 0.011 * size  # radius of a rod over the mechanism's size
    if table.shape == "rod":
        ends = np.zeros(3), np.array([table.length, 0.0, 0.0])
        return make_cylinder(*ends, min(radius, table.length / _SLENDER))
    if table.shape == "point":
        return make_ball(np.zeros(3), _BALL * radius)
    places = _distinct([np.array(marker.at) for marker in table.marker.values()], _SAME * size)
    if len(places) > 1:
        return join_surfaces(_through_places(places, np.array(table.centre), radius))
    return join_surfaces(_from_inertia(table, places[0], radius))


def _through_places(places: list[Array], centre: Array, radius: float) -> list[Surface]:
    """Return a rod through places that lie on a line, a plate through those in a plane, else rods from a centre."""
    from fmd.render.solids import make_cylinder, make_plate

    middle = np.mean(places, axis=0)
    apart = np.array(places) - middle
    _, extents, axes = np.linalg.svd(apart)
    extents = np.append(extents, np.zeros(3 - len(extents)))
    if extents[1] < _FLAT * extents[0]:
        along = apart @ axes[0]
        ends = places[int(np.argmin(along))], places[int(np.argmax(along))]
        return [make_cylinder(*ends, min(radius, float(np.ptp(along)) / _SLENDER))]
    if extents[2] < _FLAT * extents[0]:
        from scipy.spatial import ConvexHull

        flat = apart @ axes[:2].T
        corners = middle + flat[ConvexHull(flat).vertices] @ axes[:2]
        return [make_plate(corners, 1.2 * radius)]
    far = [place for place in places if np.linalg.norm(place - centre) > radius]
    lengths = [float(np.linalg.norm(place - centre)) for place in far]
    return [make_cylinder(centre, place, min(radius, a / _SLENDER)) for place, a in zip(far, lengths, strict=True)]


def _from_inertia(table: Any, place: Array, radius: float) -> list[Surface]:
    """Return the box that has a body's moments of inertia, and a rod from its marker if that lies outside."""
    from fmd.render.solids import make_ball, make_box, make_cylinder

    moments, centre = np.array(table.inertia), np.array(table.centre)
    edges = np.sqrt(np.maximum(6.0 / table.mass * (moments.sum() - 2.0 * moments), 0.0))  # Ix = m (b² + c²)/12
    if edges.max() <= 0:
        shapes = [make_ball(centre, _BALL * radius)]
    else:
        edges = np.maximum(edges, _THIN * min(edges.max(), 4 * radius))
        shapes = [make_box(edges, centre)]
    if np.any(np.abs(place - centre) > edges / 2 + radius):
        shapes.append(make_cylinder(place, centre, min(radius, float(np.linalg.norm(place - centre)) / _SLENDER)))
    return shapes


def _distinct(places: Sequence[Array], apart: float) -> list[Array]:
    """Leave out places that are as near as ``apart`` [m] to one before."""
    kept: list[Array] = []
    for place in places:
        if all(np.linalg.norm(place - other) > apart for other in kept):
            kept.append(place)
    return kept
