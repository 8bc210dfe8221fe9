"""Pictures of a contact's pressure: what is drawn is what the motion has, and what can't be is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import InputError
from fmd.output.pressure import _fill, draw_pressure
from fmd.scene.stress_outputs import ContactPressure
from tests.contact.test_contact_points import BLOCK

OUTPUT = [{"type": "pressure", "file": "pressure.png", "contact": "floor"}]


@pytest.fixture(scope="module")
def dropped() -> Pipeline:
    return Pipeline(load_scene(BLOCK | {"output": OUTPUT}, ['joint.free.rotate=["2 deg", "0 deg", "3 deg"]']))


def draw(run: Pipeline, folder: Path, **settings: Any) -> dict[str, Any]:
    drawn: dict[str, Any] = {}

    def keep(_name: str, surface: Any, values: Any, path: Path, **words: Any) -> None:
        drawn.update(words, surface=surface, values=values, path=path)

    assert isinstance(run.scene.output[0], ContactPressure)
    output = run.scene.output[0].model_copy(update=settings)
    draw_pressure(run, output, folder, keep)
    return drawn


def test_the_picture_has_the_largest_pressure_at_its_place_and_the_force_by_areas(
    dropped: Pipeline, tmp_path: Path
) -> None:
    drawn, floor = draw(dropped, tmp_path), dropped.motion.contacts["floor"]
    points = dropped.parts["block"].contact_points
    assert floor.largest[2] > 1.01 * floor.peak_pressure.max()  # it passes between output times
    assert drawn["values"].max() == pytest.approx(1e-6 * floor.largest[2], rel=1e-12)
    k, time = int(floor.tops[:, 2].argmax()), 1e-3 * float(drawn["label"].split(" at ")[1].split()[0])
    assert dropped.motion.times[k - 1] < time < dropped.motion.times[k]
    pressed = drawn["surface"].points[drawn["values"] > 0.0]
    assert np.ptp(pressed[:, 1]) < 1e-12  # on the bottom alone
    pressures = dropped.motion.contact_pressures["block"][:, points.faces["bottom"]]
    np.testing.assert_allclose(pressures @ points.areas["bottom"], floor.force[:, 1], atol=1e-9)


def test_a_picture_of_slip_has_how_far_each_point_has_rubbed(dropped: Pipeline, tmp_path: Path) -> None:
    drawn, floor = draw(dropped, tmp_path, quantity="slip"), dropped.motion.contacts["floor"]
    assert drawn["quantity"] == "slip [µm]"
    assert drawn["values"].max() == pytest.approx(1e6 * floor.slip[-1], rel=1e-12)
    assert (np.diff(dropped.motion.contact_slips["block"], axis=0) >= 0.0).all()
    assert 0.0 < floor.mean_slip[-1] < floor.slip[-1]


def test_the_camera_looks_onto_the_face_unless_it_is_given(dropped: Pipeline, tmp_path: Path) -> None:
    angles = draw(dropped, tmp_path)["camera"].angles
    assert angles == pytest.approx([-90.0 + np.rad2deg(0.5), np.rad2deg(0.5)], abs=1e-6)
    given = draw(dropped, tmp_path, camera=(0.1, 0.2))["camera"].angles
    assert given == pytest.approx(np.rad2deg([0.1, 0.2]))


def test_nodes_without_pressure_of_their_own_take_the_mean_around_on_the_face_alone() -> None:
    values, known = np.array([0.0, 2.0, 4.0, 0.0]), np.array([False, True, True, False])
    triangles = np.array([[0, 1, 2], [1, 3, 2]])
    on_face = np.array([True, True, True, False])
    assert _fill(values, known, on_face, triangles).tolist() == [3.0, 2.0, 4.0, 0.0]


def test_a_contact_that_isnt_there_or_presses_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="flor"):
        load_scene(BLOCK | {"output": [OUTPUT[0] | {"contact": "flor"}]})
    run = Pipeline(load_scene(BLOCK | {"output": OUTPUT}, ["simulation.duration=2 ms"]))
    with pytest.raises(InputError, match="presses nothing at any output time"):
        draw(run, tmp_path)
