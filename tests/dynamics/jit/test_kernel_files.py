"""Compiled kernels on disk: whole or not at all, and never another kernel's."""

import errno
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import float64, int64, types

from fmd.dynamics.jit.compiled import kernel
from fmd.dynamics.jit.kernel_files import KernelFiles

KEY = ((types.Array(float64, 1, "C"), int64), ("x86_64", "cpu", "features"), ("code", "closure"))
OTHER = ((types.Array(float64, 2, "C"), int64), *KEY[1:])
DATA = (b"machine code", {"name": "f"})


@pytest.fixture
def kept(tmp_path: Path) -> KernelFiles:
    files = KernelFiles(tmp_path / "kernels", "module.f-1.py311")
    (tmp_path / "kernels").mkdir()
    files.save(KEY, DATA)
    return files


def file_of(tmp_path: Path) -> Path:
    (path,) = (tmp_path / "kernels").iterdir()
    return path


def test_a_kernel_comes_back_for_its_own_types_alone(kept: KernelFiles) -> None:
    assert kept.load(KEY) == DATA
    assert kept.load(OTHER) is None
    kept.save(OTHER, "other")
    kept.flush()
    assert (kept.load(KEY), kept.load(OTHER)) == (DATA, "other")


def test_a_damaged_kernel_is_compiled_anew(kept: KernelFiles, tmp_path: Path) -> None:
    path = file_of(tmp_path)
    whole = path.read_bytes()
    for damaged in (b"", whole[:10], whole[:-1], whole[:40] + bytes([whole[40] ^ 1]) + whole[41:], whole + b"\0"):
        path.write_bytes(damaged)
        assert kept.load(KEY) is None
    kept.save(KEY, DATA)
    assert kept.load(KEY) == DATA


def test_a_kernel_under_anothers_name_is_not_taken(kept: KernelFiles, tmp_path: Path) -> None:
    path = file_of(tmp_path)
    kept.save(OTHER, "other")
    (other,) = set((tmp_path / "kernels").iterdir()) - {path}
    os.replace(other, path)  # as numba's numbered files could be, written by two processes at once
    assert kept.load(KEY) is None


def test_a_full_disk_costs_only_the_next_compilation(
    kept: KernelFiles, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", refuse)
    kept.save(OTHER, "other")
    monkeypatch.undo()
    assert kept.load(OTHER) is None
    assert kept.load(KEY) == DATA
    assert len(list((tmp_path / "kernels").iterdir())) == 1


MODULE = """
import numpy as np
from fmd.dynamics.jit.compiled import kernel

@kernel
def double(x):
    for k in range(len(x)):
        x[k] *= 2

if __name__ == "__main__":
    x = np.ones(3)
    double(x)
    assert x.tolist() == [2.0, 2.0, 2.0]
    print(sum(double.stats.cache_hits.values()), sum(double.stats.cache_misses.values()))
"""


@pytest.mark.slow
def test_a_second_process_reads_what_the_first_has_compiled(tmp_path: Path) -> None:
    script, cache = tmp_path / "doubling.py", tmp_path / "cache"
    script.write_text(MODULE)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}

    def run() -> str:
        command = [sys.executable, str(script)]
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True, timeout=300)
        return done.stdout.strip()

    assert run() == "0 1"
    assert run() == "1 0"
    (path,) = cache.rglob("*.kernel")
    path.write_bytes(path.read_bytes()[:100])  # power was lost
    assert run() == "0 1"
    assert run() == "1 0"


def test_kernels_of_this_process_are_kept_in_files_of_our_own() -> None:
    @kernel
    def halve(x: Any) -> None:
        for k in range(len(x)):
            x[k] *= 0.5

    assert isinstance(halve._cache._cache_file, KernelFiles)  # type: ignore[attr-defined]
    x = np.ones(2)
    halve(x)
    assert x.tolist() == [0.5, 0.5]
