"""Steady state of a mechanism with loops: modes at rest in their frames, joints where the loops close."""

from __future__ import annotations

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.core.errors import AccuracyError
from pipeline.dynamics.compiled_system.system import CompiledSystem
from pipeline.integrators.protocol import evaluate, move_positions
from pipeline.stability.tangent import differentiate

_SETTLED = 1e-9
_CORRECTIONS = 30
_NUDGE = 1e-6  # of positions, in SI units
_ROUND_OFF = 1e-14


def find_closed_steady_state(
    system: CompiledSystem, q: Array, v: Array, following: IntArray, t: float = 0.0
) -> tuple[Array, Array]:
    """Find where loads and rotation leave the modes at rest, with rates at which the loops stay closed.

    Parameters
    ----------
    q, v : ndarray, shapes (n_positions,) and (n,)
        Positions and rates that close the loops.
    following : ndarray of int
        Rates of the joints that move to close the loops as bodies deform.

    Raises
    ------
    AccuracyError
        There is no such state: something turns too fast for its stiffness.
    """
    mechanism = system.mechanism
    modes = np.concatenate([mechanism.modes_of(k) for k in range(len(mechanism.links))])
    moving = np.concatenate([modes, following])
    omega = np.concatenate([link.omega for link in mechanism.links])

    def moved(by: Array) -> Array:
        change = np.zeros(system.n)
        change[moving] = by
        return move_positions(system.parameters, q, change)

    def left(by: Array) -> Array:
        """Return accelerations of the modes, as deflections that they would hold, and the gaps."""
        positions, a = moved(by), np.zeros(system.n)
        rates = _with_closed_rates(system, positions, v, following, t)
        evaluate(system.parameters, t, positions, rates, a)
        return np.concatenate([a[modes] / omega**2, system.compiled.gaps(t, positions, rates)[0]])

    none, size = np.zeros(len(moving)), np.inf
    for _ in range(_CORRECTIONS):
        slopes = differentiate(left, none, np.full(len(moving), _NUDGE))
        change = np.asarray(-np.linalg.lstsq(slopes, left(none), rcond=1e-10)[0], dtype=float)
        q, size = moved(change), float(np.abs(change).max(initial=0.0))
        reached = float(np.abs(q[modes + mechanism.n_positions - mechanism.n]).max(initial=0.0))
        if size <= max(_SETTLED * reached, _ROUND_OFF):
            return q, _with_closed_rates(system, q, v, following, t)
    raise AccuracyError(
        f"no steady state: modes and joints still change by {size:.1e} after {_CORRECTIONS} corrections; the scene "
        "turns too fast for the bodies' stiffness"
    )


def _with_closed_rates(system: CompiledSystem, q: Array, v: Array, following: IntArray, t: float) -> Array:
    """Return rates with which the loops stay closed, those of some joints changed."""
    J = system.compiled.constraint_matrix(t, q)[:, following]
    _, opening = system.compiled.gaps(t, q, v)
    out = v.copy()
    out[following] -= np.linalg.lstsq(J, opening, rcond=1e-9)[0]
    return out
