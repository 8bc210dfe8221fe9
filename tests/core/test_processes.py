"""Child processes: what lies in the working folder isn't run, and none outlives its parent or its limits."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from fmd.core.errors import InputError
from fmd.core.processes import ChildError, run_child
from fmd.fem.formats.meshio_reader import read_by_meshio
from fmd.meshes.gmsh_session import gmsh_model
from fmd.output.fmu.build import TARGETS, _run
from fmd.output.picture_files import DrawingProcess
from fmd.render.rendering_check import rendering_failure
from fmd.stages.meshing import cad_files
from fmd.stages.meshing.cad_files import describe_cad_file, mesh_cad_file
from fmd.sweep.local import _Worker

TRAPS = ("random", "numpy", "vtkmodules", "gmsh", "meshio", "json", "ziglang", "sitecustomize", "tempfile")

DEAF = ("exec", sys.executable, "-c", "import signal, time; signal.signal(15, signal.SIG_IGN); time.sleep(100)")


@pytest.fixture
def trapped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder of modules that leave a note when they are run; the place of the note."""
    folder = tmp_path / "work"
    folder.mkdir()
    for name in TRAPS:
        (folder / f"{name}.py").write_text(f"open({str(tmp_path / 'note')!r}, 'a').write({name!r})\n")
    monkeypatch.chdir(folder)
    return tmp_path / "note"


@pytest.fixture
def box(tmp_path: Path) -> Path:
    """A box of 10 × 20 × 30 mm with a bore, as a .brep file."""
    path = tmp_path / "box.brep"
    with gmsh_model("box") as gmsh:
        occ = gmsh.model.occ
        block, bore = occ.addBox(0, 0, 0, 0.01, 0.02, 0.03), occ.addCylinder(0.005, 0.01, 0, 0, 0, 0.03, 0.003)
        occ.cut([(3, block)], [(3, bore)])
        occ.synchronize()
        gmsh.write(str(path))
    return path


def test_the_command_runs_nothing_of_the_working_folder(trapped: Path) -> None:
    command = [sys.executable, "-m", "fmd", "modes", "beam", "--set", "body.beam.mesh.divisions=[8,1,1]", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    ran = trapped.read_text() if trapped.exists() else ""
    assert ran in ("", "sitecustomize")  # which Python itself runs, before any line of ours


def test_drawing_runs_nothing_of_the_working_folder(trapped: Path) -> None:
    assert rendering_failure() is None
    assert not trapped.exists()


def test_the_process_that_draws_runs_nothing_of_the_working_folder(trapped: Path) -> None:
    with DrawingProcess("scene.toml") as draw:
        draw.start()
        draw.require_ready()
    assert not trapped.exists()


def test_readers_of_meshes_run_nothing_of_the_working_folder(trapped: Path, tmp_path: Path) -> None:
    mesh = tmp_path / "one.vtk"
    mesh.write_text(
        "# vtk DataFile Version 3.0\none\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n"
        "0 0 0 1 0 0 0 1 0 0 0 1\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\n"
    )
    assert read_by_meshio(mesh).points.shape == (4, 3)
    assert not trapped.exists()


def test_readers_of_cad_run_nothing_of_the_working_folder(trapped: Path, box: Path) -> None:
    assert describe_cad_file(box).volume > 0.0
    assert not trapped.exists()


def test_workers_of_sweeps_run_nothing_of_the_working_folder(trapped: Path) -> None:
    worker = _Worker()
    worker.connection.send(("key", None))  # no scene: that it starts is what matters
    worker.connection.poll(60.0)
    worker.stop()
    assert not trapped.exists()


def test_compilers_run_nothing_of_the_working_folder(trapped: Path) -> None:
    _run([sys.executable, "-c", "import random"], trapped.parent / "work", TARGETS[0])
    assert not trapped.exists()


def is_running(number: int) -> bool:
    """Return True unless a process has ended; one that nobody has waited for counts as ended."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
@pytest.mark.parametrize("command", [("exec", "sleep", "100"), DEAF], ids=["that sleeps", "that hears no signal"])
def test_a_child_ends_with_its_parent(command: tuple[str, ...]) -> None:
    program = (
        "import subprocess; from fmd.core.processes import child_command; "
        f"child = subprocess.Popen(child_command(*{command!r})); print(child.pid, flush=True); child.wait()"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        time.sleep(0.2)
        assert is_running(child)
        parent.send_signal(signal.SIGKILL)
    for _ in range(100):
        if not is_running(child):
            break
        time.sleep(0.05)
    assert not is_running(child)


def test_a_child_that_takes_too_long_is_ended() -> None:
    start = time.perf_counter()
    with pytest.raises(ChildError, match="it took more than 1 s") as caught:
        run_child("exec", "sleep", "100", seconds=0.6)  # told as whole seconds
    assert caught.value.late
    assert time.perf_counter() - start < 60.0


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere memory isn't limited")
def test_a_child_that_takes_too_much_memory_is_refused_it() -> None:
    python = ("exec", sys.executable, "-c")
    with pytest.raises(ChildError, match="MemoryError"):
        run_child(*python, "bytearray(10**10)", seconds=100.0, memory=2 * 10**9)
    assert run_child(*python, "print(7)", seconds=100.0, memory=2 * 10**9) == "7\n"


def test_what_a_child_says_last_or_how_it_died_is_its_error() -> None:
    python = ("exec", sys.executable, "-c")
    with pytest.raises(ChildError, match=r"^no such thing$"):
        run_child(*python, "import sys; print('x', file=sys.stderr); sys.exit('no such thing')", seconds=60)
    with pytest.raises(ChildError, match=r"^it died of SIGSEGV$"):
        run_child(*python, "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", seconds=60)
    with pytest.raises(ChildError, match="FileNotFoundError"):
        run_child("exec", "no-such-program", seconds=60)


def test_cad_that_takes_too_long_is_one_message(box: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert mesh_cad_file(box, 0.005, 1).volume == pytest.approx(6e-6 - np.pi * 9e-6 * 30e-3, rel=0.02)
    monkeypatch.setattr(cad_files, "READING_SECONDS", 1e-6)
    with pytest.raises(InputError, match="Gmsh took longer than any sound file of its size does; is it damaged"):
        mesh_cad_file(box, 0.005, 1)


@pytest.mark.slow
def test_damaged_cad_ends_within_its_limit(box: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cad_files, "READING_SECONDS", 5.0)
    content, random = box.read_bytes(), np.random.default_rng(3)
    for _ in range(4):
        damaged = bytearray(content)
        damaged[int(random.integers(len(content)))] = int(random.integers(256))
        box.write_bytes(damaged)
        start = time.perf_counter()
        said = ""
        try:
            mesh_cad_file(box, 0.005, 1)
        except InputError as error:
            said = str(error)
        assert "\n" not in said
        assert time.perf_counter() - start < 4 * cad_files.READING_SECONDS  # beside another process, with imports
