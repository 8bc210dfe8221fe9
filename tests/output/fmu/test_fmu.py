"""An FMU does what the scene's own run does, by both versions of the interface, beside references of another kind."""

import faulthandler
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from fmd.output.fmu import build
from fmd.output.fmu.write import list_platforms, write_fmu
from fmd.scene.scene import load_scene
from fmd.stages.pipeline import Pipeline

fmpy = pytest.importorskip("fmpy", reason="FMPy isn't installed")
validate_fmu = pytest.importorskip("fmpy.validation").validate_fmu
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")

END = 0.1  # s
NAMES = ("motor.position", "hinge.position", "hinge.rate", "bar.far.position[1]", "bar.far.position[3]")


@pytest.fixture(scope="module", params=["fmi2", "fmi3"])
def file(exported, request):
    return getattr(exported, request.param)


@pytest.fixture(scope="module")
def exchange(exported, tmp_path_factory):
    """An instance for model exchange by FMI 2.0, and the references of its variables."""
    return open_instance(exported.fmi2, tmp_path_factory.mktemp("exchange"), fmpy.fmi2.FMU2Model)


def open_instance(path, folder, kind):
    description = fmpy.read_model_description(str(path))
    fmpy.extract(str(path), unzipdir=str(folder))
    own = description.coSimulation or description.modelExchange
    instance = kind(
        guid=description.guid,
        unzipDirectory=str(folder),
        modelIdentifier=own.modelIdentifier,
        instanceName="small",
    )
    instance.instantiate()
    instance.setupExperiment(startTime=0.0)
    instance.enterInitializationMode()
    instance.exitInitializationMode()
    return instance, {variable.name: variable.valueReference for variable in description.modelVariables}


def simulate(path, kind="CoSimulation", names=NAMES, interval=0.005, **options):
    """Simulate an FMU; return which rows are at the run's output times, and all rows."""
    rows = fmpy.simulate_fmu(
        str(path), fmi_type=kind, stop_time=END, output_interval=interval, output=list(names), **options
    )
    times, first = np.unique(rows["time"].round(9), return_index=True)
    return first[np.abs(times / 0.005 - np.round(times / 0.005)) < 1e-6], rows


def ours(motion, name):
    place, _, rest = name.rpartition(".")
    kind, _, index = rest.partition("[")
    k = int(index.rstrip("]").split(",")[0]) - 1 if index else 0
    if kind == "position" and place in motion.joints:
        return motion.joint_position(place)
    if kind == "rate":
        return motion.joint_rate(place)
    if kind.startswith("reaction"):
        return motion.joint_loads.reactions[place][:, 1, k + (3 if kind == "reaction_moment" else 0)]
    body, _, marker = place.partition(".")
    return motion.kinematics.marker_position(motion.mechanism.number_of(body), marker)[:, k]


def largest_error(motion, chosen, rows, names=NAMES):
    times = rows["time"][chosen]
    at = np.searchsorted(motion.times, times - 1e-6)
    assert times == pytest.approx(motion.times[at])
    return max(np.abs(rows[n][chosen] - ours(motion, n)[at]).max() / np.abs(ours(motion, n)).max() for n in names)


def test_both_descriptions_are_valid(file):
    assert validate_fmu(str(file)) == []


def test_model_exchange_is_the_scenes_own_motion(exported, file):
    rows = simulate(file, "ModelExchange", interval=2.5e-4, relative_tolerance=1e-12)
    assert largest_error(exported.run.motion, *rows) < 1e-8


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9])
def test_co_simulation_is_it_too_within_its_tolerance(exported, file, tolerance):
    rows = simulate(file, start_values={"solver.tolerance": tolerance})
    assert largest_error(exported.run.motion, *rows) < 20 * tolerance


def test_reactions_and_stress_are_those_of_the_run(exported):
    stress = [f"bar.root.stress[{k}]" for k in range(1, 7)]
    reactions = [
        f"{j}.reaction_{kind}[{k}]" for j in ("motor", "hinge") for kind in ("force", "moment") for k in (2, 3)
    ]
    chosen, rows = simulate(exported.fmi2, names=[*stress, "bar.root.von_mises", *reactions])
    motion = exported.run.motion
    whole = np.abs([ours(motion, name) for name in reactions]).max()
    for name in reactions:
        assert rows[name][chosen] == pytest.approx(ours(motion, name), abs=2e-6 * whole)
    von_mises = exported.run.element_stress("bar.root")
    (expected,) = von_mises.values()
    assert rows["bar.root.von_mises"][chosen] == pytest.approx(expected, rel=1e-6, abs=1e-6 * expected.max())
    modal = motion.modal("bar") @ np.asarray(exported.run.parts["bar"].element_stress[0]).T
    assert np.stack([rows[name][chosen] for name in stress], axis=1) == pytest.approx(modal, abs=1e-6 * modal.max())


def test_a_force_on_a_marker_is_the_scenes_point_force(exported):
    scene = exported.run.scene.file
    steady = Pipeline(load_scene(scene, ["drive.gust.force=0.7N"])).motion
    values = {"drive.gust.own_load": 0.0, "bar.far.force[3]": 0.7}
    assert largest_error(steady, *simulate(exported.fmi2, start_values=values)) < 1e-7


def test_parameters_are_the_joints_spring_damper_and_the_modes_damping(exported):
    overrides = ["joint.hinge.spring=22N m", "joint.hinge.damper=0.05N m s", "body.bar.modes.damping=0.2"]
    changed = Pipeline(load_scene(exported.run.scene.file, overrides)).motion
    values = {"hinge.spring": 22.0, "hinge.damper": 0.05, "bar.damping": 0.2}
    assert largest_error(changed, *simulate(exported.fmi3, start_values=values)) < 1e-7
    assert largest_error(changed, *simulate(exported.fmi3)) > 1e-3


def test_directional_derivatives_are_the_slopes_of_differences(exchange):
    instance, refs = exchange
    rng = np.random.default_rng(3)
    states = [ref for name, ref in refs.items() if name.startswith("states.")]
    unknowns = [ref for name, ref in refs.items() if name.startswith("der(")]
    unknowns += [refs[name] for name in ("hinge.position", "motor.rate", "bar.far.velocity[3]", "bar.root.von_mises")]
    unknowns += [
        refs["motor.reaction_moment[3]"],
        refs["ball.socket.angular_velocity[2]"],
        refs["hinge.reaction_force[1]"],
    ]
    knowns = [*states, *(refs[name] for name in ("hinge.torque", "motor.motion", "motor.motion_rate"))]
    knowns += [refs[name] for name in ("bar.far.force[2]", "bar.far.torque[1]", "hinge.spring", "hinge.own_load")]
    instance.enterContinuousTimeMode()
    instance.setTime(0.017)
    # A turned joint and a bent bar in motion; the ball's quaternion is a unit one.
    start = np.array(instance.getReal(states)) + 0.01 * rng.standard_normal(len(states))
    turn = [
        k for k, ref in enumerate(states) if any(refs[f"states.socket.coordinate[{j}]"] == ref for j in range(1, 5))
    ]
    start[turn] /= np.linalg.norm(start[turn])
    others = np.array(instance.getReal(knowns[len(states) :])) + np.array([0.1, 0.0, 0.3, 0.4, 0.2, 0.0, 0.0])
    seed = rng.standard_normal(len(knowns))
    seed[: len(states)] *= 0.1
    seed[turn] -= start[turn] * (start[turn] @ seed[turn])

    def at(step):
        now = np.r_[start, others] + step * seed
        now[turn] /= np.linalg.norm(now[turn])
        instance.setContinuousStates((fmpy.fmi2.fmi2Real * len(states))(*now[: len(states)]), len(states))
        instance.setReal(knowns[len(states) :], list(now[len(states) :]))
        return np.array(instance.getReal(unknowns))

    h = 1e-5
    differences = (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h)
    values = np.abs(at(0.0))
    slopes = np.array(instance.getDirectionalDerivative(unknowns, knowns, list(seed)))
    assert slopes == pytest.approx(differences, rel=1e-6, abs=1e-7 * max(values.max(), np.abs(differences).max()))


def test_a_state_that_is_kept_goes_on_bit_for_bit(exported, tmp_path):
    instance, refs = open_instance(exported.fmi2, tmp_path, fmpy.fmi2.FMU2Slave)
    chosen = [refs[name] for name in NAMES]

    def march(begin, end):
        for k in range(begin, end):
            instance.doStep(k * 1e-3, 1e-3)
        return instance.getReal(chosen)

    march(0, 20)
    kept = instance.getFMUstate()
    first = march(20, 40)
    bytes_of_it = instance.serializeFMUstate(kept)
    instance.setFMUstate(kept)
    assert march(20, 40) == first
    instance.freeFMUstate(kept)
    instance.setFMUstate(instance.deSerializeFMUstate(bytes_of_it))
    assert march(20, 40) == first
    instance.reset()
    instance.setupExperiment(startTime=0.0)
    instance.enterInitializationMode()
    instance.exitInitializationMode()
    march(0, 20)
    assert march(20, 40) == first


def test_where_steps_end_does_not_change_the_motion(exported, tmp_path):
    ends = []
    for number, step in enumerate((END, END / 7)):
        instance, refs = open_instance(exported.fmi2, tmp_path / str(number), fmpy.fmi2.FMU2Slave)
        for k in range(round(END / step)):
            instance.doStep(k * step, step)
        ends.append(instance.getReal([refs[name] for name in NAMES]))
    assert ends[0] == pytest.approx(ends[1], rel=1e-12, abs=1e-13)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_are_refused(exported, tmp_path, value, capfd):
    instance, refs = open_instance(exported.fmi2, tmp_path, fmpy.fmi2.FMU2Slave)
    with pytest.raises(fmpy.fmi1.FMICallException):
        instance.setReal([refs["hinge.torque"]], [value])
    with pytest.raises(fmpy.fmi1.FMICallException):
        instance.setReal([10_000], [1.0])
    capfd.readouterr()


def test_a_spring_that_no_step_can_follow_ends_in_an_error(exported, tmp_path, capfd):
    """Its vibration takes 1e150 steps a second; the process ends if the call doesn't return."""
    instance, refs = open_instance(exported.fmi2, tmp_path, fmpy.fmi2.FMU2Slave)
    instance.setReal([refs["hinge.spring"]], [1e300])
    faulthandler.dump_traceback_later(60.0, exit=True)
    try:
        with pytest.raises(fmpy.fmi1.FMICallException):
            instance.doStep(0.0, 0.01)
    finally:
        faulthandler.cancel_dump_traceback_later()
    assert instance.getRealStatus(fmpy.fmi2.fmi2LastSuccessfulTime) < 1e-9
    capfd.readouterr()


def test_the_binary_runs_where_nothing_of_python_is_installed(exported, tmp_path):
    fmpy.extract(str(exported.fmi2), unzipdir=str(tmp_path))
    (library,) = tmp_path.glob("binaries/*/*")
    guid = re.search(r'guid="([^"]*)"', (tmp_path / "modelDescription.xml").read_text())
    script = f"""
import ctypes as c, sys
f = c.CDLL({str(library)!r})
f.fmi2Instantiate.restype = c.c_void_p
m = c.c_void_p(f.fmi2Instantiate(b"x", 1, {guid[1].encode()!r}, None, None, 0, 0))
zero = c.c_double(0.0)
assert [f.fmi2SetupExperiment(m, 0, zero, zero, 0, zero), f.fmi2EnterInitializationMode(m)] == [0, 0]
assert f.fmi2ExitInitializationMode(m) == 0
assert f.fmi2DoStep(m, zero, c.c_double(0.05), 0) == 0
assert not f.fmi2Instantiate(b"x", 1, b"another", None, None, 0, 0)
f.fmi2FreeInstance(m)
assert not any(name.split(".")[0] in ("fmd", "numpy") for name in sys.modules)
print("done")
"""
    ended = subprocess.run([sys.executable, "-I", "-S", "-c", script], capture_output=True, text=True, check=True)
    assert ended.stdout == "done\n"


def test_no_path_of_this_machine_is_in_it(exported):
    places = {str(Path.home()), str(Path.cwd()), str(Path(__file__).parents[3]), str(exported.fmi2.parent), "fmd-fmu-"}
    places -= {"/"}
    for path in (exported.fmi2, exported.fmi3):
        with zipfile.ZipFile(path) as archive:
            for name in archive.namelist():
                data = archive.read(name)
                assert not [place for place in places if place.encode() in data], name


def test_the_same_scene_makes_the_same_file(exported, tmp_path, monkeypatch):
    monkeypatch.setattr(build, "has_zig", lambda: False)
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    paths = [write_fmu(exported.run, None, tmp_path / f"{k}.fmu")[1] for k in range(2)]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert list_platforms(paths[0]) == []  # without a compiler there are sources alone


def test_a_mechanism_with_loops_is_refused(fmd, capsys, tmp_path):
    assert fmd("export", "slider-crank", "--to", "fmu", "--out", tmp_path / "x.fmu") == 2
    error = capsys.readouterr().err
    assert "closes a loop" in error
    assert error.count("\n") == 1
