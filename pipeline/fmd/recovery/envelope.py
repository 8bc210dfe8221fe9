"""Envelope of the stress over a whole motion, node by node, without its history.

Stress is a product of modal stress and modal coordinates. It is formed for a few nodes and output times at once, so
that it stays in the processor's cache, and what is left of it are the extremes.
"""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from threadpoolctl import threadpool_limits

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.memory import ENVELOPE_FRAMES, ENVELOPE_NODES
from fmd.recovery.stress import StressHistory


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
