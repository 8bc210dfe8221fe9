"""Sub-cycling in plain NumPy, its frozen equation by differences of the residual: slow, and sharing no frozen
tangents."""

from collections.abc import Callable

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.compiled import CompiledMechanism
from tests.dynamics.compiler import kane
from tests.dynamics.compiler.mechanisms import PointMechanism

STEP = 1e-3  # of differences of order 4, which leave 1e-10 or so


def residual(compiled: CompiledMechanism, inputs: Array, q: Array, v: Array, a: Array) -> Array:
    r = np.zeros(len(v))
    compiled.call("residual", inputs, *(np.ascontiguousarray(x, dtype=float) for x in (q, v, a)), r)
    return r


def fast_accelerations(compiled: CompiledMechanism, inputs: Array, q: Array, v: Array, slow: Array) -> Array:
    """Solve ``M_SS a_S = Q_S − M_SL a_L`` with the slow accelerations given."""
    n, n_slow = len(v), len(slow)
    frozen = np.r_[slow, np.zeros(n - n_slow)]
    r = residual(compiled, inputs, q, v, frozen)
    M = np.stack([residual(compiled, inputs, q, v, frozen + unit) - r for unit in np.eye(n)], axis=1)
    return np.asarray(np.linalg.solve(M[n_slow:, n_slow:], -r[n_slow:]))


def slope(values: Callable[[float], Array]) -> Array:
    """Derivative of a function at 0."""
    one, two = (values(k * STEP) - values(-k * STEP) for k in (1, 2))
    return (8 * one - two) / (12 * STEP)


def sub_cycle(made: PointMechanism, h: float, m: int, n_cycles: int, q: Array, v: Array) -> Array:
    """Sub-cycle from time 0; positions at the start of each cycle, shape (n_cycles, n_positions)."""
    mechanism, compiled = made.mechanism, CompiledMechanism(made.mechanism)
    n, n_slow, H = mechanism.n, mechanism.n_slow, m * h
    at = np.arange(n_slow, n) + len(q) - n  # positions of the fast coordinates
    own = np.r_[np.full(n_slow, H), np.full(n - n_slow, h)]  # both sets keep their rates half of their step behind
    a = compiled.accelerations(0.0, q, v)
    v, out = v - 0.5 * own * a, []
    for cycle in range(n_cycles):
        out.append(q)
        t, now = cycle * m * h, v + 0.5 * own * a
        a = compiled.accelerations(t, q, now)
        equation = freeze(made, compiled, t, q, now, a.copy())
        v = v + own * a
        q = kane.advance(made, q, np.r_[v[:n_slow], np.zeros(n - n_slow)], H)
        q[at] += h * v[n_slow:]
        for step in range(1, m):
            tau = step * h
            a[n_slow:] = equation(tau, q[at], v[n_slow:] + 0.5 * h * a[n_slow:])
            v[n_slow:] += h * a[n_slow:]
            q[at] += h * v[n_slow:]
    return np.array(out)


def freeze(
    made: PointMechanism, compiled: CompiledMechanism, t: float, q: Array, v: Array, a: Array
) -> Callable[[float, Array, Array], Array]:
    """Return the fast accelerations over a cycle as a function of its time, the fast positions and rates."""
    n, n_slow = len(v), made.mechanism.n_slow
    at = np.arange(n_slow, n) + len(q) - n
    inputs, place = compiled.signal_values(t), q[at].copy()

    def along(inputs_way: Array, q_way: Array, v_way: Array) -> Array:
        def values(size: float) -> Array:
            moved = inputs + size * inputs_way, q + size * q_way, v + size * v_way
            return fast_accelerations(compiled, *moved, a[:n_slow])

        return slope(values)

    still, none, rest = np.zeros(len(inputs)), np.zeros(len(q)), np.zeros(n)
    slow_rates = np.r_[v[:n_slow], np.zeros(n - n_slow)]
    rise = along(still, kane.rate_of_positions(made, q, slow_rates), np.r_[a[:n_slow], np.zeros(n - n_slow)])
    by_q = np.array([along(still, unit, rest) for unit in np.eye(len(q))[at]])
    by_v = np.array([along(still, none, unit) for unit in np.eye(n)[n_slow:]])
    by_inputs = np.array([along(unit, none, rest) for unit in np.eye(len(inputs))]).reshape(len(inputs), n - n_slow)

    def equation(tau: float, fast: Array, rates: Array) -> Array:
        loads = (compiled.signal_values(t + tau) - inputs) @ by_inputs
        return np.asarray(a[n_slow:] + tau * rise + loads + (fast - place) @ by_q + (rates - v[n_slow:]) @ by_v)

    return equation
