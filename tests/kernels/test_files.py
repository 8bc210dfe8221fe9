"""Compiled kernels on disk: whole or not at all, and never another kernel's."""

import errno
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from fmd.kernels.machine import read_code, write_code


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    path = tmp_path / "march.kernel"
    write_code(path, b"machine code")
    return path


def test_a_file_comes_back_as_it_was_written(kept: Path) -> None:
    assert read_code(kept) == b"machine code"
    assert read_code(kept.with_name("other.kernel")) is None


def test_a_damaged_file_is_as_good_as_none(kept: Path) -> None:
    whole = kept.read_bytes()
    for damaged in (b"", whole[:10], whole[:-1], whole[:20] + bytes([whole[20] ^ 1]) + whole[21:], whole + b"\0"):
        kept.write_bytes(damaged)
        assert read_code(kept) is None
    write_code(kept, b"machine code")
    assert read_code(kept) == b"machine code"


def test_a_full_disk_costs_only_the_next_compilation(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "replace", refuse)  # the last of the store's steps
    write_code(kept.with_name("other.kernel"), b"other")
    monkeypatch.undo()
    assert [path.name for path in kept.parent.iterdir()] == ["march.kernel"]
    assert read_code(kept) == b"machine code"


MODULE = """
import sys
import numpy as np
from dataclasses import dataclass
from fmd.kernels import kernel as kernels
from fmd.kernels.table import Table

compiled = []
compile_object = kernels.compile_object
kernels.compile_object = lambda *rest: compiled.append(rest) or compile_object(*rest)

@dataclass(frozen=True)
class Pair(Table):
    x: np.ndarray

@kernels.kernel
def multiply(p, factor):
    for k in range(p.x.size):
        p.x[k] *= factor * SCALE

p = Pair(np.ones(3))
multiply(p, 2.0)
print(len(compiled), p.x[0])
"""


@pytest.mark.slow
def test_a_second_process_reads_what_the_first_has_compiled(tmp_path: Path) -> None:
    script, cache = tmp_path / "multiplying.py", tmp_path / "cache"
    environment = os.environ | {"FMD_CACHE": str(cache), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}

    def run() -> str:
        command = [sys.executable, str(script)]
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True, timeout=300)
        return done.stdout.strip()

    script.write_text(MODULE.replace("SCALE", "1.0"))
    assert run() == "1 2.0"
    assert run() == "0 2.0"
    (path,) = cache.rglob("*.kernel")
    path.write_bytes(path.read_bytes()[:100])  # power was lost
    assert run() == "1 2.0"
    assert run() == "0 2.0"
    script.write_text(MODULE.replace("SCALE", "3.0"))
    assert run() == "1 6.0"
