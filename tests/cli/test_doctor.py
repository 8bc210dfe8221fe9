"""`fmd doctor`: what it checks, and the remedies that it names."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from fmd.cli import doctor
from fmd.render import rendering_check as probe

pytestmark = pytest.mark.slow


@pytest.fixture
def drawing_works(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(probe, "rendering_failure", lambda: None)


def python_that(does: str, folder: Path) -> str:
    """Return a program that stands in for Python and does something else."""
    program = folder / "python"
    program.write_text(f"#!/bin/sh\n{does}\n")
    program.chmod(0o755)
    return str(program)


def test_this_machine_can_draw() -> None:
    assert probe.rendering_failure() is None


@pytest.mark.parametrize(
    ("does", "message"),
    [
        ("kill -SEGV $$", "drawing off-screen died of SIGSEGV"),
        ("echo no module >&2; exit 1", r"drawing off-screen failed \(no module\)"),
        ("exit 3", r"drawing off-screen failed \(exit status 3\)"),
    ],
)
def test_a_drawing_that_dies_is_reported_with_its_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, does: str, message: str
) -> None:
    monkeypatch.setattr(sys, "executable", python_that(does, tmp_path))
    assert re.fullmatch(message, probe.rendering_failure() or "it draws")
    assert probe.MEND.endswith("apt-get install libgl1 libegl1")


def test_a_drawing_that_hangs_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", python_that("exec sleep 10", tmp_path))
    assert probe.rendering_failure(timeout=0.2) == "drawing off-screen took more than 0.2 s"


@pytest.mark.usefixtures("drawing_works")
def test_nothing_is_amiss_on_this_machine(tmp_path: Path) -> None:
    assert doctor.find_problems(tmp_path / "new" / "cache") == ()


@pytest.mark.usefixtures("drawing_works")
def test_missing_libraries_are_mended_by_one_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "can_load", lambda library: library not in ("libGLU.so.1", "libXft.so.2"))
    (problem,) = doctor.find_problems(tmp_path)
    assert problem.what == "Gmsh can't be loaded without libGLU.so.1, libXft.so.2"
    assert problem.mend.endswith("apt-get install libglu1-mesa libxft2")


def test_a_library_that_nobody_has_can_not_be_loaded() -> None:
    assert not doctor.can_load("libnone-of-that-name.so.99")


def test_every_package_that_a_mend_names_is_in_the_full_list() -> None:
    assert set(doctor.GMSH_LIBRARIES.values()) | set(probe.PACKAGES) == set(doctor.DEBIAN_PACKAGES)


def test_a_failing_drawing_is_a_problem(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(probe, "rendering_failure", lambda: "drawing off-screen died of SIGSEGV")
    assert doctor.find_problems(tmp_path) == (doctor.Problem("drawing off-screen died of SIGSEGV", probe.MEND),)


@pytest.mark.usefixtures("drawing_works")
def test_a_cache_folder_that_can_not_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (problem,) = doctor.find_problems(tmp_path / "file" / "cache")
    assert problem.what.startswith(f"the cache folder {tmp_path / 'file' / 'cache'} can't be written (")


def test_cores_and_threads_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    machine = doctor.describe_machine()
    assert int(machine["processor cores"]) >= 1
    assert machine["BLAS threads"] == "3 (OPENBLAS_NUM_THREADS)"


def test_the_doctor_loads_neither_gmsh_nor_pyvista_nor_numpy_before_it_is_timed(
    tmp_path: Path,
) -> None:
    code = (
        "import sys, pathlib; from fmd.cli import doctor; early = {'numpy'} & set(sys.modules); "
        "doctor.find_problems(pathlib.Path(sys.argv[1])); "
        "sys.exit(str(early | {'gmsh', 'pyvista', 'vtkmodules', 'matplotlib'} & set(sys.modules) or ''))"
    )
    result = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False)
    assert result.stderr.strip() == ""


def test_doctor_finds_nothing_to_mend_here(
    fmd: Callable[..., int], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert fmd("doctor", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["ok"], found["problems"]) == (True, [])
    monkeypatch.setattr(doctor, "measure_start", lambda: found["start_seconds"])
    monkeypatch.setattr(doctor, "find_problems", lambda cache: ())
    assert fmd("doctor") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines if line.startswith("start, ")][:8] == [
        f"start, {part}" for part in found["start_seconds"]
    ]


def test_the_parts_of_a_start_add_up_to_the_time_that_they_take_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "rendering_failure", lambda: time.sleep(0.2))
    tick = time.perf_counter()
    parts = doctor.measure_start()
    assert sum(parts.values()) <= time.perf_counter() - tick
    assert parts["drawing, beside the rest"] >= 0.2
    imports = [parts[name] for name in ("Python", "NumPy", "scene and stages", "LLVM", "mechanism")]
    assert min(imports) > 1e-3  # nothing that is loaded for one part has been loaded for another


def test_kernels_that_are_not_kept_take_no_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "kernel_folder", lambda: tmp_path)
    assert doctor.time_of_kernels() == 0.0
    (tmp_path / "march.kernel").write_bytes(bytes(10))
    assert doctor.time_of_kernels() > 0.0
