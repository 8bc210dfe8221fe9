"""Points of a sweep, some at a time in a process, against runs of their scenes by themselves."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.core.limits.errors import SAFETY
from fmd.core.limits.stepping import FEWEST_TIMES
from fmd.integrators.automatic import Automatic
from fmd.integrators.protocol import Progress, Trajectory
from fmd.output.summary import summarise_solved
from fmd.scene.scene import load_scene
from fmd.stability import operating_points
from fmd.stages import like_mechanisms, variants
from fmd.stages.mechanism import build_mechanism
from fmd.stages.plan import Plan
from fmd.sweep import work
from fmd.sweep.points import make_points, parse_variations, point_key
from fmd.sweep.record import Wanted
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


@pytest.mark.parametrize(("at_once", "count"), [(variants.FINE_VALUES_AT_ONCE, 2), (1000, 4)])
def test_points_together_march_together_between_their_output_times_too_where_memory_holds_it(
    at_once: int, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    marched, march = list[int](), Plan.march
    monkeypatch.setattr(variants, "FINE_VALUES_AT_ONCE", at_once)

    def noted(plan: Plan, times: Array, progress: Progress | None = None) -> Trajectory:
        marched.append(len(times))
        return march(plan, times, progress)

    monkeypatch.setattr(work, "_last", [])
    monkeypatch.setattr(Plan, "march", noted)
    points = [load_scene("arm", [*_ARM, f"joint.elbow.damper={value} N m s"]) for value in (0.1, 0.2, 0.4)]
    records = dict(compute_points({point_key(point): point for point in points}))
    assert all(record.status == "ok" for record in records.values())
    assert (
        len(marched) == count
    )  # at the output times and between them, of the first alone, whose mechanism others take


def test_points_by_auto_share_a_choice_that_each_of_them_checks_by_marches_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fixed = [*_ARM, "body.forearm.modes.count=4", "simulation.duration=50 ms", "simulation.error=1e-2"]
    fixed += ['simulation.run=[{integrator="auto"}]']
    given = [[*fixed, f"joint.elbow.spring={value} N m"] for value in (50.0, 30.0, 6e3, 60.0, 70.0)]
    points = [load_scene("arm", each) for each in given]
    judge, judged = Automatic.judge, list[bool]()

    def judge_but_the_last(auto: Automatic, *of: Any) -> Trajectory | None:
        found = judge(auto, *of)
        judged.append(found is not None)
        return found if len(judged) in (1, 2, 4, 5, 7) else None  # the last of three doesn't agree, say

    monkeypatch.setattr(Automatic, "judge", judge_but_the_last)
    records = [record for _, record in compute_points({point_key(point): point for point in points})]
    rows = [record.summary["integrations"][0] for record in records]
    _, late, stiffest, shared, alone = (row["step_s"] for row in rows)
    assert judged == [False, False, False, False, True, True, True, True]  # the first after a third, shorter step
    assert late == pytest.approx(shared / FEWEST_TIMES)
    assert alone not in (stiffest, late)
    assert stiffest == shared
    assert rows[1]["integrator"] == "auto (central-difference)"
    exact = load_scene("arm", [*given[1], 'simulation.run=[{integrator="runge-kutta", tolerance=1e-6}]'])
    motion = SolvedScene(exact, Cache(None)).run.motion
    for joint, angle in motion.final()["joint_positions"].items():
        error = abs(rows[1]["final"]["joint_positions"][joint] - angle) / np.ptp(motion.joint_position(joint))
        assert error < rows[1]["error"] < SAFETY * 1e-2


def test_the_first_points_of_a_process_take_the_body_and_the_mechanism_of_its_very_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(work, "_last", [])
    built: list[int] = []
    monkeypatch.setattr(
        like_mechanisms, "build_mechanism", lambda *given: (built.append(1), build_mechanism(*given))[1]
    )
    points = [load_scene("arm", [*_ARM, f"joint.elbow.damper={value} N m s"]) for value in (0.1, 0.2, 0.3, 0.4)]
    records = dict(compute_points({point_key(point): point for point in points}, Wanted(results=("tip",))))
    assert {record.status for record in records.values()} == {"ok"}
    assert len(built) <= 2  # with its body as it is and stiffened


def test_points_by_reversible_sub_cycling_find_their_operating_points_together_and_move_as_by_themselves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, find = list[int](), operating_points.find_operating_points
    monkeypatch.setattr(work, "_last", [])
    monkeypatch.setattr(operating_points, "find_operating_points", lambda *of: (found.append(1), find(*of))[1])
    fixed = [*_ARM, 'simulation.run=[{integrator="reversible-sub-cycling", substeps=5}]']
    points = [load_scene("arm", [*fixed, f"joint.elbow.damper={value} N m s"]) for value in (0.1, 0.2, 0.4)]
    wanted = Wanted(results=("tip",))
    together = dict(compute_points({point_key(point): point for point in points}, wanted))
    assert len(found) == 1  # the first of a process, whose mechanism others take, is computed before them
    for point in points:
        ((key, alone),) = compute_points({point_key(point): point}, wanted)
        assert alone.status == "ok"
        assert alone.summary == together[key].summary
    assert len(found) == 1 + len(points)


def test_a_point_that_is_refused_changes_none_that_is_computed_with_it() -> None:
    fixed = [_RUN, "simulation.duration=1 s", "simulation.step=25 ms"]  # too long from 32 kN/m on
    points = [load_scene("rod-slider", [*fixed, f"joint.slide.spring={k} N/m"]) for k in (1000, 100_000, 2000)]
    records = [record for _, record in compute_points({point_key(point): point for point in points})]
    assert [record.status for record in records] == ["ok", "refused", "ok"]
    assert "largest stable step" in records[1].message
    assert records[2].summary["integrations"][0]["stability_margin"] > 1.0


def test_results_by_name_are_those_of_the_summary_and_nothing_else_is_computed() -> None:
    fixed = [*_ARM, "joint.elbow.damper=0.2 N m s"]
    point = load_scene("arm", fixed)
    (whole,) = [record.summary for _, record in compute_points({point_key(point): point})]
    for names, stages in ((("forearm.stress",), {"motion"}), (("forearm.frequency.1", "mass"), set())):
        ((_, record),) = compute_points({point_key(point): point}, Wanted(results=names, histories=True))
        assert "integrations" not in record.summary
        (solved,) = work._last
        assert {"motion", "equations", "stability"} & {*solved.results} >= stages
        assert bool(stages) == ("fine motion" in solved.results)  # a largest stress may lie between output times
        assert bool(stages) == ("motion" in solved.results) == ("times_s" in record.summary)
        found = {name: own["value"] for each in record.summary["results"].values() for name, own in each.items()}
        expected = {
            "forearm.stress": whole["worst_stress"]["von_mises_pa"],
            "forearm.frequency.1": whole["frequencies_hz"][0],
            "mass": 1.5 + 0.4 + 0.6 * 0.012 * 0.04 * 2700,
        }
        assert found == {name: pytest.approx(expected[name], rel=1e-9) for name in names}
        if stages:
            assert record.summary["warnings"] == whole["warnings"]


def test_points_have_the_first_run_of_a_scene_and_say_how_many_others_they_lack() -> None:
    variations = parse_variations(["joint.slide.spring=1000 N/m,1100 N/m"])
    first, every = (make_points("rod-slider", variations, all_runs=each) for each in (False, True))
    assert [point.left_out for point in first] == [2, 2]
    assert [point.left_out for point in every] == [0, 0]
    assert first[0].key != every[0].key
    records = [next(iter(compute_points({points[0].key: points[0].scene})))[1] for points in (first, every)]
    (own,), (same, *_) = (record.summary["integrations"] for record in records)
    assert own["final"] == same["final"]


@pytest.mark.parametrize(("more", "says"), [((), True), (("--all-runs",), False), (("--of", "slide.position"), False)])
def test_the_terminal_says_which_runs_the_points_have(
    fmd, tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch, more: tuple[str, ...], says: bool
) -> None:
    """Of three runs, by the summary of the first alone; the points are computed in this process."""
    monkeypatch.setattr("fmd.cli.sweep.prepare_workers", lambda: None)
    monkeypatch.setattr("fmd.sweep.plot.draw_sweep", lambda *_: [])
    monkeypatch.setattr("fmd.cli.sweep.compute_locally", lambda scenes, workers, wanted: compute_points(scenes, wanted))
    given = ("--vary", "joint.slide.spring=1000 N/m,1100 N/m", "--set", "simulation.duration=0.2 s")
    assert fmd("sweep", "rod-slider", *given, "--out", tmp_path, *more) == 0
    said = "points have the first of the scene's 3 runs; --all-runs computes all"
    assert (said in capsys.readouterr().out) == says
