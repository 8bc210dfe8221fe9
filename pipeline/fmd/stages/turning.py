"""Rotors that turn as a whole, in bearings or on a hub, and the steady states in which they do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits import responses as limits
from fmd.core.limits.round_off import EXACT
from fmd.core.rotations import matrix_of_quaternion, quaternion_of_matrix, rotation_by
from fmd.dynamics.elements import SpeedDependentBearing
from fmd.dynamics.kinematics import Kinematics
from fmd.integrators.protocol import evaluate_projection
from fmd.responses.linearisation import Linearisation
from fmd.responses.ports import Direction, MarkerPort
from fmd.responses.state_space import StateSpace
from fmd.responses.steady_rotation import Rotation, SteadyRotation
from fmd.responses.whirl import SpaceView
from fmd.scene.variants import change_simulation, correct_statically, open_to_space
from fmd.stability.tangent import OperatingPoint
from fmd.stages.mechanism import place_joints
from fmd.stages.parent_joint import ground_place, joint_axes

if TYPE_CHECKING:
    from fmd.dynamics.mechanism import Mechanism
    from fmd.reduction.body import FlexibleBody
    from fmd.scene.scene import Scene
    from fmd.stages.pipeline import Pipeline


def scene_in_space(scene: Scene) -> Scene:
    """Return a scene without gravity whose bodies have shapes for small motions of any direction."""
    return change_simulation(correct_statically(open_to_space(scene), []), gravity=(0.0, 0.0, 0.0))


class InBearings:
    """A mechanism whose first body is free and turns about the axis of the first bearing."""

    def __init__(self, scene: Scene, mechanism: Mechanism) -> None:
        self.mechanism, link = mechanism, mechanism.links[0]
        self.at, self.first = int(mechanism.layout.position[0]) + 3, int(mechanism.layout.rate[0]) + 3
        self.axis = _bearing_axis(scene)
        self.still: tuple[str, ...] = ()  # what turns it, or bends it, is left out otherwise
        self.into_place = link.place_axes.T  # from space

    def rotation(self, rate: float, q: Array) -> Rotation:
        """Return the rotation of the whole at a rate [rad/s] in positions q."""
        v = np.zeros(self.mechanism.n)
        R = matrix_of_quaternion(q[None, self.at : self.at + 4])[0]
        v[self.first : self.first + 3] = rate * (R.T @ self.into_place @ self.axis)
        return Rotation(v, _resting(self.mechanism))

    def drift(self, a: Array) -> float:
        """Return the size of the acceleration of the whole about and along the axis [rad/s² or m/s²]."""
        along = self.into_place @ self.axis
        return float(max(abs(a[self.first : self.first + 3] @ along), abs(a[self.first - 3 : self.first] @ along)))

    def turned(self, q: Array, angle: float) -> tuple[Array, Rotation]:
        """Return positions turned as a whole by an angle [rad], and the rotation at no rate there."""
        out, place = q.copy(), slice(self.at, self.at + 4)
        turn = rotation_by(angle * (self.into_place @ self.axis))
        out[place] = quaternion_of_matrix((turn @ matrix_of_quaternion(q[None, place])[0])[None])[0]
        return out, self.rotation(0.0, out)


class OnHub:
    """A mechanism that turns about a revolute joint on the ground, freely or as prescribed."""

    def __init__(self, mechanism: Mechanism, root: int, axis: Array) -> None:
        self.mechanism, self.root, self.axis = mechanism, root, axis
        link = mechanism.links[root]
        self.free = link.motion is None
        self.still = (f"{link.joint_name}.position",)
        self.angle = 0.0 if link.motion is None else link.motion.value(0.0)[0]

    def rotation(self, rate: float, q: Array) -> Rotation:
        """Return the rotation of the whole at a rate [rad/s] in positions q."""
        v, motions = np.zeros(self.mechanism.n), _resting(self.mechanism)
        if self.free:
            v[self.mechanism.layout.rate[self.root]] = rate
        else:
            motions[self.root] = self.angle, rate, 0.0
        return Rotation(v, motions)

    def drift(self, a: Array) -> float:
        """Return the size of the hub's acceleration [rad/s²]."""
        return abs(float(a[self.mechanism.layout.rate[self.root]])) if self.free else 0.0

    def turned(self, q: Array, angle: float) -> tuple[Array, Rotation]:
        """Return positions turned as a whole by an angle [rad], and the rotation at no rate there."""
        out, rotation = q.copy(), self.rotation(0.0, q)
        if self.free:
            out[self.mechanism.layout.position[self.root]] += angle
            return out, rotation
        return out, replace(rotation, motions={**rotation.motions, self.root: (self.angle + angle, 0.0, 0.0)})


class TurningRotor:
    """A scene's rotor, linearised where it turns steadily.

    Its first body is free and held by bearings, or its first part's joints lead to a revolute joint on the ground.

    Raises
    ------
    InputError
        Its axis isn't given, or what supports it isn't the same all around.
    """

    def __init__(self, run: Pipeline, in_bearings: bool) -> None:
        self.given = run.scene.drive
        self.scene = scene_in_space(run.scene)
        pipeline = run.variant(self.scene, run.store.monitor)
        # All terms of stiffening stay: they count by the rates of the diagram, not by those of the scene.
        pipeline = pipeline.with_bodies(
            {name: _stiffened(pipeline, name) for name in pipeline.parts}, stiffening_loads={}
        )
        self.pipeline, self.mechanism = pipeline, pipeline.mechanism
        self.rest, _ = place_joints(pipeline.divided_scene, self.mechanism)
        way = InBearings(self.scene, self.mechanism) if in_bearings else _find_hub(pipeline, self.mechanism, self.rest)
        self.way: InBearings | OnHub = way
        linearisation = Linearisation(self.mechanism, (), self._ports())
        self.steady = SteadyRotation(linearisation, way.rotation, way.still, self._close)
        self._found: dict[float, Array] = {}
        self._require_round(linearisation)
        self._marked = places = _marker_places(self.mechanism, self.rest)
        self._size = float(np.linalg.norm(places, axis=1).max())
        self.on_axis = self._on_axis(places)
        if in_bearings:
            self.steady.leave_out_bending(self.rest, np.concatenate([self.on_axis, self.on_axis + len(places)]))

    def model(self, rate: float) -> StateSpace:
        """Linearise the rotor where it turns steadily at a rate [rad/s].

        Outputs are the displacements of all markers along two axes across that of rotation, then along it, and their
        rotations about these three.

        Raises
        ------
        InputError
            A load turns or pushes the whole rotor ever faster, or it is out of balance.
        AccuracyError
            There is no steady rotation at this rate.
        """
        model = self.steady.model(rate, self.find(rate))
        if isinstance(self.way, InBearings) and rate:
            self._require_balance(rate, model)
        return model

    def view(self, C: Array, rate: float) -> SpaceView:
        """Return how space sees the rotor's vibrations at a rate [rad/s], by the outputs of its model there."""
        first, second, along, *turns = np.split(C, 6)
        tilt_first, tilt_second, about = (self._size * turn for turn in turns)
        on = self.on_axis
        return SpaceView((first[on], second[on]), (tilt_first, tilt_second), (along, about), rate)

    def forced(self, *places: str) -> Callable[[float], StateSpace]:
        """Return models at a rate [rad/s] as `model`, whose inputs are forces on markers along both axes across."""
        inputs = []
        for place in places:
            body, _, name = place.partition(".")
            number = self.mechanism.find_marker(self.mechanism.number_of(body), name)
            at = self.mechanism.links[number].markers[name]
            inputs += [
                MarkerPort(f"{place} {k}", "N", number, at, way, False) for k, way in enumerate(self._directions[:2])
            ]
        linearisation = Linearisation(self.mechanism, inputs, self._ports())

        def model(rate: float) -> StateSpace:
            q = self.find(rate)
            rotation = self.way.rotation(rate, q)
            return linearisation.at(OperatingPoint(0.0, q, rotation.rates), rotation.motions)

        return model

    @property
    def bends(self) -> list[float]:
        """Rates at which a table of a bearing begins anew [rad/s], ascending."""
        bearings = (at for at in self.mechanism.elements if isinstance(at, SpeedDependentBearing))
        return sorted({knot for at in bearings for curve in (at.radial, at.damper) for knot in curve.knots})

    @property
    def markers(self) -> list[str]:
        """Names of all markers, in the order of the outputs."""
        return [f"{link.part or link.name}.{name}" for link in self.mechanism.links for name in link.markers]

    def places_on_axis(self, first: str) -> dict[str, int]:
        """Return one marker for each place on the axis, by its name, with its number; where it is there, ``first``."""
        found: dict[str, int] = {}
        for k in sorted(self.on_axis.tolist(), key=lambda k: self.markers[k] != first):
            apart = [float(np.linalg.norm(self._marked[k] - self._marked[other])) for other in found.values()]
            if min(apart, default=np.inf) > limits.ON_AXIS * self._size:
                found[self.markers[k]] = k
        return dict(sorted(found.items(), key=lambda item: float(self._marked[item[1]] @ self.way.axis)))

    def find(self, rate: float) -> Array:
        """Return the positions in which the rotor turns steadily at a rate [rad/s]; raises as `model`.

        The search begins at the nearest rate that is known, and goes there in steps where it finds nothing at once.
        """
        step = np.inf
        while rate not in self._found:
            known, q = min([(0.0, self.rest), *self._found.items()][::-1], key=lambda at: abs(at[0] - rate))
            to = known + float(np.clip(rate - known, -step, step))
            try:
                self._found[to] = self.steady.find(to, q)
            except AccuracyError:
                step = min(step, abs(rate - known)) / 4
                if step < limits.SHORTEST_RATE * abs(rate):
                    raise
            else:
                self._require_steady(to)
        return self._found[rate]

    @property
    def _directions(self) -> list[Direction]:
        """Two axes across that of rotation, a right-handed system with it, and that one."""
        first, second, _ = np.linalg.svd(np.eye(3) - np.outer(self.way.axis, self.way.axis))[0].T
        if np.cross(first, second) @ self.way.axis < 0.0:
            first, second = second, first
        return [(float(d[0]), float(d[1]), float(d[2])) for d in (first, second, self.way.axis)]

    def _ports(self) -> list[MarkerPort]:
        return [
            MarkerPort(f"{link.name}.{name} {k}", unit, number, at, direction, turns)
            for turns, unit in ((False, "m"), (True, "rad"))
            for k, direction in enumerate(self._directions)
            for number, link in enumerate(self.mechanism.links)
            for name, at in link.markers.items()
        ]

    def _on_axis(self, places: Array) -> IntArray:
        """Return the numbers of the markers on the axis."""
        apart = np.linalg.norm(np.cross(places, self.way.axis), axis=1)
        return np.flatnonzero(apart <= limits.ON_AXIS * max(self._size, 1e-300))

    def _close(self, q: Array) -> Array:
        if not self.mechanism.closures:
            return q
        closed = q.copy()
        evaluate_projection(self.pipeline.system.parameters, 0.0, closed, np.zeros(self.mechanism.n))
        return closed

    def _require_round(self, linearisation: Linearisation) -> None:
        turned, rotation = self.way.turned(self.rest, limits.COMPARED_TURN)
        here = self.steady.model(0.0, self.rest).A
        there = linearisation.at(OperatingPoint(0.0, turned, rotation.rates), rotation.motions).A
        if _differ(here, there) <= limits.ALIKE_AROUND:
            return
        if isinstance(self.way, InBearings):
            mend = (
                "aren't the same all around the axis, or the rotor's first marker isn't on it: the equations of the "
                "rotor then vary with its angle, and have no frequencies of their own"
            )
            raise InputError(self.scene.file, "bearing", sorted(self.scene.bearing), mend)
        raise _held_beside(self.scene, self.mechanism.links[self.way.root].joint_name)

    def _require_balance(self, rate: float, model: StateSpace) -> None:
        """Raise ``InputError`` if the straight rotor's points are accelerated as by a large eccentricity.

        A mesh is never quite round: it excites vibrations of discs and ends, far above the rotation, which only yield.
        """
        a = self.steady.accelerations(rate, self._found[rate])[self.steady.independent(model)]
        k, yielding = len(a), (limits.YIELDING * rate) ** 2
        first, second, *_ = np.split(model.C[:, :k] @ np.linalg.solve(np.eye(k) - model.A[k:, :k] / yielding, a), 6)
        off = float(np.hypot(first, second).max()) / (rate**2 + 1.0)  # at low rates round-off accelerates, too
        if off > limits.ECCENTRIC * self._size:
            mend = (
                f"the rotor is out of balance: at {rate:.4g} rad/s its points are accelerated as by a centre of mass "
                f"{1e3 * off:.2g} mm off the axis. Its vibrations are computed about a straight axis, and are right up "
                f"to {1e3 * limits.ECCENTRIC * self._size:.2g} mm; balance it"
            )
            raise InputError(self.scene.file, "body", sorted(self.scene.body), mend)

    def _require_steady(self, rate: float) -> None:
        """Raise ``InputError`` if a load of the start turns the rotor faster, or pushes it along its axis."""
        a = self.steady.accelerations(rate, self._found[rate])
        if self.way.drift(a) > limits.STEADY_RATE * (rate**2 + 1.0):
            mend = (
                "a load of the start accelerates the rotor as a whole, so that it has no steady rotation: hold it, by "
                "a prescribed motion or an axial stiffness, or let the load begin later"
            )
            raise InputError(self.scene.file, "drive", sorted(self.given), mend)


def require_one_axis(scene: Scene) -> None:
    """Check that a hinge on the ground carries the first part, and none beside it, before anything is reduced.

    Raises
    ------
    InputError
        Another joint carries it, or a second hinge off the hub's axis holds what turns on the hub, as in a four-bar.
    """
    body, carried = next(iter(scene.flexible), ""), scene.carrying
    hub = carried.get(body, "")
    while hub and (body := scene.joint[hub].parent.partition(".")[0]) != "ground":
        hub = carried.get(body, "")
    if not hub:
        return
    if not scene.joint[hub].kind.is_hinge:
        mend = (
            "a rotor turns about a revolute joint on the ground, or its first body is free and held by bearings: "
            "nothing else tells the axis of rotation"
        )
        raise InputError(scene.file, f"joint.{hub}.type", None, mend)
    hinge: Any = scene.joint[hub]
    (at, _), axis = ground_place(scene, hinge.parent), joint_axes(scene, hinge).in_parent @ hinge.axis
    ends = {name: {joint.parent, joint.child} for name, joint in scene.joint.items()}
    bodies = {name: {end.partition(".")[0] for end in both} for name, both in ends.items()}
    joined = bodies[hub] - {"ground"}
    while more := set[str]().union(*(own for own in bodies.values() if own & joined)) - joined - {"ground"}:
        joined |= more
    for name, own in bodies.items():
        if name == hub or "ground" not in own or not own & joined or not scene.joint[name].kind.is_hinge:
            continue
        (place,) = (end for end in ends[name] if end.partition(".")[0] == "ground")
        apart = ground_place(scene, place)[0] - at
        if np.linalg.norm(np.cross(apart, axis)) > limits.ON_AXIS * np.linalg.norm(apart) * np.linalg.norm(axis):
            raise _held_beside(scene, hub)


def _held_beside(scene: Scene, joint: str) -> InputError:
    mend = (
        "what holds the rotor beside this joint isn't the same all around its axis: the equations then vary with the "
        "angle, and have no frequencies of their own"
    )
    return InputError(scene.file, f"joint.{joint}", None, mend)


def _differ(A: Array, B: Array) -> float:
    """Return the largest difference of two state matrices, each entry beside the stiffness of its two coordinates.

    What is round-off of the stiffest one doesn't count: of free rotation next to many modes it is as large as 1 rad/s.
    """
    n = len(A) // 2
    stiff = np.maximum(np.abs(A[n:, :n].diagonal()), 1.0)  # at least that of 1 rad/s
    own, apart = np.sqrt(stiff), np.maximum(np.abs(A - B) - EXACT * stiff.max(), 0.0)
    stiffness, damping = apart[n:, :n] / np.outer(own, own), apart[n:, n:] / np.sqrt(np.outer(own, own))
    return float(max(stiffness.max(initial=0.0), damping.max(initial=0.0)))


def _find_hub(pipeline: Pipeline, mechanism: Mechanism, q: Array) -> OnHub:
    """Find the revolute joint on the ground that carries the first part."""
    root = mechanism.number_of(pipeline.part.name)
    while mechanism.links[root].parent >= 0:
        root = mechanism.links[root].parent
    link = mechanism.links[root]
    axis = _at_rest(mechanism, q).frames[root].rotation[0] @ link.axis
    return OnHub(mechanism, root, axis / np.linalg.norm(axis))


def _stiffened(pipeline: Pipeline, name: str) -> FlexibleBody:
    """Return a body with its geometric stiffness, unless the scene wants none."""
    part = pipeline.parts[name]
    if pipeline.scene.simulation.stiffening == "off":
        return part.body
    return part.stiffened


def _resting(mechanism: Mechanism) -> dict[int, tuple[float, float, float]]:
    """Return prescribed joints where they are at the start, without rates."""
    return {
        k: (link.motion.value(0.0)[0], 0.0, 0.0) for k, link in enumerate(mechanism.links) if link.motion is not None
    }


def _at_rest(mechanism: Mechanism, q: Array) -> Kinematics:
    return Kinematics(mechanism, np.zeros(1), q[None], np.zeros((1, mechanism.n)))


def _marker_places(mechanism: Mechanism, q: Array) -> Array:
    """Return the places of all markers from the first body's origin, in the order of the outputs, (n_markers, 3)."""
    motion = _at_rest(mechanism, q)
    places = [
        frame.origin[0] + frame.rotation[0] @ at.position
        for frame, link in zip(motion.frames, mechanism.links, strict=True)
        for at in link.markers.values()
    ]
    return np.asarray(np.array(places) - motion.frames[0].origin[0])


def _bearing_axis(scene: Scene) -> Array:
    """Return the axis of the first bearing in space, a unit vector."""
    bearing: Any = next(iter(scene.bearing.values()))
    axis = np.array(bearing.axis, dtype=float)
    if bearing.between[0].partition(".")[0] == "ground":
        axis = ground_place(scene, bearing.between[0])[1] @ axis
    return np.asarray(axis / np.linalg.norm(axis))
