"""SciPy's adaptive methods: agreement with each other, loads that jump, output, counts, failure, refusals."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from scipy.integrate import DOP853

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, StabilityError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.signals.signal import half_sine
from fmd.dynamics.system import PlainSystem, accelerations, velocities
from fmd.integrators import scipy_ivp
from fmd.integrators.exponential import Exponential
from fmd.integrators.protocol import Trajectory
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.kernels.table import Table
from tests.dynamics.hinged_body import body_of, hinged

NAMES = ("DOP853", "Radau", "LSODA")
EACH = pytest.mark.parametrize("name", NAMES)


@dataclass(frozen=True)
class Pulse(Table):
    """Half a sine of force."""

    start: float
    duration: float
    peak: float


@dataclass(frozen=True)
class Hit(Table):
    """Oscillators that a half-sine of force hits, and whose accelerations are no numbers after some time."""

    calls: Array  # (1,)
    stiffness: float
    pulse: Pulse
    until: float


@accelerations.register(Hit)
def _accelerations(p: Hit, t: float, q: Array, v: Array, a: Array) -> None:
    p.calls[0] += 1
    s = (t - p.pulse.start) / p.pulse.duration
    force = p.pulse.peak * np.sin(np.pi * s) if 0.0 < s < 1.0 else 0.0
    for i in range(v.size):
        a[i] = force - p.stiffness * q[i] if t <= p.until else np.nan


@velocities.register(Hit)
def _velocities(p: Hit, q: Array, v: Array, dq: Array) -> None:
    for i in range(v.size):
        dq[i] = v[i]


@dataclass
class HitOscillators(PlainSystem):
    stiffness: float = 4.0
    pulse: Pulse = Pulse(0.0, 1.0, 0.0)
    until: float = np.inf
    breakpoints: tuple[float, ...] = ()
    parameters: Hit = field(init=False)

    n = 2
    n_positions = 2

    def __post_init__(self) -> None:
        self.parameters = Hit(np.zeros(1), self.stiffness, self.pulse, self.until)


# Agreement -------------------------------------------------------------------------------------------------------


def peak_of(rotor: CompiledSystem) -> float:
    """Torque in the middle of the scene's 0.1 s of it [N m]."""
    return float(body_of(rotor).load.value(0.05)[0])


@pytest.fixture(scope="module")
def struck(rotor: CompiledSystem) -> CompiledSystem:
    """The scene's beam, struck for 8 ms: as long as its first period is, and short enough for Radau."""
    return hinged(body_of(rotor), half_sine(0.0, 0.008, peak_of(rotor)))


@pytest.fixture(scope="module")
def marches(struck: CompiledSystem) -> dict[str, Trajectory]:
    times, rest = np.linspace(0.0, 0.012, 25), np.zeros(struck.n)
    tolerances = {"DOP853": 1e-11, "Radau": 1e-9, "LSODA": 1e-11}
    return {name: ScipyIvp(name, tolerances[name]).march(struck, rest, rest, times) for name in NAMES}


@pytest.mark.parametrize("name", ["Radau", "LSODA"])
def test_the_methods_agree_with_each_other_on_the_struck_beam(
    struck: CompiledSystem, marches: dict[str, Trajectory], name: str
) -> None:
    # Nothing in the beam grows: errors of single steps, each below tolerance times size, add up at most. A mode's
    # position in units of its amplitude is as far off as its rate; the angle adds its rate's error over 12 ms.
    exact, march = marches["DOP853"], marches[name]
    steps = exact.end.step * 1e-11 + march.end.step * (1e-9 if name == "Radau" else 1e-11)
    omega = np.r_[1 / 0.012, body_of(struck).omega]
    size = np.maximum(np.abs(exact.q), np.abs(exact.v) / omega).max(axis=0)
    bound = steps * size
    assert (bound < 1e-4 * size).all()
    assert (np.abs(march.q - exact.q).max(axis=0) < bound).all()
    assert (np.abs(march.v - exact.v).max(axis=0) < bound * omega).all()


def test_they_agree_with_the_exponential_method_to_its_own_error(
    struck: CompiledSystem, marches: dict[str, Trajectory]
) -> None:
    # Of order 4: the error at 0.1 ms is 16/15 of the difference between 0.1 and 0.05 ms, but for higher orders.
    rest, exact = np.zeros(struck.n), marches["DOP853"]
    long, short = (Exponential(step).march(struck, rest, rest, exact.times) for step in (1e-4, 5e-5))
    own_q, own_v = (np.abs(one - other).max(axis=0) for one, other in ((long.q, short.q), (long.v, short.v)))
    for march in marches.values():
        assert (np.abs(long.q - march.q).max(axis=0) < 1.2 * own_q).all()
        assert (np.abs(long.v - march.v).max(axis=0) < 1.2 * own_v).all()
    assert (own_q < 1e-4 * np.abs(exact.q).max(axis=0)).all()


@EACH
def test_an_oscillator_follows_its_cosine_and_says_so_at_the_times_asked_for(name: str) -> None:
    # q = cos 2t. Errors of steps add up: 3 s at 1e-10 take less than 10⁴ steps by any of them.
    times = np.sort(np.r_[0.0, 0.0, np.random.default_rng(0).uniform(0, 3, 50), 2.0, 2.0])
    march = ScipyIvp(name, 1e-10).march(HitOscillators(), np.ones(2), np.zeros(2), times)
    assert march.end.step < 10_000
    assert np.array_equal(march.times, times)
    assert march.q == pytest.approx(np.cos(2 * times)[:, None] * np.ones(2), abs=1e-6)
    assert march.v == pytest.approx(-2 * np.sin(2 * times)[:, None] * np.ones(2), abs=2e-6)


@EACH
def test_a_tighter_tolerance_gives_a_smaller_error(name: str) -> None:
    times = np.linspace(0.0, 3.0, 13)
    errors = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        march = ScipyIvp(name, tolerance).march(HitOscillators(), np.ones(2), np.zeros(2), times)
        errors.append(np.abs(march.q - np.cos(2 * times)[:, None]).max())
    assert errors[0] > 10 * errors[1] > 100 * errors[2]


# Loads that jump -------------------------------------------------------------------------------------------------


@EACH
def test_a_blow_shorter_than_the_steps_is_never_missed(name: str) -> None:
    # At rest, without a spring, a method would step over a blow that it isn't told of. Of mass 1: the rate is the
    # impulse, 2/π peak duration, and the place at the end of the blow half of that times the duration.
    pulse = Pulse(5.0, 1e-3, 300.0)
    rate = 2 / np.pi * pulse.peak * pulse.duration
    told = HitOscillators(0.0, pulse, breakpoints=(5.0, 5.001))
    times = np.array([0.0, 4.0, 5.001, 10.0])
    march = ScipyIvp(name, 1e-10).march(told, np.zeros(2), np.zeros(2), times)
    assert np.array_equal(march.q[:2], np.zeros((2, 2)))
    assert march.v[2:] == pytest.approx(np.full((2, 2), rate), rel=1e-7)
    assert march.q[2] == pytest.approx(np.full(2, rate * 0.5e-3), rel=1e-7)
    assert march.q[3] == pytest.approx(np.full(2, rate * (10.0 - 5.0005)), rel=1e-7)
    hidden = HitOscillators(0.0, pulse)
    missed = ScipyIvp(name, 1e-10).march(hidden, np.zeros(2), np.zeros(2), times)
    assert np.array_equal(missed.v, np.zeros((4, 2)))


class Unaware(CompiledSystem):
    """A system that doesn't say when its torque begins and ends."""

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return ()


def test_no_step_straddles_the_begin_or_end_of_the_torque(
    rotor: CompiledSystem, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[tuple[float, float]] = []

    class Watched(DOP853):
        def step(self) -> str | None:
            message = super().step()
            steps.append((self.t_old, self.t))
            return message

    monkeypatch.setitem(scipy_ivp._METHODS, "DOP853", Watched)
    mechanism = hinged(body_of(rotor), half_sine(0.0031, 0.0052, peak_of(rotor))).mechanism
    rest, times = np.zeros(rotor.n), np.array([0.0, 0.02])

    def straddling(kind: type[CompiledSystem]) -> tuple[int, Trajectory]:
        steps.clear()
        march = ScipyIvp("DOP853", 1e-8).march(kind(mechanism), rest, rest, times)
        assert march.end.step == len(steps)
        return sum(begin < edge < end for begin, end in steps for edge in (0.0031, 0.0083)), march

    none, told = straddling(CompiledSystem)
    some, unaware = straddling(Unaware)
    assert none == 0
    assert some > 0
    exact = ScipyIvp("DOP853", 1e-13).march(CompiledSystem(mechanism), rest, rest, times)
    assert np.abs(told.q[-1] - exact.q[-1])[0] < np.abs(unaware.q[-1] - exact.q[-1])[0]


@pytest.mark.parametrize("last", [0.5, 1.0, 1.5])
def test_breakpoints_outside_the_march_change_nothing(last: float) -> None:
    times = np.linspace(0.0, last, 7)
    plain = ScipyIvp("DOP853").march(HitOscillators(), np.ones(2), np.zeros(2), times)
    outside = HitOscillators(breakpoints=(-1.0, 0.0, 2.5, 3.0))
    march = ScipyIvp("DOP853").march(outside, np.ones(2), np.zeros(2), times)
    assert np.array_equal(march.q, plain.q)
    assert np.array_equal(march.v, plain.v)
    assert march.evaluations == plain.evaluations
    twice = ScipyIvp("DOP853").march(HitOscillators(breakpoints=(0.2, 0.2)), np.ones(2), np.zeros(2), times)
    once = ScipyIvp("DOP853").march(HitOscillators(breakpoints=(0.2,)), np.ones(2), np.zeros(2), times)
    assert np.array_equal(twice.q, once.q)
    assert once.evaluations > plain.evaluations


# Output and counts -----------------------------------------------------------------------------------------------


@EACH
def test_output_at_the_start_alone_is_the_start(name: str) -> None:
    system = HitOscillators()
    march = ScipyIvp(name).march(system, np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.zeros(2))
    assert np.array_equal(march.q, [[1.0, 2.0]] * 2)
    assert np.array_equal(march.v, [[3.0, 4.0]] * 2)
    assert (march.end.step, march.step, march.evaluations) == (0, 0.0, 1)


@EACH
def test_output_times_never_change_the_steps(name: str) -> None:
    few, many = np.array([0.0, 3.0]), np.linspace(0.0, 3.0, 301)
    one, other = (ScipyIvp(name).march(HitOscillators(), np.ones(2), np.zeros(2), times) for times in (few, many))
    assert one.end.step == other.end.step
    assert np.array_equal(one.end.q, other.end.q)
    assert np.array_equal(one.q[-1], other.q[-1])


@EACH
def test_evaluations_are_counted_as_they_happen(name: str) -> None:
    system = HitOscillators(breakpoints=(1.0,))
    march = ScipyIvp(name).march(system, np.ones(2), np.zeros(2), np.linspace(0.0, 3.0, 50))
    assert march.evaluations == system.parameters.calls[0]


@EACH
def test_what_a_march_tells_about_itself(name: str) -> None:
    parts: list[float] = []
    march = ScipyIvp(name, 1e-8).march(
        HitOscillators(breakpoints=(1.0,)), np.ones(2), np.zeros(2), np.array([4.0]), parts.append
    )
    assert (march.integrator, march.substeps, march.fast_evaluations) == (name, 1, 0)
    assert march.step == pytest.approx(march.end.time / march.end.step)
    assert len(parts) == march.end.step
    assert parts == sorted(parts)
    assert 0 < parts[0] < parts[-1] == 1
    assert march.seconds > 0


@EACH
def test_it_has_no_largest_step_and_the_order_of_its_formula(rotor: CompiledSystem, name: str) -> None:
    # Hairer, Nørsett & Wanner I (DOP853) and II (Radau IIA of three stages); Adams' formulas up to 12 in LSODA.
    assert ScipyIvp(name).largest_step(rotor) == np.inf
    assert ScipyIvp(name).step == 0.0
    assert ScipyIvp(name).order(rotor) == {"DOP853": 8, "Radau": 5, "LSODA": 12}[name]


@EACH
def test_a_march_leaves_what_it_is_given_alone(name: str) -> None:
    given = np.ones(2), np.zeros(2), np.linspace(0.0, 1.0, 5)
    before = [array.copy() for array in given]
    ScipyIvp(name).march(HitOscillators(), *given)
    for now, then in zip(given, before, strict=True):
        assert np.array_equal(now, then)


# Failure ---------------------------------------------------------------------------------------------------------


@EACH
def test_a_method_that_gives_up_says_when_and_why(name: str) -> None:
    # Nothing is a number after 1.3 s. DOP853 and Radau close in on that time; LSODA notices after its step.
    message = rf"{name} stopped at t = \S+ s: (Required step size is less than spacing|not finite)"
    with pytest.raises(StabilityError, match=message) as caught:
        ScipyIvp(name, 1e-8).march(HitOscillators(until=1.3), np.ones(2), np.zeros(2), np.array([0.0, 5.0]))
    found = re.search(r"t = (\S+) s", str(caught.value))
    assert found
    assert float(found[1]) == pytest.approx(1.3, abs=0.1 if name == "LSODA" else 1e-5)


@EACH
def test_a_start_without_accelerations_is_reported(name: str) -> None:
    with pytest.raises(StabilityError, match=rf"{name} stopped at t = \S+ s"):
        ScipyIvp(name, 1e-8).march(HitOscillators(until=-1.0), np.ones(2), np.zeros(2), np.array([0.0, 5.0]))


# What is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["RK45", "dop853", ""])
def test_a_name_that_isnt_one_of_three_is_refused(name: Any) -> None:
    with pytest.raises(ValueError, match=f"name is '{name}', expected one of DOP853, Radau, LSODA"):
        ScipyIvp(name)


@pytest.mark.parametrize("tolerance", [0.0, -1e-9, 1e-14, 1.0, np.nan, np.inf])
def test_a_tolerance_out_of_reach_is_refused(tolerance: float) -> None:
    with pytest.raises(ValueError, match=rf"tolerance is {re.escape(str(tolerance))}, expected 3e-14 … 1"):
        ScipyIvp("DOP853", tolerance)


@EACH
@pytest.mark.parametrize("times", [[], [0.5, 0.2], [-0.1, 0.5], [0.0, np.nan], [0.0, np.inf]])
def test_output_times_that_no_march_can_keep_are_refused(name: str, times: list[float]) -> None:
    with pytest.raises(ValueError, match="times must be finite, from 0 on, in ascending order, and one at least"):
        ScipyIvp(name).march(HitOscillators(), np.zeros(2), np.zeros(2), np.array(times))


@EACH
@pytest.mark.parametrize("which", ["q0", "v0"])
def test_a_start_that_doesnt_fit_is_refused(name: str, which: str) -> None:
    times = np.array([0.0, 1.0])
    start: dict[str, Array] = {"q0": np.zeros(2), "v0": np.zeros(2)}
    with pytest.raises(ValueError, match=rf"{which} has shape \(3,\), expected \(2\)"):
        ScipyIvp(name).march(HitOscillators(), **{**start, which: np.zeros(3)}, times=times)
    with pytest.raises(AccuracyError, match=f"{which} holds 1 values that are not finite, of 2"):
        ScipyIvp(name).march(HitOscillators(), **{**start, which: np.array([0.0, np.inf])}, times=times)


# In a scene ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def pipeline_with() -> Callable[..., Pipeline]:
    return lambda *overrides: Pipeline(load_scene("beam-paper", ["simulation.duration=10 ms", *overrides]))


def test_single_runs_of_a_scene_can_be_replaced(pipeline_with: Callable[..., Pipeline]) -> None:
    runs = ('0={integrator="runge-kutta", tolerance=1e-10}', '1={integrator="exponential"}', '2={integrator="LSODA"}')
    motions = pipeline_with(*(f"simulation.run.{run}" for run in runs), "simulation.step=0.1 ms").motions
    assert list(motions) == ["runge-kutta", "exponential", "LSODA"]
    trajectories = {label: motion.trajectory for label, motion in motions.items()}
    assert [trajectory.integrator for trajectory in trajectories.values()] == list(motions)
    assert trajectories["exponential"].step == pytest.approx(1e-4)
    q = trajectories["runge-kutta"].q
    for label in ("exponential", "LSODA"):
        assert np.abs(trajectories[label].q - q).max() < 1e-6 * np.abs(q).max()


def test_a_method_that_a_scene_runs_twice_gets_two_labels(pipeline_with: Callable[..., Pipeline]) -> None:
    runs = '[{integrator="LSODA"}, {integrator="LSODA", tolerance=1e-6}]'
    motions = pipeline_with(f"simulation.run={runs}").motions
    assert len(motions) == 2
    one, other = motions.values()
    assert one.trajectory.evaluations > other.trajectory.evaluations
