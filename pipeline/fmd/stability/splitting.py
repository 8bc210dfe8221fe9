"""Choice of slow coordinates, ratio and step of sub-cycling for a wanted error.

Central difference with a step h advances an oscillation ω by a phase that is wrong by ``(ω h)²/24`` of itself. What a
load bends, it bends mode by mode as ``1/ω²``, so the high modes of a motion are small by ``(ω₁/ω)²`` against the lowest
one; their errors count by that. Forces frozen over a slow step H, the centrifugal ones ``Ω² u``, lag by half of it and
feed or damp a deflection u by ``½ Ω² H`` of its rate. These bound the ratio of the two steps for each split; splits
whose amplification over the duration would show are left out, and the one with the least work by the solvers' measured
cost is taken.

The state of a major cycle's amplification matrix, Miao et al. (2008), eqs. (8)–(11), is what an explicit march keeps:
positions, rates half a step behind them, and the last accelerations, which predict the rates that damping and
gyroscopic terms are taken at.
"""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.stability import MOST_SUBSTEPS, NO_RESTORING, SLOW_STEPS, STABLE_SHARE
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.vibration import frequencies


@dataclass(frozen=True)
class Split:
    """Split of a mechanism into slow and fast coordinates, with the steps of both."""

    frequency_hz: float  # coordinates below it are slow [Hz]
    substeps: int
    step: float  # fast step [s]


def split_at(system: CompiledSystem, frequency_hz: float) -> tuple[list[str], dict[str, int]]:
    """Return the fast joints and the numbers of slow modes of a mechanism that is split at a frequency."""
    own, mechanism = system.frequencies_hz, system.mechanism
    fast_joints = [
        link.name
        for k, link in enumerate(mechanism.links)
        if link.n_rates == 1 and own[mechanism.layout.rate[k]] >= frequency_hz
    ]
    slow_modes = {
        link.name: int(np.count_nonzero(own[mechanism.modes_of(k)] < frequency_hz))
        for k, link in enumerate(mechanism.links)
    }
    return fast_joints, slow_modes


def choose_split(
    system: CompiledSystem, error: float, duration: float, spin: float, step: float | None = None
) -> Split:
    """Choose the split with the least work, its ratio and, if none is given, the fast step [s].

    The error is relative to the largest deformation over a duration [s]; the spin is the angular rate of the fastest
    body, its root mean square over that [rad/s].
    """
    own = 2 * np.pi * system.frequencies_hz
    order = np.argsort(own, kind="stable")
    omega = own[order]
    stiff = omega[omega > 0]
    if not stiff.size:
        return Split(np.inf, 1, step or duration / SLOW_STEPS)
    limits = step_limits(omega, float(stiff[0]), error, duration)
    highest = STABLE_SHARE * system.largest_step
    step = step or float(min(highest, limits.min()))
    M, K, _ = system.linear_matrices
    M, K = M[np.ix_(order, order)], K[np.ix_(order, order)]
    best = Split(0.0, 1, step)
    least = _cost(omega.size, omega.size) / step
    longest = min(duration / SLOW_STEPS, 2 * error / (duration * max(spin, 1e-150) ** 2))
    for n_slow in range(1, omega.size):
        if omega[n_slow] <= 1.001 * omega[n_slow - 1]:
            continue  # no gap
        substeps = int(min(limits[:n_slow].min(initial=longest) / step, MOST_SUBSTEPS))
        if substeps < 1:
            break
        n_fast = omega.size - n_slow
        work = (_cost(omega.size, n_fast) + (substeps - 1) * _fast_cost(n_fast)) / (substeps * step)
        if work < least and _stays_below(cycle_growth(M, K, n_slow, step, substeps), substeps * step, error, duration):
            between = 0.5 * (omega[n_slow - 1] + omega[n_slow]) / (2 * np.pi)
            least, best = work, Split(float(between), substeps, step)
    return best


def longest_step(M: Array, K: Array, error: float, duration: float) -> float:
    """Return the longest step [s] of central difference whose phase errors over a duration [s] stay below an error."""
    omega = frequencies(M, K)
    return _longest_of(omega, _lowest(omega), error, duration)


def recommend_step(M: Array, K: Array, n_slow: int, error: float, duration: float) -> tuple[float, int]:
    """Return the longest fast step [s] and the largest ratio whose phase errors and growth stay below an error.

    The ratio is 1 where all coordinates are slow, or all are fast: it would change nothing. The error is relative to
    the largest deformation.
    """
    if not 0 < n_slow < len(M):
        return longest_step(M, K, error, duration), 1
    fast, slow = (frequencies(M[part, part], K[part, part]) for part in (slice(n_slow, None), slice(0, n_slow)))
    both = frequencies(M, K)
    longest_fast, longest_slow = (_longest_of(omega, _lowest(both), error, duration) for omega in (fast, slow))
    step = min(longest_fast, 2 * STABLE_SHARE / both[-1])
    for substeps in range(min(max(1, int(longest_slow / step)), MOST_SUBSTEPS), 1, -1):
        if _stays_below(cycle_growth(M, K, n_slow, step, substeps), substeps * step, error, duration):
            return step, substeps
    return min(step, longest_step(M, K, error, duration)), 1


def _lowest(omega: Array) -> float:
    """Return the lowest of ascending frequencies that isn't 0 [rad/s]; never 0, for errors are divided by it."""
    moving = omega[omega > NO_RESTORING * omega.max(initial=0.0)]
    return float(moving[0]) if moving.size else 1e-150


def _longest_of(omega: Array, lowest: float, error: float, duration: float) -> float:
    """Return the longest step that is within the limits of all oscillations and resolves the motion [s]."""
    return float(step_limits(omega, lowest, error, duration).min(initial=duration / SLOW_STEPS))


def _stays_below(radius: float, cycle: float, error: float, duration: float) -> bool:
    """Return true if growth by ``radius`` in each major cycle [s] stays below an error over the duration [s]."""
    return bool(duration / cycle * np.log(max(radius, 1e-300)) < error)


def step_limits(omega: Array, lowest: float, error: float, duration: float) -> Array:
    """Return the step of each oscillation that its stability limit and a wanted error allow [s], shape (n,).

    The error over a duration T is ``ω T (ω h)²/24 · (ω₁/ω)²``, ω₁ the lowest frequency.
    """
    moving = np.maximum(omega, 1e-150)
    accurate = np.sqrt(24 * error / (duration * moving)) / lowest  # its square may be no number
    return np.asarray(np.minimum(accurate, 2 * STABLE_SHARE / moving))


def _cost(n: int, n_fast: int) -> float:
    """Return the run time of a solution of the whole mechanism, measured on one core [s]."""
    return 0.9e-6 + 30e-9 * n + 1.2e-9 * n**2 + 0.5e-9 * n_fast**2


def _fast_cost(n: int) -> float:
    """Return the run time of a fast step of n coordinates, measured on one core [s]."""
    return 5e-9 + 4e-9 * n + 0.5e-9 * n**2


def amplification_matrix(M: Array, K: Array, n_slow: int, step: float, substeps: int, C: Array | None = None) -> Array:
    """Return the map (3n, 3n) of positions, rates and accelerations over one major cycle of ``M q̈ + C q̇ + K q = 0``.

    Slow coordinates of the matrices (n, n) are first; the step is the fast one [s].
    """
    n, L, S = len(M), slice(0, n_slow), slice(n_slow, None)
    C = np.zeros_like(K) if C is None else C
    q, v, a = np.eye(3 * n).reshape(3, n, 3 * n)
    lag = np.full((n, 1), 0.5 * step)
    lag[L] *= substeps
    now = v + lag * a
    a[:] = -np.linalg.solve(M, K @ q + C @ now)
    frozen = K[S, L] @ q[L] + C[S, L] @ now[L] + M[S, L] @ a[L]
    v[L] += substeps * step * a[L]
    q[L] += substeps * step * v[L]
    for k in range(substeps):
        if k:
            now[S] = v[S] + 0.5 * step * a[S]
            a[S] = -np.linalg.solve(M[S, S], K[S, S] @ q[S] + C[S, S] @ now[S] + frozen)
        v[S] += step * a[S]
        q[S] += step * v[S]
    return np.concatenate([q, v, a])


def cycle_growth(M: Array, K: Array, n_slow: int, step: float, substeps: int, C: Array | None = None) -> float:
    """Return the spectral radius of `amplification_matrix`: the largest growth of a vibration over a major cycle."""
    return spectral_radius(amplification_matrix(M, K, n_slow, step, substeps, C))


def spectral_radius(A: Array) -> float:
    """Return the largest modulus of the eigenvalues of a matrix of shape (n, n)."""
    return float(np.abs(np.linalg.eigvals(A)).max())
