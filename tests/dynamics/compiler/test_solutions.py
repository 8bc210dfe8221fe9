"""Compiled products with the inverse mass matrix, and the fast coordinates' held equation."""

import numpy as np
import pytest

from pipeline.dynamics.compiler.compiled import compile_mechanism
from tests.dynamics.compiler.comparison import TIME, difference, mass_and_force
from tests.dynamics.compiler.mechanisms import random_mechanism

SEEDS = pytest.mark.parametrize("seed", [*range(4), *(pytest.param(k, marks=pytest.mark.slow) for k in range(4, 60))])


@SEEDS
def test_solutions_for_given_forces_are_those_of_the_mass_matrix(seed: int) -> None:
    made = random_mechanism(seed)
    q, v = made.state(seed)
    f = np.random.default_rng(seed).normal(size=(len(v), 11))
    M, _ = mass_and_force(made.mechanism, q, v)
    assert difference(M @ compile_mechanism(made.mechanism).solve(TIME, q, f), f) < 1e-12


@SEEDS
def test_fast_coordinates_respond_alone_while_the_slow_ones_are_held(seed: int) -> None:
    made = random_mechanism(seed)
    q, v = made.state(seed)
    n_slow = made.mechanism.n_slow
    f = np.random.default_rng(seed).normal(size=(len(v), 3))
    M, _ = mass_and_force(made.mechanism, q, v)
    x = compile_mechanism(made.mechanism).solve_fast(TIME, q, f)
    assert not x[:n_slow].any()
    assert difference(M[n_slow:, n_slow:] @ x[n_slow:], f[n_slow:]) < 1e-12


@SEEDS
def test_the_held_equation_is_that_of_the_frozen_coefficients(seed: int) -> None:
    # M_SS a_S = Q_S + K_SS q_S + C_SS v_S − M_SL a_L − K_SS q − C_SS v, with all but q, v held.
    made = random_mechanism(seed)
    mechanism, (q, v) = made.mechanism, made.state(seed)
    c, K, C = compile_mechanism(mechanism).held_equation(TIME, q, v)
    M, Q = mass_and_force(mechanism, q, v)
    S, L = slice(mechanism.n_slow, None), slice(mechanism.n_slow)
    a, fast = np.linalg.solve(M, Q), q[mechanism.n_slow + mechanism.n_positions - mechanism.n :]
    moved, rates = np.random.default_rng(seed).normal(size=(2, len(fast)))
    rest = mechanism.linear_stiffness[S, S] @ (fast - moved) + mechanism.linear_damping[S, S] @ (v[S] - rates)
    expected = np.linalg.solve(M[S, S], Q[S] - M[S, L] @ a[L] + rest)
    assert difference(c - K @ moved - C @ rates, expected) < 1e-10
