"""Rest of a mechanism under all loads at the start: joints, modes and loops in equilibrium."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.core.arrays import Array
from pipeline.core.errors import AccuracyError
from pipeline.dynamics.compiled_system.system import CompiledSystem
from pipeline.integrators.protocol import evaluate, evaluate_projection, move_positions
from pipeline.stability.tangent import differentiate
from pipeline.stages.assembly import free_directions

_CORRECTIONS = 200
_SETTLED = 1e-11  # last correction [rad or m, or modal coordinate], beside the largest position
_FIRST, _FARTHEST = 0.05, 0.3  # motion of the first correction, and of any [rad or m]
_NUDGE = 1e-6
_UNSTABLE = 1e-6  # of the fastest motion: an eigenvalue above is a motion that grows


def find_equilibrium(system: CompiledSystem, q: Array, t: float = 0.0) -> Array:
    """Find positions (n_positions,) at which nothing accelerates at rest, from positions that close all loops.

    The accelerations at rest are the way down from the potential energy, steepest by the mass matrix. It is followed by
    implicit steps that lengthen as accelerations fall, and end as Newton's (pseudo-transient continuation: Kelley &
    Keyes, SIAM J Numer Anal 35, 1998). So the rest is one that a slowly damped motion would come to.

    Raises
    ------
    AccuracyError
        There is none: something keeps accelerating, or the state found isn't stable, as of a buckled part.
    """
    p, still = system.parameters, np.zeros(system.n)

    def accelerations(change: Any) -> Array:
        a = np.zeros(system.n)
        evaluate(p, t, move_positions(p, q, change), still, a)
        return a

    none = np.zeros(system.n)
    a = accelerations(none)
    size = float(np.abs(a).max(initial=0.0))
    pace = size / _FIRST  # 1 over the step in pseudo-time, which is one squared
    for _ in range(_CORRECTIONS):
        if not np.isfinite(size):
            break
        slopes = differentiate(accelerations, none, np.full(system.n, _NUDGE))
        free = free_directions(system, q)
        change = free @ np.linalg.lstsq((pace * np.eye(system.n) - slopes) @ free, a, rcond=1e-12)[0]
        farthest = float(np.abs(change).max(initial=0.0))
        change = change * min(1.0, _FARTHEST / max(farthest, 1e-300))
        q, rates = move_positions(p, q, change), still.copy()
        evaluate_projection(p, t, q, rates)
        a, before = accelerations(none), size
        size = float(np.abs(a).max(initial=0.0))
        pace *= min(10.0, max(size / max(before, 1e-300), 1e-3))
        if farthest <= _SETTLED * max(1.0, float(np.abs(q).max(initial=0.0))):
            _require_stable(free.T @ slopes @ free)
            return q
    raise AccuracyError(
        f"no equilibrium: accelerations of {size:.3g} (SI) are left after {_CORRECTIONS} "
        "corrections; something falls, turns or slides without end under the loads of the start, or is about to buckle"
    )


def _require_stable(slopes: Array) -> None:
    """Raise ``AccuracyError`` if a motion grows by itself from where nothing accelerates."""
    growing = np.linalg.eigvals(slopes)
    fastest = float(np.abs(growing).max(initial=0.0))
    if growing.real.max(initial=0.0) > _UNSTABLE * fastest:
        raise AccuracyError(
            "the equilibrium isn't stable: from where nothing accelerates a motion grows by itself, as of a part that "
            "buckles or a body that stands on its head; start nearer to the stable one"
        )
