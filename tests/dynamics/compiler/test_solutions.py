"""Compiled products with the inverse mass matrix, and the fast coordinates' held equation."""

import numpy as np
import pytest

from pipeline.dynamics.compiler.compiled import compile_mechanism
from tests.dynamics.compiler.comparison import TIME, difference, mass_and_force
from tests.dynamics.compiler.mechanisms import random_mechanism

SEEDS = pytest.mark.parametrize("seed", [*range(4), *(pytest.param(k, marks=pytest.mark.slow) for k in range(4, 60))])


@SEEDS
def test_solutions_for_given_forces_are_those_of_the_mass_matrix(seed: int) -> None:
    mechanism = random_mechanism(seed)
    q, v = mechanism.state(seed)
    f = np.random.default_rng(seed).normal(size=(len(v), 11))
    M, _ = mass_and_force(mechanism.tree, q, v)
    assert difference(M @ compile_mechanism(mechanism.tree).solve(TIME, q, f), f) < 1e-12


@SEEDS
def test_fast_coordinates_respond_alone_while_the_slow_ones_are_held(seed: int) -> None:
    mechanism = random_mechanism(seed)
    q, v = mechanism.state(seed)
    n_slow = mechanism.tree.n_slow
    f = np.random.default_rng(seed).normal(size=(len(v), 3))
    M, _ = mass_and_force(mechanism.tree, q, v)
    x = compile_mechanism(mechanism.tree).solve_fast(TIME, q, f)
    assert not x[:n_slow].any()
    assert difference(M[n_slow:, n_slow:] @ x[n_slow:], f[n_slow:]) < 1e-12


@SEEDS
def test_the_held_equation_is_that_of_the_frozen_coefficients(seed: int) -> None:
    # M_SS a_S = Q_S + K_SS q_S + C_SS v_S − M_SL a_L − K_SS q − C_SS v, with all but q, v held.
    mechanism = random_mechanism(seed)
    tree, (q, v) = mechanism.tree, mechanism.state(seed)
    c, K, C = compile_mechanism(tree).held_equation(TIME, q, v)
    M, Q = mass_and_force(tree, q, v)
    S, L = slice(tree.n_slow, None), slice(tree.n_slow)
    a, fast = np.linalg.solve(M, Q), q[tree.n_slow + tree.n_positions - tree.n :]
    moved, rates = np.random.default_rng(seed).normal(size=(2, len(fast)))
    rest = tree.linear_stiffness[S, S] @ (fast - moved) + tree.linear_damping[S, S] @ (v[S] - rates)
    expected = np.linalg.solve(M[S, S], Q[S] - M[S, L] @ a[L] + rest)
    assert difference(c - K @ moved - C @ rates, expected) < 1e-10
