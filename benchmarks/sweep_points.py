"""Processor time of a sweep's points by what is asked of them, written to sweep_points.csv.

Run from the project's root: ``python benchmarks/sweep_points.py``. The points of a scene are computed in one process
by `fmd.sweep.work.compute_points`, as a worker of ``fmd sweep`` does: with all of the scene's runs and the whole
summary, with the first run, and with one result by its name. The three are measured by turns; each has the smallest
time of its repetitions. Points that were computed before aren't kept.
"""

import os
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

from table_format import machine, write_rows

from fmd.sweep.points import combine, make_points, parse_variations
from fmd.sweep.record import SUMMARY, Wanted
from fmd.sweep.work import compute_points

TABLE = Path(__file__).parent / "sweep_points.csv"
REPETITIONS = 3
SCENES = {  # what is varied, the result that is asked for by name, and what the scene has beside its own
    "rod-slider": ("joint.slide.spring=900..1100:32 N/m", "slider.centre.position.x", ()),
    "arm": ("joint.elbow.damper=0.001..0.1:16 N m s", "tip", ()),
    "robot": ("joint.wrist.spring=100..400:32 N m", "tip", ("joint.wrist.type=revolute", "joint.wrist.axis=[0,1,0]")),
}


def seconds_of(scene: str, wanted: Wanted, all_runs: bool) -> float:
    """Return the processor seconds of a point; the first, which compiles what is new, doesn't count."""
    varied, _, overrides = SCENES[scene]
    variations = parse_variations([varied])
    made = make_points(scene, variations, overrides, combine(variations), all_runs=all_runs)
    points = {point.key: point.scene for point in made}
    first, *others = points
    list(compute_points({first: points[first]}, wanted))
    start = time.process_time()
    records = [record for _, record in compute_points({key: points[key] for key in others}, wanted)]
    seconds = time.process_time() - start
    assert all(record.status == "ok" for record in records), [record.message for record in records]
    return seconds / len(others)


def measure(scene: str) -> dict[str, str]:
    """Return a scene's row: the seconds of a point with all runs, and shares of it."""
    varied, result, _ = SCENES[scene]
    ways = {"all runs": (SUMMARY, True), "first run": (SUMMARY, False), result: (Wanted(results=(result,)), False)}
    found = {way: min(times) for way, times in _by_turns(scene, ways).items()}
    whole = found["all runs"]
    return {
        "scene": scene,
        "varied": varied.partition("=")[0],
        "all_runs_ms": f"{1e3 * whole:.3g}",
        "first_run": f"{found['first run'] / whole:.3g}",
        "result": result,
        "by_name": f"{found[result] / whole:.3g}",
    }


def _by_turns(scene: str, ways: dict[str, tuple[Wanted, bool]]) -> dict[str, list[float]]:
    times: dict[str, list[float]] = {way: [] for way in ways}
    for _ in range(REPETITIONS):
        for way, (wanted, all_runs) in ways.items():
            times[way].append(seconds_of(scene, wanted, all_runs))
    return times


if __name__ == "__main__":
    write_rows(TABLE, [measure(scene) for scene in SCENES], machine())
