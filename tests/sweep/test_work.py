"""Points of a sweep, some at a time in a process, against runs of their scenes by themselves."""

from typing import Any

import numpy as np
import pytest

from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.cache import Cache
from fmd.output.summary import summarise_solved
from fmd.scene.scene import load_scene
from fmd.sweep.points import point_key
from fmd.sweep.work import compute_points

_RUN = 'simulation.run=[{integrator="central-difference"}]'
_ARM = [_RUN, "simulation.duration=20 ms", "body.forearm.mesh.divisions=[6, 1, 2]", "body.forearm.modes.count=2"]
# Of times, of what a cache held, and what only a run by itself compares.
_OF_THE_RUN = {"seconds", "stages_run", "stages_cached", "stages_skipped", "spread"} | {
    "ratio_to_plain",
    "part_over_plain",
}


def _numbers(value: Any, path: str = "") -> dict[str, Any]:
    if isinstance(value, dict):
        items = [(f"{path}.{key}", item) for key, item in value.items() if key not in _OF_THE_RUN]
    elif isinstance(value, list):
        items = [(f"{path}.{k}", item) for k, item in enumerate(value)]
    else:
        return {path: value}
    return {name: leaf for key, item in items for name, leaf in _numbers(item, key).items()}


@pytest.mark.parametrize(
    ("scene", "fixed", "key", "low", "high", "unit"),
    [
        ("rod-slider", ["simulation.duration=1 s"], "joint.slide.spring", 300.0, 3000.0, "N/m"),
        ("arm", _ARM, "joint.elbow.damper", 0.05, 0.5, "N m s"),
        ("arm", _ARM, "body.gripper.mass", 0.3, 0.5, "kg"),
    ],
)
def test_figures_of_points_together_are_those_of_runs_by_themselves(
    scene: str, fixed: list[str], key: str, low: float, high: float, unit: str
) -> None:
    values = np.random.default_rng(7).uniform(low, high, 3).tolist()
    points = [load_scene(scene, [*fixed, f"{key}={value!r} {unit}"]) for value in values]
    records = dict(compute_points({point_key(point): point for point in points}))
    for point in points:
        record = records[point_key(point)]
        assert record.status == "ok", record.message
        alone = _numbers(summarise_solved(SolvedScene(point, Cache(None))))
        found = _numbers(record.summary)
        assert found.keys() == alone.keys()
        for name, expected in alone.items():
            if isinstance(expected, float):
                assert found[name] == pytest.approx(expected, rel=1e-9, abs=1e-12), name
            else:
                assert found[name] == expected, name


def test_a_point_that_is_refused_changes_none_that_is_computed_with_it() -> None:
    fixed = [_RUN, "simulation.duration=1 s", "simulation.step=25 ms"]  # too long from 32 kN/m on
    points = [load_scene("rod-slider", [*fixed, f"joint.slide.spring={k} N/m"]) for k in (1000, 100_000, 2000)]
    records = [record for _, record in compute_points({point_key(point): point for point in points})]
    assert [record.status for record in records] == ["ok", "refused", "ok"]
    assert "largest stable step" in records[1].message
    assert records[2].summary["integrations"][0]["stability_margin"] > 1.0
