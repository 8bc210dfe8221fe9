"""A slender pendulum let go from horizontal: our solid in pieces beside Exudyn's plane beams, in one process.

Run from the project's root: ``python benchmarks/exudyn_pendulum.py``; it needs ``pip install exudyn==1.13.6`` and
writes ``pendulum.csv`` beside itself: seconds, and the largest distance of the end over 5 s from the reference [mm].
Steel strip, 1 m × 2 mm × 20 mm. Both march generalised-α with the same steps. Exudyn's are geometrically exact beams
(linear) and cables by absolute nodal coordinates (cubic), full Newton. Its absolute tolerance is 1e-5: with the default
of 1e-10 round-off keeps Newton's method from converging, and steps are halved thousands of times. The reference is 32
of those cables, extrapolated over the step.
"""

from __future__ import annotations

import csv
import tempfile
import time
import warnings
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from exudyn_march import import_exudyn

from fmd import Pipeline, load_scene

HERE = Path(__file__).parent
LENGTH, THICK, WIDE, E, NU, RHO, G = 1.0, 2e-3, 20e-3, 206e9, 0.3, 7850.0, 9.81
DURATION, OUTPUT, REPEATS, SPECTRAL_RADIUS = 5.0, 0.01, 3, 0.8
OURS = ((4, 1e-3), (8, 2e-3), (8, 1e-3), (8, 5e-4), (16, 1e-3))
THEIRS = (("exact", 8, 1e-3), ("exact", 16, 1e-3), ("exact", 32, 1e-3), ("exact", 64, 1e-3), ("cable", 16, 1e-3))
NAMES = {"exact": "Exudyn, geometrically exact beams", "cable": "Exudyn, cables by absolute nodal coordinates"}
SCENE = f"""
title = "Pendulum"
[body.strip]
shape = "bar"
length = "{LENGTH} m"
depth = "{WIDE} m"
width = "{THICK} m"
E = "{E} Pa"
nu = {NU}
rho = "{RHO} kg/m^3"
mesh = {{ divisions = [64, 1, 1] }}
modes = {{ count = 1 }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
pieces = PIECES

[joint.hinge]
type = "revolute"
parent = "ground"
child = "strip.root"
axis = [0, 1, 0]

[simulation]
gravity = ["0 m/s^2", "0 m/s^2", "-{G} m/s^2"]
duration = "{DURATION} s"
output_step = "{OUTPUT} s"
tip = "strip.tip"
run = [{{ integrator = "generalized-alpha", step = "STEP s" }}]
"""


def march_ours(pieces: int, step: float) -> tuple[float, Any]:
    """March our strip; return the least seconds and the end's places in the plane, shape (n_times, 2) [m]."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "pendulum.toml"
        file.write_text(SCENE.replace("PIECES", str(pieces)).replace("STEP", repr(step)))
        run = Pipeline(load_scene(file))
        (plan,) = run.plans.values()
        plan.march(run.output_times[:2])
        seconds = []
        for _ in range(REPEATS):
            tick = time.perf_counter()
            plan.march(run.output_times)
            seconds.append(time.perf_counter() - tick)
        body, _, marker = run.divided_scene.simulation.tip.partition(".")
        kinematics = run.motion.kinematics
        return min(seconds), kinematics.marker_position(run.mechanism.number_of(body), marker)[:, [0, 2]]


def twin(kind: str, n: int) -> tuple[Any, Any, Any]:
    """Return Exudyn's system of n plane elements, the sensor of the end, and what has to live as long."""
    exu = import_exudyn()
    ii, container = exu.itemInterface, exu.SystemContainer()
    mbs, area, bending = container.AddSystem(), THICK * WIDE, E * WIDE * THICK**3 / 12
    own = {"length": LENGTH / n, "massPerLength": RHO * area, "bendingStiffness": bending, "axialStiffness": E * area}
    places = np.linspace(0.0, LENGTH, n + 1)
    if kind == "exact":
        own |= {"crossSectionInertia": RHO * bending / E, "shearStiffness": 5 / 6 * area * E / (2 * (1 + NU))}
        nodes = [mbs.AddNode(ii.NodeRigidBody2D(referenceCoordinates=[x, 0, 0])) for x in places]
        make = ii.ObjectBeamGeometricallyExact2D
    else:
        nodes = [mbs.AddNode(ii.NodePoint2DSlope1(referenceCoordinates=[x, 0, 1, 0])) for x in places]
        make = ii.ObjectANCFCable2D
    for pair in pairwise(nodes):
        mass = mbs.AddMarker(ii.MarkerBodyMass(bodyNumber=mbs.AddObject(make(nodeNumbers=list(pair), **own))))
        mbs.AddLoad(ii.LoadMassProportional(markerNumber=mass, loadVector=[0, -G, 0]))
    for axis in (0, 1):
        fixed = mbs.AddMarker(ii.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(ii.NodePointGround()), coordinate=axis))
        held = mbs.AddMarker(ii.MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=axis))
        mbs.AddObject(ii.CoordinateConstraint(markerNumbers=[fixed, held]))
    position = exu.OutputVariableType.Position
    sensor = mbs.AddSensor(ii.SensorNode(nodeNumber=nodes[-1], storeInternal=True, outputVariableType=position))
    mbs.Assemble()
    return mbs, sensor, container


def march_theirs(kind: str, n: int, step: float, repeats: int = REPEATS) -> tuple[float, Any]:
    """March Exudyn's elements; return as `march_ours`."""
    exu, seconds = import_exudyn(), []
    for _ in range(repeats):
        mbs, sensor, _container = twin(kind, n)
        settings = exu.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = OUTPUT
        march = settings.timeIntegration
        march.numberOfSteps, march.endTime, march.verboseMode = round(DURATION / step), DURATION, 0
        march.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
        march.newton.absoluteTolerance = 1e-5
        settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        tick = time.perf_counter()
        mbs.SolveDynamic(settings)
        seconds.append(time.perf_counter() - tick)
        found = mbs.GetSensorStoredData(sensor)[:, 1:3]
    return min(seconds), found


def main() -> None:
    """Measure, and write the table."""
    warnings.simplefilter("ignore", DeprecationWarning)
    coarse, fine = (march_theirs("cable", 32, step, 1)[1] for step in (5e-4, 2.5e-4))
    reference = (4 * fine - coarse) / 3
    rows: list[tuple[Any, ...]] = []

    def add(what: str, n: int, step: float, seconds: float, path: Any) -> None:
        apart = 1e3 * np.linalg.norm(path - reference, axis=1).max()
        rows.append((what, n, f"{1e3 * step:g}", f"{seconds:.3g}", f"{apart:.2g}"))
        print(rows[-1], flush=True)

    for pieces, step in OURS:
        add("solid in pieces", pieces, step, *march_ours(pieces, step))
    for kind, n, step in THEIRS:
        add(NAMES[kind], n, step, *march_theirs(kind, n, step))
    with (HERE / "pendulum.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("what", "number", "step_ms", "seconds", "apart_mm"))
        writer.writerows(rows)


if __name__ == "__main__":
    main()
