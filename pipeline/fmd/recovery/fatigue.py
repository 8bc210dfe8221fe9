"""Fatigue of a body's surface over a motion: rainflow cycles, S–N curve, mean stress, Miner's sum, node by node.

Nodes come in the order of a bound of their damage, which needs no history: with the coordinates ``q = U c`` of a
singular value decomposition, a norm of the stress is nowhere in a stretch of time above ``Σ_j max|c_j| ‖σ_j‖``. Where
the bound is below the damage of those that are wanted, nodes are skipped; what is stated of the others doesn't depend
on it.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from threadpoolctl import threadpool_limits

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.memory import FATIGUE_NODES, FATIGUE_ROUND, FATIGUE_STRETCHES
from fmd.recovery.stress import StressHistory, von_mises

_CORRECTIONS = ("none", "goodman", "fkm")  # by the numbers in `kernels.rainflow`


@dataclass(frozen=True)
class FatigueLaw:
    """S–N curve of two straight lines in logarithms (Basquin), and the correction for mean stress.

    Attributes
    ----------
    amplitude : float
        Stress amplitude about zero at the knee [Pa].
    cycles : float
        Cycles to failure at the knee.
    slope, slope_beyond : float
        ``N = cycles (σ/amplitude)^-slope`` above and below the knee; infinity for no damage.
    correction : str
        ``none``, ``goodman`` or ``fkm``.
    constant : float
        Tensile strength [Pa] for Goodman's line, sensitivity to mean stress M, 0 to 1, for the FKM guideline.
    """

    amplitude: float
    cycles: float
    slope: float
    slope_beyond: float
    correction: str = "none"
    constant: float = 0.0

    @property
    def numbers(self) -> Array:
        """The law as the kernels take it, shape (6,)."""
        correction = float(_CORRECTIONS.index(self.correction))
        return np.array([correction, self.constant, self.amplitude, self.cycles, self.slope, self.slope_beyond])


@dataclass(frozen=True)
class FatigueLife:
    """Damage of nodes by one motion.

    Attributes
    ----------
    nodes : ndarray, shape (n_nodes,)
        Node numbers.
    damage : ndarray, shape (n_nodes,)
        Miner's sum; 0 where it was not assessed.
    assessed : ndarray of bool, shape (n_nodes,)
        False where the bound was below ``floor``.
    floor : float
        Smallest damage that is told apart: the damage of each node that has more is known.
    normals : ndarray, shape (n_nodes, 3) or (0, 3)
        Normal of the critical plane, in the body's axes.
    """

    nodes: IntArray
    damage: Array
    assessed: IntArray
    floor: float
    normals: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def repeats(self) -> Array:
        """Repeats of the motion to failure, shape (n_nodes,); those beyond ``1/floor`` are given as that."""
        known = np.maximum(self.damage, self.floor)
        return np.asarray(np.divide(1.0, known, out=np.full(len(known), np.inf), where=known > 0.0))

    def worst(self, count: int) -> IntArray:
        """Positions in ``nodes`` of those with the most damage, the most first."""
        return np.argsort(-self.damage, kind="stable")[:count]


@dataclass(frozen=True)
class _Measure:
    """A stress whose history is counted: rows of modal stress, bounds of its size, and histories to damage."""

    rows: Array  # (n_nodes, k, n_modes)
    sizes: Array  # (n_nodes, n_modes): a norm of each mode's stress that is no smaller than the stress counted
    directions: Array  # (n_planes, 3); none for signed von Mises stress


def fatigue_by_signed_von_mises(
    stress: StressHistory, law: FatigueLaw, worst: int, share: float, workers: int | None = None
) -> FatigueLife:
    """Assess the von Mises stress with the sign of the principal stress that is the largest by size.

    Parameters
    ----------
    stress : StressHistory
        Of the surface's nodes.
    worst : int
        Number of nodes whose damage is wanted, those with the most.
    share : float
        Part of the largest damage down to which damage is wanted of all nodes, 1 for the worst nodes alone.
    workers : int, optional
        Threads; all cores by default. It changes no number.
    """
    modal, q = _decorrelated(stress)
    measure = _Measure(modal, von_mises(modal), np.zeros((0, 3)))
    damage, _, assessed = _assess(measure, q, law, worst, share, workers)
    return FatigueLife(stress.nodes, damage, assessed, _floor(damage, worst, share))


def fatigue_by_critical_plane(
    stress: StressHistory,
    normals: Array,
    law: FatigueLaw,
    worst: int,
    share: float,
    planes: int = 18,
    workers: int | None = None,
) -> FatigueLife:
    """Assess the normal stress on planes across the surface, and keep the plane with the most damage.

    Parameters
    ----------
    stress, worst, share, workers
        As for `fatigue_by_signed_von_mises`.
    normals : ndarray, shape (n_nodes, 3)
        Unit normals of the surface at the nodes.
    planes : int
        Number of planes, evenly over half a turn about the surface's normal.
    """
    modal, q = _decorrelated(stress)
    axes = _tangents(normals)  # (n_nodes, 2, 3)
    full = modal[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    in_plane = np.einsum("nai,nijm,nbj->nabm", axes, full, axes, optimize=True)
    rows = np.ascontiguousarray(np.stack([in_plane[:, 0, 0], in_plane[:, 1, 1], in_plane[:, 0, 1]], axis=1))
    sizes = np.sqrt(rows[:, 0] ** 2 + rows[:, 1] ** 2 + 2.0 * rows[:, 2] ** 2)
    angles = np.pi * np.arange(planes) / planes
    c, s = np.cos(angles), np.sin(angles)
    measure = _Measure(rows, sizes, np.stack([c * c, s * s, 2.0 * c * s], axis=1))
    damage, numbers, assessed = _assess(measure, q, law, worst, share, workers)
    normal = c[numbers, None] * axes[:, 0] + s[numbers, None] * axes[:, 1]
    return FatigueLife(stress.nodes, damage, assessed, _floor(damage, worst, share), normal)


def _decorrelated(stress: StressHistory) -> tuple[Array, Array]:
    """Return modal stress (n_nodes, 6, n) and coordinates (n, n_times) of which each is alone as large as it can be."""
    _, sizes, ways = np.linalg.svd(stress.q, full_matrices=False)
    ways = ways[sizes > 1e-13 * sizes.max(initial=0.0)]
    return np.ascontiguousarray(stress.modal @ ways.T), np.ascontiguousarray(ways @ stress.q.T)


def _tangents(normals: Array) -> Array:
    """Return two unit vectors across each normal, shape (n, 2, 3)."""
    start = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = start - (start * normals).sum(axis=1, keepdims=True) * normals
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=1)


def _floor(damage: Array, worst: int, share: float) -> float:
    """Return the damage that nodes have to pass to be assessed: that of the last one wanted, or less."""
    if not len(damage):
        return 0.0
    last = np.partition(damage, -min(worst, len(damage)))[-min(worst, len(damage))]
    return float(min(last, share * damage.max()))


def _assess(
    measure: _Measure, q: Array, law: FatigueLaw, worst: int, share: float, workers: int | None
) -> tuple[Array, IntArray, IntArray]:
    """Return damage (n_nodes,), the numbers of the critical planes, and what was assessed."""
    from fmd.recovery.kernels.node_damage import damage_of_histories, damage_of_planes, sign_von_mises
    from fmd.recovery.kernels.rainflow import bound_damage

    n_nodes, (_, n_times), numbers = len(measure.rows), q.shape, law.numbers
    bounds = np.zeros(n_nodes)
    starts = np.arange(0, n_times, max(1, n_times // FATIGUE_STRETCHES))
    peaks = np.maximum.reduceat(np.abs(q), starts, axis=1)  # of each coordinate in each stretch of time
    bound_damage(measure.sizes @ peaks * (1.0 + 1e-9), np.diff(starts, append=n_times) * 1.0, numbers, bounds)
    order = np.argsort(-bounds, kind="stable")
    damage, planes = np.zeros(n_nodes), np.zeros(n_nodes, dtype=np.int64)
    assessed = np.zeros(n_nodes, dtype=bool)

    def assess(nodes: IntArray) -> None:
        rows, room, own = measure.rows[nodes], np.empty((5, n_times)), np.empty(len(nodes))
        tensors = (rows.reshape(-1, rows.shape[2]) @ q).reshape(*rows.shape[:2], n_times)
        if len(measure.directions):
            numbered = np.zeros(len(nodes), dtype=np.int64)
            damage_of_planes(tensors, measure.directions, numbers, np.empty(n_times), room, own, numbered)
            planes[nodes] = numbered
        else:
            histories = np.empty((len(nodes), n_times))
            sign_von_mises(tensors, histories)
            damage_of_histories(histories, numbers, room, own)
        damage[nodes] = own

    with threadpool_limits(1), ThreadPoolExecutor(workers or os.cpu_count()) as threads:
        for start in range(0, n_nodes, FATIGUE_ROUND):
            if bounds[order[start]] <= (_floor(damage, worst, share) if start else -math.inf):
                break
            chosen = order[start : start + FATIGUE_ROUND]
            list(threads.map(assess, [chosen[k : k + FATIGUE_NODES] for k in range(0, len(chosen), FATIGUE_NODES)]))
            assessed[chosen] = True
    return damage, planes, assessed
