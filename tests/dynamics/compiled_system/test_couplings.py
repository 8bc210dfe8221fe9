"""Structure that sub-cycling makes use of: what couples with what, found on scenes and on mechanisms with one each."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.formula import parse_formula
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import formula, half_sine
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.integrators.subcycling import Subcycling
from fmd.reduction.body import MarkerShapes
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from fmd.scene.joints.spherical import SPHERICAL

POINT = rigid_integrals(2.0, np.zeros(3), np.zeros((3, 3)))
ROD = rigid_integrals(1.0, np.array([0.25, 0.0, 0.0]), np.diag([1e-3, 0.02, 0.02]))
X, Y = np.eye(3)[:2]


def test_the_beams_modes_are_oscillators_of_their_own() -> None:
    system = Pipeline(load_scene("beam-paper")).system
    assert not (system.coupled)
    assert not (system.couplings.inertial)
    assert not (system.couplings.elastic)
    assert not (system.couplings.damped)
    assert system.couplings.mass == pytest.approx(np.r_[0.0, np.ones(system.n - 1)])
    assert system.frozen(1e-4).single
    # The torque acts on the section at the joint, which turns with the modes: its value, not its rates.
    assert system.couplings.driven.tolist() == [0]


def test_in_the_free_frame_they_couple_with_the_angle_alone() -> None:
    system = Pipeline(load_scene("beam-paper", ["simulation.frame=free"])).system
    assert system.couplings.inertial
    assert not system.couplings.elastic
    assert system.frozen(1e-4).single


def test_rods_in_a_chain_couple_by_a_mass_matrix_that_changes() -> None:
    links = [
        Link(f"rod {k}", ROD, REVOLUTE, k - 1, place=MarkerShapes(0.5 * X * (k > 0)), spring=1.0) for k in range(3)
    ]
    couplings = CompiledSystem(Mechanism(links, ["rod 1", "rod 2"])).couplings
    assert couplings.inertial
    assert couplings.mass is None
    assert couplings.damped  # centrifugal forces


def test_a_slider_across_its_cart_has_a_constant_mass_of_its_own() -> None:
    links = [Link("cart", POINT, PRISMATIC, axis=X), Link("slider", POINT, PRISMATIC, 0, axis=Y, spring=4.0)]
    across = CompiledSystem(Mechanism(links, ["slider"]))
    assert across.couplings.mass == pytest.approx([0.0, 2.0])
    assert not (across.coupled)
    assert not (across.couplings.inertial)
    assert not (across.couplings.dragging)
    along = CompiledSystem(Mechanism([links[0], replace(links[1], axis=X)], ["slider"]))
    assert along.coupled
    assert along.couplings.inertial


def test_a_slider_on_a_turning_rod_drags_the_rod_by_its_rate() -> None:
    # −2 m r ṙ θ̇ acts on the angle, and m r θ̇² on the slider: no fast rate in the fast equation.
    links = [
        Link("rod", ROD, REVOLUTE),
        Link("slider", POINT, PRISMATIC, 0, place=MarkerShapes(X), axis=X, spring=1000.0),
    ]
    couplings = CompiledSystem(Mechanism(links, ["slider"])).couplings
    assert couplings.dragging
    assert not (couplings.inertial)
    assert not (couplings.elastic)
    assert not (couplings.damped)


def test_a_spring_that_grips_a_turning_section_couples_modes() -> None:
    beam = Pipeline(load_scene("beam-paper"))
    (link,) = beam.mechanism.links
    gripped = CompiledSystem(Mechanism([replace(link, spring=1e4)]))
    assert np.abs(link.joint_rotation).max() > 0.0
    assert gripped.couplings.elastic
    assert not gripped.frozen(1e-4).single
    damped = CompiledSystem(Mechanism([replace(link, damper=10.0)]))
    assert damped.couplings.elastic
    assert damped.couplings.damped


def test_dampers_of_single_coordinates_leave_them_single() -> None:
    beam = Pipeline(load_scene("beam-paper"))
    (link,) = beam.mechanism.links
    system = CompiledSystem(Mechanism([replace(link, damping=np.full(len(link.omega), 0.01))]))
    frozen = system.frozen(1e-4)
    assert frozen.single
    assert frozen.damped


# Loads within a cycle --------------------------------------------------------------------------------------------

METHODS = [CentralDifference(1e-3), Subcycling(1e-3, 10)]


@pytest.mark.parametrize(("begin", "duration"), [(0.0135, 0.05), (0.02, 0.0333), (0.0, 0.017), (0.0215, 0.007)])
@pytest.mark.parametrize("spring", [0.0, 3.0], ids=["alone", "coupled"])
def test_a_blow_that_begins_or_ends_or_does_both_within_a_cycle_is_followed_step_by_step(
    begin: float, duration: float, spring: float
) -> None:
    # Across a heavy cart the slider feels its load alone; so each fast step is one of central difference.
    load = half_sine(begin, duration, 5.0)
    links = [
        Link("cart", POINT, PRISMATIC, axis=X),
        Link("slider", POINT, PRISMATIC, 0, axis=Y, spring=40.0, load=load),
    ]
    links.append(Link("third", POINT, PRISMATIC, 1, axis=Y, spring=spring))
    fast = ["slider", "third"] if spring else ["slider"]
    system = CompiledSystem(Mechanism(links if spring else links[:2], fast))
    rest, times = np.zeros(system.n), np.arange(101) * 1e-3
    plain, sub_cycled = (method.march(system, rest, rest, times) for method in METHODS)
    assert np.abs(plain.q[:, 1]).max() > 1e-4
    assert sub_cycled.q == pytest.approx(plain.q, abs=1e-15)


def test_a_motion_that_varies_within_a_cycle_is_followed_to_second_order() -> None:
    # A slider on a joint that moves as prescribed: m ẍ = −k x − m f̈ along it.
    motion = formula(parse_formula("0.1*sin(7*t)"))
    links = [Link("base", POINT, PRISMATIC, axis=X, motion=motion)]
    links.append(Link("slider", POINT, PRISMATIC, 0, axis=X, spring=200.0))
    system = CompiledSystem(Mechanism(links, ["slider"]))
    times, omega, drive = np.linspace(0.0, 2.0, 41), 10.0, 7.0
    size = 0.1 * drive**2 / (omega**2 - drive**2)
    exact = size * (np.sin(drive * times) - drive / omega * np.sin(omega * times))
    steps, errors = 4e-3 / 2.0 ** np.arange(3), []
    for step in steps:
        march = Subcycling(step, 5).march(system, np.zeros(1), np.zeros(1), times)
        errors.append(np.abs(march.q[:, 0] - exact).max())
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2, abs=0.1)


# Copies ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "method", [CentralDifference(1e-3), Subcycling(1e-3, 5), ReversibleSubcycling(1e-3, 5)], ids=lambda m: m.name
)
def test_a_pickled_system_moves_alike_bit_for_bit(method: CentralDifference) -> None:
    bob = rigid_integrals(2.0, np.array([0.0, 0.1, -0.5]), np.diag([0.11, 0.12, 0.05]))
    links = [Link("bob", bob, SPHERICAL), Link("slider", POINT, PRISMATIC, 0, axis=X, spring=200.0)]
    system = CompiledSystem(Mechanism(links, ["slider"], gravity=np.array([0.0, 0.0, -9.81])))
    start, times = (system.mechanism.rest_positions, np.array([0.3, -0.2, 2.0, 0.1])), np.linspace(0.0, 0.5, 11)
    one = method.march(system, *start, times)
    other = method.march(pickle.loads(pickle.dumps(system)), *start, times)
    assert np.array_equal(other.q, one.q)
    assert np.array_equal(other.v, one.v)
    # Unit quaternions stay unit.
    assert np.linalg.norm(one.q[:, :4], axis=1) == pytest.approx(np.ones(11), abs=1e-14)
