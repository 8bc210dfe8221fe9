"""Mechanisms at rest under the loads of the start, against statics."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fmd.core.errors import AccuracyError, InputError
from fmd.scene.scene import load_scene
from fmd.stages import equilibrium
from fmd.stages.pipeline import Pipeline

PENDULUM = """
title = "Pendulum with a spring"

[body.rod]
shape = "rod"
mass = "2 kg"
length = "1 m"
marker = { hinge = { at = ["0 m", "0 m", "0 m"] }, end = { at = ["1 m", "0 m", "0 m"] } }

[joint.hinge]
type = "revolute"
parent = "ground"
child = "rod.hinge"
axis = [0, 0, 1]
angle = "80 deg"

[simulation]
duration = "1 s"
output_step = "0.1 s"
tip = "rod.end"
start = "equilibrium"
gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]

[[simulation.run]]
integrator = "runge-kutta"
"""
BEAM = """
title = "Cantilever"

[body.beam]
shape = "bar"
length = "1 m"
depth = "20 mm"
width = "20 mm"
E = "200 GPa"
nu = 0.3
rho = "7800 kg/m^3"
mesh = { element = "hexahedron", divisions = [20, 1, 1], order = 2 }
modes = { count = 8, boundary = "joint", enrich = "ritz" }
marker = { root = { face = "x-" }, tip = { face = "x+" } }

[joint.root]
type = "fixed"
parent = "ground"
child = "beam.root"

[drive.pull]
type = "point force"
marker = "beam.tip"
direction = [0, -1, 0]
force = "20 N"

[simulation]
duration = "0.1 s"
output_step = "10 ms"
tip = "beam.tip"
start = "equilibrium"

[[simulation.run]]
integrator = "auto"
"""


def run_of(folder: Path, text: str) -> Pipeline:
    (folder / "scene.toml").write_text(text)
    return Pipeline(load_scene(folder / "scene.toml"))


def test_a_pendulum_hangs_down_and_stays(tmp_path: Path) -> None:
    motion = run_of(tmp_path, PENDULUM).motion
    assert motion.joint_position("hinge") == pytest.approx(np.full(11, -np.pi / 2), abs=1e-9)


def test_a_spring_holds_a_rod_where_moments_balance(tmp_path: Path) -> None:
    scene = PENDULUM.replace('angle = "80 deg"', 'spring = "30 N m/rad"')
    (angle,) = run_of(tmp_path, scene).start[0]
    assert 30 * angle == pytest.approx(-2 * 9.81 * 0.5 * np.cos(angle), rel=1e-10)


def test_a_cantilever_deflects_by_its_closed_form(tmp_path: Path) -> None:
    motion = run_of(tmp_path, BEAM).motion
    EI = 200e9 * 0.02**4 / 12
    assert motion.tip_deflection[0, 1] == pytest.approx(-20 / (3 * EI), rel=3e-3)
    assert motion.tip_deflection[:, 1] == pytest.approx(np.full(11, motion.tip_deflection[0, 1]), rel=1e-6)


def test_a_slider_crank_rests_where_its_spring_and_its_weight_balance(tmp_path: Path) -> None:
    crank = PENDULUM.replace("angle", "#angle").replace(
        "[simulation]",
        """
[body.link]
shape = "rod"
mass = "1 kg"
length = "2 m"
marker = { a = { at = ["0 m", "0 m", "0 m"] }, b = { at = ["2 m", "0 m", "0 m"] } }

[joint.elbow]
type = "revolute"
parent = "rod.end"
child = "link.a"
axis = [0, 0, 1]

[joint.slot]
type = "point-on-line"
parent = "ground"
child = "link.b"
axis = [1, 0, 0]

[simulation]""",
    )
    run = run_of(tmp_path, crank)
    q, _ = run.start
    assert q[0] == pytest.approx(-np.pi / 2, abs=1e-8)  # the rod hangs, the link leans on the slot
    assert run.motion.constraint_residual < 1e-12
    assert np.ptp(run.motion.joint_position("hinge")) < 1e-8


def test_what_falls_has_no_equilibrium(tmp_path: Path) -> None:
    slide = PENDULUM.replace('"revolute"', '"prismatic"').replace("[0, 0, 1]", "[0, 1, 0]").replace("angle", "#angle")
    with pytest.raises(AccuracyError, match="falls, turns or slides without end"):
        run_of(tmp_path, slide).start  # noqa: B018


def test_a_start_whose_inertia_round_off_spoils_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check = equilibrium._positive_mass
    spoilt = SimpleNamespace(mass_matrix=lambda q: -np.eye(len(q)))
    monkeypatch.setattr(equilibrium, "_positive_mass", lambda system, q: check(spoilt, q))
    with pytest.raises(AccuracyError, match="the mass matrix of the start isn't positive definite: combinations of"):
        _ = run_of(tmp_path, PENDULUM).motion


def test_a_rate_at_the_start_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"joint\.hinge\.rate = '1 rad/s': has no effect"):
        run_of(tmp_path, PENDULUM.replace('angle = "80 deg"', 'rate = "1 rad/s"'))


@pytest.mark.parametrize("far", [1.0, 250.0, 2000.0])
def test_a_slide_comes_to_rest_however_far_its_spring_pulls_it(tmp_path: Path, far: float) -> None:
    # Where the spring has its length and the weight: x = far + m g/k.
    scene = PENDULUM.replace('type = "revolute"', 'type = "prismatic"').replace("axis = [0, 0, 1]", "axis = [0, -1, 0]")
    scene = scene.replace('angle = "80 deg"', f'spring = "50 N/m"\nrest = "{far} m"')
    (tmp_path / "slide.toml").write_text(scene)
    run = Pipeline(load_scene(tmp_path / "slide.toml"))
    assert run.start[0][0] == pytest.approx(far + 2.0 * 9.81 / 50.0, rel=1e-9)
