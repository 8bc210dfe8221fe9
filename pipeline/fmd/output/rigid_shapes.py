"""Shapes of rigid bodies in pictures: those of the scene, or what their markers and inertia suggest."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.shown import BORE_WALL
from fmd.core.rotations import rotation_by
from fmd.stages.visual_files import read_shape

if TYPE_CHECKING:
    from fmd.render.surface import Surface
    from fmd.stages.pipeline import Pipeline

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
    """Return a surface that may touch something."""
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
    """Return the surface of one of the shapes that a scene gives a body."""
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
