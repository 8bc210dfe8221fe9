"""From a scene's contacts to bodies that touch planes or one another, with their points and their flexibility."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fmd.contact.columns import Columns, Responder
from fmd.contact.flexibility import contact_points, find_residual_fields
from fmd.contact.touching_body import ContactPair, ContactPoints, TouchingBody
from fmd.core.errors import AccuracyError, InputError, as_input_error
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.fem.surface import surface_facets, surface_topology
from fmd.stages.contact_deformation import ContactDeformation
from fmd.stages.contact_grids import StartPose, refine_near_field
from fmd.stages.contact_steps import require_steps_of_modes
from fmd.stages.equilibrium import find_equilibrium, rest_without_friction
from fmd.stages.loop_closing import given_joints
from fmd.stages.markers import find_marker_facets
from fmd.stages.rigid_contacts import add_rigid_contact, first_points, plane_of, rigid_surface

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fmd.core.arrays import IntArray
    from fmd.scene.contacts import Contact
    from fmd.stages.part import FlexiblePart
    from fmd.stages.pipeline import Pipeline


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
    with as_input_error(part.file, f"body.{part.name}.marker"):
        loaded = {name: part.markers[name] for name in part.loaded_markers}
        solver = part.model.solver_on_joint(part.contact_faces)
        return contact_points(part.fe, solver, part.body, faces, _find_triangles(part), loaded)


def _find_triangles(part: FlexiblePart) -> dict[str, IntArray]:
    """Return the nodes at the corners of the triangles of each face that may touch another body."""
    if not part.paired_faces:
        return {}
    surface, of_facet = surface_topology(part.plain_space), surface_facets(part.plain_space)
    on_faces = find_marker_facets(part.shape, part.space, part.file, part.name)
    found = {}
    for name in part.paired_faces:
        if name not in on_faces:
            raise ValueError(f"{name} is no face that can deform; an averaged marker on a face works")
        found[name] = surface.nodes[surface.triangles[np.isin(of_facet, on_faces[name])]]
    return found


def add_contacts(run: Pipeline, mechanism: Mechanism) -> Mechanism:
    """Give a mechanism the contacts of its scene.

    Raises
    ------
    InputError
        A step is too long for the modes alone, or as `contact_points`.
    """
    require_steps_of_modes(run.scene, mechanism)
    bodies = {
        body: TouchingBody(body, _followed_points(run, body), felt=run.scene.markers_under_load(body))
        for _, body, _ in run.scene.touching_faces
    }
    start = StartPose(run.divided_scene, mechanism)
    bodies |= {
        body: TouchingBody(body, first_points(run.scene, body, start, run.store.cache))
        for body in run.scene.rigid_in_contact
    }
    for name, contact in run.scene.contact.items():
        if any(rigid_surface(run.scene, place) for place in contact.between):
            add_rigid_contact(run.scene, name, contact, bodies, start)
        elif contact.on_ground:
            plane = plane_of(run.scene, name, contact)
            body = contact.between[1].partition(".")[0]
            points, told = bodies[body].points, "half-space"
            if contact.between[1] not in run.scene.of_triangles:
                points, told = refine_near_field(run.scene, plane, body, points, start)
            planes = (*bodies[body].planes, replace(plane, near_field=told))
            bodies[body] = replace(bodies[body], points=points, planes=planes)
        else:
            body, pair = _pair(name, contact, bodies)
            if run.scene.of_triangles.issuperset(contact.between):
                pair = replace(pair, near_field="half-space")
            bodies[body] = replace(bodies[body], pairs=(*bodies[body].pairs, pair))
    if run.scene.simulation.start == "equilibrium":
        bodies = {name: replace(own, anchor=start.frame(name)) for name, own in bodies.items()}
        if any(contact.friction for contact in run.scene.contact.values()):
            bodies = _hold_where_they_lie(run, replace(mechanism, contacts=list(bodies.values())), bodies)
    return replace(mechanism, contacts=list(bodies.values()))


def _followed_points(run: Pipeline, body: str) -> ContactPoints:
    """Return a flexible body's points, of many with what finds their flexibility as they come near."""
    part, points = run.parts[body], run.parts[body].contact_points
    if not len(points.soft):
        return points

    def responder() -> Responder:
        return part.model.solver_on_joint(part.contact_faces).responder()

    columns = Columns(points.nodes, points.left_to_modes, responder, run.store.cache, part.key("contact"))
    return replace(points, columns=columns)


def _hold_where_they_lie(
    run: Pipeline, mechanism: Mechanism, bodies: Mapping[str, TouchingBody]
) -> dict[str, TouchingBody]:
    """Return bodies whose slip counts from where they lie, if they have to turn for that as they are set down."""
    q, v = given_joints(run.divided_scene, mechanism)
    system = share_system(mechanism)
    try:
        find_equilibrium(system, q)
    except AccuracyError:
        turned = rest_without_friction(system, q)
        if turned is not None:
            frames = Kinematics(mechanism, np.zeros(1), turned[None], v[None]).frames
            lie = {name: frames[mechanism.number_of(name)] for name in bodies}
            return {
                name: replace(own, anchor=(lie[name].origin[0], lie[name].rotation[0])) for name, own in bodies.items()
            }
    return dict(bodies)


def find_deformations(run: Pipeline) -> dict[str, dict[str, ContactDeformation]]:
    """Find what contacts deform bodies beside their modes in each run, by the run's label and the body."""
    found: dict[str, dict[str, ContactDeformation]] = {}
    for label, motion in run.motions.items():
        forces, own = motion.touched.forces if motion.touched else {}, dict[str, ContactDeformation]()
        for touching in motion.mechanism.contacts:
            if touching.body not in run.parts:
                continue  # rigid
            part, points = run.parts[touching.body], touching.points
            places = motion.touched.places[touching.body] if motion.touched else np.zeros((0, 0, 3))
            on_nodes = points.on_nodes(forces[touching.body], places)
            solver = part.model.solver_on_joint(part.contact_faces)
            fields = find_residual_fields(part.fe, solver, part.body, points.nodes, on_nodes)
            own[touching.body] = ContactDeformation(part, points, places, fields)
        found[label] = own
    return found


def _pair(name: str, contact: Contact, bodies: Mapping[str, TouchingBody]) -> tuple[str, ContactPair]:
    """Return the body whose points are looked for on the other's triangles, that with smaller ones, and the pair."""
    (one, face), (body, own) = (end.partition(".")[::2] for end in contact.between)
    if bodies[one].points.areas[face].mean() < bodies[body].points.areas[own].mean():
        return one, ContactPair(name, face, body, own, *_law(contact), wear=contact.wear, reported_on_other=True)
    return body, ContactPair(name, own, one, face, *_law(contact), wear=contact.wear)


def _law(contact: Contact) -> tuple[float, float, float]:
    return contact.friction, contact.clearance, contact.damping
