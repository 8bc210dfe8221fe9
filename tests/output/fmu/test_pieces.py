"""FMUs of a part in pieces, and of solids beside shells, do what the scenes' own runs do."""

import numpy as np
import pytest

import fmd
from fmd.output.fmu import build
from fmd.output.formats import write_format
from fmd.scene.scene import load_scene
from fmd.stages.pipeline import Pipeline
from tests.stages.test_structures import TIE, body, finned, pressed
from tests.verification.test_large_deflection import FORCE, strip

fmpy = pytest.importorskip("fmpy", reason="FMPy isn't installed")
pytestmark = [pytest.mark.long, pytest.mark.filterwarnings("ignore::DeprecationWarning")]

OVERRIDES = [
    "simulation.start=undeformed",
    "simulation.duration=10 ms",
    'body.strip.modes.damping={ beta = "2 ms" }',
    'simulation.run=[{ integrator = "runge-kutta", tolerance = 1e-9 }]',
]


def test_an_fmu_of_solids_beside_shells_moves_as_the_scenes_own_run(tmp_path, monkeypatch):
    if not build.own_target():
        pytest.skip("this system has no FMU binaries")
    finned(np.linspace(-0.02, 0.02, 3), own_nodes=True, coarse=True).write(tmp_path / "fin.inp")
    run = fmd.load(pressed(body(tmp_path / "fin.inp", shell="deck", tie=TIE))).run
    monkeypatch.setattr("fmd.output.fmu.write.build_binaries", build.build_own_binary)
    monkeypatch.setattr(build, "_FAST", ())  # compiled sooner
    file, _ = write_format(run, "fmu", None, tmp_path / "fin.fmu")
    rows = fmpy.simulate_fmu(str(file), stop_time=0.01, output_interval=0.001, output=["b.tip.position[2]"])
    ours = run.motion.kinematics.marker_position(run.motion.mechanism.number_of("b"), "tip")[:, 1]
    assert np.ptp(ours) > 1e-6
    assert rows["b.tip.position[2]"] == pytest.approx(ours, abs=1e-5 * np.ptp(ours))


def test_an_fmu_of_pieces_moves_as_the_scenes_own_run(tmp_path, monkeypatch):
    if not build.own_target():
        pytest.skip("this system has no FMU binaries")
    strip(tmp_path, PIECES=2, ALONG=4, LOAD="5 N", **FORCE | {"STIFFENING": "off"})
    run = Pipeline(load_scene(tmp_path / "strip.toml", OVERRIDES))
    monkeypatch.setattr("fmd.output.fmu.write.build_binaries", build.build_own_binary)
    monkeypatch.setattr(build, "_FAST", ())  # compiled sooner
    file, _ = write_format(run, "fmu", None, tmp_path / "strip.fmu")
    assert "strip.tip.force[3]" in {own.name for own in fmpy.read_model_description(str(file)).modelVariables}
    rows = fmpy.simulate_fmu(str(file), stop_time=0.01, output_interval=0.001, output=["strip.tip.position[3]"])
    motion = run.motion
    body = motion.mechanism.number_of(run.division.find_place("strip.tip").partition(".")[0])
    ours = motion.kinematics.marker_position(body, "tip")[:, 2]
    assert np.abs(ours).max() > 1e-3
    assert rows["strip.tip.position[3]"] == pytest.approx(ours, abs=1e-6 * np.abs(ours).max())
