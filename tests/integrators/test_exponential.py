"""The exponential method: its φ functions, what it solves exactly, order, output, restart, work, stability."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from math import factorial
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, StabilityError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import half_sine
from fmd.dynamics.system import PlainSystem, accelerations
from fmd.integrators.exponential import Exponential, fill_functions
from fmd.integrators.protocol import State
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.kernels.table import Table
from fmd.recovery.motion import Motion
from fmd.reduction.body import FlexibleBody
from tests.dynamics.hinged_body import body_of, energies, hinged
from tests.linear_system import LinearSystem

Body = Callable[..., FlexibleBody]
Reference = Callable[..., tuple[Array, Array]]
Order = Callable[[Array, Array], float]

KINDS = pytest.mark.parametrize("kind", ["uncoupled", "conforming", "coupled"])
PULSE = half_sine(0.32, 1.6, 20.0)  # begins and ends with a step of each march below: its kinks cost no order
EPSILON = np.finfo(float).eps
MILLI = 1e-3


@dataclass(frozen=True)
class Pushed(Table):
    """Oscillators under constant forces, with a negative damper if one is wanted, that count how often they are asked.

    The damper's coefficient multiplies the rate: a positive one feeds the motion.
    """

    calls: Array  # (1,)
    stiffness: Array
    force: Array
    growth: float


@accelerations.register(Pushed)
def _accelerations(p: Pushed, t: float, q: Array, v: Array, a: Array) -> None:
    p.calls[0] += 1
    for i in range(v.size):
        a[i] = p.force[i] - p.stiffness[i] * q[i] + p.growth * v[i]


@dataclass(frozen=True)
class PushedOscillators(PlainSystem):
    stiffness: Array
    force: Array
    growth: float = 0.0
    quaternions: int = 0

    n_slow = 1
    coupled = False
    breakpoints = ()

    @property
    def n(self) -> int:
        return len(self.stiffness)

    @property
    def n_positions(self) -> int:
        return self.n + self.quaternions

    @property
    def parameters(self) -> Pushed:
        return self._parameters

    def __post_init__(self) -> None:
        object.__setattr__(self, "_parameters", Pushed(np.zeros(1), self.stiffness, self.force, self.growth))


def moving(rotor: CompiledSystem, deformed: float = 0.1, rate: float = 0.5) -> tuple[Array, Array]:
    """Coordinates and rates of a body that turns and vibrates."""
    modal = deformed * np.random.default_rng(0).normal(size=(2, rotor.n - 1))
    return np.r_[0.3, modal[0]], np.r_[rate, 3 * modal[1]]


def assert_same_state(one: State, other: State) -> None:
    assert one.step == other.step
    for name in "qva":
        assert np.array_equal(getattr(one, name), getattr(other, name))


# The φ functions -------------------------------------------------------------------------------------------------

# Both sides of θ = 1, where the series gives way to the recurrence, are among them.
ANGLES = [0.0, 1e-9, 1e-3, 0.1, 0.5, 0.9, np.nextafter(1.0, 0.0), 1.0, np.nextafter(1.0, 2.0), 1.1, 2.0, np.pi, 6.0,
          2 * np.pi, 10.0, 20.0, 50.0]  # fmt: skip
AT_ANGLES = pytest.mark.parametrize("theta", ANGLES)


def functions(theta: float, h: float) -> Array:
    """Re φ_k and h Im φ_k/θ, rows k = 0 … 3."""
    out = np.empty(8)
    fill_functions((theta / h) ** 2, h, out)
    return out.reshape(4, 2)


@AT_ANGLES
@pytest.mark.parametrize("h", [1.0, 0.005])
def test_the_phi_functions_are_blocks_of_the_exponential_of_the_augmented_matrix(theta: float, h: float) -> None:
    # exp [[Z, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 0, 0, 0]] has φ₀ … φ₃ of Z in its first row (Sidje, ACM Trans
    # Math Softw 24, 1998, theorem 1). Z = L h; position in units of 1/ω, without which expm itself loses digits.
    omega = theta / h
    scale = np.diag([1.0 / max(omega, 1.0 / h), 1.0])  # (q, v) = scale (x, v)
    L = np.linalg.solve(scale, np.array([[0.0, 1.0], [-(omega**2), 0.0]]) @ scale)
    Z = np.kron(np.diag([1.0, 1.0, 1.0], 1), np.eye(2))
    Z[:2, :2] = h * L
    row = expm(Z)[:2]
    for k, (own, to_position) in enumerate(functions(theta, h)):
        block = scale @ row[:, 2 * k : 2 * k + 2] @ np.linalg.inv(scale)
        # Round-off of expm's squarings grows with the norm of Z.
        size = 20 * EPSILON * max(1.0, theta) / factorial(k)
        assert own == pytest.approx(block[1, 1], rel=0, abs=size)
        assert own == pytest.approx(block[0, 0], rel=0, abs=size)
        assert to_position == pytest.approx(block[0, 1], rel=0, abs=size * scale[0, 0])
        assert -((theta / h) ** 2) * to_position == pytest.approx(block[1, 0], rel=0, abs=size / scale[0, 0])


@AT_ANGLES
def test_the_phi_functions_are_the_sums_of_their_series(theta: float) -> None:
    # φ_k(iθ) = Σ (iθ)^m/(m + k)!, summed in fractions, where nothing cancels; n terms leave θⁿ/n! < 1e-20.
    square, half = -(Fraction(theta) ** 2), 12 + int(1.5 * theta)
    for k, (real, imaginary) in enumerate(functions(theta, 1.0)):
        even = sum((square**m / factorial(2 * m + k) for m in range(half)), Fraction(0))
        odd = sum((square**m / factorial(2 * m + 1 + k) for m in range(half)), Fraction(0))
        # The recurrence divides by θ ≥ 1 each time: its round-off is that of numbers up to 1, plus θ's own in cosine
        # and sine, which √(θ²) h may miss by a unit in the last place.
        assert real == pytest.approx(float(even), rel=0, abs=4 * EPSILON * max(1.0, theta if k == 0 else 1.0))
        assert imaginary == pytest.approx(float(odd), rel=0, abs=4 * EPSILON)


@pytest.mark.parametrize("h", [1.0, 0.005])
def test_without_stiffness_the_phi_functions_are_those_of_taylor(h: float) -> None:
    # φ_k(0) = 1/k! and φ_k'(0) = 1/(k + 1)!.
    expected = [(1 / factorial(k), h / factorial(k + 1)) for k in range(4)]
    assert functions(0.0, h) == pytest.approx(np.array(expected), rel=EPSILON)


@pytest.mark.parametrize("k", range(4))
@pytest.mark.parametrize("which", [0, 1])
def test_the_phi_functions_pass_from_series_to_recurrence_without_a_jump(k: int, which: int) -> None:
    # |d/dθ| < 1 for all of them, so that only round-off can be seen across a unit in the last place.
    below, above = functions(np.nextafter(1.0, 0.0), 1.0), functions(1.0, 1.0)
    assert below[k, which] == pytest.approx(above[k, which], rel=0, abs=4 * EPSILON)


# What is solved exactly ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [1e-3, 0.07, 1.0, 3.0, 25.0])
@pytest.mark.parametrize("force", [0.0, 2.5])
def test_an_oscillator_under_a_constant_force_is_exact_for_any_step(step: float, force: float) -> None:
    # q = f/ω² + (q₀ − f/ω²) cos ωt + v₀/ω sin ωt; without a spring q₀ + v₀ t + ½ f t². At and between steps.
    omega = np.array([0.0, 0.3, 2.0, 40.0])
    system = PushedOscillators(omega**2, np.full(4, force))
    q0, v0 = np.array([0.5, -0.2, 1.0, 0.1]), np.array([0.1, 0.3, -1.0, 2.0])
    n_steps = 200
    times = np.sort(np.r_[np.arange(n_steps) * step, np.random.default_rng(1).uniform(0, n_steps * step, 100)])
    march = Exponential(step).march(system, q0, v0, times)
    t, w = times[:, None], omega[1:]
    about = force / w**2
    q = about + (q0[1:] - about) * np.cos(w * t) + v0[1:] / w * np.sin(w * t)
    v = v0[1:] * np.cos(w * t) - (q0[1:] - about) * w * np.sin(w * t)
    # Each step rounds the angle ω h by some units in the last place of it or of 1, and N = a + ω² q, in which ω² q
    # cancels; the amplitudes carry over what has been collected.
    amplitude = np.abs(q0[1:]) + np.abs(v0[1:]) / w + 2 * np.abs(about)
    bound = 10 * EPSILON * n_steps * (1 + w * step) * amplitude
    assert (np.abs(march.q[:, 1:] - q) <= bound).all()
    assert (np.abs(march.v[:, 1:] - v) <= bound * w).all()
    flown = q0[0] + v0[0] * times + 0.5 * force * times**2
    assert march.q[:, 0] == pytest.approx(flown, rel=n_steps * EPSILON, abs=n_steps * EPSILON)
    assert march.v[:, 0] == pytest.approx(v0[0] + force * times, rel=n_steps * EPSILON)


# Order -----------------------------------------------------------------------------------------------------------


@KINDS
def test_it_is_of_fourth_order_on_any_body(body: Body, reference_of: Reference, order_of: Order, kind: str) -> None:
    rotor = hinged(body(4, seed=1, kind=kind), PULSE)
    times, steps = np.linspace(0.0, 4.0, 26), 0.01 / 2.0 ** np.arange(3)
    start = moving(rotor)
    q, v = reference_of(rotor, *start, times)
    marches = [Exponential(step).march(rotor, *start, times) for step in steps]
    assert Exponential(1.0).order(rotor) == 4
    assert order_of(steps, np.array([np.abs(march.q - q).max() for march in marches])) == pytest.approx(4, abs=0.15)
    assert order_of(steps, np.array([np.abs(march.v - v).max() for march in marches])) == pytest.approx(4, abs=0.15)


@pytest.fixture(scope="module")
def beam_errors(rotor: CompiledSystem, beam: Mechanism) -> Callable[[Array], Array]:
    """Return the largest errors of tip deflection and joint angle of the scene's beam, one row for each step."""
    # All steps divide the 0.1 s of the torque and the 5 ms between outputs.
    times, rest = np.arange(61) * 5 * MILLI, np.zeros(rotor.n)
    exact = Motion(beam, ScipyIvp("DOP853", 1e-11).march(rotor, rest, rest, times), "beam.tip")

    def errors(steps: Array) -> Array:
        motions = [Motion(beam, Exponential(step).march(rotor, rest, rest, times), "beam.tip") for step in steps]
        return np.array(
            [
                [
                    np.abs(motion.tip_deflection - exact.tip_deflection).max(),
                    np.abs(motion.joint_position("hub") - exact.joint_position("hub")).max(),
                ]
                for motion in motions
            ]
        )

    return errors


def test_on_the_beam_it_is_of_fourth_order_once_the_step_resolves_the_highest_mode(
    rotor: CompiledSystem, beam_errors: Callable[[Array], Array], order_of: Order
) -> None:
    steps = np.array([0.1, 0.0625, 0.05]) * MILLI  # at half of that the angle is within its round-off, some 1e-14
    assert body_of(rotor).omega.max() * steps[0] < 1
    errors = beam_errors(steps)
    assert order_of(steps, errors[:, 0]) == pytest.approx(4, abs=0.15)
    assert order_of(steps, errors[:, 1]) == pytest.approx(4, abs=0.15)


def test_on_the_beam_steps_far_above_the_highest_mode_still_converge(
    rotor: CompiledSystem, beam_errors: Callable[[Array], Array], order_of: Order
) -> None:
    # Where ω h is not small the conditions for order 4 hold in part: Hochbruck & Ostermann, SIAM J Numer Anal 43
    # (2005), give order 2 for the worst case and 3 for most.
    steps = np.array([2.5, 1.25, 0.625]) * MILLI
    assert body_of(rotor).omega.max() * steps[-1] > 5
    errors = beam_errors(steps)
    assert (np.diff(errors, axis=0) < 0).all()
    assert order_of(steps, errors[:, 0]) > 2.9
    assert order_of(steps, errors[:, 1]) > 2.9


@KINDS
def test_output_between_the_steps_is_at_least_of_third_order(
    body: Body, reference_of: Reference, order_of: Order, kind: str
) -> None:
    rotor = hinged(body(3, seed=2, kind=kind))
    times, steps = np.sort(np.random.default_rng(0).uniform(0.0, 2.0, 200)), 0.02 / 2.0 ** np.arange(4)
    start = moving(rotor)
    q, v = reference_of(rotor, *start, times)
    marches = [Exponential(step).march(rotor, *start, times) for step in steps]
    assert order_of(steps, np.array([np.abs(march.q - q).max() for march in marches])) > 2.9
    assert order_of(steps, np.array([np.abs(march.v - v).max() for march in marches])) > 2.9


# Output, restart, work -------------------------------------------------------------------------------------------


def test_output_times_never_change_the_steps(rotor: CompiledSystem) -> None:
    step, start = MILLI, moving(rotor, deformed=1e-4)
    coarse = np.linspace(0.0, 0.3, 11)
    grids = [np.array([0.3]), coarse, np.sort(np.r_[coarse, np.random.default_rng(7).uniform(0.0, 0.3, 500)])]
    marches = [Exponential(step).march(rotor, *start, grid) for grid in grids]
    for march in marches[1:]:
        assert_same_state(march.end, marches[0].end)
    there = np.searchsorted(grids[2], coarse)
    assert np.array_equal(marches[2].q[there], marches[1].q)
    assert np.array_equal(marches[2].v[there], marches[1].v)
    assert np.array_equal(marches[1].q[0], start[0])
    assert np.array_equal(marches[1].v[0], start[1])


@pytest.mark.parametrize("stop", [70.0, 70.4])
def test_a_march_resumed_is_one_march_bit_for_bit(rotor: CompiledSystem, stop: float) -> None:
    step, start, times = MILLI, moving(rotor, deformed=1e-4), np.arange(0.0, 200.0, 0.7) * MILLI
    whole = Exponential(step).march(rotor, *start, times)
    first = Exponential(step).march(rotor, *start, times[times <= stop * step])
    second = Exponential(step).resume(rotor, first.end, times)
    assert_same_state(second.end, whole.end)
    to_come = times >= first.end.step * step
    assert np.array_equal(second.q[to_come], whole.q[to_come])
    assert np.array_equal(second.v[to_come], whole.v[to_come])
    assert np.isnan(second.q[~to_come]).all()
    assert first.evaluations + second.evaluations == whole.evaluations


@pytest.mark.parametrize("spacing", [1.0, 3.0, 0.31])
def test_it_solves_the_system_four_times_a_step_and_once_at_the_start(spacing: float) -> None:
    system = PushedOscillators(np.array([1.0, 100.0]), np.zeros(2))
    march = Exponential(0.01).march(system, np.ones(2), np.zeros(2), 0.01 * np.arange(0.0, 1000.5, spacing))
    assert march.evaluations == system.parameters.calls[0] == 4 * march.end.step + 1
    assert march.end.step in (1000, 1001)  # the last output begins the last step
    assert march.fast_evaluations == 0
    assert (march.integrator, march.step, march.substeps) == ("exponential", 0.01, 1)


# Stability -------------------------------------------------------------------------------------------------------


def test_the_largest_step_has_no_limit_where_nothing_couples(rotor: CompiledSystem) -> None:
    assert Exponential(1.0).largest_step(rotor) == np.inf


@pytest.mark.parametrize("beta", [0.05, 0.2, 0.5, 0.9])
def test_the_largest_step_is_that_of_the_coupling_alone(beta: float) -> None:
    """Of a free joint and a mode at ω, unit masses coupled by β, M⁻¹ K has ω²/(1 − β²) in place of ω²."""
    omega = 30.0
    system = LinearSystem(np.array([[1.0, beta], [beta, 1.0]]), np.diag([0.0, omega**2]), 1)
    expected = 2 / (omega * beta) * np.sqrt(1 - beta**2)
    assert Exponential(1.0).largest_step(system) == pytest.approx(expected, rel=1e-9)
    assert expected > 2 / system.highest_frequency


def test_an_explicit_limit_is_left_where_coupling_is_strong(free_rotor: CompiledSystem) -> None:
    # In the frame of free modes angle and modes couple: beyond the limit small vibrations grow within a few steps.
    limit = Exponential(1.0).largest_step(free_rotor)
    assert 1 < limit * free_rotor.highest_frequency / 2 < 10
    rest, plucked = np.zeros(free_rotor.n), np.r_[0.0, 1e-9 * np.ones(free_rotor.n - 1)]
    march = Exponential(3 * limit).march(free_rotor, plucked, rest, 3 * limit * np.arange(101.0))
    assert np.abs(march.q[-1, 1:]).max() > 10 * np.abs(plucked).max()


def test_an_undriven_beam_keeps_its_energy_for_ten_seconds_at_steps_far_above_its_periods(
    coasting: CompiledSystem,
) -> None:
    # ω h = 2.9 … 43 at 5 ms. The strain energy is that of some four times the deflection of the scene.
    q0, v0 = np.zeros(coasting.n), np.zeros(coasting.n)
    q0[1:], v0[0] = [1e-3, 1e-4, 1e-4, 1e-5, 1e-5], 20.0
    times = np.arange(2001) * 5 * MILLI
    march = Exponential(5 * MILLI).march(coasting, q0, v0, times)
    kinetic, strain = energies(coasting, march)
    total = kinetic + strain
    # The equations conserve energy. What the method doesn't solve exactly is N, the spin's pull on the modes: against
    # their stiffness it is (rate/ω)², 1.2e-3 for the first mode. The energy strays by less than half of that.
    assert (v0[0] / body_of(coasting).omega[0]) ** 2 < 1.3e-3
    assert np.abs(total / total[0] - 1).max() < (v0[0] / body_of(coasting).omega[0]) ** 2
    assert strain.max() < 1.01 * strain[0]


def test_a_motion_that_grows_without_end_is_reported_with_time_and_coordinate() -> None:
    # v̇ = 50 v for the second alone: its rate passes 1e30 at t = 30 ln 10/50 = 1.38 s.
    system = PushedOscillators(np.zeros(2), np.zeros(2), growth=50.0)
    with pytest.raises(
        StabilityError, match=r"the march diverged at t = \S+ s, most in coordinate 1 \(rate "
    ) as caught:
        Exponential(0.01).march(system, np.zeros(2), np.array([0.0, 1.0]), np.array([10.0]))
    found = re.search(r"t = (\S+) s", str(caught.value))
    assert found
    assert float(found[1]) == pytest.approx(30 * np.log(10) / 50, rel=0.02)


# What is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [0.0, -0.01, np.nan, np.inf])
def test_a_step_that_leads_nowhere_is_refused(step: float) -> None:
    with pytest.raises(ValueError, match=f"step is {step}, expected a time above 0"):
        Exponential(step)


def test_a_rotation_in_space_is_refused() -> None:
    # Three rates and four positions, as a quaternion has.
    system = PushedOscillators(np.zeros(3), np.zeros(3), quaternions=1)
    start = State(0, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3))
    message = "the exponential method takes no rotations in space; use another integrator"
    with pytest.raises(ValueError, match=message):
        Exponential(0.01).march(system, start.q, start.v, np.array([1.0]))
    with pytest.raises(ValueError, match=message):
        Exponential(0.01).resume(system, start, np.array([1.0]))


@pytest.mark.parametrize("name", ["q0", "v0"])
def test_a_start_that_doesnt_fit_is_refused(name: str) -> None:
    system = PushedOscillators(np.ones(2), np.zeros(2))
    short: dict[str, Any] = {"q0": np.zeros(2), "v0": np.zeros(2), name: np.zeros(3)}
    with pytest.raises(ValueError, match=rf"{name} has shape \(3,\), expected \(2\)"):
        Exponential(0.01).march(system, **short, times=np.array([1.0]))
    broken: dict[str, Any] = {"q0": np.zeros(2), "v0": np.zeros(2), name: np.array([0.0, np.nan])}
    with pytest.raises(AccuracyError, match=f"{name} holds 1 values that are not finite, of 2"):
        Exponential(0.01).march(system, **broken, times=np.array([1.0]))


@pytest.mark.parametrize("times", [[], [0.5, 0.2], [-0.1, 0.5], [0.0, np.inf]])
def test_output_times_that_no_march_can_keep_are_refused(times: list[float]) -> None:
    system = PushedOscillators(np.ones(2), np.zeros(2))
    with pytest.raises(ValueError, match="times must be finite, from 0 on, in ascending order, and one at least"):
        Exponential(0.01).march(system, np.zeros(2), np.zeros(2), np.array(times))


# In a scene ------------------------------------------------------------------------------------------------------


def test_a_scene_runs_it_with_a_step_of_its_own() -> None:
    runs = '[{integrator = "runge-kutta", tolerance = 1e-10}, {integrator = "exponential", step = "0.1 ms"}]'
    motions = Pipeline(load_scene("beam-paper", [f"simulation.run={runs}", "simulation.duration=0.05 s"])).motions
    assert list(motions) == ["runge-kutta", "exponential"]
    assert motions["exponential"].trajectory.step == pytest.approx(1e-4)
    assert motions["runge-kutta"].trajectory.step < 1e-4
    differences = motions["exponential"].differences(motions["runge-kutta"])
    # Order 4: the difference between two steps of it, over 1 − 2⁻⁴, is the error of the longer one.
    half = Pipeline(
        load_scene(
            "beam-paper",
            ["simulation.run.0.integrator=exponential", "simulation.step=50 us", "simulation.duration=0.05 s"],
        )
    ).motion
    own = half.differences(motions["exponential"])["tip_difference_m"] / (1 - 1 / 16)
    assert differences["tip_difference_m"] == pytest.approx(own, rel=0.1)
