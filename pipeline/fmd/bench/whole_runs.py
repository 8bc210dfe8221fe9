"""Time and memory of whole runs of ready scenes: the first one on a machine, and a later one."""

from __future__ import annotations

import csv
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

from fmd.core.errors import AccuracyError
from fmd.core.files import whole_file

SCENES = ("beam", "rod-slider", "propeller")
_REST = "start, imports and the rest"
_COMMAND = "import sys; from fmd.cli.app import main; main(sys.argv[1:])"
_PER_MEGABYTE = 1024**2 if sys.platform == "darwin" else 1024  # of the system's unit of a process's size


@dataclass(frozen=True)
class StageRow:
    """Time of one stage of a run, or time and memory of the whole run.

    Attributes
    ----------
    scene : str
        The scene's name.
    run : str
        ``cold``: nothing kept, no kernel compiled; ``warm``: once more.
    stage : str
        The stage's name, or ``whole``.
    seconds, share : float
        Wall time [s], and its share of the whole.
    cached : bool
        True if the result was read from the cache.
    megabytes : float
        Largest size of the process, in the row of the whole; else not a number.
    """

    scene: str
    run: str
    stage: str
    seconds: float
    share: float
    cached: bool
    megabytes: float


def measure_runs(scene: str, overrides: Sequence[str]) -> Iterator[StageRow]:
    """Run a scene twice from an empty cache folder, each time in a process of its own.

    Raises
    ------
    AccuracyError
        A run ended with an error.
    """
    with tempfile.TemporaryDirectory(prefix="fmd-runs-") as folder:
        # Matplotlib keeps its list of fonts, which a new machine hasn't got either
        kept = {"FMD_CACHE": str(Path(folder) / "cache"), "MPLCONFIGDIR": str(Path(folder) / "fonts")}
        settings = [f"--set={override}" for override in overrides]
        fmd = [sys.executable, "-c", _COMMAND]
        command = [*fmd, "run", scene, "--json", "--out", str(Path(folder) / "out"), *settings]
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


def write_stages(rows: list[StageRow], path: Path) -> None:
    """Write the rows as CSV, after a line that names the machine."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as part, part.open("w", newline="") as file:
        file.write(f"# {platform.machine()}, {platform.system()}, Python {platform.python_version()}, ")
        file.write(f"{os.cpu_count()} processors\n")
        table = csv.writer(file, lineterminator="\n")
        table.writerow([field.name for field in fields(StageRow)])
        table.writerows([f"{x:.4g}" if isinstance(x, float) else x for x in astuple(row)] for row in rows)
