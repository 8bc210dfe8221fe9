"""Steady state of a mechanism with loops: modes at rest in their frames, joints where the loops close."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError
from fmd.core.limits import newton as limits
from fmd.core.newton import Tolerance, largest, solve
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.protocol import move_positions
from fmd.stability.tangent import differentiate

_TOLERANCE = Tolerance(limits.STEADY_CORRECTIONS, relative=limits.LOOPS_STEADY, absolute=limits.LOOPS_ROUND_OFF)


def find_closed_steady_state(
    system: CompiledSystem, q: Array, v: Array, groups: Sequence[IntArray], t: float = 0.0
) -> tuple[Array, Array]:
    """Find where loads and rotation leave the modes at rest, with rates at which the loops stay closed.

    Newton's method for the forces and the residuals that are left where the modes don't accelerate. Accelerations would
    hide them: light combinations of modes take next to no force.

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
    pull = 1 / np.maximum(np.abs(_constraints(system, q, t)[0] / forces_of).max(axis=1), limits.LOOPS_ROUND_OFF)

    State = tuple[Array, Array]  # positions; accelerations of joints and multipliers

    def residual(state: State) -> Array:
        """Return the forces, accelerations of residuals and residuals that are left."""
        (positions, others), a = state, np.zeros(n)
        J, rest_of_rates = _constraints(system, positions, t)
        rates = _close_rates((J, rest_of_rates), v, following)
        a[joints] = softest * others[: len(joints)]
        forces = system.compiled.residual(t, positions, rates, a) - J.T @ (pull * others[len(joints) :])
        parting = J @ a + _residual_accelerations(system, positions, rates, t)
        return np.concatenate(
            [forces / forces_of, parting / softest, system.compiled.residuals(t, positions, rates)[0]]
        )

    def move(state: State, by: Array) -> State:
        change = np.zeros(n)
        change[moving] = by[:k]
        return move_positions(system.parameters, state[0], change), state[1] + by[k:]

    def correction(state: State, left: Array) -> Array:
        none = np.zeros(k + len(state[1]))
        slopes = differentiate(lambda by: residual(move(state, by)), none, np.full(len(none), limits.NUDGE))
        return np.asarray(-np.linalg.lstsq(slopes, left, rcond=limits.LOOPS_DEPENDENT)[0])

    def reached(state: State) -> float:
        return largest(state[0][modes + mechanism.n_positions - n])

    start = q, np.zeros(len(joints) + len(pull))
    found = solve(start, residual, correction, move, _TOLERANCE, size=lambda change: largest(change[:k]), scale=reached)
    q = found.state[0]
    if found.converged and found.residual <= limits.LOOPS_AT_REST * reached(found.state) + limits.LOOPS_NO_FORCE:
        return q, _close_rates(_constraints(system, q, t), v, following)
    raise AccuracyError(
        f"no steady state: modes and joints still change by {found.size:.1e}, and forces of {found.residual:.1e} of "
        "what would deflect a mode by 1 are left; the scene turns too fast for the bodies' stiffness"
    )


def _constraints(system: CompiledSystem, q: Array, t: float) -> tuple[Array, Array]:
    """Return J (n_rows, n) and the rest of the residuals' rates ``J v + …`` (n_rows,).

    It is found by one rate after the other: by way of the inverse mass matrix, light combinations of modes spoil it.
    """
    none = np.zeros(system.n)
    _, rest = system.compiled.residuals(t, q, none)
    return np.stack([system.compiled.residuals(t, q, one)[1] - rest for one in np.eye(system.n)], axis=1), rest


def _close_rates(constraints: tuple[Array, Array], v: Array, following: IntArray) -> Array:
    """Return rates with which the loops stay closed, those of some joints changed."""
    J, rest = constraints
    out = v.copy()
    out[following] -= np.linalg.lstsq(J[:, following], J @ v + rest, rcond=limits.DEPENDENT_DIRECTION)[0]
    return out


def _residual_accelerations(system: CompiledSystem, q: Array, v: Array, t: float) -> Array:
    """Return the accelerations of the residuals where no coordinate accelerates, (n_rows,)."""
    h = limits.LOOPS_MOMENT / max(1.0, largest(v))

    def rates(s: float) -> Array:
        return system.compiled.residuals(t + s, move_positions(system.parameters, q, s * v), v)[1]

    return np.asarray((rates(h) - rates(-h)) / (2 * h))
