"""Drawings of a run's outputs: which stages they read, and what they show."""

from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.image import imread

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.core.errors import InputError
from fmd.output.exports import EXPORTS
from fmd.output.output_kinds import kind_named, kind_of
from fmd.output.pictures import draw_modes, draw_stress
from fmd.scene.outputs import OUTPUT_MODELS
from fmd.stages.part import PART_STAGES

SMALL = ["body.beam.mesh.divisions=[12, 2, 1]", "simulation.duration=20 ms"]


@pytest.fixture(scope="module")
def run() -> Pipeline:
    return Pipeline(load_scene("beam", SMALL), Cache(None))


def test_outputs_and_exports_read_stages_that_there_are(run):
    exports = [f'{{type="export", file="file{suffix}", body="beam"}}' for suffix in EXPORTS]
    for output in (*run.scene.output, *load_scene("beam", [*SMALL, f"output=[{', '.join(exports)}]"]).output):
        reads = list(kind_of(output).reads(run, output))
        assert {body for _, body in reads} <= {"beam"}
        assert {stage for stage, _ in reads} <= set(PART_STAGES)
        assert reads or output.type == "chart"


def test_every_type_of_output_can_be_drawn_or_written():
    for type in OUTPUT_MODELS:
        kind = kind_named(type)
        assert kind.draw or kind.write or kind.response


def test_still_pictures_need_no_motion(run, tmp_path):
    output = next(output for output in run.scene.output if output.type == "modes")
    small = output.model_copy(update={"size": (160, 90)})
    assert len(draw_modes(run, small, tmp_path)) == len(run.modes.omega)
    assert "motion" not in run.log.seconds
    assert imread(tmp_path / "mode-1.png").shape[:2] == (90, 160)


def test_chosen_modes_alone_are_drawn(run, tmp_path):
    output = next(output for output in run.scene.output if output.type == "modes").model_copy(update={"size": (64, 36)})
    assert draw_modes(run, output, tmp_path, numbers=[2, 99]) == ["mode-2.png"]


def test_an_unknown_colour_map_is_refused_with_the_key(run, tmp_path):
    output = next(output for output in run.scene.output if output.type == "modes")
    with pytest.raises(InputError, match="no-such-colours"):
        draw_modes(run, output.model_copy(update={"colour_map": "no-such-colours"}), tmp_path)


def test_the_stress_picture_is_of_the_worst_instant(run, tmp_path, monkeypatch):
    seen = SimpleNamespace()

    def note(surface, deformation, values, path, **settings):
        seen.values, seen.title = values, settings["title"]

    monkeypatch.setattr("fmd.render.pictures.draw_stress", note)
    output = next(output for output in run.scene.output if output.type == "stress")
    draw_stress(run, output, tmp_path)
    time, _, worst = run.stress_of("beam").worst()
    assert np.max(seen.values) == pytest.approx(worst)
    assert f"t = {1e3 * time:.6g} ms" in seen.title
