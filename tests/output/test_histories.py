"""Histories and tables of extremes: what is in the files, against statics and the forces of springs and masses."""

import csv
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

from fmd import Pipeline, load_scene
from fmd.accuracy.missed_peaks import UNSOUGHT, find_missed_peaks
from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.output.histories import draw_history, missed_peak_warnings
from fmd.output.summary import run_warnings
from fmd.recovery.motion import Motion
from fmd.recovery.motion_file import Variable
from fmd.recovery.stress import von_mises
from fmd.stages import plan
from tests.contact.test_rigid_contacts import BALL, RADIUS, SPEED, free
from tests.contact.test_rigid_contacts import scene as scene_of

SCENE = """
title = "Bar with a mass"
[body.bar]
shape = "bar"
length = "0.4 m"
width = "20 mm"
depth = "10 mm"
E = "70 GPa"
nu = 0.3
rho = "2700 kg/m^3"
mesh = { element = "hexahedron", order = 2, divisions = [8, 1, 1] }
modes = { count = 3, family = "in-plane bending", boundary = "joint", enrich = "none" }
marker = { hinge = { face = "x-" }, tip = { face = "x+" } }
element = { root = { at = ["20 mm", "0 mm", "0 mm"] } }
[body.ball]
shape = "point"
mass = "0.5 kg"
marker = { grip = { at = ["0 m", "0 m", "0 m"] } }
[joint.hinge]
type = "revolute"
parent = "ground"
child = "bar.hinge"
axis = [0, 0, 1]
spring = "40 N m"
damper = "0.1 N m s"
[joint.grip]
type = "fixed"
parent = "bar.tip"
child = "ball.grip"
[simulation]
duration = "50 ms"
output_step = "0.5 ms"
gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]
tip = "bar.tip"
run = [{ integrator = "runge-kutta", tolerance = 1e-9 }]
[[output]]
type = "history"
file = "loads.csv"
quantities = [
    "joint_reaction", "joint_position", "joint_rate", "marker_acceleration", "marker_velocity", "element_stress",
]
markers = ["bar.tip"]
components = ["von Mises", "xx", "xy"]
[[output]]
type = "history"
file = "loads.nc"
quantities = ["joint_reaction", "marker_displacement", "node_stress", "energy"]
markers = ["bar.tip"]
nodes = ["bar.0"]
axes = "body"
[[output]]
type = "table"
file = "extremes.csv"
quantities = ["joint_reaction", "marker_position"]
joints = ["grip"]
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("scene") / "scene.toml"
    file.write_text(SCENE)
    return file


@pytest.fixture(scope="module")
def out(scene: Path, fmd: Callable[..., int]) -> Path:
    assert fmd("run", scene, "--out", scene.parent / "out", "--no-budget") == 0
    return scene.parent / "out"


def read_columns(file: Path) -> dict[str, Array]:
    rows = list(csv.reader(file.read_text(encoding="utf-8").splitlines()))
    return dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True))


def test_a_hinge_states_the_torque_of_its_spring_and_damper(out: Path) -> None:
    found = read_columns(out / "loads.csv")
    torque = -40.0 * found["hinge.position [rad]"] - 0.1 * found["hinge.rate [rad/s]"]
    assert found["hinge.moment.z [N m]"] == pytest.approx(torque, abs=1e-7)
    assert np.ptp(torque) > 1.0


def test_a_mass_is_pulled_as_it_accelerates(out: Path) -> None:
    """Of a point mass: F = m (a − g); and its velocity is the acceleration's integral (Simpson's rule)."""
    found = read_columns(out / "loads.csv")
    assert found["grip.force.y [N]"] == pytest.approx(
        0.5 * (found["bar.tip.acceleration.y [m/s^2]"] + 9.81), rel=1e-8, abs=1e-7
    )
    times, a, v = (
        found[f"{name}"] for name in ("time [s]", "bar.tip.acceleration.y [m/s^2]", "bar.tip.velocity.y [m/s]")
    )
    h = times[1] - times[0]
    steps = h / 3 * (a[:-2] + 4 * a[1:-1] + a[2:])
    assert v[2:] - v[:-2] == pytest.approx(steps, abs=1e-2 * np.abs(steps).max())


def test_a_file_in_the_body_s_axes_has_all_runs(out: Path, scene: Path) -> None:
    run: Any = Pipeline(load_scene(scene))
    motion = run.motion
    with xarray.open_dataset(out / "loads.nc") as found:
        assert found["hinge.force"].dims == ("run", "time", "axis")
        assert found["hinge.force"].attrs["units"] == "N"
        in_space = motion.joint_loads.reactions["hinge"][:, 1, :3]
        turned = np.einsum("tji,tj->ti", motion.kinematics.frames[0].rotation, in_space)
        assert found["hinge.force"].values[0] == pytest.approx(turned, rel=1e-9, abs=1e-9)
        assert found["bar.tip.displacement"].values[0] == pytest.approx(motion.tip_displacement)
        (place,) = np.flatnonzero(run.part.surface.nodes == 0)
        stress = von_mises((run.part.surface_stress[place] @ motion.modal("bar").T)[None])[0]
        assert found["bar.0.von Mises"].values[0] == pytest.approx(stress, rel=1e-9)
        assert found["kinetic_energy"].values[0] == pytest.approx(motion.energies[0])


def test_the_table_has_extremes_and_when(out: Path) -> None:
    rows = {row["quantity"]: row for row in json.loads((out / "summary.json").read_text())["tables"]["extremes.csv"]}
    lines = (out / "extremes.csv").read_text(encoding="utf-8").splitlines()
    written = {row["quantity"]: row for row in csv.DictReader(lines)}
    assert list(rows) == list(written)
    force = read_columns(out / "loads.csv")["grip.force.y [N]"]
    row, times = rows["grip.force.y"], 0.5e-3 * np.arange(101)
    assert (row["largest"], row["smallest"]) == (pytest.approx(force.max()), pytest.approx(force.min()))
    assert row["largest_at_s"] == pytest.approx(times[force.argmax()])
    assert row["rms"] == pytest.approx(np.sqrt((force**2).mean()))
    assert float(written["grip.force.y"]["largest"]) == pytest.approx(force.max())
    assert rows["grip.force.size"]["largest"] >= np.abs(force).max() * (1 - 1e-9)
    assert rows["ball.grip.position.x"]["unit"] == "m"


def read_errors(file: Path) -> dict[str, dict[str, str]]:
    return {row["column"]: row for row in csv.DictReader(file.read_text(encoding="utf-8").splitlines())}


def test_without_a_budget_every_file_says_that_no_error_is_stated(out: Path) -> None:
    for row in read_errors(out / "loads-errors.csv").values():
        assert (row["error"], row["why not"][:11]) == ("", "not stated:")
    assert "--no-budget" in read_errors(out / "loads-errors.csv")["hinge.force.x"]["why not"]
    for name in ("loads.nc", "motion.nc"):
        with xarray.open_dataset(out / name) as found:
            assert all(variable.attrs["error"].startswith("not stated: ") for variable in found.data_vars.values())
    rows = json.loads((out / "summary.json").read_text())["tables"]["extremes.csv"]
    assert all(row["error"] is None and row["why"].startswith("not stated: ") for row in rows)


SHORT = ("--set", "simulation.duration=25 ms")


@pytest.fixture(scope="module")
def stated(scene: Path, fmd: Callable[..., int]) -> Path:
    assert fmd("run", scene, *SHORT, "--out", scene.parent / "stated", "--budget-seconds", "100") == 0
    return scene.parent / "stated"


def test_every_column_has_the_error_of_the_budget_or_says_why_not(stated: Path) -> None:
    budget = json.loads((stated / "summary.json").read_text())["error_budget"]
    rows = {row["quantity"]: row for row in (*budget["rows"], *budget["details"])}
    columns = read_columns(stated / "loads.csv")
    errors = read_errors(stated / "loads-errors.csv")
    assert [f"{name} [{row['unit']}]" for name, row in errors.items()] == list(columns)[1:]
    for name in ("hinge.force", "hinge.moment", "bar.tip.acceleration", "bar.tip.velocity"):
        row = rows[name]
        size = row["total"] * max(row["value"], row["better"] - row["between"])
        assert [float(errors[f"{name}.{axis}"]["error"]) for axis in "xyz"] == pytest.approx([size] * 3, rel=1e-6)
    assert float(errors["bar.root.von Mises"]["error"]) > 0.0
    assert float(errors["bar.root.xy"]["error"]) > 0.0
    assert errors["bar.root.xx"]["why not"] == "not stated: it is nothing but round-off"  # in the neutral plane
    with xarray.open_dataset(stated / "motion.nc") as found:
        assert found["bar.modal_coordinates"].attrs["error"].startswith("not stated: it belongs to the modes")
        assert found["bar.tip.position"].attrs["error"] > 0.0
    with xarray.open_dataset(stated / "loads.nc") as found:
        place, force = found["bar.tip.displacement"].attrs["error"], found["hinge.force"].attrs["error"]
        assert found["bar.0.von Mises"].attrs["error"] > 0.0
    assert place == "not stated: bar.tip.deflection of motion.nc has an error"
    assert force > rows["hinge.force"]["total"] * rows["hinge.force"]["value"]  # in the body's axes, which turn
    tables = {
        row["quantity"]: row for row in json.loads((stated / "summary.json").read_text())["tables"]["extremes.csv"]
    }
    assert tables["grip.force.size"]["error"] == tables["grip.force.x"]["error"] > 0.0


def test_stated_errors_hold_what_ten_times_as_many_modes_change(
    stated: Path, scene: Path, fmd: Callable[..., int]
) -> None:
    """Against 30 modes of the family; neither they nor the way to them are among the budget's variants."""
    many = scene.parent / "many"
    assert fmd("run", scene, *SHORT, "--set", "body.bar.modes.count=30", "--out", many, "--no-budget") == 0
    for name in ("motion.nc", "loads.nc"):
        with xarray.open_dataset(stated / name) as ours, xarray.open_dataset(many / name) as theirs:
            for key, variable in ours.data_vars.items():
                if not isinstance(variable.attrs["error"], str):
                    apart = np.abs(variable.values[0] - theirs[key].values[0])
                    assert apart.max() <= variable.attrs["error"] + 1e-9 * np.abs(variable.values).max(), key


def test_each_figure_of_bodies_and_of_the_end_has_an_error_or_a_reason(stated: Path) -> None:
    summary = json.loads((stated / "summary.json").read_text(encoding="utf-8"))
    places = [path for table in ("bodies", "final") for path in _places_of_numbers(summary[table], table)]
    errors = summary["stated_errors"]
    assert len(places) > 20
    assert not [path for path in places if path not in errors and path.rpartition(".")[0] not in errors]


def _places_of_numbers(value: Any, path: str) -> Iterator[str]:
    """Yield the places of the numbers in a summary's table, but for the time, which is given."""
    if isinstance(value, float) and not path.endswith("time_s"):
        yield path
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value if isinstance(value, list) else ()):
        yield from _places_of_numbers(inner, f"{path}.{key}")


def test_a_clamped_bar_in_equilibrium_bears_its_weight_and_the_mass(scene: Path) -> None:
    """Statics: F = (ρ A l + m) g and M = (ρ A l / 2 + m) g l, about the clamped face."""
    file = scene.with_name("clamped.toml")
    text = SCENE.replace('type = "revolute"', 'type = "fixed"')
    for line in ("axis = [0, 0, 1]", 'spring = "40 N m"', 'damper = "0.1 N m s"'):
        text = text.replace(f"{line}\n", "")
    file.write_text(text)
    reactions = Pipeline(load_scene(file, ["simulation.start=equilibrium"])).motion.joint_loads.reactions["hinge"][:, 1]
    weight, load = 2700 * 0.4 * 0.02 * 0.01 * 9.81, 0.5 * 9.81
    expected = [0.0, weight + load, 0.0, 0.0, 0.0, (0.5 * weight + load) * 0.4]
    # The bent bar is shorter by ½ ∫ w'² dx, some 4e-6 of its length.
    assert reactions == pytest.approx(np.tile(expected, (101, 1)), rel=1e-5, abs=1e-7)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('quantities = ["joint_reaction"]\njoints = ["hing"]', "output.3.joints.0 = 'hing': no such joint"),
        ('quantities = ["joint_position"]\nmarkers = ["bar.tip"]', "belongs to marker_position"),
        ('quantities = ["marker_velocity"]\nmarkers = ["bar.top"]', "no such marker"),
        ('quantities = ["node_stress"]', "nodes: is missing"),
        ('quantities = ["node_stress"]\nnodes = ["ball.1"]', "no such body with stress"),
        ('quantities = ["node_stress"]\nnodes = ["bar.99999"]', "bar has the nodes 0 to"),
        ('quantities = ["node_stress"]\nnodes = ["bar"]', "'beam.112'"),
        ('quantities = ["element_stress"]\nelements = ["bar.end"]', "no such element"),
        ('quantities = ["energy", "energy"]', "holds a name twice"),
        ('quantities = ["energy"]\ncomponents = ["xx"]', "belongs to element_stress"),
        ("quantities = []", "quantities"),
    ],
)
def test_a_wrong_history_is_refused_in_one_message(
    scene: Path, fmd: Callable[..., int], capsys: pytest.CaptureFixture[str], keys: str, said: str
) -> None:
    file = scene.with_name("wrong.toml")
    file.write_text(f'{SCENE}\n[[output]]\ntype = "history"\nfile = "more.csv"\n{keys}\n')
    assert fmd("run", file, "--out", scene.parent / "wrong", "--no-budget") == 2
    err = capsys.readouterr().err
    assert said in " ".join(err.split())
    assert "Traceback" not in err


SPUN = """
title = "Spun bar"
[body.bar]
shape = "bar"
length = "0.4 m"
width = "20 mm"
depth = "10 mm"
E = "7000 GPa"
nu = 0.3
rho = "2700 kg/m^3"
mesh = { element = "hexahedron", order = 2, divisions = [4, 1, 1] }
modes = { count = 3, boundary = "joint" }
marker = { hinge = { edge = ["x-", "z-"] }, tip = { face = "x+" } }
[joint.hinge]
type = "revolute"
parent = "ground"
child = "bar.hinge"
axis = [0, 0, 1]
rate = "100 rad/s"
[simulation]
duration = "1 ms"
output_step = "1 ms"
start = "steady"
tip = "bar.tip"
run = [{ integrator = "runge-kutta" }]
"""


def test_a_hinge_bears_the_products_of_inertia_of_a_body_beside_its_plane(tmp_path: Path) -> None:
    """A stiff bar spun about its lower edge: the force is m x Ω², and the moment across the hinge that times z."""
    file = tmp_path / "spun.toml"
    file.write_text(SPUN)
    motion = Pipeline(load_scene(file)).motion
    assert motion.mechanism.links[0].integrals.normal == 2
    force, moment = np.split(motion.joint_loads.reactions["hinge"][:, 1], 2, axis=1)
    pull = 2700 * 0.4 * 0.02 * 0.01 * 0.2 * 100.0**2
    np.testing.assert_allclose(np.linalg.norm(force[:, :2], axis=1), pull, rtol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(moment[:, :2], axis=1), pull * 0.01, rtol=1e-3)


SHOCK = """
title = "Shock"
[body.arm]
shape = "rigid"
mass = "2 kg"
inertia = ["1e-3 kg m^2", "0.02 kg m^2", "0.02 kg m^2"]
centre = ["0.2 m", "0 m", "0 m"]
marker = { hinge = { at = ["0 m", "0 m", "0 m"] }, tip = { at = ["0.4 m", "0 m", "0 m"] } }
[joint.hinge]
type = "revolute"
parent = "ground"
child = "arm.hinge"
axis = [0, 0, 1]
[drive.shock]
type = "point force"
marker = "arm.tip"
direction = [0, 1, 0]
force = { formula = "0 if t < 0.0212 else 2000*sin(pi*(t-0.0212)/0.001)**2 if t < 0.0222 else 0", unit = "N" }
[simulation]
duration = "30 ms"
output_step = "5 ms"
tip = "arm.tip"
run = [{ integrator = "runge-kutta" }]
[[output]]
type = "history"
file = "force.png"
quantities = ["joint_reaction"]
"""


def test_a_shock_between_output_times_is_warned_of_and_stands_above_its_chart(tmp_path: Path) -> None:
    """The hinge bears ``m c L / J − 1`` of the shock at the tip, and after it what turns."""
    file = tmp_path / "shock.toml"
    file.write_text(SHOCK)

    def run_with(step: str) -> tuple[float, list[dict[str, str]], list[Any]]:
        run, frames = Pipeline(load_scene(file, [f"simulation.output_step={step}"]), Cache(None)), []
        draw_history(run, run.scene.output[0], tmp_path, lambda *drawn, **_: frames.extend(drawn[2]))  # type: ignore[arg-type]
        return (
            float(np.abs(run.motion.joint_loads.reactions["hinge"][:, 1, :2]).max()),
            missed_peak_warnings(run),
            frames,
        )

    seen, (warning,), (frame, *_) = run_with("5 ms")
    assert warning["code"] == "coarse-output-times"
    assert (factor := re.fullmatch(r"hinge\.force: is (\d+) times larger between output times", frame.name)), frame.name
    assert frame.name.partition(": ")[2] in warning["text"]
    peak, none, (quiet, *_) = run_with("0.02 ms")
    assert (none, quiet.name) == ([], "hinge.force")
    assert peak == pytest.approx(2000 * (2 * 0.2 * 0.4 / (0.02 + 2 * 0.2**2) - 1), rel=1e-3)
    assert float(factor[1]) == pytest.approx(peak / seen - 1.0, rel=0.02)
    assert "simulation.output_step = '0.0" in warning["text"]


BESIDE = """
[body.steady]
shape = "rigid"
mass = "2 kg"
inertia = ["1e-3 kg m^2", "0.02 kg m^2", "0.02 kg m^2"]
centre = ["0.2 m", "0 m", "0 m"]
marker = { hinge = { at = ["0 m", "0 m", "0 m"] }, tip = { at = ["0.4 m", "0 m", "0 m"] } }
[joint.pivot]
type = "revolute"
parent = "ground"
child = "steady.hinge"
axis = [0, 0, 1]
[drive.step]
type = "torque"
joint = "pivot"
torque = { formula = "0 if t < 0.0125 else 1", unit = "N m" }
"""


@pytest.mark.parametrize(
    "wanted",
    [
        'quantities = ["joint_reaction", "marker_acceleration"]\njoints = ["pivot"]\nmarkers = ["steady.tip"]',
        'formulas = { step = "0 if t < 0.0125 else 1" }',
    ],
    ids=["step", "formula"],
)
def test_steps_of_loads_and_what_a_shock_does_not_reach_miss_no_peak(tmp_path: Path, wanted: str) -> None:
    file = tmp_path / "steady.toml"
    file.write_text(
        SHOCK.replace('quantities = ["joint_reaction"]', wanted).replace("[drive.shock]", BESIDE + "[drive.shock]")
    )
    assert missed_peak_warnings(Pipeline(load_scene(file), Cache(None))) == []


def test_a_long_march_with_contacts_is_not_made_again_for_peaks_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball that falls on a plane, whose error budget needs no second march either."""
    joint = {"free": free("ball.centre", [0, 0, RADIUS], [0, 0, -SPEED])}
    floor = {"between": ["ground", "ball.skin"], "normal": [0, 0, 1]}
    tables = scene_of({"ball": BALL}, joint, {"floor": floor}, 1e-4)
    tables["output"] = [{"type": "history", "file": "energy.csv", "quantities": ["energy"]}]
    short, long = Pipeline(load_scene(tables)), Pipeline(load_scene(tables))
    assert missed_peak_warnings(short) == []
    assert len(short.fine_motion.times) > len(short.motion.times)
    monkeypatch.setattr(plan, "LONG_AGAIN", -1.0)
    for _ in range(2):
        assert missed_peak_warnings(long) == [UNSOUGHT]
        assert long.fine_motion is long.motion


@pytest.mark.parametrize(("method", "told"), [("exponential", False), ("generalized-alpha", True)])
def test_outputs_within_long_steps_are_warned_of_unless_the_method_knows_the_states_there(
    method: str, told: bool
) -> None:
    settings = ["simulation.output_step=10 ms", f'simulation.run=[{{integrator="{method}", step="0.2 s"}}]']
    codes = [each["code"] for each in run_warnings(Pipeline(load_scene("rod-slider", settings)))]
    assert ("outputs-within-steps" in codes) is told


def test_what_a_free_joint_bears_misses_no_peak(tmp_path: Path) -> None:
    """It is round-off of forces that accelerate a body which spins, 9e-14 of 200 N."""
    file = tmp_path / "free.toml"
    spins = SHOCK.replace('"revolute"', '"free"').replace(
        "axis = [0, 0, 1]", 'spin = ["13 rad/s", "7 rad/s", "50 rad/s"]'
    )
    file.write_text(re.sub('formula = ".*?"', 'formula = "0"', spins))
    assert missed_peak_warnings(Pipeline(load_scene(file), Cache(None))) == []


def test_round_off_misses_no_peak(tmp_path: Path) -> None:
    """What solving leaves of moments, forces and accelerations jumps from one output time to the next."""
    file = tmp_path / "shock.toml"
    file.write_text(SHOCK)
    run, rng = Pipeline(load_scene(file), Cache(None)), np.random.default_rng(0)

    def noise_of(size: float) -> dict[str, float]:
        def variables(motion: Motion) -> list[Variable]:
            named = (("hinge.moment", "N m"), ("hinge.force", "N"), ("arm.hinge.acceleration", "m/s^2"))
            assert len(motion.joint_loads.reactions) == 1
            shape = (len(motion.times), 3)
            return [Variable(name, size * rng.normal(size=shape), ("axis",), unit, "") for name, unit in named]

        run.results.pop("missed peaks", None)  # of other noise
        return {name: peak.part for name, peak in find_missed_peaks(run, variables).items()}

    assert noise_of(1e-11) == dict.fromkeys(noise_of(1.0), 0.0)
    assert min(noise_of(1.0).values()) > 0.02
