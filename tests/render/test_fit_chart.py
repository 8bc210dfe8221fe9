"""Lines of fits' charts."""

import numpy as np

from fmd.render.fit_chart import break_at_gaps


def test_no_line_goes_through_a_gap_of_the_measured_times() -> None:
    times = np.array([0.0, 0.1, 0.2, 2.0, 2.1, 2.2])
    places, values = break_at_gaps(times, 2.0 * times)
    np.testing.assert_array_equal(np.isnan(values), [False] * 3 + [True] + [False] * 3)
    np.testing.assert_array_equal(places[np.isfinite(values)], times)
    assert break_at_gaps(times[:1], times[:1])[0].size == 1
