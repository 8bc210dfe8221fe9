"""Peaks that fixed steps miss: against closed forms of their impulses, and the sums that steps make of them."""

import math

import numpy as np
import pytest

from fmd.core.formula import parse_formula
from fmd.dynamics.signals.resolution import shortest_missed
from fmd.dynamics.signals.signal import Signal, constant, formula, linear_table, smooth_table

PULSES = (  # on a load that never rests, with their impulses and the time for which they act
    ("10*cos(3*t) + 100*exp(-((t - 0.31234)/0.0003)**2)", 100 * math.sqrt(math.pi) * 3e-4, 9e-4),
    ("10*cos(3*t) + (0 if t < 0.7 else 90*sin(pi*(t - 0.7)/0.002) if t < 0.702 else 0)", 90 * 2 / math.pi * 2e-3, 2e-3),
    ("10*cos(3*t) + (0 if t < 0.7 else 40 if t < 0.701 else 0)", 0.04, 1e-3),
    ("1e5 - 100*max(0, 1 - abs(t - 0.4)/0.001)", 0.1, 2e-3),
    ("10*cos(3*t) + 50*exp(-t/1e-4)", 5e-3, 4.6e-4),
    ("100*cos(30*t - 12) + 40*exp(-((t - 0.4)/2e-5)**2)", 40 * math.sqrt(math.pi) * 2e-5, 6e-5),
    ("0.001*sin(60000*t) + exp(-((t - 0.7)/1e-5)**2)", math.sqrt(math.pi) * 1e-5, 3e-5),
)


def signal_of(text: str) -> Signal:
    return formula(parse_formula(text))


@pytest.mark.parametrize(("text", "impulse", "lasts"), PULSES)
def test_a_step_that_is_accepted_carries_a_pulse_s_impulse(text: str, impulse: float, lasts: float) -> None:
    """By the rule of the trapezium over steps, beside that over steps of a microsecond."""
    signal, fine = signal_of(text), np.linspace(0.0, 1.0, 1_000_001)
    exact = np.trapezoid(signal.values(fine)[:, 0], fine)
    for step in lasts * np.geomspace(0.05, 10.0, 16):
        missed = shortest_missed(signal, 1.0, float(step))
        if missed == math.inf:
            times = np.append(np.arange(0.0, 1.0, step), 1.0)
            assert abs(np.trapezoid(signal.values(times)[:, 0], times) - exact) < 0.4 * impulse
        else:
            assert missed == pytest.approx(lasts, rel=0.1)
        assert (missed == math.inf) == (step < 0.2 * lasts) or 0.2 < step / lasts < 1.2


def test_loads_that_vary_slowly_or_jump_take_any_step() -> None:
    for text in (
        "5",
        "t",
        "exp(-3*t)",
        "sin(3*t + 1)",
        "cos(3*t + 3)",
        "100 if t < 1/3 else 0",
        "tanh((t - 0.5)/1e-5)",
    ):
        for step in (0.1, 0.01, 1e-3):
            assert shortest_missed(signal_of(text), 1.0, step) == math.inf
    assert shortest_missed(constant(5.0), 1.0, 1.0) == math.inf


@pytest.mark.parametrize("rate", [6283.185307179586, pytest.param(1e5, marks=pytest.mark.long)])
def test_a_vibration_takes_five_steps_in_a_period(rate: float) -> None:
    """Also where steps of whole periods see the same value again and again."""
    signal, period = signal_of(f"5 + sin({rate!r}*t)"), 2 * math.pi / rate
    for step in (period, 100.3 * period):
        assert shortest_missed(signal, 1.0, step) < period
    assert shortest_missed(signal, 1.0, period / 5) == math.inf


def test_a_table_of_noise_takes_steps_between_its_knots() -> None:
    rng = np.random.default_rng(0)
    noise = linear_table(np.linspace(0.0, 1.0, 1001), rng.normal(size=1001))
    for step, carried in ((5e-3, False), (1e-3, True), (7e-4, False), (5e-4, True), (1e-4, True)):
        assert (shortest_missed(noise, 1.0, step) == math.inf) == carried


def test_a_motion_is_judged_by_its_acceleration() -> None:
    times = np.linspace(0.0, 1.0, 1001)
    motion = smooth_table(times, times**2 + 1e-4 * np.exp(-(((times - 0.6) / 0.01) ** 2)))
    assert shortest_missed(motion, 1.0, 0.05) == math.inf
    assert shortest_missed(motion, 1.0, 0.05, derivative=2) < 0.03
    assert shortest_missed(motion, 1.0, 0.001, derivative=2) == math.inf


def test_nothing_is_said_of_a_signal_without_values() -> None:
    assert shortest_missed(signal_of("log(0 - 1 - t)"), 1.0, 0.01) == math.inf
