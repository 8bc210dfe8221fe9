"""The kernels of a planar rotor in place of a mechanism's: when, and that they move alike."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.dynamics.fast_path import fast_system, rigid_hinge_motion
from pipeline.dynamics.links import FIXED, PRISMATIC, REVOLUTE, Link, PointLoad, rigid_gram
from pipeline.dynamics.mechanism import Mechanism
from pipeline.dynamics.rotor.rotor import PlanarRotor
from pipeline.dynamics.signals.signal import constant, half_sine, total
from pipeline.integrators.protocol import evaluate
from pipeline.integrators.scipy_ivp import ScipyIvp
from pipeline.reduction.inertia import inertia_gram

AXIS = np.array([1.0, -2.0, 3.0])
PULSE = half_sine(0.1, 0.4, 2.0)


def body(n_modes: int = 3, **changes: Any) -> Link:
    """A body of mass points on a hinge, with shapes of unit modal mass and a turning section."""
    rng = np.random.default_rng(1)
    x, m, Phi = rng.normal(size=(12, 3)), rng.uniform(0.1, 0.5, 12), rng.normal(size=(36, n_modes))
    L = np.linalg.cholesky(Phi.T @ (np.repeat(m, 3)[:, None] * Phi))
    Phi = np.linalg.solve(L, Phi.T).T.reshape(12, 3, n_modes)
    hinge = {"axis": AXIS, "joint_rotation": 0.3 * rng.normal(size=n_modes), "load": PULSE}
    settings: dict[str, Any] = {"omega": rng.uniform(3.0, 9.0, n_modes)} | hinge | changes
    return Link("body", inertia_gram(x, np.diag(m), Phi), settings.pop("joint", REVOLUTE), **settings)


def test_one_driven_flexible_body_on_a_hinge_is_marched_as_a_rotor() -> None:
    mechanism = Mechanism([body()])
    rotor = fast_system(mechanism)
    assert isinstance(rotor, PlanarRotor)
    assert tuple(rotor.pulse) == (0.1, 0.4, 2.0)
    assert rotor.breakpoints == mechanism.breakpoints
    assert (rotor.n, rotor.n_slow, rotor.n_positions) == (mechanism.n, mechanism.n_slow, mechanism.n_positions)
    for one, other in zip(rotor.linear_matrices, mechanism.linear_matrices, strict=True):
        assert one == pytest.approx(other, abs=1e-12)
    assert rotor.highest_frequency == pytest.approx(mechanism.highest_frequency, rel=1e-12)
    rng = np.random.default_rng(2)
    for t in (0.0, 0.3, 0.6):
        q, v, a, b = 0.1 * rng.normal(size=4), rng.normal(size=4), np.zeros(4), np.zeros(4)
        evaluate(rotor.parameters, t, q, v, a)
        evaluate(mechanism.parameters, t, q, v, b)
        assert a == pytest.approx(b, rel=1e-12, abs=1e-12 * np.abs(b).max())


def test_a_body_without_a_drive_or_a_turning_section_is_one_too() -> None:
    still = fast_system(Mechanism([body(load=constant(0.0), joint_rotation=np.zeros(0))]))
    assert isinstance(still, PlanarRotor)
    assert still.pulse.peak == 0.0
    assert still.parameters.lever.tolist() == [1.0, 0.0, 0.0, 0.0]


OTHERS: dict[str, Mechanism] = {
    "a rigid body": Mechanism([body(0)]),
    "a spring": Mechanism([body(spring=1.0)]),
    "a damper": Mechanism([body(damper=1.0)]),
    "modal damping": Mechanism([body(damping=np.full(3, 1e-3))]),
    "a torque": Mechanism([body(load=constant(1.0))]),
    "two pulses": Mechanism([body(load=total([PULSE, PULSE]))]),
    "a slide": Mechanism([body(joint=PRISMATIC, joint_rotation=np.zeros(0))]),
    "a weld": Mechanism([body(joint=FIXED, joint_rotation=np.zeros(0), load=constant(0.0))]),
    "gravity": Mechanism([body()], gravity=np.array([0.0, 0.0, -9.81])),
    "a point load": Mechanism(
        [body()], loads=[PointLoad("body", AXIS, constant(1.0), shapes=np.zeros((3, 3)), rotations=np.zeros((3, 3)))]
    ),
    "a fast joint": Mechanism([body()], ["body"]),
    "slow modes": Mechanism([body()], slow_modes={"body": 1}),
    "another body": Mechanism([body(), Link("other", rigid_gram(1.0, AXIS, np.eye(3)), REVOLUTE)]),
    "a prescribed motion": Mechanism([body(load=constant(0.0), joint_rotation=np.zeros(0), motion=constant(0.3))]),
}


@pytest.mark.parametrize("what", OTHERS)
def test_any_other_mechanism_is_marched_as_it_is(what: str) -> None:
    mechanism = OTHERS[what]
    assert fast_system(mechanism) is mechanism
    assert rigid_hinge_motion(mechanism, np.zeros(1), np.zeros(1), np.zeros(1)) is None


def test_a_rigid_body_under_a_pulse_turns_in_closed_form() -> None:
    mechanism, times = Mechanism([body()]), np.linspace(0.0, 1.0, 21)
    found = rigid_hinge_motion(mechanism, np.array([0.2]), np.array([-0.5]), times)
    assert found is not None
    rigid = mechanism.rigid
    march = ScipyIvp("DOP853", 1e-11).march(rigid, np.array([0.2]), np.array([-0.5]), times)
    assert found[0] == pytest.approx(march.q, abs=1e-9)
    assert found[1] == pytest.approx(march.v, abs=1e-9)


def test_a_sum_of_one_signal_is_the_signal_itself() -> None:
    assert total([PULSE]) is PULSE
    assert PULSE.pulse == (0.1, 0.4, 2.0)
    assert total([PULSE, constant(0.0)]).pulse is None
    assert replace(PULSE, pulse=None) != PULSE
