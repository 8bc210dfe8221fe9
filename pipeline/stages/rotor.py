"""Vibrations of a scene's rotor over its rate of rotation: a part on a turning hub, or a shaft in bearings."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.core.arrays import Array
from pipeline.core.errors import InputError
from pipeline.core.rotations import matrix_of_quaternion, quaternion_of_matrix, rotation_matrix
from pipeline.reduction.rotating import rotating_modes
from pipeline.responses.linearisation import Linearisation
from pipeline.responses.ports import Direction, MarkerPort
from pipeline.responses.state_space import StateSpace
from pipeline.responses.whirl import WhirlingModes, whirling_modes
from pipeline.scene.damping import damping_ratios
from pipeline.scene.variants import correct_statically, replace_gravity
from pipeline.stability.tangent import OperatingPoint
from pipeline.stages.ground import ground_place

if TYPE_CHECKING:
    from pipeline.dynamics.mechanism import Mechanism
    from pipeline.scene.scene import Scene
    from pipeline.stages.pipeline import Pipeline

Vibrations = Callable[[float], WhirlingModes]
"""Vibrations at a rate of rotation [rad/s]."""

_ALIKE = 1e-6  # of the largest entry: equations of a rotor that are the same at every angle
_TURN = 1.0  # angle at which they are compared [rad]


def runs_in_bearings(scene: Scene) -> bool:
    """Return True if a scene's first body is free, and bearings hold what it carries."""
    joint = next((scene.joint[name] for name in scene.carrying.values()), None)
    return bool(scene.bearing) and joint is not None and joint.type == "free"


def find_vibrations(run: Pipeline) -> Vibrations:
    """Return the vibrations of a scene's rotor as a function of its rate of rotation [rad/s].

    Those of a shaft in bearings are seen from space, those of a part on a hub from the hub.

    Raises
    ------
    InputError
        There is no flexible part; or the bearings of a shaft are not the same all around, so that its equations vary
        with its angle.
    """
    if runs_in_bearings(run.scene):
        return _RotorInBearings(run).vibrations
    part = run.part
    body = part.body if run.scene.simulation.stiffening == "off" else part.stiffened
    ratios = np.array(damping_ratios(part.shape.modes.damping, body.omega.tolist()))

    def on_hub(rate: float) -> WhirlingModes:
        found = rotating_modes(body, np.array(part.joint.axis), rate, len(part.joint.free) == 1, ratios)
        return WhirlingModes(found.omega / (2 * np.pi), found.damping, found.whirl)

    return on_hub


class _RotorInBearings:
    """A mechanism that turns as a whole about the axis of its first bearing."""

    def __init__(self, run: Pipeline) -> None:
        self.scene = replace_gravity(correct_statically(run.scene, []), (0.0, 0.0, 0.0))
        pipeline = run.variant(self.scene, run.store.monitor)
        self.mechanism: Mechanism = pipeline.mechanism
        self.q, _ = pipeline.start
        self.axis = _bearing_axis(self.scene)
        first, second, _ = np.linalg.svd(np.eye(3) - np.outer(self.axis, self.axis))[0].T
        if np.cross(first, second) @ self.axis < 0.0:
            first, second = second, first
        directions: list[Direction] = [(float(d[0]), float(d[1]), float(d[2])) for d in (first, second, self.axis)]
        ports = [
            MarkerPort(f"{link.name}.{name} {k}", "m", number, at, direction, False)
            for k, direction in enumerate(directions)
            for number, link in enumerate(self.mechanism.links)
            for name, at in link.markers.items()
        ]
        self.linearisation = Linearisation(self.mechanism, (), ports)
        self._require_round()

    def _model(self, rate: float, angle: float = 0.0) -> StateSpace:
        """Linearise the rotor at a rate [rad/s] and an angle [rad] about its axis, undeformed."""
        at, first = int(self.mechanism.layout.position[0]), int(self.mechanism.layout.rate[0])
        q, v = self.q.copy(), np.zeros(self.mechanism.n)
        R = rotation_matrix(angle * self.axis[None])[0] @ matrix_of_quaternion(q[None, at + 3 : at + 7])[0]
        q[at + 3 : at + 7] = quaternion_of_matrix(R[None])[0]
        v[first + 3 : first + 6] = rate * (R.T @ self.axis)
        return self.linearisation.at(OperatingPoint(0.0, q, v))

    def _require_round(self) -> None:
        here, turned = self._model(0.0).A, self._model(0.0, _TURN).A
        if np.abs(here - turned).max() > _ALIKE * np.abs(here).max():
            mend = (
                "aren't the same all around the axis, or the rotor's first marker isn't on it: the equations of the "
                "rotor then vary with its angle, and have no frequencies of their own"
            )
            raise InputError(self.scene.file, "bearing", sorted(self.scene.bearing), mend)

    def vibrations(self, rate: float) -> WhirlingModes:
        """Return the vibrations at a rate [rad/s]."""
        model = self._model(rate)
        first, second, along = np.split(model.C, 3)
        return whirling_modes(model.A, (first, second), along, rate)


def _bearing_axis(scene: Scene) -> Array:
    """Return the axis of the first bearing in space, a unit vector."""
    bearing: Any = next(iter(scene.bearing.values()))
    axis = np.array(bearing.axis, dtype=float)
    if bearing.between[0].partition(".")[0] == "ground":
        axis = ground_place(scene, bearing.between[0])[1] @ axis
    return np.asarray(axis / np.linalg.norm(axis))
