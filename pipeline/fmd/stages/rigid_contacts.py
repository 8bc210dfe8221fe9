"""Contacts of rigid bodies: points with a radius, the surfaces that they touch, and the force between the two."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.contact.primitives import BALL, BORE, BOX, PIN, Primitive, RoundPoints
from fmd.contact.round_laws import RoundLaw, ball_law, joint_modulus, pin_law, shear_ratio
from fmd.contact.touching_body import ContactPair, ContactPlane, ContactPoints, TouchingBody
from fmd.contact.triangle_field import points_of_triangles
from fmd.core.arrays import Array
from fmd.core.errors import InputError, as_input_error
from fmd.core.limits.contact import CROSSING_EDGES, PRIMITIVE_DEPTH
from fmd.core.rotations import rotation_by
from fmd.stages.parent_joint import ground_place
from fmd.stages.visual_files import read_shape

if TYPE_CHECKING:
    from fmd.core.cache import Cache
    from fmd.scene.contacts import Contact
    from fmd.scene.scene import Scene
    from fmd.stages.contact_grids import StartPose

_PAIRS = {
    "ball": ("ball", "box", "pin", "bore"),
    "pin": ("bore",),
    "box": ("box",),
}
"""Which surfaces points of a surface may touch."""


def rigid_surface(scene: Scene, place: str) -> Any:
    """Return the table of a rigid body's round surface at a place of a contact; ``None`` elsewhere."""
    body, _, name = place.partition(".")
    return None if place in scene.of_triangles else getattr(scene.body.get(body), "surface", {}).get(name)


def order_of(scene: Scene, name: str, contact: Contact) -> tuple[str, str]:
    """Return the places of the points and of the surface that they may touch.

    Raises
    ------
    InputError
        Neither of the two has points that may touch the other.
    """
    one, other = (rigid_surface(scene, place) for place in contact.between)
    for place in contact.between:
        if place in scene.of_triangles:
            fault = "is of triangles, which touch planes, one another and faces of flexible bodies; make both files"
            raise InputError(scene.file, f"contact.{name}.between", place, fault)
    for (mine, theirs), places in (((other, one), contact.between[::-1]), ((one, other), contact.between)):
        if theirs is not None and (mine is None or theirs.type in _PAIRS.get(mine.type, ())):
            return places[0], places[1]
    what = f"a {one.type} and a {other.type}"
    mend = (
        "a ball touches balls, boxes, pins and bores, a pin bores, a box boxes; all of these touch faces of flexible "
    )
    mend += "bodies, and all but bores planes of the ground"
    raise InputError(scene.file, f"contact.{name}.between", what, f"can't be followed; {mend}")


def points_of(table: Any, origin: Array) -> RoundPoints | None:
    """Return the points of a surface: a ball's centre, a box's corners, pieces of a pin; ``None`` of a bore.

    They are in the body's frame, whose origin (3,) is given in the scene's coordinates.
    """
    if table.type == "ball":
        return RoundPoints(table.at - origin[None], table.radius, np.ones(1))
    if table.type == "box":
        signs = np.stack(np.meshgrid(*3 * ((-1.0, 1.0),), indexing="ij"), axis=-1).reshape(8, 3)
        corners = signs * (0.5 * np.array(table.size) - table.edge_radius)
        return RoundPoints(table.at - origin + corners @ rotation_by(table.rotation).T, table.edge_radius, np.ones(8))
    if table.type == "pin":
        start, end = np.array(table.start), np.array(table.end)
        nodes, weights = np.polynomial.legendre.leggauss(3)
        x = 0.5 * (start + end) - origin + 0.5 * nodes[:, None] * (end - start)
        return RoundPoints(x, table.radius, 0.5 * weights, float(np.linalg.norm(end - start)))
    return None


def edges_of(table: Any, origin: Array) -> RoundPoints:
    """Return the edges of a box, each of them once for each edge of another box."""
    middles = np.repeat(primitive_of(table, origin).edge_middles, 12, axis=0)
    return RoundPoints(middles, table.edge_radius, np.ones(len(middles)), of_edges=True)


def primitive_of(table: Any, origin: Array) -> Primitive:
    """Return a surface as what points touch, in the body's frame, whose origin is in the scene's coordinates."""
    if table.type in ("ball", "box"):
        half, axes, radius = np.zeros(3), np.eye(3), getattr(table, "radius", 0.0)
        if table.type == "box":
            radius, axes = table.edge_radius, rotation_by(table.rotation).T
            half = 0.5 * np.array(table.size) - radius
        return _primitive(BALL if table.type == "ball" else BOX, table.at - origin, axes, half, radius)
    start, end = np.array(table.start), np.array(table.end)
    along = (end - start) / np.linalg.norm(end - start)
    axes = np.vstack([np.linalg.svd(along[None])[2][1:], along])
    half = np.array([0.0, 0.0, 0.5 * float(np.linalg.norm(end - start))])
    return _primitive(PIN if table.type == "pin" else BORE, 0.5 * (start + end) - origin, axes, half, table.radius)


def _primitive(kind: int, at: Array, axes: Array, half: Array, radius: float) -> Primitive:
    x, y, z = (tuple(float(each) for each in row) for row in axes)
    return Primitive(kind, tuple(at.tolist()), (x, y, z), tuple(half.tolist()), radius)  # type: ignore[arg-type]


def force_law(
    scene: Scene, name: str, contact: Contact, points: RoundPoints, mine: Any, theirs: Any
) -> tuple[RoundLaw, float]:
    """Return the force of points of a surface before another one, or before a plane, and how much softer it is aside.

    Raises
    ------
    InputError
        A pin or a ball is no thinner than its bore.
    """
    materials = [(own.E, own.nu) for own in (mine, theirs) if own is not None]
    modulus, slide = joint_modulus(*materials), shear_ratio(*materials)
    if theirs is not None and theirs.type == "bore" and points.radius >= theirs.radius:
        fault = f"is no thinner than its bore, {theirs.radius:g} m; an interference fit takes two flexible bodies"
        raise InputError(scene.file, f"contact.{name}.between", f"{points.radius:g} m", fault)
    if points.length:
        length = points.length
        if theirs is not None:
            length = min(length, float(np.linalg.norm(np.subtract(theirs.end, theirs.start))))
        rows, ends = pin_law(points.radius, np.inf if theirs is None else theirs.radius, length, modulus)
        return RoundLaw(rows, contact.restitution, ends), slide
    across = 1.0 / points.radius
    if points.of_edges:
        curvatures = (across, 1.0 / theirs.edge_radius)  # of cylinders that cross at a right angle
    elif theirs is None or theirs.type == "box":
        curvatures = (across, across)
    elif theirs.type == "ball":
        curvatures = (across + 1.0 / theirs.radius,) * 2
    else:
        curvatures = (across, across + (-1.0 if theirs.type == "bore" else 1.0) / theirs.radius)
    return RoundLaw(ball_law(curvatures, modulus), contact.restitution), slide


def add_points(points: ContactPoints, face: str, own: RoundPoints, stiffness: float) -> ContactPoints:
    """Return a rigid body's points with those of a face in one more contact, whose expected slope is given [N/m]."""
    first, n = len(points.x), len(points.x) + len(own.x)
    G = np.zeros((n, 3, n, 3))
    G[:first, :, :first] = points.G
    for k, share in enumerate(own.shares):
        G[first + k, :, first + k] = np.eye(3) / (stiffness * share)
    return ContactPoints(
        x=np.concatenate([points.x, own.x]),
        areas={**points.areas, face: np.pi * own.radius**2 * own.shares},
        shapes=np.zeros((n, 3, 0)),
        G=G,
        faces={**points.faces, face: np.arange(first, n)},
        radii=np.concatenate([points.radii, np.full(len(own.x), own.radius)]),
        shares=np.concatenate([points.shares, own.shares]),
        primitives=points.primitives,
    )


def expected_stiffness(law: RoundLaw, radius: float, force: float, energy: float) -> float:
    """Return the slope of a law [N/m] under a force at rest [N] or in a shock of an energy [J]."""
    return law.stiffness(max(law.depth_under(force, energy), PRIMITIVE_DEPTH * radius))


def first_points(scene: Scene, body: str, start: StartPose, cache: Cache) -> ContactPoints:
    """Return the surfaces of a rigid body that points may touch, and the points of one of triangles.

    Raises
    ------
    InputError
        Several surfaces of triangles touch something, or round ones do, too, or its file can't be used.
    """
    tables: dict[str, Any] = scene.body[body].surface  # type: ignore[union-attr]
    ends = [end.partition(".") for own in scene.contact.values() for end in own.between]
    touching = [name for own, _, name in ends if own == body]
    used = dict.fromkeys(name for name in touching if tables[name].type == "file")
    if not used:
        round_ones = {name: table for name, table in tables.items() if table.type != "file"}
        primitives = {name: primitive_of(table, start.origin(body)) for name, table in round_ones.items()}
        none, shapes = np.zeros((0, 3)), np.zeros((0, 3, 0))
        return ContactPoints(none, {}, shapes, np.zeros((0, 3, 0, 3)), {}, primitives=primitives)
    name = next(iter(used))
    key = f"body.{body}.surface.{name}.file"
    if len({*touching}) > 1:
        fault = "is of triangles, beside which no other surface of the body touches; one file with all of them works"
        raise InputError(scene.file, key, tables[name].file, fault)
    x, triangles = read_shape(scene, body, f"surface.{name}", cache)
    with as_input_error(scene.file, key, tables[name].file):
        return points_of_triangles(name, x - start.origin(body), triangles, tables[name].E, tables[name].nu)


def plane_of(scene: Scene, name: str, contact: Contact) -> ContactPlane:
    """Return the plane of the ground of a contact."""
    place, (_, _, face) = contact.between[0], contact.between[1].partition(".")
    position, axes = ground_place(scene, place)
    normal = axes @ np.array(contact.normal, dtype=float)
    normal /= np.linalg.norm(normal)
    law = contact.friction, contact.clearance, contact.damping
    return ContactPlane(name, position, normal, law[0], face, *law[1:], wear=contact.wear)


def add_rigid_contact(
    scene: Scene, name: str, contact: Contact, bodies: dict[str, TouchingBody], start: StartPose
) -> None:
    """Add a contact of a rigid body to the bodies that touch: with a plane, a flexible face or another rigid body."""
    if contact.on_ground:
        plane, body = plane_of(scene, name, contact), contact.between[1].partition(".")[0]
        mine = rigid_surface(scene, contact.between[1])
        points = points_of(mine, start.origin(body))
        if points is None:
            fault = "is a bore, which no plane touches; pins, balls and boxes do"
            raise InputError(scene.file, f"contact.{name}.between", contact.between[1], fault)
        law, slide = force_law(scene, name, contact, points, mine, None)
        origin, R = start.frame(body)
        gaps = (origin - plane.position + points.x @ R.T) @ plane.normal - points.radius + contact.clearance
        stiffness = expected_stiffness(law, points.radius, *start.loads(float(gaps.min()), plane.normal))
        face = _points_in(name, contact.between[1])
        own = add_points(bodies[body].points, face, points, stiffness)
        plane = replace(plane, face=face, law=law, slide=slide, near_field=_near_field(points))
        bodies[body] = replace(bodies[body], points=own, planes=(*bodies[body].planes, plane))
        return
    mine_at, theirs_at = order_of(scene, name, contact)
    (body, _, face), (other, _, other_face) = mine_at.partition("."), theirs_at.partition(".")
    pair = ContactPair(
        name,
        face,
        other,
        other_face,
        contact.friction,
        contact.clearance,
        contact.damping,
        wear=contact.wear,
        reported_on_other=mine_at == contact.between[0],
    )
    mine = rigid_surface(scene, mine_at)
    if mine is not None:
        one, two = (body, mine_at), (other, theirs_at)
        held = _hold_points(scene, pair, one, two, bodies, start)
        if mine.type == "box":
            back = _hold_points(scene, replace(pair, other=body, other_face=face), two, one, bodies, start)
            edges = _hold_points(scene, replace(pair, edges=face), one, two, bodies, start)
            held = replace(held, others=(back, edges))
        pair = held
    bodies[body] = replace(bodies[body], pairs=(*bodies[body].pairs, pair))


def _hold_points(
    scene: Scene,
    pair: ContactPair,
    one: tuple[str, str],
    two: tuple[str, str],
    bodies: dict[str, TouchingBody],
    start: StartPose,
) -> ContactPair:
    """Give a body the points of its surface before that of another rigid one, and return the pair with their law.

    Of each of the two, its name and the place of its surface are given.
    """
    (body, mine_at), (other, theirs_at) = one, two
    mine, theirs = rigid_surface(scene, mine_at), rigid_surface(scene, theirs_at)
    points = edges_of(mine, start.origin(body)) if pair.edges else points_of(mine, start.origin(body))
    assert points is not None  # or it would have no place in the order
    law, slide = force_law(scene, pair.name, scene.contact[pair.name], points, mine, theirs)
    (origin, R), (theirs_origin, theirs_R) = start.frame(body), start.frame(other)
    apart = float(np.linalg.norm(origin - theirs_origin))  # no fall is farther
    # Each of the two is held by itself in what steps are chosen by: both are twice as stiff.
    stiffness = 2.0 * expected_stiffness(law, points.radius, *start.loads(apart))
    if pair.edges:
        stiffness *= CROSSING_EDGES / len(points.x)
    face = f"{_points_in(pair.name, mine_at)}, edges" if pair.edges else _points_in(pair.name, mine_at)
    bodies[body] = replace(bodies[body], points=add_points(bodies[body].points, face, points, stiffness))
    there = (origin + points.x @ R.T - theirs_origin) @ theirs_R
    held = add_points(bodies[other].points, f"before {face}", replace(points, x=there), stiffness)
    bodies[other] = replace(bodies[other], points=held)
    return replace(pair, face=face, law=law, slide=slide, near_field=_near_field(points))


def _points_in(contact: str, place: str) -> str:
    """Name a rigid surface's points in one contact: each has its own law there, and may be wide in one alone."""
    return f"{place} in {contact}"


def _near_field(points: RoundPoints) -> str:
    return "half-space under strips of the pin" if points.length else "Hertz"
