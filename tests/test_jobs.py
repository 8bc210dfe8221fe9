"""The pages of docs/jobs: their scenes run as they are written, and agree with statics and an energy balance."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from fmd import Pipeline, load, load_scene
from fmd.output.channels import find_channels

JOBS = Path(__file__).parents[1] / "docs" / "jobs"
COARSE = ("body.rod.mesh.divisions=[12,1,1]", "body.rod.modes.count=2", "output=[]")


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (JOBS / page).read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("engine") / "engine.toml"
    path.write_text(blocks("engine.md", "toml")[0])
    return path


def test_crank_gas_and_damping_of_the_engine_balance_over_a_period(engine: Path) -> None:
    run = Pipeline(
        load_scene(engine, [*COARSE, 'body.rod.depth="12 mm"', 'body.rod.width="12 mm"', "simulation.error=1e-4"])
    )
    assert run.periodic.gap < 1e-6
    motion, omega = run.motion, 50 * np.pi
    (moment,) = (channel.read(run) for channel in find_channels(run, "shaft.moment.z"))
    (slide,) = (channel.read(run) for channel in find_channels(run, "guide.rate"))
    dt = motion.times[1] - motion.times[0]
    crank = omega * np.sum(moment[:-1]) * dt
    angles = np.radians([0, 10, 30, 60, 120, 180, 360, 540, 600, 660, 700, 720])
    pressure = CubicSpline(angles, 1e5 * np.array([9, 10, 6, 2.5, 1, 0.2, 0, 0, 0.3, 1.5, 6, 9]), bc_type="periodic")
    gas = np.sum((-5e-4 * pressure(omega * motion.times) * slide)[:-1]) * dt

    # The rod hardly bends: the piston goes as a rigid slider-crank's, whose work is an integral over the angle.
    def work(angle: float) -> float:
        bent = np.sqrt(0.3**2 - (0.15 * np.sin(angle)) ** 2)
        return float(5e-4 * pressure(angle) * 0.15 * np.sin(angle) * (1 + 0.15 * np.cos(angle) / bent))

    assert gas == pytest.approx(quad(work, 0, 4 * np.pi, limit=200, points=angles[1:-1])[0], rel=1e-3)
    (link,) = (link for link in motion.mechanism.links if len(link.omega))
    rates = motion.trajectory.v[:, motion.mechanism.modes_of(motion.mechanism.links.index(link))]
    damping = np.sum((2 * link.damping * link.omega * rates**2)[:-1]) * dt
    assert crank + gas == pytest.approx(damping, abs=1e-5 * gas)


def test_the_cells_of_the_notebook_page_run(engine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(engine.parent)
    monkeypatch.setattr("fmd.load", lambda scene, *overrides: load(scene, *overrides, *COARSE))
    space: dict[str, Any] = {}
    for cell in blocks("notebook.md", "python"):
        exec(cell, space)
    assert space["moduli"].max() < 1.0
    assert 0.44 < space["slide"].max() <= 0.4501
    thin, thick = space["largest"]
    assert thin > thick > 0.9 * space["stress"].max()


def test_servos_of_the_robot_hold_its_weight_by_their_errors(tmp_path: Path, fmd) -> None:
    """``k (ref − q)`` is the moment of the weight about each joint, at rest."""
    (tmp_path / "arm.urdf").write_text(blocks("robot.md", "xml")[0])
    scene = tmp_path / "robot.toml"
    assert fmd("new", scene, "--from", tmp_path / "arm.urdf", "--flexible", "upper") == 0
    scene.write_text(scene.read_text() + blocks("robot.md", "toml")[0])
    hold = ["body.upper.mesh.divisions=[8,1,1]", 'simulation.start="equilibrium"', "output=[]"]
    hold += ["drive.shoulder.torque.variables.ref.values=[-30,-30,-30]"]
    run = Pipeline(load_scene(scene, hold))
    q, _ = run.start
    frame, elbow = q[run.mechanism.layout.position[:2]]
    turned = run.bodies["upper"].joint_rotation  # of the section at the joint against the body's frame
    shoulder = frame + turned @ q[-len(turned) :]
    upper, fore = 1.728 * 0.2 + 0.8 * 0.4, 0.8 * 0.15

    def moments(angle: float, bend: float) -> tuple[float, float]:
        far = 9.81 * fore * np.cos(angle + bend)
        return 9.81 * upper * np.cos(angle) + far, far

    rest = brentq(lambda a: 2000 * (-np.pi / 6 - a) + moments(a, elbow)[0], -1, 0)
    assert shoulder + np.pi / 6 == pytest.approx(rest + np.pi / 6, rel=1e-4)
    assert elbow == pytest.approx(moments(rest, elbow)[1] / 500, rel=1e-4)


def test_the_crossings_of_the_rotor_page_are_multiples_and_its_orbits_peak_at_forward_ones() -> None:
    page = (JOBS / "rotor.md").read_text(encoding="utf-8")
    rows = re.findall(r"^    (\d) +([\d.]+) +([\d.]+) +\d +(\w+) +([\d.]+)$", page, re.MULTILINE)
    assert len(rows) == 13
    forward = {}
    for order, rpm, hertz, whirl, ratio in rows:
        assert int(order) * float(rpm) / 60 == pytest.approx(float(hertz), abs=1e-3)
        if (order, whirl) == ("1", "forward"):
            forward[float(rpm)] = 1 / (2 * float(ratio))
    peaks = re.findall(r"^    \w+\.\w+ +([\d.]+) +[\d.]+ +([\d.]+)$", page, re.MULTILINE)
    for (rate, factor), (rpm, expected) in zip(peaks, forward.items(), strict=True):
        assert float(rate) == pytest.approx(rpm, rel=1e-3)
        assert float(factor) == pytest.approx(expected, rel=0.06)
