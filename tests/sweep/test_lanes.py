"""The table of a sweep whose points are marched in lanes, stopped and resumed, against runs by themselves."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError, InputError
from fmd.output.result_figures import result_figures
from fmd.output.summary import run_warnings
from fmd.scene.scene import Scene
from fmd.sweep.points import make_points, parse_variations
from fmd.sweep.record import Record, Wanted
from fmd.sweep.study import run_sweep
from fmd.sweep.table import SweepTable
from fmd.sweep.work import compute_points

# The rod is turned at 40 rad/s: a slider of 5 kg runs off on a spring of less than 8 kN/m, by exp(37 t) on 1 kN/m.
_SPUN = [
    'drive.motor={type="motion", joint="hinge", angle={formula="40*t", unit="rad"}}',
    'simulation.run=[{integrator="central-difference"}]',
    *("simulation.duration=4 s", "simulation.step=2 ms"),
]
_LOST, _TOO_STIFF = 1e3, 6e6  # [N/m]; the step is stable up to 5 MN/m
_WANTED = Wanted(results=("slider.centre.position", "slide.rate"), histories=True)
_STOPPED = 7  # points that are done before the sweep is stopped


def test_rows_of_points_in_lanes_are_those_of_runs_by_themselves_also_when_resumed(lanes: Any, tmp_path: Path) -> None:
    springs = np.random.default_rng(33).uniform(9e3, 2e4, 14)
    springs[[2, 6, 9]] = _LOST, _TOO_STIFF, 1.5 * _LOST
    variations = parse_variations([f"joint.slide.spring={','.join(f'{k!r} N/m' for k in springs.tolist())}"])
    points = make_points("rod-slider", variations, _SPUN)

    def compute(scenes: Mapping[str, Scene]) -> Iterator[tuple[str, Record]]:
        return compute_points(scenes, _WANTED)

    begun = run_sweep(variations, points[:_STOPPED], tmp_path, compute, wanted=_WANTED)
    whole = run_sweep(variations, points, tmp_path, compute, wanted=_WANTED)
    assert (begun.computed, whole.computed) == (_STOPPED, len(points) - _STOPPED)
    assert {*lanes.marches} == {_STOPPED - 1, len(points) - _STOPPED}  # without the one that is refused
    assert whole.records[:_STOPPED] == begun.records

    for spring, point, record, row in zip(springs, points, whole.records, SweepTable(whole).rows, strict=True):
        assert row["joint.slide.spring [N/m]"] == spring
        assert row["status"] == record.status
        assert point.scene is not None
        alone = SolvedScene(point.scene, Cache(None))
        if spring in (_LOST, 1.5 * _LOST, _TOO_STIFF):
            with pytest.raises((AccuracyError, InputError)) as fault:
                result_figures(alone.run, _WANTED.results, _WANTED.histories)
            assert record.message == str(fault.value)
            assert ("largest stable step" if spring == _TOO_STIFF else "the march diverged at t = ") in record.message
            assert record.status == ("refused" if spring == _TOO_STIFF else "failed")
            continue
        assert record.status == "ok", record.message
        assert record.summary["warnings"] == run_warnings(alone.run)
        expected = result_figures(alone.run, _WANTED.results, _WANTED.histories)
        for asked, figures in expected.items():
            for name, own in figures.items():
                found = record.summary["results"][asked][name]
                size = np.abs(own["history"]).max()
                assert found["history"] == pytest.approx(own["history"], rel=1e-10, abs=1e-10 * size)
                for column in ("smallest", "largest", "rms"):
                    assert row[f"{name}.{column}"] == pytest.approx(own[column], rel=1e-10, abs=1e-10 * size)
