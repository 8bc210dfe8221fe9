"""Frames, energies and momenta of mechanisms against mass points, compiled functions and differences."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fmd.core.arrays import Array
from fmd.core.formula import parse_formula
from fmd.core.rotations import quaternion_of_matrix, rotation_matrix
from fmd.dynamics.compiler.compiled import compile_mechanism
from fmd.dynamics.compiler.recorded import record_mechanism
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import formula
from fmd.reduction.body import MarkerShapes
from fmd.scene.joints.free import FREE
from fmd.scene.joints.revolute import REVOLUTE

Make = Callable[..., Any]

WEIGHT = (1.0, -2.0, -9.81)  # aslant, so that no axis of the ground is special


def at(mechanism: Mechanism, q: Array, v: Array, t: float = 0.0) -> Kinematics:
    """Kinematics of one state, by arrays of one row."""
    return Kinematics(mechanism, np.array([t]), q[None], v[None])


def test_frames_are_those_of_matrix_products(chain: Make, name: str) -> None:
    some = chain(name)
    q, v = some.state(5)
    found = at(some.tree, q, v).frames
    for frame, (origin, R) in zip(found, some.frames(q), strict=True):
        assert frame.origin[0] == pytest.approx(origin, abs=1e-13)
        assert frame.rotation[0] == pytest.approx(R, abs=1e-13)


def test_velocities_are_the_slopes_of_the_frames(chain: Make, name: str) -> None:
    some = chain(name)
    q, v = some.state(6)
    complex_step = some.frames(q + 1e-30j * some.derivative(q, v))
    for frame, (origin, R) in zip(at(some.tree, q, v).frames, complex_step, strict=True):
        assert frame.velocity[0] == pytest.approx(origin.imag / 1e-30, abs=1e-12)
        spin = R.imag / 1e-30 @ R.real.T  # the cross product with the angular velocity
        assert frame.spin[0] == pytest.approx([spin[2, 1], spin[0, 2], spin[1, 0]], abs=1e-12)


def test_a_marker_is_where_it_is_whether_one_body_is_asked_for_or_all(chain: Make, name: str) -> None:
    some = chain(name)
    states = [some.state(seed) for seed in range(3)]
    q, v = (np.array(part) for part in zip(*states, strict=True))
    markers = [(body, marker) for body, link in enumerate(some.tree.links) for marker in link.markers]
    whole = Kinematics(some.tree, np.zeros(3), q, v)
    assert len(whole.frames) == len(some.tree.links)
    for place in markers:
        alone = Kinematics(some.tree, np.zeros(3), q, v)
        assert np.array_equal(alone.marker_position(*place), whole.marker_position(*place))
        assert "frames" not in vars(alone)


def test_energies_and_momenta_are_those_of_the_points(chain: Make, name: str) -> None:
    some = chain(name, gravity=WEIGHT)
    states = [some.state(seed) for seed in range(4)]
    q, v = (np.array(part) for part in zip(*states, strict=True))
    found = Kinematics(some.tree, np.zeros(4), q, v)
    for k, state in enumerate(states):
        kinetic, potential = found.energies
        assert kinetic[k] == pytest.approx(some.kinetic(*state), rel=1e-12)
        assert potential[k] == pytest.approx(some.potential(state[0]), rel=1e-11)
        linear, angular = some.momenta(*state)
        assert found.momentum[k] == pytest.approx(linear, rel=1e-11, abs=1e-11 * np.abs(linear).max())
        assert found.angular_momentum[k] == pytest.approx(angular, rel=1e-11, abs=1e-11 * np.abs(angular).max())
        centre = some.masses @ some.points(state[0]) / some.masses.sum()
        assert found.centre_of_mass[k] == pytest.approx(centre, rel=1e-12, abs=1e-12)


def test_frames_and_energies_are_those_of_the_compiled_functions(chain: Make, name: str) -> None:
    some = chain(name, gravity=WEIGHT)
    links = [replace(link, integrals=bowed(link, k)) for k, link in enumerate(some.tree.links)]
    tree = replace(some.tree, links=links)
    compiled = compile_mechanism(tree)
    for seed in range(3):
        q, v = some.state(seed)
        found, (origins, rotations, spins) = at(tree, q, v), compiled.frames(0.0, q, v)
        assert np.ravel(found.energies) == pytest.approx(compiled.energies(0.0, q, v), rel=1e-12)
        M = compiled.mass_matrix(compiled.signal_values(0.0), q)
        assert found.energies[0][0] == pytest.approx(0.5 * v @ M @ v, rel=1e-12)
        for k, frame in enumerate(found.frames):
            assert frame.origin[0] == pytest.approx(origins[k], abs=1e-12)
            assert frame.rotation[0] == pytest.approx(rotations[k], abs=1e-12)
            assert frame.spin[0] == pytest.approx(spins[k], abs=1e-12 * (1 + np.abs(v).max()))


def test_mechanisms_that_differ_in_springs_are_traced_once_and_have_energies_of_their_own(
    chain: Make, name: str
) -> None:
    some = chain(name, gravity=WEIGHT)
    q, v = some.state(7)
    trees = [replace(some.tree, links=[sprung(link, factor) for link in some.tree.links]) for factor in (1.0, 3.0, 0.5)]
    assert len({id(record_mechanism(tree)) for tree in trees}) == 1
    for tree in (*trees[::-1], *trees):
        want = compile_mechanism(tree).energies(0.0, q, v)
        assert np.ravel(at(tree, q, v).energies) == pytest.approx(want, rel=1e-12)
    if any(link.unit for link in some.tree.links):
        assert len({float(at(tree, q, v).energies[1][0]) for tree in trees}) == 3
    renamed = replace(trees[0], links=[replace(trees[0].links[0], joint_name="other"), *trees[0].links[1:]])
    for other in (replace(trees[0], gravity=np.zeros(3)), renamed):
        assert record_mechanism(other) is not record_mechanism(trees[0])


def sprung(link: Link, factor: float) -> Link:
    """Give a joint with one coordinate a spring, a rest and a damper."""
    return replace(link, spring=20.0 * factor, rest=0.1 / factor, damper=0.2) if link.unit else link


def bowed(link: Link, seed: int) -> Any:
    """Inertia integrals with second-order first moments, as stiffened bodies have them."""
    n = len(link.omega)
    displacement2 = 0.1 * np.random.default_rng(seed).normal(size=(3, n, n))
    return replace(link.integrals, displacement2=displacement2 + displacement2.swapaxes(1, 2))


def test_a_prescribed_joint_moves_as_the_released_one_with_its_motion(chain: Make) -> None:
    some = chain("revolute-flexible")
    motion = formula(parse_formula("0.7*sin(1.5*t)"))
    first = replace(some.tree.links[0], motion=motion, joint_rotation=np.zeros(0))
    given = replace(some.tree, links=[first, *some.tree.links[1:]])
    rng = np.random.default_rng(3)
    q, v, t = rng.normal(size=given.n_positions), rng.normal(size=given.n), 0.6
    # The first joint is slow: free, it takes the first place.
    position, rate, _ = motion.value(t)
    free = replace(given, links=[replace(first, motion=None), *given.links[1:]])
    assert (free.layout.position[0], free.layout.rate[0]) == (0, 0)
    here, there = at(given, q, v, t), at(free, np.r_[position, q], np.r_[rate, v], t)
    assert here.along_joint(0)[1] == pytest.approx([motion.value(t)[1]])
    for one, other in zip(here.frames, there.frames, strict=True):
        for a, b in zip(one, other, strict=True):
            assert a == pytest.approx(b, abs=1e-13)
    assert here.energies[0] == pytest.approx(there.energies[0], rel=1e-13)
    assert here.energies[1] == pytest.approx(there.energies[1], rel=1e-13)


@pytest.mark.parametrize("size", [0.0, 1e-9, 0.049, 0.051, 1.0, 3.0])
def test_rotation_vectors_of_any_size_give_rotations(size: float) -> None:
    angle = size * np.array([[2.0, -1.0, 3.0]]) / np.sqrt(14.0)
    assert rotation_matrix(angle) == pytest.approx(Rotation.from_rotvec(angle).as_matrix(), abs=1e-14)


def test_quaternions_of_a_turning_body_have_no_jump() -> None:
    angles = np.linspace(0.0, 20.0, 201)[:, None] * np.array([0.6, 0.0, 0.8])
    R = Rotation.from_rotvec(angles).as_matrix()
    found = quaternion_of_matrix(R)
    assert Rotation.from_quat(found).as_matrix() == pytest.approx(R, abs=1e-13)
    assert np.abs(np.diff(found, axis=0)).max() < 0.06


def test_a_free_body_keeps_its_marker_where_rotation_takes_it() -> None:
    markers = {"nose": MarkerShapes(np.array([1.0, 0.0, 0.0]), np.zeros((3, 0)), np.zeros((3, 0)))}
    body = Link("body", rigid_integrals(2.0, np.zeros(3), np.eye(3)), FREE, markers=markers)
    turn = Rotation.from_rotvec([0.0, 0.0, np.pi / 2])
    q = np.r_[1.0, 2.0, 3.0, turn.as_quat()]
    found = at(Mechanism([body]), q, np.r_[4.0, 5.0, 6.0, 0.0, 0.0, 1.0])
    assert found.marker_position(0, "nose")[0] == pytest.approx([1.0, 3.0, 3.0])
    assert found.momentum[0] == pytest.approx([8.0, 10.0, 12.0])
    assert found.body_spin(0)[0] == pytest.approx([0.0, 0.0, 1.0])
    assert not found.deflection(0, "nose").any()


def test_a_large_turn_of_the_section_is_no_deflection_where_displacements_of_second_order_are_known() -> None:
    """A shape that is a rotation by q, to the second order: what is left is of the third."""
    z, r = np.array([0.0, 0.0, 1.0]), np.array([0.3, 0.1, 0.0])
    inwards = np.r_[np.cross(z, np.cross(z, r)), np.zeros(3)][:, None, None]
    markers = {
        "root": MarkerShapes(np.zeros(3), np.zeros((3, 1)), z[:, None], 0 * inwards),
        "tip": MarkerShapes(r, np.cross(z, r)[:, None], z[:, None], inwards),
    }
    integrals = rigid_integrals(1.0, r / 2, np.eye(3))
    integrals = replace(
        integrals, G=np.pad(integrals.G, ((0, 0), (0, 0), (0, 1), (0, 1))), S=np.pad(integrals.S, ((0, 0), (0, 1)))
    )
    body = Link(
        "body", integrals, REVOLUTE, omega=np.ones(1), joint_rotation=np.ones(1), markers=markers, section="root"
    )
    found = at(Mechanism([body]), np.array([0.2, 0.1]), np.zeros(2))
    assert np.abs(found.deflection(0, "tip")[0]).max() < 0.1**3 / 6 * 0.32 * 1.1


def test_a_turn_of_the_section_at_the_joint_is_no_deflection() -> None:
    # One shape, a small rotation about z: it turns the section and carries the tip along.
    z, r = np.array([0.0, 0.0, 1.0]), np.array([0.3, 0.1, 0.0])
    turn = z[:, None]
    markers = {
        "root": MarkerShapes(np.zeros(3), np.zeros((3, 1)), turn),
        "tip": MarkerShapes(r, np.cross(z, r)[:, None], turn),
    }
    integrals = rigid_integrals(1.0, r / 2, np.eye(3))
    integrals = replace(
        integrals, G=np.pad(integrals.G, ((0, 0), (0, 0), (0, 1), (0, 1))), S=np.pad(integrals.S, ((0, 0), (0, 1)))
    )
    body = Link(
        "body", integrals, REVOLUTE, omega=np.ones(1), joint_rotation=np.ones(1), markers=markers, section="root"
    )
    found = at(Mechanism([body]), np.array([0.2, 1e-3]), np.array([0.0, 0.5]))
    assert found.deflection(0, "tip")[0] == pytest.approx(np.zeros(3), abs=1e-16)
    assert np.abs(found.displacement(0, "tip")).max() > 1e-4
    assert [float(values[0]) for values in found.along_joint(0)] == pytest.approx([0.201, 0.5])
