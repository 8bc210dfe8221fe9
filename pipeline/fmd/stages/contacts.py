"""From a scene's contacts to bodies that touch planes or one another, with their points and their flexibility."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fmd.contact.flexibility import contact_points, find_residual_fields
from fmd.contact.near_field import CurvedPlace, find_curved_place, with_near_field
from fmd.contact.touching_body import ContactPair, ContactPlane, ContactPoints, TouchingBody
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.contact import GRID_MARGIN, RESOLVED_BY_MESH
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.fem.surface import surface_facets, surface_topology
from fmd.stages.assembly import given_joints
from fmd.stages.contact_deformation import ContactDeformation
from fmd.stages.markers import find_marker_facets
from fmd.stages.parent_joint import ground_place

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fmd.core.arrays import IntArray
    from fmd.dynamics.mechanism import Mechanism
    from fmd.scene.contacts import Contact
    from fmd.scene.scene import Scene
    from fmd.stages.part import FlexiblePart
    from fmd.stages.pipeline import Pipeline


class StartPose:
    """A mechanism at the start, undeformed, as far as contacts need it."""

    def __init__(self, scene: Scene, mechanism: Mechanism) -> None:
        self._scene, self._mechanism = scene, mechanism

    @cached_property
    def _kinematics(self) -> Kinematics:
        q, v = given_joints(self._scene, self._mechanism)
        return Kinematics(self._mechanism, np.zeros(1), q[None], v[None])

    def frame(self, body: str) -> tuple[Array, Array]:
        """Return the origin (3,) and the axes (3, 3) of a body's frame."""
        frame = self._kinematics.frames[self._mechanism.number_of(body)]
        return frame.origin[0], frame.rotation[0]

    def loads(self, normal: Array, height: float) -> tuple[float, float]:
        """Return twice the weight onto a plane [N], and the energy of a fall from a height onto it [J]."""
        weight = self._mechanism.mass * max(0.0, -float(self._mechanism.gravity @ normal))
        return 2.0 * weight, float(self._kinematics.energies[0][0]) + weight * max(0.0, height)


def refine_near_field(
    scene: Scene, plane: ContactPlane, body: str, points: ContactPoints, start: StartPose
) -> tuple[ContactPoints, str]:
    """Return a body's points, with a grid on the face of a contact if it takes one, and what gives its near field.

    Raises
    ------
    InputError
        The scene asks for a grid, and the face or the modes have no place for it, or nothing tells its size.
    """
    contact, key = scene.contact[plane.name], f"contact.{plane.name}"
    if contact.near_field == "mesh" or points.elastic is None or plane.face in points.surfaces:
        _require_mesh(scene, plane, "is of several materials, or touches a body, too")
        return points, "mesh"
    at = None
    if not points.is_flat(plane.face):
        at = find_curved_place(points, plane.face, start.frame(body)[1].T @ plane.normal)
    if at is None:
        _require_mesh(scene, plane, "is no sphere, cylinder, cone or ellipsoid that is lowest within it at the start")
        return points, "mesh"
    asked, half = contact.near_field == "half-space", 0.5 * (contact.width or 0.0)
    if contact.width is None:
        origin, R = start.frame(body)
        height = float((origin + R @ at.place - plane.position) @ plane.normal) + plane.clearance
        half = GRID_MARGIN * at.half_width(*points.elastic, *start.loads(plane.normal, height))
    if half == 0.0 and asked:
        fault = "is needed: nothing falls, moves or weighs on the plane that would tell the contact's width"
        raise InputError(scene.file, f"{key}.width", None, fault)
    if half == 0.0 or (not asked and half > RESOLVED_BY_MESH * at.spacing):
        return points, "mesh"
    return _add_grid(scene, plane, points, at, half, asked)


def _require_mesh(scene: Scene, plane: ContactPlane, why: str) -> None:
    """Raise ``InputError`` where a half-space is asked for."""
    if scene.contact[plane.name].near_field == "half-space":
        key, fault = f"contact.{plane.name}.near_field", f"{plane.face} {why}; 'mesh' works"
        raise InputError(scene.file, key, "half-space", fault)


def _add_grid(
    scene: Scene, plane: ContactPlane, points: ContactPoints, at: CurvedPlace, half: float, asked: bool
) -> tuple[ContactPoints, str]:
    assert points.elastic is not None
    try:
        found = with_near_field(points, plane.face, at, half, scene.contact[plane.name].points, *points.elastic)
    except ValueError as error:
        if not asked:
            return points, f"mesh, since {error}"
        raise InputError(scene.file, f"contact.{plane.name}.near_field", "half-space", str(error)) from error
    return found, f"half-space, a grid of {len(found.faces[plane.face])} points and a width of {2e3 * half:.3g} mm"


def find_contact_points(part: FlexiblePart) -> ContactPoints:
    """Find the points of a part's faces that may touch something.

    Raises
    ------
    InputError
        A face has no points that only push; the message tells which elements have.
    """
    if not part.has_mesh:
        raise InputError(
            part.file, f"body.{part.name}", None, "has contacts, but no mesh: a face of elements is needed"
        )
    faces = {name: part.markers[name] for name in part.contact_faces}
    try:
        return contact_points(part.fe, part.model.solver, part.body, faces, _find_triangles(part))
    except ValueError as error:
        raise InputError(part.file, f"body.{part.name}.marker", None, str(error)) from error


def _find_triangles(part: FlexiblePart) -> dict[str, IntArray]:
    """Return the nodes at the corners of the triangles of each face that may touch another body."""
    if not part.paired_faces:
        return {}
    surface, of_facet = surface_topology(part.space), surface_facets(part.space)
    on_faces = find_marker_facets(part.shape, part.space, part.file, part.name)
    found = {}
    for name in part.paired_faces:
        if name not in on_faces:
            raise ValueError(f"{name} is no face that can deform; an averaged marker on a face works")
        found[name] = surface.nodes[surface.triangles[np.isin(of_facet, on_faces[name])]]
    return found


def add_contacts(run: Pipeline, mechanism: Mechanism) -> Mechanism:
    """Give a mechanism the contacts of its scene."""
    bodies = {body: TouchingBody(body, run.parts[body].contact_points) for _, body, _ in run.scene.touching_faces}
    start = StartPose(run.divided_scene, mechanism)
    for name, contact in run.scene.contact.items():
        if contact.on_ground:
            plane = _plane(run.scene, name, contact)
            body = contact.between[1].partition(".")[0]
            points, told = refine_near_field(run.scene, plane, body, bodies[body].points, start)
            planes = (*bodies[body].planes, replace(plane, near_field=told))
            bodies[body] = replace(bodies[body], points=points, planes=planes)
        else:
            body, pair = _pair(name, contact, bodies)
            bodies[body] = replace(bodies[body], pairs=(*bodies[body].pairs, pair))
    if run.scene.simulation.start == "equilibrium":
        bodies = {name: replace(own, anchor=start.frame(name)) for name, own in bodies.items()}
    return replace(mechanism, contacts=list(bodies.values()))


def find_deformations(run: Pipeline) -> dict[str, dict[str, ContactDeformation]]:
    """Find what contacts deform bodies beside their modes in each run, by the run's label and the body."""
    found: dict[str, dict[str, ContactDeformation]] = {}
    for label, motion in run.motions.items():
        forces, own = motion.touched.forces if motion.touched else {}, dict[str, ContactDeformation]()
        for touching in motion.mechanism.contacts:
            part, points = run.parts[touching.body], touching.points
            on_nodes = points.on_nodes(forces[touching.body])
            fields = find_residual_fields(part.fe, part.model.solver, part.body, points.nodes, on_nodes)
            own[touching.body] = ContactDeformation(part, points, fields)
        found[label] = own
    return found


def _plane(scene: Scene, name: str, contact: Contact) -> ContactPlane:
    place, (_, _, face) = contact.between[0], contact.between[1].partition(".")
    position, axes = ground_place(scene, place)
    normal = axes @ np.array(contact.normal, dtype=float)
    normal /= np.linalg.norm(normal)
    return ContactPlane(name, position, normal, contact.friction, face, contact.clearance, contact.damping)


def _pair(name: str, contact: Contact, bodies: Mapping[str, TouchingBody]) -> tuple[str, ContactPair]:
    """Return the body whose points are looked for on the other's triangles, that with smaller ones, and the pair."""
    (one, face), (body, own) = (end.partition(".")[::2] for end in contact.between)
    if bodies[one].points.areas[face].mean() < bodies[body].points.areas[own].mean():
        return one, ContactPair(name, face, body, own, *_law(contact), reported_on_other=True)
    return body, ContactPair(name, own, one, face, *_law(contact))


def _law(contact: Contact) -> tuple[float, float, float]:
    return contact.friction, contact.clearance, contact.damping
