"""Whole runs of the benchmarks: their failures and their memory."""

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.whole_runs import _run
from fmd.core.errors import AccuracyError


def test_a_run_that_fails_is_reported_with_its_last_line() -> None:
    command = [sys.executable, "-c", "import sys; print('broken', file=sys.stderr); sys.exit(3)"]
    with pytest.raises(AccuracyError, match="fmd run beam-paper ended with status 3: broken"):
        _run("beam-paper", command, {})


def test_a_runs_size_is_that_of_its_own_process() -> None:
    """Asked by a small process: a child counts as large as its parent was when it began."""
    root = Path(__file__).parents[2]
    measure = (
        f"import sys; sys.path.insert(0, {str(root)!r}); from benchmarks.whole_runs import _run; "
        "print(_run('beam', [sys.executable, '-c', \"kept = bytearray(200_000_000); print('{}')\"], {})[2])"
    )
    done = subprocess.run([sys.executable, "-c", measure], capture_output=True, text=True, check=True, cwd=root)
    assert 190 < float(done.stdout) < 400
