"""Points on rigid arms: their inertia and their motion of second order, against rotations by finite angles."""

import numpy as np
import pytest

from fmd.core.arrays import EPSILON, Array
from fmd.core.rotations import rotation_matrix
from fmd.fem.arms import second_of_mean, second_of_rigid
from fmd.fem.links import Constraints, arms_marker, inertia_points

RANDOM = np.random.default_rng(5)
STEP = 1e-3  # rad: what is left out is of third order


def test_points_on_arms_have_mass_and_inertia_of_a_body() -> None:
    turn = rotation_matrix(RANDOM.standard_normal((1, 3)))[0]
    inertia = turn @ np.diag([3.0, 4.0, 6.5]) @ turn.T
    for mass in (0.5, 40.0, 0.0):
        x, m = inertia_points(mass, inertia, 0.3)
        second = np.einsum("i,ia,ib->ab", m, x, x)
        assert m.sum() == pytest.approx(mass, abs=1e-12)
        assert np.abs(m @ x).max() < 1e-12
        assert np.trace(second) * np.eye(3) - second == pytest.approx(inertia, rel=1e-12)


def test_a_rotation_is_read_from_seven_points() -> None:
    x, _ = inertia_points(1.0, np.diag([1.0, 2.0, 2.5]), 1.0)
    x = x + RANDOM.standard_normal(3)
    marker, theta, shift = arms_marker(np.arange(7), x), RANDOM.standard_normal(3), RANDOM.standard_normal(3)
    u = shift + np.cross(theta, x - x[0])
    assert marker.rotation(u) == pytest.approx(theta, rel=1e-12)
    assert marker.translation(u) == pytest.approx(shift, rel=1e-12)


def quadratic(second: Array, theta: Array) -> Array:
    return np.asarray(0.5 * np.einsum("pcab,a,b->pc", second, theta, theta))


def test_an_arm_is_drawn_in_as_a_finite_rotation_does() -> None:
    r, theta = RANDOM.standard_normal((5, 3)), STEP * RANDOM.standard_normal(3)
    R = rotation_matrix(theta[None])[0]
    exact = r @ R.T - r - np.cross(theta, r)
    assert quadratic(second_of_rigid(r), theta) == pytest.approx(exact, abs=10 * STEP**3)


def test_an_arm_on_the_mean_motion_of_nodes_is_drawn_in_as_they_turn() -> None:
    # The nodes turn by a finite angle. The arm follows the mean of their motion, and to second order turns as they do.
    nodes = RANDOM.standard_normal((6, 3))
    nodes -= nodes.mean(axis=0)
    second = nodes.T @ nodes
    inertia = np.trace(second) * np.eye(3) - second
    weights = np.einsum("ad,dcb,ic->aib", np.linalg.inv(inertia), EPSILON, nodes)  # J⁻¹ Σ r × u
    r, theta = RANDOM.standard_normal((4, 3)), STEP * RANDOM.standard_normal(3)
    R = rotation_matrix(theta[None])[0]
    moved = nodes @ R.T - nodes
    mean = np.einsum("aib,ib->a", weights, moved)
    if np.abs(mean - theta).max() < 1e-9:
        pytest.fail("these nodes show no rotation of second order, so they prove nothing")
    exact = r @ R.T - r - np.cross(mean, r)
    assert quadratic(second_of_mean(r, nodes, weights), theta) == pytest.approx(exact, abs=20 * STEP**3)


def test_links_that_hang_on_links_are_resolved_and_circles_refused() -> None:
    constraints = Constraints(6, 0)
    constraints.give(np.array([0]), np.array([1]), np.array([[2.0]]))
    constraints.give(np.array([1]), np.array([3, 4]), np.array([[1.0, -1.0]]))
    T, independent = constraints.transformation()
    assert independent.tolist() == [2, 3, 4, 5]
    assert T.shape == (6, 4)
    assert T.toarray()[0] == pytest.approx([0.0, 2.0, -2.0, 0.0])  # by 2, 3, 4 and 5
    with pytest.raises(ValueError, match="moved by two links"):
        constraints.give(np.array([1]), np.array([2]), np.array([[1.0]]))
    constraints.give(np.array([3]), np.array([0]), np.array([[1.0]]))
    with pytest.raises(ValueError, match="in a circle"):
        constraints.transformation()
