"""Steady state of a mechanism: where loads and rotation leave the modes at rest in their frames."""

from __future__ import annotations

import numpy as np

from pipeline.core.arrays import Array
from pipeline.core.errors import AccuracyError
from pipeline.dynamics.compiled_system.positive_mass import require_positive_mass
from pipeline.dynamics.compiled_system.system import CompiledSystem

_SETTLED = 1e-10
_CORRECTIONS = 30


def find_steady_state(system: CompiledSystem, q: Array, v: Array, t: float = 0.0) -> Array:
    """Find positions (n_positions,) with the modes where rates v and loads at t [s] leave them at rest in their frames.

    Raises
    ------
    AccuracyError
        There is no such state: something turns too fast for its stiffness, or deflects so far that the mass matrix
        isn't positive definite.
    """
    mechanism, compiled = system.mechanism, system.compiled
    modes = np.concatenate([mechanism.modes_of(k) for k in range(len(mechanism.links))])
    at, q, inputs = modes + mechanism.n_positions - mechanism.n, q.copy(), compiled.signal_values(t)
    size, slopes = 0.0, np.zeros((0, 0))
    for _ in range(_CORRECTIONS):
        a = compiled.accelerations(t, q, v)
        by_q, _, M = compiled.tangents(inputs, q, v, a)
        try:
            slopes = -np.linalg.solve(M, by_q[:, at])[modes]
            change = np.linalg.solve(slopes, a[modes])
        except np.linalg.LinAlgError:  # the corrections have run away
            size = np.inf
            break
        q[at] -= change
        size = float(np.linalg.norm(change))
        if size <= _SETTLED * np.linalg.norm(q[at]) or not np.isfinite(size):
            break
    settled = size <= _SETTLED * np.linalg.norm(q[at])
    if settled:
        require_positive_mass(system, q, "in the steady state")
    if not (settled and np.linalg.eigvals(slopes).real.max(initial=-1.0) < 0):
        raise AccuracyError(
            f"no steady state: the modes still change by {size:.1e} after {_CORRECTIONS} corrections, or a "
            "deflection grows by itself; the scene turns too fast for the bodies' stiffness"
        )
    return q
