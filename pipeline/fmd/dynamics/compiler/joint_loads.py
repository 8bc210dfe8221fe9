"""Force and moment that each joint of the tree transmits, and the accelerations of the bodies' frames, in space.

The recursive Newton–Euler algorithm of `residual` gives the force that moves a body and all that it carries, whatever
acts along the joint: what bears, springs, dampers, drives, friction and gears together.
"""

from __future__ import annotations

from fmd.dynamics.compiler.algebra import Vector6, rotate, scale, subtract
from fmd.dynamics.compiler.closures import ConstrainedForces, trace_rows
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.forces import PushedForces
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.residual import trace_joint_forces


def trace_joint_loads(inputs: Coordinates, frames: list[MovingFrame]) -> list[tuple[Vector6, Vector6, Vector6]]:
    """Trace of each body the acceleration of its frame, and the force and moment of its joint on parent and body.

    All are in space; moments are about the joint's place on the parent, and about the body's origin.
    """
    loops = inputs.mechanism.closures
    acting = ConstrainedForces(inputs, frames, trace_rows(inputs, frames)) if loops else PushedForces(inputs, frames)
    out = []
    for frame, found in zip(frames, trace_joint_forces(inputs, frames, acting), strict=True):
        R = frame.world[1]
        falling = rotate(R, found.x)
        acceleration = subtract(falling[:3], acting.ground[:3]) + falling[3:]
        out.append((acceleration, scale(-1.0, rotate(R, found.at_place(frame))), rotate(R, found.force)))
    return out
