"""Reversible sub-cycling: order, the linear map against its formula, conservation where sub-cycling fails, limits."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.errors import InputError, StabilityError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import constant, half_sine
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.integrators.runge_kutta import RungeKutta
from fmd.integrators.subcycling import Subcycling
from fmd.reduction.body import FlexibleBody, MarkerShapes
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from tests.dynamics.hinged_body import body_of, energies, hinged
from tests.linear_system import LinearSystem

Body = Callable[..., FlexibleBody]
Order = Callable[[Array, Array], float]
RATIOS = pytest.mark.parametrize("m", [2, 5, 10])


def errors_of(system: Any, start: tuple[Array, Array], times: Array, steps: Array, m: int) -> Array:
    exact = RungeKutta(1e-13).march(system, *start, times).q
    marches = [ReversibleSubcycling(step, m).march(system, *start, times) for step in steps]
    return np.array([np.abs(march.q - exact).max() for march in marches])


def drift(system: Any, march: Any) -> float:
    """Largest change of the energy [J]."""
    kinetic, potential = energies(system, march)
    return float(np.abs(kinetic + potential - kinetic[0] - potential[0]).max())


# Order -----------------------------------------------------------------------------------------------------------

# The arm's five modes alone at 20 µs: static responses are stiff, and take shorter steps.
ARM = ["body.forearm.modes.enrich=none", "simulation.step=20 us"]
# Scene, overrides, duration and coarsest step.
SCENES: dict[str, tuple[str, list[str], float, float]] = {
    "beam": ("beam-paper", [], 0.05, 1e-5),
    "free frame": ("beam-paper", ["simulation.frame=free"], 0.05, 1e-5),
    "rod-slider": ("rod-slider", [], 2.0, 2e-4),
    "arm": ("arm", ARM, 0.05, 2e-5),
}


@pytest.mark.parametrize("m", [5, 10])
@pytest.mark.parametrize("scene", SCENES)
def test_it_is_of_second_order_whatever_couples(order_of: Order, scene: str, m: int) -> None:
    name, overrides, duration, step = SCENES[scene]
    run = f'{{ integrator = "reversible-sub-cycling", substeps = {m} }}'
    ((_, plan),) = Pipeline(load_scene(name, [f"simulation.run=[{run}]", *overrides])).plans.items()
    steps, times = step / 2.0 ** np.arange(3), np.linspace(0.0, duration, 11)
    assert plan.integrator.order(plan.system) == 2
    assert order_of(steps, errors_of(plan.system, plan.start, times, steps, m)) == pytest.approx(2, abs=0.15)


@RATIOS
@pytest.mark.parametrize("kind", ["uncoupled", "conforming", "coupled"])
def test_it_is_of_second_order_on_any_rotor_under_any_spin(body: Body, order_of: Order, kind: str, m: int) -> None:
    rotor = hinged(body(4, seed=1, kind=kind), half_sine(0.32, 1.6, 20.0))
    rng, times, steps = np.random.default_rng(0), np.linspace(0.0, 4.0, 41), 0.001 / 2.0 ** np.arange(3)
    start = np.r_[0.3, 0.1 * rng.normal(size=4)], np.r_[0.5, 0.3 * rng.normal(size=4)]
    assert order_of(steps, errors_of(rotor, start, times, steps, m)) == pytest.approx(2, abs=0.15)


# The linear map --------------------------------------------------------------------------------------------------


def map_by_formula(M: Array, K: Array, h: float, m: int) -> Array:
    """Map of (q, v) over m steps of half a drift, a kick and half a drift for ``M a + K q = 0``."""
    n = len(M)
    drift, kick = np.eye(2 * n), np.eye(2 * n)
    drift[:n, n:] = 0.5 * h * np.eye(n)
    kick[n:, :n] = -h * np.linalg.solve(M, K)
    return np.linalg.matrix_power(drift @ kick @ drift, m)


def map_by_marching(system: Any, h: float, m: int, rest: Array, size: float) -> Array:
    """The same of small motions about rest, by central differences: from the first cycle after a start."""
    n, columns = system.n, []
    method, end = ReversibleSubcycling(h, m), np.array([(m - 0.5) * h])
    for unit in np.eye(2 * n):
        ends = []
        for sign in (1.0, -1.0):
            state = method.march(system, rest + sign * size * unit[:n], sign * size * unit[n:], end).end
            assert state.step == m
            ends.append(np.concatenate([state.q, state.v]))
        columns.append((ends[0] - ends[1]) / (2 * size))
    return np.array(columns).T


def scaled(A: Array, omega: float) -> Array:
    """With rates over ω, so that all entries are alike."""
    size = np.r_[np.ones(len(A) // 2), np.full(len(A) // 2, 1 / omega)]
    return np.asarray(size[:, None] * A / size)


@RATIOS
def test_small_motions_of_a_coupled_rotor_take_the_linear_map(free_rotor: CompiledSystem, m: int) -> None:
    rotor = hinged(body_of(free_rotor))
    h = 0.5 * ReversibleSubcycling(1.0, m).largest_step(rotor)
    want = map_by_formula(rotor.linear_matrices[0], np.diag(np.r_[0.0, body_of(rotor).omega ** 2]), h, m)
    found = map_by_marching(rotor, h, m, np.zeros(rotor.n), 1e-7)
    omega = rotor.highest_frequency
    assert scaled(found, omega) == pytest.approx(scaled(want, omega), abs=1e-8)


def pendulum() -> CompiledSystem:
    """Three rods on springy hinges that couple strongly: the last two are fast."""
    integrals = rigid_integrals(1.0, np.array([0.25, 0.0, 0.0]), np.diag([1e-3, 0.02, 0.02]))
    places = [np.zeros(3), np.array([0.5, 0.0, 0.0]), np.array([0.5, 0.0, 0.0])]
    links = [
        Link(f"rod {k}", integrals, REVOLUTE, k - 1, MarkerShapes(place), np.array([0.0, 0.0, 1.0]), spring=spring)
        for k, (place, spring) in enumerate(zip(places, (20.0, 300.0, 500.0), strict=True))
    ]
    return CompiledSystem(Mechanism(links, ["rod 1", "rod 2"]))


@RATIOS
def test_small_motions_of_a_coupled_chain_take_the_linear_map(m: int) -> None:
    tree = pendulum()
    M, K, _ = tree.linear_matrices
    assert tree.n_slow == 1
    h = 0.5 * ReversibleSubcycling(1.0, m).largest_step(tree)
    want = map_by_formula(M, K, h, m)
    assert np.abs(np.linalg.eigvals(want)).max() == pytest.approx(1, abs=1e-9)
    found = map_by_marching(tree, h, m, tree.mechanism.rest_positions, 1e-5)
    assert scaled(found, tree.highest_frequency) == pytest.approx(scaled(want, tree.highest_frequency), abs=1e-6)


@RATIOS
def test_a_march_from_its_end_with_rates_reversed_goes_back_to_its_start(m: int) -> None:
    # Sliders on sliders along one line couple through the mass matrix alone and have no velocity-dependent force.
    point = rigid_integrals(1.0, np.zeros(3), np.eye(3))
    links = [Link(f"slider {k}", point, PRISMATIC, k - 1, spring=4.0 * 50.0**k) for k in range(3)]
    system = CompiledSystem(Mechanism(links, ["slider 1", "slider 2"]))
    assert system.couplings.inertial
    method = ReversibleSubcycling(0.4 * ReversibleSubcycling(1.0, m).largest_step(system), m)
    start, times = (np.array([0.3, -0.1, 0.02]), np.array([0.5, -0.2, 1.0])), np.array([(600 * m - 0.5) * method.step])
    there = method.march(system, *start, times).end
    back = method.march(system, there.q, -there.v, times).end
    assert there.step == back.step == 600 * m
    assert np.abs(there.q - start[0]).max() > 1e-2
    assert back.q == pytest.approx(start[0], abs=1e-10)
    assert -back.v == pytest.approx(start[1], abs=1e-9)


@RATIOS
def test_the_largest_step_is_central_differences(m: int) -> None:
    tree = pendulum()
    limit = ReversibleSubcycling(1.0, m).largest_step(tree)
    assert limit == pytest.approx(2 / tree.highest_frequency)
    small = np.r_[1e-6, -1e-6, 1e-6]
    times = np.linspace(0.0, 3000 * m * limit, 301)
    march = ReversibleSubcycling(0.98 * limit, m).march(tree, small, np.zeros(3), times)
    assert np.abs(march.q).max() < 1e-3
    with pytest.raises(StabilityError, match="diverged"):
        ReversibleSubcycling(1.05 * limit, m).march(tree, small, np.zeros(3), times)


# Conservation ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("m", [5, 10])
def test_the_free_frames_beam_keeps_its_energy(free_rotor: CompiledSystem, m: int) -> None:
    # Sub-cycling at 10:1 takes it from 1.3 J to 229 J within the same time.
    coast, rest = np.linspace(0.11, 0.5, 391), np.zeros(free_rotor.n)
    march = ReversibleSubcycling(1e-5, m).march(free_rotor, rest, rest, coast)
    assert drift(free_rotor, march) < 1e-7
    assert drift(free_rotor, Subcycling(1e-5, 10).march(free_rotor, rest, rest, coast)) > 100


@pytest.fixture(scope="module")
def swung() -> tuple[CompiledSystem, tuple[Array, Array]]:
    """The arm without its drive and its dampers, let go at 3 rad/s."""
    run = Pipeline(load_scene("arm", ARM))
    tree, (q0, v0) = run.mechanism, run.start
    links = [replace(link, damper=0.0, damping=0.0 * link.damping, load=constant(0.0)) for link in tree.links]
    return CompiledSystem(replace(tree, links=links)), (q0, np.r_[3.0, v0[1:]])


def test_the_arm_keeps_its_energy_where_sub_cycling_diverges(swung: tuple[CompiledSystem, tuple[Array, Array]]) -> None:
    tree, start = swung
    times = np.linspace(0.0, 2.0, 401)
    with pytest.raises(StabilityError, match="diverged"):
        Subcycling(2e-5, 5).march(tree, *start, times)
    march = ReversibleSubcycling(2e-5, 5).march(tree, *start, times)
    kinetic, _ = energies(tree, march)
    assert np.ptp(kinetic) > 5.0
    assert drift(tree, march) < 1e-6


def test_the_arms_energy_is_kept_better_by_the_square_of_the_step(
    swung: tuple[CompiledSystem, tuple[Array, Array]], order_of: Order
) -> None:
    tree, start = swung
    steps, times = 4e-5 / 2.0 ** np.arange(3), np.linspace(0.0, 0.5, 101)
    drifts = [drift(tree, ReversibleSubcycling(step, 5).march(tree, *start, times)) for step in steps]
    assert order_of(steps, np.array(drifts)) > 1.8


def test_a_hub_that_nothing_drives_keeps_its_momentum_within_a_cycle(body: Body) -> None:
    # M_LL v_L + M_LS v_S is that of each cycle's M̂, which deflections of 10⁻⁹ change by as much: no more may show.
    rotor = hinged(body(4, seed=3, kind="coupled"))
    rng = np.random.default_rng(1)
    q0, v0 = np.r_[0.0, 1e-9 * rng.normal(size=4)], np.r_[0.0, 1e-9 * rng.normal(size=4)]
    J, H = rotor.linear_matrices[0][0, 0], rotor.linear_matrices[0][0, 1:]
    march = ReversibleSubcycling(0.01, 10).march(rotor, q0, v0, 0.01 * np.arange(0, 1001, 10))
    momentum = J * march.v[:, 0] + march.v[:, 1:] @ H
    assert momentum == pytest.approx(np.full(101, momentum[0]), rel=1e-6)


# Scenes ----------------------------------------------------------------------------------------------------------


def planned(scene: str, settings: str) -> Any:
    run = f'simulation.run=[{{ integrator = "reversible-sub-cycling", {settings} }}]'
    return Pipeline(load_scene(scene, [run, *ARM])).plans


def test_one_to_one_is_central_difference() -> None:
    ((label, plan),) = planned("arm", "substeps = 1").items()
    assert label == "reversible-sub-cycling 1:1"
    assert plan.integrator == CentralDifference(2e-5)


def test_a_fast_step_beyond_the_coupled_limit_is_refused() -> None:
    ((_, plan),) = planned("arm", "substeps = 5").items()
    limit = plan.integrator.largest_step(plan.system)
    assert limit < 0.95 * Subcycling(1.0, 5).largest_step(plan.system)
    with pytest.raises(InputError, match="reversible-sub-cycling would diverge"):
        planned("arm", f"substeps = 5, step = '{1.001e6 * limit} us'")


class Stopped(LinearSystem):
    """Two oscillators of which the first one has an end stop."""

    @property
    def stiffest_matrices(self) -> tuple[Array, Array, Array]:
        M, K, C = self.linear_matrices
        return M, K + np.diag([1e4, 0.0]), C


def test_the_cause_of_a_limit_by_end_stops_is_named() -> None:
    # 2/(m ω) with ω = 100 rad/s; with one step it is the second oscillator's 2/ω, ω = 150 rad/s.
    system = Stopped(np.eye(2), np.diag([1.0, 150.0**2]), 1)
    method = ReversibleSubcycling(1e-3, 10)
    assert method.largest_step(system) == pytest.approx(2e-3)
    assert method.describe_limit(system).endswith("of its end stops alone, whose forces are frozen over 10 steps")
    assert ReversibleSubcycling(1e-3, 1).largest_step(system) == pytest.approx(2 / 150)
    assert "23.873 Hz" in ReversibleSubcycling(1e-3, 1).describe_limit(system)


@pytest.mark.parametrize("substeps", [0, -5])
def test_it_needs_a_substep(substeps: int) -> None:
    with pytest.raises(ValueError, match=f"substeps is {substeps}, expected at least 1"):
        ReversibleSubcycling(1e-5, substeps)
