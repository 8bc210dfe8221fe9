"""Scenes with contacts: what runs give, and what is refused with what works."""

import re
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.contact_errors import CONTACT_ERRORS, contact_errors
from fmd.accuracy.error_budget import ERROR_BUDGET
from fmd.core.errors import AccuracyError, InputError, StabilityError
from fmd.integrators.automatic import Automatic
from fmd.integrators.exponential import PiecewiseExponential
from fmd.integrators.protocol import Integrator
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.integrators.rosenbrock import ExponentialRosenbrock
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.output.contacts import contact_figures, contact_warnings
from fmd.output.curves import curves_of
from fmd.output.figure_errors import figure_errors
from fmd.output.fmu.write import make_model
from fmd.output.mechanism_view import view_mechanism
from fmd.output.work_precision import compare_on_scene
from fmd.recovery.motion_file import motion_variables
from fmd.scene.outputs import Chart
from fmd.stages.linear_model import linearise_scene
from fmd.stages.stability_limits import find_scene_limits
from tests.contact.test_contact_points import BLOCK
from tests.contact.test_rigid_contacts import BALL, RADIUS


def block(*overrides: str, **tables: Any) -> Pipeline:
    return Pipeline(load_scene(BLOCK | tables, overrides))


@pytest.fixture(scope="module")
def dropped() -> Pipeline:
    return block(
        'joint.free.rotate=["2 deg", "0 deg", "3 deg"]', "contact.floor.friction=0.4", "body.block.modes.damping=0.02"
    )


def test_a_dropped_block_takes_the_impulse_that_turns_it_round(dropped: Pipeline) -> None:
    motion = dropped.motion
    own = motion.contacts["floor"]
    mass = motion.mechanism.mass
    weight = mass * np.array([0.0, -9.81, 0.0]) * motion.times[:, None]
    np.testing.assert_allclose(motion.kinematics.momentum, weight + own.impulse, atol=1e-4 * np.abs(own.impulse).max())
    assert own.impulse[-1, 1] > 0.0
    assert own.friction_work[-1] > 0.0
    across = np.linalg.norm(own.force[:, ::2], axis=1)
    assert (across <= 0.4 * own.force[:, 1] * (1 + 1e-6) + 1e-9).all()


def test_the_contact_is_in_the_summary_and_in_the_file(dropped: Pipeline) -> None:
    floor = contact_figures(dropped)["contacts"]["floor"]
    assert 0.0 < floor["begin_s"] < floor["end_s"] <= 0.06
    assert floor["impulse_n_s"][1] > 0.0
    names = {variable.name for variable in motion_variables(dropped.motion)}
    assert {"floor.force", "floor.moment", "floor.impulse", "floor.area", "floor.peak_pressure"} < names
    assert not ERROR_BUDGET.applies(dropped)


def test_each_figure_that_has_no_stated_error_says_why(dropped: Pipeline, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise StabilityError("the step is too long")

    figures = contact_figures(dropped)["contacts"]
    monkeypatch.setattr(dropped, "motion_by", fail)
    final: dict[str, Any] = {"joint_positions": {}, "joint_rates": {}}
    stated = figure_errors(dropped, {"final": final, "contacts": figures, "frequencies_hz": [1.0]})
    assert "after a contact two runs part" in str(stated["final.kinetic_energy_j"])
    assert "of the scene without its contacts" in str(stated["frequencies_hz.0"])
    contact_errors(dropped, 1e-9)
    stated = figure_errors(dropped, {"final": final, "contacts": figures})
    del dropped.results[CONTACT_ERRORS]
    for key in figures["floor"].keys() - {"energy_error_j", "near_field", "radius_over_spacing"}:
        assert re.match(
            r"not stated: the march with (longer|half the) steps failed: .*too long; not estimated: it would take",
            str(stated[f"contacts.floor.{key}"]),
        )
    assert "follows from" in str(stated["contacts.floor.radius_over_spacing"])
    assert stated["contacts.floor.energy_error_j"] == "not stated: it is an error itself"


def test_charts_have_the_largest_force_pressure_and_area_of_all_steps_between_output_times(dropped: Pipeline) -> None:
    """Against the same march with an output time near each step."""
    floor, times = dropped.motion.contacts["floor"], dropped.motion.times
    plan = next(iter(dropped.plans.values()))  # with the step of the motion, which is found with it
    finer = np.unique(np.concatenate([times, np.arange(0.0, times[-1], plan.integrator.step)]))
    fine = dropped.motion_by(plan, plan.march(finer)).contacts["floor"]
    at = np.searchsorted(finer, times)
    for quantity, values, now in (
        ("contact_force", np.linalg.norm(fine.force, axis=1), np.linalg.norm(floor.force, axis=1)),
        ("contact_pressure", 1e-6 * fine.peak_pressure, 1e-6 * floor.peak_pressure),
        ("contact_area", 1e6 * fine.area, 1e6 * floor.area),
    ):
        _, curves, components = curves_of(dropped, Chart(type="chart", file="chart.png", quantity=quantity))
        assert components == ("floor",)
        drawn = next(iter(curves.values()))[:, 0]
        exact = [values[first : last + 1].max() for first, last in zip(np.append(0, at[:-1] + 1), at, strict=True)]
        # Forces at output times start the solver of the next step elsewhere: round-off grows with each shock.
        np.testing.assert_allclose(drawn, exact, rtol=1e-7, atol=1e-9 * max(exact))
        assert (drawn > 1.05 * now).any()  # what stands at output times misses peaks
    with pytest.raises(InputError, match="needs a contact; this scene has none"):
        block(contact={}, output=[{"type": "chart", "file": "chart.png", "quantity": "contact_area"}])


def test_the_plane_that_is_touched_is_drawn_under_the_body(dropped: Pipeline) -> None:
    moving = view_mechanism(dropped, np.arange(0, 61, 20))
    (plate,) = (shape for shape in moving.shapes if shape.name == "contact.floor")
    for frame in range(4):
        corners, body = plate.points(frame), moving.bodies[0].points(frame)
        assert corners[:, 1].max() == pytest.approx(0.0, abs=1e-12)  # y = 0 is what the block falls on
        assert (corners[:, ::2].min(axis=0) < body[:, ::2].min(axis=0)).all()
        assert (corners[:, ::2].max(axis=0) > body[:, ::2].max(axis=0)).all()


def test_energy_that_steps_make_is_warned_of(dropped: Pipeline) -> None:
    motion = dropped.motion
    own = motion.contacts["floor"]
    codes = [warning["code"] for warning in contact_warnings(dropped)]
    lost = np.abs(own.energy_error).max() > 0.01 * motion.energies[0].max()
    assert ("contact-energy" in codes) is bool(lost)


def test_corners_of_quadratic_tetrahedra_that_go_deeper_are_warned_of() -> None:
    mesh = 'body.block.mesh={ element = "tetrahedron", size = "60 mm" }'
    tilt = 'joint.free.rotate=["20 deg", "0 deg", "20 deg"]'
    run = block(mesh, tilt, 'joint.free.position=["0 m", "90 mm", "0 m"]')
    (unseen,) = [own for own in contact_warnings(run) if own["code"] == "contact-unseen"]
    assert "0.008" in unseen["text"]  # 30 mm along the edge, tilted by 20° and 20°: 9.6 mm when a middle touches


def test_without_contact_no_error_budget_is_left_out_and_nothing_is_noted() -> None:
    run = block(contact={})
    assert ERROR_BUDGET.applies(run)
    assert contact_figures(run) == {}
    assert contact_warnings(run) == []
    assert run.motion.trajectory.contacts.size == 0


def test_a_step_beyond_half_of_the_limit_is_refused_with_one_that_works() -> None:
    limit = block().system.largest_step
    with pytest.raises(InputError, match="feed the highest modes") as refused:
        _ = block(f"simulation.step={0.6 * limit} s").plans
    works = float(re.search(r"([\d.e-]+) s is the longest step", str(refused.value)).group(1))  # type: ignore[union-attr]
    assert 0.45 * limit < works <= 0.5 * limit
    assert block(f"simulation.step={works} s").plans


def test_a_block_that_begins_in_the_ground_is_refused_by_its_depth() -> None:
    with pytest.raises(InputError, match=r"contact.floor: begins 0.01 m deep"):
        _ = block('joint.free.position=["0 m", "40 mm", "0 m"]').plans


def test_a_periodic_start_with_a_contact_is_refused() -> None:
    with pytest.raises(InputError, match="periodic': doesn't know of contacts"):
        _ = block('simulation.start="periodic"', 'simulation.period="1 ms"').plans


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            'simulation.run.0.integrator="exponential"',
            "takes contacts of bodies that slide alone, and joint 'free' turns",
        ),
        ('simulation.start="steady"', "doesn't know of contacts; 'undeformed' and 'equilibrium' do"),
        ("accuracy=0.01", "no error budget states theirs"),
        (
            'contact.floor.between=["block.bottom", "ground"]',
            "a face of a flexible body, or a surface of a rigid one, second",
        ),
        ('contact.floor.between=["ground", "block.top"]', "marker"),
        (
            'contact.wall={ between = ["ground", "block.side"], normal = [1, 0, 0], damping = "1 ms" }',
            "isn't that of contact.floor, 0 s, which has block in common",
        ),
        ("body.block.pieces=2", "in pieces; pieces = 1 works"),
        ('contact.wall={ between = ["ground", "block.bottom"], normal = [1, 0, 0] }', "has the face of contact.floor"),
    ],
)
def test_what_contact_can_not_do_is_refused(override: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        block(override)


def test_a_flat_face_has_no_near_field_of_a_half_space() -> None:
    with pytest.raises(InputError, match="bottom is no sphere, cylinder, cone or ellipsoid"):
        _ = block("contact.floor.near_field=half-space").mechanism


def test_a_marker_at_a_point_is_no_face() -> None:
    with pytest.raises(InputError, match="middle is no face that can deform"):
        _ = block('contact.floor.between=["ground", "block.middle"]').mechanism


@pytest.mark.parametrize(
    "method",
    [
        ReversibleSubcycling(1e-5, 2),
        ExponentialRosenbrock(),
        PiecewiseExponential(1e-5),
        ScipyIvp("Radau"),
        Automatic(1e-3, 1e-2),
    ],
)
def test_a_method_that_takes_no_contacts_says_so_from_python_too(dropped: Pipeline, method: Integrator) -> None:
    with pytest.raises(ValueError, match=rf"^{method.name} takes no contacts; central-difference, "):
        method.march(dropped.system, *dropped.start, np.array([0.0, 1e-2]))


def test_what_would_leave_contacts_out_says_so() -> None:
    run = block()
    uses = {
        "a linear model": lambda: linearise_scene(run, ["block.middle.y"], ["block.middle.y"]),
        "an FMU": lambda: make_model(run),
        "a comparison of methods": lambda: compare_on_scene(run),
    }
    for what, use in uses.items():
        with pytest.raises(InputError, match=f"{what} would leave contacts out"):
            use()


def test_the_largest_safe_step_has_contacts_closed_and_one_ratio() -> None:
    run, free = block(), block(contact={})
    limits = find_scene_limits(run, [1, 2], along=False)
    (row,) = limits.limits
    assert row.critical_step == pytest.approx(run.system.largest_step, rel=1e-6)
    assert row.critical_step < find_scene_limits(free, [1], along=False).limits[0].critical_step
    assert limits.recommended[0] <= 0.25 * row.critical_step
    with pytest.raises(InputError, match="--along would leave contacts out"):
        find_scene_limits(run, [1], along=True)


def falling_bar(**joint: Any) -> Pipeline:
    """The bar of Doyen, Ern & Piperno (SIAM J Sci Comput 33, 2011), by eight modes."""
    bar = {
        "shape": "bar",
        **dict.fromkeys(("depth", "width"), "1 m"),
        "length": "10 m",
        "E": "900 Pa",
        "nu": 0.0,
        "rho": "1 kg/m^3",
        "mesh": {"divisions": [24, 1, 1], "order": 1},
        "modes": {"count": 8, "family": "axial", "enrich": "none"},
        "marker": {"top": {"face": "x+"}, "bottom": {"face": "x-"}},
    }
    scene = BLOCK | {
        "body": {"bar": bar},
        "ground": {"top": {"at": ["15 m", "0 m", "0 m"]}},
        "joint": {"way": joint | {"parent": "ground.top", "child": "bar.top"}},
        "contact": {"floor": {"between": ["ground", "bar.bottom"], "normal": [1, 0, 0]}},
        "simulation": BLOCK["simulation"]
        | {"duration": "2 s", "output_step": "20 ms", "tip": "bar.top"}
        | {"gravity": ["-10 m/s^2", "0 m/s^2", "0 m/s^2"]},
    }
    return Pipeline(load_scene(scene))


@pytest.fixture(scope="module")
def sliding_bar() -> Pipeline:
    return falling_bar(type="prismatic", axis=[1, 0, 0])


def test_a_bar_on_a_slide_bounces_as_a_free_one(sliding_bar: Pipeline) -> None:
    """Joint-conforming modes and free ones have the same flexibility, so the same steps give the same impulse."""
    runs = falling_bar(type="free"), sliding_bar
    impulses = [run.motion.contacts["floor"].impulse[-1, 0] for run in runs]
    assert impulses[0] == pytest.approx(impulses[1], rel=1e-9)


def test_intervals_by_step_mesh_and_modes_hold_the_exact_figures(sliding_bar: Pipeline) -> None:
    """By characteristics: it touches from 1 s to 5/3 s, with 300 N at first and 500 N at last, 800/3 N s in all."""
    found = contact_errors(sliding_bar)["floor"]
    exact = {"begin_s": 1.0, "end_s": 5 / 3, "impulse_n_s": 800 / 3, "largest_force_n": 500.0, "largest_area_m2": 1.0}
    for key, value in exact.items():
        own = found[key].summary()
        low, high = own["interval"]
        assert low - 1e-9 <= value <= high + 1e-9, key
        # The peak of the force is a wave that modes can't tell, and the area is that of four points.
        assert high - low < 0.1 * value or key in ("largest_force_n", "largest_area_m2"), key
        assert own["near field"] == "no part in it"
    assert found["impulse_n_s"].parts["modes"] > 0.0
    assert found["impulse_n_s"].parts["mesh"] > 0.0


def hammer() -> Pipeline:
    """A rigid ball on the end of a flexible arm, which swings onto the ground."""
    arm = BLOCK["body"]["block"] | {
        "mesh": {"divisions": [4, 2, 1], "order": 1},
        "modes": {"count": 4},
        "marker": {"left": {"face": "x-"}, "right": {"face": "x+"}},
    }
    hinge = {"type": "revolute", "parent": "ground", "child": "arm.left", "axis": [0, 0, 1], "rate": -1.0}
    head = {"type": "fixed", "parent": "arm.right", "child": "ball.centre"}
    floor = {"between": ["ground", "ball.skin"], "normal": [0, 1, 0], "clearance": RADIUS + 1e-5}
    simulation = BLOCK["simulation"] | {"duration": "0.3 ms", "output_step": "0.01 ms", "tip": "ball.centre"}
    joints = {"hinge": hinge, "head": head}
    tables = {"body": {"arm": arm, "ball": BALL}, "joint": joints, "contact": {"floor": floor}}
    return block(**tables, simulation=simulation)


def test_errors_of_a_rigid_hammer_are_those_of_its_arms_mesh_and_modes_too(monkeypatch: pytest.MonkeyPatch) -> None:
    run = hammer()
    parts = contact_errors(run)["floor"]["impulse_n_s"].parts
    assert parts["near field"] == "no part in it"
    for source in ("step", "mesh", "modes"):
        assert isinstance(parts[source], float)
        assert parts[source] > 0.0
    del run.results[CONTACT_ERRORS]
    monkeypatch.setattr("fmd.accuracy.contact_errors.coarsen_meshes", lambda scene: scene)
    same = contact_errors(run)["floor"]["impulse_n_s"]
    assert same.parts["mesh"] == "not estimated: the coarser meshes are as fine"
    assert same.summary()["interval"] is None


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_a_block_that_is_set_down_at_rest_stays_there(friction: float) -> None:
    run = block(
        'simulation.start="equilibrium"',
        f"contact.floor.friction={friction}",
        'joint.free.position=["0 m", "50 mm", "0 m"]',
        "simulation.duration=5 ms",
    )
    own, weight = run.motion.contacts["floor"], 9.81 * run.motion.mechanism.mass
    np.testing.assert_allclose(own.force[:, 1], weight, rtol=1e-4)
    assert np.abs(run.motion.trajectory.v).max() < 1e-4 * 9.81 * 5e-3  # of what it would fall at


def test_a_block_on_a_slope_starts_with_its_foot_sheared() -> None:
    """Let go with nothing sheared, a block slips at first, even where friction is more than tan 30°."""
    slope = ['simulation.gravity=["4.905 m/s^2", "-8.4957 m/s^2", "0 m/s^2"]', "simulation.duration=5 ms"]
    slope += ["contact.floor.friction=0.8", 'joint.free.position=["0 m", "50 mm", "0 m"]']
    run = block('simulation.start="equilibrium"', *slope)
    own, weight = run.motion.contacts["floor"], 9.81 * run.motion.mechanism.mass
    np.testing.assert_allclose(own.force[:, 0], -0.5 * weight, rtol=1e-3)
    assert np.abs(run.motion.trajectory.v).max() < 1e-3 * 4.9 * 5e-3


def test_a_block_that_turns_as_it_is_set_down_comes_to_lie_flat_and_friction_holds_it_there() -> None:
    tilted = ['simulation.start="equilibrium"', 'joint.free.rotate=["0 deg", "0 deg", "2 deg"]']
    smooth = block(*tilted, "contact.floor.friction=0.0")
    assert smooth.start[0][[3, 5]] == pytest.approx(0.0, abs=1e-6)  # of its quaternion: turned about the normal at most
    rough = block(*tilted, "contact.floor.friction=0.4", "simulation.duration=5 ms")
    assert rough.start[0][3:6] == pytest.approx(smooth.start[0][3:6], abs=1e-6)
    own, weight = rough.motion.contacts["floor"], 9.81 * rough.motion.mechanism.mass
    np.testing.assert_allclose(own.force[:, 1], weight, rtol=1e-4)
    assert np.abs(rough.motion.trajectory.v).max() < 1e-4 * 9.81 * 5e-3


@pytest.mark.long
def test_a_block_that_would_slide_without_friction_has_to_begin_on_its_feet() -> None:
    slope = ['simulation.gravity=["4.905 m/s^2", "-8.4957 m/s^2", "0 m/s^2"]', "contact.floor.friction=0.8"]
    tilted = ['simulation.start="equilibrium"', 'joint.free.rotate=["0 deg", "0 deg", "2 deg"]']
    with pytest.raises(AccuracyError, match="has to begin on its feet, or without friction"):
        _ = block(*tilted, *slope).start
