"""Tables of frequencies: beside a scene's reference, and on a hub that turns."""

import csv

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.output.campbell import compute_campbell, write_campbell
from fmd.output.frequencies import frequency_table, rotating_table

SMALL = ["body.beam.mesh.divisions=[12, 2, 1]"]


@pytest.fixture(scope="module")
def run() -> Pipeline:
    return Pipeline(load_scene("beam-paper", [*SMALL, 'simulation.stiffening="auto"']), Cache(None))


def test_the_error_is_relative_to_the_scenes_reference(run):
    table = frequency_table(run)
    found, wanted = np.array(table["frequencies_hz"]), np.array(run.scene.reference.frequencies)
    assert table["relative_error"] == pytest.approx((found / wanted - 1).tolist(), abs=1e-15)
    assert table["rigid_modes"] == 6


def test_a_scene_without_a_reference_has_no_errors():
    alone = frequency_table(Pipeline(load_scene("spin-up"), Cache(None)))
    assert alone["reference_hz"] == alone["relative_error"] == []
    assert len(alone["frequencies_hz"]) > 0


def test_at_rest_a_hub_turns_no_frequency_away(run):
    held = rotating_table(run, 0.0)["rotating_frequencies_hz"]
    assert held == pytest.approx(run.body.frequencies_hz.tolist(), rel=1e-9)


def test_a_campbell_diagram_is_written_as_table_and_chart(run, tmp_path):
    rates = np.array([0.0, 100.0, 200.0])
    diagram = compute_campbell(run, rates, ())
    table, files = diagram.frequencies_hz, write_campbell(diagram, tmp_path)
    assert table.shape[0] == 3
    assert table.shape[1] >= len(run.body.omega)  # and what static responses add
    assert (np.diff(table[:, 0]) > 0).all()  # the hub's own turning stiffens the beam
    with (tmp_path / files[0]).open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0][:2] == ["rate_rad_s", "mode_1_hz"]
    assert {row.pop() for row in rows[1:]} == {"not stated: no errors were estimated"}
    assert np.array(rows[1:], dtype=float) == pytest.approx(
        np.column_stack([rates, table, diagram.growth, diagram.damping, diagram.whirl]), rel=1e-4, abs=1e-9
    )
    assert (tmp_path / files[1]).stat().st_size > 5000
