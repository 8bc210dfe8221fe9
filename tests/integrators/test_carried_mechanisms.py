"""Cycles of random mechanisms by carried and by frozen forces are those of the scheme, written out step by step."""

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.subcycling import Subcycling
from tests.dynamics.compiler.mechanisms import random_mechanism
from tests.integrators.test_paper_scheme import OTHERS, SOME

CYCLES, STEP = 5, 1e-3  # the last two by parabolas through three cycles


def march_plainly(
    system: CompiledSystem, q: Array, v: Array, m: int, degree: int
) -> tuple[Array, Array, Array, list[Array]]:
    """March some cycles, forces going on by a polynomial through the cycles before.

    Return the state at the end, and the positions after each step of the last cycle.
    """
    (M, K, _), slow, H = system.linear_matrices, np.arange(system.n) < system.n_slow, m * STEP
    k = np.linalg.solve(M, K).diagonal()
    steps = np.where(slow, H, STEP)
    a = system.compiled.accelerations(0.0, q, v)
    path = list[Array]()
    q, v, past = q.copy(), v - 0.5 * steps * a, list[Array]()
    for cycle in range(CYCLES):
        t = cycle * H
        if any(t - H < point <= t for point in system.breakpoints):
            past = []
        a = system.compiled.accelerations(t, q, v + 0.5 * steps * a)
        r = a + k * q
        v[slow] += H * a[slow]
        q[slow] += H * v[slow]
        known = [r, *past][: degree + 1]
        times = -H * np.arange(len(known))
        weights = [  # Lagrange's polynomials, beside the divided differences of the product
            np.prod([(STEP * np.arange(m) - other) / (own - other) for other in times if other != own], axis=0)
            * np.ones(m)
            for own in times
        ]
        forces = sum(np.outer(weight, one) for weight, one in zip(weights, known, strict=True))
        for s in range(m):
            if s:
                a = np.where(slow, a, forces[s] - k * q)
            v = np.where(slow, v, v + STEP * a)
            q = np.where(slow, q, q + STEP * v)
            path.append(q)
        past = known[:2]
    return q, v, a, path[-m:]


@pytest.mark.parametrize(("forces", "degree"), [("carried", 2), ("frozen", 0)])
@pytest.mark.parametrize("m", [2, 5])
@pytest.mark.parametrize("seed", [*SOME, *OTHERS])
def test_random_mechanisms_take_the_cycles_of_the_scheme(seed: int, m: int, forces: str, degree: int) -> None:
    made = random_mechanism(seed)
    system, (q0, v0) = CompiledSystem(made.mechanism), made.state(seed)
    if system.n != system.n_positions:
        pytest.skip("rotations in space are no vectors")
    method = Subcycling(STEP, m, forces)
    steps = np.r_[(CYCLES - 1) * m + np.arange(1, m), CYCLES * m - 0.5]
    march = method.march(system, q0, 0.5 * v0, STEP * steps)
    *state, path = march_plainly(system, q0, 0.5 * v0, m, degree)
    fast = slice(system.n_slow, None)
    within = [(one[fast], other[fast]) for one, other in zip(march.q[:-1], path[:-1], strict=True)]
    for found, expected in [*zip((march.end.q, march.end.v, march.end.a), state, strict=True), *within]:
        size = max(np.abs(expected).max(initial=0.0), 1e-300)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * size)


@pytest.mark.parametrize("forces", ["carried", "frozen"])
@pytest.mark.parametrize("seed", SOME)
def test_output_times_and_a_break_change_no_bit_of_whole_cycles(seed: int, forces: str) -> None:
    made = random_mechanism(seed)
    system, (q0, v0) = CompiledSystem(made.mechanism), made.state(seed)
    if system.carried_cycle() is None:
        pytest.skip("its cycles aren't compiled as a whole")
    method, end = Subcycling(STEP, 5, forces), np.array([0.0, 0.06])
    few = method.march(system, q0, 0.5 * v0, end)
    many = method.march(system, q0, 0.5 * v0, np.linspace(0.0, 0.06, 50))
    part = method.march(system, q0, 0.5 * v0, np.array([0.021]))
    for state in (many.end, method.resume(system, part.end, end).end):
        for name in ("q", "v", "a", "memory"):
            assert (getattr(state, name) == getattr(few.end, name)).all()
    assert (many.q[-1] == few.q[-1]).all()
