"""Steady state of a mechanism with loops: modes at rest in their frames, joints where the loops close."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.protocol import move_positions
from fmd.stability.tangent import differentiate

_SETTLED, _AT_REST = 1e-7, 1e-6  # last correction, and what is left of forces, beside the largest deflection
_CORRECTIONS = 30
_NUDGE = 1e-6  # of positions, in SI units
_MOMENT = 1e-5  # rad or m: how far rates move the mechanism where gaps are differentiated
_ROUND_OFF, _NOTHING = 1e-14, 1e-12


def find_closed_steady_state(
    system: CompiledSystem, q: Array, v: Array, groups: Sequence[IntArray], t: float = 0.0
) -> tuple[Array, Array]:
    """Find where loads and rotation leave the modes at rest, with rates at which the loops stay closed.

    Newton's method for the forces and the gaps that are left where the modes don't accelerate. Accelerations would hide
    them: light combinations of modes take next to no force.

    Parameters
    ----------
    q, v : ndarray, shapes (n_positions,) and (n,)
        Positions and rates that close the loops.
    groups : sequence of ndarray of int
        Rates of the joints that move to close the loops as bodies deform; each is tried in turn.

    Raises
    ------
    AccuracyError
        There is no such state: something turns too fast for its stiffness.
    """
    for following in groups[:-1]:
        with suppress(AccuracyError, np.linalg.LinAlgError):
            return _find(system, q, v, following, t)
    return _find(system, q, v, groups[-1], t)


def _find(system: CompiledSystem, q: Array, v: Array, following: IntArray, t: float) -> tuple[Array, Array]:
    """Find the state with some joints that move."""
    mechanism, n = system.mechanism, system.n
    modes = np.concatenate([mechanism.modes_of(k) for k in range(len(mechanism.links))])
    if not len(modes):
        return q, _close_rates(_constraints(system, q, t), v, following)
    joints = np.setdiff1d(np.arange(n), modes)
    moving, k = np.concatenate([modes, following]), len(modes) + len(following)
    stiffness = np.concatenate([link.omega for link in mechanism.links]) ** 2
    softest = float(stiffness.min())
    forces_of = np.empty(n)  # what deflects a mode, or moves a joint about as much, by 1
    forces_of[modes] = stiffness
    forces_of[joints] = softest * system.mass_matrix(q).diagonal()[joints]
    pull = 1 / np.maximum(np.abs(_constraints(system, q, t)[0] / forces_of).max(axis=1), _ROUND_OFF)

    def moved(by: Array) -> Array:
        change = np.zeros(n)
        change[moving] = by
        return move_positions(system.parameters, q, change)

    def left(x: Array) -> Array:
        """Return the forces, accelerations of gaps and gaps left: by positions, joint accelerations and multipliers."""
        positions, a = moved(x[:k]), np.zeros(n)
        J, rest_of_rates = _constraints(system, positions, t)
        rates = _close_rates((J, rest_of_rates), v, following)
        a[joints] = softest * x[k : k + len(joints)]
        forces = system.compiled.residual(t, positions, rates, a) - J.T @ (pull * x[k + len(joints) :])
        parting = J @ a + _gap_accelerations(system, positions, rates, t)
        return np.concatenate([forces / forces_of, parting / softest, system.compiled.gaps(t, positions, rates)[0]])

    x, size, rest = np.zeros(k + len(joints) + len(pull)), np.inf, np.inf
    for _ in range(_CORRECTIONS):
        slopes = differentiate(left, x, np.full(len(x), _NUDGE))
        change = np.asarray(-np.linalg.lstsq(slopes, left(x), rcond=1e-10)[0], dtype=float)
        q, size = moved(change[:k]), float(np.abs(change[:k]).max(initial=0.0))
        x[k:] += change[k:]
        reached = float(np.abs(q[modes + mechanism.n_positions - n]).max())
        rest = float(np.abs(left(x)).max())
        if size <= max(_SETTLED * reached, _ROUND_OFF):
            if rest <= _AT_REST * reached + _NOTHING:
                return q, _close_rates(_constraints(system, q, t), v, following)
            break  # no further correction would help
    raise AccuracyError(
        f"no steady state: modes and joints still change by {size:.1e}, and forces of {rest:.1e} of what would deflect "
        "a mode by 1 are left; the scene turns too fast for the bodies' stiffness"
    )


def _constraints(system: CompiledSystem, q: Array, t: float) -> tuple[Array, Array]:
    """Return J (n_rows, n) and the rest of the gaps' rates ``J v + …`` (n_rows,).

    It is found by one rate after the other: by way of the inverse mass matrix, light combinations of modes spoil it.
    """
    none = np.zeros(system.n)
    _, rest = system.compiled.gaps(t, q, none)
    return np.stack([system.compiled.gaps(t, q, one)[1] - rest for one in np.eye(system.n)], axis=1), rest


def _close_rates(constraints: tuple[Array, Array], v: Array, following: IntArray) -> Array:
    """Return rates with which the loops stay closed, those of some joints changed."""
    J, rest = constraints
    out = v.copy()
    out[following] -= np.linalg.lstsq(J[:, following], J @ v + rest, rcond=1e-9)[0]
    return out


def _gap_accelerations(system: CompiledSystem, q: Array, v: Array, t: float) -> Array:
    """Return the accelerations of the gaps where no coordinate accelerates, (n_rows,)."""
    h = _MOMENT / max(1.0, float(np.abs(v).max(initial=0.0)))

    def rates(s: float) -> Array:
        return system.compiled.gaps(t + s, move_positions(system.parameters, q, s * v), v)[1]

    return np.asarray((rates(h) - rates(-h)) / (2 * h))
