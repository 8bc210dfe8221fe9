"""Gears whose teeth push one another in motion, against static mesh, quadrature, SciPy and symmetry."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from math import pi
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson, quad, solve_ivp
from scipy.interpolate import CubicSpline, RectBivariateSpline
from scipy.optimize import brentq

from fmd.contact.gear_pair import mesh_gears, press_gears
from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError, InputError
from fmd.core.involute import GearPair
from fmd.dynamics.elements import GearTeeth
from fmd.dynamics.kinematics import Kinematics
from fmd.fitting.parameters import find_parameter
from fmd.output.campbell import compute_campbell
from fmd.output.contact_faults import unfelt_faults
from fmd.output.fmu.write import write_own_fmu
from fmd.output.gear_teeth import gear_teeth_figures, gear_teeth_warnings
from fmd.output.work_precision import compare_on_scene
from fmd.recovery.motion_file import gear_variables
from fmd.scene.gears import find_pair
from fmd.scene.scene import load_scene
from fmd.stages.found_together import known_marches
from fmd.stages.like_mechanisms import with_joint_numbers
from fmd.stages.linear_model import linearise_scene
from fmd.stages.pipeline import Pipeline
from fmd.stages.variants import share_marches

STEP, TORQUE, RATE = 0.5e-6, 100.0, 100.0 * pi
METHODS = (
    {"integrator": "central-difference", "step": STEP},
    {"integrator": "generalized-alpha", "step": STEP},
    {"integrator": "sub-cycling", "step": 2 * STEP, "substeps": 2},
)


def gears(**changes: Any) -> dict[str, Any]:
    """Return a scene of two equal gears of 20 teeth, one of which drives the other at 3000 rpm."""
    gear = {
        "shape": "spur-gear",
        "teeth": 20,
        "module": 0.003,
        "width": 0.02,
        "bore": 0.03,
        "E": 206e9,
        "nu": 0.3,
        "rho": 7850.0,
        "modes": {"count": 3, "enrich": "none"},
        "mesh": {"flank": 2, "fillet": 2, "across": 2, "rim": 2, "along": 1},
        "marker": {"bore": {"face": "bore", "attachment": "averaged"}},
    }
    hinge = {"type": "revolute", "axis": [0, 0, 1]}
    return {
        "title": "Gears",
        "body": {"pinion": gear, "wheel": gear},
        "ground": {"wheel": {"at": [0.06, 0.0, 0.0]}},
        "joint": {
            "in": {**hinge, "parent": "ground", "child": "pinion.bore", "rate": RATE},
            "out": {**hinge, "parent": "ground.wheel", "child": "wheel.bore", "rate": -RATE},
        },
        "drive": {
            "motor": {"type": "torque", "joint": "in", "torque": TORQUE},
            "load": {"type": "torque", "joint": "out", "torque": TORQUE},
        },
        "gear_mesh": {"teeth": {"pinion": "pinion", "wheel": "wheel", "torque": TORQUE}},
        "simulation": {
            "duration": 2.4e-4,
            "output_step": 2e-6,
            "gravity": [0.0, 0.0, 0.0],
            "tip": "pinion.bore",
            "fast": ["in", "out"],
            "run": METHODS,
        },
        **changes,
    }


@cache
def driven() -> Pipeline:
    return Pipeline(load_scene(gears()), Cache(None))


@cache
def pressed() -> tuple[GearPair, Array, Array, Array]:
    """Return the pair, approaches, places over more than a pitch, and forces of the static mesh there."""
    run = driven()
    pair = find_pair("pinion", "wheel", 0.06, run.scene.body)[2]
    both = [run.wholes[name].tooth_flexibility for name in ("pinion", "wheel")]
    approaches = teeth(run).energy.reach * np.linspace(0.0, 1.0, 31) ** 2
    places = pair.path[0] + np.arange(-4, 100) / 96 * pair.pinion.base_pitch
    return pair, approaches, places, press_gears(pair, both, 0.02, approaches, places)


def teeth(run: Pipeline) -> GearTeeth:
    (own,) = run.mechanism.elements
    assert isinstance(own, GearTeeth)
    return own


def test_marches_agree_with_scipy_on_forces_of_the_static_mesh_by_other_interpolation() -> None:
    """Angles and modes by DOP853, forces from the potential of a bivariate spline; a quarter of a pitch."""
    run, (pair, approaches, places, forces) = driven(), pressed()
    own, links = teeth(run), run.mechanism.links
    energies = np.vstack([0.0 * places, cumulative_simpson(forces, x=approaches, axis=0)])
    V = RectBivariateSpline(approaches, places, energies)
    M = run.system.linear_matrices[0]
    n = [len(link.omega) for link in links]
    grip = np.zeros((2, 2 + sum(n)))
    grip[:, :2] = np.eye(2)
    grip[0, 2 : 2 + n[0]], grip[1, 2 + n[0] :] = links[0].joint_rotation, links[1].joint_rotation
    stiffness = np.concatenate([np.zeros(2), links[0].omega ** 2, links[1].omega ** 2])

    def side(x: float, s: float) -> tuple[float, float]:
        if x <= 0.0:
            return 0.0, 0.0
        s = pair.path[0] + (s - pair.path[0]) % pair.pinion.base_pitch
        return float(V(x, s, dx=1)[0, 0]), float(V(x, s, dy=1)[0, 0])

    def rates(_: float, y: Array) -> Array:
        q, v = np.split(y, 2)
        angles, (r, _) = grip @ q, own.radii
        x = r * angles.sum()
        f, g = side(x, own.places[0] + r * angles[0])
        back, turned = side(-x - own.backlash, own.places[1] - r * angles[0])
        torques = np.array([TORQUE - r * (f - back + g - turned), TORQUE - r * (f - back)])
        return np.concatenate([v, (grip.T @ torques - stiffness * q) / M.diagonal()])

    start = np.zeros(2 * len(M))
    start[len(M) : len(M) + 2] = RATE, -RATE
    times = run.output_times
    found = solve_ivp(rates, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=1e-5, atol=1e-10)
    exact = own.radii[0] * (grip @ found.y[: len(M)]).sum(axis=0)
    assert exact.max() > 1e-5
    for label, motion in run.motions.items():
        _, error = (variable.values for variable in gear_variables(motion))
        assert np.abs(error - exact).max() < 0.01 * exact.max(), label


def test_energy_is_kept_but_for_the_work_of_the_torques_and_teeth_never_pull() -> None:
    for motion in driven().motions.values():
        kinetic, potential = motion.energies
        work = TORQUE * sum(motion.kinematics.along_joint(k)[0] for k in (0, 1))
        drift = kinetic + potential - work
        assert np.abs(drift - drift[0]).max() < 2e-3 * potential.max()
        force, error = (variable.values for variable in gear_variables(motion))
        assert (force * error >= 0.0).all()


def test_forces_on_both_gears_are_along_one_line_but_for_what_the_teeth_s_stiffness_turns() -> None:
    """They are equal and opposite; their moments differ by the energy's slope, which is small."""
    run = driven()
    first, second = np.moveaxis(run.motion.kinematics.wrenches(teeth(run)), 1, 0)
    assert first[:, :3] == pytest.approx(-second[:, :3], abs=1e-9)
    moment = first[:, 3:] + second[:, 3:] + np.cross([0.06, 0.0, 0.0], second[:, :3])
    assert np.abs(moment).max() < 0.02 * np.abs(second[:, 3:]).max()
    off = np.moveaxis(run.motion.kinematics.wrenches(replace(teeth(run), middles=(0.01, -0.02))), 1, 0)
    tilting = off[:, :, 3:] - np.stack([first, second])[:, :, 3:]
    arms = np.array([[0.0, 0.0, 0.01], [0.0, 0.0, -0.02]])[:, None, :]
    assert tilting == pytest.approx(np.cross(arms, np.stack([first, second])[:, :, :3]), abs=1e-9)
    across = np.hypot(*second[-1, :2])
    assert second[-1, 5] == pytest.approx(-teeth(run).radii[1] * across, rel=1e-12)


def test_gears_mirrored_about_the_line_of_their_axes_push_with_their_other_flanks() -> None:
    """At the start a tooth of the pinion is on that line, and there is no backlash; a wider one is crossed freely."""
    run = driven()
    q = np.zeros((2, run.mechanism.n_positions))
    q[0, :2] = 0.1, -0.1 + 4e-4
    q[1] = -q[0]

    def energies(own: GearTeeth) -> Array:
        mechanism = replace(run.mechanism, elements=[own])
        return Kinematics(mechanism, np.zeros(2), q, np.zeros((2, mechanism.n))).energies[1]

    own = teeth(run)
    assert own.backlash < 1e-12
    ahead, behind = energies(own)
    assert ahead == pytest.approx(behind, rel=1e-9)
    pressed_by = own.radii[0] * 4e-4
    loose = energies(replace(own, backlash=1.5 * pressed_by))
    assert loose.tolist() == [ahead, 0.0]


def test_damped_teeth_that_part_fast_push_no_more_but_do_not_pull() -> None:
    """Where they part by 1 m/s, τ ∂²V/∂x² ẋ is far above the force; where they approach, both add up."""
    run, own = driven(), replace(teeth(driven()), damping=20e-6, backlash=1e-4)
    q, v = np.zeros((3, run.mechanism.n_positions)), np.zeros((3, run.mechanism.n))
    q[:, 1] = 2e-4
    v[:, 1] = np.array([-1.0, 0.0, 1.0]) / own.radii[1]
    mechanism = replace(run.mechanism, elements=[own])
    parting, still, meeting = Kinematics(mechanism, np.zeros(3), q, v).wrenches(own)[:, 1, 5] / -own.radii[1]
    assert abs(parting) < 1e-9
    assert meeting > 2.0 * still > 0.0


def test_slow_gears_have_the_error_of_the_static_mesh() -> None:
    """The pinion turns by a given angle, 120 rpm, and the wheel is loaded; by the mesh's own forces at places."""
    scene = gears()
    scene["joint"]["in"] = {key: value for key, value in scene["joint"]["in"].items() if key != "rate"}
    scene["joint"]["out"]["rate"] = -4 * pi
    scene["drive"]["motor"] = {"type": "motion", "joint": "in", "angle": {"formula": "4*pi*t", "unit": "rad"}}
    scene["gear_mesh"]["teeth"]["damping"] = 20e-6
    scene["simulation"] |= {"duration": 0.02, "output_step": 0.25e-3, "fast": []}
    scene["simulation"]["run"] = [{"integrator": "central-difference", "step": 2e-6}]
    run = driven().variant(load_scene(scene))
    pair, approaches, places, forces = pressed()
    own, load = teeth(run), TORQUE / pair.wheel.base_radius
    force, error = (variable.values[10:] for variable in gear_variables(run.motion))
    assert force == pytest.approx(load, rel=3e-3)
    at = own.places[0] + own.radii[0] * 4 * pi * run.output_times[10:]
    at = pair.path[0] + (at - pair.path[0]) % pair.pinion.base_pitch
    static = CubicSpline(places, [CubicSpline(column, approaches)(load) for column in forces.T])(at)
    assert error == pytest.approx(static, rel=0.01)
    figures = gear_teeth_figures(run)["gear_meshes"]["teeth"]
    assert figures["table_error"] < 0.02
    assert [own["code"] for own in gear_teeth_warnings(run)] == ["gear-stress", "gear-inertia", "gear-inertia"]


def test_a_wheel_on_a_held_pinion_swings_with_the_period_by_quadrature() -> None:
    """From touch under a step of torque: ``2 ∫ dx/√(2 (F₀ x − V)/m)`` with the static mesh's forces at that place."""
    scene = gears()
    for joint in scene["joint"].values():
        joint.pop("rate")
    scene["drive"]["motor"] = {"type": "motion", "joint": "in", "angle": 0.0}
    scene["simulation"] |= {"duration": 4e-4, "output_step": 1e-6, "fast": [], "run": METHODS[:1]}
    run = driven().variant(load_scene(scene))
    pair, approaches, places, forces = pressed()
    own, load = teeth(run), TORQUE / pair.wheel.base_radius
    s = pair.path[0] + (own.places[0] - pair.path[0]) % pair.pinion.base_pitch
    V = CubicSpline(approaches, [CubicSpline(places, row)(s) for row in forces]).antiderivative()
    mass = float(run.system.linear_matrices[0][0, 0]) / own.radii[1] ** 2
    far = brentq(lambda x: load * x - V(x), 1e-6, approaches[-1])

    def slowness(a: float) -> float:  # x = far (1 − cos a)/2 takes the ends' singularities away
        x = 0.5 * far * (1.0 - np.cos(a))
        return float(0.5 * far * np.sin(a) / np.sqrt(2.0 * (load * x - V(x)) / mass))

    _, error = (variable.values for variable in gear_variables(run.motion))
    assert error.max() == pytest.approx(far, rel=5e-3)
    path = CubicSpline(run.output_times, error)
    first, second = [t for t in path.derivative().roots(extrapolate=False) if path(t) > 0.9 * far][:2]
    assert second - first == pytest.approx(2.0 * quad(slowness, 1e-3, pi - 1e-3)[0], rel=5e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joint.in.type": "fixed"}, "isn't carried by a revolute joint on the ground"),
        ({"ground.wheel.at": [0.0599, 0.0, 0.0]}, r"ground\.wheel\.at = .*: lets the teeth jam"),
        ({"ground.wheel.at": [0.0599, 0.0, 0.03]}, r"ground\.wheel\.at = .*: lets the teeth jam"),
        ({"gear_mesh": {"in": {"pinion": "pinion", "wheel": "wheel", "torque": 1.0}}}, "name of a contact or a joint"),
        ({"body.wheel.pieces": 2}, r"gear_mesh\.teeth\.wheel = .*: is in pieces, which have no teeth"),
        ({"gear_mesh.teeth.wheel": "whel"}, "did you mean 'wheel'"),
        ({"simulation.run": [{"integrator": "runge-kutta"}]}, "takes no gears in mesh; central-difference"),
        ({"simulation.start": "steady"}, "doesn't know of gears in mesh; 'undeformed', 'equilibrium' and"),
    ],
)
def test_gears_that_cannot_move_so_are_refused(changes: dict[str, Any], message: str) -> None:
    scene = gears()
    for key, value in changes.items():
        *path, last = key.split(".")
        table = scene
        for name in path:
            table[name] = dict(table[name])
            table = table[name]
        table[last] = value
        if value == "fixed":
            del table["rate"], table["axis"]
            scene["drive"] = {}
    with pytest.raises(InputError, match=message):
        load_scene(scene)


@pytest.mark.parametrize(
    ("place", "axis", "message"),
    [
        ([0.06, 0.0, 1e-3], [0, 0, 1], "the gears' axes aren't parallel, with the middles"),
        ([0.06, 0.0, 0.0], [0, 1e-3, 1], "joint.out isn't along the axis of wheel, which is the z axis"),
    ],
)
def test_axes_that_are_not_parallel_are_refused(place: list[float], axis: list[float], message: str) -> None:
    scene = gears()
    scene["ground"]["wheel"]["at"], scene["joint"]["out"]["axis"] = place, axis
    with pytest.raises(InputError, match=message):
        _ = driven().variant(load_scene(scene)).mechanism


def held(**simulation: Any) -> Pipeline:
    """The wheel under its load on a pinion that stays where it is."""
    scene = gears()
    for joint in scene["joint"].values():
        joint.pop("rate")
    scene["drive"]["motor"] = {"type": "motion", "joint": "in", "angle": 0.0}
    scene["simulation"] |= {"duration": 2e-6, "output_step": 2e-6, "fast": [], "run": METHODS[:1], **simulation}
    return driven().variant(load_scene(scene))


def test_a_gear_that_also_touches_says_that_forces_on_its_teeth_deflect_no_face() -> None:
    """Nothing is said of a body that touches beside gears; neither is pressed yet."""
    bodies = [SimpleNamespace(body=name, points=SimpleNamespace(yields={})) for name in ("pinion", "plate")]
    none = {own.body: np.zeros((1, 1, 3)) for own in bodies}
    touched = SimpleNamespace(forces=none, places=none)
    motion = SimpleNamespace(touched=touched, mechanism=SimpleNamespace(contacts=bodies, elements=[]))
    run: Any = SimpleNamespace(motion=motion, parts=dict.fromkeys(["pinion", "plate"]), scene=load_scene(gears()))
    ((code, text),) = unfelt_faults(run)
    assert code == "contact-gear"
    assert text.startswith("gear_mesh.teeth: forces on the teeth of pinion deflect neither")


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (lambda: linearise_scene(driven(), ["drive.load"], ["out.position"]), r"no flank is pressed .*\(start\)"),
        (lambda: compute_campbell(driven(), np.zeros(1), [1.0]), "a rotor's vibrations takes no gears in mesh"),
        (lambda: compare_on_scene(driven()), "a comparison of methods takes no gears in mesh"),
        (lambda: find_parameter(driven().scene, "gear_mesh.teeth.torque"), "is no number that results change with"),
    ],
)
def test_what_does_not_take_gears_in_mesh_says_so(use: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        use()


def test_at_rest_under_a_load_force_and_vibration_are_those_of_the_static_mesh() -> None:
    """The wheel with its disc as rigid: ``ω² = ∂²V/∂x² r²/J``, which its lowest mode makes a little lower."""
    run = held(start="equilibrium")
    own, (pair, approaches, places, forces) = teeth(run), pressed()
    force, error = (variable.values for variable in gear_variables(run.motion))
    assert force == pytest.approx(TORQUE / pair.wheel.base_radius, rel=1e-9)
    s = pair.path[0] + (own.places[0] - pair.path[0]) % pair.pinion.base_pitch
    curve = CubicSpline(approaches, [CubicSpline(places, row)(s) for row in forces])
    assert curve(error[0]) == pytest.approx(force[0], rel=5e-3)
    inertia = run.system.linear_matrices[0][0, 0]
    rigid = np.sqrt(curve(error[0], 1) * own.radii[1] ** 2 / inertia) / (2 * pi)
    model = linearise_scene(run, ["drive.load"], ["out.position"], "equilibrium").model
    assert model.poles_hz.min() == pytest.approx(rigid, rel=0.03)
    assert model.poles_hz.min() < rigid


@pytest.mark.long
def test_gears_in_lanes_move_as_by_themselves(lanes: Any) -> None:
    runs = []
    for damper in np.geomspace(0.01, 1.0, 8).tolist():
        scene = gears()
        scene["joint"]["out"] = {**scene["joint"]["out"], "damper": damper}
        scene["simulation"] |= {"duration": 4e-5, "run": METHODS[:1]}
        runs.append(driven().variant(load_scene(scene)))
        like = with_joint_numbers(runs[0].mechanism, runs[-1].scene)  # whose teeth needn't be tabulated again
        runs[-1].results["mechanism"] = like
    share_marches(runs)
    assert lanes.marches == [8]
    for run in runs:
        (plan,) = run.plans.values()
        (found,) = known_marches(run).values()
        assert found.q == pytest.approx(plan.march(run.output_times).q, rel=1e-9, abs=1e-15)


def test_a_table_that_is_coarse_or_overrun_is_warned_of() -> None:
    run = held()
    own = teeth(run)
    mechanism = replace(run.mechanism, elements=[replace(own, energy=replace(own.energy, error=0.03, reach=1e-12))])
    run.results["mechanism"] = mechanism
    found = [warning["text"] for warning in gear_teeth_warnings(run) if warning["code"] == "gear-table"]
    assert "tabulated up to" in found[0]
    assert "off by 0.03 of the load, which no key makes less" in found[1]


def test_what_stiffens_gears_is_found_with_the_ratio_of_their_teeth() -> None:
    """A torque turns both, ``(J₁ + J₂ (z₁/z₂)²) α₁ = T``; with teeth that don't touch the wheel would stand still."""
    scene = gears()
    scene["joint"]["in"].pop("rate"), scene["joint"]["out"].pop("rate")
    scene["joint"]["out"]["axis"] = [0, 0, -1]
    scene["ground"]["wheel"]["at"] = [0.075, 0.0, 0.0]
    scene["body"]["wheel"] = {**scene["body"]["wheel"], "teeth": 30}
    del scene["drive"]["load"]
    scene["simulation"] |= {"duration": 0.01, "run": METHODS[:1]}
    run = Pipeline(load_scene(scene), Cache(None))
    J = [float(np.trace(run.parts[name].body.integrals.G[:2, :2, 0, 0])) for name in ("pinion", "wheel")]
    found = [run.stiffening_loads[name].largest_rate for name in ("pinion", "wheel")]
    assert found[0] == pytest.approx(TORQUE * 0.01 / (J[0] + J[1] * (20 / 30) ** 2), rel=1e-6)
    assert found[1] == pytest.approx(found[0] * 20 / 30, rel=1e-9)


def test_what_stiffens_gears_whose_motions_are_given_follows_these() -> None:
    """On a pinion that is held the wheel stands still; motions at both ends need no teeth."""
    assert held().stiffening_loads["wheel"].largest_rate < 1e-9
    scene = gears()
    scene["simulation"] |= {"fast": [], "run": METHODS[:1]}
    for name, joint, rate in (("motor", "in", 30.0), ("load", "out", -20.0)):
        angle = {"formula": f"{rate}*t", "unit": "rad"}
        scene["joint"][joint] = {key: value for key, value in scene["joint"][joint].items() if key != "rate"}
        scene["drive"][name] = {"type": "motion", "joint": joint, "angle": angle}
    loads = driven().variant(load_scene(scene)).stiffening_loads
    assert loads["pinion"].largest_rate == pytest.approx(30.0)
    assert loads["wheel"].largest_rate == pytest.approx(20.0)


def test_forces_of_teeth_that_are_not_meshed_are_refused() -> None:
    pair, _, places, _ = pressed()
    both = [driven().wholes[name].tooth_flexibility for name in ("pinion", "wheel")]
    with pytest.raises(ValueError, match=r"pairs of teeth touch at once; mesh\.teeth = \d is needed for both gears"):
        press_gears(pair, both, 0.02, np.array([0.0, 2e-3]), places)


def test_forces_that_do_not_settle_end_in_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    pair, approaches, places, _ = pressed()
    both = [driven().wholes[name].tooth_flexibility for name in ("pinion", "wheel")]
    monkeypatch.setattr("fmd.contact.gear_pair.GEAR_PASSES", 1)
    with pytest.raises(AccuracyError, match=r"the forces on . pairs of teeth don't settle"):
        press_gears(pair, both, 0.02, approaches, places[:1])
    with pytest.raises(AccuracyError, match=r"the load's shares of . pairs of teeth don't settle, at 0\.06 m"):
        mesh_gears(pair, both, 0.02, TORQUE, 3)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_an_fmu_has_the_gears_teeth(kind: str, tmp_path: Path) -> None:
    """By FMPy's integrator and by the FMU's own, against central differences in steps of 0.5 µs."""
    fmpy = pytest.importorskip("fmpy", reason="FMPy isn't installed")
    run = driven()
    paths = write_own_fmu(run, tmp_path / "gears.fmu")
    own = sum(run.motion.kinematics.along_joint(number)[0] for number in (0, 1))
    for path in paths:
        rows = fmpy.simulate_fmu(
            str(path),
            fmi_type=kind,
            stop_time=float(run.output_times[-1]),
            output_interval=2e-6,
            output=["in.position", "out.position"],
            relative_tolerance=1e-8,
        )
        found = np.interp(run.output_times, rows["time"], rows["in.position"] + rows["out.position"])
        assert found == pytest.approx(own, abs=2e-3 * np.abs(own).max())
