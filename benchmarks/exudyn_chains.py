"""Exudyn's twins of the arm and of the spatial robot: chains of floating frames on the same meshes, modes and loads.

`work_precision.py` and ``fmd bench --peer`` ask for their rows; it needs ``pip install exudyn==1.13.6``.

A flexible body is an ``ObjectFFRFreducedOrder`` with our mesh matrices and joint-conforming modes. Four massless mesh
nodes about each marker, and one that moves as the centre of mass, carry the marker's shapes exactly, so joints, springs
and weight act on the modes as ours do. Hinges are held by constraints; the robot's second link has Euler parameters,
the first one stays with Euler angles. The springs of the arm's joints are linear in sections' angles, and are objects
on the coordinates themselves, at half the time of its torsional springs. Solvers and settings are the fastest that were
found for the same error: generalised-α with modified Newton to 1e-8, a Jacobian a step. Its explicit solvers know no
constraints, so the chains have none. Its floating frames know no geometric stiffening, so our side goes without, too:
that moves the arm's tip by 4e-7 of its way. The robot stays 1.3e-5 from ours, because of Exudyn's marker on a section:
a torque acts on the modes as if the section's own axes were the frame's.
"""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from exudyn_march import IMPLICIT, Twin, add_sensor, import_exudyn, refine, relative_error, sample_times
from few_modes import few_modes

from fmd import Pipeline, load_scene
from fmd.integrators.runge_kutta import RungeKutta
from fmd.output.work_precision import WorkPrecisionRow
from fmd.recovery.motion import Motion

HERE = Path(__file__).parent
CORNERS = 0.02 * np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, -1, -1.0]])  # of a marker's nodes, which average to it
FINEST, MOST_SECONDS = 1e-8, 2.0
COUNTS = [100 * 2**k for k in range(11)]


def flexible(
    mbs,
    fe,
    body,
    damping,
    markers,
    position,
    rotation,
    kind="NodeType.RotationRxyz",
    velocity=(0, 0, 0),
    spin=(0, 0, 0),
):
    """Add a flexible body; return its object, nodes, and the virtual nodes of each marker."""
    exu = import_exudyn()
    n, n_modes = len(body.x), body.shapes.shape[-1]
    x, shapes, nodes = [body.x], [body.shapes], {}
    for name in markers:
        marker = body.markers[name]
        nodes[name] = list(range(n, n + 4))
        n += 4
        for corner in CORNERS:
            x.append((marker.position + corner)[None])
            shapes.append((marker.translation + np.cross(marker.rotation.T, corner).T)[None])
    mass_row = body.integrals.S
    nodes["centre"] = n
    n += 1
    x.append((mass_row[:, 0] / body.integrals.mass)[None])
    shapes.append((mass_row[:, 1:] / body.integrals.mass)[None])
    all_x, all_shapes, more = np.concatenate(x), np.concatenate(shapes), 3 * (n - len(body.x))

    def padded(A):
        return sp.csr_matrix(sp.block_diag([sp.csr_matrix(A), sp.csr_matrix((more, more))]))

    fem = exu.FEM.FEMinterface()
    fem.nodes, fem.massMatrix, fem.stiffnessMatrix = {"Position": all_x}, padded(fe.M), padded(fe.K)
    matrix = np.ascontiguousarray(all_shapes.reshape(3 * n, n_modes))
    fem.modeBasis = {"matrix": matrix, "type": "NormalModes"}
    reduced = exu.FEM.ObjectFFRFreducedOrderInterface(fem, kind)
    reduced.stiffnessMatrixReduced, reduced.massMatrixReduced = np.diag(body.omega**2), np.eye(n_modes)
    moving = {"initialAngularVelocity": list(spin), "initialVelocity": list(velocity)}
    made = reduced.AddObjectFFRFreducedOrder(mbs, positionRef=list(position), rotationMatrixRef=rotation, **moving)
    D = exu.MatrixContainer()
    D.SetWithDenseMatrix(np.diag(2 * damping * body.omega), useDenseMatrix=False)
    mbs.SetObjectParameter(made["oFFRFreducedOrder"], "dampingMatrixReduced", D)
    return {"object": made["oFFRFreducedOrder"], "frame": made["nRigidBody"], "modes": made["nGenericODE2"], **nodes}


def section(mbs, body, name):
    """Add a marker that moves and turns as a section does."""
    ii = import_exudyn().itemInterface
    return mbs.AddMarker(
        ii.MarkerSuperElementRigid(
            bodyNumber=body["object"],
            meshNodeNumbers=body[name],
            weightingFactors=[0.25] * 4,
            useAlternativeApproach=True,
            rotationsExponentialMap=2,
        )
    )


def point(mbs, body, nodes):
    """Add a marker that moves as the mean of virtual nodes."""
    ii, weights = import_exudyn().itemInterface, [1 / len(nodes)] * len(nodes)
    return mbs.AddMarker(
        ii.MarkerSuperElementPosition(bodyNumber=body["object"], meshNodeNumbers=nodes, weightingFactors=weights)
    )


def add_weight(mbs, body, mass, g):
    ii = import_exudyn().itemInterface
    force = list(mass * np.array(g))
    mbs.AddLoad(ii.LoadForceVector(markerNumber=point(mbs, body, [body["centre"]]), loadVector=force))


def add_torques(mbs, levers, size, keep):
    """Add a torque ``size(t)`` times a lever on each coordinate (node, number)."""
    exu = import_exudyn()
    for (node, k), lever in levers.items():
        if abs(lever) < 1e-6:
            continue

        def make(lever):
            def load(mbs, t, load):  # Exudyn counts the arguments
                return lever * size(t)

            return load

        made = exu.advancedUtilities.CreateSymbolicUserFunction(
            mbs, make(float(lever)), "loadUserFunction", itemTypeName="LoadCoordinate"
        )
        keep.append(made)
        ii = exu.itemInterface
        marker = mbs.AddMarker(ii.MarkerNodeCoordinate(nodeNumber=node, coordinate=k))
        mbs.AddLoad(ii.LoadCoordinate(markerNumber=marker, loadUserFunction=made))


def hold(mbs, node, coordinates):
    """Hold coordinates of a node."""
    ii = import_exudyn().itemInterface
    ground = mbs.AddMarker(ii.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(ii.NodePointGround()), coordinate=0))
    for k in coordinates:
        marker = mbs.AddMarker(ii.MarkerNodeCoordinate(nodeNumber=node, coordinate=k))
        mbs.AddObject(ii.CoordinateConstraint(markerNumbers=[ground, marker]))


def arm(run) -> Twin:
    exu = import_exudyn()
    ii, symbolic, g, turned = (
        exu.itemInterface,
        exu.symbolic,
        [0, -9.81, 0],
        np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]),
    )
    body, container = run.bodies["forearm"], exu.SystemContainer()
    mbs, keep = container.AddSystem(), [container]

    def rigid(y, mass, inertia):
        node = mbs.AddNode(ii.NodeRigidBody2D(referenceCoordinates=[0, y, -math.pi / 2]))
        return node, mbs.AddObject(ii.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node))

    def place(number, x):
        return mbs.AddMarker(ii.MarkerBodyPosition(bodyNumber=number, localPosition=[x, 0, 0]))

    ground = place(mbs.AddObject(ii.ObjectGround()), 0.0)
    upper_node, upper = rigid(-0.25, 1.5, 1.5 * 0.25 / 12)
    forearm = flexible(mbs, run.parts["forearm"].fe, body, 0.002, ["wrist"], [0, -0.5, 0], turned)
    frame = mbs.AddMarker(ii.MarkerNodePosition(nodeNumber=forearm["frame"]))
    wrist = point(mbs, forearm, forearm["wrist"])
    gripper_node, gripper = rigid(-1.16, 0.4, 6e-4)
    for pair in ([ground, place(upper, -0.25)], [place(upper, 0.25), frame], [wrist, place(gripper, -0.06)]):
        mbs.AddObject(ii.RevoluteJoint2D(markerNumbers=pair))
    hold(mbs, forearm["frame"], (2, 3, 4))
    add_weight(mbs, forearm, body.integrals.mass, g)
    for number in (upper, gripper):
        marker = mbs.AddMarker(ii.MarkerBodyMass(bodyNumber=number))
        mbs.AddLoad(ii.LoadMassProportional(markerNumber=marker, loadVector=g))
    add_torques(mbs, {(upper_node, 2): 1.0}, lambda t: 12.0 * symbolic.sin(2 * math.pi * t), keep)
    at_elbow, at_wrist = body.joint_rotation, body.axis @ body.markers["wrist"].rotation

    def spring(nodes, grip, stiffness, damping):
        def matrix(factor):
            made = exu.MatrixContainer()
            made.SetWithDenseMatrix(factor * np.outer(grip, grip), useDenseMatrix=True)
            return made

        matrices = {"massMatrix": matrix(0.0), "stiffnessMatrix": matrix(stiffness), "dampingMatrix": matrix(damping)}
        mbs.AddObject(ii.ObjectGenericODE2(nodeNumbers=nodes, **matrices))

    bent = [forearm["frame"], forearm["modes"]]
    spring([upper_node, *bent], np.r_[0, 0, -1, 0, 0, 0, 0, 0, 1, at_elbow], 60.0, 0.2)
    spring([*bent, gripper_node], np.r_[0, 0, 0, 0, 0, -1, -at_wrist, 0, 0, 1], 20.0, 0.02)
    sensors = [add_sensor(mbs, forearm[name], "Coordinates") for name in ("frame", "modes")]
    mbs.Assemble()
    marker = body.markers["wrist"]

    def tip(samples):
        pose, q = samples
        r, angle = marker.position + q @ marker.translation.T, pose[:, 5] - math.pi / 2
        c, s = np.cos(angle), np.sin(angle)
        turned = [c * r[:, 0] - s * r[:, 1], s * r[:, 0] + c * r[:, 1], r[:, 2]]
        return np.c_[pose[:, 0], pose[:, 1] - 0.5, pose[:, 2]] + np.transpose(turned)

    return Twin(mbs, sensors, tip, keep)


def robot(run) -> Twin:
    exu, axis = import_exudyn(), (0.0, 0.8, 0.6)  # of the elbow
    ii, symbolic, g, straight = exu.itemInterface, exu.symbolic, run.scene.simulation.gravity, np.eye(3)
    container = exu.SystemContainer()
    mbs, keep = container.AddSystem(), [container]
    first, second = run.bodies["one"], run.bodies["two"]
    one = flexible(mbs, run.parts["one"].fe, first, 0.005, ["end"], [0, 0, 0], straight)
    kind = "NodeType.RotationEulerParameters"
    two = flexible(mbs, run.parts["two"].fe, second, 0.005, ["base", "end"], [0.4, 0, 0], straight, kind)
    node = mbs.AddNode(ii.NodeRigidBodyRxyz(referenceCoordinates=[0.83, 0, 0, 0, 0, 0]))
    payload = mbs.AddObject(ii.ObjectRigidBody(mass=1.0, inertia=[8e-4, 6e-4, 5e-4, 0, 0, 0], nodeNumber=node))
    hold(mbs, one["frame"], range(5))
    R = np.c_[[1, 0, 0], np.cross(axis, [1, 0, 0]), axis]
    turned = {"rotationMarker0": R, "rotationMarker1": R}
    end = section(mbs, one, "end")
    frame = mbs.AddMarker(ii.MarkerNodeRigid(nodeNumber=two["frame"]))
    mbs.AddObject(ii.RevoluteJointZ(markerNumbers=[end, frame], **turned))
    ends = [end, section(mbs, two, "base")]
    mbs.AddObject(ii.TorsionalSpringDamper(markerNumbers=ends, stiffness=60.0, damping=0.3, **turned))
    flange = mbs.AddMarker(ii.MarkerBodyRigid(bodyNumber=payload, localPosition=[-0.03, 0, 0]))
    mbs.AddObject(ii.GenericJoint(markerNumbers=[section(mbs, two, "end"), flange], constrainedAxes=[1] * 6))
    for made, body in ((one, first), (two, second)):
        add_weight(mbs, made, body.integrals.mass, g)
    marker = mbs.AddMarker(ii.MarkerBodyMass(bodyNumber=payload))
    mbs.AddLoad(ii.LoadMassProportional(markerNumber=marker, loadVector=g))
    levers = {(one["frame"], 5): 1.0} | {(one["modes"], k): x for k, x in enumerate(first.joint_rotation)}
    add_torques(mbs, levers, lambda t: 20.0 * symbolic.sin(2 * math.pi * t), keep)
    kinds = (("frame", "Position"), ("frame", "RotationMatrix"), ("modes", "Coordinates"))
    sensors = [add_sensor(mbs, two[name], kind) for name, kind in kinds]
    mbs.Assemble()
    marker = second.markers["end"]

    def tip(samples):
        origin, rotation, q = samples
        r = marker.position + q @ marker.translation.T
        return origin + np.einsum("tij,tj->ti", rotation.reshape(-1, 3, 3), r)

    return Twin(mbs, sensors, tip, keep)


CASES = {"arm": ("arm", arm), "robot": (str(HERE / "scenes" / "robot.toml"), robot)}


def prepare(name: str) -> tuple[Pipeline, Callable[[Any], float]]:
    """Return a chain's scene as Exudyn has it, without geometric stiffening, and the error of its tip's positions."""
    run = Pipeline(load_scene(CASES[name][0], [*few_modes(name), "simulation.stiffening=off"]))
    exact = RungeKutta(1e-13).march(run.system, *run.start, sample_times(run.scene.simulation.duration))
    return run, relative_error(Motion(run.mechanism, exact, run.scene.simulation.tip).tip_position)


def measure(name: str) -> Iterator[WorkPrecisionRow]:
    """March a chain by Exudyn's solvers, coarse to fine, timed as our own benchmark does it."""
    import_exudyn()  # before the reference takes its time
    run, error = prepare(name)
    for solver in IMPLICIT:
        yield from refine(
            CASES[name][1](run), run.scene.simulation.duration, solver, COUNTS, error, FINEST, MOST_SECONDS
        )
