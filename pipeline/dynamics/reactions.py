"""Forces and moments of the joints that close a mechanism's loops, over a motion."""

from __future__ import annotations

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.compiled_system.shared import share_system
from pipeline.dynamics.mechanism import Mechanism


def closing_reactions(mechanism: Mechanism, times: Array, q: Array, v: Array) -> dict[str, Array]:
    """Compute force [N] and moment [N m] of each joint that closes a loop on its parent and on its child.

    Where constraints are redundant, no motion tells how joints share their load; the smallest multipliers are taken.

    Parameters
    ----------
    times, q, v : ndarray, shapes (n_times,), (n_times, n_positions) and (n_times, n)
        Times [s] with positions and rates that close the loops.

    Returns
    -------
    dict of str to ndarray, shape (n_times, 2, 6)
        In space, about the joint's place on the parent and on the child, by the joints' names.
    """
    names = [joint.name for joint in mechanism.closing_joints]
    compiled = share_system(mechanism).compiled
    found = [compiled.reactions(float(t), q[k], v[k]) for k, t in enumerate(times)] if names else []
    return {name: np.array([at[name] for at in found]) for name in names}


def constraint_residual(mechanism: Mechanism, times: Array, q: Array, v: Array) -> float:
    """Return the largest gap of a mechanism's loops over a motion [m, or rad]; 0 without loops."""
    if not mechanism.closures:
        return 0.0
    compiled = share_system(mechanism).compiled
    return max(float(np.abs(compiled.gaps(float(t), q[k], v[k])[0]).max(initial=0.0)) for k, t in enumerate(times))
