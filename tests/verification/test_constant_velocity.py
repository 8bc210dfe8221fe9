"""Constant-velocity joints: both shafts turn equally fast at any tilt, where a universal joint's ratio oscillates."""

from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.dynamics.closures import Place, close_joint
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.runge_kutta import RungeKutta
from fmd.reduction.body import MarkerShapes
from fmd.scene.joints.constant_velocity import CONSTANT_VELOCITY
from fmd.scene.joints.spherical import SPHERICAL
from tests.verification.absolute_coordinates import AbsoluteBodies, Gap

X, NOTHING = np.array([1.0, 0.0, 0.0]), np.zeros((3, 0))
TIMES = np.linspace(0.0, 0.3, 4)  # before the shafts fold by half a turn, where the equation branches


def shafts(tilt: float, joint: dict[str, Any], closing: bool) -> Any:
    """Run two shafts, the second in a bearing on an axis that is tilted about z against the first's [rad].

    The joint between them carries the second shaft, or closes the loop of both.
    """
    along = [float(np.cos(tilt)), float(np.sin(tilt)), 0.0]
    markers = {"start": {"at": [0.0, 0.0, 0.0]}, "end": {"at": [0.4, 0.0, 0.0]}}
    shaft = {"shape": "rigid", "mass": 2.0, "centre": [0.2, 0, 0], "inertia": [0.01, 0.03, 0.03], "marker": markers}
    inner = {"parent": "first.end", "child": "second.start", **joint}
    bearing = {"type": "revolute", "parent": "ground.bearing", "child": "second.end", "axis": along}
    if closing:
        joint_tables = {"output": bearing | {"axis": [1, 0, 0], "rotate": [0.0, 0.0, tilt]}, "inner": inner}
    else:
        joint_tables = {"inner": inner, "output": bearing | {"child_axis": [1, 0, 0]}}
    place = {"at": [0.4 + 0.4 * along[0], 0.4 * along[1], 0.0]}
    tables = {
        "title": "Two shafts",
        "body": {"first": shaft, "second": shaft},
        "ground": {"bearing": place},
        "joint": {
            "input": {"type": "revolute", "parent": "ground", "child": "first.start", "axis": [1, 0, 0], "rate": 20.0},
            **joint_tables,
        },
        "drive": {"engine": {"type": "torque", "joint": "input", "torque": 0.3}},
        "simulation": {
            "duration": 0.5,
            "output_step": 0.005,
            "tip": "second.end",
            "run": [{"integrator": "runge-kutta", "tolerance": 1e-10}],
        },
    }
    return Pipeline(load_scene(tables)).motion.kinematics


@pytest.mark.parametrize(("tilt", "closing"), [(0.1, False), (1.2, False), (0.6, True), (1.2, True)])
def test_both_shafts_turn_equally_fast_at_any_tilt(tilt: float, closing: bool) -> None:
    joint: dict[str, Any] = {"type": "constant-velocity", "axis": [1, 0, 0]}
    motion = shafts(tilt, joint | ({} if closing else {"angles": [0.0, tilt]}), closing)
    first, second = (motion.body_spin(motion.mechanism.number_of(name)) for name in ("first", "second"))
    assert np.ptp(first[:, 0]) > 3.0  # the engine speeds it up
    assert second[:, 0] == pytest.approx(first[:, 0], rel=1e-8)
    assert np.abs(second[:, 1:]).max() < 1e-7
    kinetic, _ = motion.energies  # both shafts turn, of 0.02 kg m² together, and the engine does work
    turned = 20.0 * motion.times + 0.5 * 0.3 / 0.02 * motion.times**2
    assert kinetic == pytest.approx(0.5 * 0.02 * 20.0**2 + 0.3 * turned, rel=1e-8)


@pytest.mark.parametrize("tilt", [0.1, 0.6])
def test_a_universal_joint_turns_the_second_shaft_by_its_known_ratio(tilt: float) -> None:
    joint = {"type": "universal", "axis": [0, 1, 0], "child_axis": [0, 0, 1], "angles": [0.0, tilt]}
    motion = shafts(tilt, joint, closing=False)
    first, second = (motion.body_spin(motion.mechanism.number_of(name))[:, 0] for name in ("first", "second"))
    theta = motion.joint_coordinates(motion.mechanism.number_of("first"))[0][:, 0]
    assert np.ptp(theta) > 2 * np.pi
    # Of the input's fork from the plane of both shafts; known since Poncelet, 1824.
    ratio = np.cos(tilt) / (1.0 - np.sin(tilt) ** 2 * np.cos(theta) ** 2)
    assert second / first == pytest.approx(ratio, rel=1e-7)


def bodies(closing: bool) -> tuple[Mechanism, AbsoluteBodies, Array]:
    """Two bodies as a mechanism and by constraints: a pendulum of both, or both on the ground, tied by the joint."""
    rng = np.random.default_rng(4)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    places = np.array([[0.0, 0.0, 0.0], [0.5, 0.1, -0.2], [0.8, 0.5, 0.1]])
    masses, centres = [1.5, 0.8], rng.uniform(-0.2, 0.2, (2, 3))
    inertias = [np.diag(rng.uniform(0.02, 0.03, 3)) for _ in range(2)]
    gravity = np.array([3.0, -7.0, -4.0])
    integrals = [rigid_integrals(*given) for given in zip(masses, centres, inertias, strict=True)]
    first = Link("first", integrals[0], SPHERICAL, place=MarkerShapes(places[0]))
    if closing:
        origins = places[[0, 2]]
        links = [first, Link("second", integrals[1], SPHERICAL, place=MarkerShapes(places[2]))]
        ends = (("first", places[1]), ("second", places[1] - places[2]))
        at = [Place(name, MarkerShapes(place, NOTHING, NOTHING)) for name, place in ends]
        closures = [close_joint(CONSTANT_VELOCITY, "shafts", at[0], at[1], axis)]
    else:
        origins = places[:2]
        links, closures = [first, Link("second", integrals[1], CONSTANT_VELOCITY, 0, MarkerShapes(places[1]), axis)], []
    gaps = _gaps(axis, places[1] - origins[0], places[1] - origins[1], places[2] if closing else None)
    reference = AbsoluteBodies(masses, list(centres), inertias, gaps, gravity)
    return Mechanism(links, gravity=gravity, closures=closures), reference, origins


def _gaps(axis: Array, of_first: Array, of_second: Array, end: Array | None) -> Gap:
    """Write the joint out: both places meet, and the rotation between the bodies has no part about the shaft."""

    def gaps(x: Array, R: Array) -> list[complex]:
        between = R[0].T @ R[1]
        twist = [between[2, 1] - between[1, 2], between[0, 2] - between[2, 0], between[1, 0] - between[0, 1]]
        meeting = x[1] + R[1] @ of_second - x[0] - R[0] @ of_first
        held = [] if end is None else list(x[1] - end)
        return [*x[0], *meeting, axis @ np.array(twist), *held]

    return gaps


@pytest.mark.parametrize("closing", [False, True])
def test_bodies_on_the_joint_move_as_its_constraint_written_out_says(closing: bool) -> None:
    mechanism, reference, origins = bodies(closing)
    system = CompiledSystem(mechanism)
    march = RungeKutta(1e-11).march(system, mechanism.rest_positions, np.zeros(system.n), TIMES)
    positions, rotations = reference.march(origins, TIMES)
    assert np.abs(rotations[-1][0].T @ rotations[-1][1] - np.eye(3)).max() > 0.1  # the joint has tilted
    for k, t in enumerate(TIMES):
        found, axes, _ = system.compiled.frames(float(t), march.q[k], march.v[k])
        assert found == pytest.approx(positions[k], abs=1e-8)
        assert axes == pytest.approx(rotations[k], abs=1e-8)
    kinetic, potential = Kinematics(mechanism, march.times, march.q, march.v).energies
    assert kinetic[-1] > 0.1
    assert kinetic + potential == pytest.approx(np.full(len(TIMES), potential[0]), abs=1e-8)
