"""Generalised-α: its order, its damping, its Newton iteration."""

import numpy as np
import pytest
import scipy.linalg

from benchmarks.stability_cases import case_builders
from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.scene.joints.revolute import REVOLUTE
from fmd.scene.joints.spherical import SPHERICAL
from tests.dynamics.hinged_body import body_of, energies, hinged


@pytest.fixture(scope="module")
def beam():
    return Pipeline(load_scene("beam-paper")).system


@pytest.fixture(scope="module")
def times():
    return np.linspace(0.0, 0.15, 61)


@pytest.fixture(scope="module")
def exact(beam, times):
    rest = np.zeros(beam.n)
    return ScipyIvp("DOP853", 1e-12).march(beam, rest, rest, times)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8, 1.0])
def test_angle_and_first_mode_converge_at_order_2(beam, times, exact, rho):
    rest, steps = np.zeros(beam.n), np.array([1e-4, 5e-5, 2.5e-5])
    errors = []
    for step in steps:
        motion = GeneralizedAlpha(step, rho).march(beam, rest, rest, times)
        errors.append(np.abs(motion.q - exact.q).max(axis=0)[:2])
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    # Chung & Hulbert's parameters make the method of second order for every ρ∞; the strongest damping reaches the
    # asymptotic range last.
    np.testing.assert_allclose(slope, GeneralizedAlpha(1e-4, rho).order(beam), atol=0.1 if rho > 0 else 0.2)


def test_frequencies_that_the_step_cannot_resolve_are_damped_by_rho_each_step(beam):
    # One mode at ω h = 1e4: each step multiplies its amplitude by about ρ∞ (Chung & Hulbert 1993, definition).
    still = hinged(body_of(beam))
    step = 1e4 / body_of(still).omega[-1]
    q0 = np.zeros(still.n)
    q0[-1] = 1e-6
    rho, n_steps = 0.6, 24
    times = np.arange(n_steps + 1) * step
    motion = GeneralizedAlpha(step, rho).march(still, q0, np.zeros(still.n), times)
    amplitude = np.abs(motion.q[:, -1])
    late = amplitude[-1] / amplitude[-9]
    assert late ** (1 / 8) == pytest.approx(rho, rel=0.25)


def test_without_damping_the_energy_of_a_ringing_beam_stays(beam):
    # ρ∞ = 1 is the trapezoidal rule: energy errors are bounded, and fall with h².
    still = hinged(body_of(beam))
    q0, v0 = np.zeros(still.n), np.zeros(still.n)
    q0[1], v0[0] = 1e-4, 20.0
    drift = []
    for step in (1e-4, 5e-5):
        motion = GeneralizedAlpha(step, 1.0).march(still, q0, v0, np.linspace(0, 1.0, 201))
        total = np.sum(energies(still, motion), axis=0)
        drift.append(np.abs(total / total[0] - 1).max())
    assert drift[1] < drift[0] / 3
    assert drift[1] < 1e-6


def test_output_times_never_change_the_steps(beam):
    rest = np.zeros(beam.n)
    few = GeneralizedAlpha(1e-4).march(beam, rest, rest, np.array([0.0, 0.05]))
    many = GeneralizedAlpha(1e-4).march(beam, rest, rest, np.linspace(0, 0.05, 777))
    np.testing.assert_array_equal(few.q[-1], many.q[-1])
    np.testing.assert_array_equal(few.end.q, many.end.q)


def test_a_spinning_body_in_space_keeps_its_quaternion_unit():
    link = Link("top", rigid_integrals(2.0, np.zeros(3), np.diag([0.1, 0.2, 0.25])), SPHERICAL)
    top = CompiledSystem(Mechanism([link]))
    start = top.mechanism.rest_positions
    v0 = np.array([0.1, 5.0, 0.1])
    motion = GeneralizedAlpha(1e-3, 1.0).march(top, start, v0, np.linspace(0, 2, 21))
    np.testing.assert_allclose(np.linalg.norm(motion.q, axis=1), 1.0, atol=1e-14)
    exact = ScipyIvp("DOP853", 1e-12).march(top, start, v0, np.linspace(0, 2, 21))
    coarse = np.abs(motion.v - exact.v).max()
    fine = GeneralizedAlpha(5e-4, 1.0).march(top, start, v0, np.linspace(0, 2, 21))
    assert coarse / np.abs(fine.v - exact.v).max() == pytest.approx(4.0, rel=0.1)  # order 2 on the rotation group


def test_a_newton_iteration_that_fails_stops_the_march(beam):
    q0, v0 = np.zeros(beam.n), np.zeros(beam.n)
    q0[1], v0[0] = 1.0, 1e100  # softening beyond all measure: the next step overflows
    with pytest.raises(
        AccuracyError, match=r"Newton's iteration did not converge at t = .* s with a step of 0.001 s; .* 0.0005 s"
    ):
        GeneralizedAlpha(1e-3).march(beam, q0, v0, np.array([0.0, 0.01]))


@pytest.mark.parametrize("share", [1.5, 20.0, 1000.0])
def test_forces_that_balance_leave_an_acceleration_with_their_round_off(share):
    # The slider's vibration is damped until the spring holds the slowly turning rod's slider: k x = m Ω² r. Both are
    # far above what accelerates it then.
    case = case_builders()["rod-slider"]()
    step = share * 2 / case.system.highest_frequency
    start = np.full(2, 1e-6), np.array([1e-9, 0.0])
    end = GeneralizedAlpha(step).march(case.system, *start, np.array([0.0, 12000 * step])).end
    radius = 1.0  # m
    assert 1e-30 < end.q[1] == pytest.approx(end.v[0] ** 2 * radius / case.lowest**2, rel=1e-3)


@pytest.mark.parametrize(("share", "n_steps"), [(0.5, 40_000), (1.5, 4000), (20.0, 4000), (1000.0, 4000)])
@pytest.mark.parametrize("size", [1e-6, 1.0])
def test_a_nearly_singular_mass_leaves_the_slow_vibrations(share, n_steps, size):
    # ω from 0.1 to 4e5 rad/s: once the fastest is damped, what accelerates the others is beneath its forces' round-off.
    case = case_builders()["M_SS nearly singular, 1e-10"]()
    squares, modes = scipy.linalg.eigh(case.M, case.K)  # 1/ω²: the slow ones are the exact ones
    omega = 1 / np.sqrt(squares[1:])
    method = GeneralizedAlpha(share * 2 / case.system.highest_frequency)
    end = method.march(case.system, np.full(5, size), np.zeros(5), np.array([0.0, n_steps * method.step])).end
    start, found = (modes[:, 1:].T @ case.K @ q for q in (np.full(5, size), end.q))
    t = end.step * method.step
    assert np.abs(found - start * np.cos(omega * t)).max() < 1e-3 * np.abs(start).max()


@pytest.mark.parametrize("swing", [0.0, 0.1])
def test_a_pendulum_comes_to_rest_at_an_angle_that_is_no_exact_number(swing):
    # Gravity's two components balance about its hinge, with a round-off that is coarser than its last swings.
    down = np.array([np.cos(0.7), np.sin(0.7), 0.0])
    integrals = rigid_integrals(1.0, down, np.eye(3))
    hanging = CompiledSystem(Mechanism([Link("pendulum", integrals, REVOLUTE, damper=2.0)], gravity=9.81 * down))
    end = GeneralizedAlpha(0.05).march(hanging, np.array([swing]), np.zeros(1), np.array([0.0, 1000.0])).end
    assert abs(end.q[0]) < 1e-12


def test_corrections_beneath_round_off_end_though_they_shrink():
    # A stiffened beam that turns steadily rests within 1e-16 m of its axis. There a trial of 1e-25 m/s² no longer moves
    # it, and corrections shrink by a steady 0.27, until after 38,948 steps twelve of them were not enough.
    case = case_builders()["beam at 1.1 ω₁, stiffened"]()
    step = 0.5 * 2 / case.system.highest_frequency
    end = GeneralizedAlpha(step).march(case.system, case.at.q, case.at.v, np.array([0.0, 42_000 * step])).end
    assert end.v[0] == pytest.approx(case.at.v[0], rel=1e-12)
    assert np.abs(end.q[1:]).max() < 1e-15


@pytest.mark.parametrize("rho", [0.8, 1.0])
def test_a_step_far_beyond_the_highest_frequency_keeps_newton_near_by(rho):
    # At ω h = 2000 the last acceleration, frozen over a step, throws the modes of a beam in its free frame metres away,
    # where their inertia swamps the rotation's: Newton's iteration ran to accelerations of 1e16 from there.
    case = case_builders()["beam, free frame"]()
    step = 1000 * 2 / case.system.highest_frequency
    q0 = np.full(case.system.n, 1e-6)
    motion = GeneralizedAlpha(step, rho).march(case.system, q0, np.zeros(case.system.n), np.arange(301) * step)
    # Coupled, modes vibrate a little wider than they began; each step multiplies what is stiff by −ρ∞ or so.
    assert np.abs(motion.q[:, 1:]).max() < 2e-6
    assert np.abs(motion.q[300, 1:]).max() < (2e-6 if rho == 1 else 1e-25)


@pytest.mark.parametrize("rho", [-0.1, 1.1, np.nan])
def test_a_rho_outside_its_range_is_refused(rho):
    with pytest.raises(ValueError, match=r"rho is .*, expected 0 … 1"):
        GeneralizedAlpha(1e-3, rho)


def test_newtons_tangent_is_the_analytic_one_of_a_linear_system(coasting):
    # At rest but for its modes the beam is a set of oscillators: q̈ = -ω² q, so with ∂q/∂q̈ = h² β (1 - α_f)/(1 - α_m)
    # the tangent of q̈ - f(q) is diagonal, 1 + ω² ∂q/∂q̈, and its factor is itself.
    method, n = GeneralizedAlpha(1e-4), coasting.n
    q0 = np.r_[0.0, np.full(n - 1, 1e-6)]
    end = method.march(coasting, q0, np.zeros(n), np.array([0.0, 1e-3])).end
    alpha_m, alpha_f, beta, _ = method.weights
    slope = method.step**2 * beta * (1 - alpha_f) / (1 - alpha_m)
    tangent = end.memory[: n * n].reshape(n, n)
    np.testing.assert_allclose(np.diag(tangent), 1 + slope * np.r_[0.0, body_of(coasting).omega ** 2], rtol=1e-6)
    assert np.abs(tangent - np.diag(np.diag(tangent))).max() < 1e-4


@pytest.mark.long
def test_a_loop_nearly_at_rest_is_marched_past_the_round_off_of_its_stiff_shapes() -> None:
    """Beside accelerations of some mm/s² the bars' hold 1e-8 m/s² of round-off of shapes up to 236 kHz.

    With twelve of them a bar the march ended at 2.424 s. C lies where eight shapes a bar take it.
    """
    places = []
    for count in (2, 6):
        keys = [f"body.{bar}.modes.count={count}" for bar in ("AB", "BC", "CD")]
        keys += [f"body.{bar}.mesh.divisions=[2,1,1]" for bar in ("AB", "BC", "CD")]
        run = Pipeline(load_scene("four-bar", [*keys, "simulation.duration=2.5 s"]), Cache(None))
        places.append(run.motion.tip_position)
    assert places[1] == pytest.approx(places[0], abs=1e-6)
