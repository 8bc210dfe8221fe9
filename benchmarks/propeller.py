"""The propeller: sub-cycling against plain central difference, stress recovery, and one sector against the whole.

Run from the project's root: ``python benchmarks/propeller.py``; it prints the table and writes it beside itself. What
is compared runs in turn in one process, except for the two eigenproblems, which have one each for the sake of memory.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from table_format import machine, write_rows
from threadpoolctl import threadpool_limits

from fmd import Pipeline, load_scene
from fmd.recovery.stress import StressHistory

REPEATS = 11
SPLITS = (5, 10, 20)
FRAMES = 200
MODES = 24


def sub_cycling():
    """Run time and stress of each ratio beside plain central difference."""
    runs = [f"{{integrator='sub-cycling',split='1 kHz',substeps={m}}}" for m in SPLITS]
    listed = f"simulation.run=[{{integrator='central-difference'}},{','.join(runs)}]"
    for scene in ("propeller", "propeller-torque", "propeller-gust"):
        run = Pipeline(load_scene(scene, [listed]))
        stress = run.element_stress("propeller.joint")
        plain, *others = stress
        seconds = {label: [] for label in stress}
        for _ in range(REPEATS):
            for label, plan in run.plans.items():
                seconds[label].append(plan.march(run.motion.times).seconds)
        medians = {label: float(np.median(values)) for label, values in seconds.items()}
        for label in others:
            apart = np.abs(stress[label] - stress[plain]).max() / stress[plain].max()
            yield (
                f"{scene}, {label} over plain, run time",
                medians[label] / medians[plain],
                f"{apart:.1e} of the stress",
            )


def recovery():
    """Von Mises stress of 200 frames on all surface nodes beside NumPy's product of that size."""
    history = Pipeline(load_scene("propeller")).stress
    flat, q = history.modal.reshape(-1, history.modal.shape[2]), np.ascontiguousarray(history.q[:FRAMES].T)
    ours, numpys = [], []
    with threadpool_limits(1):
        for _ in range(REPEATS):
            tick = time.perf_counter()
            StressHistory.measure_at(history, np.arange(FRAMES))
            ours.append(time.perf_counter() - tick)
            tick = time.perf_counter()
            flat @ q
            numpys.append(time.perf_counter() - tick)
    size = f"({flat.shape[0]} × {flat.shape[1]}) @ ({q.shape[0]} × {q.shape[1]})"
    yield "stress recovery over numpy.matmul, run time", float(np.median(ours) / np.median(numpys)), size


def eigenproblem(whole):
    """Seconds and memory [MB] of the free modes, beyond what the matrices take."""
    from fmd.reduction.cyclic import CyclicSolver
    from fmd.reduction.eigen import FreeBodySolver

    fe = Pipeline(load_scene("propeller")).fe
    fe.M  # noqa: B018
    tick = time.perf_counter()
    with threadpool_limits(1):
        (FreeBodySolver(fe) if whole else CyclicSolver(fe, 6)).modes(MODES)
    spent = time.perf_counter() - tick
    print(spent, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def sectors():
    """The eigenproblem by one sector over that of the whole body."""
    found = []
    for how in ("whole", "sector"):
        found.append(subprocess.run([sys.executable, __file__, how], capture_output=True, text=True, check=True).stdout)
    (time_whole, memory_whole), (time_one, memory_one) = ([float(x) for x in line.split()] for line in found)
    yield (
        f"{MODES} modes by one sector over whole, time",
        time_one / time_whole,
        f"{time_one:.1f} s / {time_whole:.1f} s",
    )
    yield "the same, peak memory", memory_one / memory_whole, f"{memory_one:.0f} MB / {memory_whole:.0f} MB"


def main():
    """Measure and write the table."""
    if len(sys.argv) > 1:
        eigenproblem(sys.argv[1] == "whole")
        return
    rows = []
    for part in (sub_cycling, recovery, sectors):
        for what, ratio, figures in part():
            print(f"{what:62s} {ratio:7.3f}  {figures}")
            rows.append({"what": what, "ratio": float(ratio), "figures": figures})
    write_rows(Path(__file__).with_suffix(".csv"), rows, machine())


if __name__ == "__main__":
    main()
