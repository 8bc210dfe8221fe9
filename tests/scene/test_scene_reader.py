"""A scene read again and again with other values is the one that is read by itself, and so are its errors."""

from collections.abc import Callable

import pytest

from fmd.core.errors import InputError
from fmd.scene.scene import Scene, SceneReader, load_scene

CHANGES = {
    "rod-slider": [
        ["joint.slide.spring=900 N/m"],
        ["joint.slide.spring=0.8 N/mm"],
        ["joint.slide.spring=-1 N/m"],
        ["joint.slide.spring=700 N/m"],
        ["joint.slide.spring=700 N/m ± 2 %"],
        ["joint.slide.spring=600 N/m"],
        ["joint.slide.spring=0 N/m"],
        ["joint.slide.spring=900.0 N/m", "simulation.run.1.substeps=7"],
        ["simulation.run.1.substeps=7.0"],  # refused: no whole number, though equal to 7
        ["body.slider.mass=4 kg ± 2 %"],
        ["joint.slide.type=revolute"],
        ["joint.slide.parent=rod.nowhere"],
        ["body.slider.mass=-4 kg", "joint.slide.spring=x"],
        [],
    ],
    "arm": [
        ["joint.elbow.damper=0.1 N m s"],
        ["joint.elbow.damper=0.3 N m s", "joint.elbow.spring=50 N m"],
        ["joint.elbow.damper=0.1 N m s", "joint.elbow.spring=50"],  # refused: in a file it needs its unit
        ["joint.elbow.damper=0.4 N m s", "joint.elbow.spring=70 N m"],
        ["joint.elbow.damper=x", "joint.elbow.spring=80 N m"],
        ["joint.elbow.damper=0.5 N m s", "joint.elbow.spring=70 N m"],
        ["joint.elbow.spring=60 N m", "joint.elbow.damper=0.5 N m s"],
        [
            "joint.elbow.damper=0.7 N m s",
            "joint.elbow={ type = 'fixed', parent = 'upper.elbow', child = 'forearm.elbow' }",
        ],
        ["body.forearm.length=500 mm"],
        ["body.forearm.length=500 mm", "output.3.type=fatigue"],
        ["body.forearm.marker.wrist.face=x*"],
        ["simulation.duration=2 s", "simulation.tip=gripper.wrist"],
        [],
    ],
}


def _read(load: Callable[[list[str]], Scene], changes: list[str]) -> Scene | str:
    """Return a scene, or why it is refused."""
    try:
        return load(changes)
    except InputError as error:
        return str(error)


@pytest.mark.parametrize("name", CHANGES)
def test_a_scene_read_again_is_the_one_that_is_read_by_itself(name: str) -> None:
    reader, shared = SceneReader(name), 0
    last = reader.load([])
    for changes in CHANGES[name]:
        alone, again = (_read(load, changes) for load in (lambda given: load_scene(name, given), reader.load))
        if isinstance(alone, str) or isinstance(again, str):
            assert again == alone
            continue
        assert again == alone
        assert again.tolerances == alone.tolerances
        assert again.model_dump(mode="json") == alone.model_dump(mode="json")
        assert again.model_fields_set == alone.model_fields_set
        shared += sum(again.joint[joint] is last.joint[joint] for joint in last.joint)
        last = again
    assert shared
