"""Exudyn's floating frame beside ours: run time against error on the same mesh, modes and loads.

Run from the project's root: ``python benchmarks/exudyn_peer.py [SCENE]…``; it needs ``pip install exudyn==1.13.6``.

- ``beam``, also with 20 and 60 modes: our matrices and joint-conforming modes in Exudyn's
  ``ObjectFFRFreducedOrder``; the torque acts on the
  frame's angle and, by the rotation of the section at the joint, on each mode, as in our own equations.
- ``driven-bar``: a bar of 300 mm with its ten lowest hub-fixed modes; the hub's angle follows the law of Kane, Ryan &
  Banerjee (Journal of Guidance, Control, and Dynamics 10, 1987) to 100 rad/s within 50 ms.
- ``rod-slider``: joint coordinates, by ``ObjectKinematicTree``.

Exudyn's settings are the fastest that were found for the same error: its module without range checks; symbolic load
functions, which spare it the calls to Python; Euler angles held by coordinate constraints, at half the time of Euler
parameters and a revolute joint; modified Newton to 1e-5 with one Jacobian a march (one a step for the rod and slider,
whose inertia changes); ρ∞ = 0.95; one thread, nothing written. Its explicit solvers know no constraints: a bearing of
very large mass on the frame's own node holds it for them, and a flywheel of very large inertia drives the angle; both
change the motion by less than 1e-9 of itself. Seconds are those of Exudyn's own timer around the solver.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from exudyn_march import IMPLICIT, INTERVALS, STAGES, Twin, add_sensor, import_exudyn, print_rows, refine, sample_times
from scipy.integrate import solve_ivp
from scipy.sparse.linalg import eigsh

from fmd import Pipeline, load_scene
from fmd.fem.markers import face_marker
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.output.work_precision import WorkPrecisionRow
from fmd.reduction.inertia import inertia_gram

MOST_SECONDS = 2.0  # a march longer than this, or of an error below the other, ends its solver's range
FINEST = 1e-9
COUNTS = [INTERVALS * 2**k for k in range(14)]
BEARING = 1e11  # a bearing's mass and a flywheel's inertia over the body's mass


@dataclass
class Case:
    """What is solved: ``build(explicit)`` gives the peer, ``error`` is that of samples (INTERVALS + 1, n)."""

    duration: float
    build: Callable[[bool], Twin]
    error: Callable[[Any], float]


def floating_frame(x, K, M, shapes, explicit, loads, angle=None) -> Twin:
    """Put a body on an axis along z through its origin.

    ``loads``, functions of time, are the torque on the frame or flywheel and each mode's generalised force; ``angle``
    is the frame's prescribed angle.
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

    def offset(mbs, t, item, offset):
        return angle(t)

    for k, load in enumerate(loads):
        marker = coordinate(modes, k - 1) if k else coordinate(frame, 5)
        mbs.AddLoad(ii.LoadCoordinate(markerNumber=marker, loadUserFunction=load_function(load)))
    if explicit:
        heavy = BEARING * M.sum() / 3
        inertia = [heavy, heavy, heavy if angle else 0.0, 0.0, 0.0, 0.0]
        mbs.AddObject(ii.ObjectRigidBody(mass=heavy, inertia=inertia, nodeNumber=frame))
    else:
        ground = coordinate(mbs.AddNode(ii.NodePointGround()), 0)
        for k in range(5):
            mbs.AddObject(ii.CoordinateConstraint(markerNumbers=[ground, coordinate(frame, k)]))
        if angle:
            keep.append(symbolic(mbs, offset, "offsetUserFunction", itemTypeName="ObjectConnectorCoordinate"))
            markers = [ground, coordinate(frame, 5)]
            mbs.AddObject(ii.CoordinateConstraint(markerNumbers=markers, offsetUserFunction=keep[-1]))
    return assembled(mbs, modes, keep)


def assembled(mbs, node, keep, jacobian_each_step=False) -> Twin:
    sensors = [add_sensor(mbs, node, "Coordinates")]
    mbs.Assemble()
    return Twin(mbs, sensors, lambda samples: samples[0], keep, 1e-5, jacobian_each_step)


def deflection_error(across, exact):
    wanted = exact @ across
    return lambda q: float(np.abs(q @ across - wanted).max() / np.abs(wanted).max())


def beam(count: int = 5) -> Case:
    run = Pipeline(load_scene("beam", [f"body.beam.modes.count={count}"]))
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


def driven_bar() -> Case:
    Omega, T, duration, n = 100.0, 0.05, 0.1, 10
    sizes = ["length=300 mm", "E=72200 MPa", "rho=2000 kg/m^3"]
    run = Pipeline(load_scene("beam", [f"body.beam.{size}" for size in sizes]))
    fe = run.fe
    hub, tip = (face_marker(fe.discretisation, run.mesh.faces[name]) for name in ("x-", "x+"))
    free = np.setdiff1d(np.arange(3 * len(fe.x)), 3 * hub.nodes[:, None] + np.arange(3))
    K, M = (matrix[free][:, free].tocsc() for matrix in (fe.K, fe.M))
    shapes = np.zeros((3 * len(fe.x), n))
    omega2, shapes[free] = eigsh(K, n, M, sigma=0.0)
    shapes = shapes.reshape(len(fe.x), 3, n)
    x = fe.x - hub.position

    # The linear floating frame with its angle given: q̈ = θ̇² D p + 2 θ̇ A ṗ − ω² q − θ̈ H with p = (1, q).
    G = inertia_gram(x, fe.m, shapes).G
    D, A = G[0, 0] + G[1, 1], G[0, 1] - G[1, 0]

    def rates(t, y):
        p, v, s = np.r_[1.0, y[:n]], np.r_[0.0, y[n:]], 2 * math.pi * min(t / T, 1.0)
        rate, acceleration = Omega / (2 * math.pi) * (s - math.sin(s)), Omega / T * (1 - math.cos(s))
        return np.r_[y[n:], (rate**2 * D @ p + 2 * rate * A @ v - acceleration * p @ A)[1:] - omega2 * y[:n]]

    times, y, exact = sample_times(duration), np.zeros(2 * n), np.zeros((INTERVALS + 1, n))
    for inside in (times <= T, times >= T):  # the law's third derivative jumps at T
        span = times[inside]
        found = solve_ivp(rates, span[[0, -1]], y, "DOP853", t_eval=span, rtol=1e-12, atol=1e-18).y
        exact[inside], y = found[:n].T, found[:, -1]

    def build(explicit):
        esym, s, heavy = import_exudyn().symbolic, 2 * math.pi / T, BEARING * fe.mass

        def angle(t):
            spun = Omega / T * (0.5 * t * t + (esym.cos(s * t) - 1.0) / s**2)
            return esym.IfThenElse(t < T, spun, Omega * (t - 0.5 * T))

        def torque(t):
            return esym.IfThenElse(t < T, heavy * Omega / T * (1.0 - esym.cos(s * t)), esym.Real(0.0))

        return floating_frame(x, fe.K, fe.M, shapes, explicit, [torque] if explicit else [], angle)

    return Case(duration, build, deflection_error(tip.translation(shapes)[1], exact))


def rod_slider() -> Case:
    run = Pipeline(load_scene("rod-slider"))
    scene, (q0, v0) = run.scene, run.start
    rod, slider, slide, motor = scene.body["rod"], scene.body["slider"], scene.joint["slide"], scene.drive["motor"]
    rest, duration = float(rod.marker["rest"].at[0]), scene.simulation.duration
    exact = ScipyIvp("DOP853", 1e-12).march(run.system, q0, v0, sample_times(duration)).q

    def build(_):  # joint coordinates know no constraints
        exu = import_exudyn()
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
            jointOffsets=exu.Vector3DList([zeros, [rest, 0.0, 0.0]]),
            linkInertiasCOM=exu.Matrix3DList([np.diag([0.0, across, across]), np.zeros((3, 3))]),
            linkCOMs=exu.Vector3DList([[rod.length / 2, 0.0, 0.0], zeros]),
            linkMasses=[rod.mass, slider.mass],
            jointForceVector=[motor.torque.constant, 0.0],
            jointPositionOffsetVector=[0.0, slide.rest],
            jointPControlVector=[0.0, slide.spring],
        )
        mbs.AddObject(tree)
        return assembled(mbs, node, [container], jacobian_each_step=True)

    def tip(q):
        return (rest + q[:, 1]) * np.exp(1j * q[:, 0])

    return Case(duration, build, lambda q: float(np.abs(tip(q) - tip(exact)).max()))


CASES: dict[str, Callable[[], Case]] = {
    "beam": beam,
    "beam-20-modes": lambda: beam(20),
    "beam-60-modes": lambda: beam(60),
    "driven-bar": driven_bar,
    "rod-slider": rod_slider,
}


def measure(case: Case) -> Iterator[WorkPrecisionRow]:
    """March a case by each of Exudyn's solvers, coarse to fine, timed as our own benchmark does it."""
    for solver in (IMPLICIT[0], *STAGES):
        twin = case.build(solver in STAGES)
        yield from refine(twin, case.duration, solver, COUNTS, case.error, FINEST, MOST_SECONDS)


def peer_rows(scene_name: str) -> list[WorkPrecisionRow]:
    """Return the rows of Exudyn's solvers on a scene, to stand beside our own.

    Raises
    ------
    ModuleNotFoundError
        Exudyn isn't installed.
    ValueError
        The scene has no peer.
    """
    if scene_name not in CASES:
        raise ValueError(f"scene is {scene_name!r}, Exudyn is the peer of {', '.join(CASES)}")
    import_exudyn()  # before the reference takes its time
    return list(measure(CASES[scene_name]()))


if __name__ == "__main__":
    for name in sys.argv[1:] or CASES:
        print_rows(name, peer_rows(name))
