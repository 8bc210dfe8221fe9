"""Compiled accelerations against the kernels of the mechanism, mass points, and the interpreter of the graph."""

import numpy as np
import pytest

from pipeline.core.arrays import Array
from pipeline.dynamics.compiler.compiled import compile_mechanism
from pipeline.dynamics.mechanism import Mechanism
from pipeline.dynamics.tree.solve import solve_accelerations
from tests.dynamics.compiler import kane
from tests.dynamics.compiler.comparison import TIME, difference, interpreted
from tests.dynamics.compiler.mechanisms import random_mechanism

BATCHES = [*range(2), *(pytest.param(k, marks=pytest.mark.slow) for k in range(2, 20))]


def by_kernels(mechanism: Mechanism, q: Array, v: Array) -> Array:
    a = np.zeros(mechanism.n)
    solve_accelerations(mechanism.parameters, TIME, q, v, a)
    return a


@pytest.mark.parametrize("batch", BATCHES)
def test_random_mechanisms_accelerate_as_by_the_kernels(batch: int) -> None:
    for seed in range(10 * batch, 10 * batch + 10):
        made = random_mechanism(seed)
        q, v = made.state(seed)
        a = interpreted(compile_mechanism(made.mechanism), "accelerations", (made.mechanism.n,), q=q, v=v)
        assert difference(a, by_kernels(made.mechanism, q, v)) < 1e-12, seed


@pytest.mark.parametrize("seed", [*range(6), *(pytest.param(k, marks=pytest.mark.slow) for k in range(6, 40))])
def test_machine_code_does_what_the_interpreter_does(seed: int) -> None:
    made = random_mechanism(seed)
    q, v = made.state(seed)
    compiled = compile_mechanism(made.mechanism)
    a = compiled.accelerations(TIME, q, v)
    assert difference(a, interpreted(compiled, "accelerations", (made.mechanism.n,), q=q, v=v)) < 1e-13


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(k, marks=pytest.mark.slow) for k in range(4, 60))])
def test_mass_points_accelerate_alike_by_dalemberts_principle(seed: int) -> None:
    # Differences of order 8 over steps of 0.01 s leave 1e-10 or so of the bias.
    made = random_mechanism(seed, second_order=False)
    q, v = made.state(seed)
    a = interpreted(compile_mechanism(made.mechanism), "accelerations", (made.mechanism.n,), q=q, v=v)
    assert difference(a, kane.accelerations(made, TIME, q, v)) < 1e-8
