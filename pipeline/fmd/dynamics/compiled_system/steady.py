"""Steady state of a mechanism: where loads and rotation leave the modes at rest in their frames."""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.dynamics.compiled_system.positive_mass import require_positive_mass
from fmd.dynamics.compiled_system.system import CompiledSystem

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
    joints = np.setdiff1d(np.arange(mechanism.n), modes)
    at, q, inputs = modes + mechanism.n_positions - mechanism.n, q.copy(), compiled.signal_values(t)
    a = np.zeros(mechanism.n)
    a[joints] = compiled.accelerations(t, q, v)[joints]
    size, slopes = 0.0, np.zeros((0, 0))
    for _ in range(_CORRECTIONS):
        # Newton's method for the forces that are left where the modes don't accelerate, which are smoother than
        # accelerations: light combinations of modes make these steep.
        free = compiled.accelerations(t, q, v)
        by_q, _, M = compiled.tangents(inputs, q, v, a)
        try:
            change = np.linalg.solve(np.concatenate([M[:, joints], by_q[:, at]], axis=1), M @ (a - free))
            slopes = -np.linalg.solve(M, by_q[:, at])[modes]
        except np.linalg.LinAlgError:  # the corrections have run away
            size = np.inf
            break
        a[joints] -= change[: len(joints)]
        q[at] -= change[len(joints) :]
        size = float(np.linalg.norm(change[len(joints) :]))
        if size <= _SETTLED * np.linalg.norm(q[at]) or not np.isfinite(size):
            break
    if not size <= _SETTLED * np.linalg.norm(q[at]):
        raise AccuracyError(
            f"no steady state: the modes still change by {size:.1e} after {_CORRECTIONS} corrections; the scene turns "
            "too fast for the bodies' stiffness, or bends them too far"
        )
    require_positive_mass(system, q, "in the steady state")
    if not np.linalg.eigvals(slopes).real.max(initial=-1.0) < 0:
        raise AccuracyError(
            "no steady state: a deflection grows by itself; the scene turns too fast for the bodies' stiffness"
        )
    return q
