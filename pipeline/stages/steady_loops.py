"""Steady start of mechanisms with loops: bodies deformed as loads and rotation hold them, with closed joints."""

from __future__ import annotations

import numpy as np

from pipeline.core.arrays import Array
from pipeline.core.errors import AccuracyError
from pipeline.dynamics.compiled_system.positive_mass import require_positive_mass
from pipeline.dynamics.compiled_system.system import CompiledSystem
from pipeline.integrators.protocol import evaluate, move_positions, project_state
from pipeline.stages.assembly import constraint_matrix

_SETTLED = 1e-10
_NOTHING = 1e-15  # of modal coordinates [m kg^½]
_CORRECTIONS = 30
_TRIAL = 1e-6  # modal coordinates by which slopes are tried [m kg^½]
_DEPENDENT = 1e-8  # of the largest singular value
_DEFORMING = 1e-6  # of a unit motion: what deforms less is a motion of joints alone


def find_steady_loop(system: CompiledSystem, q: Array, v: Array, t: float = 0.0) -> tuple[Array, Array]:
    """Find positions and rates where loads at t [s] and the rates leave the modes at rest, with all loops closed.

    Motions that deform nothing stay out: a crank keeps its angle, and the joints behind it follow the deformed bodies.

    Raises
    ------
    AccuracyError
        There is no such state: something turns too fast for its stiffness, or deflects so far that the mass matrix
        isn't positive definite.
    """
    mechanism = system.mechanism
    modes = np.concatenate([mechanism.modes_of(k) for k in range(len(mechanism.links))])
    size, settled, slopes = np.inf, False, np.zeros((0, 0))
    for _ in range(_CORRECTIONS if len(modes) else 0):
        ways, across = _deforming_ways(system, q, modes, t)
        slopes = np.column_stack(
            [across @ (_modal(system, q, v, t, way, modes) - _modal(system, q, v, t, -way, modes)) for way in ways.T]
        ) / (2.0 * _TRIAL)
        try:
            change = ways @ np.linalg.solve(slopes, across @ _modal(system, q, v, t, 0.0 * ways[:, 0], modes))
        except np.linalg.LinAlgError:  # the corrections have run away
            break
        q, _ = project_state(system.parameters, t, move_positions(system.parameters, q, -change), v)
        size = float(np.linalg.norm(change[modes]))
        settled = size <= max(_SETTLED * float(np.linalg.norm(q[modes + system.n_positions - system.n])), _NOTHING)
        if settled or not np.isfinite(q).all():
            break
    if len(modes) and not (settled and np.linalg.eigvals(slopes).real.max(initial=-1.0) < 0):
        raise AccuracyError(
            f"no steady state: the modes still change by {size:.1e} after {_CORRECTIONS} corrections, or a "
            "deflection grows by itself; the scene turns too fast for the bodies' stiffness"
        )
    require_positive_mass(system, q, "in the steady state")
    return project_state(system.parameters, t, q, v)


def _deforming_ways(system: CompiledSystem, q: Array, modes: Array, t: float) -> tuple[Array, Array]:
    """Return motions (n, k) that keep the loops closed and deform bodies, and their deformations (k, n_modes)."""
    J = constraint_matrix(system, q, t)
    scaled = J / np.maximum(np.linalg.norm(J, axis=1), 1e-300)[:, None]
    _, sizes, directions = np.linalg.svd(scaled)
    free = directions[int((sizes > _DEPENDENT * sizes.max(initial=0.0)).sum()) :].T
    across, share, turn = np.linalg.svd(free[modes], full_matrices=False)
    kept = share > _DEFORMING
    return free @ turn[kept].T / share[kept], across[:, kept].T


def _modal(system: CompiledSystem, q: Array, v: Array, t: float, way: Array, modes: Array) -> Array:
    """Return the modes' accelerations a trial step along a motion, with closed loops."""
    q, v = project_state(system.parameters, t, move_positions(system.parameters, q, _TRIAL * way), v)
    a = np.zeros(system.n)
    evaluate(system.parameters, t, q, v, a)
    return np.asarray(a[modes])
