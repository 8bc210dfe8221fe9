"""Tangents and adjoints of random scenes of `benchmarks/truth_scenes.py` against extrapolated differences."""

import importlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmd as package
from fmd.fitting.frozen_run import FrozenRun
from fmd.fitting.parameters import Parameter, find_parameter
from fmd.integrators.runge_kutta import RungeKutta
from tests.fitting.test_adjoint import differ
from tests.fitting.test_tangents import differences

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
RUNS = (
    "{integrator='central-difference',step='0.5 ms'}",
    "{integrator='runge-kutta',tolerance=1e-12}",
    "{integrator='generalized-alpha',step='1 ms'}",
)
LONG = (pytest.param(seed, marks=pytest.mark.long) for seed in (3, 12, 18, 64, 79))
SEEDS = (17, 26, 41, 57, 73, *LONG)


def read_random(seed: int, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("truth_scenes").random_case(seed).table


@pytest.mark.parametrize("seed", SEEDS)
def test_derivatives_of_a_random_rigid_scene_are_differences_of_its_marches(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a load and a mass, to 1e-8 of the largest derivative: what differences over three distances show."""
    table = read_random(seed, monkeypatch)
    short = ("simulation.duration=0.1 s", "simulation.output_step=5 ms", f"simulation.run=[{RUNS[seed % 3]}]")
    frozen = FrozenRun(package.load(table, *short).run)
    loads = [f"drive.{name}.{key}" for name, own in table["drive"].items() for key in ("force", "torque") if key in own]
    keys = [*loads[:1], next(f"body.{name}.mass" for name in table["body"])]
    parameters = [find_parameter(frozen.run.scene, key) for key in keys]
    motion = frozen.at({}, by=parameters)
    assert all(frozen.beside(motion, each).by_tangents for each in parameters)
    tangents: dict[Parameter, Any] = {each: motion.tangents[each] for each in parameters}
    references = [differences(frozen, each) for each in parameters]
    for kind, name in enumerate(("q", "v")):
        largest = max(np.abs(getattr(each, name)).max() for each in tangents.values())
        for tangent, reference in zip(tangents.values(), references, strict=True):
            np.testing.assert_allclose(getattr(tangent, name), reference[kind], rtol=0, atol=1e-8 * largest)
    found, expected = differ(frozen, keys)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize(("phase", "round_off"), [(1.0, 1e-15), (200.0, 1e-14), (5000.0, 1e-11), (5000.0, 1e-9)])
def test_the_noise_of_extrapolated_differences_is_no_less_than_their_error(
    phase: float, round_off: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of an oscillation by the logarithm of its frequency, out of phase over the first distances, with round-off."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    module, t, rng = importlib.import_module("random_derivatives"), np.linspace(0.0, 1.0, 41), np.random.default_rng(0)

    def value(share: float) -> Any:
        return np.sin(phase * (1.0 + share) * t * (1.0 + round_off * rng.normal()))

    shares = module.SHARE * 0.5 ** np.arange(module.HALVINGS + 1)
    found, noise = module.choose_extrapolation([(value(s) - value(-s)) / (2.0 * s) for s in shares])
    assert np.abs(found - phase * t * np.cos(phase * t)).max() < 2.0 * noise < 0.02 * phase


def test_derivatives_of_a_run_by_auto_are_those_of_the_motion_though_steps_stay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By the tolerance of the run itself they were far off, see `fmd.core.limits.stepping`."""
    run, found = package.load(read_random(3, monkeypatch)).run, []
    for tolerance in (None, 1e-12):
        frozen = FrozenRun(run)
        if tolerance is not None:
            frozen.plan = replace(frozen.plan, integrator=RungeKutta(tolerance))
        parameter = find_parameter(run.scene, "drive.push2.force")
        frozen.beside(motion := frozen.at({}, by=[parameter]), parameter)
        found.append(motion.tangents[parameter].q)
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-5 * np.abs(found[1]).max())


def test_the_last_extrapolation_is_not_chosen_though_it_agrees_with_the_one_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Differences of a result of 1 whose round-off grows, but for the last two extrapolations, both 8e-8 off."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    module = importlib.import_module("random_derivatives")
    wanted = [1.0 + off for off in (1e-9, -1e-9, 2e-9, -4e-9, 8e-9, -3e-8, 8.01e-8, 8e-8)]
    differences = [np.ones(1), np.ones(1)]
    for value in wanted:  # (64 c − 20 b + a) / 45
        differences.append((45.0 * value + 20.0 * differences[-1] - differences[-2]) / 64.0)
    found, noise = module.choose_extrapolation(differences)
    assert abs(found[0] - 1.0) <= noise < 1e-8
