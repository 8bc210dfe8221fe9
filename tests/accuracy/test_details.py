"""Quantities of joints and markers in the error budget: their names, their sizes, and what is left out."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.changed_bodies import retune_body
from fmd.accuracy.details import detail_quantities, leave_out_nothing
from fmd.accuracy.error_budget import state_errors
from fmd.accuracy.error_estimates import OTHER_LOOPS, Quantity
from fmd.accuracy.estimators import Estimates
from fmd.accuracy.missed_peaks import largest_between
from fmd.accuracy.quantities import motion_quantities, stress_quantities
from fmd.core.cache import Cache
from fmd.reduction.inertia import inertia_integrals

QUICK = ["body.beam.mesh.divisions=[12, 2, 1]", "simulation.duration=20 ms"]


@pytest.fixture(scope="module")
def beam() -> Pipeline:
    return Pipeline(load_scene("beam-paper", QUICK))


def test_forces_places_rates_and_accelerations_have_the_names_of_files(beam: Pipeline) -> None:
    found = detail_quantities(beam.scene, beam.motion)
    units = {"hub.force": "N", "hub.moment": "N m", "beam.tip.velocity": "m/s", "beam.tip.acceleration": "m/s^2"}
    assert {name: found[name].unit for name in units} == units
    assert found["beam.tip.acceleration"].values == pytest.approx(
        beam.motion.kinematics.marker_acceleration(0, "tip", beam.motion.joint_loads.accelerations)
    )
    place = found["beam.tip.position"]
    moved = np.linalg.norm(beam.motion.tip_position - beam.motion.tip_position[0], axis=1)
    assert place.scale == pytest.approx(moved.max())


def test_an_error_of_a_place_is_relative_to_how_far_it_moves(beam: Pipeline) -> None:
    place = detail_quantities(beam.scene, beam.motion)["beam.tip.position"]
    shifted = type(place)(place.name, place.unit, place.values + np.array([0.0, 0.0, 0.1 * place.scale]))
    assert place.error(shifted) == pytest.approx(0.1)


FREE = """
title = "Free"
[body.arm]
shape = "rigid"
mass = "2 kg"
inertia = ["0.013 kg m^2", "0.02 kg m^2", "0.02 kg m^2"]
centre = ["0 m", "0 m", "0 m"]
marker = { hinge = { at = ["0 m", "0 m", "0 m"] }, tip = { at = ["0.37 m", "0.11 m", "0.07 m"] } }
[joint.loose]
type = "free"
parent = "ground"
child = "arm.hinge"
START
[drive.couple]
type = "point force"
marker = "arm.hinge"
direction = [0.3, 0.7, 0.1]
force = { formula = "0", unit = "N" }
[simulation]
duration = "50 ms"
output_step = "1 ms"
tip = "arm.tip"
run = [{ integrator = "runge-kutta" }]
"""


def test_what_is_round_off_has_no_row(beam: Pipeline) -> None:
    """The hub neither moves, nor does a beam in a plane bear a moment across it."""
    names = {row.name for row in state_errors(beam).details}
    assert "beam.tip.acceleration" in names
    assert "beam.root.position" not in names


def test_what_solving_leaves_of_a_marker_that_a_loop_holds_has_no_row() -> None:
    """A linkage's foot on the ground had 2.3e-7 m/s² beside 156, stated within 315 % for 2930 %."""
    sizes = {"rocker.outer.acceleration": 2.3e-7, "rocker.inner.acceleration": 156.3, "crank.outer.acceleration": 1e-5}
    found = {name: Quantity(name, "m/s^2", size * np.eye(3)) for name, size in sizes.items()}
    found["rocker.foot.acceleration"] = Quantity("rocker.foot.acceleration", "m/s^2", 3.8e-3 * np.eye(3))
    for marker, size in (("rocker.foot", 6e-15), ("rocker.inner", 5.0)):  # redundant constraints hold the foot
        found[f"{marker}.velocity"] = Quantity(f"{marker}.velocity", "m/s", size * np.eye(3))
    mechanism = SimpleNamespace(mass=1.0, reach=1.0)
    assert {*leave_out_nothing(found, mechanism)} == {
        "rocker.inner.acceleration",
        "crank.outer.acceleration",
        "rocker.inner.velocity",
    }


def test_what_solving_leaves_of_a_free_body_that_only_turns_or_slides_has_no_row(tmp_path: Path) -> None:
    """The joint had a moment of 2e-15 N m within 266 %, the sliding body an angular momentum of 7e-17 within 123 %."""
    file = tmp_path / "free.toml"
    for start in ('spin = ["13 rad/s", "7 rad/s", "50 rad/s"]', 'velocity = ["1 m/s", "2 m/s", "0.3 m/s"]'):
        file.write_text(FREE.replace("START", start))
        budget = state_errors(Pipeline(load_scene(file), Cache(None)))
        assert budget.details
        small = {row.name: (row.value, row.total) for row in (*budget.rows, *budget.details) if 0 < row.value < 1e-9}
        assert not small


def test_a_body_in_other_coordinates_gets_the_whole_inertia_of_its_own_shapes(beam: Pipeline) -> None:
    """Reactions take it; the variants of a budget have bodies of other coordinates."""
    body = beam.bodies["beam"]
    assert body.integrals.normal >= 0  # the motion is in a plane
    retuned, _ = retune_body(body, np.linspace(1.2, 2.0, len(body.omega)) * body.omega)
    other = beam.with_bodies({"beam": retuned})
    (link,) = other.with_whole_inertia(other.mechanism).links
    whole = inertia_integrals(retuned.x, beam.parts["beam"].fe.m, retuned.shapes)
    assert np.abs(link.integrals.G - whole.G).max() < 1e-12 * np.abs(whole.G).max()


def test_a_blow_states_what_few_modes_leave_out_of_the_reaction(tmp_path: Path) -> None:
    """Against the same bar in many modes, which share nothing with the load-dependent vectors of the budget."""
    text = """
    title = 'a blow'
    [body.bar]
    shape = 'bar'
    E = '70 GPa'
    nu = 0.33
    rho = '2700 kg/m^3'
    length = '400 mm'
    depth = '10 mm'
    width = '20 mm'
    mesh = { order = 2, divisions = [12, 1, 1] }
    [body.bar.marker]
    root = { face = 'x-', attachment = 'rigid' }
    tip = { face = 'x+' }
    [body.bar.modes]
    count = 3
    boundary = 'joint'
    enrich = 'none'
    [joint.hub]
    type = 'fixed'
    parent = 'ground'
    child = 'bar.root'
    [drive.blow]
    type = 'point force'
    marker = 'bar.tip'
    direction = [0.0, 1.0, 0.0]
    force = { formula = '100*sin(pi*t/0.0003) if t < 0.0003 else 0', unit = 'N' }
    [simulation]
    duration = '5 ms'
    output_step = '0.05 ms'
    gravity = ['0 m/s^2', '0 m/s^2', '0 m/s^2']
    tip = 'bar.tip'
    [[simulation.run]]
    integrator = 'auto'
    """
    (tmp_path / "blow.toml").write_text(text)
    few, many = (Pipeline(load_scene(tmp_path / "blow.toml", [f"body.bar.modes.count={n}"])) for n in (3, 40))
    rows = {row.name: row for row in state_errors(few).details}
    better = detail_quantities(many.scene, many.motion)
    own = detail_quantities(few.scene, few.motion)
    for name in ("hub.force", "hub.moment", "bar.tip.velocity", "bar.tip.acceleration"):
        true = own[name].error(better[name]) * better[name].scale
        assert true > 0.3 * better[name].scale, name
        assert true <= rows[name].size <= 10 * true, name


def test_reactions_of_a_loop_are_not_mended_by_forces_that_round_off_makes() -> None:
    """Later generations of static responses move a plane loop out of its plane: what held them was 50 kN for 0.4 kN."""
    given = ["body.rod.mesh.divisions=[8,1,1]", "body.rod.modes.count=2", "simulation.duration=1 ms", "output=[]"]
    method = "simulation.run=[{integrator='central-difference', step='5 us'}]"
    estimates = Estimates(Pipeline(load_scene("slider-crank", [*given, method])))
    errors = estimates._truncation()
    for name in ("small_end.force", "guide.force", "shaft.moment"):
        assert errors[name] == OTHER_LOOPS
        assert name not in estimates.corrections
    assert float(errors["slider.pin.acceleration"]) < 0.02


def test_a_row_holds_the_peak_between_output_times_that_the_warning_tells() -> None:
    """A beam that rings, at a dozen output times, against the same motion at all of them."""
    coarse = Pipeline(load_scene("beam-paper", [*QUICK, "simulation.output_step=1.7 ms"]), Cache(None))
    fine = coarse.fine_motion
    dense = detail_quantities(coarse.scene, fine) | motion_quantities(fine, fine)
    budget = state_errors(coarse, 1e-9)  # values are there without estimates
    rows = {row.name: replace(row, parts={"time": 0.01}) for row in (*budget.rows, *budget.details)}
    for name, less in (("beam.tip.acceleration", 0.97), ("hub, rate", 0.995)):
        row, exact = rows[name], dense[name].scale
        assert row.value < less * exact
        assert exact <= row.better - row.correction < 1.05 * exact
        assert row.interval is not None
        assert row.interval[0] <= row.value < exact <= row.interval[1]


def test_a_place_goes_as_far_between_output_times_from_where_it_was_at_the_start() -> None:
    run = Pipeline(load_scene("rod-slider", ["simulation.output_step=30 ms"]), Cache(None))
    largest, fine = largest_between(run), run.fine_motion
    exact = np.linalg.norm(fine.tip_position - fine.tip_position[0], axis=1).max()
    assert run.motion.tip_position.shape < fine.tip_position.shape
    assert exact <= largest["tip.position"] < 1.001 * exact
    at_outputs, dense = (detail_quantities(run.scene, each)["rod.orientation"].scale for each in (run.motion, fine))
    assert at_outputs < 0.9997 * dense < dense <= largest["rod.orientation"] < 1.001 * dense


def test_each_of_five_thousand_intervals_is_looked_into() -> None:
    own = ["simulation.output_step=1 ms", "simulation.duration=5 s", "simulation.run=[{integrator='auto'}]"]
    run = Pipeline(load_scene("rod-slider", own), Cache(None))
    times, outputs = run.fine_times
    assert np.diff(outputs).tolist() == [2] * 5000
    np.testing.assert_array_equal(times[outputs], run.output_times)


def test_stress_of_a_named_element_has_its_peak_between_output_times() -> None:
    stress = 'quantities=["element_stress"], elements=["beam.spot"], components=["xx"]'
    own = [f'output=[{{type="history", file="a.csv", {stress}}}]', "simulation.output_step=1.7 ms"]
    own += ["body.beam.element={spot={at=['30 mm', '0 m', '0 m']}}"]
    run = Pipeline(load_scene("beam-paper", [*QUICK, *own]), Cache(None))
    largest, fine = largest_between(run), run.fine_motion
    dense = stress_quantities(run, fine, np.array([0]))["beam.spot, von Mises stress"].scale
    assert dense <= largest["beam.spot, von Mises stress"] < 1.05 * dense
    assert largest["beam.spot.xx"] > 0.5 * dense


def test_the_largest_stress_of_a_body_in_pieces_has_its_peak_between_output_times() -> None:
    own = ["body.beam.pieces=2", "body.beam.mesh.divisions=[6, 1, 1]", "simulation.run=[{integrator='auto'}]"]
    own += ["simulation.duration=80 ms", "simulation.output_step=40 ms"]  # the peak is at 50 ms
    run = Pipeline(load_scene("beam-paper", own), Cache(None))
    row = next(row for row in state_errors(run, 1e-9).rows if row.name == "beam, largest von Mises stress")
    dense = run.stress_of("beam", run.fine_motion).worst()[2]
    assert row.value == pytest.approx(run.stress_of("beam").worst()[2])
    assert 1.01 * row.value < 0.98 * dense < row.value + row.between < 1.02 * dense
