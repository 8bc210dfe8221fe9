"""Time and memory of whole runs of ready scenes: the first one on a machine, and a later one.

Run from the project's root: ``python benchmarks/whole_runs.py``. Writes ``pipeline.csv``.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).parents[1]))
from benchmarks.table_format import machine, write_rows
from fmd.core.errors import AccuracyError

SCENES = ("beam", "rod-slider", "propeller")
_REST = "start, imports and the rest"
_COMMAND = "import sys; from fmd.cli.app import main; main(sys.argv[1:])"
_PER_MEGABYTE = 1024**2 if sys.platform == "darwin" else 1024  # of the system's unit of a process's size


@dataclass(frozen=True)
class StageRow:
    """Wall time [s] of one stage of a cold or warm run and its share, or time and largest size of the whole run."""

    scene: str
    run: str
    stage: str
    seconds: float
    share: float
    cached: bool
    megabytes: float


def measure_runs(scene: str) -> Iterator[StageRow]:
    """Run a scene twice from an empty cache folder, each time in a process of its own.

    Raises
    ------
    AccuracyError
        A run ended with an error.
    """
    with tempfile.TemporaryDirectory(prefix="fmd-runs-") as folder:
        # Matplotlib keeps its list of fonts, which a new machine hasn't got either
        kept = {"FMD_CACHE": str(Path(folder) / "cache"), "MPLCONFIGDIR": str(Path(folder) / "fonts")}
        fmd = [sys.executable, "-c", _COMMAND]
        command = [*fmd, "run", scene, "--json", "--out", str(Path(folder) / "out")]
        for run in ("cold", "warm"):
            summary, seconds, megabytes = _run(scene, command, os.environ | kept)
            stages = summary["seconds"]
            parts = stages | {_REST: max(seconds - sum(stages.values()), 0.0)}
            for stage, spent in sorted(parts.items(), key=lambda part: -part[1]):
                cached = stage in summary["stages_cached"]
                yield StageRow(scene, run, stage, spent, spent / seconds, cached, float("nan"))
            yield StageRow(scene, run, "whole", seconds, 1.0, False, megabytes)


def _run(scene: str, command: list[str], environment: dict[str, str]) -> tuple[dict[str, Any], float, float]:
    """Run a command in a process; return its summary, wall time [s] and largest size [MB]."""
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        tick = time.perf_counter()
        process = subprocess.Popen(command, stdout=output, stderr=errors, env=environment)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - tick
        process.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        errors.seek(0)
        if process.returncode:
            last = errors.read().decode(errors="replace").strip().splitlines()
            raise AccuracyError(f"fmd run {scene} ended with status {process.returncode}: {last[-1] if last else ''}")
        return json.load(output), seconds, usage.ru_maxrss / _PER_MEGABYTE


def main() -> None:
    """Measure the scenes, and write ``pipeline.csv`` beside this file."""
    rows = [row for scene in SCENES for row in measure_runs(scene)]
    remark = f"{machine()}, {os.cpu_count()} processors"
    write_rows(Path(__file__).with_name("pipeline.csv"), rows, remark, digits=4)


if __name__ == "__main__":
    main()
