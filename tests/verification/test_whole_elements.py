"""Scenes of the product beside whole finite elements in motion, which know neither frame, modes nor joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import load
from tests.verification.whole_elements import WholeElements, WholeMotion
from tests.verification.whole_scenes import WholeScene, random_scene

pytestmark = pytest.mark.slow

SEEDS = range(6)
STEPS = (8, 16)  # of the whole elements between two output times: their difference bounds the finer one's error
ROUND_OFF = 1e-6


def marker_motion(whole: WholeElements, field: Any, marker: Any) -> Any:
    """Return a marker's mean of a field over time, shape (n_times, 3)."""
    return np.einsum("n,tna->ta", marker.translation_weights, field[:, marker.nodes])


def deflection(whole: WholeElements, motion: WholeMotion, marker: Any) -> Any:
    """Return how a marker moves beside the turned root, in space, shape (n_times, 3)."""
    turned = np.array([whole.turned(t)[0] for t in motion.times])
    return marker_motion(whole, motion.u - turned, marker)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_scene_moves_as_its_whole_elements_do_within_its_stated_errors(tmp_path: Path, seed: int) -> None:
    scene: WholeScene = random_scene(seed)
    (tmp_path / "scene.toml").write_text(scene.text)
    result = load(tmp_path / "scene.toml")
    result.write(tmp_path / "out")
    with (tmp_path / "out" / "all.csv").open() as file:
        names = file.readline().strip().split(",")
        table = dict(zip(names, np.loadtxt(file, delimiter=",").T, strict=True))
    whole, times = scene.whole(result), table["time [s]"]
    rough, fine = (whole.march(times, steps) for steps in STEPS)
    x, markers = whole.solid.fe.x, result.run.parts["bar"].markers
    stated = {row["quantity"]: row["total"] for row in result.budget.summary()["rows"]}

    def columns(name: str, unit: str) -> Any:
        return np.stack([table[f"{name}.{axis} [{unit}]"] for axis in "xyz"], axis=1)

    def check(name: str, ours: Any, one: Any, other: Any, size: float, allowed: float) -> None:
        wrong, own = np.abs(ours - other).max() / size, np.abs(one - other).max() / size
        assert own < 0.5, f"{name}: the whole elements' own error is {own:.2g}"
        assert wrong <= allowed + 2 * own + ROUND_OFF, f"{name}: off by {wrong:.2g}, {allowed:.2g} stated"

    for name in ("tip", "side"):
        marker = markers[name]
        size = np.abs(deflection(whole, fine, marker)).max()
        places = [marker_motion(whole, motion.u + x, marker) for motion in (rough, fine)]
        check(f"position of {name}", columns(f"bar.{name}.position", "m"), *places, size, stated["tip, deflection"])
    largest = [np.array([max(whole.von_mises(u).max() for u in motion.u)]) for motion in (rough, fine)]
    worst = np.array([result.summary["worst_stress"]["bar"]["value_pa"]])
    check("largest stress", worst, *largest, largest[1][0], stated["bar, largest von Mises stress"])
