"""Sweeps as a user meets them: in processes of their own, some of which are killed on the way."""

import csv
import io
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import redirect_stdout
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import xarray

from fmd.cli.answers import answer_schema
from fmd.cli.app import main

pytestmark = pytest.mark.slow

FMD = [str(Path(sys.executable).with_name("fmd"))]
RUNS = "simulation.run=[{integrator='central-difference'}, {integrator='sub-cycling', substeps=5}]"
COARSE = ["--set", RUNS, "--set", "body.beam.mesh.divisions=[12, 2, 1]", "--set", "simulation.duration=20 ms"]
# Five million steps, about half a second with the error budget's, so that something is always under way.
LONG = ["--set", "simulation.run=[{integrator='central-difference'}]", "--set", "body.beam.mesh.divisions=[12, 2, 1]"]
LONG += ["--set", "simulation.duration=1 s", "--set", "simulation.step=0.2us"]
SPEEDS = ",".join(f"{speed} rad/s" for speed in range(5, 11))
TRACE = """
from pathlib import Path
from distributed import WorkerPlugin

class Trace(WorkerPlugin):
    name = "trace"

    def setup(self, worker):
        self.log = Path({folder!r}) / str(worker.name)

    def transition(self, key, start, finish, **kwargs):
        if finish in ("executing", "memory") and str(key).startswith("point-"):
            with self.log.open("a") as file:
                print(finish, key, file=file)

async def dask_setup(worker):
    await worker.plugin_add(Trace())
"""


@pytest.fixture(scope="module")
def environment(with_own_cache, tmp_path_factory):
    return with_own_cache(tmp_path_factory.mktemp("cache")) | {"OPENBLAS_NUM_THREADS": "1"}


@pytest.fixture(scope="module")
def fmd(environment):
    """Call ``fmd sweep`` in a process of its own; it answers with what it has printed as JSON."""

    def call(*arguments):
        command = [*FMD, "sweep", *map(str, arguments), "--json"]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300, env=environment)
        assert done.returncode == 0, done.stderr
        answer = json.loads(done.stdout)
        jsonschema.validate(answer, answer_schema("sweep"))
        return answer

    return call


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """One point by ``fmd run``, in this process; it compiles the kernels, so that no worker has to."""
    given = [*COARSE, "--set", "body.beam.modes.count=3", "--set", "body.beam.mesh.divisions=[16, 2, 1]", "--no-cache"]
    out = ("--no-pictures", "--out", str(tmp_path_factory.mktemp("run")), "--json")
    with redirect_stdout(io.StringIO()) as printed, pytest.raises(SystemExit, match="0"):
        main(["run", "beam-paper", *given, *out])
    return json.loads(printed.getvalue())


@pytest.fixture(scope="module")
def grid(run, fmd, tmp_path_factory):
    """Two meshes, two numbers of modes, and three steps: one that works, one that would diverge, one that is no time.

    The steps vary fastest, so both workers want the same mesh and modes at the same time.
    """
    folder = tmp_path_factory.mktemp("grid")
    shapes = ["--vary", "body.beam.modes.count=2,3", "--vary", "body.beam.mesh.divisions=[12, 2, 1],[16,2,1]"]
    steps = ["--vary", "simulation.step=10us,3ms,fast"]
    return folder, fmd("beam-paper", *COARSE, *shapes, *steps, "--out", folder, "--workers", 2)


def test_each_point_is_a_row_also_what_is_refused(grid):
    rows = grid[1]["rows"]
    assert [grid[1][key] for key in ("points", "computed", "ok", "refused", "failed")] == [12, 8, 4, 8, 0]
    assert [row["status"] for row in rows] == ["ok", "refused", "refused"] * 4
    assert "central-difference would diverge; the largest stable step" in rows[1]["message"]
    assert rows[2]["message"].startswith("--vary: simulation.step = 'fast'")


def test_the_figures_of_a_point_are_those_of_a_run(grid, run):
    row = grid[1]["rows"][-3]
    assert [row[f"frequencies_hz.{k}"] for k in range(3)] == run["frequencies_hz"]
    assert row["worst_stress.von_mises_pa"] == run["worst_stress"]["von_mises_pa"]
    for number, integration in enumerate(run["integrations"]):
        assert row[f"run.{number}.final.joint_positions.hub"] == integration["final"]["joint_positions"]["hub"]
        assert row[f"run.{number}.stability_margin"] == integration["largest_stable_step_s"] / integration["step_s"]


def test_points_that_share_a_mesh_or_modes_have_them_made_once(grid):
    records = [json.loads(path.read_text()) for path in (grid[0] / "points").glob("*.json")]
    made = [stage for record in records for stage in record["summary"].get("stages_run", ())]
    assert made.count("motion") == 4
    assert made.count("mesh") in (1, 2)  # a point that is refused may have made one, and has no summary
    assert made.count("modes") in (3, 4)


def test_the_table_comes_as_csv_and_as_netcdf_with_a_dimension_for_each_key(grid):
    folder, found = grid
    assert found["files"] == ["sweep.csv", "sweep.nc", "sweep-errors.csv", "sweep.png"]
    with (folder / "sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["body.beam.mesh.divisions"] for row in rows[:4]] == ["[12, 2, 1]"] * 3 + ["[16,2,1]"]
    with xarray.open_dataset(folder / "sweep.nc", engine="scipy") as table:
        keys = ("body.beam.modes.count", "body.beam.mesh.divisions", "simulation.step")
        assert table.status.dims == keys
        assert table["simulation.step"].values.tolist() == ["10us", "3ms", "fast"]  # as one of them is no time
        stress = table["worst_stress.von_mises_pa"].values.reshape(-1)
        assert table["run.seconds"].dims == (*keys, "run")
        assert table["run.seconds"].units == "s"
        assert np.isnan(table.frequencies_hz.sel({"body.beam.modes.count": 2})[..., 2]).all()
    np.testing.assert_array_equal(stress, [float(row["worst_stress.von_mises_pa"] or "nan") for row in rows])


def test_a_second_sweep_computes_nothing_that_is_known(grid, capsys):
    folder, found = grid
    before = {path.name: path.stat().st_ino for path in (folder / "points").iterdir()}
    vary = ["--vary", "simulation.step=0.01 ms", "--vary", "body.beam.modes.count=2,3"]
    with pytest.raises(SystemExit, match="0"):
        main(["sweep", "beam-paper", *COARSE, *vary, "--out", str(folder), "--json"])
    again = json.loads(capsys.readouterr().out)
    assert (again["points"], again["ok"], again["computed"]) == (2, 2, 0)
    assert [row["simulation.step [s]"] for row in again["rows"]] == [1e-5, 1e-5]
    assert again["rows"][1]["run.0.seconds"] == found["rows"][6]["run.0.seconds"]  # that of the first sweep
    assert before == {path.name: path.stat().st_ino for path in (folder / "points").iterdir()}


def points_in(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (folder / "points").glob("point-*.json")}


def wait_for(condition, seconds=120.0):
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return found


def has_ended(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    return False


def children_of(process: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


@pytest.mark.long
@pytest.mark.usefixtures("grid")
def test_a_killed_sweep_goes_on_where_it_was_and_a_killed_worker_costs_no_point(environment, tmp_path):
    arguments = [*FMD, "sweep", "beam-paper", *LONG, "--vary", f"drive.spin_up.speed={SPEEDS}", "--out", str(tmp_path)]
    sweep = subprocess.Popen([*arguments, "--workers", "2"], env=environment, start_new_session=True)
    wait_for(lambda: len(points_in(tmp_path)) >= 3)
    sweep.send_signal(signal.SIGKILL)
    sweep.wait()
    wait_for(lambda: has_ended(sweep.pid), 20.0)  # its workers don't outlive it
    done = points_in(tmp_path)
    assert 3 <= len(done) < 6
    rest = subprocess.Popen([*arguments, "--workers", "1", "--json"], env=environment, stdout=subprocess.PIPE)
    wait_for(lambda: len(points_in(tmp_path)) > len(done))
    server = next(
        child for child in children_of(rest.pid) if b"forkserver" in Path(f"/proc/{child}/cmdline").read_bytes()
    )
    os.kill(children_of(server)[0], signal.SIGKILL)
    found = json.loads(rest.communicate(timeout=120)[0])
    assert (found["ok"], found["computed"]) == (6, 6 - len(done))
    assert done.items() <= points_in(tmp_path).items()  # to the last digit of the run times: not computed again
    assert sorted(path.name for path in (tmp_path / "points").iterdir()) == sorted(points_in(tmp_path))
    assert len(points_in(tmp_path)) == 6


@pytest.mark.long
@pytest.mark.usefixtures("grid")
def test_a_cluster_that_loses_a_worker_loses_no_point_and_records_none_twice(environment, tmp_path):
    pytest.importorskip("distributed")
    (tmp_path / "log").mkdir()
    (tmp_path / "trace.py").write_text(TRACE.format(folder=str(tmp_path / "log")))
    at, address = tmp_path / "scheduler.json", ""
    options = {"env": environment, "stderr": subprocess.DEVNULL, "cwd": tmp_path}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard", "--port", "0"]
    host = ["--host", "127.0.0.1"]
    processes = [subprocess.Popen([*dask, *host, "--scheduler-file", str(at)], **options)]
    try:
        address = json.loads(wait_for(lambda: at.is_file() and at.read_text()))["address"]
        for name in ("one", "two"):
            worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
            worker += ["--no-dashboard", "--name", name, "--preload", str(tmp_path / "trace.py")]
            processes.append(subprocess.Popen(worker, **options))
        arguments = ["beam-paper", *LONG, "--vary", f"drive.spin_up.speed={SPEEDS}", "--out", str(tmp_path)]
        command = [*FMD, "sweep", *arguments, "--scheduler", address, "--json"]
        sweep = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE)
        log = tmp_path / "log" / "two"
        wait_for(lambda: log.is_file() and log.read_text().count("memory") >= 1)
        before = {name.removesuffix(".json") for name in points_in(tmp_path)}
        time.sleep(0.5)  # the scheduler learns within milliseconds that they are no longer wanted
        wait_for(lambda: log.read_text().splitlines()[-1].startswith("executing"))
        processes[2].kill()
        found = json.loads(sweep.communicate(timeout=120)[0])
    finally:
        for process in processes:
            process.kill()
            process.wait()
    assert (found["ok"], found["computed"]) == (6, 6)
    assert len(points_in(tmp_path)) == 6
    events = [line.split() for path in log.parent.iterdir() for line in path.read_text().splitlines()]
    started = [key for event, key in events if event == "executing"]
    again = {key for key in started if started.count(key) > 1}
    # What was recorded isn't touched again. What the killed worker had in hand is: that which it was at, and at most
    # that which it had done but not yet delivered.
    assert not again & before
    mine = [line.split()[1] for line in log.read_text().splitlines()]
    assert {mine[-1]} <= again <= set(mine)
    assert all(started.count(key) == 2 for key in again)


@pytest.mark.parametrize("address", ["nowhere", "tcp://127.0.0.1:9"])
def test_a_scheduler_that_does_not_answer_is_reported(address, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("fmd.sweep.cluster.ANSWERS_WITHIN", 0.2)
    with pytest.raises(SystemExit, match="2"):
        main(["sweep", "beam", "--vary", "simulation.step=10us", "--scheduler", address, "--out", str(tmp_path)])
    said = capsys.readouterr().err
    assert said.startswith(f"fmd: --scheduler = '{address}': no Dask scheduler answers there")
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize("wrong", [["--workers", "0"], ["--workers", "1", "--scheduler", "tcp://x:1"]])
def test_workers_are_for_this_machine(wrong, tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["sweep", "beam", "--vary", "simulation.step=10us", "--out", str(tmp_path / "out"), *wrong])
    assert "must be 1 or more, and can't stand beside --scheduler" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_written_is_reported(tmp_path, capsys):
    (tmp_path / "file").touch()
    with pytest.raises(SystemExit, match="2"):
        main(["sweep", "beam", "--vary", "simulation.step=10us", "--out", str(tmp_path / "file" / "out")])
    assert "can't be written" in capsys.readouterr().err
