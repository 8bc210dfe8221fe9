"""The search for the longest safe step, on growth in closed form."""

import numpy as np
import pytest

from fmd.core.limits.stability import ALLOWED_GROWTH
from fmd.stability.limits import longest_safe_step


@pytest.mark.parametrize("power", [1, 3])
def test_the_longest_safe_step_is_where_vibrations_grow_tenfold(power: int) -> None:
    exact = 0.37 * np.log(ALLOWED_GROWTH) ** (1 / power)
    assert exact * (1 - 1 / 128) <= longest_safe_step(lambda h: (h / 0.37) ** power, 2.0) <= exact
    assert longest_safe_step(lambda h: (h / 0.37) ** power, 2.0, bisections=30) == pytest.approx(exact, rel=1e-8)


def test_without_growth_the_upper_step_is_safe_and_with_too_much_none() -> None:
    assert longest_safe_step(lambda h: 0.0, 2.0) == 2.0
    assert longest_safe_step(lambda h: 3.0, 2.0) == 0.0


def test_a_window_of_steps_that_happen_to_be_stable_again_does_not_count() -> None:
    assert longest_safe_step(lambda h: 3.0 * (0.1 < h < 1.5), 2.0) <= 0.1


@pytest.mark.parametrize(("summit", "limit"), [(1.5, 0.3), (2.29, 0.3), (2.5, 0.2711), (1.0, 1.0)])
def test_steps_beyond_a_summit_of_growth_are_not_trusted(summit: float, limit: float) -> None:
    def folds(step: float) -> float:
        return float(summit * np.exp(-(((step - 0.3) / 0.1) ** 2)) + 5.0 * (step > 1.0))

    assert longest_safe_step(folds, 2.0) == pytest.approx(limit, rel=0.05)
