"""One flexible body on a hinge as a system that integrators march, its energies and its angular momentum."""

from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.links import Link
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import Signal, constant
from fmd.integrators.protocol import Trajectory
from fmd.reduction.body import FlexibleBody
from fmd.scene.joints.revolute import REVOLUTE


def hinged(body: FlexibleBody | Link, load: Signal | None = None) -> CompiledSystem:
    """Make the system of one body on a hinge to the ground, whose torque is ``load``; none by default."""
    torque = load or constant(0.0)
    if isinstance(body, Link):
        return CompiledSystem(Mechanism([replace(body, load=torque)]))
    inertia = {"integrals": body.integrals, "omega": body.omega, "joint_rotation": body.joint_rotation}
    return CompiledSystem(Mechanism([Link("body", joint=REVOLUTE, axis=body.axis, load=torque, **inertia)]))


def body_of(system: CompiledSystem) -> Link:
    """The body of a system of one."""
    (link,) = system.mechanism.links
    return link


def energies(system: CompiledSystem, march: Trajectory) -> tuple[Array, Array]:
    """Kinetic and potential energy of a march [J], shape (n_times,) each."""
    return Kinematics(system.mechanism, march.times, march.q, march.v).energies


def angular_momentum(system: CompiledSystem, march: Trajectory) -> Array:
    """Angular momentum of a march of one body about the axis of its hinge at the origin [kg m²/s]."""
    axis = body_of(system).axis / np.linalg.norm(body_of(system).axis)
    momentum = Kinematics(system.mechanism, march.times, march.q, march.v).angular_momentum
    return np.asarray(momentum[:, axis != 0.0] @ axis[axis != 0.0])  # a planar body's has no other parts
