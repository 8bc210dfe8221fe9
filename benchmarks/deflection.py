"""Stated against true errors of large deflection, written to deflection.csv.

A clamped strip of 1000 × 20 × 5 mm is bent until its linear deflection is a part of its length: by a steady force at
its end, against the elastica (elliptic integrals), and by ``sin²(π t / 2T)`` of that over three periods T of its first
mode, against Exudyn's geometrically exact cable element (``pip install exudyn==1.13.6``; without, these rows stay as
they are in the table). Run from the project's root: ``python benchmarks/deflection.py``.
"""

import contextlib
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1]))
from benchmarks.table_format import renew_rows
from fmd import Pipeline, load_scene
from fmd.accuracy.deflection import deflection_errors
from fmd.accuracy.quantities import motion_quantities
from fmd.core.arrays import Array
from fmd.core.limits.errors import SAFETY
from tests.verification.test_large_deflection import elastica

_TABLE = Path(__file__).parent / "deflection.csv"
_DEFLECTIONS = (0.02, 0.05, 0.1, 0.2, 0.4)  # of the length
_WIDTH, _DEPTH, _MODULUS, _DENSITY = 0.02, 0.005, 210e9, 7850.0
_BENDING = _MODULUS * _WIDTH * _DEPTH**3 / 12
_MASS = _DENSITY * _WIDTH * _DEPTH
_PERIOD = float(2 * np.pi / (1.875104069**2 * np.sqrt(_BENDING / _MASS)))  # of a clamped beam's first mode
_OF_STEADY = 0.75  # of the steady force: the peak of the motion is then about the steady deflection
_OUTPUTS = 300
_SCENE = f"""
title = "Strip"
[body.strip]
shape = "bar"
length = "1 m"
depth = "{_WIDTH} m"
width = "{_DEPTH} m"
E = "{_MODULUS} Pa"
nu = 0.0
rho = "{_DENSITY} kg/m^3"
mesh = {{ element = "hexahedron", order = 2, divisions = [48, 1, 1] }}
modes = {{ count = 4, boundary = "joint", enrich = "inertia" }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
[joint.clamp]
type = "fixed"
parent = "ground"
child = "strip.root"
[drive.load]
type = "point force"
marker = "strip.tip"
direction = [0, 0, 1]
force = {{ formula = "FORCE", unit = "N" }}
[simulation]
duration = "{3 * _PERIOD} s"
output_step = "{3 * _PERIOD / _OUTPUTS} s"
tip = "strip.tip"
run = [{{ integrator = "auto" }}]
"""
Row = tuple[str, str, str, float, float]


def strip(folder: Path, force: str, *settings: str) -> Pipeline:
    """Return the strip under a force at its end."""
    file = folder / "strip.toml"
    file.write_text(_SCENE.replace("FORCE", force))
    return Pipeline(load_scene(file, list(settings)))


def stated_errors(run: Pipeline) -> dict[str, float]:
    """Return the stated errors of a run by large deflection."""
    names = dict.fromkeys(("strip, largest von Mises stress",))
    found = deflection_errors(run, names | motion_quantities(run.motion, run.motion))
    return {name: SAFETY * error for name, error in found.items()}


def steady_rows(folder: Path) -> Iterator[Row]:
    """Compare steady deflections with the elastica, and their stress, which is that of beam theory."""
    for deflection in _DEFLECTIONS:
        force = 3 * deflection * _BENDING
        run = strip(folder, repr(force), "simulation.start=steady", "simulation.duration=10 ms")
        stated, ours = stated_errors(run), run.motion.tip_deflection[0, [0, 2]]
        exact = elastica(3 * deflection) - [1, 0]
        size = float(np.linalg.norm(exact))
        true = {
            "tip, deflection": float(np.linalg.norm(exact - ours)) / size,
            "tip, largest deflection": abs(float(np.linalg.norm(ours)) / size - 1),
            "strip, largest von Mises stress": 1 / (1 + exact[0]) - 1,
        }
        for name, error in true.items():
            yield "elastica", f"{deflection:g}", name, stated[name], error


def moving_rows(folder: Path) -> Iterator[Row]:
    """Compare motions with Exudyn's."""
    for deflection in _DEFLECTIONS:
        force = _OF_STEADY * 3 * deflection * _BENDING
        run = strip(folder, f"{force!r}*sin(pi*t/{2 * _PERIOD!r})**2")
        stated, ours = stated_errors(run), run.motion.tip_deflection
        theirs = march_cable(force)[: len(ours)]
        ours = ours[: len(theirs), [0, 2]]
        size = float(np.linalg.norm(theirs, axis=1).max())
        true = {
            "tip, deflection": float(np.linalg.norm(ours - theirs, axis=1).max()) / size,
            "tip, largest deflection": abs(float(np.linalg.norm(ours, axis=1).max()) / size - 1),
        }
        for name, error in true.items():
            yield "Exudyn", f"{deflection:g}", name, stated[name], error


def march_cable(force: float) -> Array:
    """Return the displacement of the strip's end along and across it by Exudyn, shape (n_times, 2) [m]."""
    import exudyn
    from exudyn.beams import GenerateStraightLineANCFCable2D
    from exudyn.utilities import Force, MarkerNodePosition, ObjectANCFCable2D, SensorNode

    container = exudyn.SystemContainer()
    system = container.AddSystem()
    # The axial stiffness is a tenth of the strip's: enough for its length, and Newton's iteration converges.
    cable = ObjectANCFCable2D(
        massPerLength=_MASS, bendingStiffness=_BENDING, axialStiffness=0.1 * _MODULUS * _WIDTH * _DEPTH
    )
    nodes = GenerateStraightLineANCFCable2D(
        system, [0, 0, 0], [1, 0, 0], 16, cable, fixedConstraintsNode0=[1, 1, 0, 1], fixedConstraintsNode1=[0] * 4
    )[0]

    def push(mbs: object, t: float, load: object) -> list[float]:
        return [0.0, force * float(np.sin(np.pi * t / (2 * _PERIOD))) ** 2, 0.0]

    marker = system.AddMarker(MarkerNodePosition(nodeNumber=nodes[-1]))
    system.AddLoad(Force(markerNumber=marker, loadVector=[0, force, 0], loadVectorUserFunction=push))
    displacement = exudyn.OutputVariableType.Displacement
    sensor = system.AddSensor(SensorNode(nodeNumber=nodes[-1], storeInternal=True, outputVariableType=displacement))
    system.Assemble()
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = 3000, 3 * _PERIOD
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    settings.timeIntegration.newton.relativeTolerance = settings.timeIntegration.newton.absoluteTolerance = 1e-4
    settings.solutionSettings.sensorsWritePeriod = 3 * _PERIOD / _OUTPUTS
    settings.solutionSettings.writeSolutionToFile = False
    settings.linearSolverType = exudyn.LinearSolverType.EigenSparse
    system.SolveDynamic(settings)
    return np.asarray(system.GetSensorStoredData(sensor))[:, 1:3]


def main() -> None:
    """Write the table; without Exudyn its rows stay as they are."""
    columns = ("reference", "deflection", "quantity", "stated", "true")
    with tempfile.TemporaryDirectory() as folder:
        rows = list(steady_rows(Path(folder)))
        with contextlib.suppress(ImportError):
            rows += moving_rows(Path(folder))
    named = [dict(zip(columns, row, strict=True)) for row in rows]
    renew_rows(_TABLE, named, ("reference",), lambda row: row["reference"] == "Exudyn")


if __name__ == "__main__":
    main()
