"""Compiled accelerations against mass points, Lagrange's equations, and the interpreter of the graph."""

import numpy as np
import pytest

from fmd.dynamics.compiler.compiled import compile_mechanism
from tests.dynamics.compiler import kane, lagrange
from tests.dynamics.compiler.comparison import TIME, difference, interpreted
from tests.dynamics.compiler.mechanisms import EACH, random_mechanism


@pytest.mark.parametrize("second_order", [False, True])
@EACH
def test_mass_points_accelerate_alike_by_dalemberts_principle(seed: int, second_order: bool) -> None:
    # Differences of order 8 over steps of 0.01 s leave 1e-10 or so of the bias.
    made = random_mechanism(seed, second_order)
    q, v = made.state(seed)
    a = interpreted(made.compiled, "accelerations", (made.mechanism.n,), q=q, v=v)
    assert difference(a, kane.accelerations(made, TIME, q, v)) < 1e-8


def is_scalar(seed: int) -> bool:
    """True if a random mechanism has no rotation in space, and a body with second-order moments."""
    mechanism = random_mechanism(seed, second_order=True).mechanism
    return mechanism.n == mechanism.n_positions and any(link.integrals.displacement2.any() for link in mechanism.links)


LAGRANGE = [seed for seed in (3, 4, 5, 13) if is_scalar(seed)]


@pytest.mark.parametrize("seed", LAGRANGE)
def test_stiffened_bodies_accelerate_as_by_lagranges_equations(seed: int) -> None:
    mechanism = lagrange.without_drives(random_mechanism(seed, second_order=True).mechanism)
    q, v = 0.4 * np.random.default_rng(seed).normal(size=(2, mechanism.n))
    a = interpreted(compile_mechanism(mechanism), "accelerations", (mechanism.n,), q=q, v=v)
    assert difference(a, lagrange.accelerations(mechanism, q, v)) < 1e-8


@EACH
def test_machine_code_does_what_the_interpreter_does(seed: int) -> None:
    made = random_mechanism(seed, second_order=True)
    q, v = made.state(seed)
    a = made.compiled.accelerations(TIME, q, v)
    assert difference(a, interpreted(made.compiled, "accelerations", (made.mechanism.n,), q=q, v=v)) < 1e-12
