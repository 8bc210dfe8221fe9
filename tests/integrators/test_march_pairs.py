"""What two marches that differ tell of the error of the finer one."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.integrators.automatic import _GAINS
from fmd.integrators.march_pairs import Gain, Pairs, Parting
from fmd.integrators.protocol import State, Trajectory

TIMES = np.linspace(0.0, 1.0, 301)


def trajectory(step: float, q: Array, v: Array) -> Trajectory:
    end = State(0, q[-1], v[-1], v[-1])
    return Trajectory("central-difference", step, 1, TIMES, q, v, 0, 0, 0.0, end)


def vibration(step: float, frequencies: Array, amplitudes: Array) -> Trajectory:
    """March of central difference, whose frequencies are too high by (ω h)²/24, in closed form."""
    exact = np.where(step > 0, 2 / max(step, 1e-300) * np.arcsin(frequencies * step / 2), frequencies)
    angle = TIMES[:, None] * exact
    return trajectory(step, amplitudes * np.cos(angle), -amplitudes * exact * np.sin(angle))


@pytest.mark.parametrize("seed", range(12))
def test_steps_that_are_nearly_alike_tell_an_error_above_the_true_one(seed: int) -> None:
    """In step, out of step, and all between."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 12))
    frequencies = np.sort(10 ** rng.uniform(1.0, 4.0, n))
    amplitudes = 10 ** rng.uniform(-2.0, 0.0, n) / frequencies
    step = 1.8 / frequencies[-1] / rng.integers(1, 40)
    groups = np.zeros(n, dtype=np.int64)
    report, exact = Pairs(1e-3, groups, groups), Pairs(1e-3, groups, groups)
    gain = _GAINS["central-difference"]
    fine = vibration(step / 1.25, frequencies, amplitudes)
    report.agrees(vibration(step, frequencies, amplitudes), gain)
    report.agrees(fine, gain)
    exact.agrees(vibration(0.0, frequencies, amplitudes), gain)
    true = exact._apart(vibration(0.0, frequencies, amplitudes), fine)
    assert true < report.difference
    assert report.difference < 10 * true


def test_the_gain_follows_how_much_shorter_steps_have_become() -> None:
    q = np.zeros((301, 1))
    coarse, fine = trajectory(2.0, q, q), trajectory(1.0, q, q)
    assert Gain(3.0, 0.0, math.inf).of(coarse, fine) == pytest.approx(7.0)
    assert Gain(3.0, 0.0, 5.0).of(coarse, fine) == 5.0
    assert Gain(3.0, 0.1, 5.0).of(fine, coarse) == 0.1


@pytest.mark.parametrize(("is_rate", "place", "since"), [(False, 1, 0.5), (True, 2, 0.25), (True, 0, 0.0)])
def test_marches_that_part_say_which_coordinate_does_and_since_when(is_rate: bool, place: int, since: float) -> None:
    one, groups = np.ones((301, 3)), np.arange(3)
    other = one.copy()
    other[since < TIMES, place] += 0.1
    report, gain = Pairs(1e-2, groups, groups), Gain(0.0, 1.0, 1.0)
    assert not report.agrees(trajectory(1.0, one, one), gain)
    assert not report.agrees(trajectory(0.5, one, other) if is_rate else trajectory(0.5, other, one), gain)
    assert report.parting == Parting(is_rate, place, pytest.approx(since, abs=TIMES[1]))
    assert report.agrees(report.before, gain)
    assert report.parting is None


@pytest.mark.parametrize("ended", [Pairs.start_anew, lambda report: report.add_failure(AccuracyError("diverges"))])
def test_another_method_or_a_failure_leaves_nothing_of_the_marches_before(ended: Callable[[Pairs], None]) -> None:
    one, groups = np.ones((301, 1)), np.zeros(1, dtype=np.int64)
    report, gain = Pairs(1e-2, groups, groups), Gain(0.0, 1.0, 1.0)
    report.agrees(trajectory(1.0, one, one), gain)
    report.agrees(trajectory(0.5, 2 * one, one), gain)
    assert report.parting is not None
    ended(report)
    assert (report.before, report.parting, report.difference, report.apart) == (None, None, np.inf, np.inf)
