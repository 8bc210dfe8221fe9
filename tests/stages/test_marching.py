"""Motions of a scene's runs, and what is made anew where one lost its inertia."""

from types import SimpleNamespace
from typing import Any

import pytest

from fmd.core.errors import AccuracyError, InertiaError
from fmd.stages import marching


def lossy_run(lossy: int) -> Any:
    """Return a run without flexible bodies, whose trajectories lose their inertia so many times."""
    left = [lossy]

    class Run:
        scene: Any = SimpleNamespace(simulation=SimpleNamespace(n_outputs=1))
        whole_energy, bodies, stiffness_changes, plans = False, dict[str, Any](), dict[str, Any](), dict[str, Any]()

        def __init__(self) -> None:
            self.mechanism, self.results = "made before", {"motion": {}}

        @property
        def trajectories(self) -> dict[str, Any]:
            left[0] -= 1
            if left[0] >= 0:
                raise InertiaError("a motion has -1 times its inertia")
            return {}

    return Run()


@pytest.fixture(autouse=True)
def _room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(marching, "require_room", lambda scene, mechanism: None)


def test_a_motion_that_lost_its_inertia_is_found_anew_with_the_whole_energy() -> None:
    run = lossy_run(1)
    type(run).mechanism = "made anew"
    assert marching.find_motions(run) == {}
    assert run.whole_energy
    assert run.mechanism == "made anew"
    assert run.results == {}


def test_nothing_is_made_anew_without_need() -> None:
    run = lossy_run(0)
    marching.find_motions(run)
    assert not run.whole_energy
    assert run.mechanism == "made before"
    assert run.results == {"motion": {}}


def test_a_motion_that_loses_its_inertia_all_the_same_is_refused() -> None:
    run = lossy_run(2)
    type(run).mechanism = "made anew"
    with pytest.raises(AccuracyError, match="a motion has -1 times its inertia"):
        marching.find_motions(run)
