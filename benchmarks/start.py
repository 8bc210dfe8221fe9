"""Processor and wall time of commands' starts, of an earlier version and of this one, in alternating runs.

Run from the project's root beside another checkout, ``python benchmarks/start.py --before ../earlier``; it prints the
table and writes it beside itself. A cold run has an empty cache folder (no kernel, no mode, no list of fonts), a warm
one that of a run before. Times are of the command and its child processes, on one BLAS thread; each row has the
smallest of the repetitions of either version, and the median of the ratios of neighbouring runs.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from statistics import median
from typing import NamedTuple

from table_format import machine, renew_rows

ROOT = Path(__file__).parents[1]
COMMANDS = {
    "fmd --help, warm": ["--help"],
    "fmd modes beam, warm": ["modes", "beam"],
    "fmd run beam --no-pictures, warm": ["run", "beam", "--no-pictures"],
    "fmd run beam, warm": ["run", "beam"],
    "fmd run beam, cold": ["run", "beam"],
    "fmd run propeller, cold": ["run", "propeller"],
}


class Times(NamedTuple):
    """Processor and wall time of one run [s]."""

    processor: float
    wall: float


def run(project: Path, arguments: list[str], folder: Path) -> Times:
    """Run a command of a version of the project, with its cache and its results in a folder."""
    kept = {"FMD_CACHE": str(folder / "cache"), "MPLCONFIGDIR": str(folder / "fonts")}
    alone = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    out = ["--out", str(folder / "out")] if arguments[0] == "run" else []
    module, function = tomllib.loads((project / "pyproject.toml").read_text())["project"]["scripts"]["fmd"].split(":")
    command = [sys.executable, "-c", f"from {module} import {function}; {function}()", *arguments, *out]
    before, tick = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    environment = os.environ | kept | alone | {"PYTHONPATH": str(project / "pipeline")}
    subprocess.run(command, cwd=project, env=environment, check=True, capture_output=True)
    wall, after = time.perf_counter() - tick, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Times(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, wall)


def measure(projects: tuple[Path, Path], label: str, repetitions: int) -> list[tuple[Times, Times]]:
    """Run a command in both versions by turns and return the times of each pair."""
    arguments, warm = COMMANDS[label], label.endswith("warm")
    with tempfile.TemporaryDirectory() as kept:
        folders = [Path(kept) / name for name in ("before", "after")]
        if warm:
            for project, folder in zip(projects, folders, strict=True):
                run(project, arguments, folder)
        pairs = []
        for _ in range(repetitions):
            times = []
            for project, folder in zip(projects, folders, strict=True):
                with tempfile.TemporaryDirectory() as empty:
                    times.append(run(project, arguments, folder if warm else Path(empty)))
            pairs.append((times[0], times[1]))
        return pairs


def main() -> None:
    """Measure and write the table."""
    reader = argparse.ArgumentParser()
    reader.add_argument("--before", type=Path, required=True, help="root of a checkout of the earlier version")
    reader.add_argument("--commands", nargs="*", default=list(COMMANDS), choices=list(COMMANDS), metavar="COMMAND")
    reader.add_argument("--repetitions", type=int, default=5, help="pairs of a warm command; a cold one has half")
    chosen = reader.parse_args()
    rows = []
    for label in chosen.commands:
        repetitions = chosen.repetitions if label.endswith("warm") else max(1, chosen.repetitions // 2)
        pairs = measure((chosen.before.resolve(), ROOT), label, repetitions)
        row: dict[str, str] = {"command": label}
        for kind in Times._fields:
            both = [[getattr(times, kind) for times in version] for version in zip(*pairs, strict=True)]
            ratio = median(after / before for before, after in zip(*both, strict=True))
            figures = {"before": min(both[0]), "after": min(both[1]), "ratio": ratio}
            row |= {f"{kind}, {what}": f"{figure:.2f}" for what, figure in figures.items()}
        rows.append(row)
        print(*row.values(), sep="  ", flush=True)
    remark = f"{machine()}, {os.cpu_count()} processors"
    path, order = Path(__file__).with_suffix(".csv"), list(COMMANDS)
    renew_rows(path, rows, ("command",), lambda row: order.index(row["command"]), remark)


if __name__ == "__main__":
    main()
