"""Places on the ground: joints hang on them, and their axes turn all that hangs there."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.recovery.motion import Motion
from fmd.stages.parent_joint import axes_in_space, ground_place, read_parent_joint
from tests.stages.test_mechanism import CRANK

PLACE = '\n[ground.B0]\nat = ["1 m", "-2 m", "0.5 m"]\nrotation = ["20 deg", "-35 deg", "50 deg"]\n'
R = Rotation.from_rotvec(np.deg2rad([20.0, -35.0, 50.0])).as_matrix()


def march(folder: Path, text: str, *overrides: str) -> Motion:
    file = folder / "scene.toml"
    file.write_text(text)
    return Pipeline(load_scene(file, overrides)).motion


def weight(g: Array) -> str:
    return f"simulation.gravity={[f'{x!r} m/s^2' for x in g.tolist()]}"


def test_a_mechanism_on_a_turned_place_moves_as_on_the_ground_under_turned_gravity(tmp_path: Path) -> None:
    g = np.array([1.0, -9.0, 3.0])
    on_ground = march(tmp_path, CRANK, weight(R.T @ g))
    on_place = march(tmp_path, CRANK.replace('"ground"', '"ground.B0"') + PLACE, weight(g))
    assert on_place.kinematics.q == pytest.approx(on_ground.kinematics.q, abs=1e-8)
    assert np.ptp(on_ground.kinematics.q) > 0.5  # it moves
    moved = np.array([1.0, -2.0, 0.5]) + on_ground.tip_position @ R.T
    assert on_place.tip_position == pytest.approx(moved, abs=1e-8)
    for one, other in zip(on_place.energies, on_ground.energies, strict=True):
        assert np.diff(one) == pytest.approx(np.diff(other), abs=1e-7)
    turned = on_ground.centre_angular_velocity[1:]  # seen from the first joint
    assert on_place.centre_angular_velocity[1:] == pytest.approx(turned, abs=1e-6)


def test_a_quarter_turn_has_whole_axes() -> None:
    scene = load_scene("beam-paper", ['ground={p={at=["1 m","0 m","0 m"], rotation=["0 deg","0 deg","90 deg"]}}'])
    at, axes = ground_place(scene, "ground.p")
    assert at.tolist() == [1.0, 0.0, 0.0]
    assert axes.tolist() == [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    assert ground_place(scene, "ground")[1].tolist() == np.eye(3).tolist()


def test_bodies_have_the_axes_of_the_place_that_they_hang_on(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(CRANK.replace('"ground"', '"ground.B0"') + PLACE)
    scene = load_scene(tmp_path / "scene.toml")
    assert axes_in_space(scene, "slider") == pytest.approx(R, abs=1e-15)


@pytest.mark.parametrize(
    ("turn", "gravity", "planar"),
    [
        ('["0 deg", "0 deg", "30 deg"]', "[0, -9.81, 0]", True),  # about the hinge itself
        ('["90 deg", "0 deg", "0 deg"]', "[0, -9.81, 0]", False),  # the hinge is along gravity now
        ('["90 deg", "0 deg", "0 deg"]', "[1, 0, -9.81]", True),
    ],
)
def test_a_motion_is_plane_by_axes_in_space(turn: str, gravity: str, planar: bool) -> None:
    place = f'ground={{p={{at=["0 m","0 m","0 m"], rotation={turn}}}}}'
    g = gravity.strip("[]").split(", ")
    pull = f"simulation.gravity={[f'{x} m/s^2' for x in g]}"
    scene = load_scene("beam-paper", [place, "joint.hub.parent=ground.p", pull])
    assert read_parent_joint(scene, "beam").in_plane is planar


@pytest.mark.parametrize(
    ("override", "key", "said"),
    [
        ("joint.hub.parent=ground.B1", "joint.hub.parent", "no such place; did you mean 'ground.B0'?"),
        ("joint.hub.parent=grund.B0", "joint.hub.parent", "no such body"),
        ("joint.hub.child=ground.B0", "joint.hub.child", "holds ground to itself"),
        ("simulation.tip=ground.B0", "simulation.tip", "no such body"),
        ("ground.B0.at=[0, 0, 0]", "ground.B0.at.0", "needs a unit"),
        ('ground.B0.rotation=["1 m", "0 deg", "0 deg"]', "ground.B0.rotation.0", "an angle is wanted"),
    ],
)
def test_places_that_are_not_there_are_refused(tmp_path: Path, override: str, key: str, said: str) -> None:
    (tmp_path / "scene.toml").write_text(CRANK + PLACE)
    with pytest.raises(InputError) as caught:
        load_scene(tmp_path / "scene.toml", [override])
    assert caught.value.key == key
    assert said in str(caught.value)
