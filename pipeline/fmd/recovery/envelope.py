"""Envelope of the stress over a whole motion, node by node, without its history.

Stress is a product of modal stress and modal coordinates. It is formed for a few nodes and output times at once, so
that it stays in the processor's cache, and what is left of it are the extremes.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.memory import ENVELOPE_FRAMES, ENVELOPE_NODES
from fmd.core.limits.recovery import NEAR_LARGEST_STRESS
from fmd.recovery.stress import StressHistory, von_mises


@dataclass(frozen=True)
class StressEnvelope:
    """Extremes of stress at some nodes of a body over all output times of a motion, and when they occur first."""

    nodes: IntArray  # (n_nodes,): node numbers
    von_mises: Array  # (n_nodes,): largest von Mises stress [Pa]
    principal_1: Array  # (n_nodes,): largest principal stress [Pa]
    principal_3: Array  # (n_nodes,): smallest principal stress [Pa]
    times: Array  # (n_nodes, 3): when each of the three occurs first [s]

    def measure(self, component: str) -> tuple[Array, Array]:
        """Return an extreme (n_nodes,) [Pa] by its name in a scene, and when it occurs (n_nodes,) [s]."""
        names = {"von Mises": self.von_mises, "principal 1": self.principal_1, "principal 3": self.principal_3}
        return names[component], self.times[:, list(names).index(component)]


def stress_envelope(stress: StressHistory, workers: int | None = None) -> StressEnvelope:
    """Find the extremes of stress at all nodes over all output times; ``workers`` are threads, all cores by default."""
    n_nodes, n_times = len(stress.nodes), len(stress.times)
    extremes, frames = np.empty((n_nodes, 3)), np.zeros((n_nodes, 3), dtype=np.int64)
    extremes[:] = -1.0, -np.inf, np.inf
    q = np.ascontiguousarray(stress.q.T)

    def search(start: int) -> None:
        from fmd.recovery.kernels.extremes import take_extremes

        rows = stress.modal[start : start + ENVELOPE_NODES]
        flat, mine = rows.reshape(-1, rows.shape[2]), slice(start, start + len(rows))
        room = np.empty((len(flat), ENVELOPE_FRAMES))
        squares, means = np.empty((2, ENVELOPE_FRAMES))
        for first in range(0, n_times, ENVELOPE_FRAMES):
            count = min(ENVELOPE_FRAMES, n_times - first)
            tensors = room if count == ENVELOPE_FRAMES else np.empty((len(flat), count))
            np.matmul(flat, q[:, first : first + count], out=tensors)
            take_extremes(tensors.reshape(len(rows), 6, count), first, squares, means, extremes[mine], frames[mine])

    with threadpool_limits(1), ThreadPoolExecutor(workers or os.cpu_count()) as threads:
        list(threads.map(search, range(0, n_nodes, ENVELOPE_NODES)))
    von_mises, high, low = extremes.T
    return StressEnvelope(stress.nodes, np.sqrt(von_mises), high, low, stress.times[frames])


def estimate_missed_peak(stress: StressHistory, node: int) -> float:
    """Estimate by how much the largest von Mises stress at a node is larger between output times, as a part of it.

    Through three output times goes a parabola whose top is at most an eighth of their second difference beyond the
    sampled ones; a vibration sampled less than about four times a period shows no more than that it is too fast. The
    node is a place in ``stress.nodes``.
    """
    tensors = stress.modal[node] @ stress.q.T
    sizes = von_mises(tensors[None])[0]
    if len(sizes) < 3 or not sizes.max() > 0.0:
        return 0.0
    bent = von_mises(np.diff(tensors, 2, axis=1)[None])[0] / 8.0
    near = np.maximum(np.maximum(sizes[:-2], sizes[1:-1]), sizes[2:]) >= NEAR_LARGEST_STRESS * sizes.max()
    return float(bent[near].max() / sizes.max())


def estimate_missed_vibration(stress: StressHistory, node: int, rates: Array, omega: Array) -> float:
    """Estimate what vibrations hide between output times, as a part of the largest von Mises stress at a node.

    A rate that differs from the coordinate's central difference belongs to a vibration that the output times don't
    resolve; over the angular frequency it is what this vibration's amplitude has beside its displacement at that time.
    So a vibration whose period the output times hit exactly is seen, too, although all its outputs are alike. The node
    is a place in ``stress.nodes``; modal coordinates have rates (n_times, n) and frequencies (n,) [rad/s].
    """
    tensors = stress.modal[node] @ stress.q.T
    sizes = von_mises(tensors[None])[0]
    if len(sizes) < 3 or not sizes.max() > 0.0:
        return 0.0
    unresolved = rates[1:-1] - (stress.q[2:] - stress.q[:-2]) / (stress.times[2:] - stress.times[:-2])[:, None]
    aside = np.abs(stress.q[1:-1] - (stress.q[:-2] + stress.q[1:-1] + stress.q[2:]) / 3.0)  # of the vibration's middle
    further = np.hypot(aside, unresolved / omega) - aside
    hidden = np.sqrt(((von_mises(stress.modal[node].T) * further) ** 2).sum(axis=1))
    return max(float((sizes[1:-1] + hidden).max() / sizes.max()) - 1.0, 0.0)
