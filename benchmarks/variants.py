"""Scenes marched in a second for a sweep over a damper, written to variants.csv.

An earlier version's sweep marches one scene after the other in each of two processes; this one marches all in the
lanes of one compiled step, in two threads. Both march by central difference with the same step, and what is timed is
the march alone. Run from the project's root: ``python benchmarks/variants.py --before CHECKOUT``; CHECKOUT is the root
of the earlier version.
"""

from __future__ import annotations

import argparse
import csv
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from march_speed import open_scene

ROOT = Path(__file__).parents[1]
TABLE = Path(__file__).parent / "variants.csv"
COUNT, REPETITIONS = 64, 5
CASES = {  # key that varies, step and duration [s]
    "rod-slider": ("joint.slide.damper={:g} N s/m", 1e-3, 10.0),
    "beam": ("joint.hub.damper={:g} N m s", 1e-5, 0.1),
    "arm": ("joint.elbow.damper={:g} N m s", 2e-5, 0.2),
    str(ROOT / "benchmarks" / "scenes" / "robot.toml"): ("joint.elbow.damper={:g} N m s", 2e-5, 0.2),
}


def overrides(scene: str) -> list[str]:
    key, _, _ = CASES[scene]
    return [key.format(0.001 * (k + 1)) for k in range(COUNT)]


def time_one(scene: str) -> None:
    """Print the seconds of one scene's march; runs in the version that is first on the path."""
    from fmd.integrators.central_difference import CentralDifference

    _, step, duration = CASES[scene]
    run, system = open_scene(scene, overrides(scene)[:1])
    times, (q0, v0) = np.linspace(0.0, duration, 101), run.start
    print(min(CentralDifference(step).march(system, q0, v0, times).seconds for _ in range(REPETITIONS)))


def time_variants(scene: str) -> float:
    """Return the seconds a scene takes where all are marched at once."""
    from fmd import Pipeline, load_scene
    from fmd.integrators.variants import march_variants

    _, step, duration = CASES[scene]
    runs = [Pipeline(load_scene(scene, [change])) for change in overrides(scene)]
    mechanisms, times, (q0, v0) = [run.mechanism for run in runs], np.linspace(0.0, duration, 101), runs[0].start
    marches = (march_variants(mechanisms, step, q0, v0, times, workers=2) for _ in range(REPETITIONS))
    return min(march.seconds for march in marches) / COUNT


def time_before(checkout: str, scene: str) -> float:
    """Return the seconds of a scene's march by the earlier version, in a process of its own."""
    environment = os.environ | {"PYTHONPATH": checkout, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, __file__, "--one", scene]
    done = subprocess.run(command, env=environment, cwd=checkout, check=True, capture_output=True, text=True)
    return float(done.stdout.split()[-1])


def main() -> None:
    """Measure every case and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", metavar="CHECKOUT")
    parser.add_argument("--one", metavar="SCENE")
    chosen = parser.parse_args()
    if chosen.one:
        time_one(chosen.one)
        return
    rows = []
    for scene, (_, step, duration) in CASES.items():
        before, now = time_before(chosen.before, scene) / 2, time_variants(scene)
        rows.append(
            {
                "scene": Path(scene).stem,
                "steps": round(duration / step),
                "before_per_s": f"{1 / before:.0f}",
                "now_per_s": f"{1 / now:.0f}",
                "ratio": f"{before / now:.1f}",
            }
        )
        print(rows[-1], flush=True)
    with TABLE.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
