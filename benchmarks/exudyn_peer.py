"""Exudyn's floating frame beside ours: run time against error on the same mesh, modes and loads.

`work_precision.py` and ``fmd bench --peer`` ask for its rows; it needs ``pip install exudyn==1.13.6``.

- ``beam``, also with 20 and 60 modes: our matrices and joint-conforming modes in Exudyn's
  ``ObjectFFRFreducedOrder``; the torque acts on the
  frame's angle and, by the rotation of the section at the joint, on each mode, as in our own equations.
- ``rod-slider``: joint coordinates, by ``ObjectKinematicTree``.

Exudyn's settings are the fastest that were found for the same error: its module without range checks; symbolic load
functions, which spare it the calls to Python; Euler angles held by coordinate constraints, at half the time of Euler
parameters and a revolute joint; modified Newton to 1e-5 with one Jacobian a march (one a step for the rod and slider,
whose inertia changes); ρ∞ = 0.95; one thread, nothing written. Its explicit solvers know no constraints: a bearing of
very large mass on the frame's own node holds it for them, and changes the motion by less than 1e-9 of itself. Seconds
are those of Exudyn's own timer around the solver.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from exudyn_march import IMPLICIT, INTERVALS, STAGES, Twin, add_sensor, import_exudyn, refine, sample_times

from fmd import Pipeline, load_scene
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.output.work_precision import WorkPrecisionRow

MOST_SECONDS = 2.0  # a march longer than this, or of an error below the other, ends its solver's range
FINEST = 1e-9
COUNTS = [INTERVALS * 2**k for k in range(14)]
BEARING = 1e11  # a bearing's mass over the body's


@dataclass
class Case:
    """What is solved: ``build(explicit)`` gives the peer, ``error`` is that of samples (INTERVALS + 1, n)."""

    duration: float
    build: Callable[[bool], Twin]
    error: Callable[[Any], float]


def floating_frame(x, K, M, shapes, explicit, loads) -> Twin:
    """Put a body on an axis along z through its origin.

    ``loads``, functions of time, are the torque on the frame and each mode's generalised force.
    """
    exu = import_exudyn()
    ii, symbolic = exu.itemInterface, exu.advancedUtilities.CreateSymbolicUserFunction
    fem = exu.FEM.FEMinterface()
    fem.nodes, fem.massMatrix, fem.stiffnessMatrix = {"Position": np.array(x)}, M, K
    fem.modeBasis = {"matrix": np.ascontiguousarray(shapes.reshape(3 * len(x), -1)), "type": "NormalModes"}
    keep = [exu.SystemContainer()]
    mbs = keep[0].AddSystem()
    body = exu.FEM.ObjectFFRFreducedOrderInterface(fem, "NodeType.RotationRxyz").AddObjectFFRFreducedOrder(mbs)
    frame, modes = body["nRigidBody"], body["nGenericODE2"]

    def coordinate(node, k):
        return mbs.AddMarker(ii.MarkerNodeCoordinate(nodeNumber=node, coordinate=k))

    def load_function(of_time):
        def load(mbs, t, load):  # Exudyn counts the arguments
            return of_time(t)

        keep.append(symbolic(mbs, load, "loadUserFunction", itemTypeName="LoadCoordinate"))
        return keep[-1]

    for k, load in enumerate(loads):
        marker = coordinate(modes, k - 1) if k else coordinate(frame, 5)
        mbs.AddLoad(ii.LoadCoordinate(markerNumber=marker, loadUserFunction=load_function(load)))
    if explicit:
        heavy = BEARING * M.sum() / 3
        inertia = [heavy, heavy, 0.0, 0.0, 0.0, 0.0]
        mbs.AddObject(ii.ObjectRigidBody(mass=heavy, inertia=inertia, nodeNumber=frame))
    else:
        ground = coordinate(mbs.AddNode(ii.NodePointGround()), 0)
        for k in range(5):
            mbs.AddObject(ii.CoordinateConstraint(markerNumbers=[ground, coordinate(frame, k)]))
    return assembled(mbs, modes, keep)


def assembled(mbs, node, keep, jacobian_each_step=False) -> Twin:
    sensors = [add_sensor(mbs, node, "Coordinates")]
    mbs.Assemble()
    return Twin(mbs, sensors, lambda samples: samples[0], keep, 1e-5, jacobian_each_step)


def deflection_error(across, exact):
    wanted = exact @ across
    return lambda q: float(np.abs(q @ across - wanted).max() / np.abs(wanted).max())


def beam(count: int = 5) -> Case:
    run = Pipeline(load_scene("beam-paper", [f"body.beam.modes.count={count}"]))
    body, torque, (q0, v0), simulation = run.body, run.mechanism.links[0].load, run.start, run.scene.simulation
    first, last = torque.terms[0].support
    peak, _, _ = torque.value(0.5 * (first + last))
    exact = ScipyIvp("DOP853", 1e-12).march(run.system, q0, v0, sample_times(simulation.duration)).q[:, 1:]
    tip = body.markers[simulation.tip.partition(".")[2]]
    arm = np.cross(body.axis, tip.position)
    length = np.linalg.norm(arm)

    def build(explicit):
        esym = import_exudyn().symbolic
        zero = esym.Real(0.0)

        def half_sine(size):
            def load(t):
                size_now = size * esym.sin(math.pi / (last - first) * (t - first))
                return esym.IfThenElse(t < first, zero, esym.IfThenElse(t < last, size_now, zero))

            return load

        loads = [half_sine(peak * lever) for lever in (1.0, *body.joint_rotation)]
        return floating_frame(body.x, run.fe.K, run.fe.M, body.shapes, explicit, loads)

    across = arm @ tip.translation / length - length * body.joint_rotation
    return Case(simulation.duration, build, deflection_error(across, exact))


def rod_slider() -> Case:
    run = Pipeline(load_scene("rod-slider"))
    scene, duration = run.scene, run.scene.simulation.duration
    exact = ScipyIvp("DOP853", 1e-12).march(run.system, *run.start, sample_times(duration)).q

    def tip(q):
        return (float(scene.body["rod"].marker["rest"].at[0]) + q[:, 1]) * np.exp(1j * q[:, 0])

    build = partial(rod_slider_twin, run, scene.joint["slide"].spring)
    return Case(duration, lambda _: build(), lambda q: float(np.abs(tip(q) - tip(exact)).max()))


def rod_slider_twin(run: Pipeline, spring: float) -> Twin:
    """Build the rod and slider with a spring [N/m]; joint coordinates know no constraints."""
    exu, scene, (q0, v0) = import_exudyn(), run.scene, run.start
    rod, slider, slide, motor = scene.body["rod"], scene.body["slider"], scene.joint["slide"], scene.drive["motor"]
    ii, across, zeros = exu.itemInterface, rod.mass * rod.length**2 / 12, np.zeros(3)
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    start = {"initialCoordinates": q0, "initialCoordinates_t": v0}
    node = mbs.AddNode(ii.NodeGenericODE2(referenceCoordinates=np.zeros(2), numberOfODE2Coordinates=2, **start))
    tree = ii.ObjectKinematicTree(
        nodeNumber=node,
        jointTypes=[exu.JointType.RevoluteZ, exu.JointType.PrismaticX],
        linkParents=[-1, 0],
        jointTransformations=exu.Matrix3DList([np.eye(3), np.eye(3)]),
        jointOffsets=exu.Vector3DList([zeros, [float(rod.marker["rest"].at[0]), 0.0, 0.0]]),
        linkInertiasCOM=exu.Matrix3DList([np.diag([0.0, across, across]), np.zeros((3, 3))]),
        linkCOMs=exu.Vector3DList([[rod.length / 2, 0.0, 0.0], zeros]),
        linkMasses=[rod.mass, slider.mass],
        jointForceVector=[motor.torque.constant, 0.0],
        jointPositionOffsetVector=[0.0, slide.rest],
        jointPControlVector=[0.0, spring],
    )
    mbs.AddObject(tree)
    return assembled(mbs, node, [container], jacobian_each_step=True)


CASES: dict[str, Callable[[], Case]] = {
    "beam": beam,
    "beam-20-modes": lambda: beam(20),
    "beam-60-modes": lambda: beam(60),
    "rod-slider": rod_slider,
}


def measure(name: str) -> Iterator[WorkPrecisionRow]:
    """March a scene by each of Exudyn's solvers, coarse to fine, timed as our own benchmark does it."""
    import_exudyn()  # before the reference takes its time
    case = CASES[name]()
    for solver in (IMPLICIT[0], *STAGES):
        twin = case.build(solver in STAGES)
        yield from refine(twin, case.duration, solver, COUNTS, case.error, FINEST, MOST_SECONDS)
