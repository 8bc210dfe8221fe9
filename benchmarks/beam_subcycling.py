"""Sub-cycling against plain central difference on the beam: run time side by side, and error.

Run from the project's root: ``python benchmarks/beam_subcycling.py``; it prints the table and writes it beside
itself. The reference is SciPy's DOP853 at rtol 1e-11. Each method is timed in turn, many times over, in one process;
the table has medians. Errors are the largest over all output times.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from table_format import machine, write_rows

from fmd import Pipeline, load_scene
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.integrators.subcycling import Subcycling

STEP = 1e-5
REPEATS = 101


def main():
    """Measure and write the table."""
    run = Pipeline(load_scene("beam-paper"))
    rotor, times, rest = run.system, run.motion.times, np.zeros(run.system.n)
    methods = {"central difference": CentralDifference(STEP)}
    methods |= {f"sub-cycling {m}:1": Subcycling(STEP, m) for m in (1, 2, 5, 10, 20)}
    seconds = {name: [] for name in methods}
    motions = {}
    for _ in range(REPEATS):
        for name, method in methods.items():
            trajectory = method.march(rotor, rest, rest, times)
            motions[name] = replace(run.motion, trajectory=trajectory)
            seconds[name].append(trajectory.seconds)
    reference = ScipyIvp("DOP853", 1e-11).march(rotor, rest, rest, times)  # which starts anew where the torque ends
    exact = replace(run.motion, trajectory=reference)
    plain = np.median(seconds["central difference"])
    rows = []
    for name, motion in motions.items():
        tip = np.linalg.norm(motion.tip_position - exact.tip_position, axis=1)
        joint = np.abs(motion.joint_position("hub") - exact.joint_position("hub"))
        rows.append(
            {
                "method": name,
                "median_ms": f"{1e3 * np.median(seconds[name]):.2f}",
                "ratio": f"{np.median(seconds[name]) / plain:.3f}",
                "tip_deflection_error_um": f"{1e6 * np.abs(motion.tip_deflection - exact.tip_deflection).max():.3f}",
                "tip_position_error_um": f"{1e6 * tip.max():.3f}",
                "joint_angle_error_urad": f"{1e6 * joint.max():.2f}",
            }
        )
    path = Path(__file__).with_suffix(".csv")
    write_rows(path, rows, f"{machine()}, h = {STEP} s")
    print(path.read_text())


if __name__ == "__main__":
    main()
