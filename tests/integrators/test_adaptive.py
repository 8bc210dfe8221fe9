"""Adaptive methods: error against tolerance, steps, output, loads that jump, quiet coordinates, groups, failure."""

import re
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.linalg import expm

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.errors import StabilityError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.system import PlainSystem, accelerations, advance, velocities
from fmd.integrators.rosenbrock import ExponentialRosenbrock
from fmd.integrators.runge_kutta import DAMPED, RungeKutta
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.integrators.step_control import groups_of, kinds_of, step_within
from fmd.kernels.table import Table
from fmd.scene.joints.spherical import SPHERICAL

BOTH = pytest.mark.parametrize("method", [ExponentialRosenbrock, RungeKutta])


@dataclass(frozen=True)
class Linear(Table):
    """``q̈ = −K q − C v + f sin(Ω t) + push·(time since the jump)^power + round-off``; not a number after some time."""

    calls: Array  # (1,)
    K: Array  # (n, n)
    C: Array  # (n, n)
    f: Array  # (n,)
    rate: float
    push: Array  # (n,)
    jump: float
    until: float
    noise: Array  # (n,)
    power: float


@accelerations.register(Linear)
def _accelerations(p: Linear, t: float, q: Array, v: Array, a: Array) -> None:
    p.calls[0] += 1
    for i in range(v.size):
        a[i] = p.f[i] * np.sin(p.rate * t) + (p.push[i] * (t - p.jump) ** p.power if t >= p.jump else 0.0)
        for j in range(v.size):
            a[i] -= p.K[i, j] * q[j] + p.C[i, j] * v[j]
        a[i] += p.noise[i] * (((q[0] + 1.0) - 1.0) - q[0])
        if t > p.until:
            a[i] = np.nan


@velocities.register(Linear)
def _velocities(p: Linear, q: Array, v: Array, dq: Array) -> None:
    for i in range(v.size):
        dq[i] = v[i]


@advance.register(Linear)
def _advance(p: Linear, q: Array, v: Array, h: float, first: int, last: int) -> None:
    for i in range(first, last):
        q[i] += h * v[i]


@dataclass
class LinearSystem(PlainSystem):
    K: Array
    C: Array | None = None
    f: Array | None = None
    rate: float = 1.0
    push: Array | None = None
    jump: float = np.inf
    until: float = np.inf
    noise: Array | None = None
    power: float = 0.0
    breakpoints: tuple[float, ...] = ()
    parameters: Linear = field(init=False)

    def __post_init__(self) -> None:
        self.n = self.n_positions = len(self.K)
        none = np.zeros(self.n)
        C = np.zeros_like(self.K) if self.C is None else self.C
        f, push, noise = (none if x is None else x for x in (self.f, self.push, self.noise))
        self.parameters = Linear(np.zeros(1), self.K, C, f, self.rate, push, self.jump, self.until, noise, self.power)

    @property
    def highest_frequency(self) -> float:
        return float(np.sqrt(np.abs(np.linalg.eigvals(self.K)).max()))

    def exact(self, q0: Array, v0: Array, times: Array) -> Array:
        """Positions in closed form: the matrix exponential with sine, cosine and the push as states of their own."""
        n, p = self.n, self.parameters
        A = np.zeros((2 * n + 3, 2 * n + 3))
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n, :n], A[n : 2 * n, n : 2 * n], A[n : 2 * n, 2 * n] = -p.K, -p.C, p.f
        A[2 * n, 2 * n + 1], A[2 * n + 1, 2 * n] = p.rate, -p.rate
        A[n : 2 * n, 2 * n + 2] = p.push
        start, found = np.r_[q0, v0, 0.0, 1.0, 0.0], []
        for t in times:
            before = min(t, p.jump)
            now = expm(A * before) @ start
            now[-1] = 1.0 if t >= p.jump else 0.0
            found.append((expm(A * (t - before)) @ now)[:n])
        return np.array(found)


def two_oscillators(**settings: object) -> LinearSystem:
    """Frequencies 2 and 11 rad/s or so, some damping, a load."""
    K, C = np.array([[6.0, -2.0], [-2.0, 120.0]]), np.array([[0.1, 0.02], [0.0, 0.3]])
    return LinearSystem(K, C, np.array([1.0, 3.0]), 1.7, **settings)


# Error against tolerance -----------------------------------------------------------------------------------------


def oscillators_case():
    system, times = two_oscillators(), np.linspace(0.0, 10.0, 41)
    q0, v0 = np.array([1.0, 0.1]), np.array([0.0, 1.0])
    return system, q0, v0, times, system.exact(q0, v0, times)


def rod_slider_case():
    pipeline = Pipeline(load_scene("rod-slider"))
    times = np.linspace(0.0, 5.0, 41)
    return by_dop853(pipeline.system, *pipeline.start, times)


def beam_case():
    rotor, times = Pipeline(load_scene("beam-paper")).system, np.linspace(0.0, 0.05, 41)
    return by_dop853(rotor, np.zeros(rotor.n), np.zeros(rotor.n), times)


def spinning_pendulum() -> CompiledSystem:
    bob = rigid_integrals(2.0, np.array([0.0, 0.0, -0.5]), np.diag([0.11, 0.12, 0.05]))
    return CompiledSystem(Mechanism([Link("bob", bob, SPHERICAL)], gravity=np.array([0, 0, -9.81])))


def pendulum_case():
    system = spinning_pendulum()
    return by_dop853(system, system.mechanism.rest_positions, np.array([2.0, 1.0, 8.0]), np.linspace(0.0, 2.0, 41))


def by_dop853(system, q0, v0, times):
    return system, q0, v0, times, ScipyIvp("DOP853", 1e-13).march(system, q0, v0, times).q


CASES = {"oscillators": oscillators_case, "rod-slider": rod_slider_case, "beam": beam_case, "pendulum": pendulum_case}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    return CASES[request.param]()


def errors_of(methods, case):
    system, q0, v0, times, exact = case
    marches = [method.march(system, q0, v0, times) for method in methods]
    groups = groups_of(system)[: system.n_positions]
    sizes = np.array([np.abs(exact[:, groups == g]).max() for g in groups])
    return np.array([(np.abs(march.q - exact) / sizes).max() for march in marches]), marches


def test_the_error_of_the_exponential_method_is_proportional_to_the_tolerance(case):
    # Steps whose error of order 4 is the tolerance leave a global one, of order 4, that is proportional to it.
    tolerances = 10.0 ** -np.arange(3.0, 10.0)
    errors, marches = errors_of([ExponentialRosenbrock(tolerance) for tolerance in tolerances], case)
    ratios = errors / tolerances
    assert (errors[1:] < 0.5 * errors[:-1]).all()
    assert 0.75 < np.polyfit(np.log(tolerances), np.log(errors), 1)[0] < 1.25
    # From rest a mode's first steps are frozen to the little that it has moved by then: the beam's error is far below.
    assert (ratios < 30).all()
    assert ratios.min() > (1e-5 if case[0].n == 6 else 1e-2)
    # and work grows with the fourth root
    steps = [march.end.step for march in marches]
    assert np.polyfit(np.log(tolerances[3:]), np.log(steps[3:]), 1)[0] == pytest.approx(-1 / 4, abs=0.06)


def test_the_error_of_the_runge_kutta_method_follows_the_tolerance(case):
    # Steps whose error of order 8 is the tolerance leave a global one, of order 8, that is proportional to it; work
    # grows with its eighth root.
    tolerances = 10.0 ** -np.arange(4.0, 12.0)
    errors, marches = errors_of([RungeKutta(tolerance) for tolerance in tolerances], case)
    assert np.polyfit(np.log(tolerances), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.25)
    steps = [march.end.step for march in marches]
    assert np.polyfit(np.log(tolerances[3:]), np.log(steps[3:]), 1)[0] == pytest.approx(-1 / 8, abs=0.04)
    assert marches[0].step == pytest.approx(marches[0].end.time / marches[0].end.step)


def test_steps_at_the_stability_limit_leave_nothing_of_the_fastest_vibrations():
    """Steps that grow until the error stops them keep these alive: 1e-5 to 1e-3 of what moves, and more evaluations."""
    ways, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(4, 4)))
    system = LinearSystem(ways @ np.diag([1.0, 9.0, 80.0**2, 300.0**2]) @ ways.T)
    start, times = ways @ [1.0, 0.5, 0.0, 0.0], np.linspace(0.0, 20.0, 101)
    exact = system.exact(start, np.zeros(4), times)
    bounded, free = (RungeKutta(1e-3, reach).march(system, start, np.zeros(4), times) for reach in (DAMPED, np.inf))
    assert np.abs(bounded.q - exact).max() < 1e-10
    assert np.abs(free.q - exact).max() > 1e-6
    assert bounded.evaluations < free.evaluations
    assert bounded.step <= DAMPED / 300.0


# Output ----------------------------------------------------------------------------------------------------------


@BOTH
def test_output_times_never_change_the_steps(case, method):
    system, q0, v0, times, _ = case
    few = method(1e-4).march(system, q0, v0, times[[0, -1]])
    many = method(1e-4).march(system, q0, v0, np.linspace(0.0, times[-1], 777))
    for name in ("step", "time", "next_step", "q", "v", "memory"):
        np.testing.assert_array_equal(getattr(few.end, name), getattr(many.end, name))
    np.testing.assert_array_equal(few.q[-1], many.q[-1])
    longer = method(1e-4).march(system, q0, v0, np.r_[times, 1.1 * times[-1]])
    np.testing.assert_array_equal(longer.q[20], method(1e-4).march(system, q0, v0, times).q[20])


def test_between_its_steps_the_exponential_method_is_as_good_as_at_them(case):
    # Compared at many times within few steps; the pendulum's quaternions are unit there too.
    system, q0, v0, times, _ = case
    fine = np.sort(np.r_[times, np.random.default_rng(0).uniform(0.0, times[-1], 200)])
    exact = ScipyIvp("DOP853", 1e-12).march(system, q0, v0, fine)
    march = ExponentialRosenbrock(1e-6).march(system, q0, v0, fine)
    size = np.abs(exact.q).max(axis=0).max()
    assert np.abs(march.q - exact.q).max() < 1e-4 * size
    if system.n_positions > system.n:
        np.testing.assert_allclose(np.linalg.norm(march.q, axis=1), 1.0, atol=1e-14)
        np.testing.assert_allclose(np.linalg.norm(march.end.q), 1.0, atol=1e-14)


@BOTH
def test_output_at_the_start_is_the_start(method):
    march = method(1e-3).march(two_oscillators(), np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.zeros(2))
    np.testing.assert_array_equal(march.q, [[1.0, 2.0]] * 2)
    np.testing.assert_array_equal(march.v, [[3.0, 4.0]] * 2)


@BOTH
def test_evaluations_are_counted_as_they_happen(method):
    system = two_oscillators(breakpoints=(1.0,))
    march = method(1e-4).march(system, np.ones(2), np.zeros(2), np.linspace(0.0, 3.0, 50))
    at_start = system.n  # changes of each coordinate tell what balances
    assert march.evaluations == system.parameters.calls[0] - at_start


@BOTH
def test_what_a_march_tells_while_it_goes(method):
    parts: list[float] = []
    method(1e-6).march(two_oscillators(), np.ones(2), np.zeros(2), np.array([40.0]), parts.append)
    assert len(parts) > 1
    assert parts == sorted(parts)
    assert 0 < parts[0] <= parts[-1] == 1


# Loads that jump -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("jump", [0.7300001, 1.0, np.pi])
@pytest.mark.parametrize(("method", "bound"), [(ExponentialRosenbrock, 30), (RungeKutta, 30)])
def test_a_jump_at_a_breakpoint_costs_neither_accuracy_nor_many_steps(method, bound, jump):
    pushed = two_oscillators(push=np.array([20.0, -50.0]), jump=jump, breakpoints=(jump,))
    q0, v0, times = np.array([1.0, 0.1]), np.zeros(2), np.linspace(0.0, 6.0, 31)
    exact = pushed.exact(q0, v0, times)
    march = method(1e-7).march(pushed, q0, v0, times)
    assert np.abs(march.q - exact).max() < bound * 1e-7 * np.abs(exact).max()
    smooth = method(1e-7).march(two_oscillators(push=np.array([20.0, -50.0]), jump=-1.0), q0, v0, times)
    assert march.end.step < 1.3 * smooth.end.step + 10


@BOTH
def test_a_step_ends_at_each_breakpoint_however_close_they_are(method):
    points = (0.5, 0.5 + 1e-15, 0.5 + 2e-15, 1.0, 1.0, 1.0 + 1e-9)
    system = two_oscillators(breakpoints=points)
    q0, v0 = np.ones(2), np.zeros(2)
    march = method(1e-6).march(system, q0, v0, np.array([2.0]))
    np.testing.assert_allclose(march.q, system.exact(q0, v0, [2.0]), atol=1e-3)
    assert method(1e-6).march(system, q0, v0, np.array([0.5])).end.time == 0.5


def test_a_step_never_leaves_a_sliver():
    assert step_within(1.0, np.inf) == 1.0
    assert step_within(1.0, 0.4) == 0.4
    assert step_within(1.0, 1.0 + 1e-12) == 1.0 + 1e-12
    assert step_within(1.0, 1.2) == 0.6
    assert step_within(1.0, 2.1) == 1.0


# Scales ----------------------------------------------------------------------------------------------------------


def test_a_coordinate_that_only_round_off_moves_does_not_count():
    # Nothing acts on the third coordinate but round-off of what acts on the others, some 1e-16 of it.
    K, f, noise = np.diag([6.0, 12.0, 3.0]), np.array([1.0, 3.0, 0.0]), np.array([0.0, 0.0, 3.0])
    plain, noisy = LinearSystem(K[:2, :2].copy(), f=f[:2].copy()), LinearSystem(K, f=f, noise=noise)
    times, tolerance = np.linspace(0.0, 10.0, 5), 1e-9
    one = ExponentialRosenbrock(tolerance).march(plain, np.array([0.1, 0.3]), np.zeros(2), times)
    other = ExponentialRosenbrock(tolerance).march(noisy, np.array([0.1, 0.3, 0.0]), np.zeros(3), times)
    assert 0 < np.abs(other.q[:, 2]).max() < 1e-12
    assert other.end.step <= 1.2 * one.end.step + 5


class Grouped(LinearSystem):
    groups = np.zeros(2, dtype=np.int64), np.zeros(2, dtype=np.int64)


@BOTH
def test_coordinates_of_one_group_share_its_largest_value(method):
    # The second oscillator is a millionth of the first and 20 times as fast: alone it would set the step.
    K, q0, times = np.diag([1.0, 400.0]), np.array([1.0, 1e-6]), np.array([10.0])
    alone, grouped = (kind(K, None, np.array([0.1, 1e-7]), 3.0) for kind in (LinearSystem, Grouped))
    tolerance = 1e-4
    apart = method(tolerance).march(alone, q0, np.zeros(2), times)
    together = method(tolerance).march(grouped, q0, np.zeros(2), times)
    if method is RungeKutta:  # the other solves both exactly but for the load
        assert together.end.step < 0.4 * apart.end.step
    assert np.abs(together.q - grouped.exact(q0, np.zeros(2), times)).max() < 0.1
    assert together.end.memory.size < apart.end.memory.size


def test_a_system_without_groups_has_one_for_each_coordinate(rotor):
    np.testing.assert_array_equal(groups_of(two_oscillators()), [0, 1, 2, 3])
    np.testing.assert_array_equal(groups_of(Grouped(np.eye(2))), [0, 0, 1, 1])


@BOTH
def test_a_mechanism_that_rests_stays_at_rest_with_ever_longer_steps(method):
    march = method(1e-9).march(LinearSystem(np.eye(2)), np.zeros(2), np.zeros(2), np.array([100.0]))
    np.testing.assert_array_equal(march.q, np.zeros((1, 2)))
    assert march.end.step < 20


@BOTH
def test_what_rests_in_balance_takes_no_step_for_the_round_off_of_its_forces(method):
    """Forces of up to 1e10 per unit balance: by the size of what has moved, 1e-15, each step's error was 100 %.

    The exponential method solves it in one step; the Runge-Kutta method needs 37 of 5.5 radians.
    """
    for seed in range(6):
        rng = np.random.default_rng([seed, 32])
        n = int(rng.integers(2, 7))
        turn = np.linalg.qr(rng.normal(size=(n, n)))[0]
        K = turn @ np.diag(10 ** rng.uniform(0, 10, n)) @ turn.T
        system = LinearSystem(0.5 * (K + K.T), push=rng.normal(size=n) * 10 ** rng.uniform(-3, 5), jump=0.0, power=0.0)
        q0 = np.linalg.solve(system.K, system.parameters.push)
        march = method(1e-9).march(system, q0, np.zeros(n), np.array([200 / system.highest_frequency]))
        assert march.end.step < 150
        np.testing.assert_allclose(march.q[0], q0, rtol=1e-9)


@BOTH
@pytest.mark.parametrize(("power", "jump"), [(0.5, 0.0), (0.3, 0.0), (1.0, 50.0), (2.0, 50.0)])
def test_a_load_that_begins_steeply_or_late_moves_what_rests(method, power, jump):
    """From rest its error is beside what has moved in a step: where its rate is infinite always the same part of it.

    And late in the march the time's own round-off is a large part of a short step.
    """
    push = np.array([3.0]) / (1.0 if jump == 0.0 else 1e-5**power)
    system = LinearSystem(np.zeros((1, 1)), push=push, jump=jump, power=power, breakpoints=(jump,))
    times = np.array([0.1, 1.0])
    march = method(1e-8).march(system, np.zeros(1), np.zeros(1), jump + times)
    exact = push * times ** (power + 2) / ((power + 1) * (power + 2))
    np.testing.assert_allclose(march.q[:, 0], exact, rtol=1e-5)


@BOTH
def test_a_load_with_an_infinite_rate_in_the_middle_of_a_march_takes_few_steps(method):
    """Where steps are so short that the time's round-off makes their error, shorter ones still would never grow."""
    system = LinearSystem(np.zeros((1, 1)), push=np.array([3.0]), jump=0.3, power=0.3, breakpoints=(0.3,))
    march = method(1e-10).march(system, np.zeros(1), np.zeros(1), np.array([1.0]))
    exact = 3.0 * 0.7**2.3 / (1.3 * 2.3)
    assert march.q[0, 0] == pytest.approx(exact, rel=1e-8)
    assert march.end.step < 10_000


# Failure ---------------------------------------------------------------------------------------------------------


@BOTH
def test_a_march_into_what_is_no_number_stops_there_and_says_so(method):
    with pytest.raises(StabilityError, match=r"stopped at t = \S+ s: ") as caught:
        method(1e-6).march(two_oscillators(until=1.3), np.ones(2), np.zeros(2), np.array([5.0]))
    found = re.search(rf"{method.name} stopped at t = (\S+) s: its step fell to \S+ s$", str(caught.value))
    assert found
    assert float(found[1]) == pytest.approx(1.3, abs=1e-5)


@BOTH
def test_a_start_without_accelerations_is_reported(method):
    with pytest.raises(StabilityError, match=rf"{method.name} stopped at t = 0 s: the accelerations are not finite"):
        method(1e-6).march(two_oscillators(until=-1.0), np.ones(2), np.zeros(2), np.array([5.0]))


@BOTH
def test_a_motion_that_escapes_in_finite_time_is_reported(method):
    # Negative damping that grows: here the spring pushes, q grows as exp(1e4 t), until it overflows.
    with pytest.raises(StabilityError, match=r"stopped at t = \S+ s"), np.errstate(over="ignore"):
        method(1e-3).march(LinearSystem(-1e8 * np.eye(1)), np.ones(1), np.zeros(1), np.array([1.0]))


@BOTH
@pytest.mark.parametrize("tolerance", [0.0, -1e-9, 1e-14, 1.0, np.nan, np.inf])
def test_a_tolerance_out_of_reach_is_refused(method, tolerance):
    with pytest.raises(ValueError, match=rf"tolerance is {re.escape(str(tolerance))}, expected 3e-14 … 1"):
        method(tolerance)


def test_they_have_no_largest_step_and_their_formulas_order(rotor):
    assert ExponentialRosenbrock(1e-3).largest_step(rotor) == np.inf
    assert RungeKutta(1e-3).largest_step(rotor) == np.inf
    assert ExponentialRosenbrock(1e-3).order(rotor) == 4
    assert RungeKutta(1e-3).order(rotor) == 8


class OfOneKind(LinearSystem):
    groups = np.array([0, 3]), np.array([0, 3])


@BOTH
def test_a_group_that_hardly_moves_counts_for_a_small_part_of_its_kind(method):
    # The second oscillator is 1e-9 of the first and 20 times as fast: alone it would set the step.
    K, q0, times = np.diag([1.0, 400.0]), np.array([1.0, 1e-9]), np.array([10.0])
    alone, alike = (kind(K, None, np.array([0.1, 1e-10]), 3.0) for kind in (LinearSystem, OfOneKind))
    apart, together = (method(1e-4).march(system, q0, np.zeros(2), times) for system in (alone, alike))
    if method is RungeKutta:  # the other solves both exactly but for the load; here stability sets the step
        assert together.end.step < 0.7 * apart.end.step
    assert np.abs(together.q - alike.exact(q0, np.zeros(2), times)).max() < 0.1


def test_kinds_are_needed_where_one_has_two_groups():
    assert kinds_of(two_oscillators())[1] == 0
    assert kinds_of(Grouped(np.eye(2)))[1] == 0
    kinds, n_kinds = kinds_of(OfOneKind(np.eye(2)))
    np.testing.assert_array_equal(kinds, [0, 1, 2, 0, 3, 4, 5, 3])
    assert n_kinds == 6
