"""Killed runs, full disks, folders that can't be written, runs side by side, poor machines: nothing is poisoned.

A process with everything imported and compiled forks a child for each run, so that a hundred of them cost seconds.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

from fmd.core.cache import Cache
from fmd.stages.pipeline import RUN_STAGES

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork, signals and resource limits"),
]

SCENE = """
base = "beam-paper"
title = "Small beam"

[simulation]
duration = "4 ms"
step = "20 us"
output_step = "0.2 ms"
tip = "beam.tip"

[[simulation.run]]
integrator = "central-difference"
"""
SMALL = ["--set", "body.beam.mesh.divisions=[6, 1, 1]", "--set", "body.beam.modes.count=2", "--set", "output=[]"]
STAGES = ("mesh", "assembly", "modes", "body", "motion", "surface", "stress")
KEPT = ("mesh", "modes", "body", "surface", "stress")  # those that the cache keeps
NEVER_KEPT = {stage.name for stage in RUN_STAGES.values() if stage.inputs is None}
FILES = len(KEPT) + 2  # at least: and the motion and the summary

FMD = (sys.executable, "-c", "from fmd.cli.app import main; main()")

# Forks a child for each line, or waits for one: it runs the command line with a cache of its own, in an environment and
# with a file system of its own where the order has such, and dies where the order says.
SERVER = """
import ctypes, json, os, signal, subprocess, sys
from fmd.cli.app import main
from fmd.stages.store import StageStore

def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)

def prepare(order):
    os.environ["FMD_CACHE"] = order["cache"]
    for name, value in order.get("environment", {}).items():
        os.environ.pop(name, None) if value is None else os.environ.update({name: value})
    if "mount" in order:  # seen by this process alone
        new_names, private = 0x20000, 0x4000 | 0x40000
        libc = ctypes.CDLL(None, use_errno=True)
        assert libc.unshare(new_names) == 0 and libc.mount(b"none", b"/", None, private, None) == 0
        options, folder = order["mount"]
        subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", folder], check=True)
    stage, when = order.get("stage"), order.get("when")
    compute, replace, count = StageStore.compute, os.replace, [0]

    def patched(self, name, make):
        if name == stage and when == "before":
            die()
        value = compute(self, name, (lambda: (make(), die())) if name == stage and when == "within" else make)
        if name == stage and when == "after":
            die()
        return value

    def replaced(*names):
        count[0] += 1
        if count[0] == order.get("file") and when == "before":
            die()
        replace(*names)
        if count[0] == order.get("file") and when == "after":
            die()

    StageStore.compute, os.replace = patched, replaced
    if "most_bytes" in order:
        import resource
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (order["most_bytes"], order["most_bytes"]))

try:
    main(json.loads(sys.argv[1]))  # imports, compiles, reads what there is to read
except SystemExit as stop:
    assert not stop.code
print(flush=True)
for line in sys.stdin:
    order = json.loads(line)
    if "wait" in order:
        print(os.waitpid(order["wait"], 0)[1], flush=True)
        continue
    child = os.fork()
    if not child:
        os.setpgid(0, 0)
        with open(order["log"], "w") as log:
            os.dup2(log.fileno(), 1), os.dup2(log.fileno(), 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
        status = 1
        try:
            prepare(order)
            main(order["arguments"])
            status = 0
        except SystemExit as stop:
            status = stop.code or 0
        except BaseException:
            import traceback
            traceback.print_exc()
        finally:
            try:
                sys.stdout.flush(), sys.stderr.flush()
            finally:
                os._exit(status)
    print(child, flush=True)
"""


class Runs:
    """Runs of the small scene, one after another, in children of one warm process."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self.folder, self.numbers = folder, iter(range(10_000))
        self.scene = folder / "small.toml"
        self.scene.write_text(SCENE)
        self.command = ["run", str(self.scene), *SMALL, "--no-budget"]
        first = json.dumps([*self.command, "--no-cache", "--json", "--out", str(self.new_folder())])
        command, pipe = [sys.executable, "-c", SERVER, first], subprocess.PIPE
        self.server = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment)
        assert self.server.stdout is not None
        while (line := self.server.stdout.readline()) != "\n":  # the first run's summary
            assert line

    def ask(self, **order: Any) -> int:
        """Send an order; return the number that answers it."""
        assert self.server.stdin is not None
        assert self.server.stdout is not None
        print(json.dumps(order), file=self.server.stdin, flush=True)
        return int(self.server.stdout.readline())

    def new_folder(self) -> Path:
        folder = self.folder / f"{next(self.numbers)}"
        folder.mkdir()
        return folder

    def start(self, cache: Path, out: Path, *more: str, **order: Any) -> Callable[[], int]:
        """Start a run; the result waits for its end and returns its exit status, negative for a signal."""
        log = out.with_name(f"{out.name}.log")
        arguments = [*self.command, *more, "--out", str(out)]
        self.child = child = self.ask(cache=str(cache), log=str(log), arguments=arguments, **order)
        return lambda: os.waitstatus_to_exitcode(self.ask(wait=child))

    def run(self, cache: Path, out: Path, *more: str, **order: Any) -> int:
        return self.start(cache, out, *more, **order)()

    def results(self, cache: Path, **order: Any) -> dict[str, Any]:
        """What a whole run gives, but for its times."""
        out = self.new_folder()
        assert self.run(cache, out, **order) == 0, said(out)
        return read(out)

    def close(self) -> None:
        self.server.communicate(timeout=30)


def said(out: Path) -> str:
    return out.with_name(f"{out.name}.log").read_text()


def read(out: Path) -> dict[str, Any]:
    summary = json.loads((out / "summary.json").read_text())
    for key in ("seconds", "stages_run", "stages_cached", "stages_skipped"):
        del summary[key]
    for row in summary["integrations"]:
        del row["seconds"], row["ratio_to_plain"], row["part_over_plain"], row["spread"]
    with xarray.open_dataset(out / "motion.nc", engine="scipy") as motion:
        # text of repr: a component of the angular momentum that isn't computed is no number, which equals nothing
        summary["motion"] = {name: repr(np.asarray(x).tolist()) for name, x in motion.load().variables.items()}
    return summary


@pytest.fixture(scope="module")
def runs(with_own_cache: Callable[[Path], dict[str, str]], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Runs]:
    runs = Runs(tmp_path_factory.mktemp("faults"), with_own_cache(tmp_path_factory.mktemp("cache")))
    yield runs
    runs.close()


@pytest.fixture(scope="module")
def whole(runs: Runs) -> dict[str, Any]:
    """The results of an undisturbed run."""
    return runs.results(runs.new_folder())


def assert_sound(runs: Runs, cache: Path, out: Path, whole: dict[str, Any], twice: bool = False) -> None:
    """The next run gives the undisturbed results; so does one that reads them all from the cache."""
    assert runs.run(cache, out) == 0, said(out)
    assert read(out) == whole
    if not twice:
        return
    again = runs.new_folder()
    assert runs.run(cache, again) == 0
    assert set(json.loads((again / "summary.json").read_text())["stages_run"]) <= NEVER_KEPT
    assert read(again) == whole


# What is left after a stage is what there is before the next one, and so with files.
KILLS = pytest.mark.parametrize(
    ("when", "stages"),
    [("before", STAGES), ("within", STAGES[1::2]), ("after", STAGES[-1:])],
    ids=["before", "within", "after"],
)


def kill(runs: Runs, cache: Path, out: Path, when: str, stage: str) -> None:
    assert runs.run(cache, out, stage=stage, when=when) == -signal.SIGKILL, (stage, said(out))
    assert not (out / "summary.json").exists()


@KILLS
def test_runs_killed_one_stage_after_another_are_taken_up_by_the_next(
    runs: Runs, whole: dict[str, Any], when: str, stages: tuple[str, ...]
) -> None:
    """Each run takes up what all before it have left, and the last one gives the undisturbed results."""
    cache, out = runs.new_folder(), runs.new_folder()
    for stage in stages:
        kill(runs, cache, out, when, stage)
    assert_sound(runs, cache, out, whole)


@KILLS
@pytest.mark.long
def test_a_run_killed_at_any_stage_is_taken_up_by_the_next(
    runs: Runs, whole: dict[str, Any], when: str, stages: tuple[str, ...]
) -> None:
    for stage in stages:
        cache, out = runs.new_folder(), runs.new_folder()
        kill(runs, cache, out, when, stage)
        assert_sound(runs, cache, out, whole)


@pytest.mark.parametrize(("when", "every"), [pytest.param("before", 1, marks=pytest.mark.long), ("after", 7)])
def test_a_run_killed_at_any_file_leaves_it_whole_or_not_at_all(
    runs: Runs, whole: dict[str, Any], when: str, every: int
) -> None:
    for file in count(1, every):
        cache, out = runs.new_folder(), runs.new_folder()
        status = runs.run(cache, out, file=file, when=when)
        if status == 0:  # there is no further file
            break
        assert status == -signal.SIGKILL, said(out)
        visible = {path.name for path in out.glob("*.*") if not path.name.startswith(".")} if out.exists() else set()
        assert visible <= {"motion.nc", "summary.json"}
        assert_sound(runs, cache, out, whole)
    assert file > FILES


def test_runs_killed_at_random_times_one_after_another_poison_nothing(runs: Runs, whole: dict[str, Any]) -> None:
    rng = np.random.default_rng(7)
    tick = time.perf_counter()
    runs.results(runs.new_folder())
    typical = time.perf_counter() - tick
    killed = 0
    while killed < 3:
        cache, out = runs.new_folder(), runs.new_folder()
        for _ in range(3):  # in one cache, further each time
            end = runs.start(cache, out)
            time.sleep(rng.uniform(0.0, typical))
            with suppress(ProcessLookupError):  # it has ended by itself
                os.kill(runs.child, signal.SIGKILL)
            killed += end() == -signal.SIGKILL
        assert_sound(runs, cache, out, whole, twice=True)


def test_two_runs_at_once_on_one_cache_and_one_folder_agree(runs: Runs, whole: dict[str, Any]) -> None:
    cache, out = runs.new_folder(), runs.new_folder()
    ends = [runs.start(cache, out) for _ in range(2)]
    assert [end() for end in ends] == [0, 0]
    assert read(out) == whole
    assert_sound(runs, cache, out, whole)


# Disks and folders -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("most_bytes", [0, 3000])
def test_a_full_disk_is_one_message_and_leaves_nothing_half_written(
    runs: Runs, whole: dict[str, Any], most_bytes: int
) -> None:
    cache, out = runs.new_folder(), runs.new_folder()
    log = out.with_name(f"{out.name}.log")
    assert runs.run(cache, out, most_bytes=most_bytes) == 2
    assert list(out.iterdir()) == []
    if most_bytes:  # it limits the log too
        assert log.read_text().startswith(f"fmd: --out = '{out}': can't be written")
    assert not [path for path in cache.rglob("*") if path.name.startswith(".")]
    assert_sound(runs, cache, out, whole)


def test_a_disk_too_full_for_the_cache_alone_costs_only_time(runs: Runs, whole: dict[str, Any]) -> None:
    require_mounts()
    small = runs.new_folder()
    assert runs.results(small, mount=["size=16k", str(small)]) == whole


def test_a_cache_of_another_version_costs_only_time(runs: Runs, whole: dict[str, Any]) -> None:
    """Undamaged entries under the right names that hold something else, as classes that have changed since do."""
    cache = runs.new_folder()
    assert runs.run(cache, runs.new_folder()) == 0
    entries = [path for path in cache.rglob("*-*") if path.is_file() and not path.name.startswith(".")]
    assert len(entries) > 3
    for k, entry in enumerate(entries):
        value = [{"Modes": [1.0, 2.0]}, np.zeros((2, 3)), "a text", 7][k % 4]
        Cache(entry.parent).save(entry.name, "a text" if entry.name.startswith(("stress-", "inertia-")) else value)
    assert_sound(runs, cache, runs.new_folder(), whole)


def test_a_read_only_place_for_results_is_one_message(runs: Runs) -> None:
    require_mounts()
    place = runs.new_folder()
    out = place / "results"
    assert runs.run(runs.new_folder(), out, mount=["ro", str(place)]) == 2
    assert said(out).startswith(f"fmd: --out = '{out}': can't be written")
    assert said(out).count("\n") == 1


def test_a_cache_folder_that_is_a_file_costs_only_time(runs: Runs, whole: dict[str, Any]) -> None:
    cache = runs.new_folder() / "file"
    cache.write_text("in the way")
    assert runs.results(cache) == whole
    assert cache.read_text() == "in the way"


def test_a_cache_folder_that_cannot_be_written_costs_only_time(runs: Runs, whole: dict[str, Any]) -> None:
    require_mounts()
    cache = runs.new_folder()
    assert runs.results(cache, mount=["ro", str(cache)]) == whole


def require_mounts() -> None:
    if os.geteuid() or subprocess.run(["unshare", "-m", "true"], check=False).returncode:
        pytest.skip("needs a file system of its own")


# Poor machines ---------------------------------------------------------------------------------------------------

MODES = ["modes", "beam", "--set", "body.beam.mesh.divisions=[6, 1, 1]", "--json"]


def fmd(arguments: list[str], *before: str, cwd: Path | None = None, **environment: str | None) -> Any:
    given = {k: v for k, v in (os.environ | environment).items() if v is not None}
    command = [*before, *FMD, *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=given, cwd=cwd, check=False, timeout=300)


@pytest.fixture(scope="module")
def frequencies() -> list[float]:
    return frequencies_of(fmd(MODES))


def frequencies_of(done: Any) -> list[float]:
    assert done.returncode == 0, done.stderr
    found: list[float] = json.loads(done.stdout)["frequencies_hz"]
    return found


def test_without_a_home_results_are_the_same(runs: Runs, whole: dict[str, Any], tmp_path: Path) -> None:
    # XDG_CACHE_HOME: else the true user's cache is found by the user's name, with results of another day or library
    homeless = {"HOME": None, "FMD_CACHE": None, "XDG_CACHE_HOME": str(tmp_path)}
    assert runs.results(runs.new_folder(), environment=homeless) == whole
    assert list((tmp_path / "fmd" / "stages").iterdir())


def test_a_user_without_a_home_keeps_the_cache_among_temporary_files(frequencies: list[float], tmp_path: Path) -> None:
    if os.geteuid() or not shutil.which("setpriv"):
        pytest.skip("needs to become another user")
    tmp_path.chmod(0o777)
    for folder in tmp_path.parents:  # pytest's own are the user's alone
        if not folder.stat().st_mode & 0o001:
            folder.chmod(folder.stat().st_mode | 0o001)
    nobody = ("setpriv", "--reuid", "12345", "--regid", "12345", "--clear-groups")
    environment = {"HOME": None, "XDG_CACHE_HOME": None, "FMD_CACHE": None, "TMPDIR": str(tmp_path)}
    assert frequencies_of(fmd(MODES, *nobody, cwd=tmp_path, **environment)) == frequencies
    kept = tmp_path / "fmd-12345"
    assert (kept.stat().st_uid, kept.stat().st_mode & 0o777) == (12345, 0o700)
    assert list((kept / "stages").iterdir())
    assert [path.name for path in tmp_path.iterdir()] == ["fmd-12345"]


def test_on_one_core_and_without_a_network_results_are_the_same(frequencies: list[float]) -> None:
    before = ("unshare", "-rn", "taskset", "-c", "0")
    if not shutil.which("taskset") or subprocess.run([*before, "true"], check=False).returncode:
        pytest.skip("needs taskset and a network of its own")
    assert frequencies_of(fmd([*MODES, "--no-cache"], *before)) == frequencies


def test_without_a_display_pictures_are_drawn(runs: Runs) -> None:
    picture = 'output=[{type="stress", file="stress.png", body="beam", size=[320, 240]}]'
    out = runs.new_folder()
    nowhere = {"DISPLAY": ":99", "WAYLAND_DISPLAY": None}
    assert runs.run(runs.new_folder(), out, "--set", picture, environment=nowhere) == 0, said(out)
    assert (out / "stress.png").stat().st_size > 1000


def test_a_missing_library_is_one_message(tmp_path: Path) -> None:
    # a gmsh that fails as the true one does where the system lacks a library
    (tmp_path / "gmsh.py").write_text('raise OSError("libGL.so.1: cannot open shared object file: No such file")')
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = fmd([*MODES, "--no-cache"], PYTHONPATH=path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.strip().splitlines()[-1].startswith("fmd: libGL.so.1: cannot open shared object file")
    assert "`fmd doctor` tells what this machine lacks" in done.stderr
    assert "Traceback" not in done.stderr
