"""Bounds of signals over intervals, and the times at which they act: against values at many times."""

import math

import numpy as np
import pytest

from fmd.core.formula import parse_formula
from fmd.dynamics.signals.activity import find_activity
from fmd.dynamics.signals.bounds import PieceBounds
from fmd.dynamics.signals.signal import constant, formula, half_sine, linear_table, smooth_table

FORMULAS = (
    "500*exp(-((t-0.15)/0.0003)**2)",
    "126*t**5 - 420*t**6 + 540*t**7",
    "sin(20*t)/(1 + t) - cos(3*t)*tan(t/3)",
    "tanh((t - 1)/0.1) + log(1 + t) - sqrt(t + 0.1)",
    "max(0, 1 - abs(t - 0.7)/0.1) + min(t, 2*sin(t)) + 2**t + t**-2",
    "t**2 if t < 0.3 else 5 - t if t <= 1.2 else (t + 1)**1.5",
)


@pytest.mark.parametrize("text", FORMULAS)
def test_bounds_freeze_values_and_derivatives_within(text: str) -> None:
    rng = np.random.default_rng(1)
    begin = rng.uniform(0.01, 2.0, 200)
    end = begin + 10.0 ** rng.uniform(-6.0, -0.5, 200)
    expression = parse_formula(text)
    signal = formula(expression)
    with np.errstate(all="ignore"):
        series = PieceBounds(begin, end, 3).run_program(expression.codes, expression.constants)
    for part in np.linspace(0.0, 1.0, 9):
        values = signal.values(begin + part * (end - begin))
        for k, bounds in enumerate(series):
            found, room = values[:, k] / math.factorial(k), 1e-9 * (1.0 + np.abs(values[:, k]))
            assert (found >= bounds[0] - room).all()
            assert (found <= bounds[1] + room).all()


@pytest.mark.slow
def test_random_pulses_are_found_where_they_are_and_stepped_onto() -> None:
    """Gaussian blows of any place, width and height, alone or on a slow load: 16 times in each, 6 widths about it."""
    rng = np.random.default_rng(2)
    for _ in range(16):
        at, width, height = rng.uniform(0.1, 0.9), 10.0 ** rng.uniform(-7, -3), 10.0 ** rng.uniform(-3, 6)
        slow = rng.choice(["0", f"{height}*sin(t)"])
        text = f"{slow} + {height}*exp(-((t - {at})/{width})**2)"
        events = np.array(find_activity(formula(parse_formula(text)), 1.0).events)
        near = events[np.abs(events - at) < 6 * width]
        assert len(near) >= 8
        assert np.diff(near).max() < 4 * width
        assert len(events) < 100


def test_loads_that_vary_evenly_have_no_events() -> None:
    for text in ("5", "t", "sin(300*t)", "1 - cos(300*t)", "exp(-3*t)*cos(40*t)", "t**3 - t", "sqrt(t)"):
        assert find_activity(formula(parse_formula(text)), 10.0).events == ()
    assert find_activity(constant(1.0), 1.0).shortest_action == math.inf


def test_a_motion_is_judged_by_its_acceleration() -> None:
    """A wiggle of 1e-10 of the whole motion, whose acceleration is all that there is."""
    signal = formula(parse_formula("t + 1e-10*exp(-((t - 0.5)/0.0003)**2)"))
    assert find_activity(signal, 1.0).shortest_action == math.inf
    assert len(find_activity(signal, 1.0, derivative=2).events) > 8


def test_the_time_for_which_a_load_acts_is_known() -> None:
    assert find_activity(half_sine(0.2, 0.001, 5.0), 1.0).shortest_action == pytest.approx(0.001)
    blow = linear_table(np.array([0.0, 0.4, 0.401, 0.402, 1.0]), np.array([0.0, 0.0, 3.0, 0.0, 0.0]))
    assert find_activity(blow, 1.0).shortest_action == pytest.approx(0.002)
    times = np.linspace(0.0, 1.0, 1001)
    smooth = smooth_table(times, np.exp(-(((times - 0.3) / 0.003) ** 2)))
    assert 0.005 < find_activity(smooth, 1.0).shortest_action < 0.05
    assert find_activity(formula(parse_formula("sin(100*t)")), 1.0).shortest_action == math.inf


def test_fast_vibrations_all_along_do_not_hide_a_pulse() -> None:
    text = "0.001*sin(60000*t) + exp(-((t - 7)/1e-6)**2)"
    activity = find_activity(formula(parse_formula(text)), 10.0)
    assert activity.unresolved.any()
    assert sum(abs(t - 7.0) < 3e-6 for t in activity.events) >= 8


def test_kinks_are_stepped_onto() -> None:
    events = find_activity(formula(parse_formula("max(0, 1 - abs(t - 0.5)/0.0002) + abs(t - 0.25)")), 1.0).events
    for kink in (0.25, 0.4998, 0.5, 0.5002):
        assert np.abs(np.array(events) - kink).min() < 2e-12
    kinks = np.array(find_activity(formula(parse_formula("abs(sin(50*t))")), 1.0).events)
    assert kinks == pytest.approx(np.arange(1, 16) * np.pi / 50, abs=1e-11)
