"""Faults of surfaces that touch: the side that they look to, and a material that counts for nothing."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from fmd.contact.surfaces import find_rim, node_normals
from fmd.core.limits.contact import DEPTH_FRAMES, FACE_ALIKE, FELT_OF_JOINT, RIGID_BESIDE, ROUNDED_START
from fmd.integrators.exponential import Exponential
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


def joint_faults(run: Pipeline) -> Iterator[str]:
    """Yield which joints deflect faces that are pressed by much beside the modes, which gaps don't feel.

    The deflection is weighted by the forces of contact, whose own is the measure.
    """
    motion, touched = run.motion, run.motion.touched
    if touched is None:
        return
    for body in motion.mechanism.contacts:
        ends = [
            (name, side, end.partition(".")[2])
            for name, joint in run.scene.joint.items()
            for side, end in enumerate((joint.parent, joint.child))
            if end.partition(".")[0] == body.body and joint.kind.n_rates < 6
        ]
        ends = [each for each in ends if np.abs(body.points.yields.get(each[2], np.zeros(1))).max() > 0.0]
        forces = touched.forces[body.body]
        pressed = np.flatnonzero(forces.any(axis=(1, 2))) if ends else np.zeros(0, dtype=np.int64)
        works, own = np.zeros(len(ends)), 0.0
        for k in pressed[:: -(-len(pressed) // DEPTH_FRAMES) or 1].tolist():
            part = motion.part(k, k + 1)
            R, f = part.kinematics.frames[motion.mechanism.number_of(body.body)].rotation[0], forces[k]
            own += float(np.einsum("na,namb,mb->", f, body.points.G, f))
            for j, (name, side, marker) in enumerate(ends):
                wrench = (part.joint_loads.reactions[name][0, side].reshape(2, 3) @ R).ravel()
                works[j] += np.einsum("na,nak,k->", f, body.points.yields[marker], wrench)
        for (name, _, marker), work in zip(ends, works, strict=True):
            if abs(work) > FELT_OF_JOINT * own:
                yield (
                    f"joint.{name}: what it does at {body.body}.{marker} deflects faces in contact beside the modes by "
                    f"{abs(work) / own:.0%} of what the contact does, which its gaps don't feel; more modes, or "
                    f"body.{body.body}.modes.enrich = 'inertia', have it"
                )


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
