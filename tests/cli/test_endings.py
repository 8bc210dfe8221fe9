"""How commands end when they are interrupted, when nobody reads on, and when numbers leave what can be computed."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from fmd.cli.options import print_json
from fmd.core.errors import AccuracyError

FMD = [sys.executable, "-m", "fmd"]
PART = """
title = "A bar alone"
[body.bar]
shape = "bar"
length = "300 mm"
depth = "10 mm"
width = "20 mm"
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
mesh = { divisions = [12, 1, 1] }
modes = { count = 6 }
marker = { middle = { at = ["150 mm", "0 mm", "0 mm"] }, tip = { face = "x+" } }
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("door", "delay"),
    [("start", 0.1), ("start", 0.4), ("start", 1.2), ("module", 0.2)],
)
def test_an_interrupt_while_all_is_loaded_is_one_line(door: str, delay: float, tmp_path: Path) -> None:
    begun = "from fmd.cli.start import main; print(flush=True); main()"
    if door == "module":  # python -m fmd
        begun = "import runpy, fmd.cli.start; print(flush=True); runpy.run_module('fmd', run_name='__main__')"
    command = [sys.executable, "-c", begun, "run", "arm", "--no-cache", "--no-pictures", "--out", str(tmp_path)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.read(1)
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors.decode()) == (130, "fmd: interrupted\n")


@pytest.mark.slow
def test_a_reader_who_has_had_enough_is_no_fault_of_the_machine(tmp_path: Path) -> None:
    short = ["--no-budget", "--set", "output=[]", "--set", "simulation.duration=0.1 s", "--out", str(tmp_path)]
    command = [*FMD, "run", "rod-slider", *short]
    reader, writer = os.pipe()
    process = subprocess.Popen(command, stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    os.close(reader)  # as `head` does once it has its lines
    _, errors = process.communicate(timeout=120)
    assert re.sub(rb"\d+ s: [a-z ]+[^\n]*\n", b"", errors) == b""  # progress, on a slow machine
    assert (tmp_path / "summary.json").exists()


def test_no_garbage_is_looked_for_at_the_end() -> None:
    # what is registered first is called last
    asked = "import atexit, gc; atexit.register(lambda: print(gc.get_freeze_count(), len(gc.get_objects())))"
    begun = f"{asked}; from fmd.cli.start import main; main()"
    done = subprocess.run([sys.executable, "-c", begun, "--version"], capture_output=True, text=True, check=True)
    frozen, collected = map(int, done.stdout.splitlines()[-1].split())
    assert frozen > 10_000
    assert collected < 100


def test_a_failure_of_numerical_libraries_is_one_message(fmd, capsys, monkeypatch) -> None:
    def fail(*_):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr("fmd.cli.inputs.load_scene", fail)
    assert fmd("modes", "beam") == 3
    said = "fmd: the numbers of this scene can't be computed with (Singular matrix); check units and sizes\n"
    assert capsys.readouterr().err == said


UPRIGHT = """
[joint.foot]
type = "fixed"
parent = "ground"
child = "bar.foot"
[simulation]
duration = "1 s"
output_step = "0.1 s"
tip = "bar.tip"
gravity = ["-9.81 m/s^2", "0 m/s^2", "0 m/s^2"]
[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-6
"""


@pytest.mark.parametrize(("command", "more", "status"), [("run", ["--no-budget"], 2), ("mesh", [], 0)])
def test_a_wrong_unit_is_told_before_anything_is_computed(
    fmd, capsys, monkeypatch, tmp_path, command, more, status
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = tmp_path / "upright.toml"
    wrong = (
        PART.replace("7850 kg/m^3", "7850 g/cm^3")
        .replace("210 GPa", "2 GPa")
        .replace("{ middle", '{ foot = { face = "x-" }, middle')
    )
    scene.write_text(wrong.replace("divisions = [12", "divisions = [6").replace("count = 6", "count = 2") + UPRIGHT)
    assert fmd(command, scene, *more) == status
    first, *others = capsys.readouterr().err.splitlines()
    assert first.startswith("warning: body.bar.rho is 7.85e+06 kg/m^3, which is unusual: foam has about 30, water 1000")
    assert [text.partition("would buckle")[1] for text in others] == ["would buckle"] * (status == 2)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_json_can_not_hold_is_named_by_its_place(bad: float) -> None:
    with pytest.raises(AccuracyError, match=r"the result rows\.1\.error isn't a finite number"):
        print_json({"rows": [{"error": 1.0}, {"error": bad}]})


@pytest.mark.slow
@pytest.mark.parametrize("more", ["", 'support = [{ face = "x-" }]'])
def test_a_part_without_a_simulation_has_frequency_responses(fmd, capsys, tmp_path: Path, more: str) -> None:
    scene = tmp_path / "part.toml"
    scene.write_text(PART + more)
    asked = ("--in", "bar.middle.y", "--out", "bar.middle.y", "--to", "20 Hz", "--points", "20")
    assert fmd("frf", scene, *asked, "--folder", tmp_path, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    omega, answer = 2 * np.pi * np.array(found["frequencies_hz"]), np.array(found["real"])
    if more:  # a cantilever loaded in its middle: (l/2)³/3EI under the force, but for its clamp's stiffness
        stiffness = 3 * 210e9 * (0.02 * 0.01**3 / 12) / 0.15**3
        assert answer[0] == pytest.approx(1 / stiffness, rel=0.05)
    else:  # far below its first mode of 580 Hz a free bar moves as a rigid one, -1/mω²
        assert answer == pytest.approx(-1 / (7850 * 0.3 * 0.01 * 0.02 * omega**2), rel=0.01)
    assert fmd("linearise", scene, "--in", "bar.middle.y", "--out", "bar.tip.y", "--folder", tmp_path, "--json") == 0
    assert len(json.loads(capsys.readouterr().out)["outputs"]) == 1
