"""Colour scales: their limits and their maps."""

from typing import get_args

import numpy as np
import pytest

from fmd.render.colours import (
    FILM_RANGES,
    film_limits,
    limits_in_megapascals,
    sample_colours,
    stress_limits,
    usual_limits,
)
from fmd.scene.pictures import Film


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


def test_a_films_colours_reach_to_the_99th_percentile_of_its_stress() -> None:
    stress = np.append(np.linspace(0.0, 10.0, 10_001), 500.0)  # one instant's peak
    assert usual_limits(stress) == (0.0, pytest.approx(9.9, rel=1e-3))
    assert usual_limits(-stress) == pytest.approx((-9.9, -0.1), rel=1e-2)
    brief = np.append(np.zeros(10_000), 7.0)
    assert usual_limits(brief) == stress_limits(brief)


def test_a_films_colours_span_all_frames_or_each_of_them() -> None:
    stress = np.array([[0.0, 1.0, 2.0], [-1.0, 4.0, 8.0]])
    assert film_limits(stress, "largest").tolist() == [[-1.0, 8.0], [-1.0, 8.0]]
    assert film_limits(stress, "frame").tolist() == [[0.0, 2.0], [-1.0, 8.0]]
    assert film_limits(stress, "usual")[0].tolist() == pytest.approx(usual_limits(stress))
    assert set(FILM_RANGES) == set(get_args(Film.model_fields["span"].annotation))


def test_the_usual_map_has_no_dark_lower_end_and_ends_as_turbo_does() -> None:
    colours = sample_colours("light turbo", 256).astype(float)
    luminance = colours @ (0.2126, 0.7152, 0.0722)
    assert luminance[:200].min() > 110
    assert np.abs(colours[100:] - sample_colours("turbo", 256)[100:]).max() <= 1
    assert np.abs(np.diff(colours, axis=0)).max() < 12  # no jump where the two meet
