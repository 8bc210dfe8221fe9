"""Motions of a scene's runs, and what is made anew where one lost its inertia."""

from types import SimpleNamespace
from typing import Any

import pytest

from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError, InertiaError
from fmd.core.progress import silent
from fmd.stages import runs
from fmd.stages.stage import Stage
from fmd.stages.store import StageStore


class LossyRun:
    """A run without flexible bodies, whose mass matrix isn't positive definite after the first so many marches."""

    scene: Any = SimpleNamespace(simulation=SimpleNamespace(n_outputs=1, run=()), contact={})
    store = StageStore(Cache(None))
    output_times, stiffness_changes, whole_energy = (0.0,), None, False
    mechanism: Stage[str] = Stage("mechanism", lambda run: "made anew")
    compiled_plans: Stage[dict[str, Any]] = Stage("machine code", lambda run: {"run": run}, ("mechanism",))

    def __init__(self, lossy: int) -> None:
        self.left, self.results = lossy, {"mechanism": "made before", "loads": "kept"}

    def while_timed(self) -> Any:
        return silent("")

    def march(self, times: Any, advance: Any) -> Any:
        return self.mechanism

    def require_positive_mass(self, trajectory: Any) -> None:
        self.left -= 1
        if self.left >= 0:
            raise InertiaError("a motion has -1 times its inertia")

    def motion_by(self, plan: Any, trajectory: Any) -> Any:
        return trajectory


@pytest.fixture(autouse=True)
def _room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "require_room", lambda scene, mechanism: None)
    monkeypatch.setattr("fmd.stages.runs.require_unbuckled", lambda scene, changes: None)


def find_motions(run: Any) -> Any:
    return runs.find_motions(run)


def test_a_motion_that_lost_its_inertia_is_found_anew_with_the_whole_energy() -> None:
    run = LossyRun(1)
    assert find_motions(run) == {"run": "made anew"}
    assert run.whole_energy
    assert run.results["loads"] == "kept"


def test_nothing_is_made_anew_without_need() -> None:
    run = LossyRun(0)
    assert find_motions(run) == {"run": "made before"}
    assert not run.whole_energy


def test_a_motion_that_loses_its_inertia_all_the_same_is_refused() -> None:
    with pytest.raises(AccuracyError, match="a motion has -1 times its inertia"):
        find_motions(LossyRun(2))
