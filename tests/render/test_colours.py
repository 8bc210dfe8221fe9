"""Colour scales: their limits and their maps."""

import numpy as np
import pytest

from pipeline.render.colours import limits_in_megapascals, sample_colours, stress_limits


def test_limits_are_those_of_the_stress_and_hold_zero_unless_all_is_negative() -> None:
    assert stress_limits(np.array([2.0, 5.0])) == (0.0, 5.0)
    assert stress_limits(np.array([-2.0, 5.0])) == (-2.0, 5.0)
    assert stress_limits(np.array([-5.0, -2.0])) == (-5.0, -2.0)
    for constant in (0.0, -3.0):
        low, high = stress_limits(np.full(3, constant))
        assert low == constant < high


def test_limits_are_converted_and_have_to_ascend() -> None:
    assert limits_in_megapascals((-1e6, 2e6)) == pytest.approx((-1.0, 2.0))
    with pytest.raises(ValueError, match="the highest colour needs a larger stress"):
        limits_in_megapascals((1.0, 1.0))


def test_colours_run_from_one_end_of_the_map_to_the_other() -> None:
    assert sample_colours("gray", 3).tolist() == [[0, 0, 0], [128, 128, 128], [255, 255, 255]]
