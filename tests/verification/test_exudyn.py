"""Bodies that Exudyn moves: the tip of a driven beam, and of a part of tetrahedra in space, beside ours.

Exudyn's generalised-α is of second order: the difference falls to 1e-6 of the tip's path and less with the step.
"""

import contextlib
import importlib.util
import io
from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.output.formats import write_format

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]
TIME, OUTPUTS = 0.05, 50
DRIVE = '[drive.torque]\ntype = "torque"\njoint = "hub"\ntorque = { formula = "2*sin(pi*t/0.05)", unit = "N m" }\n'
SPIN = (10.0, 30.0, 40.0)
SCENES = {
    "beam": (
        'E = "722 MPa"\nmesh = { element = "hexahedron", divisions = [12, 2, 1] }\n'
        'modes = { count = 5, family = "in-plane bending", enrich = "none" }\n',
        f'type = "revolute"\naxis = [0, 0, 1]\n{DRIVE}',
    ),
    "part": (
        'E = "100 MPa"\nmesh = { element = "tetrahedron", size = "20 mm" }\nmodes = { count = 6, enrich = "none" }\n',
        'type = "spherical"\nspin = ["10 rad/s", "30 rad/s", "40 rad/s"]\n',
    ),
}


def make_run(name: str, folder: Path) -> Pipeline:
    body, joint = SCENES[name]
    path = folder / "scene.toml"
    path.write_text(f"""title = "t"
[body.beam]
shape = "bar"
length = "340 mm"
depth = "25 mm"
width = "10 mm"
nu = 0.34
rho = "2000 kg/m^3"
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
{body}
[joint.hub]
parent = "ground"
child = "beam.root"
{joint}
[simulation]
duration = "{TIME} s"
output_step = "{TIME / OUTPUTS} s"
tip = "beam.tip"
stiffening = "off"
[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-11
""")
    return Pipeline(load_scene(path))


def march_there(script: Path, driven: bool, step: float) -> np.ndarray:
    """Return the tip's positions by Exudyn, which loads the body by the script that was written beside it."""
    exu = pytest.importorskip("exudyn")
    eii = pytest.importorskip("exudyn.itemInterface")
    spec = importlib.util.spec_from_file_location("body_of_exudyn", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    body = module.add_body(mbs, spin=(0.0, 0.0, 0.0) if driven else SPIN)
    ground = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=mbs.AddObject(eii.ObjectGround())))
    root = body["markers"]["root"]
    axes = [1, 1, 1, 1, 1, 0] if driven else [1, 1, 1, 0, 0, 0]
    mbs.AddObject(eii.GenericJoint(markerNumbers=[ground, root], constrainedAxes=axes))
    if driven:

        def torque(_, t, __):
            return [0.0, 0.0, 2.0 * np.sin(np.pi * t / TIME)]

        mbs.AddLoad(eii.LoadTorqueVector(markerNumber=root, loadVectorUserFunction=torque))
    position = exu.OutputVariableType.Position
    sensors = [
        mbs.AddSensor(
            eii.SensorSuperElement(
                bodyNumber=body["object"], meshNodeNumber=node, storeInternal=True, outputVariableType=position
            )
        )
        for node in body["nodes"]["tip"]
    ]
    mbs.Assemble()
    settings = exu.SimulationSettings()
    march = settings.timeIntegration
    march.endTime, march.numberOfSteps = TIME, round(TIME / step)
    march.generalizedAlpha.spectralRadius = 1.0
    march.generalizedAlpha.useIndex2Constraints = march.generalizedAlpha.useNewmark = True
    march.newton.useModifiedNewton = True
    march.newton.relativeTolerance, march.newton.absoluteTolerance = 1e-10, 1e-12
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = TIME / OUTPUTS
    with contextlib.redirect_stdout(io.StringIO()):
        mbs.SolveDynamic(settings)
    data = [mbs.GetSensorStoredData(sensor) for sensor in sensors]
    times = np.arange(OUTPUTS + 1) * TIME / OUTPUTS
    rows = np.abs(data[0][:, 0][:, None] - times).argmin(axis=0)
    return np.mean([one[rows, 1:4] for one in data], axis=0)


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] * (name == "beam")) for name in SCENES])
def test_the_tip_moves_there_as_here(name: str, tmp_path: Path):
    run = make_run(name, tmp_path)
    write_format(run, "exudyn", "beam", tmp_path / "body.npz")
    ours = run.motion.tip_position
    path = np.linalg.norm(np.diff(ours, axis=0), axis=1).sum()
    assert run.motion.tip_size.max() > 1e-4
    coarse, fine = (march_there(tmp_path / "body.py", name == "beam", step) for step in (2e-5, 1e-5))
    assert np.abs(fine - ours).max() < 1e-6 * path
    assert np.abs(fine - ours).max() < 0.5 * np.abs(coarse - ours).max()
