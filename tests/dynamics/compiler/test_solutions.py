"""Compiled products with the inverse mass matrix, of all coordinates and of the fast ones."""

import numpy as np

from tests.dynamics.compiler.comparison import TIME, difference
from tests.dynamics.compiler.mechanisms import EACH, random_mechanism


@EACH
def test_solutions_for_given_forces_are_those_of_the_mass_matrix(seed: int) -> None:
    made = random_mechanism(seed)
    q, v = made.state(seed)
    f = np.random.default_rng(seed).normal(size=(len(v), 11))
    compiled = made.compiled
    assert difference(compiled.mass_matrix(compiled.signal_values(TIME), q) @ compiled.solve(TIME, q, f), f) < 1e-12


@EACH
def test_fast_coordinates_respond_alone_while_the_slow_ones_are_frozen(seed: int) -> None:
    made = random_mechanism(seed)
    q, v = made.state(seed)
    n_slow = made.mechanism.n_slow
    f = np.random.default_rng(seed).normal(size=(len(v), 3))
    compiled = made.compiled
    M, x = compiled.mass_matrix(compiled.signal_values(TIME), q), compiled.solve(TIME, q, f, "solve_fast")
    assert not x[:n_slow].any()
    assert difference(M[n_slow:, n_slow:] @ x[n_slow:], f[n_slow:]) < 1e-12


@EACH
def test_slow_coordinates_respond_alone_while_the_fast_ones_are_frozen(seed: int) -> None:
    made = random_mechanism(seed)
    q, v = made.state(seed)
    n_slow = made.mechanism.n_slow
    f = np.random.default_rng(seed).normal(size=(len(v), 3))
    compiled = made.compiled
    M, x = compiled.mass_matrix(compiled.signal_values(TIME), q), compiled.solve(TIME, q, f, "solve_slow")
    assert not x[n_slow:].any()
    assert difference(M[:n_slow, :n_slow] @ x[:n_slow], f[:n_slow]) < 1e-12
