"""Steady state of a mechanism: where loads and rotation leave the modes at rest in their frames."""

from __future__ import annotations

import numpy as np

from pipeline.core.arrays import Array
from pipeline.core.errors import AccuracyError
from pipeline.dynamics.compiled_system.system import CompiledSystem

_SETTLED = 1e-10
_CORRECTIONS = 30


def find_steady_state(system: CompiledSystem, q: Array, v: Array, t: float = 0.0) -> Array:
    """Find positions (n_positions,) with the modes where rates v and loads at t [s] leave them at rest in their frames.

    Raises
    ------
    AccuracyError
        There is no such state: something turns too fast for its stiffness.
    """
    mechanism, compiled = system.mechanism, system.compiled
    modes = np.concatenate([mechanism.modes_of(k) for k in range(len(mechanism.links))])
    at, q = modes + mechanism.n_positions - mechanism.n, q.copy()

    def left(values: Array) -> Array:
        q[at] = values
        return np.asarray(compiled.accelerations(t, q, v)[modes])

    found, size = q[at].copy(), 0.0
    for _ in range(_CORRECTIONS):
        lack = left(found)
        # The equations are almost linear in the modes: a difference of their own size has no error to speak of.
        step = 1e-3 * max(np.abs(found).max(initial=0.0), 1e-6)
        slopes = np.stack([left(found + step * unit) - lack for unit in np.eye(len(found))], axis=1) / step
        change = np.linalg.solve(slopes, lack)
        found, size = found - change, float(np.linalg.norm(change))
        if size <= _SETTLED * np.linalg.norm(found):
            break
    stable = np.linalg.eigvals(slopes).real.max(initial=-1.0) < 0
    if not (stable and size <= _SETTLED * np.linalg.norm(found)):
        raise AccuracyError(
            f"no steady state: the modes still change by {size:.1e} after {_CORRECTIONS} corrections, or a "
            "deflection grows by itself; the scene turns too fast for the bodies' stiffness"
        )
    q[at] = found
    return q
