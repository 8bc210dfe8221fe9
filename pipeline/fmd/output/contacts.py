"""Contacts of a run in numbers: forces, pressure, times, and the energy that its steps made or lost."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.accuracy.contact_errors import ContactError
from fmd.contact.primitives import BORE, BOX, PIN, Primitive
from fmd.core.arrays import Array, IntArray
from fmd.core.limits.contact import (
    BETWEEN_NODES,
    DEPTH_FRAMES,
    FEW_ON_MESH,
    FEW_POINTS,
    PLACES_ON_SIDE,
    PLACES_ON_SURFACE,
    UNSEEN_DEPTH,
)
from fmd.core.limits.errors import SAFETY
from fmd.recovery.motion import Motion
from fmd.recovery.wear import worn_faces
from fmd.stages.contact_steps import leave_fastest_out
from fmd.stages.pipeline import Pipeline

if TYPE_CHECKING:
    from fmd.contact.touching_body import ContactPair, TouchingBody
    from fmd.stages.part import FlexiblePart


def contact_figures(run: Pipeline) -> dict[str, Any]:
    """Return the contacts of the first run by name; nothing without contacts."""
    histories = run.motion.contacts
    touching = run.motion.mechanism.contacts
    near_fields = {own.name: own.near_field for body in touching for own in body.contacts}
    figures = {name: {"near_field": near_fields[name], **own.figures} for name, own in histories.items()}
    for body in touching:
        for name in body.names:
            if histories[name].wears and (faces := worn_faces(run.motion, name)):
                figures[name]["wear_depths_m"] = {f"{at.body}.{at.face}": float(at.depths[-1].max()) for at in faces}
        for name in () if body.points.has_primitives else body.names:
            spacing = float(np.sqrt(body.points.areas[body.face_of(name)].mean()))
            radius = float(np.sqrt(histories[name].largest[1] / np.pi))
            figures[name]["radius_over_spacing"] = radius / spacing
        for plane in body.planes:
            own = run.at_instants.contact_deformation(body.body, run.at_instants.motion)
            if own is not None and plane.face in body.points.grids:
                stress, depth = own.stress_below(plane.face, run.at_instants.motion)
                figures[plane.name] |= {"largest_stress_below_pa": stress, "its_depth_m": depth}
    return {"contacts": figures} if histories else {}


def contact_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Return warnings about energy that contact's steps made, grids, raised flexibility, and nodes that go unseen."""
    found = list[dict[str, str]]()
    if not run.scene.contact:
        return found
    from fmd.output import contact_faults as faults

    found += [{"code": "contact-material", "text": text} for text in faults.material_faults(run)]
    found += [{"code": "contact-facing", "text": text} for text in faults.facing_faults(run.motion)]
    found += [{"code": code, "text": text} for code, text in faults.unfelt_faults(run)]
    found += [{"code": "contact-start", "text": text} for text in faults.start_faults(run)]
    found += [{"code": "contact-spread", "text": text} for text in faults.spread_faults(run)]
    for motion in run.motions.values():
        for name, own in motion.contacts.items():
            if not own.keeps_energy(motion.energies[0]):
                part = own.lost_part(motion.energies[0])
                text = (
                    f"contact.{name}: the steps made or lost {np.abs(own.energy_error).max():.3g} J by opening and "
                    f"closing, {100 * part:.2g} % of the largest of kinetic energy, energy stored in the contact, and "
                    "its heat; shorter steps lose less, and rho = 0 of generalized-alpha, but not where points cross "
                    "the edge of a face"
                )
                found.append({"code": "contact-energy", "text": text})
        found += [{"code": "contact-grid", "text": text} for text in _grid_faults(motion)]
        found += [{"code": "contact-wide", "text": text} for text in _pin_faults(motion)]
        found += [{"code": "contact-worn", "text": text} for text in _wear_faults(motion)]
        found += [{"code": "contact-coarse", "text": text} for text in _coarse_faults(motion)]
        found += [{"code": "contact-unseen", "text": text} for text in describe_depths(run, motion).values()]
    rings = leave_fastest_out(run.scene)
    for name, body, face in run.scene.touching_faces:
        if raised := run.parts[body].contact_points.raised:
            text = (
                f"contact.{name}: the modes of {body} have nearly all of its mesh's flexibility at the face; in "
                f"{100 * raised:.2g} % of its directions some was added, which takes short steps; fewer modes or "
                f"smaller elements help{rings and f'{rings}, which ring in forces of central differences'}"
            )
            found.append({"code": "contact-flexibility", "text": text})
        depth, why = _unseen_depth(run, name, body, face) if run.scene.contact[name].on_ground else (0.0, "")
        if depth > 0.0:
            text = (
                f"contact.{name}: places of {body}.{face} that carry no pressure go up to {depth:.3g} m deeper than "
                f"those that do, for {why}"
            )
            found.append({"code": "contact-unseen", "text": text})
    return found


def contact_step_warnings(run: Pipeline, errors: Mapping[str, Mapping[str, ContactError]]) -> list[dict[str, str]]:
    """Warn of contacts whose impulse or largest force is known to less than ``"auto"`` was asked for, by the step."""
    wanted, found = run.scene.simulation.error, []
    for name, own in errors.items() if run.scene.refines_contacts else ():
        for key, word in (("impulse_n_s", "impulse"), ("largest_force_n", "largest force")):
            part, size = own[key].parts["step"], float(np.linalg.norm(own[key].value))
            if isinstance(part, float) and part > SAFETY * wanted * size:
                text = (
                    f"contact.{name}: halvings of the step have brought its {word} to {100 * part / size:.2g} %, not "
                    f"to the {100 * wanted:.2g} % of simulation.error; it changes by chance, or takes a step of yours"
                )
                found.append({"code": "contact-step", "text": text})
    return found


def _grid_faults(motion: Motion) -> Iterator[str]:
    """Yield what is wrong with the grids that contacts' near fields have: too small, or too coarse."""
    planes = [(body, plane) for body in motion.mechanism.contacts for plane in body.planes]
    for body, plane in planes:
        if plane.face not in body.points.grids:
            continue
        own, key = motion.contacts[plane.name], f"contact.{plane.name}"
        pressed = own.area.max() / body.points.areas[plane.face][0]
        if own.beyond_grid:
            yield (
                f"{key}: the contact reaches the border of its near field's grid, beyond which nothing is carried; a "
                f"larger {key}.width helps, or near_field = 'mesh' where the body rolls"
            )
        elif 0.0 < pressed < FEW_POINTS:
            yield (
                f"{key}: at most {pressed:.0f} points of its near field's grid are pressed, of which {FEW_POINTS} give "
                f"the largest pressure to 2 %; a smaller {key}.width or more {key}.points help"
            )


def _pin_faults(motion: Motion) -> Iterator[str]:
    """Yield which pins press a wider part of their bores or planes than a half-space tells."""
    in_bore = (
        "the pin presses more than a quarter of its bore's round, where a half-space is too soft; flexible bodies, "
        "whose faces fit, tell it by their meshes"
    )
    on_plane = (
        "the pin is pressed into the plane with more than a quarter of its round, where deformations are too large for "
        "a half-space; a larger radius, length or E, or less of a load or speed, stays below that"
    )
    for body in motion.mechanism.contacts:
        for fault, contacts in ((on_plane, body.planes), (in_bore, body.pairs)):
            for own in contacts:
                if own.law and motion.contacts[own.name].beyond_grid:
                    yield f"contact.{own.name}: {fault}"


def _wear_faults(motion: Motion) -> Iterator[str]:
    """Yield which contacts wear deeper than they are pressed together, so that the worn shape would press elsewhere."""
    for name, own in motion.contacts.items():
        force = np.linalg.norm(own.force, axis=1)
        deep = float(np.divide(2.0 * own.energy, force, out=np.zeros(len(force)), where=force > 0.0).max())
        if 0.0 < deep < own.wear_depth[-1]:
            yield (
                f"contact.{name}: wear goes {own.wear_depth[-1]:.3g} m deep, more than the {deep:.3g} m that its "
                "surface gives way, and pressures are those of the shape as drawn; volume and mean depth hold, the "
                "largest depth spreads as surfaces fit"
            )


def _coarse_faults(motion: Motion) -> Iterator[str]:
    """Yield which contacts of curved faces press few points of the mesh, so that their force isn't sure."""
    for body in motion.mechanism.contacts:
        for name in () if body.points.has_primitives else body.names:
            own = body.points.faces[body.face_of(name)]
            gridded = body.face_of(name) in body.points.grids
            pressed = int((motion.contact_pressures[body.body][:, own] > 0.0).sum(axis=1).max())
            if not gridded and 0 < pressed < FEW_ON_MESH and not body.points.is_flat(body.face_of(name)):
                yield (
                    f"contact.{name}: at most {pressed} points of a curved face are pressed, of which {FEW_ON_MESH} "
                    "give the force to 2 % and 50 the largest pressure to 3 %; smaller elements there help"
                )


def _unseen_depth(run: Pipeline, contact: str, body: str, face: str) -> tuple[float, str]:
    """Return how much deeper than points other nodes of a face go under its plane [m], and why; 0 if that is little."""
    part, motion = run.parts[body], run.motion
    (touching,) = (own for own in motion.mechanism.contacts if own.body == body)
    (plane,) = (own for own in touching.planes if own.name == contact)
    nodes, reduced = part.markers[face].nodes, run.bodies[body]
    frame, q = motion.kinematics.frames[motion.mechanism.number_of(body)], motion.modal(body)

    def lowest(x: Array, shapes: Array) -> Array:
        along = frame.rotation.transpose(0, 2, 1) @ plane.normal
        gaps = np.einsum("ta,tna->tn", along, x + np.einsum("nam,tm->tna", shapes, q))
        return np.asarray(gaps.min(axis=1) + (frame.origin - plane.position) @ plane.normal + plane.clearance)

    own, there = touching.points.faces[face], motion.touched.places[body] if motion.touched else np.zeros((0, 0, 3))
    points = lowest(touching.points.x[own], touching.points.shapes[own])
    for t in range(len(points)) if there.shape[1] else ():
        grid = touching.points.moved_to(there[t])
        points[t] = lowest(grid.x[own], grid.shapes[own])[t]
    deeper = (np.minimum(points, 0.0) - lowest(reduced.x[nodes], reduced.shapes[nodes])).max()
    extent = float(np.ptp(touching.points.x[own], axis=0).max())
    bulge = _bulge(part, reduced.x, nodes) if motion.contacts[contact].span[0] is None else 0.0
    if bulge > 0.0 and points.min() < bulge:
        why = f"the face bulges by as much between nodes, which come within {points.min():.3g} m of the plane, and may "
        return bulge, why + "touch it unseen; smaller elements, or near_field = 'auto', help"
    why = "it tilts onto a corner; smaller elements there, or linear hexahedra, help"
    if plane.face in touching.points.grids:
        why = "it touches beside the near field's grid, which is where the face is lowest at the start; near_field = "
        why += "'mesh' follows it"
    return (float(deeper), why) if deeper > UNSEEN_DEPTH * extent else (0.0, "")


def _bulge(part: FlexiblePart, x: Array, nodes: IntArray) -> float:
    """Return how far a face is out of the chords between neighbours of its nodes, by normals at these [m]."""
    from fmd.contact.surfaces import triangle_normals

    triangles = part.surface.nodes[part.surface.triangles]
    ends = triangles[np.isin(triangles, nodes).all(axis=1)]
    normals, other = np.zeros(x.shape), np.roll(ends, 1, axis=1)
    np.add.at(normals, ends, triangle_normals(x, ends)[:, None])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    return float(((normals[other] - normals[ends]) * (x[other] - x[ends])).sum(axis=2).max(initial=0.0)) / 8.0


def distances_from(surface: Primitive, x: Array) -> Array:
    """Return how far places are from a rigid surface, negative in its body [m], (n,); infinite beyond ends of an axis.

    Places x (n, 3) are in the body's frame [m].
    """
    along, half = (x - np.array(surface.at)) @ np.array(surface.axes).T, np.array(surface.half)
    beside = along - np.clip(along, -half, half)
    apart = np.asarray(np.linalg.norm(beside, axis=1))
    if surface.kind == BOX:
        apart = np.where(apart > 0.0, apart, (np.abs(along) - half).max(axis=1))
    gaps = (surface.radius - apart) if surface.kind == BORE else apart - surface.radius
    return np.where(beside[:, 2] == 0.0, gaps, np.inf) if surface.kind >= PIN else np.asarray(gaps)


def describe_depths(run: Pipeline, motion: Motion) -> dict[str, str]:
    """Return warnings of contacts whose rigid surface goes deeper between a face's nodes than these tell, by name."""
    found = {}
    bodies = {own.body: own for own in motion.mechanism.contacts}
    for body in bodies.values():
        for pair in body.pairs:
            theirs = bodies[pair.other].points.primitives
            if body.body not in run.parts or pair.other_face not in theirs:
                continue
            surface = theirs[pair.other_face]
            size = surface.radius if surface.kind != BOX else 2.0 * (min(surface.half) + surface.radius)
            depth = _depth_between(run, motion, body, pair, surface, size)
            if depth > UNSEEN_DEPTH * size:
                found[pair.name] = (
                    f"contact.{pair.name}: {pair.other}.{pair.other_face} goes up to {depth:.3g} m deeper into "
                    f"{body.body}.{pair.face} between its nodes, which alone touch it; elements of at most "
                    f"{BETWEEN_NODES * surface.radius:.3g} m there help"
                )
    return found


def _depth_between(
    run: Pipeline, motion: Motion, body: TouchingBody, pair: ContactPair, surface: Primitive, size: float
) -> float:
    """Return by how much a face's triangles are deeper in a rigid surface of a size than its nodes are at most [m]."""
    part, reduced = run.parts[body.body], run.bodies[body.body]
    nodes, topology = part.markers[pair.face].nodes, part.surface
    triangles = topology.nodes[topology.triangles]
    triangles = triangles[np.isin(triangles, nodes).all(axis=1)]
    numbers = [motion.mechanism.number_of(name) for name in (body.body, pair.other)]
    own, other = (motion.kinematics.frames[k] for k in numbers)
    q, deepest = motion.modal(body.body), 0.0
    reach = float(np.linalg.norm(reduced.x[triangles[:, 0]] - reduced.x[triangles[:, 1]], axis=1).max(initial=0.0))
    weights = _weights(int(np.clip(PLACES_ON_SURFACE * reach / size, *PLACES_ON_SIDE)))
    for t in np.unique(np.linspace(0, len(motion.times) - 1, DEPTH_FRAMES).astype(int)):
        x = reduced.x + np.einsum("nam,m->na", reduced.shapes, q[t])
        there = (own.origin[t] + x @ own.rotation[t].T - other.origin[t]) @ other.rotation[t]
        gaps = distances_from(surface, there[triangles].reshape(-1, 3)).reshape(-1, 3) + pair.clearance
        near = gaps.min(axis=1, initial=np.inf) < reach
        if near.any():
            places = np.einsum("wc,nca->nwa", weights, there[triangles[near]]).reshape(-1, 3)
            between = float(distances_from(surface, places).min()) + pair.clearance
            deepest = max(deepest, min(0.0, float(gaps.min())) - between)
    return deepest


def _weights(count: int) -> Any:
    """Return weights of a triangle's corners at places spread over it, so many to a side."""
    return np.array([(i, j, count - i - j) for i in range(count + 1) for j in range(count + 1 - i)]) / count
