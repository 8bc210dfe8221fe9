"""Run time against error of mechanisms with loops, ours and Exudyn's, side by side in one process.

Run from the project's root: ``python benchmarks/exudyn_loops.py``; it needs ``pip install exudyn==1.13.6`` and writes
``loops.csv`` beside itself.

- ``double-four-bar``: rigid bars in the plane through singular positions. The reference is the motion of parallel
  cranks, one equation.
- ``bricard``: a spatial loop with a redundant constraint; Exudyn has Euler parameters and its dense solver there, which
  has to ignore the singular Jacobian.
- ``slider-crank``: the model's rod, our mesh matrices and its four joint-conforming modes in an
  ``ObjectFFRFreducedOrder`` (see `exudyn_chains`), both sides without geometric stiffening.

The error is that of a point's path in space over the duration, of the slider-crank that of the rod's modes, relative to
the largest value. Exudyn's solvers have Newton's tolerance 1e-8, one thread, nothing written. Each time is the least of
five.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from exudyn_chains import flexible, hold, point
from exudyn_march import (
    IMPLICIT,
    REPEATS,
    Twin,
    add_sensor,
    import_exudyn,
    refine,
    relative_error,
    sample_times,
)
from few_modes import few_modes
from scipy.integrate import solve_ivp
from table_format import machine, write_rows

from fmd import Pipeline, load_scene
from fmd.core.errors import AccuracyError
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.rosenbrock import ExponentialRosenbrock
from fmd.integrators.runge_kutta import RungeKutta
from fmd.recovery.motion import Motion

HERE = Path(__file__).parent
MOST_SECONDS, FINEST = 10.0, 1e-8
COARSEST, HALVINGS = 100, 14
TOLERANCES = tuple(10.0**-k for k in np.arange(3.0, 12.0, 0.5))
FIELDS = ("scene", "integrator", "step_s", "seconds", "error", "evaluations")


@dataclass
class Case:
    """A scene, what is compared of its motion, its reference, and its twin."""

    scene: str
    overrides: tuple[str, ...]
    figures: Callable[[Motion], Any]
    exact: Callable[[Pipeline], Any]
    build: Callable[[Pipeline], Twin]


def parallel_cranks(_: Pipeline) -> Any:
    """Return the path of the first crank's end: all cranks stay parallel, 3 θ̈ = -3.5 · 9.81 cos θ."""

    def rates(_: float, y: Any) -> list[float]:
        return [y[1], -3.5 * 9.81 / 3.0 * math.cos(y[0])]

    times = sample_times(10.0)
    angle = solve_ivp(rates, (0.0, 10.0), [math.pi / 2, -1.0], "DOP853", times, rtol=1e-13, atol=1e-13).y[0]
    return np.c_[np.cos(angle), np.sin(angle), 0.0 * angle]


def finest(figures: Callable[[Motion], Any]) -> Callable[[Pipeline], Any]:
    """Return the reference of the finest Runge-Kutta march."""
    return lambda run: figures(march_ours(run, RungeKutta(1e-13))[1])


def march_ours(run: Pipeline, method: Any) -> tuple[Any, Motion]:
    """March by a method of ours; return the trajectory and the motion."""
    times = sample_times(run.scene.simulation.duration)
    trajectory = method.march(run.system, *run.start, times)
    return trajectory, Motion(run.mechanism, trajectory, run.scene.simulation.tip)


def path(motion: Motion) -> Any:
    return motion.tip_position


def rod_modes(motion: Motion) -> Any:
    return motion.modal("rod")


def twin_four_bar(_: Pipeline) -> Twin:
    exu = import_exudyn()
    ii, container = exu.itemInterface, exu.SystemContainer()
    mbs = container.AddSystem()
    ground = mbs.AddObject(ii.ObjectGround())

    def at(body, x):
        return mbs.AddMarker(ii.MarkerBodyPosition(bodyNumber=body, localPosition=[x, 0, 0]))

    def rod(x, y, angle, velocity):
        place, rates = [x, y, angle], list(velocity)
        node = mbs.AddNode(ii.NodeRigidBody2D(referenceCoordinates=place, initialVelocities=rates))
        body = mbs.AddObject(ii.ObjectRigidBody2D(mass=1.0, inertia=1 / 12, nodeNumber=node))
        mass = mbs.AddMarker(ii.MarkerBodyMass(bodyNumber=body))
        mbs.AddLoad(ii.LoadMassProportional(markerNumber=mass, loadVector=[0, -9.81, 0]))
        return at(body, -0.5), at(body, 0.5), node

    cranks = [rod(x, 0.5, math.pi / 2, (0.5, 0.0, -1.0)) for x in (0.0, 1.0, 2.0)]
    couplers = [rod(x, 1.0, 0.0, (1.0, 0.0, 0.0)) for x in (0.5, 1.5)]
    pairs = [(at(ground, float(k)), cranks[k][0]) for k in range(3)]
    pairs += [(cranks[0][1], couplers[0][0]), (cranks[1][1], couplers[0][1])]
    pairs += [(cranks[1][1], couplers[1][0]), (cranks[2][1], couplers[1][1])]
    for pair in pairs:
        mbs.AddObject(ii.RevoluteJoint2D(markerNumbers=list(pair)))
    sensors = [add_sensor(mbs, cranks[0][2], "Position")]
    mbs.Assemble()
    return Twin(mbs, sensors, lambda samples: 2.0 * samples[0] * [1.0, 1.0, 0.0], [container])


def twin_bricard(_: Pipeline) -> Twin:
    exu = import_exudyn()
    ii, container, (X, Y, Z) = exu.itemInterface, exu.SystemContainer(), np.eye(3)
    mbs = container.AddSystem()
    ends = np.array([[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1.0]])
    bodies = []
    for k in range(5):
        along, centre = ends[k + 1] - ends[k], 0.5 * (ends[k] + ends[k + 1])
        inertia = (1.0 - along**2) / 12
        reference = {"referenceCoordinates": [*centre, 1, 0, 0, 0], "initialVelocities": [0.0] * 7}
        node = mbs.AddNode(ii.NodeRigidBodyEP(**reference))
        body = mbs.AddObject(ii.ObjectRigidBody(mass=1.0, inertia=[*inertia, 0, 0, 0], nodeNumber=node))
        mass = mbs.AddMarker(ii.MarkerBodyMass(bodyNumber=body))
        mbs.AddLoad(ii.LoadMassProportional(markerNumber=mass, loadVector=[0, -9.81, 0]))
        bodies.append((body, along))

    def at(body, place):
        return mbs.AddMarker(ii.MarkerBodyRigid(bodyNumber=body, localPosition=list(place)))

    ground = mbs.AddObject(ii.ObjectGround())
    places = [(at(ground, ends[0]), at(bodies[0][0], -0.5 * bodies[0][1]))]
    for (one, along), (other, ahead) in pairwise(bodies):
        places.append((at(one, 0.5 * along), at(other, -0.5 * ahead)))
    places.append((at(bodies[4][0], 0.5 * bodies[4][1]), at(ground, ends[5])))
    for pair, z in zip(places, (Y, Z, X, Y, Z, X), strict=True):
        x = np.roll(z, 1)
        turned = np.c_[x, np.cross(z, x), z]
        mbs.AddObject(ii.RevoluteJointZ(markerNumbers=list(pair), rotationMarker0=turned, rotationMarker1=turned))
    kind = exu.OutputVariableType.Position
    tip = {"bodyNumber": bodies[2][0], "localPosition": list(0.5 * bodies[2][1])}
    sensor = mbs.AddSensor(ii.SensorBody(**tip, storeInternal=True, outputVariableType=kind))
    mbs.Assemble()
    return Twin(mbs, [sensor], lambda samples: samples[0], [container], dense=True)


def twin_slider_crank(run: Pipeline) -> Twin:
    exu = import_exudyn()
    ii, container = exu.itemInterface, exu.SystemContainer()
    mbs, keep = container.AddSystem(), [container]
    crank = {"referenceCoordinates": [0.075, 0, 0], "initialVelocities": [0.0, 11.25, 150.0]}
    crank_node = mbs.AddNode(ii.NodeRigidBody2D(**crank))
    crank_body = mbs.AddObject(ii.ObjectRigidBody2D(mass=0.36, inertia=0.36 * 0.15**2 / 12, nodeNumber=crank_node))
    part, start = run.parts["rod"], {"velocity": [0.0, 22.5, 0.0], "spin": [0.0, 0.0, -75.0]}
    rod = flexible(mbs, part.fe, run.bodies["rod"], 0.01, ["slider"], [0.15, 0, 0], np.eye(3), **start)
    slider_node = mbs.AddNode(ii.NodePoint2D(referenceCoordinates=[0.45, 0]))
    slider = mbs.AddObject(ii.ObjectMassPoint2D(physicsMass=0.075552, nodeNumber=slider_node))

    def place(number, x):
        return mbs.AddMarker(ii.MarkerBodyPosition(bodyNumber=number, localPosition=[x, 0, 0]))

    ground = place(mbs.AddObject(ii.ObjectGround()), 0.0)
    frame = mbs.AddMarker(ii.MarkerNodePosition(nodeNumber=rod["frame"]))
    end = point(mbs, rod, rod["slider"])
    for pair in ([ground, place(crank_body, -0.075)], [place(crank_body, 0.075), frame], [end, place(slider, 0.0)]):
        mbs.AddObject(ii.RevoluteJoint2D(markerNumbers=pair))
    hold(mbs, rod["frame"], (2, 3, 4))
    hold(mbs, slider_node, (1,))

    def angle(mbs, t, item, offset):  # Exudyn counts the arguments
        return 150.0 * t

    create = exu.advancedUtilities.CreateSymbolicUserFunction
    keep.append(create(mbs, angle, "offsetUserFunction", itemTypeName="ObjectConnectorCoordinate"))
    still = mbs.AddMarker(ii.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(ii.NodePointGround()), coordinate=0))
    turning = mbs.AddMarker(ii.MarkerNodeCoordinate(nodeNumber=crank_node, coordinate=2))
    mbs.AddObject(ii.CoordinateConstraint(markerNumbers=[still, turning], offsetUserFunction=keep[-1]))
    sensors = [add_sensor(mbs, rod["modes"], "Coordinates")]
    mbs.Assemble()
    return Twin(mbs, sensors, lambda samples: samples[0], keep)


def ours(run: Pipeline, case: Case, wanted: Any) -> Iterator[tuple[Any, ...]]:
    """March by our methods, coarse to fine."""
    duration = run.scene.simulation.duration
    steps = [duration / (COARSEST * 2.0**k) for k in range(HALVINGS)]
    series = [(RungeKutta, TOLERANCES), (ExponentialRosenbrock, TOLERANCES[2:11])]
    series += [(kind, steps) for kind in (CentralDifference, GeneralizedAlpha)]
    for kind, settings in series:
        for setting in settings:
            method = kind(float(setting))
            try:
                trajectory, motion = march_ours(run, method)
            except AccuracyError:  # diverged, or nothing that converged: nothing to compare at this step
                continue
            error = relative_error(wanted)(case.figures(motion))
            if not error < 1.0:
                continue
            seconds = min(march_ours(run, method)[0].seconds for _ in range(REPEATS))
            yield method.name, trajectory.step, seconds, error, trajectory.evaluations
            if seconds > 0.1 * MOST_SECONDS or error < FINEST:
                break


def peers(run: Pipeline, case: Case, wanted: Any) -> Iterator[tuple[Any, ...]]:
    """March by Exudyn's solvers, coarse to fine."""
    duration, counts, error = (
        run.scene.simulation.duration,
        [COARSEST * 2**k for k in range(HALVINGS)],
        relative_error(wanted),
    )
    for solver in IMPLICIT:
        for row in refine(case.build(run), duration, solver, counts, error, FINEST, MOST_SECONDS):
            yield row.integrator, row.step_s, row.seconds, row.error, row.evaluations


CASES = {
    "double-four-bar": Case(str(HERE / "scenes" / "double-four-bar.toml"), (), path, parallel_cranks, twin_four_bar),
    "bricard": Case(str(HERE / "scenes" / "bricard.toml"), (), path, finest(path), twin_bricard),
    "slider-crank": Case(
        "slider-crank",
        (*few_modes("slider-crank"), "simulation.stiffening=off"),
        rod_modes,
        finest(rod_modes),
        twin_slider_crank,
    ),
}


def main() -> None:
    """Measure all cases and write the table."""
    rows = []
    for name, case in CASES.items():
        run = Pipeline(load_scene(case.scene, list(case.overrides)))
        wanted = case.exact(run)
        for program in (ours, peers):
            for figures in program(run, case, wanted):
                print(name, *figures, flush=True)
                rows.append(dict(zip(FIELDS, (name, *figures), strict=True)))
    write_rows(HERE / "loops.csv", rows, machine(), digits=4)


if __name__ == "__main__":
    main()
