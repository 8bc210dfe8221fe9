"""Scenes of the product beside whole finite elements in motion, which know neither frame, modes nor joints."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import Result, load
from tests.verification.whole_elements import WholeElements, WholeMotion
from tests.verification.whole_scenes import WholeScene, random_blow, random_scene

pytestmark = pytest.mark.slow

MORE = pytest.mark.long
SEEDS = (0, pytest.param(1, marks=MORE))
BLOWS = tuple(pytest.param(seed, marks=MORE) for seed in range(3))
STEPS = (4, 8)  # of the whole elements between two output times: their difference bounds the finer one's error
STEPS_OF_BLOWS = (16, 32)
MOST_STATED = 20.0  # stated over true error
ROUND_OFF = 1e-6


def marker_motion(whole: WholeElements, field: Any, marker: Any) -> Any:
    """Return a marker's mean of a field over time, shape (n_times, 3)."""
    return np.einsum("n,tna->ta", marker.translation_weights, field[:, marker.nodes])


def deflection(whole: WholeElements, motion: WholeMotion, marker: Any) -> Any:
    """Return how a marker moves beside the turned root, in space, shape (n_times, 3)."""
    turned = np.array([whole.turned(t)[0] for t in motion.times])
    return marker_motion(whole, motion.u - turned, marker)


def run_scene(scene: WholeScene, folder: Path) -> tuple[Result, dict[str, Any]]:
    """Run a scene as ``fmd run`` does, and return its result and the columns of its history."""
    (folder / "scene.toml").write_text(scene.text)
    result = load(folder / "scene.toml")
    result.write(folder / "out")
    with (folder / "out" / "all.csv").open() as file:
        names = file.readline().strip().split(",")
        return result, dict(zip(names, np.loadtxt(file, delimiter=",").T, strict=True))


def columns_of(table: dict[str, Any], name: str, unit: str) -> Any:
    """Return a vector over time from the columns of a history, shape (n_times, 3)."""
    return np.stack([table[f"{name}.{axis} [{unit}]"] for axis in "xyz"], axis=1)


@pytest.mark.parametrize("seed", BLOWS)
def test_accelerations_and_reactions_to_a_blow_are_within_their_stated_errors(tmp_path: Path, seed: int) -> None:
    scene = random_blow(seed)
    result, table = run_scene(scene, tmp_path)
    whole = scene.whole(result)
    rough, fine = (whole.march(table["time [s]"], steps) for steps in STEPS_OF_BLOWS)
    rows = {row.name: row for row in result.budget.details}
    tip = result.run.parts["bar"].markers["tip"]
    accelerations = [marker_motion(whole, motion.a, tip) for motion in (rough, fine)]
    for name, unit, (one, other) in (
        ("bar.tip.acceleration", "m/s^2", accelerations),
        ("hub.force", "N", (rough.reaction, fine.reaction)),
    ):
        wrong, own = (np.linalg.norm(each - other, axis=1).max() for each in (columns_of(table, name, unit), one))
        assert own < 0.5 * np.linalg.norm(other, axis=1).max(), f"{name}: the whole elements are off by {own:.3g}"
        assert wrong <= rows[name].size + own, f"{name}: off by {wrong:.3g} {unit}, {rows[name].size:.3g} stated"
        assert rows[name].size <= MOST_STATED * (wrong + own)


@pytest.mark.long
@pytest.mark.parametrize("seed", SEEDS)
def test_a_scene_moves_as_its_whole_elements_do_within_its_stated_errors(tmp_path: Path, seed: int) -> None:
    scene: WholeScene = random_scene(seed)
    result, table = run_scene(scene, tmp_path)
    whole, times = scene.whole(result), table["time [s]"]
    rough, fine = (whole.march(times, steps) for steps in STEPS)
    x, markers = whole.solid.fe.x, result.run.parts["bar"].markers
    stated = {row["quantity"]: row["total"] for row in result.budget.summary()["rows"]}

    def check(name: str, ours: Any, one: Any, other: Any, size: float, allowed: float) -> None:
        wrong, own = np.abs(ours - other).max() / size, np.abs(one - other).max() / size
        assert own < 0.5, f"{name}: the whole elements' own error is {own:.2g}"
        assert wrong <= allowed + 2 * own + ROUND_OFF, f"{name}: off by {wrong:.2g}, {allowed:.2g} stated"

    for name in ("tip", "side"):
        marker = markers[name]
        size = np.abs(deflection(whole, fine, marker)).max()
        places = [marker_motion(whole, motion.u + x, marker) for motion in (rough, fine)]
        check(
            f"position of {name}",
            columns_of(table, f"bar.{name}.position", "m"),
            *places,
            size,
            stated["tip, deflection"],
        )
    size, row = np.abs(fine.reaction).max(), next(row for row in result.budget.details if row.name == "hub.force")
    check("force of the hub", columns_of(table, "hub.force", "N"), rough.reaction, fine.reaction, size, row.size / size)
    largest = [np.array([max(whole.von_mises(u).max() for u in motion.u)]) for motion in (rough, fine)]
    worst = np.array([result.summary["worst_stress"]["bar"]["value_pa"]])
    check("largest stress", worst, *largest, largest[1][0], stated["bar, largest von Mises stress"])
