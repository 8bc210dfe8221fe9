"""Compiled cycles of random mechanisms are those of the sub-cycled scheme, written out in NumPy with whole tangents."""

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.subcycling import Subcycling
from tests.dynamics.compiler.mechanisms import random_mechanism

CYCLES, STEP = 3, 1e-3
SOME = (3, 4, 14, 16, 23, 46)  # rigid and flexible, with all joints that have no rotations in space
OTHERS = [pytest.param(seed, marks=pytest.mark.long) for seed in range(200) if seed not in SOME]


def march_plainly(system: CompiledSystem, q: Array, v: Array, h: float, m: int) -> tuple[Array, Array, Array]:
    """March some cycles by eqs. (8)-(11) of the paper with tangents; return positions, rates and accelerations."""
    compiled, slow, H = system.compiled, np.arange(system.n) < system.n_slow, m * h
    fast, steps = ~slow, np.where(slow, H, h)
    S = np.ix_(fast, fast)
    a = compiled.accelerations(0.0, q, v)
    q, v = q.copy(), v - 0.5 * steps * a
    for cycle in range(CYCLES):
        t = cycle * m * h
        q_begin, now, inputs = q.copy(), v + 0.5 * steps * a, compiled.signal_values(t)
        a = compiled.accelerations(t, q, now)
        K, C, M = compiled.tangents(inputs, q, now, a)
        by_inputs = compiled.input_tangents(inputs, q, now, a)[fast]
        drift = K[np.ix_(fast, slow)] @ now[slow] + C[np.ix_(fast, slow)] @ a[slow]
        begin = a[fast]
        v[slow] += H * a[slow]
        q[slow] += H * v[slow]
        for k in range(m):
            if k:
                tau, middle = (cycle * m + k) * h - t, v[fast] + 0.5 * h * a[fast]
                force = K[S] @ (q - q_begin)[fast] + C[S] @ (middle - now[fast]) + tau * drift
                force = force + by_inputs @ (compiled.signal_values((cycle * m + k) * h) - inputs)
                a[fast] = begin - np.linalg.solve(M[S], force)
            v[fast] += h * a[fast]
            q[fast] += h * v[fast]
    return q, v, a


@pytest.mark.parametrize("m", [2, 5])
@pytest.mark.parametrize("seed", [*SOME, *OTHERS])
def test_random_mechanisms_take_the_cycles_of_the_scheme(seed: int, m: int) -> None:
    made = random_mechanism(seed)
    system, (q0, v0) = CompiledSystem(made.mechanism), made.state(seed)
    if system.n != system.n_positions:
        pytest.skip("rotations in space are no vectors")
    end = Subcycling(STEP, m).march(system, q0, 0.5 * v0, np.array([(CYCLES * m - 0.5) * STEP])).end
    for found, expected in zip((end.q, end.v, end.a), march_plainly(system, q0, 0.5 * v0, STEP, m), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10 * max(np.abs(expected).max(), 1e-300))
