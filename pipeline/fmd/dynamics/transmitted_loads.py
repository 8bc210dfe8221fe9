"""Loads that pass through the bodies of a mechanism in motion, and the geometric stiffness that they cause.

From the leaves to the ground, Newton's and Euler's laws give what each joint transmits, by the rates of the momenta::

    F = Ṗ + ω × P − m g − (loads and what children pull with)        M = L̇ + ω × L + V × P − …
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.mechanism import LEAST_SHARE
from fmd.core.limits.memory import MOST_FORMS
from fmd.core.limits.round_off import SOLVED
from fmd.core.recently_used import RecentlyUsed
from fmd.core.rotations import turned
from fmd.dynamics.closures import Closure, Place
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.links import Link, PointLoad
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.reactions import closing_reactions
from fmd.reduction.body import FlexibleBody, MarkerShapes

AnyPlace = TypeVar("AnyPlace", bound=Place)

ELEMENT = "element "
"""What is before a force element's name, which may be that of a joint too."""


@dataclass(frozen=True)
class BodyLoads:
    """Loads on one body over a motion, in its own axes."""

    spin: Array  # (n_times, 3): angular velocity [rad/s]
    turning: Array  # (n_times, 3): angular acceleration [rad/s²]
    acceleration: Array  # (n_times, 3): acceleration of its frame less that of free fall [m/s²]
    # (n_loads, n_times, 6): force [N] and moment [N m] of each body that it carries, then of each point load on it,
    # then of each joint on it that closes a loop, then of each force element's end on it
    wrenches: Array
    joint: Array  # (n_times, 6): force and moment of the joint that carries it, at its origin
    # (n_loads, 6): components of ``wrenches`` that the motion of rigid bodies leaves open, as `open_loads` finds them
    open: Array

    def within(self, some: slice) -> BodyLoads:
        """Return the loads at some of the times alone."""
        over_times = (self.spin, self.turning, self.acceleration, self.wrenches.swapaxes(0, 1), self.joint)
        spin, turning, acceleration, wrenches, joint = (values[some] for values in over_times)
        return BodyLoads(spin, turning, acceleration, wrenches.swapaxes(0, 1), joint, self.open)


def transmitted_loads(motion: Kinematics) -> list[BodyLoads]:
    """Compute the loads on each body of a mechanism over a motion that is sampled finely enough for its rates."""
    return transmitted_loads_of([motion])[0]


def transmitted_loads_of(motions: Sequence[Kinematics]) -> list[list[BodyLoads]]:
    """Compute the loads over motions at the same times of mechanisms that differ in numbers of joints alone."""
    times, count = motions[0].times, len(motions)
    q, v = (np.concatenate([getattr(own, name) for own in motions]) for name in ("q", "v"))
    motion = Kinematics(motions[0].mechanism, np.tile(times, count), q, v)
    mechanism, frames = motion.mechanism, motion.frames
    reactions = closing_reactions(mechanism, motion.times, motion.q, motion.v)
    reactions |= {f"{ELEMENT}{each.name}": motion.wrenches(each) for each in mechanism.elements}
    joints: dict[int, tuple[Array, Array]] = {}  # force and moment on a body at its origin, in space
    found: dict[int, BodyLoads] = {}
    into_bodies = [frame.rotation.swapaxes(1, 2) for frame in frames]
    moving = [
        (turned(into_body, frame.velocity), turned(into_body, frame.spin), momenta.linear, momenta.angular)
        for into_body, frame, momenta in zip(into_bodies, frames, motion.momenta, strict=True)
    ]
    values = np.array(moving)  # (n_bodies, 4, all times of all motions, 3)
    apart = values.reshape(*values.shape[:2], count, len(times), 3)
    rates = np.gradient(apart, times, axis=3, edge_order=2).reshape(values.shape)
    for body in reversed(range(len(mechanism.links))):
        frame, into_body, weight = frames[body], into_bodies[body], into_bodies[body] @ mechanism.gravity
        velocity, spin, linear, angular = moving[body]
        acceleration = rates[body, 0] + np.cross(spin, velocity) - weight
        loaded = loaded_places(mechanism, body)
        pulls = [_on_carrier(motion, k, *joints[k]) for k in loaded.carried]
        pulls += [_of_load(motion, body, at) for at in loaded.loads]
        pulls += [(reactions[name][:, side, :3], reactions[name][:, side, 3:]) for name, side, _ in loaded.joined]
        wrenches = np.array([np.concatenate([turned(into_body, part) for part in pull], axis=1) for pull in pulls])
        wrenches = wrenches.reshape(len(pulls), len(motion.times), 6)
        # Force and moment about its origin by which its joint moves it and what it carries.
        force = rates[body, 2] + np.cross(spin, linear) - mechanism.links[body].integrals.mass * weight
        moment = rates[body, 3] + np.cross(spin, angular) + np.cross(velocity, linear)
        moment = moment - np.cross(motion.momenta[body].moment, weight)
        for at, wrench in zip(loaded.markers, wrenches, strict=True):
            force = force - wrench[:, :3]
            moment = moment - wrench[:, 3:] - np.cross(at.position, wrench[:, :3])
        found[body] = BodyLoads(
            spin,
            rates[body, 1],
            acceleration,
            wrenches,
            np.concatenate([force, moment], axis=1),
            np.zeros((len(pulls), 6), dtype=bool),
        )
        joints[body] = turned(frame.rotation, force), turned(frame.rotation, moment)
    parts = [slice(first, first + len(times)) for first in range(0, len(motion.times), len(times))]
    return [[found[body].within(part) for body in range(len(mechanism.links))] for part in parts]


def geometric_stiffness_over(mechanism: Mechanism, body: int, loads: BodyLoads) -> Array:
    """Return what loads add to the modal stiffness of a body, shape (n_times, n, n) [1/s²]."""
    link = mechanism.links[body]
    integrals, n = link.integrals, len(link.omega)
    markers = loaded_places(mechanism, body).markers
    terms = [(-wrench, at.displacement2) for wrench, at in zip(loads.wrenches, markers, strict=True)]
    if link.joint_displacement2.size:
        moment = loads.joint[:, 3:] @ link.axis / np.linalg.norm(link.axis)
        terms.append((-moment[:, None], link.joint_displacement2[None]))
    terms += [
        (_spin_products(loads.spin).reshape(-1, 9), integrals.stiffening.reshape(9, *integrals.stiffening.shape[2:])),
        (loads.acceleration, integrals.displacement2),
        (loads.turning, integrals.rotation2),
    ]
    there = [(values, forms) for values, forms in terms if forms.size]
    if not there:
        return np.zeros((len(loads.spin), n, n))
    forms = np.concatenate([forms for _, forms in there])
    values = np.concatenate([values for values, _ in there], axis=1)
    return np.asarray(np.tensordot(values, 0.5 * (forms + forms.swapaxes(1, 2)), 1))


def change_by_inertia(body: FlexibleBody, loads: BodyLoads) -> float:
    """Estimate from above the part by which a stiffened body's own inertia changes its stiffness under its loads."""
    integrals, n = body.integrals, len(body.omega)
    terms = (
        (integrals.displacement2, loads.acceleration),
        (integrals.rotation2, loads.turning),
        (integrals.stiffening.reshape(9, *integrals.stiffening.shape[2:]), _spin_products(loads.spin).reshape(-1, 9)),
    )
    return float(
        sum(_sizes(forms, body.omega) @ np.abs(values).max(axis=0) for forms, values in terms if forms.size and n)
    )


# By the forms and frequencies: the same for all points of a sweep.
_known_sizes: RecentlyUsed[Array] = RecentlyUsed(MOST_FORMS)


def _sizes(forms: Array, omega: Array) -> Array:
    """Return the largest part of the modal stiffness that each of some quadratic forms (k, n, n) is, shape (k,)."""

    def find() -> Array:
        return np.asarray(np.abs(np.linalg.eigvalsh(forms / np.outer(omega, omega))).max(axis=1))

    return _known_sizes.get((forms.shape, forms.tobytes(), omega.tobytes()), find)


def _spin_products(spin: Array) -> Array:
    """Return ``ω² 1 − ω ωᵀ`` of angular velocities (n_times, 3), shape (n_times, 3, 3)."""
    return np.asarray((spin**2).sum(axis=1)[:, None, None] * np.eye(3) - spin[:, :, None] * spin[:, None, :])


def without_negligible_terms(mechanism: Mechanism, body: int, loads: BodyLoads, tolerance: float) -> Mechanism:
    """Leave out terms of second order that change a body's stiffness by less than a part of it under its loads.

    A component of a load counts as a tenth of the whole at least, since vibration adds to it. Those that are open stay.
    """
    links, points = list(mechanism.links), list(mechanism.loads)
    omega = links[body].omega

    def counting(forms: Array, values: Array, stays: Array | bool = False) -> Array:
        """Quadratic forms (k, n, n) of loads (n_times, k), zero where they don't count; empty if none does."""
        if not forms.size:
            return forms
        peaks = np.abs(values).max(axis=0)
        counts = (_sizes(forms, omega) * np.maximum(peaks, LEAST_SHARE * peaks.max()) > tolerance) | stays
        return np.where(counts[:, None, None], forms, 0.0) if counts.any() else forms[:, :0, :0]

    def counting_displacement2(displacement2: Array, wrench: Array, unknown: Array) -> Array:
        stays = unknown
        if displacement2.size and unknown.any():
            sizes = _sizes(displacement2, omega)
            stays = unknown & (sizes > SOLVED * sizes.max())
        parts = [counting(displacement2[k : k + 3], wrench[:, k : k + 3], stays[k : k + 3]) for k in (0, 3)]
        n = max(part.shape[1] for part in parts)
        return np.concatenate([part if part.size else np.zeros((3, n, n)) for part in parts])

    links[body] = _sift_own_terms(links[body], loads, counting)
    wrenches = zip(loads.wrenches, loads.open, strict=True)

    def counting_marker(at: MarkerShapes) -> MarkerShapes:
        return replace(at, displacement2=counting_displacement2(at.displacement2, *next(wrenches)))

    for k, link in enumerate(links):
        if link.parent == body:
            links[k] = replace(link, place=counting_marker(link.place))
    for k, load in enumerate(points):
        if load.body == links[body].name:
            points[k] = replace(load, marker=counting_marker(load.marker))

    def counting_place(place: AnyPlace) -> AnyPlace:
        return replace(place, marker=counting_marker(place.marker)) if place.body == links[body].name else place

    closures, elements = list(mechanism.closures), list(mechanism.elements)
    for k, closure in enumerate(closures):
        if isinstance(closure, Closure):
            first, second = counting_place(closure.first), counting_place(closure.second)
            closures[k] = replace(closure, first=first, second=second)
    for k, element in enumerate(elements):
        if not element.stiffens:
            continue
        elements[k] = replace(element, ends=(counting_place(element.ends[0]), counting_place(element.ends[1])))
    return replace(mechanism, links=links, loads=points, closures=closures, elements=elements)


def _sift_own_terms(link: Link, loads: BodyLoads, counting: Callable[[Array, Array], Array]) -> Link:
    """Leave out what doesn't count of a link's terms by its accelerations, its spin and the force in its joint."""
    integrals, axis = link.integrals, link.axis / np.linalg.norm(link.axis)
    integrals = replace(
        integrals,
        displacement2=counting(integrals.displacement2, loads.acceleration),
        rotation2=counting(integrals.rotation2, loads.turning),
    )
    n, products = len(link.omega), _spin_products(loads.spin)
    if integrals.stiffening.size and not counting(integrals.stiffening.reshape(9, n, n), products.reshape(-1, 9)).size:
        G = integrals.G.copy()
        G[:, :, 1:, 1:] += integrals.stiffening
        integrals = replace(integrals, G=G, stiffening=integrals.stiffening[:, :, :0, :0])
    joint_displacement2 = link.joint_displacement2
    if joint_displacement2.size:
        joint_displacement2 = counting(joint_displacement2[None], (loads.joint[:, 3:] @ axis)[:, None])[0]
    return replace(link, integrals=integrals, joint_displacement2=joint_displacement2)


class LoadedPlaces(NamedTuple):
    """Places of a body at which something acts on it, in the order of `BodyLoads.wrenches`."""

    carried: list[int]  # numbers of the bodies that it carries
    loads: list[PointLoad]
    # Of each joint that closes a loop, and of each force element, its name, the number of its place, and the marker.
    joined: list[tuple[str, int, MarkerShapes]]
    markers: list[MarkerShapes]


def loaded_places(mechanism: Mechanism, body: int) -> LoadedPlaces:
    """Return the places of a body at which something acts on it."""
    carried, name = [k for k, other in enumerate(mechanism.links) if other.parent == body], mechanism.links[body].name
    pairs = [(joint.name, (joint.first, joint.second)) for joint in mechanism.closing_joints]
    pairs += [(f"{ELEMENT}{element.name}", element.ends) for element in mechanism.elements if element.stiffens]
    joined = [
        (key, side, place.marker) for key, places in pairs for side, place in enumerate(places) if place.body == name
    ]
    loads = [load for load in mechanism.loads if load.body == name]
    markers = [mechanism.links[k].place for k in carried] + [load.marker for load in loads]
    return LoadedPlaces(carried, loads, joined, markers + [at for *_, at in joined])


def _on_carrier(motion: Kinematics, body: int, force: Array, moment: Array) -> tuple[Array, Array]:
    """Force and moment by which a body pulls at the place of its joint on the one that carries it, in space."""
    link = motion.mechanism.links[body]
    carrier = motion.frames[link.parent]
    place = carrier.origin + carrier.rotation @ link.place.position
    return -force, -moment - np.cross(motion.frames[body].origin - place, force)


def _of_load(motion: Kinematics, body: int, load: PointLoad) -> tuple[Array, Array]:
    """Force and moment of a point load at its place, in space."""
    frame, size = motion.frames[body], load.size.values(motion.times)[:, :1]
    if load.effort is not None:
        size = size + motion.effort(load.effort)[:, None]
    direction = load.direction / np.linalg.norm(load.direction)
    values = size * (frame.rotation @ direction if load.following else direction)
    return (np.zeros_like(values), values) if load.torque else (values, np.zeros_like(values))
