"""What one major cycle does to a system: by formula, Miao et al. (2008), eqs. (8)–(11), and by the very integrators.

The state is what an explicit march keeps: positions, rates half a step behind them, and the last accelerations, which
predict the rates that damping and gyroscopic terms are taken at.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pipeline.core.arrays import Array

if TYPE_CHECKING:
    from pipeline.dynamics.system import System
    from pipeline.integrators.protocol import Integrator, State

STABLE = 1e-9  # a spectral radius that exceeds 1 by less is round-off


def amplification_matrix(M: Array, K: Array, n_slow: int, step: float, substeps: int, C: Array | None = None) -> Array:
    """Map of positions, rates and accelerations over one major cycle of ``M q̈ + C q̇ + K q = 0``, shape (3n, 3n).

    Parameters
    ----------
    M, K, C : ndarray, shape (n, n)
        Mass, stiffness and coefficients of the rates, slow coordinates first.
    n_slow : int
        Number of slow coordinates.
    step : float
        Fast step [s].
    substeps : int
        Fast steps to a major cycle.
    """
    n, L, S = len(M), slice(0, n_slow), slice(n_slow, None)
    C = np.zeros_like(K) if C is None else C
    q, v, a = np.eye(3 * n).reshape(3, n, 3 * n)
    lag = np.full((n, 1), 0.5 * step)
    lag[L] *= substeps
    now = v + lag * a
    a[:] = -np.linalg.solve(M, K @ q + C @ now)
    held = K[S, L] @ q[L] + C[S, L] @ now[L] + M[S, L] @ a[L]
    v[L] += substeps * step * a[L]
    q[L] += substeps * step * v[L]
    for k in range(substeps):
        if k:
            now[S] = v[S] + 0.5 * step * a[S]
            a[S] = -np.linalg.solve(M[S, S], K[S, S] @ q[S] + C[S, S] @ now[S] + held)
        v[S] += step * a[S]
        q[S] += step * v[S]
    return np.concatenate([q, v, a])


def growth(M: Array, K: Array, n_slow: int, step: float, substeps: int, C: Array | None = None) -> float:
    """Spectral radius of `amplification_matrix`."""
    return spectral_radius(amplification_matrix(M, K, n_slow, step, substeps, C))


def spectral_radius(A: Array) -> float:
    """Largest modulus of the eigenvalues of a matrix (n, n)."""
    return float(np.abs(np.linalg.eigvals(A)).max())


def measured_matrix(method: Integrator, system: System, about: State | None = None, size: float = 1.0) -> Array:
    """The same map found by feeding unit vectors to an integrator: positions, rates and what it keeps in ``State.a``.

    Parameters
    ----------
    method : Integrator
        One with a fixed step.
    system : System
        With as many positions as rates.
    about : State, optional
        A state of the march about which the map is taken, by central differences; the undeformed rest by default.
    size : float
        Of the vectors that are fed; for a linear system it is of no account.
    """
    rest = np.zeros(system.n)
    base = about or method.march(system, rest, rest, np.zeros(1)).end
    parts = np.cumsum([base.q.size, base.v.size])
    centre = np.concatenate([base.q, base.v, base.a])

    def cycle(values: Array) -> Array:
        q, v, a = np.split(values, parts)
        start = replace(base, q=q, v=v, a=a)
        end = method.resume(system, start, np.array([base.step * method.step])).end
        return np.concatenate([end.q, end.v, end.a])

    units = size * np.eye(centre.size)
    return np.stack([(cycle(centre + unit) - cycle(centre - unit)) / (2 * size) for unit in units], axis=1)
