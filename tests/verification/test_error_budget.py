"""The error budget against true errors: scenes, each against a much finer run of it."""

from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest

from benchmarks.true_errors import true_errors
from fmd import Pipeline, load_scene
from fmd.accuracy.coarse_mesh import NO_COARSER_MESH, Pair, make_coarse_pair
from fmd.accuracy.error_budget import ERROR_BUDGET, state_errors
from fmd.core.cache import Cache
from fmd.output.summary import summarise

ROUND_OFF = 1e-9
AUTO = 'simulation.run=[{integrator="auto"}]'
PLAIN = 'simulation.run=[{integrator="central-difference"}]'
FROM_FILE = """
title = "Bar"
[body.bar]
shape = "mesh"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = { file = "bar.vtu", unit = "m" }
modes = { count = 1 }
marker.root = { plane = "x = 0" }
marker.tip = { plane = "x = 0.2 m" }
[joint.clamp]
type = "fixed"
parent = "ground"
child = "bar.root"
[simulation]
duration = "1 ms"
output_step = "1 ms"
tip = "bar.tip"
run = [{ integrator = "auto" }]
"""


def ratios(scene: str, own: list[str], finer: list[str]) -> dict[str, float]:
    """Stated over true error of each quantity whose true one is above round-off."""
    run = Pipeline(load_scene(scene, own))
    true = true_errors(run, Pipeline(load_scene(scene, [*own, *finer])))
    return {row.name: row.numerical / true[row.name] for row in ERROR_BUDGET.of(run).rows if true[row.name] > ROUND_OFF}


def rod_slider() -> dict[str, float]:
    return ratios("rod-slider", ["simulation.duration=3 s", "simulation.step=2 ms", PLAIN], ["simulation.step=0.1 ms"])


def beam() -> dict[str, float]:
    own = ["body.beam.mesh.divisions=[24, 2, 1]", "simulation.duration=0.1 s"]
    finer = ["body.beam.mesh.divisions=[36, 4, 2]", "body.beam.modes.count=10", "body.beam.modes.enrich=ritz"]
    return ratios("beam-paper", [*own, "simulation.step=40 us", PLAIN], [*finer, "simulation.step=10 us"])


def enriched_beam() -> dict[str, float]:
    """With load-dependent vectors, of which noise makes one that the coarse mesh has not."""
    own = ["body.beam.mesh.divisions=[24, 2, 1]", "simulation.duration=0.1 s", "body.beam.modes.enrich=ritz", AUTO]
    finer = ["body.beam.mesh.divisions=[36, 4, 2]", "body.beam.modes.count=10", "simulation.error=1e-5"]
    return ratios("beam-paper", own, finer)


def propeller() -> dict[str, float]:
    """Three blades of linear elements, against quadratic ones, with joints of the same width."""
    own = [
        "body.propeller.blades=3",
        "body.propeller.seat=90 deg",
        "simulation.output_step=0.2 ms",
        "body.propeller.modes.count=12",
        PLAIN,
    ]
    coarse = "body.propeller.mesh={order=1, sleeve=[24, 4, 2], joint=[4, 6, 6], blade=[4, 6, 12], growth=4.0}"
    fine = "body.propeller.mesh={order=2, sleeve=[30, 5, 2], joint=[5, 6, 6], blade=[5, 6, 12], growth=4.0}"
    finer = [fine, "body.propeller.modes.count=26", "body.propeller.modes.enrich=ritz", "simulation.step=0.5 us"]
    return ratios("propeller", [*own, coarse], finer)


@pytest.mark.slow
@pytest.mark.parametrize(
    "cases", [(rod_slider, beam), pytest.param((rod_slider, beam, propeller), marks=pytest.mark.long)]
)
def test_at_least_95_percent_of_true_errors_are_below_the_stated_ones_and_most_within_a_factor_of_five(
    cases: tuple[Callable[[], dict[str, float]], ...],
) -> None:
    found = {}
    for case in cases:
        found |= {f"{case.__name__}: {quantity}": ratio for quantity, ratio in case().items()}
    values = np.array(list(found.values()))
    assert len(values) > (30 if propeller in cases else 15)
    assert np.mean(values >= 1) >= 0.95, {name: ratio for name, ratio in found.items() if ratio < 1}
    assert np.median(values) <= 2.5
    # On the coarser of the propeller's meshes the enhanced elements bend with one layer: their error falls by more than
    # the factor of four that is asserted of linear ones, and some frequencies are stated eight times too far off.
    assert np.mean(values <= 5) >= 0.8, {name: ratio for name, ratio in found.items() if ratio > 5}


@pytest.mark.slow
def test_vectors_that_the_coarse_mesh_has_not_do_not_spoil_the_budget() -> None:
    found = enriched_beam()
    values = np.array(list(found.values()))
    assert (values >= 1).all(), found
    assert np.median(values) <= 3
    # 187 when their frequencies were given to shapes of another kind; 12, by some linear algebra libraries, when they
    # were given to shapes alike by nine tenths. Round-off decides which vector noise makes: 2.2 to 5.4 so far,
    # and 5.8 where shapes with less than 1e-3 of every load's response, in the energy norm, were left out for a trial.
    assert found["potential energy"] < 8


def test_a_body_of_one_element_each_way_says_what_it_could_not_estimate() -> None:
    run = Pipeline(
        load_scene(
            "beam", ["body.beam.mesh.divisions=[1, 1, 1]", "body.beam.modes.count=1", "simulation.duration=2 ms", PLAIN]
        ),
    )
    rows = {row.name: row for row in ERROR_BUDGET.of(run).rows}
    assert rows["beam, mass"].parts["discretisation"] == NO_COARSER_MESH
    frequency = rows["beam, frequency 1"]
    assert isinstance(frequency.parts["discretisation"], float)  # from recovered stress alone
    assert frequency.parts["truncation"] == "no part in it"


def test_the_mass_of_a_mesh_file_has_no_error(tmp_path: Path) -> None:
    """Its shape is that of its elements, of which the file tells all; frequencies lack a coarser mesh."""
    x, y, z = (each.ravel() for each in np.meshgrid([0.0, 0.1, 0.2], [0.0, 0.02], [0.0, 0.01], indexing="ij"))
    first = np.array([0, 4, 6, 2, 1, 5, 7, 3])
    meshio.write(tmp_path / "bar.vtu", meshio.Mesh(np.c_[x, y, z], [("hexahedron", np.array([first, first + 4]))]))
    (tmp_path / "bar.toml").write_text(FROM_FILE)
    rows = {row.name: row for row in state_errors(Pipeline(load_scene(tmp_path / "bar.toml"), Cache(None)), 1e-9).rows}
    mass = rows["bar, mass"]
    assert (mass.why, mass.interval) == ("", (mass.value, mass.value))
    assert mass.value == pytest.approx(2700 * 0.2 * 0.02 * 0.01)
    assert rows["bar, frequency 1"].why


def test_few_curved_elements_have_a_coarser_mesh_that_can_be_meshed_and_tells_of_the_volume() -> None:
    """Half of them each way are inverted; the volume is compared with that of a much finer mesh."""

    def blades(counts: str) -> Pipeline:
        overrides = ["body.propeller.blades=3", "body.propeller.seat=90 deg", "body.propeller.modes.count=1"]
        return Pipeline(load_scene("propeller", [*overrides, f"body.propeller.mesh={{order=2, {counts}}}"]))

    run = blades("sleeve=[18, 2, 1], joint=[2, 4, 3], blade=[2, 4, 6]")
    pair = make_coarse_pair(run)
    assert isinstance(pair, Pair)
    volumes = [
        p.part.mesh.volume for p in (pair.coarse, run, blades("sleeve=[30, 5, 2], joint=[5, 6, 6], blade=[5, 6, 12]"))
    ]
    told = (volumes[1] - volumes[0]) / pair.gains["geometry"]
    assert 0.5 < told / (volumes[2] - volumes[1]) < 2


def test_the_tips_largest_deflection_is_that_between_output_times() -> None:
    own = ["body.beam.mesh.divisions=[12, 1, 1]", "simulation.duration=0.1 s", PLAIN]
    often = [*own, "simulation.output_step=0.015625 ms"]  # 32 times as often
    coarse, fine = (Pipeline(load_scene("beam-paper", overrides)) for overrides in (own, often))
    at_outputs, largest = coarse.motion.tip_size.max(), fine.motion.tip_size.max()
    assert largest * (1 - 1e-9) <= coarse.fine_motion.tip_size.max() < largest * (1 + 1e-6)
    assert at_outputs < largest * (1 - 1e-6)
    chosen = coarse.fine_times[1]
    assert coarse.fine_times[0][chosen] == pytest.approx(coarse.output_times, rel=1e-15)


def test_an_adaptive_methods_tolerance_is_the_error_that_is_stated() -> None:
    own = ["simulation.duration=2 s", 'simulation.run=[{integrator="runge-kutta", tolerance=1e-5}]']
    finer = ['simulation.run=[{integrator="runge-kutta", tolerance=1e-13}]']
    found = np.array(list(ratios("rod-slider", own, finer).values()))
    assert (found >= 1).all()
    assert (found <= 5).all()


def test_a_budget_is_kept_and_counted_among_the_stages(tmp_path) -> None:
    def summary() -> dict:
        scene = load_scene("rod-slider", ["simulation.duration=0.5 s"])
        return summarise(Pipeline(scene, Cache(tmp_path)), [], budget=True)

    first, second = summary(), summary()
    assert "error budget" in first["stages_run"]
    assert "error budget" in second["stages_cached"]
    assert first["error_budget"] == second["error_budget"]
    assert {"quantity", "value", "unit", "total", "time"} < first["error_budget"]["rows"][0].keys()


def test_without_a_budget_nothing_is_computed_for_it() -> None:
    run = Pipeline(load_scene("rod-slider", ["simulation.duration=0.5 s"]))
    assert "error_budget" not in summarise(run, [], budget=False)
    assert "error budget" not in run.log.seconds


def test_the_better_value_is_the_answer_and_its_interval_holds_it_and_the_truth() -> None:
    own = ["simulation.duration=60 ms", PLAIN]  # the largest deflection is at 50 ms
    run = Pipeline(load_scene("beam-paper", own))
    finer = ["body.beam.modes.count=12", "body.beam.modes.enrich=ritz", "body.beam.mesh.divisions=[36, 4, 2]"]
    truth = Pipeline(load_scene("beam-paper", [*own, *finer, "simulation.step=10 us"]))
    rows = {row.name: row for row in ERROR_BUDGET.of(run).rows}
    exact = {
        "tip, largest deflection": float(truth.fine_motion.tip_size.max()),
        "beam, largest von Mises stress": truth.stress.worst()[2],
    }
    for name, value in exact.items():
        row = rows[name]
        assert row.interval is not None
        assert row.interval[0] <= min(row.value, value) <= max(row.better, value) <= row.interval[1]
        assert abs(row.better - value) < 0.1 * abs(row.value - value)  # five modes leave out a quarter, one eighth
