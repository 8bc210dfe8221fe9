"""Warnings of runs whose slow and fast coordinates share their inertia."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.output.mechanism_figures import coupling_warnings
from tests.linear_system import LinearSystem


def run_with(beta: float, method: Any) -> Any:
    M = np.array([[1.0, beta], [beta, 1.0]])
    system = LinearSystem(M, np.diag([1.0, 100.0]), n_slow=1)
    return cast(Any, SimpleNamespace(plans={"the run": SimpleNamespace(integrator=method, system=system)}))


@pytest.mark.parametrize(("beta", "warned"), [(0.0, False), (0.98, False), (0.995, True)])
def test_a_sub_cycled_run_is_warned_of_where_slow_and_fast_share_their_inertia(beta: float, warned: bool) -> None:
    found = coupling_warnings(run_with(beta, ReversibleSubcycling(1e-3, 5)))
    assert [warning["code"] for warning in found] == ["inertial-coupling"] * warned
    if warned:
        assert "the run: " in found[0]["text"]
        assert "β = 0.995, 1 - β² = 0.01" in found[0]["text"]


def test_a_run_without_sub_cycling_is_not_warned_of() -> None:
    assert coupling_warnings(run_with(0.999, CentralDifference(1e-3))) == []
    assert coupling_warnings(run_with(0.999, ReversibleSubcycling(1e-3, 1))) == []
