"""The time limit of an error budget."""

import math
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from itertools import count
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy import comparison, truncation
from fmd.accuracy.comparison import Comparison
from fmd.accuracy.details import detail_quantities
from fmd.accuracy.error_budget import ERROR_BUDGET, allowed_seconds, state_errors
from fmd.accuracy.error_estimates import MORE_OF_MESH, MORE_OF_MODEL, Quantity
from fmd.accuracy.estimators import Estimates
from fmd.accuracy.time_limit import LeftOutError, TimeLimit
from fmd.accuracy.truncation import _work_of_vibrations, require_start
from fmd.core import clock
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError
from fmd.core.progress import interrupted_by
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.runge_kutta import RungeKutta
from fmd.recovery.motion import Motion
from fmd.scene.variants import enrich_bases
from fmd.stages.plan import Plan
from fmd.stages.runs import plan_like

BEAM = [
    "body.beam.mesh.divisions=[8, 1, 1]",
    "body.beam.modes.count=2",
    "simulation.duration=10 ms",
    'simulation.run=[{integrator="auto"}]',
]


def test_what_would_take_longer_than_is_left_is_refused() -> None:
    limit = TimeLimit(10.0)
    limit.require(5.0)
    with pytest.raises(LeftOutError, match="it would take longer than the time limit of 10 s"):
        limit.require(20.0)
    TimeLimit().require(1e9)


def test_a_march_that_will_not_end_in_time_is_stopped_by_its_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(clock, "read_clocks", lambda: (now[0], now[0]))
    limit = TimeLimit(10.0, started=(0.0, 0.0))
    advance = limit.watch()
    now[0] = 1.0
    advance(1e-5)  # it was compiled
    limit, now[0] = TimeLimit(10.0, started=(0.0, 0.0)), 0.0
    advance = limit.watch()
    advance(0.0)
    now[0] = 1.0
    advance(0.5)  # one more second
    now[0] = 2.0
    with pytest.raises(LeftOutError, match="it would take longer than the time limit of 10 s"):
        advance(0.05)


def test_seconds_in_which_others_use_the_machine_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """As little do those of several threads that work at once."""
    clocks = [0.0, 0.0]
    monkeypatch.setattr(clock, "read_clocks", lambda: tuple(clocks))
    limit = TimeLimit(10.0, started=(0.0, 0.0))
    for clocks[0], clocks[1] in ((60.0, 2.0), (2.0, 60.0)):
        limit.require(7.0)
    clocks[:] = 20.0, 11.0
    with pytest.raises(LeftOutError, match="time limit"):
        limit.require(0.0)


def test_a_march_is_forecast_by_its_steps_and_by_those_that_the_first_of_its_method_took() -> None:
    """One in a quarter of the steps was taken for as long as the first."""
    run = Pipeline(load_scene("beam-paper", [*BEAM, "simulation.run=[{integrator='central-difference'}]"]), Cache(None))
    motion = run.fine_motion
    run.results[Pipeline.fine_motion.name] = replace(motion, trajectory=replace(motion.trajectory, seconds=3.0))
    of = Comparison(run, TimeLimit(10.0))
    method: Any = of.plan.integrator
    of.march(run, replace(of.plan, integrator=replace(method, step=method.step / 2)))
    with pytest.raises(LeftOutError, match="time limit"):
        of.march(run, replace(of.plan, integrator=replace(method, step=method.step / 4)))


def test_a_budget_without_time_names_what_it_left_out_and_is_not_kept(tmp_path) -> None:
    run = Pipeline(load_scene("beam-paper", BEAM), Cache(tmp_path))
    short = state_errors(run, 1e-9)
    rows = {row.name: row for row in short.rows}
    assert isinstance(rows["beam, frequency 1"].parts["discretisation"], float)  # from recovered stress, at once
    assert "not estimated: it would take" in str(rows["beam, frequency 1"].parts[MORE_OF_MESH])  # by a coarser mesh
    assert "not estimated: it would take" in str(rows["tip, deflection"].parts["time"])
    assert "not estimated: it would take" in str(rows["tip, deflection"].parts[MORE_OF_MODEL])
    named = " ".join(short.left_out)
    for source in ("time", "discretisation", "truncation", "stiffening left off"):
        assert f"{source}: not estimated" in named
    again = Pipeline(load_scene("beam-paper", BEAM), Cache(tmp_path))
    whole = state_errors(again)
    assert whole.left_out == ()
    assert ERROR_BUDGET.name in again.log.run
    kept = Pipeline(load_scene("beam-paper", BEAM), Cache(tmp_path))
    assert state_errors(kept, 1e-9) == whole
    assert ERROR_BUDGET.name in kept.log.cached


@pytest.mark.parametrize("source", ["_otherwise_across", "_otherwise_coarse"])
def test_a_motion_whose_march_by_another_mesh_fails_has_no_stated_error(
    monkeypatch: pytest.MonkeyPatch, source: str
) -> None:
    """The shift of frequencies alone was stated: a third of the true error of a body beside one that hits a stop."""

    def fail(*_: object) -> None:
        raise AccuracyError("its steps are too long")

    estimates = Estimates(Pipeline(load_scene("beam-paper", BEAM), Cache(None)), TimeLimit())
    for name in ("_march_shift", "_otherwise_across", "_otherwise_coarse"):
        monkeypatch.setattr(estimates, name, fail if name == source else lambda *_: {})
    estimates.pair, estimates._across = estimates._coarse_pair(), estimates._pair_across()
    estimates._discretisation({})
    assert estimates._no_shapes == dict.fromkeys(estimates.of_motion, "not estimated: its steps are too long")


@pytest.mark.parametrize(
    ("run_seconds", "budget_seconds"),
    [(0.1, 20.0), (5.0, 20.0), (9.0, 27.0), (15.0, 25.0), (40.0, 20.0), (600.0, 180.0)],
)
def test_the_time_limit_is_three_times_that_of_the_run_and_less_for_long_ones(
    run_seconds: float, budget_seconds: float
) -> None:
    run = Pipeline(load_scene("beam-paper", BEAM), Cache(None))
    run.log.seconds["modes"] = run_seconds
    assert allowed_seconds(run) == pytest.approx(budget_seconds)


@pytest.mark.parametrize("method", ["central-difference", "runge-kutta"])
def test_a_richer_basis_whose_short_steps_will_not_end_in_time_is_marched_by_long_implicit_ones_at_once(
    monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    """Its steps are far shorter than the run's, and a march that the limit stops would have spent all time."""
    run = Pipeline(load_scene("beam-paper", [*BEAM, f"simulation.run=[{{integrator='{method}'}}]"]), Cache(None))
    motion = run.fine_motion
    run.results[Pipeline.fine_motion.name] = replace(motion, trajectory=replace(motion.trajectory, seconds=900.0))
    estimates, marched = Estimates(run, TimeLimit(1000.0)), []

    def march(other: Pipeline, plan: Plan) -> Motion:
        marched.append(plan.integrator.name)
        return Comparison.march(estimates, other, plan)

    monkeypatch.setattr(estimates, "march", march)
    assert all(isinstance(error, float) for error in estimates._truncation().values())
    assert {*marched} == {"generalized-alpha"}


@pytest.mark.parametrize(("exact", "of_step"), [(1e-4, 1.0), (0.0, 1.0), (1e-4, 0.0)])
def test_steps_that_do_not_follow_what_a_richer_basis_changes_are_halved(
    monkeypatch: pytest.MonkeyPatch, exact: float, of_step: float
) -> None:
    """A chain's momentum changed by 2e-4 in steps of 6 µs, 4e-7 in a quarter of them and 1e-7 with long ones.

    Here the difference is ``exact`` and a part that falls with the square of the step.
    """
    steps: list[float] = []

    def by_steps(of: Any, rich: Any, as_if: Any, method: GeneralizedAlpha) -> truncation.BasisComparison:
        steps.append(method.step)
        values = (np.array([1.0]), np.array([1.0 + exact + of_step * method.step**2]))
        ours, theirs = ({"momentum": Quantity("momentum", "kg m/s", value)} for value in values)
        return truncation.BasisComparison(ours, theirs)

    monkeypatch.setattr(truncation, "_by_steps", by_steps)
    explicit = SimpleNamespace(integrator=None)
    of: Any = SimpleNamespace(beside=(explicit, {}), implicit_method=GeneralizedAlpha(0.064), limit=TimeLimit())
    of.changes = lambda theirs, ours: Comparison.changes(of, theirs, ours)
    found = truncation._by_implicit_steps(of, [(of, {})])
    change = of.changes(found.enriched, found.ours)["momentum"]
    assert change == pytest.approx(exact, rel=0.2, abs=1e-5)
    assert steps == [0.064 / 2**k for k in range(len(steps))]
    assert (len(steps) == 2) == (of_step == 0.0)


def test_steps_of_variants_hardly_damp_stiff_shapes_which_takes_momentum() -> None:
    """A free bar spins up its shapes of up to 180 kHz: with a radius of 0.8 steps of 10 µs lost 1.8e-8."""
    bar = {"shape": "bar", "length": 0.25, "depth": 0.012, "width": 0.023, "E": 210e9, "nu": 0.3, "rho": 7850.0}
    bar["mesh"] = {"element": "hexahedron", "order": 2, "divisions": [8, 1, 1]}
    bar |= {"modes": {"count": 5}, "marker": {"root": {"face": "x-"}}}
    free = {"type": "free", "parent": "ground", "child": "bar.root", "spin": [0.0, 20.0, 200.0]}
    simulation = {"duration": 2e-4, "output_step": 1e-5, "tip": "bar.root", "run": [{"integrator": "auto"}]}
    run = Pipeline(load_scene({"title": "", "body": {"bar": bar}, "joint": {"float": free}, "simulation": simulation}))
    plan = next(iter(run.plans.values()))
    plan = replace(plan, integrator=replace(Comparison(run, TimeLimit()).implicit_method, step=1e-5))
    momentum = detail_quantities(run.scene, run.motion_by(plan, plan.march(run.output_times)))["angular_momentum"]
    assert np.abs(momentum.values - momentum.values[0]).max() < 4e-9 * momentum.scale


@pytest.mark.parametrize("rings", [False, True])
def test_a_run_that_rings_is_not_compared_by_steps_that_damp_what_rings(
    monkeypatch: pytest.MonkeyPatch, rings: bool
) -> None:
    """They would miss how errors of frequencies add up: of 6 s of it stress was stated to 1.5 % for 13 %.

    What is damped of a quantity counts, and where that is much nothing is stated.
    """
    monkeypatch.setattr(comparison.limits, "MARCH_OF_LIMIT", 0.0)
    monkeypatch.setattr(comparison.limits, "WORTH_OTHER_METHOD", np.inf)
    monkeypatch.setattr(comparison.limits, "MOST_OF_METHOD", 0.06)  # the hub's force has 0.1, what is stated up to 0.02
    run = [f"drive.spin_up.smooth={str(not rings).lower()}", "simulation.duration=0.3 s"]
    run += ["simulation.run=[{integrator='central-difference'}]"] + ["drive.spin_up.duration=4 ms"] * rings
    estimates = Estimates(Pipeline(load_scene("beam", [*BEAM[:2], *run]), Cache(None)), TimeLimit(1000.0))
    found = estimates.by_source()["discretisation"]
    fast = {"hub, rate", "hub.rate", "hub.force", "beam.tip.acceleration"} if rings else set()
    assert {name for name, error in found.items() if isinstance(error, str)} == fast
    assert {*estimates.of_motion} - {*estimates.beside[1]} == fast
    assert all(found[name] >= 0.5 * part for name, part in estimates.damped.items() if name not in fast)
    assert (estimates.damped["tip, deflection"] > 0.01) == rings
    assert any("4 quantities that vibrate fast" in each for each in estimates.left_out) == rings


def test_the_work_of_a_richer_basis_whose_vibrations_are_followed_is_forecast() -> None:
    march = "simulation.run=[{integrator='runge-kutta', tolerance=1e-7}]"
    estimates = Estimates(Pipeline(load_scene("beam-paper", [*BEAM, march]), Cache(None)))
    rich = estimates.run.variant(enrich_bases(estimates.run.scene))
    theirs, own = (
        each.trajectory.evaluations
        for each in (estimates.march(rich, plan_like(estimates.plan, rich)), estimates.run.fine_motion)
    )
    size = rich.system.n / estimates.plan.system.n
    assert 0.3 < _work_of_vibrations(estimates, rich) / (theirs / own * size**2) < 3.0


@pytest.mark.parametrize(("seconds", "known"), [(20.0, False), (20.0, True), (2000.0, False)])
def test_a_search_for_a_richer_periodic_start_that_would_take_too_long_is_left_out(seconds: float, known: bool) -> None:
    """13 marches of 30 ms each, 66 times as long with 27 coordinates up to 250 kHz in place of 8 up to 3.6 kHz."""
    trajectory = SimpleNamespace(seconds=0.03, evaluations=51_442)
    run = SimpleNamespace(
        scene=SimpleNamespace(repeats=True),
        periodic=SimpleNamespace(marches=13, period=0.08),
        output_times=[0.0, 0.08],
        fine_motion=SimpleNamespace(trajectory=trajectory),
    )
    plan = SimpleNamespace(integrator=RungeKutta(1e-9), system=SimpleNamespace(n=8))
    of: Any = SimpleNamespace(run=run, plan=plan, limit=TimeLimit(seconds))
    system = SimpleNamespace(n=27, highest_frequency=1.56e6)
    rich: Any = SimpleNamespace(system=system, results={"periodic motion": ...} if known else {})
    with pytest.raises(LeftOutError) if seconds < 100.0 and not known else nullcontext():
        require_start(of, rich)


CRANK = [
    "body.rod.mesh.divisions=[12,1,1]",
    "body.rod.modes.count=2",
    "body.rod.modes.enrich=none",
    "body.rod.modes.damping=0.05",
    'simulation.start="periodic"',
    f'simulation.period="{2 * np.pi / 150!r} s"',
    f'simulation.duration="{2 * np.pi / 150!r} s"',
    'simulation.run=[{integrator="runge-kutta"}]',
]


@pytest.mark.long
def test_a_richer_basis_begins_where_implicit_steps_repeat_if_others_take_too_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both ways say how far more modes move the orbit."""
    run = Pipeline(load_scene("slider-crank", CRANK), Cache(None))
    estimates = Estimates(run, TimeLimit())
    exact = estimates._truncation()
    monkeypatch.setattr(truncation, "_by_one_method", lambda of, rich, as_if: None)
    found = estimates._truncation()
    for name in ("tip, deflection", "tip, largest deflection", "rod, largest von Mises stress"):
        assert found[name] == pytest.approx(exact[name], rel=0.1), name


def test_the_time_limit_ends_a_search_for_a_periodic_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each look at the clock takes a second; the search, of a dozen marches, has three."""
    run = Pipeline(load_scene("slider-crank", CRANK), Cache(None))
    ticks = count()
    monkeypatch.setattr(clock, "read_clocks", lambda: (float(next(ticks)), math.inf))
    limit = TimeLimit(3.0, started=(0.0, 0.0))
    with interrupted_by(partial(limit.require, 0.0)), pytest.raises(LeftOutError):
        _ = run.periodic
    assert next(ticks) < 20  # stages and marches look at it, too
