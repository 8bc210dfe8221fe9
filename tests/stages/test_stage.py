"""The stage graph: results are computed once, kept under keys of everything they depend on, and logged."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.error_budget import ERROR_BUDGET
from fmd.core import clock
from fmd.core.cache import Cache
from fmd.core.errors import InertiaError
from fmd.core.progress import Advance
from fmd.output.explain import STAGES
from fmd.stages import store as store_module
from fmd.stages.part import PART_STAGES, FlexiblePart
from fmd.stages.pipeline import RUN_STAGES
from fmd.stages.stage import Stage, forget, stages_of
from fmd.stages.store import StageStore

ROOT = Path(__file__).parents[2]


class Sum:
    """A sum of two numbers, with a stage for the sum and one for its double."""

    def __init__(self, store: StageStore, *numbers: int) -> None:
        self.store, self.numbers, self.computed = store, numbers, 0
        self.results: dict[str, Any] = {}

    def add(self) -> int:
        self.computed += 1
        return sum(self.numbers)

    total: Stage[int] = Stage("total", add, (), lambda owner: owner.numbers, ("fmd/stages",))
    double: Stage[int] = Stage("double", lambda owner: 2 * owner.total, ("total",))


def test_a_stage_is_computed_once_and_by_nobody_who_finds_it_in_the_cache(tmp_path):
    first = Sum(StageStore(Cache(tmp_path)), 3, 4)
    assert (first.double, first.double, first.total) == (14, 14, 7)
    assert first.computed == 1
    assert first.store.log.run == ["total", "double"]
    again = Sum(StageStore(Cache(tmp_path)), 3, 4)
    assert again.double == 14
    assert again.computed == 0
    assert again.store.log.cached == ["total"]
    assert again.store.log.run == ["double"]  # it has no inputs for a key, so it is never kept
    assert Sum(StageStore(Cache(tmp_path)), 4, 4).total == 8


def test_the_stages_of_a_class_come_in_the_order_of_their_definition():
    assert [stage.name for stage in stages_of(Sum)] == ["total", "double"]
    assert isinstance(Sum.total, Stage)


def test_every_stage_reads_stages_that_come_before_it():
    before: set[str] = set()
    for stage in (*PART_STAGES.values(), *RUN_STAGES.values(), ERROR_BUDGET):
        assert {*stage.reads, *stage.in_key} <= before, stage.name
        before.add(stage.name)
    assert len(STAGES) == len(set(STAGES))


def test_what_was_made_of_a_forgotten_result_is_forgotten_with_it(tmp_path):
    first = Sum(StageStore(Cache(tmp_path)), 3, 4)
    assert first.double == 14
    forget(first, "double")
    assert first.results == {"total": 7}
    assert first.double == 14
    forget(first, "total")
    assert first.results == {}


def test_an_error_of_a_stage_has_what_is_unusual_about_the_scene_as_its_notes():
    store = StageStore(Cache(None), remarks=lambda: iter(["rho is 2.7, which is unusual"]))
    with pytest.raises(TypeError) as caught:
        Sum(store, 3, "4").double  # noqa: B018 - computes it
    assert caught.value.__notes__ == ["rho is 2.7, which is unusual"]  # of both stages


def test_every_source_that_a_key_names_is_there():
    named = {
        source for stage in (*PART_STAGES.values(), *RUN_STAGES.values(), ERROR_BUDGET) for source in stage.all_sources
    }
    assert {"fmd/stages/contacts.py", "fmd/stages/part_results.py", "fmd/reduction"} <= named  # that compute them, too
    assert [source for source in named if not (ROOT / "pipeline" / source).exists()] == []


@pytest.mark.parametrize(
    ("override", "changed"),
    [
        ("body.beam.mesh.divisions=[12, 2, 1]", set(PART_STAGES) - {"assembly"}),
        ("body.beam.E='70 GPa'", set(PART_STAGES) - {"assembly", "mesh", "surface"}),
        ("body.beam.modes.count=4", set(PART_STAGES) - {"assembly", "mesh", "surface", "teeth"}),
        ("body.beam.modes.enrich='inertia'", set(PART_STAGES) - {"assembly", "mesh", "surface", "teeth", "modes"}),
        ("simulation.frame='free'", set(PART_STAGES) - {"assembly", "mesh", "surface", "teeth", "modes"}),
        ("simulation.duration='1 ms'", set()),
    ],
)
def test_a_key_changes_with_whatever_its_stage_depends_on_and_with_nothing_else(override, changed):
    one, other = (
        FlexiblePart(load_scene("beam-paper", overrides), "beam", StageStore(Cache(None)))
        for overrides in ([], [override])
    )
    assert {name for name in PART_STAGES if one.key(name) != other.key(name)} == changed


def test_the_formulation_of_elements_is_in_the_keys_of_modes_and_stress_but_not_of_the_mesh():
    linear = "body.beam.mesh.order=1"
    one, other = (
        FlexiblePart(load_scene("beam-paper", overrides), "beam", StageStore(Cache(None)))
        for overrides in ([linear], [linear, "body.beam.mesh.formulation=plain"])
    )
    changed = {name for name in PART_STAGES if one.key(name) != other.key(name)}
    assert changed == set(PART_STAGES) - {"assembly", "mesh", "surface"}
    assert (one.space.is_enhanced, other.space.is_enhanced) == (True, False)
    assert (one.modes.frequencies_hz < other.modes.frequencies_hz).all()


def test_a_variant_takes_over_what_both_scenes_have_in_common_and_leaves_the_run_alone():
    small = "body.beam.mesh.divisions=[12, 2, 1]"
    run = Pipeline(load_scene("beam-paper", [small]), Cache(None))
    body, before = run.part.body, set(run.part.results)
    richer = run.variant(load_scene("beam-paper", [small, "body.beam.modes.enrich='inertia'"]))
    assert richer.part.modes is run.part.modes
    assert richer.part.model is run.part.model
    assert "body" not in richer.part.results
    assert len(richer.part.body.omega) > len(body.omega)
    finer = run.variant(load_scene("beam-paper", ["body.beam.mesh.divisions=[14, 2, 1]"]))
    assert finer.part.results == {}
    assert run.part.body is body
    assert set(run.part.results) == before


def test_given_modes_replace_the_scenes_own_in_all_that_follows():
    scene = load_scene("beam-paper", ["body.beam.mesh.divisions=[12, 2, 1]"])
    part = FlexiblePart(scene, "beam", StageStore(Cache(None)))
    fewer = FlexiblePart(
        load_scene("beam-paper", ["body.beam.mesh.divisions=[12, 2, 1]", "body.beam.modes.count=2"]), "beam", part.store
    )
    given = FlexiblePart(scene, "beam", part.store, like=part, modes=fewer.modes)
    assert len(given.body.omega) == 2
    assert len(part.body.omega) == 5


def test_the_time_of_a_stage_that_fails_counts_but_not_that_of_others_on_the_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clocks = [0.0, 0.0]
    for module in (clock, store_module):
        monkeypatch.setattr(module, "read_clocks", lambda: tuple(clocks))

    def fail() -> float:
        clocks[:] = 60.0, 2.0
        raise InertiaError("lost")

    store = StageStore(Cache(None))
    with pytest.raises(InertiaError):
        store.compute("motion", fail)
    store.compute("motion", lambda: 1.0)
    assert store.log.seconds["motion"] == 2.0
    assert store.log.run == ["motion"]


def test_a_stage_is_one_task_and_hands_on_its_progress() -> None:
    told: list[tuple[str, float]] = []  # -1 where a task begins

    @contextmanager
    def monitor(name: str) -> Iterator[Advance]:
        told.append((name, -1.0))
        yield lambda done: told.append((name, done))

    store = StageStore(Cache(None), monitor)

    def outer() -> None:
        store.compute("inner", lambda: store.advance(0.5))
        store.advance(0.25)

    store.compute("outer", outer)
    assert told == [("outer", -1.0), ("inner", -1.0), ("inner", 0.5), ("outer", 0.25)]
    told.clear()
    run = Pipeline(load_scene("beam-paper", ["body.beam.mesh.divisions=[12, 2, 1]"]), Cache(None), monitor)
    assert len(run.part.body.omega)
    names = [name for name, done in told if done < 0.0]
    assert names.count("body") == names.count("modes") == 1
    assert "modes" in {name for name, done in told if 0.0 < done <= 1.0}


def test_every_stage_that_is_kept_knows_the_kind_of_its_result() -> None:
    run = Pipeline(load_scene("beam"), Cache(None))
    owners = [(run, stages_of(Pipeline)), (run.part, stages_of(FlexiblePart))]
    kinds = {stage.name: stage._find_kind(owner) for owner, stages in owners for stage in stages if stage.inputs}
    assert kinds["stability"] == "tuple[Growth, ...]"  # of a computation whose module isn't loaded
    assert all(kinds.values()), kinds
