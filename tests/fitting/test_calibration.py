"""Intervals of fits hold the truth as often as they say: 200 noises on a vibration whose closed form is the model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.fitting.fit import fit_scene
from fmd.fitting.measurements import MeasuredChannel, estimate_noise
from fmd.fitting.parameters import Parameter
from fmd.fitting.varied import VariedNumber

TRUTH = {"stiffness": 39.0, "damping": 0.42, "start": 0.011}
BEGIN = {"stiffness": 41.0, "damping": 0.35, "start": 0.01}
TIMES, NOISE, SEEDS = np.linspace(0.0, 4.0, 161), 1e-3, 200


def vibration(stiffness: complex, damping: complex, start: complex) -> Array:
    """Return a damped vibration of unit mass from rest, for complex steps too."""
    decay, omega = 0.5 * damping, np.sqrt(stiffness - 0.25 * damping**2)
    return start * np.exp(-decay * TIMES) * (np.cos(omega * TIMES) + decay / omega * np.sin(omega * TIMES))


@dataclass
class Vibration:
    """A measured vibration."""

    channels: tuple[MeasuredChannel, ...]
    solved: int = 0
    axis = ("time [s]", TIMES)
    in_time = True
    has_modes = has_responses = False

    def require_times(self, shifts: Sequence[VariedNumber]) -> None:
        assert not shifts

    def predict(self, values: Mapping[Parameter, float]) -> list[Array]:
        return [vibration(*values.values()).real]

    def slopes(self, values: Mapping[Parameter, float], parameter: Parameter) -> list[Array]:
        return [vibration(*(x + 1e-30j * (each == parameter) for each, x in values.items())).imag / 1e-30]

    def likeness(self, values: Mapping[Parameter, float]) -> None:
        return None


@pytest.mark.parametrize("given", [pytest.param(True, marks=pytest.mark.long), False])
def test_intervals_hold_the_truth_in_95_of_100_noises(given: bool) -> None:
    varied = tuple(VariedNumber(Parameter(key, value)) for key, value in BEGIN.items())
    truth, inside, chi2 = vibration(*TRUTH.values()).real, np.zeros(len(TRUTH)), []
    for seed in range(SEEDS):
        values = truth + NOISE * np.random.default_rng(seed).standard_normal(TIMES.size)
        sigma = NOISE if given else estimate_noise(TIMES, values)
        fit = fit_scene((Vibration((MeasuredChannel("x", "m", values, sigma, given),)),), varied)
        ends = zip(fit.intervals, TRUTH.values(), strict=True)
        inside += [low <= true <= high for (low, high), true in ends]
        chi2.append(fit.chi2 / fit.n_free)
    # Of 200 with a probability of 0.95 there are 190 ± 3.1 inside: none of three is off by three times that.
    assert 0.93 <= inside.mean() / SEEDS <= 0.97
    np.testing.assert_allclose(inside / SEEDS, 0.95, rtol=0, atol=0.046)
    assert np.mean(chi2) == pytest.approx(1.0, abs=0.05)
