"""What a cycle of reversible sub-cycling freezes, and its steps, against NumPy and functions of their own."""

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.dynamics.compiler.compiled import CompiledMechanism, compile_mechanism
from fmd.dynamics.compiler.middle import find_pattern
from tests.dynamics.compiler.comparison import TIME, difference


@pytest.fixture(scope="module")
def compiled() -> CompiledMechanism:
    return compile_mechanism(Pipeline(load_scene("arm", ["body.forearm.modes.enrich=none"])).mechanism)


def in_blocks(A: Array) -> Array:
    """A matrix (n, n) by columns, in blocks of eight rows."""
    n = len(A)
    out = np.zeros((-(-n // 8), n, 8))
    for i in range(n):
        out[i // 8, :, i % 8] = A[i]
    return out


def test_responses_are_accelerations_and_the_inverse_mass_matrix(compiled: CompiledMechanism) -> None:
    random, n = np.random.default_rng(3), compiled.mechanism.n
    q, v, a, X = 0.01 * random.normal(size=n), random.normal(size=n), np.zeros(n), np.zeros((n, 8))
    inputs = compiled.signal_values(TIME)
    compiled.call("responses", inputs, q, v, np.eye(n, 8), a, X)
    assert difference(a, compiled.accelerations(TIME, q, v)) < 1e-12
    assert difference(X[:, :n] @ compiled.mass_matrix(inputs, q), np.eye(n)) < 1e-10


@pytest.mark.parametrize(("kept", "damped"), [(1.0, 1.0), (0.3, 1.0), (0.3, 0.0), (0.0, 1.0), (0.0, 0.0)])
def test_a_step_takes_the_frozen_equations_matrices(compiled: CompiledMechanism, kept: float, damped: float) -> None:
    random, n, h = np.random.default_rng(4), compiled.mechanism.n, 0.1
    X, K, C = random.normal(size=(3, n, n))
    K, C = K * (random.uniform(size=(n, n)) < kept), damped * C * (random.uniform(size=(n, n)) < 0.3)
    pattern = find_pattern(K, C)
    frozen, middle, s, v, last = random.normal(size=(5, n))
    A, B, constant, was = np.zeros((1, n, 8)), np.zeros((1, n, 8)), np.zeros(n), (s.copy(), v.copy(), last.copy())
    compiled.call(f"middle{pattern}", K.T.copy(), C.T.copy(), in_blocks(X), frozen, middle, A, B, constant)
    assert difference(A, in_blocks(X @ K)) < 1e-13
    assert difference(B, in_blocks(X @ C)) < 1e-13
    compiled.call(f"middle_step{pattern}", np.array([h]), A, B, constant, s, v, last)
    a = frozen - X @ (K @ was[0] + C @ (was[1] + 0.5 * h * was[2] - middle))
    assert difference(last, a) < 1e-12
    assert difference(v, was[1] + h * a) < 1e-12
    assert difference(s, was[0] + h * (was[1] + h * a)) < 1e-12
