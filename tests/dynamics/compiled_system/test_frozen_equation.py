"""Sub-cycling of compiled systems against one in NumPy that holds the residual's slopes by differences."""

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system import system
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.subcycling import Subcycling
from tests.dynamics.compiled_system.frozen_by_differences import sub_cycle
from tests.dynamics.compiler.mechanisms import EACH, PointMechanism, random_mechanism


def small_state(made: PointMechanism, seed: int) -> tuple[Array, Array]:
    q, v = made.state(seed)
    return q, 0.5 * v


@EACH
def test_sub_cycling_holds_the_slopes_of_the_residual(seed: int) -> None:
    made, h, m = random_mechanism(seed), 0.004, 5
    start = small_state(made, seed)
    want = sub_cycle(made, h, m, 8, *start)
    march = Subcycling(h, m).march(CompiledSystem(made.mechanism), *start, m * h * np.arange(8))
    assert march.q == pytest.approx(want, abs=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_a_fast_step_without_loops_is_that_with_loops(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    made, h, m = random_mechanism(seed), 0.004, 5
    start, times = small_state(made, seed), m * h * np.arange(20)
    unrolled = Subcycling(h, m).march(CompiledSystem(made.mechanism), *start, times)
    monkeypatch.setattr(system, "MOST_UNROLLED", 0)
    looped = Subcycling(h, m).march(CompiledSystem(made.mechanism), *start, times)
    assert unrolled.q == pytest.approx(looped.q, abs=1e-11)
