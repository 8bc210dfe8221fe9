"""A process that draws: order, errors, its death, and the pause while something is timed."""

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fmd.core.errors import InputError
from fmd.meshes.gmsh_session import gmsh_model
from fmd.output.picture_files import DrawingProcess
from fmd.render.calls import draw_here
from fmd.render.chart_data import Curve

pytestmark = pytest.mark.slow

TIMES = np.linspace(0.0, 1.0, 11)


def draw_line(draw, path: Path, slope: float = 1.0) -> None:
    draw("charts.draw_chart", TIMES, [Curve("line", slope * TIMES)], path, title="a line", ylabel="x [m]")


@pytest.fixture(scope="module")
def process() -> Iterator[DrawingProcess]:
    with DrawingProcess("scene.toml") as process:
        yield process


def test_pictures_are_the_same_as_drawn_here(process: DrawingProcess, tmp_path: Path) -> None:
    for slope in (1.0, 2.0):
        draw_line(process, tmp_path / f"there-{slope}.png", slope)
    process.finish()
    for slope in (1.0, 2.0):
        draw_line(draw_here, tmp_path / f"here-{slope}.png", slope)
        assert (tmp_path / f"there-{slope}.png").read_bytes() == (tmp_path / f"here-{slope}.png").read_bytes()


def test_an_error_comes_back_and_the_next_picture_is_drawn(process: DrawingProcess, tmp_path: Path) -> None:
    process("charts.draw_chart", TIMES, [], tmp_path / "none.png", title="", ylabel="")
    draw_line(process, tmp_path / "line.png")
    with pytest.raises(ValueError, match="a chart needs at least one curve"):
        process.finish()
    process.finish()
    assert (tmp_path / "line.png").exists()


def test_a_process_that_dies_is_reported_with_its_remedy(tmp_path: Path) -> None:
    with DrawingProcess("scene.toml") as process:
        process.start()
        process.require_ready()
        assert process._process is not None
        process._process.kill()
        process._process.wait()
        with pytest.raises(InputError, match=r"scene.toml: output: .*died of SIGKILL; .*--no-pictures"):  # noqa: PT012
            draw_line(process, tmp_path / "line.png")
            process.finish()


def test_nothing_is_drawn_while_something_is_timed(process: DrawingProcess, tmp_path: Path) -> None:
    picture = tmp_path / "line.png"
    draw_line(process, tmp_path / "first.png")  # which takes longest
    process.finish()
    with process.paused():
        draw_line(process, picture)
        time.sleep(0.5)
        assert picture.exists() == (sys.platform == "win32")
    process.finish()
    assert picture.exists()


def test_a_process_that_is_not_needed_is_never_started() -> None:
    with DrawingProcess("scene.toml") as process:
        process.require_ready()
        with process.paused():
            process.finish()
        assert process._process is None


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such signals")
def test_a_broken_pipe_is_an_error_after_meshing_too() -> None:
    with gmsh_model("empty"):
        pass
    reader, writer = os.pipe()
    os.close(reader)
    with pytest.raises(BrokenPipeError):  # Gmsh would have the signal end this process
        os.write(writer, b"x")
    os.close(writer)


def test_a_machine_that_cannot_draw_is_refused_before_anything_is_integrated(fmd, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("FMD_CACHE", str(tmp_path / "cache"))
    program = tmp_path / "python"
    program.write_text("#!/bin/sh\nkill -SEGV $$\n")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))
    monkeypatch.setattr("fmd.stages.pipeline.Pipeline.motions", property(lambda run: pytest.fail("integrated")))
    assert fmd("run", "beam-paper", "--out", str(tmp_path / "out")) == 2
    said = capsys.readouterr().err
    assert "drawing off-screen died of SIGSEGV" in said
    assert "apt-get install libgl1 libegl1" in said
    assert not (tmp_path / "out").exists()
