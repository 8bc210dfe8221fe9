"""Interruption of searches by whoever waits for them."""

import numpy as np
import pytest

from fmd.core import newton
from fmd.core.progress import check_for_interruption, interrupted_by


class EnoughError(Exception):
    pass


def test_a_search_ends_where_whoever_waits_for_it_says_so_and_only_within() -> None:
    calls = []

    def check() -> None:
        calls.append(0)
        if len(calls) == 3:
            raise EnoughError

    def root() -> newton.Solution[float]:
        """Halve what is left of the root of x in each correction."""
        small = newton.Tolerance(50, residual=1e-6)
        return newton.solve(1.0, lambda x: np.array([x]), lambda x, r: -0.5 * r, lambda x, d: x + float(d[0]), small)

    with interrupted_by(check):
        with interrupted_by(lambda: None):
            assert root().converged  # the innermost one counts
        with pytest.raises(EnoughError):
            root()
    assert len(calls) == 3
    check_for_interruption()
    assert root().converged
