"""The pages of docs/jobs: their scenes run as they are written, and agree with statics and an energy balance."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson, quad, simpson, solve_ivp
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


@pytest.fixture(scope="module")
def run(engine: Path) -> Pipeline:
    """The engine with the rod of 12 mm."""
    thick = ['body.rod.depth="12 mm"', 'body.rod.width="12 mm"']
    return Pipeline(load_scene(engine, [*COARSE, *thick, "simulation.error=1e-4"]))


def gas_pressure() -> CubicSpline:
    """Pressure of the engine page over the crank's angle [Pa]."""
    angles = np.radians([0, 10, 30, 60, 120, 180, 360, 540, 600, 660, 700, 720])
    return CubicSpline(angles, 1e5 * np.array([9, 10, 6, 2.5, 1, 0.2, 0, 0, 0.3, 1.5, 6, 9]), bc_type="periodic")


def stress_of_a_beam(h: float) -> tuple[float, float]:
    """Return when a rod of an edge has its largest stress over the two turns [s], and that stress [Pa].

    It is a beam between its pins that bends in half a sine, by its own inertia and under the forces of gas and piston,
    on a rigid slider-crank, whose accelerations are linear along the rod. Derivatives by time are those of Fourier
    series.
    """
    omega, r, L, piston, n = 50 * np.pi, 0.15, 0.3, 75.552e-3, 401
    line, s = 7870 * h**2, np.linspace(0, 1, 101)  # mass over length, and places along the rod
    angle = 4 * np.pi * np.arange(n) / n
    tilt = np.arcsin(r * np.sin(angle) / L)
    along, across = np.stack([np.cos(tilt), -np.sin(tilt)], -1), np.stack([np.sin(tilt), np.cos(tilt)], -1)
    apart = angle[:, None] - angle + 2 * np.pi * np.eye(n)
    sign = (-1.0) ** (np.arange(n)[:, None] - np.arange(n))
    D = omega / 4 * sign * (1 - np.eye(n)) / np.sin(apart / 4)
    slide = D @ D @ (r * np.cos(angle) + L * np.cos(tilt))
    pin = -(omega**2) * r * np.stack([np.cos(angle), np.sin(angle)], -1)
    a0, b0 = np.sum(pin * across, -1), np.sum(pin * along, -1)  # at the crank's end
    a1, b1 = slide * across[:, 0], slide * along[:, 0]  # at the piston's
    force_x = -5e-4 * gas_pressure()(angle) - piston * slide  # on the rod
    force_y = (line * L * (a0 / 6 + a1 / 3) - force_x * across[:, 0]) / across[:, 1]
    pull = (force_x * along[:, 0] + force_y * along[:, 1])[:, None]
    pull = pull - line * L * (b0[:, None] * (1 - s) + (b1 - b0)[:, None] * (1 - s**2) / 2)
    sine, rigid = np.sin(np.pi * s), a0[:, None] * (1 - s) + a1[:, None] * s
    frequency = np.sqrt(200e9 * h**2 / 12 / 7870) * (np.pi / L) ** 2
    tension = 2 * (np.pi / L) ** 2 / line * simpson(pull * np.cos(np.pi * s) ** 2, x=s)
    stiffness = frequency**2 + tension - (D @ tilt) ** 2
    middle = np.linalg.solve(D @ D + 0.02 * frequency * D + np.diag(stiffness), -2 * simpson(rigid * sine, x=s))
    inertia = -line * (rigid + np.outer(D @ D @ middle - (D @ tilt) ** 2 * middle, sine))
    left, right = (cumulative_simpson(inertia * x, x=s, initial=0) for x in (s, 1 - s))
    bend = L**2 * ((1 - s) * left + s * (right[:, -1:] - right)) - pull * np.outer(middle, sine)
    stress = np.max(np.abs(bend) * (h / 2) / (h**4 / 12) + np.abs(pull) / h**2, axis=1)
    return angle[stress.argmax()] / omega, float(stress.max())


@pytest.mark.parametrize(("number", "edge"), [(0, 0.008), (1, 0.012)])
def test_the_largest_stress_on_the_engine_page_is_that_of_a_beam_on_a_rigid_crank(number: int, edge: float) -> None:
    page = (JOBS / "engine.md").read_text(encoding="utf-8")
    said = re.findall(r"largest von Mises stress ([\d.]+) MPa at t = ([\d.]+) ms", page)[number]
    time, stress = stress_of_a_beam(edge)
    assert float(said[0]) * 1e6 == pytest.approx(stress, rel=0.006)
    assert float(said[1]) * 1e-3 == pytest.approx(time, abs=3e-4)
    assert f"{stress / 1e6:.1f} MPa" in page[page.index("## Is it right?") :]


def test_the_largest_stress_of_the_engine_is_that_of_a_beam_on_a_rigid_crank(run: Pipeline) -> None:
    assert run.stress.worst()[2] == pytest.approx(stress_of_a_beam(0.012)[1], rel=0.006)


def test_crank_gas_and_damping_of_the_engine_balance_over_a_period(run: Pipeline) -> None:
    assert run.periodic.gap < 1e-6
    motion, omega = run.motion, 50 * np.pi
    (moment,) = (channel.read(run) for channel in find_channels(run, "shaft.moment.z"))
    (slide,) = (channel.read(run) for channel in find_channels(run, "guide.rate"))
    dt = motion.times[1] - motion.times[0]
    crank = omega * np.sum(moment[:-1]) * dt
    pressure = gas_pressure()
    gas = np.sum((-5e-4 * pressure(omega * motion.times) * slide)[:-1]) * dt

    # The rod hardly bends: the piston goes as a rigid slider-crank's, whose work is an integral over the angle.
    def work(angle: float) -> float:
        bent = np.sqrt(0.3**2 - (0.15 * np.sin(angle)) ** 2)
        return float(5e-4 * pressure(angle) * 0.15 * np.sin(angle) * (1 + 0.15 * np.cos(angle) / bent))

    assert gas == pytest.approx(quad(work, 0, 4 * np.pi, limit=200, points=pressure.x[1:-1])[0], rel=1e-3)
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


def test_the_figures_on_the_robot_page_are_those_of_a_rigid_arm() -> None:
    """Its upper link, far stiffer than the servos, bears their torque where it is held, 6 M/h³."""
    page = (JOBS / "robot.md").read_text(encoding="utf-8")
    (stress, at), (shoulder,), (elbow,) = (
        [float(x) for x in re.findall(r"-?[\d.]+", line)]
        for line in re.findall(r"^    (?:largest|shoulder: -|elbow: \d).*$", page, re.MULTILINE)
    )
    upper, fore, held, g = 0.0233 + 1.728 * 0.2**2 + 0.8 * 0.4**2, 0.006 + 0.8 * 0.15**2, 0.8 * 0.4 * 0.15, 9.81
    reference = CubicSpline([0, 0.4, 1], np.radians([0, 30, 30]), bc_type="clamped")  # upwards

    def torques(t: Any, y: Any) -> Any:
        a, b, va, vb = y
        return 2000 * (reference(t) - a) + 60 * (reference(t, 1) - va) - 0.5 * va, -500 * b - 8.2 * vb

    def slope(t: float, y: Any) -> Any:
        a, b, va, vb = y
        c, h, far = held * np.cos(b), held * np.sin(b), g * 0.8 * 0.15 * np.cos(a + b)
        M = [[upper + fore + 2 * c, fore + c], [fore + c, fore]]
        weight = g * (1.728 * 0.2 + 0.8 * 0.4) * np.cos(a) + far
        one, other = torques(t, y)
        return [va, vb, *np.linalg.solve(M, [one - weight + h * (2 * va + vb) * vb, other - far - h * va**2])]

    rigid = solve_ivp(slope, (0, 1), np.zeros(4), "LSODA", np.linspace(0, 1, 1001), rtol=1e-7, atol=1e-9)
    torque = np.abs(torques(rigid.t, rigid.y)[0])
    assert stress * 1e6 == pytest.approx(6 * torque.max() / 0.04**3, rel=0.006)
    assert at * 1e-3 == pytest.approx(rigid.t[torque.argmax()], abs=5e-3)
    assert (-shoulder, elbow) == pytest.approx((rigid.y[0, -1], -rigid.y[1, -1]), rel=1e-4)


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
