"""Loads that pass through bodies: against applied torques, weights and central forces."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmd.dynamics.compiler.compiled import compile_mechanism
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.links import Link, PointLoad, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import constant
from fmd.dynamics.transmitted_loads import (
    BodyLoads,
    geometric_stiffness_over,
    transmitted_loads,
    transmitted_loads_of,
    without_negligible_terms,
)
from fmd.reduction.body import MarkerShapes
from fmd.scene.joints.fixed import FIXED
from fmd.scene.joints.free import FREE
from fmd.scene.joints.revolute import REVOLUTE

ROD = rigid_integrals(2.0, np.array([0.5, 0.0, 0.0]), np.diag([0.0, 0.2, 0.2]))
AT_END = np.array([1.0, 0.0, 0.0])


def still(mechanism: Mechanism) -> Kinematics:
    times = np.linspace(0.0, 1.0, 11)
    q = np.broadcast_to(mechanism.rest_positions, (11, mechanism.n_positions))
    return Kinematics(mechanism, times, q, np.zeros((11, mechanism.n)))


def test_joints_transmit_the_torques_that_drive_them() -> None:
    """A double pendulum in space with a spring, motors and a follower torque, integrated by DOP853."""
    links = [
        Link("upper", ROD, REVOLUTE, axis=np.array([0.0, 0.0, 1.0]), load=constant(3.0)),
        Link(
            "lower",
            ROD,
            REVOLUTE,
            0,
            MarkerShapes(AT_END),
            np.array([0.0, 1.0, 0.0]),
            spring=5.0,
            rest=0.3,
            load=constant(-0.7),
        ),
    ]
    twist = PointLoad(
        "lower", np.array([0.0, 0.6, 0.8]), constant(0.4), torque=True, following=True, marker=MarkerShapes(AT_END)
    )
    mechanism = Mechanism(links, gravity=np.array([1.0, -9.8, 2.0]), loads=[twist])
    compiled, times = compile_mechanism(mechanism), np.linspace(0.0, 1.0, 2001)
    done = solve_ivp(
        lambda t, y: np.concatenate([y[2:], compiled.accelerations(t, y[:2], y[2:])]),
        (0.0, 1.0), [0.2, -0.3, 1.0, 2.0], "DOP853", times, rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    q, v = done.y[:2].T, done.y[2:].T
    upper, lower = transmitted_loads(Kinematics(mechanism, times, q, v))
    inside = slice(5, -5)  # differences at the ends are of a lower order
    assert upper.joint[inside, 5] == pytest.approx(np.full(1991, 3.0), abs=2e-3)
    assert lower.joint[inside, 4] == pytest.approx(-0.7 - 5.0 * (q[inside, 1] - 0.3), abs=2e-3)
    assert lower.wrenches[0, :, 3:] == pytest.approx(np.tile([0.0, 0.24, 0.32], (2001, 1)))


def test_loads_over_motions_that_are_looked_at_together_are_those_of_each() -> None:
    links = [Link(name, ROD, REVOLUTE, k - 1, MarkerShapes(k * AT_END)) for k, name in enumerate(("upper", "lower"))]
    links, times = [replace(links[0], parent=-1), replace(links[1], spring=3.0)], np.linspace(0.0, 1.0, 31)
    stiff = Mechanism([links[0], replace(links[1], spring=40.0)])
    motions = [
        Kinematics(own, times, *np.stack([np.outer(np.sin(k * times), [1.0, k]), np.outer(np.cos(times), [k, 2.0])]))
        for k, own in enumerate((Mechanism(links), stiff), 1)
    ]
    for together, motion in zip(transmitted_loads_of(motions), motions, strict=True):
        for found, alone in zip(together, transmitted_loads(motion), strict=True):
            for name in ("spin", "turning", "acceleration", "wrenches", "joint"):
                assert np.array_equal(getattr(found, name), getattr(alone, name)), name


def test_a_hanging_load_pulls_with_its_weight() -> None:
    links = [
        Link("rod", ROD, FIXED),
        Link("load", rigid_integrals(3.0, np.zeros(3), np.zeros((3, 3))), FIXED, 0, MarkerShapes(AT_END)),
    ]
    push = PointLoad("load", np.array([0.0, 2.0, 0.0]), constant(4.0))
    rod, load = transmitted_loads(still(Mechanism(links, gravity=np.array([10.0, 0.0, 0.0]), loads=[push])))
    assert rod.wrenches[0, 5] == pytest.approx([30.0, 4.0, 0.0, 0.0, 0.0, 0.0])
    assert rod.joint[5] == pytest.approx([-50.0, -4.0, 0.0, 0.0, 0.0, -4.0])
    assert load.acceleration[5] == pytest.approx([-10.0, 0.0, 0.0])


def test_a_turning_mass_pulls_outwards() -> None:
    links = [
        Link("rod", ROD, FREE),
        Link("load", rigid_integrals(3.0, np.zeros(3), np.zeros((3, 3))), FIXED, 0, MarkerShapes(AT_END)),
    ]
    mechanism = Mechanism(links)
    times = np.linspace(0.0, 1.0, 2001)
    angle = 7.0 * times
    q, v = np.zeros((2001, 7)), np.zeros((2001, 6))
    q[:, 5], q[:, 6], v[:, 5] = np.sin(angle / 2), np.cos(angle / 2), 7.0
    rod, _ = transmitted_loads(Kinematics(mechanism, times, q, v))
    assert rod.wrenches[0, 5:-5] == pytest.approx(np.tile([3.0 * 49.0, 0, 0, 0, 0, 0], (1991, 1)), abs=1e-3)


def test_terms_that_no_load_makes_count_are_left_out() -> None:
    rng = np.random.default_rng(0)
    displacement2 = rng.normal(size=(6, 2, 2))
    displacement2 = displacement2 + displacement2.transpose(0, 2, 1)
    displacement2[2:] *= 1e-9
    integrals = rigid_integrals(2.0, np.zeros(3), np.eye(3))
    G = np.zeros((3, 3, 3, 3))
    G[:, :, :1, :1] = integrals.G
    G[[0, 1], [0, 1], [1, 2], [1, 2]] = 1.0
    carrier = Link("rod", replace(integrals, G=G, S=np.zeros((3, 3))), FIXED, omega=np.array([10.0, 20.0]))
    load = Link(
        "load",
        rigid_integrals(3.0, np.zeros(3), np.zeros((3, 3))),
        FIXED,
        0,
        MarkerShapes(AT_END, displacement2=displacement2),
    )
    mechanism = Mechanism([carrier, load], gravity=np.array([10.0, 0.0, 0.0]))
    loads = transmitted_loads(still(mechanism.rigid))[0]
    K = geometric_stiffness_over(mechanism, 0, loads)[0]
    assert pytest.approx(K) == -30.0 * displacement2[0]
    left = without_negligible_terms(mechanism, 0, loads, 1e-4).links[1].place.displacement2
    assert np.array_equal(left[:2], displacement2[:2])  # across the pull, a tenth of it is taken for granted
    assert not left[2:].any()
    assert without_negligible_terms(mechanism, 0, loads, 100.0).links[1].place.displacement2.size == 0


def test_rotation_and_the_joints_moment_stiffen_by_their_own_forms() -> None:
    """A rotation as centrifugal forces act, ``−ω × (ω × r)``; a moment about the axis does work on the joint's turn."""
    rng, spin, moment = np.random.default_rng(4), np.array([0.3, -1.2, 2.0]), np.array([0.5, 1.5, -2.0])
    forms, turned = rng.normal(size=(3, 3, 2, 2)), rng.normal(size=(2, 2))
    stiffening, bent = forms + forms.swapaxes(2, 3), turned + turned.T
    axis = np.array([0.0, 0.6, 0.8])
    integrals = replace(ROD, G=np.zeros((3, 3, 3, 3)), S=np.zeros((3, 3)), stiffening=stiffening)
    link = Link("rod", integrals, REVOLUTE, axis=axis, omega=np.ones(2), joint_displacement2=bent)
    still, loads = np.zeros((1, 3)), np.zeros((0, 1, 6))
    acting = BodyLoads(
        spin[None], still, still, loads, np.r_[0.0, 0.0, 0.0, moment][None], np.zeros((0, 6), dtype=bool)
    )
    (K,) = geometric_stiffness_over(Mechanism([link]), 0, acting)
    outwards = -np.array([np.cross(spin, np.cross(spin, e)) for e in np.eye(3)])
    assert pytest.approx(K, rel=1e-12) == np.tensordot(outwards, stiffening, 2) - (moment @ axis) * bent
