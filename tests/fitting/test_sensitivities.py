"""Derivatives of results by numbers of a scene, against closed forms, laws of scale and scenes solved anew."""

import csv
import json
import re
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import fmd as package
from fmd.core import progress
from fmd.core.errors import InputError
from fmd.fitting.frozen_run import Beside, FrozenRun
from fmd.fitting.neighbours import march_in_parts
from fmd.fitting.parameters import change_parameters, find_parameter
from fmd.fitting.sensitivities import Sensitivity, _find_round_off
from fmd.integrators.central_difference import CentralDifference
from tests.contact.test_rigid_contacts import BALL, RADIUS, free
from tests.contact.test_rigid_contacts import scene as touching

MASS, STIFFNESS, START = 2.0, 800.0, 0.01
OSCILLATOR: dict[str, Any] = {
    "title": "Mass on a spring",
    "body": {
        "block": {
            "shape": "rigid",
            "mass": "2 kg",
            "inertia": ["0.1 kg m^2", "0.1 kg m^2", "0.1 kg m^2"],
            "marker": {"hook": {"at": ["0 m", "0 m", "0 m"]}},
        }
    },
    "joint": {
        "slide": {
            "type": "prismatic",
            "parent": "ground",
            "child": "block.hook",
            "axis": [1, 0, 0],
            "spring": "800 N/m",
            "position": "10 mm",
        }
    },
    "simulation": {
        "duration": "0.5 s",
        "output_step": "10 ms",
        "step": "50 us",
        "tip": "block.hook",
        "run": [{"integrator": "central-difference"}],
    },
}
BOUNCE = touching(
    {"ball": BALL},
    {"free": free("ball.centre", [0, 0, RADIUS + 1e-6], [0, 0, -1])},
    {"floor": {"between": ["ground", "ball.skin"], "normal": [0, 0, 1]}},
    3e-4,
)
SIMULATION = {"duration": 1.0, "output_step": 0.1, "step": "auto", "tip": "bar.end", "run": [{"integrator": "auto"}]}
SMALL_ARM = (
    "simulation.run=[{integrator='central-difference'}]",
    "body.forearm.mesh.divisions=[12,1,1]",
    "body.forearm.modes.enrich=none",
    "simulation.duration=0.2 s",
)
BAR = """
title = "Bar"

[body.bar]
shape = "bar"
length = "400 mm"
depth = "20 mm"
width = "20 mm"
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
mesh = { divisions = [10, 2, 2] }
modes = { count = 6 }
marker = { end = { face = "x-" } }
"""


def by_key(found: list[Sensitivity], name: str) -> dict[str, Sensitivity]:
    return {each.parameter.key: each for each in found if each.channel.name == name}


def with_force(value: Any) -> dict[str, Any]:
    slide = OSCILLATOR["joint"]["slide"] | {"position": "0 m"}
    return OSCILLATOR | {
        "joint": {"slide": slide},
        "drive": {"push": {"type": "force", "joint": "slide", "force": value}},
    }


def test_an_oscillator_has_the_derivatives_of_its_closed_form() -> None:
    result = package.load(OSCILLATOR)
    keys = ["joint.slide.spring", "body.block.mass", "joint.slide.position"]
    found = by_key(package.jacobian(result, ["slide.position"], keys), "slide.position")
    omega, t = np.sqrt(STIFFNESS / MASS), result.run.output_times
    by_omega = -START * t * np.sin(omega * t)
    expected = {
        "joint.slide.spring": by_omega * omega / (2.0 * STIFFNESS),
        "body.block.mass": -by_omega * omega / (2.0 * MASS),
        "joint.slide.position": np.cos(omega * t),
    }
    for key, slope in expected.items():
        # Steps of 50 µs are 1e-3 of a radian: the method's own error is some 1e-7 of the phase.
        np.testing.assert_allclose(found[key].slope, slope, atol=1e-5 * np.abs(slope).max())
        assert np.abs(found[key].error).max() < 1e-4 * np.abs(slope).max()
    assert found["joint.slide.position"].relative == pytest.approx(1.0, abs=1e-9)


def test_derivatives_are_those_of_the_steps_after_hundreds_of_oscillations() -> None:
    """Leapfrog's own solution is ``x_n = x_0 cos nθ`` with ``2 sin(θ/2) = ω h``."""
    h, key = 5e-3, "joint.slide.spring"
    times = {"simulation.duration": "50 s", "simulation.output_step": "50 ms", "simulation.step": f"{h} s"}
    result = package.load(OSCILLATOR, *(f"{name}={value}" for name, value in times.items()))
    (found,) = package.jacobian(result, ["slide.position"], [key])
    omega, n = np.sqrt(STIFFNESS / MASS), result.run.output_times / h
    theta = 2.0 * np.arcsin(0.5 * omega * h)
    by_logarithm = -START * n * np.sin(n * theta) * omega * h / (2.0 * np.cos(0.5 * theta))
    size = np.abs(by_logarithm).max()
    assert found.by_tangents
    np.testing.assert_allclose(found.slope * STIFFNESS, by_logarithm, atol=1e-9 * size)


def test_tangents_by_a_mass_and_differences_that_are_drawn_back_are_those_of_the_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A mass is no input of the equations; of an oscillator it counts as the spring does, the other way round."""
    result = package.load(OSCILLATOR, "simulation.duration=5 s", "simulation.step=5 ms")
    mass, spring = package.jacobian(result, ["slide.position"], ["body.block.mass", "joint.slide.spring"])
    monkeypatch.setattr(CentralDifference, "marches_tangents", False)
    (drawn,) = package.jacobian(result, ["slide.position"], ["body.block.mass"])
    assert [each.by_tangents for each in (mass, spring, drawn)] == [True, True, False]
    assert [each.lacking for each in (mass, spring, drawn)] == ["", "", "central-difference"]
    size = np.abs(spring.slope).max() * STIFFNESS
    np.testing.assert_allclose(mass.slope * MASS, -spring.slope * STIFFNESS, atol=1e-9 * size)
    np.testing.assert_allclose(drawn.slope * MASS, -spring.slope * STIFFNESS, atol=1e-7 * size)


@pytest.mark.parametrize(
    ("scene", "method"),
    [
        ("arm", "integrator='central-difference'"),
        ("arm", "integrator='sub-cycling', substeps=3, step='10 us'"),
        (BOUNCE, "integrator='central-difference', step='0.5 us'"),
    ],
    ids=["plain", "sub-cycled", "in contact"],
)
def test_a_march_in_parts_is_that_without_a_break(scene: Any, method: str) -> None:
    run = package.load(scene, f"simulation.run=[{{{method}}}]", *(SMALL_ARM[1:] if scene == "arm" else ())).run
    plan = next(iter(run.plans.values()))
    parts = march_in_parts(plan, run.output_times)
    whole = plan.march(run.output_times)
    assert len(parts.stops) > 100
    for name in ("q", "v", "contacts"):
        np.testing.assert_array_equal(getattr(parts.trajectory, name), getattr(whole, name))


@pytest.mark.parametrize(
    "force",
    [
        "3 N",
        {"formula": "3*sin(20*t)", "unit": "N"},
        {"times": ["0 s", "0.2 s", "0.5 s"], "values": [0.0, 2.0, 0.0], "unit": "N"},
    ],
)
def test_a_load_counts_as_one_number_to_which_a_linear_motion_is_proportional(force: Any) -> None:
    found = package.jacobian(package.load(with_force(force)), ["slide.position"], ["drive.push.force"])
    assert [each.relative for each in found] == [pytest.approx(1.0, abs=1e-9)]


def test_tangents_of_many_numbers_march_together_and_are_those_of_marches_drawn_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Springs, dampers, a load's size and when it ends, and starts, through places, stress and a joint's load."""
    names = ["tip", "forearm.stress", "forearm.wrist.position.y", "elbow.moment.z"]
    push = "drive.swing.torque={times=['0 s','0.03 s','0.045 s','1 s'],values=[0.0,9.0,0.0,0.0],unit='N m'}"
    joints = ["joint.elbow.spring", "joint.elbow.damper", "joint.wrist.spring", "joint.shoulder.angle"]
    keys = [*joints, "drive.swing.torque"]
    result = package.load("arm", *SMALL_ARM, "simulation.duration=0.04 s", push)
    by_tangents = package.jacobian(result, names, keys)
    frozen = FrozenRun(result.run)
    motion = frozen.at({}, by=[find_parameter(result.run.scene, key) for key in keys])
    for parameter in motion.by:
        frozen.beside(motion, parameter)
    assert frozen.marches == 2  # the motion, and five tangents at once
    monkeypatch.setattr(CentralDifference, "marches_tangents", False)
    by_differences = package.jacobian(result, names, keys)
    for mine, other in zip(by_tangents, by_differences, strict=True):
        assert mine.by_tangents
        assert not other.by_tangents
        # Differences at two parts in ten thousand leave some 1e-8 of the largest change by any of the numbers.
        np.testing.assert_allclose(mine.slope, other.slope, rtol=0, atol=1e-6 * np.abs(other.slope).max())


def test_results_of_the_arm_have_the_derivatives_of_scenes_solved_anew() -> None:
    """Numbers that pass through the mesh, the basis, the mechanism and the load, set in the scene's own words."""
    names = ["tip", "forearm.stress", "forearm.wrist.position.y", "elbow.moment.z"]
    numbers = {
        "body.forearm.depth": (0.012, "m"),
        "body.gripper.mass": (0.4, "kg"),
        "joint.elbow.spring": (60.0, "N m"),
        "body.forearm.modes.damping": (0.002, ""),
    }
    result = package.load("arm", *SMALL_ARM)
    found = package.jacobian(result, names, list(numbers))
    assert not any(each.jumps for each in found)
    for key, (value, unit) in numbers.items():
        sides = [package.load("arm", *SMALL_ARM, f"{key}={value * (1 + s)!r} {unit}".strip()) for s in (-0.01, 0.01)]
        for each in found:
            if each.parameter.key != key:
                continue
            low, high = (np.asarray(each.channel.read(side.run)) for side in sides)
            slope = (high - low) / (0.02 * value)
            np.testing.assert_allclose(each.slope, slope, rtol=0, atol=3e-3 * np.abs(slope).max())


def test_frequencies_go_with_the_root_of_stiffness_and_density_and_inversely_with_size(tmp_path: Path) -> None:
    path = tmp_path / "bar.toml"
    path.write_text(BAR.replace('width = "20 mm"', 'width = "30 mm"'))
    sizes = ["body.bar.length", "body.bar.depth", "body.bar.width"]
    names = [f"bar.frequency.{number}" for number in (1, 2, 5)]
    every = package.jacobian(package.load(path), names, ["body.bar.E", "body.bar.rho", *sizes])
    for name in names:
        found = by_key(every, name)
        assert found["body.bar.E"].relative == pytest.approx(0.5, abs=1e-6)
        assert found["body.bar.rho"].relative == pytest.approx(-0.5, abs=1e-9)
        assert sum(found[key].relative for key in sizes) == pytest.approx(-1.0, abs=1e-6)
        assert all(each.relative_error < 1e-6 for each in found.values())


def test_round_off_of_modes_that_are_solved_anew_is_in_the_stated_error() -> None:
    """Squares of frequencies have 1 by the modulus, shapes 0; both get a round-off of their own, shapes other signs."""
    rng, true, stated = np.random.default_rng(0), [], []
    first = rng.normal(size=(20, 3, 6))

    def solve(scale: float) -> Any:
        omega = np.sqrt(np.arange(1.0, 7.0) * scale * (1.0 + 1e-10 * rng.normal(size=6)))
        shapes = (first + 1e-10 * rng.normal(size=first.shape)) * rng.choice([-1.0, 1.0], 6)
        part = SimpleNamespace(key=lambda _: scale)
        return SimpleNamespace(parts={"bar": part}, bodies={"bar": SimpleNamespace(omega=omega, shapes=shapes)})

    for _ in range(20):
        pairs = [Beside(solve(1.0 - step), solve(1.0 + step), step) for step in (2e-3, 1e-3)]
        rough, fine = (
            (each.high.bodies["bar"].omega ** 2 - each.low.bodies["bar"].omega ** 2) / (2.0 * each.step)
            for each in pairs
        )
        true.append(np.abs((4.0 * fine - rough) / 3.0 / np.arange(1.0, 7.0) - 1.0).max())
        stated.append(_find_round_off(solve(1.0), pairs, 2e-3))
    assert np.mean(true) < np.mean(stated) < 5.0 * np.mean(true)


def test_frequencies_of_a_body_that_its_joint_holds_have_derivatives_by_dimensions() -> None:
    """Against frequencies solved anew: the joint's forces on the modes change with the body's section."""
    bar = BAR_TABLES["body"]["bar"] | {"depth": 0.04, "modes": {"count": 3, "boundary": "joint"}}
    hub = {"type": "revolute", "parent": "ground", "child": "bar.end", "axis": [-1, 2, 1]}
    tables = {"title": "Bar", "body": {"bar": bar}, "joint": {"hub": hub}, "simulation": SIMULATION}

    def solve(depth: float) -> Any:
        return package.load(tables, "body.bar.mesh.divisions=[8, 2, 2]", f"body.bar.depth={depth!r} m")

    result, names = solve(0.04), [f"bar.frequency.{k}" for k in (1, 2, 3)]
    found = package.jacobian(result, names, ["body.bar.depth"])
    far, near = (
        (solve(0.04 + h).run.modes.frequencies_hz - solve(0.04 - h).run.modes.frequencies_hz) / (2.0 * h)
        for h in (8e-4, 4e-4)
    )
    exact = 1e-5 * result.run.modes.frequencies_hz / 0.04
    assert (np.abs([each.slope for each in found] - (4.0 * near - far) / 3.0) < exact).all()
    assert (np.array([each.error for each in found]) < exact).all()


def test_modes_of_one_frequency_turn_into_those_that_part(tmp_path: Path) -> None:
    """Of a square bar's pair one bends over the depth and one over the width; both lose with length alike."""
    path = tmp_path / "bar.toml"
    path.write_text(BAR)
    names = ["bar.frequency.1", "bar.frequency.2"]
    found = package.jacobian(package.load(path), names, ["body.bar.depth", "body.bar.width", "body.bar.length"])
    lower, upper = (by_key(found, name) for name in names)
    stays, grows = lower["body.bar.depth"].relative, upper["body.bar.depth"].relative
    assert stays == pytest.approx(lower["body.bar.width"].relative, abs=1e-5)
    assert grows == pytest.approx(upper["body.bar.width"].relative, abs=1e-5)
    assert abs(stays) < 0.01  # a Bernoulli bar's are 0 and 1
    assert 0.95 < grows < 1.0
    assert stays + grows + lower["body.bar.length"].relative == pytest.approx(-1.0, abs=1e-5)
    path.write_text(BAR.replace('depth = "20 mm"', 'depth = "20.02 mm"'))
    parted = package.load(path).run.modes.frequencies_hz[:2]
    together = package.load(BAR_TABLES).run.modes.frequencies_hz[:2]
    np.testing.assert_allclose((parted / together - 1.0) / 1e-3, [stays, grows], atol=2e-3)


def test_a_number_is_changed_where_it_stands_and_nowhere_else() -> None:
    scene = package.load_scene("arm")
    mass, angle = (find_parameter(scene, key) for key in ("body.gripper.mass", "joint.shoulder.angle"))
    assert (mass.value, mass.unit, angle.unit) == (0.4, "kg", "rad")
    assert find_parameter(scene, "simulation.gravity.1").unit == "m/s^2"
    changed = change_parameters(scene, {mass: 0.5})
    expected = package.load_scene("arm", ["body.gripper.mass=0.5 kg"])
    assert changed.model_dump(mode="json") == expected.model_dump(mode="json")
    assert scene.body["gripper"].mass == 0.4


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("joint.elbow.sprung", "did you mean 'spring'"),
        ("joint.elbow", "the numbers there: angle"),
        ("simulation.step", "no number that results change with smoothly"),
        ("joint.elbow.rest", "is 0, of which there is no per cent"),
        ("body.forearm.mesh.divisions.0", "no number that results change with smoothly"),
        ("joint.elbow.axis.7", "there is no '7' in joint.elbow.axis"),
    ],
)
def test_a_key_that_is_no_number_is_refused(key: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        find_parameter(package.load_scene("arm"), key)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("slide.positoin", "did you mean 'slide.position'"),
        ("tip", "doesn't deflect"),
        ("stress", "no such result"),
        ("block.hook.position.k", "did you mean 'block.hook.position'"),
    ],
)
def test_a_result_that_there_is_not_is_refused(name: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        package.jacobian(package.load(OSCILLATOR), [name], ["body.block.mass"])


def test_derivatives_say_how_far_they_are(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    advance = progress._Task.advance

    def advance_slowly(task: Any, done: float) -> None:  # a line comes every millisecond
        advance(task, done)
        time.sleep(0.02)

    monkeypatch.setattr(progress, "SAY_AFTER_SECONDS", 1e-3)
    monkeypatch.setattr(progress._Task, "advance", advance_slowly)
    result = package.load(OSCILLATOR)
    result.run.motion  # noqa: B018
    capsys.readouterr()
    package.jacobian(result, ["slide.position"], ["joint.slide.spring", "body.block.mass"])
    assert re.search(r"s: derivatives, 50 %, about \d+ s left\n", capsys.readouterr().err)
    package.ResultFunction(result, ["slide.position"], ["joint.slide.spring"]).jacobian(np.array([900.0]))
    assert "s: derivatives" in capsys.readouterr().err  # with its share, if the first comes before the first line


def test_the_command_prints_rows_and_writes_table_chart_and_histories(
    fmd: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    given = ["--of", "tip,forearm.wrist.position", "--to", "joint.elbow.spring,body.gripper.mass", "--out", tmp_path]
    settings = [word for text in SMALL_ARM for word in ("--set", text)]
    assert fmd("sensitivities", "arm", *given, *settings, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["files"] == ["sensitivities.csv", "sensitivity-histories.csv", "sensitivities.png"]
    # The arm moves in a plane: z is round-off.
    assert [row["of"] for row in found["rows"][::2]] == ["tip", "forearm.wrist.position.x", "forearm.wrist.position.y"]
    for row in found["rows"]:
        low, high = row["interval"]
        assert low <= row["relative"] <= high
    with (tmp_path / "sensitivity-histories.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header[3] == "d forearm.wrist.position.x / d ln joint.elbow.spring [m]"
    assert len(rows) == 101
    assert fmd("sensitivities", "arm", *given, *settings) == 0
    text = capsys.readouterr().out
    assert "of histories: ratios of root mean squares" in text
    assert "by tangents of the motion: joint.elbow.spring, body.gripper.mass" in text
    assert fmd("sensitivities", "arm", "--of", "tip,", "--to", "joint.elbow.spring") == 2
    assert "has an empty name" in capsys.readouterr().err


BAR_TABLES = {
    "title": "Bar",
    "body": {
        "bar": {
            "shape": "bar",
            "length": 0.4,
            "depth": 0.02,
            "width": 0.02,
            "E": 210e9,
            "nu": 0.3,
            "rho": 7850.0,
            "mesh": {"divisions": [10, 2, 2]},
            "modes": {"count": 6},
            "marker": {"end": {"face": "x-"}},
        }
    },
}
