"""Bauchau's misaligned four-bar: our solid meshes beside Exudyn's geometrically exact beams, in one process.

Run from the project's root: ``python benchmarks/exudyn_four_bar.py``; it needs ``pip install exudyn==1.13.6`` and
writes ``four_bar.csv`` beside itself. Both march 3,000 steps of generalised-α over 12 s. Exudyn has 4, 8 and 4 beam
elements on nodes with Euler parameters, sections as published, Newton's tolerance 1e-8; a flywheel of very large
inertia turns A.
"""

from __future__ import annotations

import contextlib
import csv
import io
import platform
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from exudyn_march import import_exudyn

from fmd import Pipeline, load_scene

HERE = Path(__file__).parent
DURATION, STEPS, REPEATS, RATE = 12.0, 3000, 3, -0.6
TIMES, WANTED = (1.0, 2.0, 10.0), (-2.0439, -3.8349, 0.89939)  # mm, three meshes of such beams, extrapolated
THICK = [52.99e6, 16.88e6, 16.88e6, 733.5, 1131.0, 1131.0], [85.2e-6, 42.6e-6, 42.6e-6], 1.997
THIN = [13.25e6, 4.22e6, 4.22e6, 45.84, 70.66, 70.66], [5.324e-6, 2.662e-6, 2.662e-6], 0.4992


def twin() -> tuple[Any, Any, list[Any]]:
    """Return the assembled beams, the sensor of C, and what has to live as long."""
    exu = import_exudyn()
    from exudyn import utilities as tools

    ii, container = exu.itemInterface, exu.SystemContainer()
    mbs, upright, straight = container.AddSystem(), tools.RotationMatrixZ(0.5 * np.pi), np.eye(3)

    def beam(start, end, turned, n, section, pivot, rate):
        data = exu.BeamSection()
        stiffness, data.inertia, data.massPerLength = np.diag(section[0]), np.diag(section[1]), section[2]
        data.stiffnessMatrix = stiffness
        parameters = tools.RotationMatrix2EulerParameters(turned)
        spin, nodes = np.array([0.0, 0.0, rate]), []
        turning = tools.AngularVelocity2EulerParameters_t(turned.T @ spin, parameters)
        for share in np.linspace(0.0, 1.0, n + 1):
            at = (1 - share) * np.array(start) + share * np.array(end)
            velocity = np.cross(spin, at - pivot) if rate else np.array([-RATE * 0.12, 0.0, 0.0])
            state = {"referenceCoordinates": [*at, *parameters], "initialVelocities": [*velocity, *turning]}
            nodes.append(mbs.AddNode(ii.NodeRigidBodyEP(**state)))
        length = float(np.linalg.norm(np.subtract(end, start))) / n
        for pair in pairwise(nodes):
            mbs.AddObject(ii.ObjectBeamGeometricallyExact(nodeNumbers=list(pair), length=length, sectionData=data))
        return [mbs.AddMarker(ii.MarkerNodeRigid(nodeNumber=node)) for node in (nodes[0], nodes[-1])], nodes[-1]

    (a, b), _ = beam([0, 0, 0], [0, 0.12, 0], upright, 4, THICK, np.zeros(3), RATE)
    (b2, c), corner = beam([0, 0.12, 0], [0.24, 0.12, 0], straight, 8, THICK, np.zeros(3), 0.0)
    (d, c2), _ = beam([0.24, 0, 0], [0.24, 0.12, 0], upright, 4, THIN, np.array([0.24, 0, 0]), RATE)
    turning = tools.AngularVelocity2EulerParameters_t([0, 0, RATE], [1, 0, 0, 0])
    state = {"referenceCoordinates": [0, 0, 0, 1, 0, 0, 0], "initialVelocities": [0, 0, 0, *turning]}
    wheel_node = mbs.AddNode(ii.NodeRigidBodyEP(**state))
    wheel = mbs.AddObject(ii.ObjectRigidBody(mass=1.0, inertia=[1e7, 1e7, 1e7, 0, 0, 0], nodeNumber=wheel_node))
    ground = mbs.AddObject(ii.ObjectGround())

    def at(body, place):
        return mbs.AddMarker(ii.MarkerBodyRigid(bodyNumber=body, localPosition=place))

    def hinge(one, other, first=straight, second=straight):
        mbs.AddObject(ii.RevoluteJointZ(markerNumbers=[one, other], rotationMarker0=first, rotationMarker1=second))

    hinge(at(ground, [0, 0, 0]), at(wheel, [0, 0, 0]))
    mbs.AddObject(ii.GenericJoint(markerNumbers=[at(wheel, [0, 0, 0]), a], rotationMarker0=upright))
    hinge(b, b2, upright.T)
    hinge(at(ground, [0.24, 0, 0]), d)
    tilted = tools.RotationMatrixY(np.deg2rad(5.0))  # its z axis is (sin 5°, 0, cos 5°)
    hinge(c, c2, tilted, upright.T @ tilted)
    kind = exu.OutputVariableType.Position
    sensor = mbs.AddSensor(ii.SensorNode(nodeNumber=corner, storeInternal=True, outputVariableType=kind))
    mbs.Assemble()
    return mbs, sensor, [container]


def march_twin(output: bool) -> tuple[float, Any]:
    """March the beams; return seconds, and times and places of C out of the plane [mm] if wanted."""
    exu, (mbs, sensor, _) = import_exudyn(), twin()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.active = output
    settings.solution.sensors.writePeriod = 0.02
    time = settings.timeIntegration
    time.endTime, time.numberOfSteps = DURATION, STEPS
    time.automaticStepSize = time.adaptiveStep = False
    time.generalizedAlpha.spectralRadius = 0.9
    time.newton.useModifiedNewton = True
    time.newton.relativeTolerance, time.newton.absoluteTolerance = 1e-8, 1e-10
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.parallel.numberOfThreads = 1
    with contextlib.redirect_stdout(io.StringIO()):
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha, showHints=False)
    seconds = mbs.sys["dynamicSolver"].timer.total
    return seconds, np.array(mbs.GetSensorStoredData(sensor)) if output else None


def main() -> None:
    """March both and write the table."""
    run = Pipeline(load_scene("four-bar"))
    method, times = next(iter(run.plans.values())).integrator, run.motion.times
    ours = min(method.march(run.system, *run.start, times).seconds for _ in range(REPEATS))
    _, found = march_twin(output=True)
    theirs = min(march_twin(output=False)[0] for _ in range(REPEATS))
    rows = [
        ("solid meshes, 8 modes a bar", ours, np.interp(TIMES, times, 1e3 * run.motion.tip_position[:, 2])),
        ("Exudyn, 16 exact beams", theirs, np.interp(TIMES, found[:, 0], 1e3 * found[:, 3])),
    ]
    with (HERE / "four_bar.csv").open("w", newline="", encoding="utf-8") as file:
        file.write(f"# {platform.machine()}, {platform.system()}, Python {platform.python_version()}\n")
        table = csv.writer(file, lineterminator="\n")
        table.writerow(("model", "seconds", *(f"c_at_{time:g}_s_mm" for time in TIMES), "largest_error"))
        for name, seconds, places in rows:
            error = np.abs(places / WANTED - 1).max()
            table.writerow((name, f"{seconds:.4g}", *(f"{z:.5g}" for z in places), f"{error:.2g}"))
            print(name, seconds, places, error)


if __name__ == "__main__":
    main()
