"""The exponential Rosenbrock method: its matrix functions, its Jacobian, its order, and what it solves exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from fmd import Pipeline, load_scene
from fmd.core.errors import AccuracyError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import constant, linear_table
from fmd.integrators import phi_functions, rosenbrock
from fmd.integrators.automatic import Automatic
from fmd.integrators.protocol import State, evaluate, evaluate_velocities
from fmd.integrators.rosenbrock import ExponentialRosenbrock
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.kernels.kernel import kernel
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from fmd.scene.joints.spherical import SPHERICAL
from tests.dynamics.hinged_body import body_of, energies, hinged


@kernel
def matrix_functions(A, half, levels, m):
    return phi_functions.fill_phi_functions(A, half, levels, m)


@kernel
def flow_to(m, half, ahead):
    rosenbrock._flow_to(m, half, ahead)


@kernel
def linearise(m, p, t, dt, u, n_positions):
    rosenbrock._linearise(m, p, t, dt, u, n_positions)


def phi_by_expm(A, tau):
    """φ₀ … φ₄ of ``tau A`` as blocks of one exponential (Sidje, ACM Trans Math Softw 24, 1998, theorem 1)."""
    n = len(A)
    big = np.zeros((5 * n, 5 * n))
    big[:n, :n] = tau * A
    for k in range(4):
        big[k * n : (k + 1) * n, (k + 1) * n : (k + 2) * n] = np.eye(n)
    whole = expm(big)
    return np.array([whole[:n, k * n : (k + 1) * n] for k in range(5)])


def functions_of(A, half, levels=28):
    n = len(A)
    found = np.full((levels, 5, n, n), np.nan)
    return matrix_functions(A, half, found, np.empty((7, n, n))), found


# Matrix functions ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1e-6, 0.1, 0.26, 0.9, 1.1, 1.7, 2.0, 2.8, 3.0, 11.0, 60.0])
@pytest.mark.parametrize("n", [1, 4, 9])
def test_matrix_functions_are_those_of_one_larger_exponential(n, size):
    A = np.random.default_rng(n).normal(size=(n, n))
    A *= size / np.abs(A).sum(axis=1).max()
    top, levels = functions_of(A, 1.0)
    for level in range(top + 1):
        exact = phi_by_expm(A, 0.5 ** (top - level))
        np.testing.assert_allclose(levels[level], exact, rtol=1e-12, atol=1e-13 * np.abs(exact[0]).max())


@pytest.mark.parametrize("theta", [1.0, 1e2, 1e4])
def test_matrix_functions_of_a_stiff_oscillator_are_cosine_and_sine(theta):
    # A² = −θ² 1; the recursion φ_{k+1} = A⁻¹ (φ_k − 1/k!) loses nothing for θ ≥ 1. Doubling adds up phase errors.
    A = np.array([[0.0, theta], [-theta, 0.0]])
    top, levels = functions_of(A, 1.0)
    exact = [np.array([[np.cos(theta), np.sin(theta)], [-np.sin(theta), np.cos(theta)]])]
    for factorial in (1, 1, 2, 6):
        exact.append(np.linalg.solve(A, exact[-1] - np.eye(2) / factorial))
    np.testing.assert_allclose(levels[top], exact, rtol=0, atol=1e-15 * max(10.0, 10 * theta))


def test_matrix_functions_of_a_nilpotent_matrix_are_polynomials():
    A = np.array([[0.0, 7.0], [0.0, 0.0]])
    top, levels = functions_of(A, 3.0)
    exact = [np.eye(2) / f + 3.0 * A / g for f, g in ((1, 1), (1, 2), (2, 6), (6, 24), (24, 120))]
    np.testing.assert_allclose(levels[top], exact, rtol=1e-14)


@pytest.mark.parametrize("value", [1e12, np.nan, np.inf])
def test_too_large_a_step_is_told_not_tried(value):
    assert functions_of(np.array([[value]]), 1.0)[0] == -1
    assert functions_of(np.array([[20.0]]), 1.0, levels=3)[0] == -1
    assert functions_of(np.array([[20.0]]), 1.0, levels=4)[0] == 3


@pytest.mark.parametrize("ahead", [0.0, 1e-3, 0.3, 0.5, 0.77, 0.999])
@pytest.mark.parametrize("size", [0.5, 20.0])
def test_the_flow_to_any_time_in_a_step_is_that_of_a_larger_exponential(ahead, size):
    rng = np.random.default_rng(1)
    A, c, m = rng.normal(size=(3, 3)), rng.normal(size=(4, 3)), rosenbrock.make_room(3)
    A *= size / np.abs(A).sum(axis=1).max()
    m.top[0], m.levels[:] = functions_of(A, 0.5)
    m.A[:], m.c[:], m.w[:] = A, c, np.nan
    flow_to(m, 0.5, ahead)
    phi = phi_by_expm(A, ahead)
    exact = sum(ahead ** (k + 1) * phi[k + 1] @ c[k] for k in range(4))
    np.testing.assert_allclose(m.w, exact, rtol=1e-11, atol=1e-13)


# Jacobian --------------------------------------------------------------------------------------------------------


def chain() -> CompiledSystem:
    """A bob that swings in space, a slider on it, a spin about it."""
    bob = rigid_integrals(2.0, np.array([0.0, 0.1, -0.5]), np.diag([0.11, 0.12, 0.05]))
    links = [
        Link("bob", bob, SPHERICAL),
        Link("slider", rigid_integrals(0.5, np.zeros(3), np.zeros((3, 3))), PRISMATIC, 0, axis=[0, 0, 1], spring=200.0),
        Link(
            "wheel", rigid_integrals(1.0, np.array([0.1, 0, 0]), np.diag([0.1, 0.2, 0.3])), REVOLUTE, 1, axis=[0, 1, 0]
        ),
    ]
    return CompiledSystem(Mechanism(links, gravity=np.array([0, 0, -9.81])))


def slope_of(tree, u, t=0.0):
    q, v, n = u[: tree.n_positions], u[tree.n_positions :], tree.n_positions
    F = np.empty(u.size)
    evaluate_velocities(tree.parameters, q.copy(), v.copy(), F[:n])
    evaluate(tree.parameters, t, q.copy(), v.copy(), F[n:])
    return F


def test_the_jacobian_is_that_of_central_differences():
    tree, rng = chain(), np.random.default_rng(2)
    u = np.r_[tree.mechanism.rest_positions, np.zeros(tree.n)] + 0.3 * rng.normal(size=tree.n_positions + tree.n)
    n, m = u.size, rosenbrock.make_room(u.size)
    m.J[:], m.dt[:], m.F[:], m.marks[:] = np.nan, np.nan, slope_of(tree, u), 10.0
    exact = np.empty((n, n))
    for j, unit in enumerate(np.eye(n)):  # of order 4
        ahead, far = (slope_of(tree, u + h * unit) - slope_of(tree, u - h * unit) for h in (1e-4, 2e-4))
        exact[:, j] = (8 * ahead - far) / 12e-4
    before = u.copy()
    linearise(m, tree.parameters, 0.0, 1e-6, u, tree.n_positions)
    np.testing.assert_array_equal(u, before)
    np.testing.assert_allclose(m.J, exact, atol=1e-6 * np.abs(exact).max())
    np.testing.assert_array_equal(m.dt, np.zeros(n))  # nothing here depends on time


# Order -----------------------------------------------------------------------------------------------------------


def with_fixed_steps(system, q0, v0, h, n_steps):
    """March with the method's own kernel, its choice of the next step overruled each time."""
    method = ExponentialRosenbrock(0.999)
    first = method.march(system, q0, v0, np.zeros(1)).end
    n_groups = first.memory.size // 2 - 1
    large = np.r_[np.zeros(n_groups), np.full(n_groups, 1e9), 0.0, 0.0]  # nothing balances, no step is rejected
    state = State(0, q0.astype(float), v0.astype(float), first.a, 0.0, h, large)
    for k in range(n_steps):
        state = method.resume(system, state, np.array([(k + 0.5) * h])).end
        assert state.step == k + 1
        state = replace(state, next_step=h)
    assert state.time == pytest.approx(n_steps * h)
    return state


def order_cases():
    pipeline = Pipeline(load_scene("rod-slider"))
    yield pipeline.system, *pipeline.start, 1.0, np.array([8, 16, 32])
    rotor = Pipeline(load_scene("beam-paper")).system  # while the torque acts, which has no kink before 0.1 s
    yield rotor, np.zeros(rotor.n), np.zeros(rotor.n), 0.05, np.array([20, 40, 80])
    tree = chain()
    yield tree, tree.mechanism.rest_positions, np.array([2.0, 1.0, 8.0, 0.0, 3.0]), 0.5, np.array([64, 128, 256])


@pytest.mark.parametrize("k", range(3), ids=["rod-slider", "beam", "chain"])
def test_with_fixed_steps_it_is_of_its_declared_order(k):
    system, q0, v0, duration, counts = list(order_cases())[k]
    exact = ScipyIvp("DOP853", 1e-13).march(system, q0, v0, np.array([duration]))
    errors = []
    for n_steps in counts:
        end = with_fixed_steps(system, q0, v0, duration / n_steps, n_steps)
        errors.append(np.abs(end.q - exact.q[0]).max() / np.abs(exact.q[0]).max())
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert errors[-1] > 1e-12
    assert slope == pytest.approx(ExponentialRosenbrock(1e-3).order(system), abs=0.35)


# What is solved exactly ------------------------------------------------------------------------------------------


def test_an_oscillator_under_a_load_linear_in_time_is_solved_exactly_in_steps_far_beyond_its_period():
    # x(t) of a mass 5 kg on 1000 N/m under 3 N + 2 N/s t, up to a kink at 40 s: the particular solution and a cosine.
    point = rigid_integrals(5.0, np.zeros(3), np.zeros((3, 3)))
    load = linear_table(np.array([0.0, 40.0, 80.0]), np.array([3.0, 83.0, 83.0]))
    link = Link("point", point, PRISMATIC, axis=np.array([1, 0, 0]), spring=1000.0, load=load)
    tree = CompiledSystem(Mechanism([link]))
    times, omega = np.linspace(0.0, 40.0, 201), np.sqrt(200.0)
    march = ExponentialRosenbrock(1e-3).march(tree, np.array([0.01]), np.zeros(1), times)
    amplitude, rate = 0.01 - 0.003, -0.002 / omega
    exact = 0.003 + 0.002 * times + amplitude * np.cos(omega * times) + rate * np.sin(omega * times)
    np.testing.assert_allclose(march.q[:, 0], exact, atol=2e-7)
    assert march.end.time == 40.0
    assert march.step > 2 * np.pi / omega


def strongly_damped() -> CompiledSystem:
    """A mass of 1 kg on a damper of 1e12 N s/m under 1e12 N: 1 m/s at once."""
    point = rigid_integrals(1.0, np.zeros(3), np.zeros((3, 3)))
    return CompiledSystem(
        Mechanism([Link("point", point, PRISMATIC, axis=np.array([1, 0, 0]), damper=1e12, load=constant(1e12))])
    )


def test_between_steps_that_are_long_beside_a_strong_damper_the_motion_is_known():
    """Derivatives of a high order overflowed: all samples were NaN, without a word."""
    times = np.linspace(0.0, 1.0, 21)
    march = ExponentialRosenbrock(1e-3).march(strongly_damped(), np.zeros(1), np.zeros(1), times)
    np.testing.assert_allclose(march.q[:, 0], times, atol=1e-3)


def test_auto_does_not_march_for_ever_against_a_strong_damper():
    times = np.linspace(0.0, 1.0, 21)
    march = Automatic(1e-3, 1.0).march(strongly_damped(), np.zeros(1), np.zeros(1), times)
    np.testing.assert_allclose(march.q[:, 0], times, atol=1e-3)
    assert march.integrator == "auto (exponential-rosenbrock)"


def test_a_mode_too_fast_to_follow_costs_no_steps(rotor):
    # The same beam with its highest mode ten times as fast: explicit methods would need ten times the steps.
    body = body_of(rotor)
    stiff = replace(body, omega=body.omega * np.r_[np.ones(len(body.omega) - 1), 10.0])
    times, rest = np.array([0.05]), np.zeros(rotor.n)
    marches = [ExponentialRosenbrock(1e-4).march(r, rest, rest, times) for r in (rotor, hinged(stiff, body.load))]
    assert marches[1].end.step < 2 * marches[0].end.step
    assert marches[1].q[-1, :2] == pytest.approx(marches[0].q[-1, :2], rel=1e-2)


def test_energy_of_a_ringing_beam_that_turns_stays_to_the_tolerance(rotor):
    coasting = hinged(body_of(rotor))
    q0, v0 = np.zeros(rotor.n), np.zeros(rotor.n)
    q0[1], v0[0] = 1e-4, 20.0
    march = ExponentialRosenbrock(1e-9).march(coasting, q0, v0, np.linspace(0.0, 0.2, 51))
    total = np.sum(energies(coasting, march), axis=0)
    np.testing.assert_allclose(total / total[0], 1.0, atol=1e-7)


def test_what_is_not_finite_at_the_start_is_refused(rotor):
    with pytest.raises(AccuracyError, match="q0 holds 1 values that are not finite"):
        ExponentialRosenbrock(1e-3).march(rotor, np.r_[np.nan, np.zeros(5)], np.zeros(6), np.array([1.0]))
