"""Seconds that each method needs for an error of the tip, from the tables here, as a Markdown table for the README.

Run from the project's root: ``python benchmarks/summary.py``. Between two rows of a table seconds are interpolated in
logarithms; a method that doesn't reach an error, or starts below it, has a dash or its first row's seconds.
"""

from __future__ import annotations

import csv
from itertools import pairwise
from math import exp, log
from pathlib import Path

HERE = Path(__file__).parent
SCENES = ("rod-slider", "beam", "beam-20-modes", "beam-60-modes", "arm")
ERRORS = (1e-3, 1e-6)
METHODS = (
    "central-difference",
    "sub-cycling 5:1",
    "sub-cycling 10:1",
    "generalized-alpha",
    "generalized-alpha, adaptive",
    "exponential",
    "exponential-rosenbrock",
    "runge-kutta",
    "Radau",
    "LSODA",
    "Exudyn GeneralizedAlpha",
    "Exudyn VelocityVerlet",
    "Exudyn RK44",
    "Exudyn RK67",
)


def rows_of(scene):
    """Return (seconds, error) pairs by method, as they are in the table."""
    found = {}
    with (HERE / f"{scene}.csv").open() as file:
        file.readline()
        for row in csv.DictReader(file):
            found.setdefault(row["integrator"], []).append((float(row["seconds"]), float(row["error"])))
    return found


def seconds_at(points, error):
    """Return the least seconds for an error, None if it isn't reached."""
    best = None
    if points[0][1] <= error:
        best = points[0][0]
    for (s0, e0), (s1, e1) in pairwise(points):
        if e1 <= error < e0:
            part = (log(e0) - log(error)) / (log(e0) - log(e1))
            found = exp(log(s0) + part * (log(s1) - log(s0)))
            best = found if best is None else min(best, found)
    return best


def shown(seconds):
    """Format seconds."""
    if seconds is None:
        return "–"
    factor, unit = (1, "s") if seconds >= 1 else (1e3, "ms") if seconds >= 1e-3 else (1e6, "µs")
    return f"{seconds * factor:.2g} {unit}" if seconds * factor < 100 else f"{seconds * factor:.0f} {unit}"


def main():
    """Print the table."""
    tables = {scene: rows_of(scene) for scene in SCENES}
    print("| error of the tip | " + " | ".join(f"{scene}, {error:.0e}" for scene in SCENES for error in ERRORS) + " |")
    print("|---|" + "---|" * (len(SCENES) * len(ERRORS)))
    best = {
        (scene, error): min(x for points in rows.values() if (x := seconds_at(points, error)) is not None)
        for scene, rows in tables.items()
        for error in ERRORS
    }
    for method in METHODS:
        cells = []
        for scene, rows in tables.items():
            for error in ERRORS:
                seconds = seconds_at(rows[method], error) if method in rows else None
                cells.append(f"**{shown(seconds)}**" if seconds == best[scene, error] else shown(seconds))
        print(f"| {method} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
