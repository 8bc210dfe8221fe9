"""Whole runs: their failures, their memory, and the file of their stages."""

import csv
import subprocess
import sys
from pathlib import Path

import pytest

from fmd.bench.whole_runs import StageRow, _run, write_stages
from fmd.core.errors import AccuracyError


def test_a_run_that_fails_is_reported_with_its_last_line() -> None:
    command = [sys.executable, "-c", "import sys; print('broken', file=sys.stderr); sys.exit(3)"]
    with pytest.raises(AccuracyError, match="fmd run beam ended with status 3: broken"):
        _run("beam", command, {})


def test_a_runs_size_is_that_of_its_own_process() -> None:
    """Asked by a small process: a child counts as large as its parent was when it began."""
    measure = (
        "import sys; from fmd.bench.whole_runs import _run; "
        "print(_run('beam', [sys.executable, '-c', \"kept = bytearray(200_000_000); print('{}')\"], {})[2])"
    )
    done = subprocess.run([sys.executable, "-c", measure], capture_output=True, text=True, check=True)
    assert 190 < float(done.stdout) < 400


def test_stages_are_written_row_by_row(tmp_path: Path) -> None:
    write_stages([StageRow("beam", "cold", "mesh", 0.5, 0.25, False, float("nan"))], tmp_path / "pipeline.csv")
    _, *table = (tmp_path / "pipeline.csv").read_text().splitlines()
    assert next(csv.DictReader(table))["share"] == "0.25"
