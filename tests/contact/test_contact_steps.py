"""Steps of scenes with contacts: refused before contacts are found, and chosen by the modes for an implicit method."""

import os
import re
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.contact_errors import contact_errors
from fmd.core.errors import ConvergenceError, InputError
from fmd.core.limits.contact import CHOSEN_STEP
from fmd.core.limits.errors import SAFETY
from fmd.integrators.exponential import Exponential
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.output.contacts import contact_warnings
from fmd.output.summary import summarise
from fmd.stages.contact_steps import steps_settle
from tests.contact.test_contact_points import BLOCK
from tests.contact.test_rigid_contacts import BALL, MASS, RADIUS, SPEED, STIFF, free, scene

IMPLICIT = "simulation.run.0.integrator=generalized-alpha"
NEAR = (  # 40 µm above the floor, with the speed of the fall
    'joint.free.position=["0 m", "50.04 mm", "0 m"]',
    'joint.free.velocity=["0 m/s", "-0.44 m/s", "0 m/s"]',
    "simulation.duration=0.3 ms",
    "simulation.output_step=10 us",
)


def block(*overrides: str, **tables: Any) -> Pipeline:
    return Pipeline(load_scene(BLOCK | tables, overrides))


def test_a_step_beyond_the_modes_own_limit_is_refused_before_contacts_are_found() -> None:
    run, free = block("simulation.step=1 ms"), block(contact={})
    with pytest.raises(InputError, match=r"simulation\.step = '0\.001 s': is too long for contact") as refused:
        _ = run.mechanism
    assert "contact" not in run.parts["block"].results
    stable = float(re.search(r"stable up to ([\d.e-]+) s", str(refused.value)).group(1))  # type: ignore[union-attr]
    assert stable == pytest.approx(2.0 / free.parts["block"].body.omega[-1], rel=1e-3)
    assert "simulation.run.0.integrator = 'generalized-alpha'" in str(refused.value)
    assert "body.block.modes.enrich" not in str(refused.value)  # there are none to leave out
    with pytest.raises(InputError, match=r"body\.block\.modes\.enrich = 'none' leaves out the fastest modes"):
        _ = block("simulation.step=1 ms", "body.block.modes.enrich=inertia").mechanism


def automatic(scene: dict[str, Any], error: float, *overrides: str) -> Pipeline:
    simulation = {key: value for key, value in scene["simulation"].items() if key != "step"}
    simulation |= {"run": [{"integrator": "auto"}], "error": error}
    return Pipeline(load_scene(scene | {"simulation": simulation}, overrides))


def test_auto_halves_steps_of_an_implicit_method_until_figures_of_contacts_agree() -> None:
    """Its impulse and largest force are those of explicit steps of 1 µs, which resolve what it passes over."""
    run, fine = automatic(BLOCK, 5e-3, *NEAR), block(*NEAR, "simulation.step=1 us")
    ours, exact = (each.motion.contacts["floor"] for each in (run, fine))
    assert list(run.motions) == ["generalized-alpha"]
    assert run.motion.trajectory.step <= 0.125 * run.growths[0].step * CHOSEN_STEP / run.results["contact step"]
    assert ours.impulse[-1] == pytest.approx(exact.impulse[-1], rel=1e-2, abs=1e-2 * np.abs(exact.impulse[-1]).max())
    assert ours.largest[0] == pytest.approx(exact.largest[0], rel=1e-2)


@pytest.mark.parametrize(("error", "told"), [(1e-2, []), (1e-6, ["contact-step"])])
def test_auto_halves_explicit_steps_of_rigid_surfaces_and_warns_where_that_is_not_enough(
    error: float, told: list[str]
) -> None:
    """Largest force of a ball by Hertz, ``4/3 E* √R δ^1.5`` with ``δ = (15 m v²/(16 E* √R))^0.4``."""
    joint = {"free": free("ball.centre", [0, 0, RADIUS + 1e-6], [0, 0, -SPEED])}
    floor = {"between": ["ground", "ball.skin"], "normal": [0, 0, 1]}
    run = automatic(scene({"ball": BALL}, joint, {"floor": floor}, 3e-4), error)
    own, stiff = run.motion.contacts["floor"], STIFF * np.sqrt(RADIUS)
    force = 4.0 / 3.0 * stiff * (15.0 / 16.0 * MASS * SPEED**2 / stiff) ** 0.6
    assert list(run.motions) == ["central-difference"]
    assert own.largest[0] == pytest.approx(force, rel=max(error, 1e-5))
    assert not contact_warnings(run)
    warnings = [each for each in summarise(run, [], True, 100.0)["warnings"] if each["code"] == "contact-step"]
    assert [each["code"] for each in warnings] == told
    assert all(
        "contact.floor: halvings of the step have brought its largest force" in each["text"] for each in warnings
    )


@pytest.mark.parametrize("tolerance", [1e-4, pytest.param(1e-6, marks=pytest.mark.long)])
def test_runge_kutta_states_the_errors_of_a_shock_by_its_tolerance(tolerance: float) -> None:
    """A ball's impulse is twice its momentum, its largest force Hertz's; a block's are those by a tight tolerance."""
    joint = {"free": free("ball.centre", [0, 0, RADIUS + 1e-6], [0, 0, -SPEED])}
    floor = {"between": ["ground", "ball.skin"], "normal": [0, 0, 1]}
    stiff = STIFF * np.sqrt(RADIUS)
    force = 4.0 / 3.0 * stiff * (15.0 / 16.0 * MASS * SPEED**2 / stiff) ** 0.6
    rigid, block = scene({"ball": BALL}, joint, {"floor": floor}, 3e-4), with_tolerance(BLOCK, 1e-8, *NEAR).motion
    own = block.contacts["floor"]
    cases = [(rigid, (), 2.0 * MASS * SPEED, force), (BLOCK, NEAR, own.impulse[-1, 1], own.largest[0])]
    for of, overrides, impulse, largest in cases:
        run = with_tolerance(of, tolerance, *overrides)
        found, errors = run.motion.contacts["floor"], contact_errors(run)["floor"]
        for key, value, exact in (
            ("impulse_n_s", float(np.linalg.norm(found.impulse[-1])), impulse),
            ("largest_force_n", found.largest[0], largest),
        ):
            part = errors[key].parts["step"]
            assert abs(value - exact) < 3.0 * SAFETY * part < 0.2 * exact


def test_runge_kutta_begins_where_a_block_rests_undeformed_in_few_evaluations() -> None:
    """What has moved is round-off of places at first, in which a touch is lost again; it took 3.7 million of them."""
    at_rest = ('joint.free.position=["0 m", "50 mm", "0 m"]', "simulation.duration=20 us")
    motion = with_tolerance(BLOCK, 1e-9, *at_rest, "simulation.output_step=20 us").motion
    fallen = motion.mechanism.mass * (9.81 * 20e-6 + motion.kinematics.momentum[-1, 1] / motion.mechanism.mass)
    assert motion.contacts["floor"].impulse[-1, 1] == pytest.approx(fallen, rel=1e-8)
    assert motion.trajectory.evaluations < 1000


def with_tolerance(scene: dict[str, Any], tolerance: float, *overrides: str) -> Pipeline:
    runs = {"run": [{"integrator": "runge-kutta", "tolerance": tolerance}]}
    return Pipeline(load_scene(scene | {"simulation": scene["simulation"] | runs}, overrides))


def on_a_slide(*overrides: str, drive: Any = None, **joint: Any) -> Pipeline:
    """A steel ball that comes down on a slide, in 48 steps a shock."""
    slide = {"type": "prismatic", "parent": "ground", "child": "ball.centre", "axis": [0, 0, 1]}
    joints = {"slide": slide | {"position": RADIUS + 1e-6, "rate": -SPEED} | joint}
    floor = {"between": ["ground", "ball.skin"], "normal": [0, 0, 1]}
    whole = scene({"ball": BALL}, joints, {"floor": floor}, 3e-4, **EXACT) | {"drive": drive or {}}
    return Pipeline(load_scene(whole, overrides))


EXACT: dict[str, Any] = {"run": [{"integrator": "exponential"}], "step": "2 us"}


def test_exponential_steps_keep_the_energy_of_a_scene_and_refuse_what_does_not() -> None:
    own = on_a_slide()
    errors, floor = contact_errors(own)["floor"], own.motion.contacts["floor"]
    assert own.motion.trajectory.v[-1, 0] == pytest.approx(SPEED, rel=1e-11)
    assert floor.impulse[-1, 2] == pytest.approx(2.0 * MASS * SPEED, rel=1e-10)
    assert 0.0 < errors["largest_force_n"].parts["step"] < 0.02 * floor.largest[0]
    with pytest.raises(InputError, match=r"keeps the energy of contacts beside gravity, loads in time and linear spr"):
        _ = on_a_slide(damper="1 N s/m").motion
    slide = {"type": "prismatic", "parent": "ground", "child": "block.middle", "axis": [0, 1, 0]}
    damped = {"slide": slide | {"position": "60 mm", "damper": "1 N s/m"}}
    with pytest.raises(InputError, match=r"loads in time and linear springs alone, without dampers"):
        _ = block(joint=damped, simulation=BLOCK["simulation"] | EXACT).motion  # far less than its modes' stiffness
    later = {"type": "force", "joint": "slide", "force": {"formula": "1e9*t*q**2", "unit": "N"}}
    with pytest.raises(InputError, match=r"loads in time and linear springs alone"):
        _ = on_a_slide(drive={"later": later}).motion  # none at t = 0
    hinge = {"hinge": {"type": "revolute", "parent": "ground", "child": "ball.centre", "axis": [0, 1, 0]}}
    contact = {"floor": {"between": ["ground", "ball.skin"], "normal": [0, 0, 1]}}
    with pytest.raises(InputError, match=r"takes contacts of bodies that slide alone, and joint 'hinge' turns"):
        load_scene(scene({"ball": BALL}, hinge, contact, 3e-4, **EXACT))


def test_exponential_steps_warn_where_they_spread_a_shock_and_take_no_friction_from_python() -> None:
    runs = [on_a_slide(f"simulation.step={step} us") for step in (2, 40)]
    assert [[own["code"] for own in contact_warnings(run)] for run in runs] == [[], ["contact-spread"]]
    rough = on_a_slide("contact.floor.friction=0.1", "simulation.run.0.integrator=central-difference")
    with pytest.raises(ValueError, match=r"takes no friction, damping or restitution in contacts: ball has some"):
        Exponential(1e-6).march(rough.system, *rough.start, np.zeros(1))


@pytest.mark.long  # kernels as they stand
def test_runge_kutta_reads_no_slope_beyond_its_stages() -> None:
    ball = "with_tolerance(scene({'ball': BALL}, {'free': free('ball.centre', [0, 0, 0], [0, 0, 1])}, {}, 1e-4), 1e-4)"
    code = f"from tests.contact.test_contact_steps import *; print({ball}.motion.trajectory.q[-1, 2])"
    kernels = os.environ | {"FMD_KERNELS": "python"}
    found = subprocess.run([sys.executable, "-c", code], env=kernels, capture_output=True, text=True, check=False)
    assert float(found.stdout) == pytest.approx(1e-4), found.stderr


@pytest.mark.parametrize("speed", [0.05, 3.0])
def test_runge_kutta_follows_a_shock_of_free_balls_that_its_first_step_would_pass(speed: float) -> None:
    """Nothing moves faster and faster before it, so that steps would grow without bound; impulse by two masses."""
    joints = {
        "one": free("low.centre", [0, 0, 0], [0, 0, 0.5 * speed]),
        "two": free("high.centre", [0, 0, 2.0 * RADIUS + 1e-6], [0, 0, -0.5 * speed]),
    }
    hit = {"hit": {"between": ["low.skin", "high.skin"]}}
    run = with_tolerance(scene({"low": BALL, "high": BALL}, joints, hit, 5e-3), 1e-6)
    assert run.motion.contacts["hit"].impulse[-1, 2] == pytest.approx(MASS * speed, rel=1e-4)


def test_runge_kutta_passes_a_touch_that_only_a_rough_trial_has() -> None:
    """One ball rests on the floor, where a trial that the other has gone deep into it wavers about touching."""
    along = {"type": "prismatic", "parent": "ground", "axis": [0, 0, 1]}
    joints = {
        "one": along | {"child": "low.centre", "position": RADIUS},
        "two": along | {"child": "high.centre", "position": 3.0 * RADIUS + 1e-6, "rate": -SPEED},
    }
    touching = {"floor": {"between": ["ground", "low.skin"], "normal": [0, 0, 1]}}
    hit = {"hit": {"between": ["low.skin", "high.skin"]}}
    run = with_tolerance(scene({"low": BALL, "high": BALL}, joints, touching | hit, 3e-4), 1e-4)
    assert run.motion.trajectory.evaluations < 5000
    v, floor = run.motion.trajectory.v[-1], run.motion.contacts["floor"]
    assert 0.5 * MASS * (v**2).sum() == pytest.approx(0.5 * MASS * SPEED**2, rel=1e-3)
    assert MASS * (v.sum() + SPEED) == pytest.approx(floor.impulse[-1, 2], rel=1e-6)


@pytest.mark.parametrize(("speed", "tolerance"), [(0.55, 1.8e-7), (2.4, 4e-8), (0.084, 1.5e-7)])
def test_runge_kutta_states_what_a_force_that_is_not_smooth_costs(speed: float, tolerance: float) -> None:
    """A ball's force begins as a power of the depth, which the estimate of order 8 takes for smooth."""
    joint = {"free": free("ball.centre", [0, 0, RADIUS + 1e-6], [0, 0, -speed])}
    floor = {"between": ["ground", "ball.skin"], "normal": [0, 0, 1]}
    run = with_tolerance(scene({"ball": BALL}, joint, {"floor": floor}, 2e-4), tolerance)
    exact, error = 2.0 * MASS * speed, contact_errors(run)["floor"]["impulse_n_s"].total
    assert abs(run.motion.contacts["floor"].impulse[-1, 2] - exact) < error < 1e-4 * exact


SLIDE = {"type": "prismatic", "parent": "ground.place", "child": "block.middle", "axis": [0, 1, 0]}


def test_exponential_steps_take_a_constant_load_on_a_face_whose_deflection_turns_it() -> None:
    """Such a load adds to the stiffness, as the modes of the whole mechanism have it."""
    push = {"type": "point force", "marker": "block.bottom", "direction": [0, -1, 0], "force": "3 kN"}
    tables = {"joint": {"free": SLIDE | {"position": "50.1 mm"}}, "ground": {"place": {"at": [0, 0, 0]}}}
    forces = list[float]()
    for method in ({"integrator": "exponential", "step": "2 us"}, {"step": "0.5 us"}):
        more = {"duration": "0.5 ms", "output_step": "50 us", "run": [BLOCK["simulation"]["run"][0] | method]}
        run = block(drive={"push": push}, simulation=BLOCK["simulation"] | more, **tables)
        forces.append(run.motion.contacts["floor"].largest[0])
        lost = run.motion.contacts["floor"].energy_error
        assert np.abs(lost).max() < (1e-9 if len(forces) == 1 else 1e-3) * run.motion.energies[0].max()
    assert forces[0] == pytest.approx(forces[1], rel=2e-3)


def exactly(height: str, step: str) -> Pipeline:
    """A block on a slide that falls on twenty points, with exponential steps."""
    tables = {"joint": {"free": SLIDE | {"position": height}}, "ground": {"place": {"at": [0, 0, 0]}}}
    more = {"duration": "1 ms", "output_step": "50 us", "run": [{"integrator": "exponential", "step": step}]}
    return block(simulation=BLOCK["simulation"] | more, **tables)


@pytest.mark.parametrize(("height", "lost"), [("50.0001 mm", 1e-6), ("50.001 mm", 1e-7)])
def test_exponential_steps_keep_the_energy_of_gentle_touches_to_the_round_off_of_places(
    height: str, lost: float
) -> None:
    """Dropped by 0.1 and 1 µm, forces were asked for beyond that, and the march ended."""
    run = exactly(height, "0.5 us")
    assert run.motion.contacts["floor"].largest[0] > 100.0
    assert np.abs(run.motion.contacts["floor"].energy_error).max() < lost * run.motion.energies[0].max()


def test_exponential_steps_so_short_that_round_off_is_left_of_their_forces_name_a_longer_one() -> None:
    with pytest.raises(ConvergenceError, match=r"with a step of 1e-07 s; take a longer step, such as 4e-07 s"):
        _ = exactly("50.00001 mm", "0.1 us").motion  # from ten times as high its bits decide


def test_runge_kutta_takes_no_contact_with_a_memory() -> None:
    floor = BLOCK["contact"]["floor"] | {"friction": 0.1}
    told = r"takes no contact with friction, damping or restitution, as of contact\.floor; central-difference, sub-cyc"
    with pytest.raises(InputError, match=told):
        with_tolerance(BLOCK | {"contact": {"floor": floor}}, 1e-6)


def test_auto_is_the_only_run_of_a_scene_with_contacts_and_other_steered_methods_are_refused() -> None:
    runs = [{"integrator": "auto"}, {"integrator": "central-difference"}]
    with pytest.raises(InputError, match=r"'auto': is a scene's only run with contacts; central-difference, "):
        load_scene(BLOCK | {"simulation": BLOCK["simulation"] | {"run": runs}})
    told = (
        r"simulation\.run\.0\.integrator = 'Radau': takes no contact; 'auto' does, and central-difference, "
        r"sub-cycling, exponential, runge-kutta and generalized-alpha do"
    )
    with pytest.raises(InputError, match=told):
        load_scene(BLOCK | {"simulation": BLOCK["simulation"] | {"run": [{"integrator": "Radau"}]}})


def test_an_implicit_method_takes_a_step_by_its_modes_and_the_impulse_of_short_explicit_ones() -> None:
    implicit, explicit = (block(*own, *NEAR, "body.block.modes.enrich=inertia") for own in ([IMPLICIT], []))
    (first,) = implicit.growths
    assert first.step == pytest.approx(0.25 * 2.0 / implicit.parts["block"].body.omega[3])  # of four modes that count
    assert first.step > implicit.system.largest_step  # which an explicit method would diverge at
    found = [run.motion.contacts["floor"] for run in (implicit, explicit)]
    assert found[0].impulse[-1, 1] == pytest.approx(found[1].impulse[-1, 1], rel=0.02)
    assert found[0].lost_part(implicit.motion.energies[0]) <= 0.01  # by halvings


def test_a_step_that_does_not_converge_is_halved_where_it_is_left_open_and_named_where_it_is_given(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    march, steps = GeneralizedAlpha.march, []

    def fail_at_first(method: GeneralizedAlpha, *arguments: Any) -> Any:
        steps.append(method.step)
        if method.step == steps[0] and arguments[3][-1] > 0.0:  # not as it is compiled
            raise ConvergenceError("Newton's iteration did not converge")
        return march(method, *arguments)

    monkeypatch.setattr(GeneralizedAlpha, "march", fail_at_first)
    assert block(IMPLICIT).motion.contacts["floor"].impulse[-1, 1] > 0.0
    assert steps[-1] <= 0.5 * steps[0]
    steps.clear()
    with pytest.raises(ConvergenceError, match=r"simulation\.step: Newton's iteration did not converge"):
        _ = block(IMPLICIT, "simulation.step=1 us").motion
    steps.clear()
    with pytest.raises(
        ConvergenceError, match=r"\.enrich = 'none' leaves out the fastest modes, which stall it at any"
    ):
        _ = block(IMPLICIT, "simulation.step=1 us", "body.block.modes.enrich=inertia").motion


def test_steps_keep_energy_if_they_lose_a_hundredth_at_most_and_make_half_of_that() -> None:
    """What they make stands beside the swing of the rest's energy, which goes up and down."""
    own, kinetic = block(*NEAR).motion.contacts["floor"], np.array([2.0, 1.0])
    none = own._replace(energy=np.zeros(2), friction_work=np.zeros(2), damping_work=np.zeros(2))
    for made, kept in ((0.009, True), (0.011, False), (-0.019, True), (-0.021, False)):
        assert none._replace(energy_error=np.array([0.0, made])).keeps_energy(kinetic) == kept, made


def test_a_contact_that_half_the_step_no_longer_finds_has_changed() -> None:
    """Relative to what is left of it, nothing, no change could be told."""
    run, no_work = automatic(BLOCK, 5e-3), {"friction_work": np.zeros(2), "damping_work": np.zeros(2)}
    found: list[dict[str, Any]] = []
    for size in (1.0, 0.0):
        own = SimpleNamespace(keeps_energy=lambda _: True, impulse=np.full((2, 3), size), largest=[size], **no_work)
        found.append({"run": SimpleNamespace(energies=np.ones((2, 2)), contacts={"floor": own})})
    assert not steps_settle(run.scene, found)
    assert steps_settle(run.scene, found[:1] * 2)
