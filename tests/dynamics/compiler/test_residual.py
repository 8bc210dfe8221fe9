"""Residual against mass points; its tangents by the signals against differences, and in lanes against the interpreter.

Tangents by the coordinates, frames, markers, energies and momenta are tested where bodies have terms of second order,
too: `test_second_order`.
"""

import numpy as np
import pytest

from tests.dynamics.compiler import kane
from tests.dynamics.compiler.comparison import TIME, difference, interpreted
from tests.dynamics.compiler.mechanisms import EACH, random_mechanism


@EACH
def test_the_residual_is_mass_times_acceleration_less_force(seed: int) -> None:
    # Differences of order 8 over steps of 0.01 s leave 1e-10 or so of the bias.
    made = random_mechanism(seed, second_order=False)
    q, v = made.state(seed)
    a = np.random.default_rng(seed).normal(size=len(v))
    M, Q = kane.mass_and_force(made, TIME, q, v)
    compiled = made.compiled
    assert difference(compiled.residual(TIME, q, v, a), M @ a - Q) < 1e-8
    assert difference(compiled.mass_matrix(compiled.signal_values(TIME), q), M) < 1e-12
    many, still = np.array([q, 1.01 * q]), np.zeros(len(v))
    assert (compiled.still_residuals(many) == [compiled.residual(0.0, x, still, still) for x in many]).all()


@EACH
def test_tangents_by_the_signals_are_those_of_differences(seed: int) -> None:
    made = random_mechanism(seed, second_order=True)
    compiled = made.compiled
    q, v = made.state(seed)
    a, inputs = np.random.default_rng(seed).normal(size=len(v)), compiled.signal_values(TIME)
    r = np.zeros(len(v))
    columns = np.zeros((len(v), len(inputs)))
    for j, unit in enumerate(np.eye(len(inputs))):
        for k, weight in ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0)):
            compiled.call("residual", inputs + k * 1e-3 * unit, q, v, a, r)
            columns[:, j] += weight / 12e-3 * r
    found = compiled.input_tangents(compiled.signal_values(TIME), q, v, a)
    assert np.abs(found - columns).max(initial=0.0) < 1e-8 * max(np.abs(columns).max(initial=0.0), 1.0)


@EACH
def test_lanes_of_machine_code_do_what_the_interpreter_does(seed: int) -> None:
    made = random_mechanism(seed, second_order=True)
    compiled, mechanism = made.compiled, made.mechanism
    q, v = made.state(seed)
    rng = np.random.default_rng(seed)
    sizes = {"dinputs": compiled.signal_values(TIME).size, "dq": len(q), "dv": len(v), "da": len(v)}
    directions = {name: rng.normal(size=(size, 8)) for name, size in sizes.items()}
    dr, a = np.zeros((mechanism.n, 8)), rng.normal(size=mechanism.n)
    compiled.call("tangents", compiled.signal_values(TIME), q, v, a, *directions.values(), dr)
    assert difference(dr, interpreted(compiled, "tangents", dr.shape, q=q, v=v, a=a, **directions)) < 1e-12


@pytest.mark.parametrize("seed", [1, 45])
def test_the_adjoint_of_the_accelerations_is_the_transpose_of_their_tangents(seed: int) -> None:
    made = random_mechanism(seed, second_order=True)
    compiled, (q, v) = made.compiled, made.state(seed)
    inputs, f = compiled.signal_values(TIME), np.random.default_rng(seed).normal(size=len(v))
    a = compiled.accelerations(TIME, q, v)
    by_q, by_v, M = compiled.tangents(inputs, q, v, a)
    slopes = (compiled.input_tangents(inputs, q, v, a), by_q, by_v)
    found = [np.zeros(slope.shape[1]) for slope in slopes]
    x = np.zeros(len(v))
    compiled.call("acceleration_adjoint", inputs, q, v, a, np.zeros(0), f, x, *found)
    np.testing.assert_allclose(x, np.linalg.solve(M, f), rtol=0, atol=1e-10 * np.abs(x).max())
    for mine, slope in zip(found, slopes, strict=True):
        expected = -slope.T @ np.linalg.solve(M, f)
        assert np.abs(mine - expected).max(initial=0.0) < 1e-10 * max(np.abs(expected).max(initial=0.0), 1.0)
