"""From a scene's drives, attachments and splits to the mechanism: what each key does, and what is refused."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from fmd import Pipeline, load_scene
from fmd.cli.app import main
from fmd.core.errors import InputError
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.integrators.subcycling import Subcycling
from fmd.recovery.motion import Motion
from fmd.scene.scene import Scene
from fmd.scene.state_loads import TorqueOverTime
from fmd.stages.mechanism import build_mechanism
from fmd.stages.signals import signal_of
from tests.dynamics.drives import Drives

# A crank on a hinge with a slider on it: rigid, so quick.
CRANK = """
title = "Crank and slider"

[body.crank]
shape = "rod"
mass = "3 kg"
length = "2 m"
marker = { hub = { at = ["0 m", "0 m", "0 m"] }, end = { at = ["2 m", "0 m", "0 m"] } }

[body.slider]
shape = "point"
mass = "2 kg"
marker = { centre = { at = ["0 m", "0 m", "0 m"] } }

[joint.hub]
type = "revolute"
parent = "ground"
child = "crank.hub"
axis = [0, 0, 1]

[joint.slide]
type = "prismatic"
parent = "crank.end"
child = "slider.centre"
axis = [1, 0, 0]
spring = "50 N/m"

[simulation]
duration = "1 s"
output_step = "20 ms"
tip = "slider.centre"

[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-10
"""
WELDED = CRANK.replace('type = "prismatic"', 'type = "fixed"').replace('axis = [1, 0, 0]\nspring = "50 N/m"\n', "")
TURN = '\n[drive.turn]\ntype = "motion"\njoint = "hub"\nangle = { formula = "sin(3*t)", unit = "rad" }\n'
PUSH = '\n[drive.push]\ntype = "force"\njoint = "slide"\nforce = { formula = "t", unit = "kN" }\n'
TWIST = '\n[drive.twist]\ntype = "torque"\njoint = "hub"\ntorque = "1 N m"\n'
PULSE = '\n[drive.pulse]\ntype = "torque pulse"\njoint = "hub"\ntorque = "1 N m"\nduration = "0.1 s"\n'
SLIDE_BY_TABLE = (
    '\n[drive.move]\ntype = "motion"\njoint = "slide"\n'
    'position = { times = ["0 s", "400 ms", "1 s"], values = [0, 30, -10], unit = "cm" }\n'
)
BEAM = ("body.beam.mesh.divisions=[12, 1, 1]", "simulation.duration=20 ms", "simulation.output_step=1 ms")
CLOSELY = 'simulation.run=[{ integrator = "runge-kutta", tolerance = 1e-12 }]'


def scene_of(folder: Path, text: str, *overrides: str) -> Scene:
    file = folder / "mine.toml"
    file.write_text(text)
    return load_scene(file, overrides)


def motion_of(scene: Scene) -> Motion:
    return Pipeline(scene).motion


def twisted(given: str) -> str:
    """A torque on the crank, as it would stand in the scene."""
    return TWIST.replace('"1 N m"', given)


def blow(marker: str, direction: str) -> str:
    return f'\n[drive.blow]\ntype = "point force"\nmarker = "{marker}"\nforce = "1 N"\ndirection = {direction}\n'


# What is refused -------------------------------------------------------------------------------------------------

# Drives, overrides, the key that the message names, and a part of what it says.
Refused = tuple[str, tuple[str, ...], str, str]
PRESCRIBED = "has no effect: 'turn' prescribes the joint's motion"
MECHANISMS: dict[str, Refused] = {
    "a spring under a motion": (TURN, ("joint.hub.spring=1 N m",), "joint.hub.spring", PRESCRIBED),
    "a damper under a motion": (TURN, ("joint.hub.damper=1 N m s",), "joint.hub.damper", PRESCRIBED),
    "a start under a motion": (TURN, ("joint.hub.angle=1 deg",), "joint.hub.angle", PRESCRIBED),
    "a rate under a motion": (TURN, ("joint.hub.rate=1 rad/s",), "joint.hub.rate", PRESCRIBED),
    "a fast joint under a motion": (TURN, ("simulation.fast=['hub']",), "simulation.fast.0", "has no coordinate"),
    "a torque beside a motion": (TURN + TWIST, (), "drive.twist.joint", PRESCRIBED),
    "a pulse beside a motion": (TURN + PULSE, (), "drive.pulse.joint", PRESCRIBED),
    "two motions": (TURN + TURN.replace("turn", "again"), (), "drive.again.joint", PRESCRIBED),
    "no motion": (re.sub("angle.*", "", TURN), (), "drive.turn.angle", "a revolute joint moves by its angle"),
    "a slide's angle": (
        TURN.replace('"hub"', '"slide"'), (), "drive.turn.angle", "this one moves by its position",
    ),
    "no position": (
        re.sub("angle.*", "", TURN).replace('"hub"', '"slide"'), ("joint.slide.spring=0 N/m",),
        "drive.turn.position", "a prismatic joint moves by its position",
    ),
    "both": (TURN + 'position = "1 m"\n', (), "drive.turn.position", "this one moves by its angle"),
    "a motion whose rate jumps": (
        SLIDE_BY_TABLE.replace('"cm"', '"cm", between = "straight"'), ("joint.slide.spring=0 N/m",),
        "drive.move.position.between", "would let the motion's rate jump",
    ),
    "no such joint": (TURN.replace('"hub"', '"hob"'), (), "drive.turn.joint", "did you mean 'hub'?"),
    "a torque on a slide": (TWIST.replace('"hub"', '"slide"'), (), "drive.twist.joint", "needs a revolute or screw"),
    "a force on a hinge": (PUSH.replace('"slide"', '"hub"'), (), "drive.push.joint", "needs a prismatic one"),
    "no such marker": (blow("crank.tip", "[1, 0, 0]"), (), "drive.blow.marker", "no such marker"),
    "no direction": (blow("crank.end", "[0, 0, 0]"), (), "drive.blow.direction", "has no direction"),
    "hardly a direction": (blow("crank.end", "[0, 0, 1e-300]"), (), "drive.blow.direction", "has no direction"),
    "weight without a unit": ("", ("simulation.gravity=[0, 0, -9.81]",), "simulation.gravity.0", "m/s"),
    "a split without its ratio": (
        "", ("simulation.run=[{ integrator = 'sub-cycling', substeps = 'auto' }]",),
        "simulation.run.0.substeps", "give both 'auto' or none",
    ),
}  # fmt: skip
TABLE = '{{ times = {}, values = {}, unit = "N m" }}'
# What the torque is, the key below it, and a part of what is said.
TORQUES: dict[str, tuple[str, str, str]] = {
    "an unknown name": ('{ formula = "2*x", unit = "N m" }', ".formula", "at column 3: there is no 'x'"),
    "a caret": ('{ formula = "t^2", unit = "N m" }', ".formula", "at column 2"),
    "half a formula": ('{ formula = "sin(", unit = "N m" }', ".formula", "at column"),
    "no finite value": ('{ formula = "1/0", unit = "N m" }', ".formula", "no finite value"),
    "code": ('{ formula = "open(t).read()", unit = "N m" }', ".formula", "at column"),
    "no unit": ('{ formula = "t" }', ".unit", "is missing"),
    "a unit of another quantity": ('{ formula = "t", unit = "N" }', ".unit", "'N m' works"),
    "no unit at all": ('{ formula = "t", unit = "wibble" }', ".unit", "'N m' works"),
    "another quantity": ('"1 kg"', "", "N m"),
    "formula and table": (
        '{ formula = "t", times = ["0 s", "1 s"], values = [0, 1], unit = "N m" }', ".formula", "one of the two",
    ),
    "neither": ('{ unit = "N m" }', ".formula", "is missing"),
    "an unknown key": ('{ formla = "t", unit = "N m" }', ".formla", "did you mean 'formula'?"),
    "a constant's own key": ("{ constant = 1 }", ".constant", "no such key"),
    "times that turn back": (TABLE.format('["0 s", "2 s", "1 s"]', "[0, 1, 2]"), ".times.2", "the time before it"),
    "a time twice": (TABLE.format('["0 s", "0 s"]', "[0, 1]"), ".times.1", "the time before it"),
    "a value too few": (TABLE.format('["0 s", "1 s"]', "[0]"), ".values", "must hold 2 values"),
    "one time": (TABLE.format('["0 s"]', "[0]"), ".times", "at least 2"),
    "a time in metres": (TABLE.format('["0 m", "1 m"]', "[0, 1]"), ".times.0", "is a length, a time is wanted"),
    "an endless value": (TABLE.format('["0 s", "1 s"]', "[0, inf]"), ".values.1", "finite"),
    "a value with a unit": (TABLE.format('["0 s", "1 s"]', '[0, "1 N m"]'), ".values.1", "number"),
    "values beside a formula": ('{ formula = "t", values = [0, 1], unit = "N m" }', ".values", "belongs to a table"),
    "a curve of a formula": (
        '{ formula = "t", between = "smooth", unit = "N m" }', ".between", "belongs to a table",
    ),
    "another curve": (
        '{ times = ["0 s", "1 s"], values = [0, 1], between = "wavy", unit = "N m" }', ".between", "'smooth'",
    ),
}  # fmt: skip
REFUSED = MECHANISMS | {
    name: (twisted(given), (), f"drive.twist.torque{key}", said) for name, (given, key, said) in TORQUES.items()
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_can_not_be_is_refused_by_its_key(tmp_path: Path, name: str) -> None:
    drives, overrides, key, said = REFUSED[name]
    scene_of(tmp_path, CRANK)  # all the rest is right
    with pytest.raises(InputError) as caught:
        scene_of(tmp_path, CRANK + drives, *overrides)
    assert caught.value.key == key
    assert said in str(caught.value)
    assert {error.key.rpartition(".")[0] for error in caught.value.others} <= {key.rpartition(".")[0]}  # of its list


@pytest.mark.parametrize(
    "name", ["two motions", "a caret", "times that turn back", "no unit at all", "a spring under a motion"]
)
def test_the_command_line_ends_with_status_2(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    drives, overrides, key, said = REFUSED[name]
    file = tmp_path / "mine.toml"
    file.write_text(CRANK + drives)
    sets = [part for text in overrides for part in ("--set", text)]
    with pytest.raises(SystemExit) as stop:
        main(["run", str(file), *sets, "--out", str(tmp_path / "out")])
    assert stop.value.code == 2
    message = capsys.readouterr().err
    assert key in message
    assert said in message
    assert not (tmp_path / "out").exists()


def test_a_formula_that_stops_being_a_number_is_wrong_input_with_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(CRANK + twisted('{ formula = "sqrt(0.5 - t)", unit = "N m" }'))
    with pytest.raises(SystemExit) as stop:
        main(["run", str(file), "--out", str(tmp_path / "out"), "--no-pictures"])
    assert stop.value.code == 2
    assert "drive.twist.torque = 'sqrt(0.5 - t)': has no real value" in capsys.readouterr().err


# Drives ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "by_hand"),
    [
        ('"3 kN mm"', lambda t: 3.0),
        ('{ formula = "2*t - 1", unit = "kN m" }', lambda t: 1000 * (2 * t - 1)),
        (
            '{ times = ["0 s", "500 ms"], values = [1, 3], unit = "kN m", beyond = "hold" }',
            lambda t: 1000 * min(1 + 4 * t, 3),
        ),
        (
            '{ times = ["0 s", "0.5 s", "2 s"], values = [1, 3, 0], unit = "N m", between = "smooth" }',
            CubicSpline([0, 0.5, 2], [1, 3, 0], bc_type="clamped"),
        ),
    ],
    ids=["constant", "formula", "table", "smooth table"],
)
def test_a_torque_over_time_comes_in_si_units(tmp_path: Path, given: str, by_hand: Any) -> None:
    drive = scene_of(tmp_path, CRANK + twisted(given)).drive["twist"]
    assert drive.type == "torque"
    assert isinstance(drive.torque, TorqueOverTime)
    signal = signal_of(drive.torque)
    for t in (0.0, 0.2, 0.7, 1.1):
        assert signal.value(t)[0] == pytest.approx(float(by_hand(t)), rel=1e-12)


@pytest.mark.parametrize(
    ("values", "beyond"),
    [([0, 2, 2, 0], "repeat"), ([0, 2, 2, 1], "repeat"), ([1, 2, 2, 1], "zero"), ([0, 2, 2, 1], "hold")],
)
def test_a_table_goes_on_beyond_its_ends_as_it_says(tmp_path: Path, values: list[float], beyond: str) -> None:
    # The rate of the crank and its welded slider is ∫ τ dt / J, here summed over NumPy's interpolation of the table.
    times, J = np.array([0.0, 0.06, 0.1, 0.13]), 3 * 2**2 / 3 + 2 * 2**2
    table = f"times = {[f'{t} s' for t in times]}, values = {values}, unit = 'N m', beyond = '{beyond}'"
    motion = motion_of(scene_of(tmp_path, WELDED + twisted(f"{{ {table} }}")))
    fine = np.linspace(0.0, motion.times[-1], 1_000_001)
    at = np.mod(fine, times[-1]) if beyond == "repeat" else fine
    torque = np.interp(at, times, values) * (1.0 if beyond != "zero" else fine <= times[-1])
    rate = cumulative_trapezoid(torque, fine, initial=0.0) / J
    assert motion.joint_rate("hub") == pytest.approx(np.interp(motion.times, fine, rate), abs=2e-6)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (
            'times = ["0 s", "40 ms"], values = [1, 1]',
            "the table covers 0 … 0.04 s of the simulation's 1 s; say 'hold'",
        ),
        ('times = ["40 ms", "2 s"], values = [1, 1]', "the table covers 0.04 … 2 s of"),
        ('times = ["0 s", "1 us"], values = [1, 1], beyond = "repeat"', "takes 2000000 rows; 200000 are the most"),
        ('times = ["0 s", "1 ms"], values = [1, 2], between = "smooth", beyond = "repeat"', "ends as it begins"),
        ('formula = "t", beyond = "hold"', "belongs to a table of times"),
        ('times = ["0 s", "2 s"], values = [1, 1], beyond = "stop"', "'hold', 'zero' or 'repeat'"),
    ],
)
def test_a_table_that_ends_too_soon_or_can_not_go_on_is_refused(tmp_path: Path, table: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        scene_of(tmp_path, WELDED + twisted(f"{{ {table}, unit = 'N m' }}"))
    assert caught.value.key == "drive.twist.torque.beyond"
    assert said in str(caught.value)


def test_a_prescribed_motion_never_jumps_beyond_its_table(tmp_path: Path) -> None:
    for beyond, said in (
        ("zero", "would let the motion jump to 0"),
        ("repeat", "needs a curve that ends as it begins"),
    ):
        with pytest.raises(InputError, match=said):
            scene_of(
                tmp_path,
                CRANK + SLIDE_BY_TABLE.replace('"cm"', f'"cm", beyond = "{beyond}"'),
                "joint.slide.spring=0 N/m",
            )


def test_drives_on_one_joint_add_up(tmp_path: Path) -> None:
    # ½ τ t² / J and the pulse's impulse, 2/π τ T / J, on the crank and the slider, which is held at the crank's end.
    motion = motion_of(scene_of(tmp_path, WELDED + TWIST + TWIST.replace("twist", "more") + PULSE))
    J = 3 * 2**2 / 3 + 2 * 2**2
    late = motion.times > 0.1
    want = (2 * motion.times + 2 / np.pi * 0.1) / J
    assert motion.joint_rate("hub")[late] == pytest.approx(want[late], rel=1e-9)


@pytest.mark.parametrize("smooth", ["", "smooth = true\n"])
def test_a_pulse_that_is_given_by_a_speed_is_sized_for_the_body_on_its_joint(tmp_path: Path, smooth: str) -> None:
    # It would bring the crank alone, 4 kg m², to 6 rad/s; with the slider on it there are 12 kg m².
    pulse = PULSE.replace('torque = "1 N m"', 'speed = "6 rad/s"')
    motion = motion_of(scene_of(tmp_path, WELDED + pulse + smooth))
    assert motion.joint_rate("hub")[motion.times > 0.1] == pytest.approx(np.full(45, 6 * 4 / 12), rel=1e-9)


def test_a_prescribed_table_moves_its_joint_along_the_smooth_curve(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, CRANK.replace('spring = "50 N/m"\n', "") + TWIST + SLIDE_BY_TABLE)
    mechanism = build_mechanism(scene, {})
    motion = mechanism.links[1].motion
    assert motion is not None
    curve = CubicSpline([0.0, 0.4, 1.0], [0.0, 0.3, -0.1], bc_type="clamped")
    for t in np.linspace(0.01, 0.99, 9):
        assert motion.value(t) == pytest.approx([float(curve(t, k)) for k in range(3)], rel=1e-12, abs=1e-12)
    # The angular momentum about the hub is τ t, with (4 + 2 r²) kg m² at the slider's distance r = 2 m + x.
    moved = motion_of(scene)
    x = moved.joint_position("slide")
    assert x == pytest.approx(curve(moved.times), abs=1e-12)
    assert (4 + 2 * (2 + x) ** 2) * moved.joint_rate("hub") == pytest.approx(moved.times, abs=1e-8)
    # What pushes the slider: m (ẍ − r θ̇²).
    for k in (10, 35):
        load = Drives(mechanism).loads(moved.times[k], moved.trajectory.q[k], moved.trajectory.v[k])
        want = 2 * (curve(moved.times[k], 2) - (2 + x[k]) * moved.joint_rate("hub")[k] ** 2)
        assert load == pytest.approx({"slider": want}, rel=1e-9)


def test_a_turned_crank_slings_its_slider_out(tmp_path: Path) -> None:
    # ẍ = (2 m + x) Ω² − k/m x for θ = Ω t, with Ω² < k/m: x swings about 2 m Ω²/(k/m − Ω²).
    text = CRANK + TURN.replace("sin(3*t)", "3*t")
    motion = motion_of(scene_of(tmp_path, text))
    stiff, middle = 50 / 2 - 9, 9 * 2 / (50 / 2 - 9)
    assert motion.joint_position("slide") == pytest.approx(
        middle * (1 - np.cos(np.sqrt(stiff) * motion.times)), abs=1e-8
    )
    assert motion.joint_position("hub") == pytest.approx(3 * motion.times, abs=1e-14)


def test_point_loads_act_where_and_as_they_say(tmp_path: Path) -> None:
    # Force F across the crank's end, following it: torque 2 m F; and 1 N m about z: α = (2 F + 1)/J.
    loads = (
        '\n[drive.blow]\ntype = "point force"\nmarker = "crank.end"\n'
        'force = "3 N"\ndirection = [0, 2, 0]\nfollowing = true\n'
        '\n[drive.turn]\ntype = "point torque"\nmarker = "slider.centre"\ntorque = "1 N m"\ndirection = [0, 0, 1]\n'
    )
    motion = motion_of(scene_of(tmp_path, WELDED + loads))
    assert motion.joint_rate("hub") == pytest.approx(7 / 12 * motion.times, abs=1e-9)
    # Fixed in space it stops at 90°: the work is F times the way along y.
    fixed = motion_of(scene_of(tmp_path, WELDED + loads.replace("true", "false")))
    theta = fixed.joint_position("hub")
    gained = 0.5 * 12 * fixed.joint_rate("hub") ** 2
    assert gained == pytest.approx(3 * 2 * np.sin(theta) + theta, abs=1e-8)


def test_weight_acts_on_every_body(tmp_path: Path) -> None:
    weight = 'simulation.gravity=["0 m/s^2", "-10 m/s^2", "0 m/s^2"]'
    motion = motion_of(scene_of(tmp_path, CRANK, weight))
    kinetic, potential = motion.energies
    # Rod: J = 4 kg m², its weight at 1 m; slider of 2 kg at r = 2 m + x.
    theta, x = motion.joint_position("hub"), motion.joint_position("slide")
    height = 3 * 1 * np.sin(theta) + 2 * (2 + x) * np.sin(theta)
    assert potential == pytest.approx(10 * height + 0.5 * 50 * x**2, abs=1e-9)
    assert kinetic + potential == pytest.approx(np.zeros(motion.times.size), abs=1e-7)
    assert kinetic.max() > 10


# Flexible bodies -------------------------------------------------------------------------------------------------


def quick_beam(*overrides: str) -> Pipeline:
    return Pipeline(load_scene("beam-paper", [*BEAM, CLOSELY, *overrides]))


@pytest.mark.parametrize(
    "extra",
    [
        "body.beam.modes.damping=1e-15",
        'drive.more={ type = "torque", joint = "hub", torque = "0 N m" }',
        'drive.more={ type = "point force", marker = "beam.tip", direction = [0, 1, 0], force = "0 N" }',
    ],
    ids=["damping", "torque", "point force"],
)
@pytest.mark.parametrize("stiffening", ["off", "on"])
def test_drives_and_dampers_next_to_nothing_change_next_to_nothing(extra: str, stiffening: str) -> None:
    plain, driven = (quick_beam(f"simulation.stiffening={stiffening}", *more) for more in ((), (extra,)))
    one, other = plain.motion, driven.motion
    q = one.trajectory.q
    assert other.modal("beam") == pytest.approx(q[:, 1:], abs=1e-10 * np.abs(q[:, 1:]).max())
    assert other.trajectory.q[:, 0] == pytest.approx(q[:, 0], abs=1e-10)
    assert other.trajectory.v == pytest.approx(one.trajectory.v, abs=1e-10 * np.abs(one.trajectory.v).max())
    assert other.tip_deflection == pytest.approx(one.tip_deflection, abs=1e-10)
    assert np.abs(q[-1, 0]) > 1e-3


def test_modal_damping_takes_out_what_its_ratio_says() -> None:
    # Welded, a small modal velocity decays as exp(−ζ ω t) in every mode, with frequency ω √(1 − ζ²).
    zeta = 0.03
    weld = 'joint.hub={ type = "fixed", parent = "ground", child = "beam.root" }'
    run = quick_beam("drive={}", weld, f"body.beam.modes.damping={zeta}", 'body.beam.modes.boundary="joint"')
    system, t = run.system, np.linspace(0.0, 0.02, 21)
    omega = run.body.omega
    march = ScipyIvp("DOP853", 1e-11).march(system, np.zeros(system.n), np.ones(system.n), t)
    swing = omega * np.sqrt(1 - zeta**2)
    want = np.exp(-zeta * np.outer(t, omega)) * np.sin(np.outer(t, swing)) / swing
    assert march.q == pytest.approx(want, abs=1e-8 / omega[0])


def test_a_rigid_attachment_holds_its_face_plane() -> None:
    # Every node of a rigid face moves as the marker's translation and rotation say; of an averaged one, it doesn't.
    lack = []
    for attachment in ("averaged", "rigid"):
        run = quick_beam(f"body.beam.marker.tip={{ face = 'x+', attachment = '{attachment}' }}")
        body = run.body
        tip = body.markers["tip"]
        arms = body.x - tip.position
        face = np.abs(arms[:, 0]) < 1e-9
        rigid = tip.translation + np.cross(tip.rotation.T[None], arms[face][:, None, :]).transpose(0, 2, 1)
        lack.append(np.abs(body.shapes[face] - rigid).max() / np.abs(body.shapes[face]).max())
    assert lack[1] < 1e-9
    assert lack[0] > 1e-6
    with pytest.raises(InputError, match="attachment"):
        quick_beam("body.beam.marker.tip={ face = 'x+', attachment = 'glued' }")


# Splits ----------------------------------------------------------------------------------------------------------


def sub_cycled(settings: str, *overrides: str) -> Any:
    run = quick_beam(f'simulation.run=[{{ integrator = "sub-cycling", {settings} }}]', *overrides)
    (plan,) = run.plans.values()
    return run, plan


def test_a_split_by_frequency_takes_what_is_below_slowly() -> None:
    # Pinned at the joint, the beam's modes are at about 206, 444, 766, 1144 and 1560 Hz; the hinge alone has 0.
    run, plan = sub_cycled('substeps = 3, split = "500 Hz"')
    slow = run.body.frequencies_hz < 500
    assert 0 < slow.sum() < len(slow)
    tree = plan.mechanism
    assert tree.n_slow == 1 + slow.sum()
    assert list(tree.slow_modes.values()) == [slow.sum()]
    assert not tree.fast_joints
    assert plan.integrator == Subcycling(run.scene.simulation.step, 3)


def test_a_split_below_everything_has_nothing_slow() -> None:
    _, plan = sub_cycled('substeps = 1, split = "1e-3 Hz"', "joint.hub.spring=10 N m")
    assert plan.mechanism.n_slow == 0
    assert list(plan.mechanism.fast_joints) == ["beam"]


@pytest.mark.parametrize("split", ['"500 Hz"', '"auto"'])
def test_any_split_comes_to_the_motion_of_the_whole(split: str) -> None:
    substeps = '"auto"' if "auto" in split else "2"
    run, plan = sub_cycled(f"substeps = {substeps}, split = {split}", "simulation.step=2 us")
    want = quick_beam().motion
    found = run.motion
    q = want.trajectory.q
    error = np.abs(found.modal("beam") - q[:, 1:]).max() / np.abs(q[:, 1:]).max()
    assert error < (run.scene.simulation.error if "auto" in split else 5e-3)
    assert found.joint_position("hub")[-1] == pytest.approx(q[-1, 0] + q[-1, 1:] @ run.body.joint_rotation, rel=1e-3)
    assert f"sub-cycling {plan.integrator.substeps}:1" in run.motions


def test_an_automatic_split_keeps_a_step_that_is_given() -> None:
    _, plan = sub_cycled('substeps = "auto", split = "auto", step = "5 us"')
    assert plan.integrator.step == 5e-6
    assert plan.integrator.step < plan.integrator.largest_step(plan.system)
    assert plan.key == "simulation.run.0.step"
