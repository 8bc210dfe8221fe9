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
from dataclasses import field, replace

import numpy as np
from threadpoolctl import threadpool_limits

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.memory import FATIGUE_NODES, FATIGUE_ROUND, FATIGUE_STRETCHES
from fmd.recovery.stress import StressHistory, von_mises

_CORRECTIONS = ("none", "goodman", "fkm")  # by the numbers in `kernels.rainflow`


@dataclass(frozen=True)
class FatigueLaw:
    """S–N curve of two straight lines in logarithms (Basquin), and the correction for mean stress."""

    amplitude: float  # stress amplitude about zero at the knee [Pa]
    cycles: float  # cycles to failure at the knee
    slope: float  # ``N = cycles (σ/amplitude)^-slope`` above the knee; infinity for no damage
    slope_beyond: float  # the same below the knee
    correction: str = "none"  # ``none``, ``goodman`` or ``fkm``
    # Tensile strength [Pa] for Goodman's line, sensitivity to mean stress M, 0 to 1, for the FKM guideline.
    constant: float = 0.0
    findley: float = 0.25  # coefficient k of the normal stress in Findley's parameter

    @property
    def numbers(self) -> Array:
        """The law as the kernels take it, shape (7,)."""
        knee = (self.amplitude, self.cycles, self.slope, self.slope_beyond)
        return np.array([_CORRECTIONS.index(self.correction), self.constant, *knee, self.findley], dtype=float)

    def stronger(self, share: float) -> FatigueLaw:
        """Return the law of a material that bears stress so many times as large."""
        constant = share * self.constant if self.correction == "goodman" else self.constant
        return replace(self, amplitude=share * self.amplitude, constant=constant)


@dataclass(frozen=True)
class FatigueLife:
    """Damage of nodes by one motion."""

    nodes: IntArray  # (n_nodes,): node numbers
    damage: Array  # (n_nodes,): Miner's sum; 0 where it was not assessed
    assessed: IntArray  # (n_nodes,): false where the bound was below ``floor``
    floor: float  # smallest damage that is told apart: the damage of each node that has more is known
    # (n_nodes, 3) or (0, 3): normal of the critical plane, in the body's axes
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
class _SignedVonMises:
    """Von Mises stress with the sign of the principal stress that is the largest by size."""

    rows: Array  # (n_nodes, 6, n_modes)

    def bounds(self, peaks: Array) -> Array:
        """Return what the stress is nowhere above in stretches of time, by the peaks of the coordinates there."""
        return np.asarray(von_mises(self.rows) @ peaks)

    def damage(self, tensors: Array, numbers: Array, damage: Array, planes: IntArray) -> None:
        """Fill damage and numbers of planes of nodes by their stress, (n_nodes, k, n)."""
        from fmd.recovery.kernels.node_damage import damage_of_histories, sign_von_mises

        histories = np.empty((len(tensors), tensors.shape[2]))
        sign_von_mises(tensors, histories)
        damage_of_histories(histories, numbers, np.empty((5, tensors.shape[2])), damage)

    def normal(self, planes: IntArray) -> Array:
        """Return the critical planes' normals; there are none."""
        return np.zeros((0, 3))


@dataclass(frozen=True)
class _NormalStress:
    """Normal stress on planes that stand on the surface."""

    rows: Array  # (n_nodes, 3, n_modes): along both axes of the surface, and the shear stress between them
    axes: Array  # (n_nodes, 2, 3)
    n_azimuths: int

    @property
    def azimuths(self) -> Array:
        """Angles of the normals in the surface, shape (n_azimuths,)."""
        return np.pi * np.arange(self.n_azimuths) / self.n_azimuths

    @property
    def directions(self) -> Array:
        """Coefficients of the rows in the planes' normal stress, shape (n_azimuths, 3)."""
        c, s = np.cos(self.azimuths), np.sin(self.azimuths)
        return np.stack([c * c, s * s, 2.0 * c * s], axis=1)

    def bounds(self, peaks: Array) -> Array:
        """Return what the stress is nowhere above in stretches of time, by the peaks of the coordinates there."""
        sizes = np.sqrt(self.rows[:, 0] ** 2 + self.rows[:, 1] ** 2 + 2.0 * self.rows[:, 2] ** 2)
        return np.asarray(sizes @ peaks)

    def damage(self, tensors: Array, numbers: Array, damage: Array, planes: IntArray) -> None:
        """Fill damage and numbers of planes of nodes by their stress, (n_nodes, k, n)."""
        from fmd.recovery.kernels.node_damage import damage_of_planes

        n = tensors.shape[2]
        damage_of_planes(tensors, self.directions, numbers, np.empty(n), np.empty((5, n)), damage, planes)

    def normal(self, planes: IntArray) -> Array:
        """Return the critical planes' normals, shape (n_nodes, 3)."""
        angle = self.azimuths[planes]
        return np.cos(angle)[:, None] * self.axes[:, 0] + np.sin(angle)[:, None] * self.axes[:, 1]


@dataclass(frozen=True)
class _Findley(_NormalStress):
    """Shear stress of each cycle on a plane, and its largest normal stress there."""

    k: float

    def bounds(self, peaks: Array) -> Array:
        """Return what the parameter is nowhere above in stretches of time, as a uniaxial stress about zero.

        Half the difference of two principal stresses is at most 1/√2 of the tensor's norm; the normal stress of a cycle
        may be that of another stretch.
        """
        norms = super().bounds(peaks)
        worst = norms.max(axis=1, keepdims=True)
        return np.asarray(2.0 * (np.sqrt(0.5) * norms + self.k * worst) / (self.k + np.hypot(1.0, self.k)))

    def damage(self, tensors: Array, numbers: Array, damage: Array, planes: IntArray) -> None:
        """Fill damage and numbers of planes of nodes by their stress, (n_nodes, k, n)."""
        from fmd.recovery.kernels.node_damage import damage_by_findley

        n = tensors.shape[2]
        damage_by_findley(tensors, self.directions, numbers, np.empty((4, n)), np.empty((5, n)), damage, planes)

    def normal(self, planes: IntArray) -> Array:
        """Return the critical planes' normals, shape (n_nodes, 3)."""
        lean = np.where(planes % 2 == 1, np.pi / 4 + 0.5 * np.arctan(self.k), np.pi / 2)[:, None]
        flat = super().normal(planes // 2)
        return np.asarray(np.sin(lean) * flat + np.cos(lean) * np.cross(self.axes[:, 0], self.axes[:, 1]))


_Measure = _SignedVonMises | _NormalStress


def fatigue_by_signed_von_mises(stress: StressHistory, law: FatigueLaw, worst: int, share: float) -> FatigueLife:
    """Assess the von Mises stress with the sign of the principal stress that is the largest by size.

    The damage of ``worst`` nodes is wanted, those with the most, and of all others down to ``share`` of the largest, 1
    for the worst alone.
    """
    modal, q = _decorrelated(stress)
    return _assess(_SignedVonMises(modal), stress.nodes, q, law, worst, share)


def fatigue_by_critical_plane(
    stress: StressHistory, normals: Array, law: FatigueLaw, worst: int, share: float, planes: int = 18
) -> FatigueLife:
    """Assess the normal stress on planes across the surface, and keep the plane with the most damage.

    There are ``planes`` of them, evenly over half a turn about the surface's unit normals (n_nodes, 3); the rest is as
    for `fatigue_by_signed_von_mises`.
    """
    rows, axes, q = _in_surface(stress, normals)
    return _assess(_NormalStress(rows, axes, planes), stress.nodes, q, law, worst, share)


def fatigue_by_findley(
    stress: StressHistory, normals: Array, law: FatigueLaw, worst: int, share: float, planes: int = 18
) -> FatigueLife:
    """Assess Findley's parameter ``τ_a + k σ_n`` on planes of all directions, and keep the plane with the most damage.

    Parameters are those of `fatigue_by_critical_plane`; ``planes`` stand on the surface, and as many lean (Findley, J
    Eng Ind 81 (1959) 301-306).
    """
    rows, axes, q = _in_surface(stress, normals)
    return _assess(_Findley(rows, axes, planes, law.findley), stress.nodes, q, law, worst, share)


def _in_surface(stress: StressHistory, normals: Array) -> tuple[Array, Array, Array]:
    """Return modal stress in the surface (n_nodes, 3, n), the surface's axes there (n_nodes, 2, 3), and coordinates."""
    modal, q = _decorrelated(stress)
    axes = _tangents(normals)
    full = modal[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    in_plane = np.einsum("nai,nijm,nbj->nabm", axes, full, axes, optimize=True)
    rows = np.stack([in_plane[:, 0, 0], in_plane[:, 1, 1], in_plane[:, 0, 1]], axis=1)
    return np.ascontiguousarray(rows), axes, q


def _decorrelated(stress: StressHistory) -> tuple[Array, Array]:
    """Return modal stress (n_nodes, 6, n) and coordinates (n, n_times) of which each is alone as large as it can be."""
    _, sizes, directions = np.linalg.svd(stress.q, full_matrices=False)
    directions = directions[sizes >= 1e-13 * sizes.max(initial=0.0)]  # all of them at rest
    return np.ascontiguousarray(stress.modal @ directions.T), np.ascontiguousarray(directions @ stress.q.T)


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


def _assess(measure: _Measure, nodes: IntArray, q: Array, law: FatigueLaw, worst: int, share: float) -> FatigueLife:
    """Assess nodes in the order of the bounds of their damage, down to what is wanted."""
    from fmd.recovery.kernels.rainflow import bound_damage

    n_nodes, n_times, numbers = len(measure.rows), q.shape[1], law.numbers
    bounds = np.zeros(n_nodes)
    starts = np.arange(0, n_times, max(1, n_times // FATIGUE_STRETCHES))
    peaks = np.maximum.reduceat(np.abs(q), starts, axis=1)  # of each coordinate in each stretch of time
    stresses = measure.bounds(peaks) * (1.0 + 1e-9)
    bound_damage(stresses, np.diff(starts, append=n_times) * 1.0, numbers, bounds)
    order = np.argsort(-bounds, kind="stable")
    damage, planes = np.zeros(n_nodes), np.zeros(n_nodes, dtype=np.int64)
    assessed = np.zeros(n_nodes, dtype=bool)

    def assess(chosen: IntArray) -> None:
        rows, own, numbered = measure.rows[chosen], np.empty(len(chosen)), np.zeros(len(chosen), dtype=np.int64)
        tensors = (rows.reshape(-1, rows.shape[2]) @ q).reshape(*rows.shape[:2], n_times)
        measure.damage(tensors, numbers, own, numbered)
        damage[chosen], planes[chosen] = own, numbered

    with threadpool_limits(1), ThreadPoolExecutor(os.cpu_count()) as threads:
        for start in range(0, n_nodes, FATIGUE_ROUND):
            if bounds[order[start]] <= (_floor(damage, worst, share) if start else -math.inf):
                break
            chosen = order[start : start + FATIGUE_ROUND]
            list(threads.map(assess, [chosen[k : k + FATIGUE_NODES] for k in range(0, len(chosen), FATIGUE_NODES)]))
            assessed[chosen] = True
    return FatigueLife(nodes, damage, assessed, _floor(damage, worst, share), measure.normal(planes))
