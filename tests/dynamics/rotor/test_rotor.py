"""The equations of motion of one body on one joint, against Lagrange's equations from its full mass matrix."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.core.arrays import Array
from pipeline.dynamics.rotor.parameters import TorquePulse
from pipeline.dynamics.rotor.rotor import PlanarRotor
from pipeline.dynamics.system import accelerations, advance, fast_steps, hold_slow
from pipeline.integrators.protocol import evaluate
from pipeline.reduction.body import FlexibleBody, MarkerShapes
from pipeline.reduction.inertia import inertia_gram

PULSE = TorquePulse(0.2, 1.5, 20.0)
SIZES = pytest.mark.parametrize("n", [1, 3, 4, 6])


class Points(NamedTuple):
    """A body of 10 points: positions, mass matrix, shapes, the joint's axis and the rotations of its section."""

    x: Array
    m: Array
    Phi: Array
    axis: Array
    rotation: Array
    omega: Array

    def rotor(self) -> PlanarRotor:
        n = len(self.omega)
        marker = MarkerShapes(np.zeros(3), np.zeros((3, n)), self.rotation)
        gram = inertia_gram(self.x, self.m, self.Phi)
        body = FlexibleBody(self.x, self.Phi, self.omega, self.axis, "joint", {"joint": marker}, gram, np.nan)
        return PlanarRotor(body, PULSE)


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


def mass_matrix(rotor: PlanarRotor, q: Array) -> Array:
    """Mass matrix of spin and modes, from the body's 6 + n motions: only the spin about the axis is left."""
    motions = np.zeros((6 + rotor.n - 1, rotor.n))
    motions[3:6, 0] = rotor.body.axis
    motions[6:, 1:] = np.eye(rotor.n - 1)
    return motions.T @ rotor.body.gram.mass_matrix(np.r_[1.0, q[1:]]) @ motions


def by_lagrange(rotor: PlanarRotor, t: float, q: Array, v: Array) -> Array:
    """Solve d/dt ∂T/∂q̇ − ∂T/∂q = Q.

    The mass matrix is quadratic in q, so that central differences of any width are exact.
    """
    units = np.eye(rotor.n)
    rate_of_mass = 0.5 * (mass_matrix(rotor, q + v) - mass_matrix(rotor, q - v))
    slope = [0.25 * v @ (mass_matrix(rotor, q + u) - mass_matrix(rotor, q - u)) @ v for u in units]
    s = (t - PULSE.start) / PULSE.duration
    torque = PULSE.peak * np.sin(np.pi * s) if 0 < s < 1 else 0.0
    # The torque does work on the section at the joint, which turns with the frame and with each mode.
    section = np.r_[1.0, rotor.body.axis @ rotor.body.markers["joint"].rotation]
    stiffness = np.r_[0.0, rotor.body.omega**2]
    return np.linalg.solve(mass_matrix(rotor, q), slope - rate_of_mass @ v - stiffness * q + torque * section)


def compiled(rotor: PlanarRotor, t: float, q: Array, v: Array) -> Array:
    a = np.empty(rotor.n)
    evaluate(rotor.parameters, t, q, v, a)
    return a


@SIZES
@pytest.mark.parametrize("t", [0.1, 0.3, 0.95, 1.69, 1.8], ids=lambda t: f"{t}s")
def test_accelerations_follow_from_lagranges_equations(n: int, t: float) -> None:
    rotor = random_points(n).rotor()
    for seed in range(5):
        q, v = random_state(n, seed)
        want = by_lagrange(rotor, t, q, v)
        assert compiled(rotor, t, q, v) == pytest.approx(want, rel=1e-10, abs=1e-10 * np.abs(want).max())


def test_the_random_bodies_have_every_kind_of_coupling() -> None:
    rotor = random_points(4).rotor()
    D, A = rotor.parameters.D, rotor.parameters.A
    assert rotor.parameters.gyroscopic
    assert not rotor.parameters.diagonal
    assert min(np.abs(D[0, 1:]).min(), np.abs(A[0, 1:]).min(), np.abs(A[1:, 1:][~np.eye(4, dtype=bool)]).min()) > 1e-3


@SIZES
def test_shapes_along_the_axis_are_oscillators_of_their_own(n: int) -> None:
    # Points that move along the axis keep their distance from it: θ̈ = τ/J and q̈ = τψ − ω²q, whatever the rates.
    points = random_points(n)
    along = points.Phi.sum(axis=1)
    along = np.linalg.solve(np.linalg.cholesky(along.T @ points.m @ along), along.T).T
    rotor = points._replace(Phi=along[:, None, :] * points.axis[:, None]).rotor()
    q, v = random_state(n)
    arms = np.cross(points.axis, points.x)
    J = np.einsum("ia,ij,ja->", arms, points.m, arms)
    tau = PULSE.peak  # in the middle of the pulse
    want = np.r_[tau / J, tau * (points.axis @ points.rotation) - points.omega**2 * q[1:]]
    assert not rotor.parameters.gyroscopic
    assert rotor.parameters.diagonal
    assert compiled(rotor, PULSE.start + PULSE.duration / 2, q, v) == pytest.approx(want, rel=1e-10)


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
    want = compiled(points.rotor(), 0.5, q, v)
    assert compiled(turned.rotor(), 0.5, q, v) == pytest.approx(want, rel=1e-10, abs=1e-10 * np.abs(want).max())


def test_the_angle_itself_has_no_effect() -> None:
    rotor = random_points(4).rotor()
    q, v = random_state(4)
    assert np.array_equal(compiled(rotor, 0.5, q, v), compiled(rotor, 0.5, q + np.eye(5)[0], v))


@SIZES
def test_energies_are_those_of_the_points(n: int) -> None:
    points = random_points(n)
    rotor = points.rotor()
    states = [random_state(n, seed) for seed in range(4)]
    kinetic, strain = rotor.energies(*(np.array(part) for part in zip(*states, strict=True)))
    for k, (q, v) in enumerate(states):
        r = points.x + points.Phi @ q[1:]
        velocity = v[0] * np.cross(points.axis, r) + points.Phi @ v[1:]
        assert kinetic[k] == pytest.approx(0.5 * np.einsum("ia,ij,ja->", velocity, points.m, velocity), rel=1e-12)
        assert strain[k] == pytest.approx(0.5 * np.sum((points.omega * q[1:]) ** 2), rel=1e-12)


@SIZES
def test_the_frequencies_that_limit_the_step_are_those_of_the_mass_matrix(n: int) -> None:
    rotor = random_points(n).rotor()
    M = mass_matrix(rotor, np.zeros(rotor.n))
    assert rotor.reference_mass == pytest.approx(M, abs=1e-12)
    squares = np.linalg.eigvals(np.linalg.solve(M, np.diag(np.r_[0.0, rotor.body.omega**2])))
    assert rotor.highest_frequency == pytest.approx(np.sqrt(squares.real.max()), rel=1e-10)
    # Rayleigh: holding the frame is a constraint, which can only lower the highest frequency.
    assert rotor.highest_fast_frequency == rotor.body.omega.max() <= rotor.highest_frequency


def test_a_body_at_rest_stays_at_rest_until_the_torque_begins() -> None:
    rotor = random_points(3).rotor()
    assert np.array_equal(compiled(rotor, 0.0, np.zeros(4), np.zeros(4)), np.zeros(4))


def test_angular_momentum_changes_by_the_torque_alone() -> None:
    # d/dt (M q̇)_θ = τ, for the angle is cyclic.
    rotor = random_points(5).rotor()
    q, v = random_state(5)
    a = compiled(rotor, 0.95, q, v)
    rate_of_mass = 0.5 * (mass_matrix(rotor, q + v) - mass_matrix(rotor, q - v))
    assert (mass_matrix(rotor, q) @ a + rate_of_mass @ v)[0] == pytest.approx(PULSE.peak, rel=1e-10)


def test_without_gyroscopic_terms_the_short_way_is_taken_and_right() -> None:
    # A flat body that bends across one line: x along it, shapes at right angles, as a beam's in-plane bending. Modes
    # couple with the spin only, and are orthogonal to it here.
    rng = np.random.default_rng(3)
    e, along, across = np.eye(3)[[2, 0, 1]]
    x, m = rng.uniform(0.0, 2.0, 8), np.diag(rng.uniform(0.5, 1.5, 8))
    W = np.sqrt(np.diag(m))[:, None]
    Phi = (np.linalg.qr(W * np.column_stack([x, rng.normal(size=(8, 3))]))[0][:, 1:] / W)[:, None, :] * across[:, None]
    rotation = np.outer(e, [0.2, -0.3, 0.1])
    rotor = Points(x[:, None] * along, m, Phi, e, rotation, np.array([3.0, 4.0, 5.0])).rotor()
    assert rotor.parameters.diagonal
    assert not rotor.parameters.gyroscopic
    q, v = random_state(3)
    want = by_lagrange(rotor, 0.95, q, v)
    assert compiled(rotor, 0.95, q, v) == pytest.approx(want, rel=1e-10, abs=1e-10 * np.abs(want).max())


def test_spin_about_the_opposite_axis_is_spin_in_reverse() -> None:
    # With the angle, its rates and the torque negated, nothing else changes.
    points = random_points(4)
    rotor = points.rotor()
    mirrored = replace(points._replace(axis=-points.axis).rotor(), pulse=PULSE._replace(peak=-PULSE.peak))
    sign = np.r_[-1.0, np.ones(4)]
    q, v = random_state(4)
    assert sign * compiled(mirrored, 0.5, sign * q, sign * v) == pytest.approx(compiled(rotor, 0.5, q, v), rel=1e-10)


@pytest.mark.parametrize("name", [accelerations, hold_slow, fast_steps, advance], ids=lambda name: name.__name__)
def test_a_name_without_a_mechanism_does_nothing(name: Any) -> None:
    with pytest.raises(NotImplementedError, match=r"^$"):
        name(*([None] * (name.__code__.co_argcount)))
