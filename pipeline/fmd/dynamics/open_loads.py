"""Loads that the motion of rigid bodies leaves open: those of joints whose loops are redundant, and of force elements.

A bar between two walls is stretched by its own deflection, whatever rigid bodies would do there. Such loads are states
of self-stress: Lagrange multipliers λ of the constraints with ``Jᵀ λ = 0``, and the force of each element, which its
ends hand on to all that carries them. The share of both walls is as each side's stiffness has it: the bodies take their
elastic energy as small as self-stresses s can make it (Castigliano's principle of least work)::

    Σ_bodies Σ_modes (f + g s)² / ω²  +  Σ_elements sᵀ K⁻¹ s   →   min

with the modal forces f of the loads that are known, and g of unit self-stresses.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from fmd.core.arrays import EPSILON, Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.mechanism import OPEN_MOMENTS, SHARED_MOMENTS
from fmd.core.limits.rank import DEPENDENT_CONSTRAINT, SELF_STRESS_PART
from fmd.core.limits.round_off import SOLVED
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.transmitted_loads import ELEMENT, BodyLoads, loaded_places

_KNOWN = ("", 0)  # key of a point load


@dataclass(frozen=True)
class SelfStress:
    """A state of self-stress, over its largest component."""

    wrenches: tuple[Array, ...]  # (n_loads, 6): on each body in its own axes, in the order of `BodyLoads.wrenches`
    joints: tuple[Array, ...]  # (6,): force and moment of the joint that carries each body, in its axes
    compliance: float  # twice the elastic energy of its force element [J]


State = Mapping[tuple[str, int], Array]
"""Force and moment (6,) in space on places of joints that close loops and of elements, by name and number of place."""


def open_loads(rigid: Mechanism, times: Array, q: Array) -> list[Array]:
    """Return which components of the loads on each body are left open by the motion of rigid bodies, (n_loads, 6).

    They are in the body's axes, in the order of `BodyLoads.wrenches`; ``rigid`` has all constraints.
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
    if not rigid.closing_joints:
        return 0.0
    some = np.unique(np.linspace(0, len(times) - 1, OPEN_MOMENTS).astype(int))
    found = Kinematics(rigid, times[some], q[some], np.zeros((len(some), rigid.n))).constraints
    return float(np.abs(found.residuals[:, : len(found.joints)]).max(initial=0.0))


def _self_stress(motion: Kinematics) -> Iterator[tuple[State, float]]:
    """Yield states of self-stress of the joints that close loops, at a moment of the motion."""
    rigid, found, n = motion.mechanism, motion.constraints, motion.mechanism.n
    if not found.joints:
        return
    states = (np.repeat(motion.times, n + 1), np.repeat(motion.q, n + 1, axis=0), np.eye(n + 1, n))
    rates = Kinematics(rigid, *states).constraints.rates
    J = (rates[:-1] - rates[-1]).T  # less those of prescribed motions
    U, sizes, _ = np.linalg.svd(J[:, _loose(rigid)])
    rank = int((sizes > DEPENDENT_CONSTRAINT * max(sizes.max(initial=0.0), 1.0)).sum())
    for state in U[: len(found.joints), rank:].T:
        total: dict[tuple[str, int], Array] = {}
        for size, name, pair in zip(state, found.joints, found.wrenches[0], strict=True):
            for side, wrench in enumerate(pair):
                total[name, side] = total.get((name, side), np.zeros(6)) + size * wrench
        yield total, 0.0


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
        first, second = (motion.place_motion(end) for end in element.ends)
        units = element.unit_loads(second.origin[0] - first.origin[0], first.rotation[0] @ element.ends[0].axes)
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
    carried, loads, joined, markers = loaded_places(mechanism, body)
    keys: list[int | tuple[str, int]] = [*carried, *[_KNOWN] * len(loads), *((name, side) for name, side, _ in joined)]
    return [(key, at.position) for key, at in zip(keys, markers, strict=True)]


def share_open_loads(mechanism: Mechanism, motion: Kinematics, loads: Sequence[BodyLoads]) -> list[BodyLoads]:
    """Return the loads on each body with those that the motion of rigid bodies leaves open as stiffness shares them.

    The motion has all bodies rigid, under all constraints.
    """
    count, rigid = len(motion.times), motion.mechanism
    moments = np.unique(np.linspace(0, count - 1, SHARED_MOMENTS).astype(int))
    wrenches = [np.zeros((len(moments), len(own.wrenches), 6)) for own in loads]
    joints = [np.zeros((len(moments), 6)) for _ in loads]
    for number, k in enumerate(moments):
        states = self_stresses(Kinematics(rigid, motion.times[k : k + 1], motion.q[k : k + 1], np.zeros((1, rigid.n))))
        sizes = _least_work(mechanism, loads, states, int(k))
        for size, state in zip(sizes, states, strict=True):
            for body in range(len(loads)):
                wrenches[body][number] += size * state.wrenches[body]
                joints[body][number] += size * state.joints[body]
    return [
        replace(
            own,
            wrenches=own.wrenches + np.moveaxis(_between(moments, wrench, count), 0, 1),
            joint=own.joint + _between(moments, joint, count),
        )
        for own, wrench, joint in zip(loads, wrenches, joints, strict=True)
    ]


def _least_work(mechanism: Mechanism, loads: Sequence[BodyLoads], states: Sequence[SelfStress], k: int) -> Array:
    """Return the size of each state of self-stress at a moment."""
    known, by_states = [np.zeros(0)], [np.zeros((0, len(states)))]
    for body, link in enumerate(mechanism.links):
        if not len(link.omega):
            continue
        f = _of_inertia(mechanism, body, loads[body], k) + _modal(mechanism, body, loads[body].wrenches[:, k])
        known.append(f / link.omega)
        parts = [_modal(mechanism, body, state.wrenches[body]) / link.omega for state in states]
        by_states.append(np.array(parts).reshape(len(states), len(link.omega)).T)
    by_states.append(np.diag([np.sqrt(state.compliance) for state in states]))
    known.append(np.zeros(len(states)))
    G = np.concatenate(by_states)
    return np.asarray(-np.linalg.lstsq(G, np.concatenate(known), rcond=SOLVED)[0])


def _modal(mechanism: Mechanism, body: int, wrenches: Array) -> Array:
    """Return the modal forces (n,) of loads (n_loads, 6) on a body, in its axes; of round-off there are none.

    A mode that stretches a body has rotations of round-off alone: what counts is the size of all modes together.
    """
    f, sizes = np.zeros((2, len(mechanism.links[body].omega)))
    for wrench, at in zip(wrenches, loaded_places(mechanism, body).markers, strict=True):
        for part, shape in ((wrench[:3], at.translation), (wrench[3:], at.rotation)):
            if shape.size:
                f += part @ shape
                sizes += np.linalg.norm(part) * np.linalg.norm(shape, axis=0)
    return np.where(np.abs(f) > SOLVED * sizes.max(initial=0.0), f, 0.0)


def _of_inertia(mechanism: Mechanism, body: int, loads: BodyLoads, k: int) -> Array:
    """Return the modal forces (n,) of a body's own inertia and weight."""
    integrals, spin = mechanism.links[body].integrals, loads.spin[k]
    products = (spin @ spin) * np.eye(3) - np.outer(spin, spin)
    moments = integrals.G[:, :, 0, 1:]
    f = np.einsum("ab,abi->i", products, moments) - np.einsum("a,abc,bci->i", loads.turning[k], EPSILON, moments)
    return np.asarray(f - loads.acceleration[k] @ integrals.S[:, 1:])


def _between(moments: IntArray, values: Array, count: int) -> Array:
    """Interpolate values (n_moments, …) to all times, (count, …)."""
    flat = values.reshape(len(moments), -1)
    columns = [np.interp(np.arange(count), moments, column) for column in flat.T]
    return np.array(columns).reshape(flat.shape[1], count).T.reshape(count, *values.shape[1:])
