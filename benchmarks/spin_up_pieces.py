"""Measure Kane's spin-up in pieces, without and with displacements of second order, against the stiffened beam.

Run from the project's root: ``python benchmarks/spin_up_pieces.py``. Writes ``spin_up_pieces.csv``: pieces, second
order, coordinates, largest lag of the tip [m], largest difference from the stiffened beam in one piece [% of its
largest lag], seconds of the march by generalised-α with 2 ms, compiled.
"""

from __future__ import annotations

import csv
import time
from pathlib import Path
from typing import Any

import numpy as np

from fmd import Pipeline, load_scene

HERE = Path(__file__).parent
MARCH = 'simulation.run=[{ integrator = "generalized-alpha", step = "2 ms" }]'
CASES = ((3, "off"), (4, "off"), (6, "off"), (8, "off"), (2, "auto"), (4, "auto"), (8, "auto"))


def spin_up(pieces: int, stiffening: str) -> tuple[Any, int, float]:
    """Return how far the tip leads over time (n_times,) [m], the number of coordinates, and the seconds."""
    cut = [f"body.beam.pieces={pieces}", "body.beam.modes={ count = 1 }"] if pieces > 1 else []
    sizes = ["body.beam.mesh.divisions=[48, 1, 1]", f"simulation.stiffening={stiffening}"]
    run = Pipeline(load_scene("spin-up", [MARCH, *sizes, *cut]))
    (plan,) = run.plans.values()
    plan.march(run.output_times[:2])
    tick = time.perf_counter()
    trajectory = plan.march(run.output_times)
    seconds = time.perf_counter() - tick
    return run.motion_by(plan, trajectory).tip_deflection[:, 1], run.system.n, seconds


def main() -> None:
    """Measure, and write the table."""
    whole, n, seconds = spin_up(1, "auto")
    size = np.abs(whole).max()
    rows = [(1, "auto", n, f"{size:.4f}", "0", f"{seconds:.2g}")]
    for pieces, stiffening in CASES:
        lead, n, seconds = spin_up(pieces, stiffening)
        apart = f"{100 * np.abs(lead - whole).max() / size:.2g}"
        rows.append((pieces, stiffening, n, f"{np.abs(lead).max():.4f}", apart, f"{seconds:.2g}"))
        print(rows[-1], flush=True)
    with (HERE / "spin_up_pieces.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("pieces", "stiffening", "coordinates", "lag_m", "apart_percent", "seconds"))
        writer.writerows(rows)


if __name__ == "__main__":
    main()
