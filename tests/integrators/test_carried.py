"""Sub-cycling by carried forces: its maps, its order, its growth, and when it is taken."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.cli.run import _notes
from fmd.core.arrays import Array
from fmd.integrators.carried import _maps
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.runge_kutta import RungeKutta
from fmd.integrators.subcycling import Subcycling
from fmd.stability.tangent import OperatingPoint, scheme_growth_rates
from fmd.stages import runs
from fmd.stages.plan import Growth
from tests.linear_system import LinearSystem

COARSE = "body.propeller.mesh={order=1, sleeve=[24, 2, 1], joint=[2, 2, 2], blade=[2, 2, 4]}"


def gyroscopic(spin: float, damping: float = 0.0) -> LinearSystem:
    """Make a slow coordinate on soft springs and five fast ones that couple by stiffness, damping and spin."""
    random = np.random.default_rng(3)
    B, G = random.normal(size=(6, 6)), random.normal(size=(6, 6))
    K = np.diag([0.5, 30.0, 40.0, 60.0, 80.0, 100.0]) ** 2 + 20.0 * (B + B.T)
    C = spin * (G - G.T) + damping * (B @ B.T)
    return LinearSystem(np.eye(6), K, 1, C)


def start_of(system: LinearSystem) -> tuple[Array, Array]:
    random = np.random.default_rng(1)
    return random.normal(size=system.n) / 50.0, random.normal(size=system.n)


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("m", [2, 5, 10])
def test_the_map_of_a_cycle_is_its_steps(m: int, degree: int) -> None:
    random, h, k = np.random.default_rng(m), 0.3, np.array([0.0, 1e-2, 0.7, 9.0, 40.0])
    v, a, r, r1, r2 = random.normal(size=(5, k.size))
    q = (r - a) / np.where(k > 0, k, 1.0)
    r = a + k * q
    x, rate, now = q.copy(), v.copy(), a.copy()
    for s in range(m):
        if s:
            line, curve = (r - r1) / m if degree else 0.0, (r - 2 * r1 + r2) / (2 * m * m) if degree > 1 else 0.0
            now = r + s * line + s * (s + m) * curve - k * x
        rate = rate + h * now
        x = x + h * rate
    found = np.einsum("rpn,pn->rn", _maps(k, h, m)[degree], np.array([v, a, r, r1, r2]))
    for one, other in zip(found, (x - q, rate, now), strict=True):
        assert one == pytest.approx(other, rel=1e-10, abs=1e-10)


@pytest.mark.parametrize(("forces", "order"), [("carried", 2), ("frozen", 1)])
def test_the_measured_order_is_the_declared_one(
    forces: str, order: int, order_of: Callable[[Array, Array], float]
) -> None:
    system = gyroscopic(1.0, 0.02)
    start, times = start_of(system), np.array([0.0, 1.0])
    steps = 1.0 / np.array([4000, 8000, 16000])
    exact = RungeKutta(1e-12).march(system, *start, times).q[-1]
    methods = [Subcycling(step, 5, forces) for step in steps]
    errors = np.array([np.abs(method.march(system, *start, times).q[-1] - exact).max() for method in methods])
    assert methods[0].order(system) == order
    assert order_of(steps, errors) == pytest.approx(order, abs=0.25)


def test_forces_are_not_carried_on_over_a_breakpoint() -> None:
    """From the cycle that begins with a load's jump or after it, none of the forces before it is remembered."""

    class Jumping(LinearSystem):
        breakpoints = (0.018,)

    known = gyroscopic(1.0)
    system, method = Jumping(known.M, known.K, 1, known.C), Subcycling(1e-3, 5, "carried")
    ends = (method.march(system, *start_of(known), np.array([0.005 * n - 5e-4])).end for n in range(1, 7))
    assert [end.memory[2 * system.n] for end in ends] == [1.0, 2.0, 2.0, 2.0, 1.0, 2.0]


def test_a_cycle_is_no_longer_than_the_slow_coordinates_allow() -> None:
    """Two oscillators of 300 and 100 rad/s: ``2/ω`` bounds the cycle of the slow one, and the fast one's step."""
    system = LinearSystem(np.eye(2), np.diag([300.0**2, 100.0**2]), 1)
    assert Subcycling(1e-3, 2).largest_step(system) == pytest.approx(2.0 / 300.0 / 2, rel=1e-12)
    assert Subcycling(1e-3, 5).largest_step(system) == pytest.approx(2.0 / 300.0 / 5, rel=1e-12)


@pytest.mark.parametrize("forces", ["carried", "frozen"])
def test_a_state_goes_on_bit_for_bit_and_output_times_change_none(forces: str) -> None:
    system, method = gyroscopic(1.0), Subcycling(1e-3, 7, forces)
    start, end = start_of(system), np.array([0.0, 0.5])
    within = np.linspace(0.1, 0.5, 5) + 6e-4
    few = method.march(system, *start, within)
    many = method.march(system, *start, np.sort(np.r_[within, within - 3e-4]))  # two to a step
    part = method.march(system, *start, np.array([0.2]))
    rest = method.resume(system, part.end, end)
    for state in (many.end, rest.end):
        for name in ("q", "v", "a", "memory"):
            assert (getattr(state, name) == getattr(few.end, name)).all()
    for name in ("q", "v"):
        assert (getattr(many, name)[1::2] == getattr(few, name)).all()
    assert few.evaluations == -(-501 // 7) + 1
    assert few.fast_evaluations == 0


@pytest.mark.parametrize("forces", ["carried", "frozen"])
def test_one_step_to_a_cycle_is_central_difference(forces: str) -> None:
    system, times = gyroscopic(1.0), np.linspace(0.0, 0.5, 11)
    plain = CentralDifference(1e-3).march(system, *start_of(system), times)
    assert (Subcycling(1e-3, 1, forces).march(system, *start_of(system), times).q == plain.q).all()


def test_growth_by_frozen_gyroscopic_forces_is_seen_and_that_of_carried_ones_is_less() -> None:
    system = gyroscopic(2.0)
    at = OperatingPoint(0.0, np.zeros(6), np.zeros(6))
    rates = {
        forces: scheme_growth_rates(Subcycling(1e-3, 10, forces), system, [at], 0.1)[0, 0]
        for forces in ("carried", "frozen")
    }
    start, times = start_of(system), np.array([0.0, 4.0])
    march = Subcycling(1e-3, 10, "frozen").march(system, *start, np.array([0.0, 2.0, 4.0]))
    growth = np.log(np.abs(march.v[2]).max() / np.abs(march.v[1]).max()) / 2.0
    assert rates["frozen"] == pytest.approx(growth, rel=0.25)
    assert rates["carried"] < 0.2 * rates["frozen"]
    assert np.isfinite(Subcycling(1e-3, 10, "carried").march(system, *start, times).q).all()


def test_where_carried_forces_would_grow_the_map_with_its_history_says_so() -> None:
    system = gyroscopic(0.0, 3.0)  # strong dampers, which a parabola runs ahead of
    at = OperatingPoint(0.0, np.zeros(6), np.zeros(6))
    assert scheme_growth_rates(Subcycling(2e-3, 10, "carried"), system, [at], 0.2)[0, 0] > 5.0


def test_the_beam_follows_tangents_since_its_cycles_are_one_function() -> None:
    plans = Pipeline(load_scene("beam-paper", [])).plans
    methods = [plan.integrator for label, plan in plans.items() if label.startswith("sub-cycling")]
    assert {getattr(method, "forces", None) for method in methods} == {"tangents"}


@pytest.mark.parametrize(
    ("by_carried", "by_tangents", "error", "chosen"),
    [
        (1.0, 1.0, 1e-3, "carried"),
        (1.0017, 1.008, 1e-3, "carried"),  # more than is wanted, but less than by what would be taken else
        (1.008, 1.0017, 1e-3, "tangents"),
        (1.0, 1.008, 1e-10, "tangents"),  # which carried forces don't reach
    ],
)
def test_the_propeller_carries_its_forces_unless_vibrations_grow_or_the_error_does(
    by_carried: float, by_tangents: float, error: float, chosen: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def growth(_: object, plan: Any, *__: object) -> Growth:
        return Growth(None, {"carried": by_carried, "tangents": by_tangents}[plan.integrator.forces])

    pipeline = Pipeline(load_scene("propeller", [COARSE, f"simulation.error={error}"]))
    draft = next(plan for plan in pipeline.drafts if plan.integrator.name == "sub-cycling")
    run = next(run for run in pipeline.scene.simulation.run if run.integrator == "sub-cycling")
    monkeypatch.setattr(runs, "_measure_growth", growth)
    found = runs._choose_forces(pipeline, draft, run, [])
    assert (found.carried, found.factor) == ((True, by_carried) if chosen == "carried" else (False, by_tangents))
    assert (found.over_plain is None) == found.carried  # how long tangents take beside plain steps is measured


def test_sub_cycling_that_takes_longer_than_plain_steps_says_so() -> None:
    rows = [
        {"integrator": "sub-cycling", "substeps": 10, "growth": 1.0, "forces": "tangents", "part_over_plain": ratio}
        for ratio in (None, 0.3, 2.3)
    ]
    said = [line for line in _notes({"integrations": rows, "left_out_modes": {}}) if "times as long" in line]
    assert len(said) == 1
    assert said[0].startswith("note: sub-cycling 10:1 takes 2.3 times as long as central-difference here")
    assert "not accurate or not stable enough" in said[0]  # each is why tangents may be taken


def test_carried_forces_of_the_propeller_are_as_accurate_as_tangents() -> None:
    plan = list(Pipeline(load_scene("propeller", [COARSE])).plans.values())[1]
    system, (q0, v0), times = plan.excited_system or plan.system, plan.start, np.linspace(0.0, 0.01, 11)
    if plan.excited is not None:
        q0, v0 = q0[plan.excited.positions], v0[plan.excited.rates]
    exact = RungeKutta(1e-12).march(system, q0, v0, times).q
    errors = {
        forces: np.abs(Subcycling(1e-6, 10, forces).march(system, q0, v0, times).q - exact).max()
        for forces in ("tangents", "carried")
    }
    assert errors["carried"] < 1.2 * errors["tangents"]
