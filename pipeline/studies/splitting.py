"""Which coordinates sub-cycling may take slowly, and how slowly, for a wanted error.

Central difference with a step h advances an oscillation ω by a phase that is wrong by ``(ω h)²/24`` of itself. What a
load bends, it bends mode by mode as ``1/ω²``, so the high modes of a motion are small by ``(ω₁/ω)²`` against the lowest
one; their errors count by that. The ratio of the two steps is then bounded for each split, and the split with the least
work by the solvers' measured cost is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.checks import Array
from pipeline.dynamics.tree import Tree

_MOST_SUBSTEPS = 50
_STABLE = 0.8  # of the stability limit 2/ω
_STEPS_OVER_MOTION = 200  # slow steps over the duration, at least


@dataclass(frozen=True)
class Split:
    """A choice.

    Attributes
    ----------
    frequency_hz : float
        Coordinates below it are slow [Hz].
    substeps : int
        Fast steps in a slow one.
    step : float
        Fast step [s].
    """

    frequency_hz: float
    substeps: int
    step: float


def split_at(tree: Tree, frequency_hz: float) -> tuple[list[str], dict[str, int]]:
    """Fast joints and numbers of slow modes of a tree if every coordinate below a frequency is slow."""
    own = tree.frequencies_hz
    fast_joints = [
        link.name for k, link in enumerate(tree.links) if link.n_rates == 1 and own[tree.layout.rate[k]] >= frequency_hz
    ]
    slow_modes = {
        link.name: int(np.count_nonzero(own[tree.modes_of(k)] < frequency_hz)) for k, link in enumerate(tree.links)
    }
    return fast_joints, slow_modes


def choose_split(tree: Tree, error: float, duration: float, step: float | None = None) -> Split:
    """Choose the split, the ratio and, if none is given, the fast step.

    Parameters
    ----------
    error : float
        Wanted, relative to the largest deformation.
    duration : float
        Of the motion [s].
    step : float, optional
        Fast step [s].
    """
    omega = np.sort(2 * np.pi * tree.frequencies_hz)
    stiff = omega[omega > 0]
    if not stiff.size:
        return Split(np.inf, 1, step or duration / _STEPS_OVER_MOTION)
    limits = largest_steps(omega, float(stiff[0]), error, duration)
    highest = 2 * _STABLE / tree.highest_frequency
    step = step or float(min(highest, limits.min()))
    best = Split(0.0, 1, step)
    least = _cost(omega.size, omega.size) / step
    for n_slow in range(omega.size):
        if n_slow and omega[n_slow] <= 1.001 * omega[n_slow - 1]:
            continue  # no gap
        substeps = int(min(limits[:n_slow].min(initial=duration / _STEPS_OVER_MOTION) / step, _MOST_SUBSTEPS))
        if substeps < 1:
            break
        n_fast = omega.size - n_slow
        work = (_cost(omega.size, n_fast) + (substeps - 1) * _fast_cost(n_fast)) / (substeps * step)
        if work < least and n_fast:
            below = omega[n_slow - 1] if n_slow else 0.0
            least, best = work, Split(float(0.5 * (below + omega[n_slow]) / (2 * np.pi)), substeps, step)
    return best


def largest_steps(omega: Array, lowest: float, error: float, duration: float) -> Array:
    """Step of each oscillation that keeps to its stability limit and to the wanted error [s], shape (n,).

    ``ω T (ω h)²/24 · (ω₁/ω)² ≤ error``.
    """
    moving = np.maximum(omega, 1e-150)
    accurate = np.sqrt(24 * error / (duration * moving * lowest**2))
    return np.asarray(np.minimum(accurate, 2 * _STABLE / moving))


def _cost(n: int, n_fast: int) -> float:
    """Measured on one core [s]: a solution of the whole, and what is held of it."""
    return 0.9e-6 + 30e-9 * n + 1.2e-9 * n**2 + 0.5e-9 * n_fast**2


def _fast_cost(n: int) -> float:
    return 5e-9 + 4e-9 * n + 0.5e-9 * n**2
