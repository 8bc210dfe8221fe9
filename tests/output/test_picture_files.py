"""What was drawn before is not drawn again, as long as all that it shows is the same."""

import shutil
from dataclasses import replace

import pytest

from fmd import Result, load_scene
from fmd.core.cache import Cache
from fmd.output.explain import forecast_run
from fmd.output.output_kinds import kind_of
from fmd.output.write import write_results

pytestmark = pytest.mark.slow

SMALL = ["body.beam.mesh.divisions=[12, 2, 1]", "simulation.duration=20 ms", "output.3.size=[320, 180]"]
SMALL += ["body.beam.modes.count=2", "output.4.size=[320, 180]", "output.5.size=[320, 180]", "output.5.frames=2"]
MODES, STRESS, FILM, CHART = "mode-1.png", "von-mises.png", "motion.mp4", "fig-09-com-position.png"
ALL = {MODES, STRESS, FILM, CHART}


@pytest.fixture(scope="module")
def drawn_once(tmp_path_factory):
    folder = tmp_path_factory.mktemp("first")
    plan, run = draw(folder, [])
    assert fate_of(plan) == "run"
    assert "pictures" in run.log.run
    assert "pictures" not in run.log.cached
    return folder


@pytest.fixture
def first(drawn_once, tmp_path):
    """A folder with the cache of a first run, and the pictures of that."""
    shutil.copytree(drawn_once / "cache", tmp_path / "cache")
    return tmp_path, pictures_in(drawn_once)


def draw(folder, overrides):
    cache, scene = Cache(folder / "cache"), load_scene("beam-paper", [*SMALL, *overrides])
    plan, run = forecast_run(Result(scene, cache), True, False), Result(scene, cache)
    write_results(run, folder / "out", pictures=True, budget=False)
    return plan, run


def fate_of(plan):
    (step,) = [step for step in plan.steps if step.stage == "pictures"]
    return step.fate


def pictures_in(folder):
    return {path.name: path.read_bytes() for path in (folder / "out").iterdir() if path.suffix in (".png", ".mp4")}


def test_a_second_run_draws_nothing_and_leaves_the_same_files(first, monkeypatch):
    folder, pictures = first

    def draw_again(*_):
        raise AssertionError("drawn again")

    monkeypatch.setattr("fmd.output.picture_files.kind_of", lambda output: replace(kind_of(output), draw=draw_again))
    plan, run = draw(folder, [])
    assert fate_of(plan) == "cached"
    assert "pictures" not in run.log.run
    assert pictures.keys() >= ALL
    assert pictures_in(folder) == pictures


@pytest.mark.parametrize(
    ("override", "drawn"),
    [
        ("simulation.run.0.integrator='exponential'", {STRESS, FILM, CHART}),
        ("output.3.camera=['10 deg', '20 deg']", {MODES}),
        ("body.beam.E='100 GPa'", ALL),
        ("title='Another'", ALL),
    ],
)
def test_what_has_changed_is_drawn_anew(first, override, drawn, monkeypatch):
    folder, _ = first
    again = set()

    def note(_, output, out, draw):
        name = output.file.format(mode=1)
        again.add(name)
        (out / name).write_bytes(b"")
        return [name]

    monkeypatch.setattr("fmd.output.picture_files.kind_of", lambda output: replace(kind_of(output), draw=note))
    plan, run = draw(folder, [override])
    assert ALL & again == drawn
    assert fate_of(plan) == "run"
    assert "pictures" in run.log.run
    assert ("pictures" in run.log.cached) == (drawn != ALL)


def test_a_damaged_picture_is_drawn_anew(first):
    folder, pictures = first
    (lost, *_) = (folder / "cache").glob("pictures-*")
    lost.write_bytes(lost.read_bytes()[:-1])
    plan, run = draw(folder, [])
    assert fate_of(plan) == "run"
    assert {"pictures"} <= set(run.log.run) & set(run.log.cached)
    assert pictures_in(folder).keys() == pictures.keys()


def test_charts_with_stated_errors_are_drawn_once_and_again_without_a_budget(tmp_path, monkeypatch):
    """A chart of a budget's errors is kept under these, and read back once the kept budget tells them."""
    counts, drawn = [], []

    def note(_, output, out, draw):
        drawn.append(output.file)
        (out / output.file).write_bytes(b"")
        return [output.file]

    monkeypatch.setattr("fmd.output.picture_files.kind_of", lambda output: replace(kind_of(output), draw=note))
    scene = load_scene(
        "rod-slider", ["simulation.duration=0.1 s", "simulation.run=[{integrator='central-difference'}]"]
    )
    for budget in (True, True, False):
        run = Result(scene, Cache(tmp_path / "cache"))
        plan = forecast_run(run, True, budget)
        write_results(run, tmp_path / "out", pictures=True, budget=budget)
        counts.append((len(drawn), fate_of(plan)))
    assert counts == [(2, "run"), (2, "cached"), (4, "run")]
