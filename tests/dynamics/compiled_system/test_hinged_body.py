"""One flexible body on a hinge as a compiled system, against Lagrange's equations from its full mass matrix."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.links import Link
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import half_sine
from fmd.integrators.protocol import evaluate
from fmd.reduction.inertia import inertia_integrals
from fmd.scene.joints.revolute import REVOLUTE

START, DURATION, PEAK = 0.2, 1.5, 20.0  # of half a sine of torque
SIZES = pytest.mark.parametrize("n", [1, 3, 4, 6])


class Points(NamedTuple):
    """A body of 10 points: positions, mass matrix, shapes, the joint's axis and the rotations of its section."""

    x: Array
    m: Array
    Phi: Array
    axis: Array
    rotation: Array
    omega: Array

    def system(self, peak: float = PEAK) -> CompiledSystem:
        integrals = inertia_integrals(self.x, self.m, self.Phi)
        hinge = {"axis": self.axis, "joint_rotation": self.axis @ self.rotation}
        load = half_sine(START, DURATION, peak)
        return CompiledSystem(Mechanism([Link("body", integrals, REVOLUTE, omega=self.omega, load=load, **hinge)]))

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix of spin and modes: half the Hessian of the points' kinetic energy by the rates."""
        r = self.x + self.Phi @ q[1:]
        J = np.concatenate([np.cross(self.axis, r)[:, :, None], self.Phi], axis=2)
        return np.asarray(np.einsum("iak,ij,jal->kl", J, self.m, J))


def random_points(n: int, seed: int = 0) -> Points:
    rng = np.random.default_rng([n, seed])
    B, Phi, e = rng.normal(size=(10, 10)), rng.normal(size=(30, n)), rng.normal(size=3)
    m = np.eye(10) + B @ B.T / 10
    L = np.linalg.cholesky(Phi.T @ np.kron(m, np.eye(3)) @ Phi)
    Phi = np.linalg.solve(L, Phi.T).T.reshape(10, 3, n)  # unit modal mass
    rotation = 0.3 * rng.normal(size=(3, n))
    return Points(rng.normal(size=(10, 3)), m, Phi, e / np.linalg.norm(e), rotation, rng.uniform(3.0, 12.0, n))


def random_state(n: int, seed: int = 1) -> tuple[Array, Array]:
    rng = np.random.default_rng([n, seed])
    return rng.normal(size=1 + n), 2.0 * rng.normal(size=1 + n)


def by_lagrange(points: Points, t: float, q: Array, v: Array) -> Array:
    """Solve d/dt ∂T/∂q̇ − ∂T/∂q = Q.

    The mass matrix is quadratic in q, so that central differences of any width are exact.
    """
    units, M = np.eye(len(q)), points.mass_matrix
    rate_of_mass = 0.5 * (M(q + v) - M(q - v))
    slope = [0.25 * v @ (M(q + u) - M(q - u)) @ v for u in units]
    s = (t - START) / DURATION
    torque = PEAK * np.sin(np.pi * s) if 0 < s < 1 else 0.0
    # The torque does work on the section at the joint, which turns with the frame and with each mode.
    section = np.r_[1.0, points.axis @ points.rotation]
    stiffness = np.r_[0.0, points.omega**2]
    return np.linalg.solve(M(q), slope - rate_of_mass @ v - stiffness * q + torque * section)


def compiled(system: CompiledSystem, t: float, q: Array, v: Array) -> Array:
    a = np.empty(system.n)
    evaluate(system.parameters, t, q, v, a)
    return a


@SIZES
@pytest.mark.parametrize("t", [0.1, 0.3, 0.95, 1.69, 1.8], ids=lambda t: f"{t}s")
def test_accelerations_follow_from_lagranges_equations(n: int, t: float) -> None:
    points = random_points(n)
    system = points.system()
    for seed in range(5):
        q, v = random_state(n, seed)
        want = by_lagrange(points, t, q, v)
        assert compiled(system, t, q, v) == pytest.approx(want, rel=1e-10, abs=1e-10 * np.abs(want).max())


def test_the_random_bodies_have_every_kind_of_coupling() -> None:
    couplings = random_points(4).system().couplings
    assert couplings.inertial
    assert couplings.elastic  # by spin
    assert couplings.damped  # Coriolis forces
    assert couplings.mass == pytest.approx([0.0, 1.0, 1.0, 1.0, 1.0])


@SIZES
def test_shapes_along_the_axis_are_oscillators_of_their_own(n: int) -> None:
    # Points that move along the axis keep their distance from it: θ̈ = τ/J and q̈ = τψ − ω²q, whatever the rates.
    points = random_points(n)
    along = points.Phi.sum(axis=1)
    along = np.linalg.solve(np.linalg.cholesky(along.T @ points.m @ along), along.T).T
    system = points._replace(Phi=along[:, None, :] * points.axis[:, None]).system()
    q, v = random_state(n)
    arms = np.cross(points.axis, points.x)
    J = np.einsum("ia,ij,ja->", arms, points.m, arms)
    want = np.r_[PEAK / J, PEAK * (points.axis @ points.rotation) - points.omega**2 * q[1:]]  # in the pulse's middle
    assert not system.coupled
    assert not (system.couplings.inertial)
    assert not (system.couplings.elastic)
    assert not (system.couplings.damped)
    assert compiled(system, START + DURATION / 2, q, v) == pytest.approx(want, rel=1e-10)


@SIZES
def test_turning_body_and_axis_together_changes_nothing(n: int) -> None:
    points = random_points(n)
    R = Rotation.random(rng=np.random.default_rng(5)).as_matrix()
    turned = points._replace(
        x=points.x @ R.T,
        Phi=np.einsum("ab,ibk->iak", R, points.Phi),
        axis=R @ points.axis,
        rotation=R @ points.rotation,
    )
    q, v = random_state(n)
    want = compiled(points.system(), 0.5, q, v)
    assert compiled(turned.system(), 0.5, q, v) == pytest.approx(want, rel=1e-10, abs=1e-10 * np.abs(want).max())


def test_the_angle_itself_has_no_effect() -> None:
    system = random_points(4).system()
    q, v = random_state(4)
    assert np.array_equal(compiled(system, 0.5, q, v), compiled(system, 0.5, q + np.eye(5)[0], v))


@SIZES
def test_energies_are_those_of_the_points(n: int) -> None:
    points = random_points(n)
    system = points.system()
    for seed in range(4):
        q, v = random_state(n, seed)
        kinetic, strain = system.compiled.energies(0.0, q, v)
        assert kinetic == pytest.approx(0.5 * v @ points.mass_matrix(q) @ v, rel=1e-12)
        assert strain == pytest.approx(0.5 * np.sum((points.omega * q[1:]) ** 2), rel=1e-12)


@SIZES
def test_the_frequencies_that_limit_the_step_are_those_of_the_mass_matrix(n: int) -> None:
    points = random_points(n)
    system, M = points.system(), points.mass_matrix(np.zeros(1 + n))
    assert system.linear_matrices[0] == pytest.approx(M, abs=1e-12)
    squares = np.linalg.eigvals(np.linalg.solve(M, np.diag(np.r_[0.0, points.omega**2])))
    assert system.highest_frequency == pytest.approx(np.sqrt(squares.real.max()), rel=1e-10)
    # Rayleigh: holding the frame is a constraint, which can only lower the highest frequency.
    assert system.highest_fast_frequency == pytest.approx(points.omega.max(), rel=1e-12)
    assert system.highest_fast_frequency <= system.highest_frequency


def test_a_body_at_rest_stays_at_rest_until_the_torque_begins() -> None:
    assert not compiled(random_points(3).system(), 0.0, np.zeros(4), np.zeros(4)).any()


def test_angular_momentum_changes_by_the_torque_alone() -> None:
    # d/dt (M q̇)_θ = τ, for the angle is cyclic.
    points = random_points(5)
    q, v = random_state(5)
    a = compiled(points.system(), START + DURATION / 2, q, v)
    rate_of_mass = 0.5 * (points.mass_matrix(q + v) - points.mass_matrix(q - v))
    assert (points.mass_matrix(q) @ a + rate_of_mass @ v)[0] == pytest.approx(PEAK, rel=1e-10)


def test_a_flat_body_whose_bending_is_orthogonal_to_its_spin_couples_nothing() -> None:
    # x along a line, shapes at right angles to it, as a beam's in-plane bending.
    rng = np.random.default_rng(3)
    e, along, across = np.eye(3)[[2, 0, 1]]
    x, m = rng.uniform(0.0, 2.0, 8), np.diag(rng.uniform(0.5, 1.5, 8))
    W = np.sqrt(np.diag(m))[:, None]
    Phi = (np.linalg.qr(W * np.column_stack([x, rng.normal(size=(8, 3))]))[0][:, 1:] / W)[:, None, :] * across[:, None]
    rotation = np.outer(e, [0.2, -0.3, 0.1])
    points = Points(x[:, None] * along, m, Phi, e, rotation, np.array([3.0, 4.0, 5.0]))
    system = points.system()
    # The shapes are orthogonal to the spin's: nothing couples, in any state.
    assert not (system.coupled)
    assert not (system.couplings.elastic)
    assert not (system.couplings.damped)
    q, v = random_state(3)
    want = by_lagrange(points, 0.95, q, v)
    assert compiled(system, 0.95, q, v) == pytest.approx(want, rel=1e-10, abs=1e-10 * np.abs(want).max())


def test_spin_about_the_opposite_axis_is_spin_in_reverse() -> None:
    # With the angle, its rates and the torque negated, nothing else changes.
    points = random_points(4)
    mirrored = points._replace(axis=-points.axis).system(-PEAK)
    sign = np.r_[-1.0, np.ones(4)]
    q, v = random_state(4)
    want = compiled(points.system(), 0.5, q, v)
    assert sign * compiled(mirrored, 0.5, sign * q, sign * v) == pytest.approx(want, rel=1e-10)
