"""Laws that every integrator obeys: order, identities, restarts, output, reversal, divergence."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, InputError, StabilityError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import half_sine
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import State, evaluate
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.integrators.subcycling import Subcycling
from fmd.reduction.body import FlexibleBody
from fmd.reduction.inertia import inertia_integrals
from fmd.scene.joints.revolute import REVOLUTE
from tests.dynamics.hinged_body import body_of, energies, hinged
from tests.linear_system import LinearSystem
from tests.tasks import Tasks

Body = Callable[..., FlexibleBody]
Method = Callable[[float], CentralDifference | Subcycling | ReversibleSubcycling]
Reference = Callable[..., tuple[Array, Array]]
Order = Callable[[Array, Array], float]

PULSE = half_sine(0.32, 1.6, 20.0)  # begins and ends with a step of each method below: its kinks cost no order
BODIES = ("uncoupled", "conforming", "coupled")
KINDS = pytest.mark.parametrize("kind", BODIES)
EACH = pytest.mark.parametrize(
    "method",
    [CentralDifference, lambda step: Subcycling(step, 5), lambda step: ReversibleSubcycling(step, 5)],
    ids=["plain", "5:1", "reversible 5:1"],
)
SUB_CYCLED = pytest.mark.parametrize("m", [2, 5, 10])


def moving(rotor: CompiledSystem, deformed: float = 0.1, rate: float = 0.5) -> tuple[Array, Array]:
    """Coordinates and rates of a body that turns and vibrates."""
    rng = np.random.default_rng(0)
    modal = deformed * rng.normal(size=(2, rotor.n - 1))
    return np.r_[0.3, modal[0]], np.r_[rate, 3 * modal[1]]


# Order -----------------------------------------------------------------------------------------------------------


@KINDS
@pytest.mark.parametrize("n", [3, 5])
def test_central_difference_is_of_second_order_on_any_body(
    body: Body, reference_of: Reference, order_of: Order, n: int, kind: str
) -> None:
    rotor = hinged(body(n, seed=1, kind=kind), PULSE)
    times, steps = np.linspace(0.0, 4.0, 41), 0.004 / 2.0 ** np.arange(3)
    start = moving(rotor)
    q, v = reference_of(rotor, *start, times)
    marches = [CentralDifference(step).march(rotor, *start, times) for step in steps]
    assert CentralDifference(1.0).order(rotor) == 2
    assert order_of(steps, np.array([np.abs(march.q - q).max() for march in marches])) == pytest.approx(2, abs=0.1)
    assert order_of(steps, np.array([np.abs(march.v - v).max() for march in marches])) == pytest.approx(2, abs=0.1)


@SUB_CYCLED
@pytest.mark.parametrize("n", [3, 5])
def test_sub_cycling_is_of_second_order_on_bodies_without_inertial_coupling(
    body: Body, reference_of: Reference, order_of: Order, n: int, m: int
) -> None:
    # Spin stretches the body and couples its modes; the rate changes within a cycle, and with it the stretch.
    rotor = hinged(body(n, seed=1, kind="uncoupled"), PULSE)
    assert rotor.couplings.elastic
    times, steps = np.linspace(0.0, 4.0, 41), 0.004 / 2.0 ** np.arange(3)
    start = moving(rotor)
    q, _ = reference_of(rotor, *start, times)
    marches = [Subcycling(step, m).march(rotor, *start, times) for step in steps]
    assert Subcycling(1.0, m).order(rotor) == 2
    assert order_of(steps, np.array([np.abs(march.q - q).max() for march in marches])) == pytest.approx(2, abs=0.1)


@SUB_CYCLED
@pytest.mark.parametrize("kind", ["conforming", "coupled"])
def test_sub_cycling_is_at_least_of_first_order_on_any_body(
    body: Body, reference_of: Reference, order_of: Order, m: int, kind: str
) -> None:
    # A slow acceleration frozen over a cycle is late by half of it, and acts on the modes by the coupling; a conforming
    # body gets some from its own deformation.
    rotor = hinged(body(4, seed=1, kind=kind), PULSE)
    times, steps = np.linspace(0.0, 4.0, 41), 0.004 / 2.0 ** np.arange(3)
    start = moving(rotor)
    q, _ = reference_of(rotor, *start, times)
    errors = [np.abs(Subcycling(step, m).march(rotor, *start, times).q - q).max() for step in steps]
    assert Subcycling(1.0, m).order(rotor) == 1
    assert order_of(steps, np.array(errors)) > 0.9


def test_output_between_the_steps_is_of_second_order(
    body: Body, reference_of: Reference, order_of: Order, method: Method
) -> None:
    rotor = hinged(body(3, seed=2, kind="uncoupled"))
    times, steps = np.sort(np.random.default_rng(0).uniform(0.0, 2.0, 200)), 0.002 / 2.0 ** np.arange(3)
    start = moving(rotor)
    q, v = reference_of(rotor, *start, times)
    marches = [method(step).march(rotor, *start, times) for step in steps]
    assert order_of(steps, np.array([np.abs(march.q - q).max() for march in marches])) > 1.9
    assert order_of(steps, np.array([np.abs(march.v - v).max() for march in marches])) > 1.9


def test_the_random_bodies_are_of_the_kinds_they_are_named_after(body: Body) -> None:
    uncoupled, conforming, coupled = bodies = [body(4, seed=1, kind=kind) for kind in BODIES]
    assert not hinged(uncoupled, PULSE).coupled
    assert hinged(conforming, PULSE).coupled
    assert conforming.coupling < 1e-12
    assert coupled.coupling > 0.1
    for some in bodies:
        rotor, a = hinged(some, PULSE), np.zeros(5)
        assert rotor.couplings.elastic
        evaluate(rotor.parameters, 0.0, np.zeros(5), np.r_[1.0, np.zeros(4)], a)
        assert np.abs(a[1:]).min() > 0.01  # spin stretches it


# Identities ------------------------------------------------------------------------------------------------------


@KINDS
@pytest.mark.parametrize("n", [1, 3, 6])
def test_one_to_one_sub_cycling_is_central_difference_bit_for_bit(body: Body, n: int, kind: str) -> None:
    rotor = hinged(body(n, seed=3, kind=kind), PULSE)
    assert Subcycling(1.0, 1).order(rotor) == 2
    assert_equal_bit_for_bit(rotor, 0.005, np.linspace(0.0, 10.0, 77))


@pytest.mark.parametrize("frame", ["rotor", "free_rotor"])
def test_one_to_one_sub_cycling_of_the_beam_is_central_difference_bit_for_bit(
    frame: str, request: pytest.FixtureRequest
) -> None:
    rotor = request.getfixturevalue(frame)
    assert rotor.frozen(1e-5).single
    assert rotor.coupled == (frame == "free_rotor")
    assert_equal_bit_for_bit(rotor, 1e-5, np.linspace(0.0, 0.2, 77))


def assert_equal_bit_for_bit(rotor: CompiledSystem, step: float, times: Array) -> None:
    start = moving(rotor, deformed=1e-3)
    plain, one = (method.march(rotor, *start, times) for method in (CentralDifference(step), Subcycling(step, 1)))
    assert np.array_equal(plain.q, one.q)
    assert np.array_equal(plain.v, one.v)
    assert_same_state(plain.end, one.end)


def assert_same_state(one: State, other: State) -> None:
    assert one.step == other.step
    for name in "qva":
        assert np.array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize("m", [2, 7])
@pytest.mark.parametrize("n", [3, 5])
def test_sub_cycling_of_a_body_that_turns_steadily_is_central_difference(body: Body, n: int, m: int) -> None:
    # With an inertia of 2·10¹² kg m² about the axis the rate is constant: what a cycle holds doesn't change.
    rotor = hinged(body(n, seed=4, far=1e6), PULSE)
    assert rotor.couplings.elastic
    start, times = moving(rotor), np.linspace(0.0, 10.0, 101)
    plain = CentralDifference(0.01).march(rotor, *start, times)
    sub_cycled = Subcycling(0.01, m).march(rotor, *start, times)
    assert sub_cycled.q == pytest.approx(plain.q, abs=1e-9)
    assert sub_cycled.v == pytest.approx(plain.v, abs=1e-8)


def test_a_mode_at_rest_follows_the_discrete_cosine(coasting: CompiledSystem, method: Method) -> None:
    # Without spin each mode is an oscillator on its own. Leapfrog from rest gives q_n = q_0 cos(2n arcsin(ωh/2)) for
    # every ωh < 2; here the highest is 1.98, over 10⁵ steps.
    step = 0.99 * method(1.0).largest_step(coasting)
    n, q0 = np.arange(0, 100_001, 1000), np.r_[0.0, np.full(coasting.n - 1, 1e-4)]
    march = method(step).march(coasting, q0, np.zeros(coasting.n), n * step)
    phase = 2 * np.arcsin(body_of(coasting).omega * step / 2)
    assert march.q[:, 1:] == pytest.approx(1e-4 * np.cos(np.outer(n, phase)), abs=1e-10)
    assert np.array_equal(march.q[:, 0], np.zeros(n.size))


# Output and restart ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=["beam", "general"])
def scenario(request: pytest.FixtureRequest, rotor: CompiledSystem, body: Body) -> tuple[CompiledSystem, float]:
    """A mechanism and a step for it: one with modes that don't couple with each other, one with modes that do."""
    return (rotor, 1e-5) if request.param == "beam" else (hinged(body(4, seed=5), PULSE), 0.004)


def test_output_times_never_change_the_steps(scenario: tuple[CompiledSystem, float], method: Method) -> None:
    rotor, step = scenario
    last, start = 3000 * step, moving(scenario[0], deformed=1e-3)
    rng = np.random.default_rng(7)
    coarse = np.linspace(0.0, last, 11)
    grids = [np.array([last]), coarse, np.arange(3001) * step, np.sort(np.r_[coarse, rng.uniform(0.0, last, 500)])]
    marches = [method(step).march(rotor, *start, grid) for grid in grids]
    for march in marches[1:]:
        assert_same_state(march.end, marches[0].end)
        rows = np.searchsorted(march.times, coarse[1:-1] - 1e-9 * step)
        assert march.times[rows] == pytest.approx(coarse[1:-1], rel=1e-12)
    for march, grid in zip(marches[2:], grids[2:], strict=True):
        common, there, here = np.intersect1d(coarse, grid, return_indices=True)
        assert common.size > 5
        assert np.array_equal(march.q[here], marches[1].q[there])
        assert np.array_equal(march.v[here], marches[1].v[there])


@pytest.mark.parametrize("m", [2, 7])
@pytest.mark.parametrize("sub_cycled", [Subcycling, ReversibleSubcycling])
@pytest.mark.parametrize("system", ["beam", "beam, free frame", "coupled modes", "linear", "chain"])
def test_output_times_within_a_cycle_leave_it_alone(
    request: pytest.FixtureRequest,
    body: Body,
    system: str,
    sub_cycled: type[Subcycling | ReversibleSubcycling],
    m: int,
) -> None:
    # Output at each step, and between: the fast steps are cut everywhere. The torque ends within a cycle.
    some: CompiledSystem | LinearSystem
    step, rng = 1e-5, np.random.default_rng(2)
    if system.startswith("beam"):
        beam = body_of(request.getfixturevalue("rotor" if system == "beam" else "free_rotor"))
        some = hinged(beam, half_sine(0.0, 1003.3e-5, 5.0))
    elif system == "coupled modes":
        some, step = hinged(body(4, seed=5), half_sine(0.32, 2003.3 * 0.004 - 0.32, 20.0)), 0.004
    elif system == "linear":
        A, B = rng.normal(size=(2, 4, 4))
        some, step = LinearSystem(A @ A.T + np.eye(4), B @ B.T, 2, 0.1 * np.eye(4)), 0.01
    else:
        rod = rigid_integrals(1.0, np.array([0.25, 0.0, 0.0]), np.diag([1e-3, 0.02, 0.02]))
        links = [Link(f"rod {k}", rod, REVOLUTE, k - 1, spring=9.0 * 100**k, damper=0.01) for k in range(2)]
        some, step = CompiledSystem(Mechanism(links, ["rod 1"])), 1e-3
    start = 1e-3 * rng.normal(size=some.n), rng.normal(size=some.n)
    coarse, times = np.linspace(0.0, 3000 * step, 11), np.arange(3001) * step
    fine = np.sort(np.r_[coarse, times, rng.uniform(0.0, times[-1], 2000)])
    one, other = (sub_cycled(step, m).march(some, *start, grid) for grid in (coarse, fine))
    assert_same_state(other.end, one.end)
    rows = np.searchsorted(fine, coarse)
    assert np.array_equal(other.q[rows], one.q)
    assert np.array_equal(other.v[rows], one.v)


def test_a_time_asked_for_twice_is_answered_twice(scenario: tuple[CompiledSystem, float], method: Method) -> None:
    rotor, step = scenario
    once = method(step).march(rotor, *moving(rotor), np.array([0.0, 33.0, 33.5, 90.0]) * step)
    twice = method(step).march(rotor, *moving(rotor), np.repeat(once.times, 2))
    assert np.array_equal(twice.q, np.repeat(once.q, 2, axis=0))
    assert np.array_equal(twice.v, np.repeat(once.v, 2, axis=0))


def test_the_first_output_is_the_start(scenario: tuple[CompiledSystem, float], method: Method) -> None:
    rotor, step = scenario
    q0, v0 = moving(rotor)
    march = method(step).march(rotor, q0, v0, np.array([0.0, step]))
    assert np.array_equal(march.q[0], q0)
    assert march.v[0] == pytest.approx(v0, rel=1e-12, abs=1e-12)


def test_watching_a_march_doesnt_change_it(scenario: tuple[CompiledSystem, float], method: Method) -> None:
    rotor, step = scenario
    parts: list[float] = []
    times = np.linspace(0.0, 20_000 * step, 9)
    watched = method(step).march(rotor, *moving(rotor), times, parts.append)
    assert np.array_equal(watched.q, method(step).march(rotor, *moving(rotor), times).q)
    assert len(parts) > 1
    assert parts == sorted(parts)
    assert 0 < parts[0] < parts[-1] == 1


def test_a_march_leaves_what_it_is_given_alone(scenario: tuple[CompiledSystem, float], method: Method) -> None:
    rotor, step = scenario
    start, times = moving(rotor), np.linspace(0.0, 100 * step, 9)
    given = [array.copy() for array in (*start, times)]
    first = method(step).march(rotor, *start, times)
    end = [getattr(first.end, name).copy() for name in "qva"]
    method(step).resume(rotor, first.end, 2 * times)
    for now, before in zip((*start, times, first.end.q, first.end.v, first.end.a), given + end, strict=True):
        assert np.array_equal(now, before)


@pytest.mark.parametrize("stop", [700.0, 700.5, 709.0])
def test_a_march_resumed_is_one_march_bit_for_bit(
    scenario: tuple[CompiledSystem, float], method: Method, stop: float
) -> None:
    rotor, step = scenario
    start, times = moving(rotor), np.arange(0.0, 2000.0, 0.7) * step
    whole = method(step).march(rotor, *start, times)
    first = method(step).march(rotor, *start, times[times <= stop * step])
    assert first.end.step % first.substeps == 0  # a march stops where all coordinates are at the same time
    assert 0 < first.end.step - first.times[-1] / step <= first.substeps
    second = method(step).resume(rotor, first.end, times)
    assert_same_state(second.end, whole.end)
    to_come = times >= first.end.step * step
    for given, wanted in ((first, ~to_come[: len(first.times)]), (second, to_come)):
        assert np.array_equal(given.q[wanted], whole.q[: len(wanted)][wanted])
        assert np.array_equal(given.v[wanted], whole.v[: len(wanted)][wanted])


# Reversal --------------------------------------------------------------------------------------------------------


def test_central_difference_without_velocity_dependent_forces_retraces_its_steps(body: Body) -> None:
    # Leapfrog is symmetric: from the same coordinates with the next rate negated it goes back the way it came. There
    # are no velocity-dependent forces where points move along the axis alone: nothing then changes the inertia.
    some = body(4, seed=6)
    shapes = np.linalg.qr(some.shapes.sum(axis=1))[0][:, None, :] * some.axis[:, None]
    rotor = hinged(replace(some, shapes=shapes, integrals=inertia_integrals(some.x, np.eye(10), shapes)))
    assert not (rotor.coupled)
    assert not (rotor.couplings.elastic)
    assert not (rotor.couplings.damped)
    q0, v0 = moving(rotor)
    step, n_steps = 0.02, 10_000
    end = CentralDifference(step).march(rotor, q0, v0, np.array([(n_steps - 1) * step])).end
    assert end.step == n_steps
    a = np.empty(rotor.n)
    evaluate(rotor.parameters, 0.0, end.q, end.v, a)
    turned = State(0, end.q, -(end.v + step * a), a)
    back = CentralDifference(step).resume(rotor, turned, np.array([n_steps * step]))
    assert np.abs(end.q - q0).max() > 0.1
    assert back.q[-1] == pytest.approx(q0, abs=1e-9)


def test_with_velocity_dependent_forces_central_difference_goes_back_to_second_order(
    body: Body, order_of: Order
) -> None:
    # v_n ≈ v_{n−½} + ½h a_{n−1} looks back and not ahead, which costs the symmetry.
    rotor = hinged(body(4, seed=6))
    q0, v0 = moving(rotor)
    steps, errors, times = 0.004 / 2.0 ** np.arange(3), [], np.array([0.0, 4.0])
    for step in steps:
        there = CentralDifference(step).march(rotor, q0, v0, times)
        back = CentralDifference(step).march(rotor, there.q[-1], -there.v[-1], times)
        errors.append(np.abs(back.q[-1] - q0).max())
    assert min(errors) > 1e-9  # well above round-off: it isn't reversible
    assert order_of(steps, np.array(errors)) > 1.9


# Stability -------------------------------------------------------------------------------------------------------


@KINDS
def test_the_largest_step_is_two_over_the_highest_frequency(body: Body, kind: str) -> None:
    some = body(4, seed=7, kind=kind)
    rotor = hinged(some)
    # Eliminating the angle leaves the modes with mass 1 − HHᵀ/J, where H = eᵀ of the mass matrix's rows of rotation.
    H = some.axis @ some.integrals.mass_matrix(np.eye(1, 5)[0])[3:6, 6:]
    mass = np.eye(4) - np.outer(H, H) / some.inertia_about_joint
    coupled = np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, np.diag(some.omega**2))).real.max())
    assert CentralDifference(1.0).largest_step(rotor) == pytest.approx(2 / coupled, rel=1e-10)
    assert Subcycling(1.0, 1).largest_step(rotor) == pytest.approx(2 / coupled, rel=1e-10)
    assert Subcycling(1.0, 5).largest_step(rotor) == pytest.approx(2 / some.omega.max(), rel=1e-12)


def test_just_below_the_largest_step_the_driven_beam_stays_where_it_should(
    rotor: CompiledSystem, method: Method
) -> None:
    step, rest = 0.99 * method(1.0).largest_step(rotor), np.zeros(rotor.n)
    march = method(step).march(rotor, rest, rest, np.arange(0, 100_001, 10) * step)
    # Leapfrog overstates an oscillator's response by 1/√(1 − (ωh/2)²) at most: 7.1 times at 0.99.
    kinetic, strain = energies(rotor, march)
    driven = march.times < 0.2
    assert kinetic.max() < 2 * kinetic[driven].max()
    assert strain.max() < 2 * strain[driven].max()


def test_just_above_the_largest_step_the_march_diverges_and_says_when_and_where(
    rotor: CompiledSystem, method: Method
) -> None:
    step, rest = 1.02 * method(1.0).largest_step(rotor), np.zeros(rotor.n)
    with pytest.raises(StabilityError, match=r"diverged at t = \S+ s, most in coordinate \d+ \(rate ") as caught:
        method(step).march(rotor, rest, rest, np.array([10_000 * step]))
    found = re.search(r"t = (\S+) s, most in coordinate (\d+) .*; take a smaller step$", str(caught.value))
    assert found
    # The amplitude grows by (ωh/2 + √((ωh/2)² − 1))² = 1.49 a step, so that 10³⁰ is passed within some 200 steps; the
    # highest mode, the last coordinate, is the one that is unstable.
    assert 0 < float(found[1]) < 400 * step
    # The angle follows with the square of it, before sub-cycling that solves for it last has looked.
    assert int(found[2]) in ((0, rotor.n - 1) if method(1.0).name.startswith("reversible") else (rotor.n - 1,))


def test_in_the_free_frame_central_difference_has_the_coupled_limit(free_rotor: CompiledSystem) -> None:
    limit = CentralDifference(1.0).largest_step(free_rotor)
    assert limit < 2 / body_of(free_rotor).omega.max()
    coasting = hinged(body_of(free_rotor))
    rest, deformed = np.zeros(coasting.n), np.r_[0.0, np.full(coasting.n - 1, 1e-6)]
    below = CentralDifference(0.99 * limit).march(coasting, deformed, rest, np.arange(0, 100_001, 10) * limit * 0.99)
    # The norm in which the step is unitary bounds the strain energy by its start over 1 − (ωh/2)² = 0.02.
    strain = energies(coasting, below)[1]
    assert strain.max() < strain[0] / (1 - 0.99**2)
    with pytest.raises(StabilityError, match="the march diverged"):
        CentralDifference(1.02 * limit).march(coasting, deformed, rest, np.array([10_000 * limit]))


@pytest.mark.parametrize(
    ("key", "name"), [("simulation.step", "central-difference"), ("simulation.run.1.step", "sub-cycling")]
)
def test_a_scene_with_a_step_above_the_limit_is_refused_before_it_starts(
    rotor: CompiledSystem, key: str, name: str
) -> None:
    scene, tasks = load_scene("beam-paper", [f"{key}=300 us"]), Tasks()
    pipeline = Pipeline(scene, monitor=tasks)
    with pytest.raises(InputError, match=rf"beam-paper\.toml: {key} = .*0\.0003 s.*{name} would diverge") as caught:
        _ = pipeline.motions
    limit = re.search(r"largest stable step of this model is (\S+) s .* (\S+) Hz\)", str(caught.value))
    assert limit
    highest = body_of(rotor).omega.max()
    assert float(limit[1]) == pytest.approx(2 / highest, rel=1e-3)
    assert float(limit[2]) == pytest.approx(highest / (2 * np.pi), rel=1e-4)
    assert not tasks.began_a_run(scene)


# What is refused -------------------------------------------------------------------------------------------------


@EACH
@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("coordinate", range(4))
@pytest.mark.parametrize("which", ["q0", "v0"])
def test_what_is_not_finite_never_leaves_silently(
    body: Body, method: Method, which: str, coordinate: int, bad: float
) -> None:
    rotor = hinged(body(3, seed=8), PULSE)
    start = {"q0": np.zeros(4), "v0": np.zeros(4)}
    start[which][coordinate] = bad
    message = f"{which} holds 1 values that are not finite|the march diverged"
    with pytest.raises(AccuracyError, match=message), np.errstate(invalid="ignore"):
        method(0.01).march(rotor, **start, times=np.array([0.0, 1.0]))


@EACH
@pytest.mark.parametrize("name", ["q0", "v0"])
def test_a_start_of_the_wrong_length_is_refused(body: Body, method: Method, name: str) -> None:
    rotor = hinged(body(3, seed=8), PULSE)
    start = {"q0": np.zeros(4), "v0": np.zeros(4), name: np.zeros(3)}
    with pytest.raises(ValueError, match=rf"{name} has shape \(3,\), expected \(4\)"):
        method(0.01).march(rotor, **start, times=np.array([0.0, 1.0]))


@EACH
@pytest.mark.parametrize(
    "times",
    [[], [0.5, 0.2, 0.7], [-0.1, 0.5], [0.0, np.nan, 0.5], [0.0, np.nan], [0.0, np.inf]],
    ids=["none", "out of order", "before the start", "a nan", "a nan at the end", "never"],
)
def test_output_times_that_no_march_can_keep_are_refused(body: Body, method: Method, times: list[float]) -> None:
    rotor = hinged(body(3, seed=8), PULSE)
    with pytest.raises(ValueError, match="times"), np.errstate(invalid="ignore"):
        method(0.01).march(rotor, np.zeros(4), np.zeros(4), np.array(times))


@EACH
@pytest.mark.parametrize("step", [0.0, -0.01, np.nan, np.inf])
def test_a_step_that_leads_nowhere_is_refused(body: Body, method: Method, step: float) -> None:
    rotor = hinged(body(3, seed=8), PULSE)
    with pytest.raises(ValueError, match=f"step is {step}"), np.errstate(invalid="ignore", divide="ignore"):
        method(step).march(rotor, np.zeros(4), np.zeros(4), np.array([0.0, 1.0]))


@EACH
def test_times_before_a_resumed_march_are_left_without_a_number(body: Body, method: Method) -> None:
    rotor = hinged(body(3, seed=8), PULSE)
    first = method(0.01).march(rotor, np.zeros(4), np.zeros(4), np.array([1.0]))
    second = method(0.01).resume(rotor, first.end, np.array([0.0, 0.5, 2.0]))
    for given in (second.q, second.v):
        assert np.isnan(given[:2]).all()
        assert np.isfinite(given[2]).all()


@pytest.mark.parametrize("substeps", [0, -5])
def test_sub_cycling_needs_a_substep(substeps: int) -> None:
    with pytest.raises(ValueError, match=f"substeps is {substeps}, expected at least 1"):
        Subcycling(1e-5, substeps)
