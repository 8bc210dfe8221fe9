"""Faults of surfaces that touch: the side that they look to, a material that counts for nothing, what isn't felt."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from fmd.contact.flexibility import find_yields
from fmd.contact.surfaces import find_rim, node_normals
from fmd.contact.touching_body import TouchingBody
from fmd.core.arrays import Array
from fmd.core.limits.contact import DEPTH_FRAMES, FACE_ALIKE, RIGID_BESIDE, ROUNDED_START, UNFELT
from fmd.dynamics.elements import PointSpring, SixAxisSpring
from fmd.integrators.exponential import Exponential
from fmd.integrators.protocol import evaluate
from fmd.recovery.motion import Motion
from fmd.stages.pipeline import Pipeline
from fmd.stages.rigid_contacts import rigid_surface


def facing_faults(motion: Motion) -> Iterator[str]:
    """Yield which faces of triangles look the same way where they are nearest at the start: they pass through.

    Two closed ones don't, as they are refused inside out, though mean normals at their edges may be alike.
    """
    bodies, frames = {own.body: own for own in motion.mechanism.contacts}, motion.kinematics.frames
    for body in bodies.values():
        for pair in body.pairs:
            sides, is_open = [], False
            for name, face in ((body.body, pair.face), (pair.other, pair.other_face)):
                points, frame = bodies[name].points, frames[motion.mechanism.number_of(name)]
                if face in points.surfaces:
                    corners = np.unique(points.surfaces[face])
                    is_open |= bool(find_rim(points.surfaces[face]).any())
                    both = points.x[corners], node_normals(points, points.surfaces[face])[corners]
                    x, normals = (own @ frame.rotation[0].T for own in both)
                    sides.append((f"{name}.{face}", x + frame.origin[0], normals))
            if len(sides) < 2 or not is_open:
                continue
            (one, x, normals), (two, others, their_normals) = sides
            apart, nearest = cKDTree(others).query(x)
            if normals[k := int(apart.argmin())] @ their_normals[nearest[k]] > FACE_ALIKE:
                yield (
                    f"contact.{pair.name}: {one} and {two} look the same way where they are nearest at the start, so "
                    "that one passes through the other; corners of triangles go counter-clockwise seen from outside"
                )


def material_faults(run: Pipeline) -> Iterator[str]:
    """Yield which surfaces of rigid bodies are as soft as a face of elements that they touch, and count as rigid."""
    bodies = {own.body: own for own in run.motion.mechanism.contacts}
    for body in bodies.values():
        for pair in body.pairs:
            if pair.other_face in bodies[pair.other].points.primitives and body.points.elastic is not None:
                surface: Any = rigid_surface(run.scene, place := f"{pair.other}.{pair.other_face}")
                if RIGID_BESIDE * body.points.elastic[0] > surface.E:
                    yield (
                        f"contact.{pair.name}: {place} is rigid before a face of elements, and its E of "
                        f"{surface.E:.3g} Pa counts for nothing; a surface of type 'file' gives way there, too"
                    )


def unfelt_faults(run: Pipeline) -> Iterator[tuple[str, str]]:
    """Yield kind and text of what isn't felt beside the modes where faces touch: by gaps, or by springs' ends."""
    if run.motion.touched is None:
        return
    for body in run.motion.mechanism.contacts:
        if body.body in run.parts:
            yield from (("contact-joint", text) for text in _joint_faults(run, body))
            yield from (("contact-spring", text) for text in _spring_faults(run, body))
            yield from (
                (
                    "contact-gear",
                    f"gear_mesh.{name}: forces on the teeth of {body.body} deflect neither its modes nor its faces in "
                    "contact; a torque on its hinge and a contact of another body are free of that",
                )
                for name, own in run.scene.gear_mesh.items()
                if body.body in (own.pinion, own.wheel)
            )


def _joint_faults(run: Pipeline, body: TouchingBody) -> Iterator[str]:
    """Yield which joints deflect a body's faces that are pressed by much beside the modes, which gaps don't feel.

    The deflection is weighted by the forces of contact, whose own is the measure.
    """
    motion, (forces, places, pressed) = run.motion, _pressed_times(run.motion, body)
    ends = [
        (name, side, end.partition(".")[2])
        for name, joint in run.scene.joint.items()
        for side, end in enumerate((joint.parent, joint.child))
        if end.partition(".")[0] == body.body and joint.kind.n_rates < 6
    ]
    ends = [each for each in ends if np.abs(body.points.yields.get(each[2], np.zeros(1))).max() > 0.0]
    works, own = np.zeros(len(ends)), 0.0
    for k in pressed if ends else ():
        part = motion.part(k, k + 1)
        R, f = part.kinematics.frames[motion.mechanism.number_of(body.body)].rotation[0], forces[k]
        at, points = np.flatnonzero(f.any(axis=1)), body.points.moved_to(places[k])
        if body.travels:
            own += 2.0 * sum(float(motion.contacts[name].energy[k]) for name in body.names)
        else:
            own += float(np.einsum("na,namb,mb->", f[at], body.points.between(at), f[at]))
        for j, (name, side, marker) in enumerate(ends):
            wrench = (part.joint_loads.reactions[name][0, side].reshape(2, 3) @ R).ravel()
            works[j] += np.einsum("na,nak,k->", f, points.yields[marker], wrench)
    for (name, _, marker), work in zip(ends, works, strict=True):
        if abs(work) > UNFELT * own:
            yield (
                f"joint.{name}: what it does at {body.body}.{marker} deflects faces in contact beside the modes by "
                f"{abs(work) / own:.0%} of what the contact does, which its gaps don't feel; more modes, or "
                f"body.{body.body}.modes.enrich = 'inertia', have it"
            )


def _spring_faults(run: Pipeline, body: TouchingBody) -> Iterator[str]:
    """Yield which springs, bushings and bearings would be stretched otherwise by what they don't feel of a body.

    That is what contacts, loads and force elements deflect at their ends beside the modes, weighted by their own
    forces, whose work over their own stretch is the measure.
    """
    motion, part = run.motion, run.parts[body.body]
    forces, places, pressed = _pressed_times(motion, body)
    given = [(f"{kind}.{key}", at.between) for kind, table in run.scene.elements.items() for key, at in table.items()]
    ends = [
        (key, element, side, end.partition(".")[2])
        for (key, between), element in zip(given, motion.mechanism.elements, strict=False)  # gears' teeth come last
        for side, end in enumerate(between)
        if end.partition(".")[0] == body.body and pressed
    ]
    if not ends:
        return
    loaded, all_nodes = {name: part.markers[name] for name in body.felt}, np.arange(len(part.fe.x))
    solver = part.model.solver_on_joint(part.contact_faces)
    yields = np.dstack([*find_yields(part.fe, solver, part.body, all_nodes, loaded).values()])
    felt, p, a = np.empty((len(pressed), yields.shape[2])), run.system.parameters, np.zeros(run.system.n)
    number, own = motion.mechanism.number_of(body.body), list(motion.mechanism.contacts).index(body)
    for row, k in zip(felt, pressed, strict=True):
        evaluate(p, float(motion.times[k]), motion.trajectory.q[k].copy(), motion.trajectory.v[k].copy(), a)
        row[:] = p.contact.felt[own, : len(row)]
    R = motion.kinematics.frames[number].rotation[pressed]
    for key, element, side, marker in ends:
        wrenches, strain = motion.kinematics.wrenches(element)[pressed], motion.kinematics.strain(element)[0][pressed]
        flat = np.einsum("tkb,tba->tka", wrenches[:, side].reshape(-1, 2, 3), R).reshape(-1, 6)
        own_yields = np.einsum("nak,nam->km", loaded[marker].columns(len(all_nodes), np.eye(3)), yields)
        by_points = [body.points.moved_to(places[k]).yields[marker] for k in pressed]
        moved = felt @ own_yields.T + np.einsum("tna,tnak->tk", forces[pressed], by_points)
        if isinstance(element, PointSpring):
            stretch = np.abs(element.law.forces(strain[:, 0], np.zeros(len(strain))) * strain[:, 0])
        elif isinstance(element, SixAxisSpring):
            stretch = np.einsum("ti,ij,tj->t", strain, element.K[: strain.shape[1], : strain.shape[1]], strain)
        unfelt = np.abs((flat * moved).sum(axis=1)).sum()
        if unfelt > UNFELT * stretch.sum() > 0.0:  # none of dampers
            yield (
                f"{key}: what forces deflect at {body.body}.{marker} beside the modes is "
                f"{unfelt / stretch.sum():.0%} of its stretch, which it doesn't feel; more modes, or "
                f"body.{body.body}.modes.enrich = 'inertia', have it"
            )


def _pressed_times(motion: Motion, body: TouchingBody) -> tuple[Array, Array, list[int]]:
    """Return the forces on a body's points, their places, (n_times, n, 3) each, and some times at which there are any.

    Places are of grids that travel alone.
    """
    if motion.touched is None:
        return np.zeros((0, 0, 3)), np.zeros((0, 0, 3)), []
    forces, places = motion.touched.forces[body.body], motion.touched.places[body.body]
    pressed = np.flatnonzero(forces.any(axis=(1, 2)))
    return forces, places, pressed[:: -(-len(pressed) // DEPTH_FRAMES) or 1].tolist()


def start_faults(run: Pipeline) -> Iterator[str]:
    """Yield which contacts press from the start though nothing balances what presses them there, and so ring."""
    (q, v), system, motion = run.start, run.system, run.motion
    if run.scene.simulation.start == "equilibrium" or v.any():
        return
    pushed = bool(system.compiled.residual(0.0, q, v, v).any())
    soon = 2.0 * max(motion.trajectory.step, system.shock_step) if pushed else 0.0
    for name, own in motion.contacts.items():
        begin, _ = own.span
        presses = pushed or np.linalg.norm(own.force[0]) > ROUNDED_START * own.largest[0]
        if presses and begin is not None and begin <= soon:
            yield (
                f"contact.{name}: presses from the start, undeformed under its loads, and rings about their balance; "
                "simulation.start = 'equilibrium' begins there, if bodies can rest"
            )


def spread_faults(run: Pipeline) -> Iterator[str]:
    """Yield which runs take steps that keep the energy of contacts at a length that spreads their forces."""
    for motion in run.motions.values():
        step, longest = motion.trajectory.step, run.system.shock_step
        if motion.trajectory.integrator == Exponential.name and step > longest:
            yield (
                f"steps of {step:.3g} s keep the energy of contacts, but spread the forces of shocks, which rise in "
                f"{longest:.3g} s; simulation.step = '{longest:.2g} s' resolves them"
            )
