"""Steady state of a mechanism: where loads and rotation leave the modes at rest in their frames."""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.core.limits import newton as limits
from fmd.core.newton import Tolerance, largest, solve
from fmd.dynamics.compiled_system.positive_mass import require_positive_mass
from fmd.dynamics.compiled_system.system import CompiledSystem

_TOLERANCE = Tolerance(limits.STEADY_CORRECTIONS, relative=limits.STEADY)


def find_steady_state(system: CompiledSystem, q: Array, v: Array) -> Array:
    """Find positions (n_positions,) where rates v and the loads of the start leave the modes at rest in their frames.

    Raises
    ------
    AccuracyError
        There is no such state: something turns too fast for its stiffness, or deflects so far that the mass matrix
        isn't positive definite.
    """
    mechanism, compiled = system.mechanism, system.compiled
    modes = np.concatenate([mechanism.modes_of(k) for k in range(len(mechanism.links))])
    joints = np.setdiff1d(np.arange(mechanism.n), modes)
    at, inputs = modes + mechanism.position_shift, compiled.signal_values(0.0)
    State = tuple[Array, Array]  # positions, and accelerations, which are 0 in the modes

    # The forces that are left where the modes don't accelerate are smoother than accelerations: massless
    # combinations of modes make these steep.
    def residual(state: State) -> Array:
        return state[1] - compiled.accelerations(0.0, state[0], v)

    def slopes(state: State) -> tuple[Array, Array]:
        by_q, _, M = compiled.tangents(inputs, state[0], v, state[1])
        return by_q[:, at], M

    def correction(state: State, left: Array) -> Array:
        by_modes, M = slopes(state)
        return -np.linalg.solve(np.concatenate([M[:, joints], by_modes], axis=1), M @ left)

    def move(state: State, change: Array) -> State:
        q, a = state[0].copy(), state[1].copy()
        a[joints] += change[: len(joints)]
        q[at] += change[len(joints) :]
        return q, a

    a = np.zeros(mechanism.n)
    a[joints] = compiled.accelerations(0.0, q, v)[joints]
    found = solve(
        (q, a),
        residual,
        correction,
        move,
        _TOLERANCE,
        size=lambda change: largest(change[len(joints) :]),
        scale=lambda state: largest(state[0][at]),
    )
    if not found.converged:
        raise AccuracyError(
            f"no steady state: the modes still change by {found.size:.1e} after {_TOLERANCE.corrections} corrections; "
            "the scene turns too fast for the bodies' stiffness, or bends them too far"
        )
    q = found.state[0]
    require_positive_mass(system, q, "in the steady state")
    by_modes, M = slopes(found.state)
    if not np.linalg.eigvals(-np.linalg.solve(M, by_modes)[modes]).real.max(initial=-1.0) < 0:
        raise AccuracyError(
            "no steady state: a deflection grows by itself; the scene turns too fast for the bodies' stiffness"
        )
    return q
