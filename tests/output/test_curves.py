"""Curves of charts: every quantity of every scene, components that move, former names."""

from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.error_budget import state_errors
from fmd.core.errors import InputError
from fmd.output.curves import Curves, _moving, curves_of, errors_of_curve
from fmd.output.summary import summarise
from fmd.render.chart_data import Curve
from fmd.render.charts import draw_chart
from fmd.scene.outputs import CHART_QUANTITIES, CONTACT_QUANTITIES, JOINT_QUANTITIES, Chart

QUICK = ["body.beam.mesh.divisions=[12, 2, 1]", "simulation.duration=20 ms"]


@pytest.fixture(scope="module")
def beam() -> Pipeline:
    return Pipeline(load_scene("beam-paper", QUICK))


@pytest.fixture(scope="module")
def damped() -> Pipeline:
    """The beam with a damper that takes next to nothing: other kernels march it."""
    return Pipeline(load_scene("beam-paper", [*QUICK, "joint.hub.damper=1e-12 N m s"]))


@pytest.fixture(scope="module")
def slider() -> Pipeline:
    return Pipeline(load_scene("rod-slider", ["simulation.duration=0.1 s"]))


def drawn(run: Pipeline, quantity: str, **settings: str) -> Curves:
    return curves_of(run, Chart(type="chart", file="chart.png", quantity=quantity, **settings))


def test_every_quantity_of_a_chart_has_a_meaning_in_the_scenes_reference() -> None:
    allowed = next(each for each in Chart.model_fields["quantity"].metadata if hasattr(each, "words"))
    assert set(allowed.words) == set(CHART_QUANTITIES)
    assert set(JOINT_QUANTITIES) < set(CHART_QUANTITIES)


def test_the_first_curve_has_the_error_of_the_budget_in_the_charts_unit(slider: Pipeline) -> None:
    def stated(quantity: str, **settings: str) -> tuple[float, ...]:
        return errors_of_curve(slider, Chart(type="chart", file="chart.png", quantity=quantity, **settings))

    assert stated("energy") == ()  # without a budget nothing is computed for it
    details = {row.name: row for row in state_errors(slider).details}
    joint = next(iter(slider.motion.joints))
    size = details[f"{joint}.position"].size
    assert size > 0.0
    assert stated("joint_position", joint=joint) == pytest.approx([size])
    wanted = {"m": ("mm", 1e3), "rad": ("deg", 180 / np.pi)}[slider.motion.joint_unit(joint)]
    assert stated("joint_position", joint=joint, unit=wanted[0]) == pytest.approx([wanted[1] * size])
    rows = {row.name: row for row in state_errors(slider).rows}
    assert stated("energy") == pytest.approx([rows["kinetic energy"].size, rows["potential energy"].size])


OF_NAMED_PLACES = {"element_stress", *CONTACT_QUANTITIES}


@pytest.mark.parametrize("quantity", [name for name in CHART_QUANTITIES if name not in OF_NAMED_PLACES])
def test_a_damper_changes_no_chart(beam: Pipeline, damped: Pipeline, quantity: str) -> None:
    settings = {"marker": "beam.tip"} if quantity == "marker_position" else {}
    label, curves, components = drawn(beam, quantity, **settings)
    other_label, others, other_components = drawn(damped, quantity, **settings)
    assert (other_label, list(others), other_components) == (label, list(curves), components)
    one, other = (next(iter(each.values())) for each in (curves, others))  # what sub-cycling holds differs
    assert other == pytest.approx(one, abs=1e-5 * np.nanmax(np.abs(one)), nan_ok=True)


def test_a_damper_changes_no_key_of_the_summary(beam: Pipeline, damped: Pipeline) -> None:
    one, other = (summarise(run, [], budget=False) for run in (beam, damped))
    assert list(one) == list(other)
    assert list(one["final"]) == list(other["final"])
    assert list(one["integrations"][1]) == list(other["integrations"][1])
    assert one["peak_tip_deflection_m"] == pytest.approx(other["peak_tip_deflection_m"], rel=1e-6)


@pytest.mark.parametrize("value", [2.0, np.nan])
def test_components_that_are_all_still_are_drawn_as_lines(tmp_path: Path, value: float) -> None:
    given = {"auto": np.full((30, 3), value), "other": np.full((30, 3), value)}
    label, curves, components = _moving("momentum [kg m/s]", given, ("x", "y", "z"))
    assert components == ("x", "y", "z")
    assert curves["auto"].shape == (30, 3)
    lines = [Curve(name, values) for name, values in curves.items()]
    file = tmp_path / "still.png"
    draw_chart(np.linspace(0, 1, 30), lines, file, title="", ylabel=label, component_labels=components)
    assert file.is_file()


def test_a_body_that_never_moves_has_every_chart() -> None:
    still = Pipeline(load_scene("beam-paper", [*QUICK, "drive={}"]))
    for quantity in set(CHART_QUANTITIES) - OF_NAMED_PLACES - {"marker_position"}:
        _, curves, components = drawn(still, quantity)
        values = next(iter(curves.values()))
        assert values.shape == ((41, len(components)) if components else (41,)), quantity
        if quantity not in ("centre_of_mass", "com_position", "tip_position"):
            assert not values.any(), quantity


def test_components_that_hardly_move_are_not_drawn(beam: Pipeline) -> None:
    assert drawn(beam, "tip_position")[2] == ("x", "y")
    assert drawn(beam, "momentum")[2] == ("x", "y")
    assert drawn(beam, "angular_momentum")[2] == ("z",)
    assert all(curve.shape[1] == 2 for curve in drawn(beam, "com_velocity")[1].values())


def test_former_names_stand_for_the_present_ones(beam: Pipeline) -> None:
    for former, present in (("com_position", "centre_of_mass"), ("joint_angle", "joint_position")):
        one, other = drawn(beam, former), drawn(beam, present)
        assert one[0] == other[0]
        assert all(np.array_equal(a, b) for a, b in zip(one[1].values(), other[1].values(), strict=True))


def test_a_joint_is_drawn_in_the_unit_asked_for(slider: Pipeline) -> None:
    label, angle, _ = drawn(slider, "joint_position", joint="hinge", unit="deg")
    assert label == "angle of hinge [deg]"
    (in_degrees, *_), (first, *_) = angle.values(), slider.motions.values()
    assert in_degrees == pytest.approx(np.degrees(first.joint_position("hinge")))
    assert drawn(slider, "joint_rate", joint="slide")[0] == "speed of slide [m/s]"


def test_what_a_scene_lacks_is_refused(slider: Pipeline) -> None:
    with pytest.raises(InputError, match=r"output\.joint: must be one of hinge, slide"):
        drawn(slider, "joint_position")
    with pytest.raises(InputError, match="no flexible body"):
        drawn(slider, "modal_coordinates")


def test_a_rigid_mechanism_has_the_quantities_of_the_whole(slider: Pipeline) -> None:
    assert drawn(slider, "energy")[2] == ("kinetic", "potential")
    assert drawn(slider, "centre_of_mass")[2] == ("x", "y")
    assert drawn(slider, "marker_position", marker="rod.hinge")[0] == "position of rod.hinge [m]"
