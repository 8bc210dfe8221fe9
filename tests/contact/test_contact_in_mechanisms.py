"""Contact of bodies in mechanisms: what joints bear, loops, and implicit steps."""

import re
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.tangents import Direction, TangentSystem
from fmd.output.contacts import contact_warnings

ARM: dict[str, Any] = {
    "title": "Arm",
    "body": {
        "arm": {
            "shape": "bar",
            "length": "300 mm",
            **dict.fromkeys(("depth", "width"), "30 mm"),
            "E": "70 GPa",
            "nu": 0.3,
            "rho": "2700 kg/m^3",
            "mesh": {"divisions": [8, 1, 1], "order": 1},
            "modes": {"count": 3, "enrich": "none"},
            "marker": {"root": {"face": "x-"}, "under": {"face": "y-"}, "end": {"face": "x+"}},
        }
    },
    "joint": {"hinge": {"type": "revolute", "axis": [0, 0, 1], "parent": "ground", "child": "arm.root"}},
    "contact": {"stop": {"between": ["ground", "arm.under"], "normal": [0, 1, 0], "clearance": "17 mm"}},
    "simulation": {
        "duration": "4 ms",
        "output_step": "4 us",
        "step": "auto",
        "tip": "arm.end",
        "gravity": ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"],
        "run": [{"integrator": "central-difference"}],
    },
}
FALLING = ('joint.hinge.rate="-4 rad/s"',)


def arm(*overrides: str, **tables: Any) -> Pipeline:
    return Pipeline(load_scene(ARM | tables, overrides))


@pytest.fixture(scope="module")
def fallen() -> Pipeline:
    """An arm that falls onto a stop under its face, as a pendulum against a stop."""
    return arm(*FALLING)


def impulse_left(run: Pipeline, joint: str) -> Array:
    """Return what is missing of the momentum by weight, contact and a joint's force over time, (n_times, 3)."""
    motion = run.motion
    force = motion.joint_loads.reactions[joint][:, 1, :3] + motion.contacts["stop"].force
    force = force + motion.mechanism.mass * motion.mechanism.gravity
    steps = 0.5 * np.diff(motion.times)[:, None] * (force[1:] + force[:-1])
    momentum = motion.kinematics.momentum
    return np.asarray(momentum[1:] - momentum[0] - np.cumsum(steps, axis=0))


def told_of_joints(run: Pipeline) -> list[dict[str, str]]:
    return [own for own in contact_warnings(run) if own["code"] == "contact-joint"]


def test_joint_and_stop_together_change_the_momentum_of_an_arm(fallen: Pipeline) -> None:
    momentum = np.abs(fallen.motion.kinematics.momentum).max()
    assert np.abs(fallen.motion.contacts["stop"].impulse[-1, 1]) > momentum
    assert np.abs(impulse_left(fallen, "hinge")).max() < 5e-3 * momentum


def closed(*overrides: str, **runs: Any) -> Pipeline:
    """The same arm, free and held by a hinge that closes a loop."""
    flight = {"type": "free", "parent": "ground", "child": "arm.root"}
    joints = {"flight": flight | {"spin": ["0 rad/s", "0 rad/s", "-4 rad/s"]}, "hinge": ARM["joint"]["hinge"]}
    return arm(*overrides, joint=joints, **runs)


RESPONSES = ("body.arm.modes.enrich=inertia", 'simulation.duration="2.4 ms"')


@pytest.fixture(scope="module")
def responding() -> Pipeline:
    """A loop whose body has static responses, also to the joint that closes it."""
    return closed(*RESPONSES)


def test_a_joint_of_a_loop_that_deflects_a_face_beside_the_modes_is_warned_of(
    fallen: Pipeline, responding: Pipeline
) -> None:
    """Static responses have what it deflects: they change the largest force by about the share."""
    bare = closed(RESPONSES[1])
    (share,) = (re.search(r"beside the modes by (\d+)%", own["text"]) for own in told_of_joints(bare))
    forces = [run.motion.contacts["stop"].largest[0] for run in (bare, responding)]
    assert share is not None
    assert 0.01 * float(share.group(1)) == pytest.approx(1.0 - forces[0] / forces[1], abs=0.03)
    assert not told_of_joints(responding)
    assert not told_of_joints(fallen)  # whose joint holds it, and so its faces


def test_a_loop_gives_the_motion_of_the_same_mechanism_without_one(responding: Pipeline) -> None:
    run, fallen = responding, arm(*FALLING, *RESPONSES)
    assert run.mechanism.closures
    first, other = (each.motion.contacts["stop"] for each in (fallen, run))
    np.testing.assert_allclose(other.impulse, first.impulse, atol=1e-2 * np.abs(first.impulse).max())
    assert other.span == pytest.approx(first.span, rel=1e-2)
    assert run.motion.constraint_residual < 1e-9
    np.testing.assert_allclose(
        run.motion.joint_loads.reactions["hinge"][0, 1, :3],
        fallen.motion.joint_loads.reactions["hinge"][0, 1, :3],
        atol=1e-6 * np.abs(fallen.motion.joint_loads.reactions["hinge"]).max(),
    )
    momentum = np.abs(run.motion.kinematics.momentum).max()
    assert np.abs(impulse_left(run, "hinge")).max() < 5e-3 * momentum


def test_a_loop_in_contact_has_the_tangents_of_its_steps() -> None:
    """Along rates of the start, beside differences of marches in which the same points close."""
    run = closed('contact.stop.clearance="15.1 mm"')
    (plan,), times = run.plans.values(), np.linspace(0.0, 2e-4, 6)
    system, q, v = plan.marched
    touching = tuple(0.0 * x for x in system.contact_numbers(v))
    along = Direction(np.zeros(system.compiled.numbers.shape), [], 0.0 * q, v, contact=touching)
    both: Any = TangentSystem(system, [along])
    march = plan.integrator.march(both, *both.join(q, v), times)
    assert np.abs(both.part_rows(march.contacts)).max() > 0.0
    sides = [[plan.integrator.march(system, q, (1.0 + side * x) * v, times) for side in (-1, 1)] for x in (2e-5, 1e-5)]
    for tangents, name in zip(both.part(march.q, march.v), "qv", strict=True):
        (rough, fine) = ((getattr(b, name) - getattr(a, name)) / 2.0 for a, b in sides)
        slope = (4.0 * fine / 1e-5 - rough / 2e-5) / 3.0
        np.testing.assert_allclose(tangents[:, :, 0], slope, rtol=0, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("friction", [pytest.param(0.0, marks=pytest.mark.long), 0.3])
def test_generalised_alpha_gives_the_contact_of_central_differences(friction: float) -> None:
    def impulse(method: str, step: float) -> Array:
        run = arm(
            *FALLING,
            f"contact.stop.friction={friction}",
            f"simulation.step={step} s",
            f'simulation.run.0.integrator="{method}"',
        )
        return run.motion.contacts["stop"].impulse[-1]

    limit = arm(*FALLING).system.largest_step
    first, other = impulse("central-difference", 0.1 * limit), impulse("generalized-alpha", 0.25 * limit)
    assert first[1] > 0.1
    np.testing.assert_allclose(other, first, atol=0.01 * np.abs(first).max())


def test_a_step_left_open_is_halved_where_contact_makes_energy() -> None:
    slapping = ('joint.hinge.rate="-8 rad/s"', "contact.stop.clearance=15 mm", "simulation.duration=0.2 ms")

    def made(run: Pipeline) -> float:
        motion = run.motion
        return float(np.abs(motion.contacts["stop"].energy_error).max() / motion.energies[0].max())

    free = arm(*slapping)
    first = 0.25 * free.system.largest_step
    assert made(arm(*slapping, f"simulation.step={first} s")) > 0.01
    assert made(free) <= 0.01
    assert free.motion.trajectory.step < 0.6 * first
