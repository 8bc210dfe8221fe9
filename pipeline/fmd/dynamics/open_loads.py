"""Loads that the motion of rigid bodies leaves open: those of joints whose loops are redundant, and of force elements.

A bar between two walls is stretched by its own deflection, whatever rigid bodies would do there. Such loads are states
of self-stress: Lagrange multipliers λ of the constraints with ``Jᵀ λ = 0``, and the force of each element, which its
ends hand on to all that carries them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.mechanism import OPEN_MOMENTS
from fmd.core.limits.rank import DEPENDENT_CONSTRAINT, SELF_STRESS_PART
from fmd.core.rotations import BodyFrame
from fmd.dynamics.closures import Closure, Coupler, Place
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.transmitted_loads import ELEMENT, loaded_places

_KNOWN = ("", 0)  # key of a point load


@dataclass(frozen=True)
class SelfStress:
    """A state of self-stress, over its largest component.

    Attributes
    ----------
    wrenches : tuple of ndarray, shapes (n_loads, 6)
        On each body in its own axes, in the order of `BodyLoads.wrenches`.
    joints : tuple of ndarray, shape (6,)
        Force and moment of the joint that carries each body, in its axes.
    compliance : float
        Twice the elastic energy of its force element [J].
    """

    wrenches: tuple[Array, ...]
    joints: tuple[Array, ...]
    compliance: float


State = Mapping[tuple[str, int], Array]
"""Force and moment (6,) in space on places of joints that close loops and of elements, by name and number of place."""


def open_loads(rigid: Mechanism, times: Array, q: Array) -> list[Array]:
    """Return which components of the loads on each body are left open by the motion of rigid bodies.

    Parameters
    ----------
    rigid : Mechanism
        With all bodies rigid, and all of its constraints.
    times, q : ndarray, shapes (n_times,) and (n_times, n_positions)
        Its motion.

    Returns
    -------
    list of ndarray of bool, shapes (n_loads, 6)
        For each body, in its own axes and in the order of `BodyLoads.wrenches`.
    """
    counts = [len(_places_on(rigid, body)) for body in range(len(rigid.links))]
    found = [np.zeros((count, 6), dtype=bool) for count in counts]
    for k in np.unique(np.linspace(0, len(times) - 1, OPEN_MOMENTS).astype(int)):
        motion = Kinematics(rigid, times[k : k + 1], q[k : k + 1], np.zeros((1, rigid.n)))
        for state, _ in (*_self_stress(motion), *_of_elements(motion)):
            parts = _hand_on(motion, state, 0.0).wrenches
            found = [own | (np.abs(new) > SELF_STRESS_PART) for own, new in zip(found, parts, strict=True)]
    return found


def self_stresses(motion: Kinematics) -> list[SelfStress]:
    """Return the states of self-stress of a mechanism of rigid bodies at a moment, and units of its bushings' loads."""
    states = [*_self_stress(motion), *_of_elements(motion)]
    return [_hand_on(motion, state, compliance) for state, compliance in states if np.isfinite(compliance)]


def largest_residual(rigid: Mechanism, times: Array, q: Array) -> float:
    """Return the largest residual by which a motion of rigid bodies opens joints that close loops [m, or rad]."""
    largest = 0.0
    for k in np.unique(np.linspace(0, len(times) - 1, OPEN_MOMENTS).astype(int)):
        motion = Kinematics(rigid, times[k : k + 1], q[k : k + 1], np.zeros((1, rigid.n)))
        for closure in rigid.closing_joints:
            first, second, apart = _places_of(motion, closure)
            axes = closure.along if len(closure.along) == 3 else closure.along @ first.T
            residuals = [
                *(axes @ apart),
                *(sum(first @ a @ (second @ b) for a, b in pairs) for pairs in closure.square),
            ]
            residuals += [np.linalg.norm(apart) - closure.distance] if closure.distance else []
            largest = max([largest, *(abs(residual) for residual in residuals)])
    return float(largest)


def _self_stress(motion: Kinematics) -> Iterator[tuple[State, float]]:
    """Yield states of self-stress of the joints that close loops, at a moment of the motion."""
    rows = [row for closure in motion.mechanism.closing_joints for row in _row_wrenches(motion, closure)]
    if not rows:
        return
    J = np.concatenate([_work_at_unit_rates(motion, rows), _of_couplers(motion.mechanism)])
    U, sizes, _ = np.linalg.svd(J[:, _loose(motion.mechanism)])
    rank = int((sizes > DEPENDENT_CONSTRAINT * max(sizes.max(initial=0.0), 1.0)).sum())
    for state in U[: len(rows), rank:].T:
        total: dict[tuple[str, int], Array] = {}
        for size, row in zip(state, rows, strict=True):
            for key, wrench in row.items():
                total[key] = total.get(key, np.zeros(6)) + size * wrench
        yield total, 0.0


def _row_wrenches(motion: Kinematics, closure: Closure) -> list[State]:
    """Return force and moment in space of a unit multiplier of each constraint of a joint, on its two places."""
    first, second, apart = _places_of(motion, closure)
    pairs: list[tuple[Array, Array]] = []  # force on the second place, moment on the first
    for direction in closure.along:
        d = direction if len(closure.along) == 3 else first @ direction
        pairs.append((d, np.cross(d, apart)))
    turns = [np.sum([np.cross(first @ a, second @ b) for a, b in pairs], axis=0) for pairs in closure.square]
    rows = [_on_both(closure, -d, m, d, np.zeros(3)) for d, m in pairs]
    rows += [_on_both(closure, np.zeros(3), c, np.zeros(3), -c) for c in turns]
    if closure.distance:
        rows.append(_on_both(closure, -apart, np.zeros(3), apart, np.zeros(3)))
    return [row for number, row in enumerate(rows) if number not in closure.left_out]


def _places_of(motion: Kinematics, closure: Closure) -> tuple[Array, Array, Array]:
    """Return the rotations of a joint's two bodies at a moment, and the vector from its first place to its second."""
    one, other = (_frame_of(motion, place) for place in (closure.first, closure.second))
    first, second = one.rotation[0], other.rotation[0]
    apart = other.origin[0] + second @ closure.second.marker.position
    return first, second, np.asarray(apart - one.origin[0] - first @ closure.first.marker.position)


def _on_both(closure: Closure, force: Array, moment: Array, other_force: Array, other_moment: Array) -> State:
    return {
        (closure.name, 0): np.concatenate([force, moment]),
        (closure.name, 1): np.concatenate([other_force, other_moment]),
    }


def _work_at_unit_rates(motion: Kinematics, rows: Sequence[State]) -> Array:
    """Return the power of each row's forces at each unit rate of the joints, shape (n_rows, n)."""
    rigid, n = motion.mechanism, motion.mechanism.n
    rates = np.concatenate([np.eye(n), np.zeros((1, n))])
    moving = Kinematics(rigid, np.repeat(motion.times, n + 1), np.repeat(motion.q, n + 1, axis=0), rates)
    velocities: dict[tuple[str, int], Array] = {}
    for closure in rigid.closing_joints:
        for side, place in enumerate((closure.first, closure.second)):
            frame = _frame_of(moving, place)
            arm = frame.rotation @ place.marker.position
            both = np.concatenate([frame.velocity + np.cross(frame.spin, arm), frame.spin], axis=1)
            velocities[closure.name, side] = both[:-1] - both[-1]  # less that of prescribed motions
    powers = [sum((velocities[key] @ wrench for key, wrench in row.items()), np.zeros(n)) for row in rows]
    return np.array(powers).reshape(len(rows), n)


def _of_couplers(rigid: Mechanism) -> Array:
    """Return the rates' factors in the mechanism's couplers, shape (n_couplers, n)."""
    couplers = [closure for closure in rigid.closures if isinstance(closure, Coupler)]
    J = np.zeros((len(couplers), rigid.n))
    for row, coupler in zip(J, couplers, strict=True):
        for name, factor in zip(coupler.joints, coupler.factors, strict=True):
            number = rigid.number_of(name)
            if rigid.links[number].motion is None:
                row[rigid.layout.rate[number]] += factor
    return J


def _loose(rigid: Mechanism) -> IntArray:
    """Rates of the joints without springs."""
    parts = [
        np.arange(at, at + link.n_rates)
        for link, at in zip(rigid.links, rigid.layout.rate, strict=True)
        if not (link.spring or link.laws)
    ]
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])


def _of_elements(motion: Kinematics) -> Iterator[tuple[State, float]]:
    """Yield unit forces and moments of each force element, with its compliance; infinite if it isn't constant."""
    for element in motion.mechanism.elements:
        frames = [_frame_of(motion, end) for end in element.ends]
        first, second = (frame.origin[0] + frame.rotation[0] @ end.marker.position
                         for frame, end in zip(frames, element.ends, strict=True))  # fmt: skip
        units = element.unit_loads(second - first, frames[0].rotation[0] @ element.ends[0].axes)
        for unit, compliance in units:
            yield {(f"{ELEMENT}{element.name}", 0): -unit, (f"{ELEMENT}{element.name}", 1): unit}, compliance


def _hand_on(motion: Kinematics, state: State, compliance: float) -> SelfStress:
    """Return the loads on each body, from the leaves to the ground, over the largest."""
    mechanism, frames = motion.mechanism, motion.frames
    joints: dict[int, Array] = {}  # force and moment on a body at its origin, in space
    loads: dict[int, Array] = {}
    for body in reversed(range(len(mechanism.links))):
        frame, pulls = frames[body], [np.zeros((0, 6))]
        load = np.zeros(6)
        for key, place in _places_on(mechanism, body):
            if isinstance(key, int):
                pull = -joints[key]
                pull[3:] += np.cross(frames[key].origin[0] - frame.origin[0] - frame.rotation[0] @ place, pull[:3])
            else:
                pull = np.asarray(state.get(key, np.zeros(6)))
            pulls.append(np.concatenate([frame.rotation[0].T @ pull[:3], frame.rotation[0].T @ pull[3:]])[None])
            load -= pull
            load[3:] -= np.cross(frame.rotation[0] @ place, pull[:3])
        joints[body], loads[body] = load, np.concatenate(pulls)
    largest = max(max((np.abs(own).max(initial=0.0) for own in loads.values()), default=0.0), 1e-300)
    bodies = range(len(mechanism.links))
    by_joints = [np.ravel(joints[k].reshape(2, 3) @ frames[k].rotation[0]) for k in bodies]
    return SelfStress(
        tuple(loads[k] / largest for k in bodies), tuple(each / largest for each in by_joints), compliance / largest**2
    )


def _places_on(mechanism: Mechanism, body: int) -> list[tuple[int | tuple[str, int], Array]]:
    """Places of loads on a body, in the order of `BodyLoads.wrenches`: of a carried body its number is the key."""
    carried, points, joined = loaded_places(mechanism, body)
    places: list[tuple[int | tuple[str, int], Array]] = [(k, mechanism.links[k].place) for k in carried]
    places += [(_KNOWN, load.place) for load in points]
    return places + [((name, side), at.position) for name, side, at in joined]


def _frame_of(motion: Kinematics, place: Place) -> BodyFrame:
    """Return the frame of a place's body, or the ground's."""
    numbers = {link.name: k for k, link in enumerate(motion.mechanism.links)}
    if place.body in numbers:
        return motion.frames[numbers[place.body]]
    still = np.zeros((len(motion.q), 3))
    return BodyFrame(still, np.broadcast_to(np.eye(3), (len(still), 3, 3)), still, still)
