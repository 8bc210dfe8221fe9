"""Envelope and fatigue of the propeller's surface over many output times, beside the matrix products alone.

Run from the project's root, ``python benchmarks/envelope.py``; it writes ``envelope.csv`` beside itself. Stress is that
of the modes of the ready scene `propeller`; its coordinates are vibrations at the modes' frequencies with random
phases, about as large as in the scene. Each row is a process of its own; the smallest of three runs counts.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from table_format import machine, write_rows
from threadpoolctl import threadpool_limits

from fmd.recovery.envelope import stress_envelope
from fmd.recovery.fatigue import FatigueLaw, fatigue_by_signed_von_mises
from fmd.recovery.stress import StressHistory

HERE = Path(__file__).parent
N_TIMES, REPETITIONS = 100_000, 3
NODES, FRAMES = 64, 256  # of a product, as in `fmd.recovery.envelope`
LAW = FatigueLaw(90e6, 1e6, 6.0, 11.0, "fkm", 0.3)
HEADER = ("work", "nodes", "modes", "output times", "threads", "wall s", "processor s", "peak MB")


def prepare(path: Path) -> None:
    """Write modal stress, times and coordinates."""
    from fmd import Pipeline, load_scene

    run = Pipeline(load_scene("propeller"))
    rng, largest = np.random.default_rng(0), np.abs(run.motion.modal("propeller")).max(axis=0)
    times = np.linspace(0.0, 1.0, N_TIMES)
    phases = rng.uniform(0.0, 2 * np.pi, len(largest))
    q = largest * np.sin(np.outer(times, run.body.omega) + phases)
    part = run.part
    np.savez(path, nodes=part.surface.nodes, modal=part.surface_stress, times=times, q=q)


def multiply(stress: StressHistory) -> None:
    """Form all stress tensors in blocks that stay in the cache, and drop them."""
    q, modal = np.ascontiguousarray(stress.q.T), stress.modal

    def block(start: int) -> None:
        rows = modal[start : start + NODES].reshape(-1, modal.shape[2])
        out = np.empty((len(rows), FRAMES))
        for first in range(0, q.shape[1] - FRAMES + 1, FRAMES):
            np.matmul(rows, q[:, first : first + FRAMES], out=out)

    with threadpool_limits(1), ThreadPoolExecutor(os.cpu_count()) as threads:
        list(threads.map(block, range(0, len(modal), NODES)))


WORKS = {
    "products alone (dgemm)": multiply,
    "envelope": stress_envelope,
    "fatigue, worst 20 nodes": lambda stress: fatigue_by_signed_von_mises(stress, LAW, 20, 1.0),
}


def measure(work: str, path: Path) -> None:
    """Print the row of one kind of work."""
    with np.load(path) as held:
        stress = StressHistory(*(held[name] for name in ("nodes", "modal", "times", "q")))
    few = StressHistory(stress.nodes[:100], stress.modal[:100], stress.times[:300], stress.q[:300])
    WORKS[work](few)  # compiles
    best = (np.inf, np.inf)
    for _ in range(REPETITIONS):
        wall, processor = time.perf_counter(), time.process_time()
        WORKS[work](stress)
        best = min(best, (time.perf_counter() - wall, time.process_time() - processor))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    n_nodes, _, n_modes = stress.modal.shape
    row = (work, n_nodes, n_modes, len(stress.times), os.cpu_count(), f"{best[0]:.3g}", f"{best[1]:.3g}", f"{peak:.0f}")
    print(json.dumps(dict(zip(HEADER, row, strict=True))))


def main() -> None:
    """Measure all rows, each in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "stress.npz"
        prepare(path)
        rows = [json.loads(subprocess.check_output([sys.executable, __file__, work, str(path)])) for work in WORKS]
    write_rows(HERE / "envelope.csv", rows, machine())
    print((HERE / "envelope.csv").read_text())


if __name__ == "__main__":
    measure(sys.argv[1], Path(sys.argv[2])) if len(sys.argv) > 2 else main()
