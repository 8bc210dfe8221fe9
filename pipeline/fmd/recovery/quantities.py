"""Quantities at joints and markers over a motion, as variables with names, units and meanings."""

from collections.abc import Iterator, Sequence

import numpy as np

from fmd.core.arrays import Array
from fmd.core.rotations import turned
from fmd.recovery.motion import Motion
from fmd.recovery.motion_file import Variable, joint_variables

_RATES = ("rate", "rates", "angular_velocity", "velocity")
_XYZ = ("axis",)
_MARKERS = {
    "marker_position": "m",
    "marker_displacement": "m",
    "marker_velocity": "m/s",
    "marker_acceleration": "m/s^2",
}


def coordinate_variables(motion: Motion, joints: Sequence[str], rates: bool) -> list[Variable]:
    """Return positions, or rates, of some joints; joints without a coordinate have none."""
    found = (at for name in dict.fromkeys(joints) for at in joint_variables(motion, name))
    return [at for at in found if (at.name.rpartition(".")[2] in _RATES) is rates]


def reaction_variables(motion: Motion, joints: Sequence[str], in_body: bool) -> Iterator[Variable]:
    """Return force and moment of some joints on their children, in space or in the children's axes."""
    children = motion.mechanism.joint_children
    for joint in joints:
        child, both = children[joint], motion.joint_loads.reactions[joint][:, 1]
        where = f"in the axes of {child}" if in_body and child else "in space"
        for name, values, units in (("force", both[:, :3], "N"), ("moment", both[:, 3:], "N m")):
            seen = _in_body(motion, child, values) if in_body and child else values
            text = f"{name} of joint {joint} on {child or 'the ground'}, {where}"
            yield Variable(f"{joint}.{name}", seen, _XYZ, units, text)


def marker_variables(motion: Motion, quantity: str, markers: Sequence[str], in_body: bool) -> Iterator[Variable]:
    """Return one quantity of some markers, ``"body.marker"`` each, in space or in the bodies' axes.

    It is ``marker_position``, ``marker_displacement``, ``marker_velocity`` or ``marker_acceleration``. A displacement
    is counted from the start in space, or is that by deformation in the body.
    """
    whole, kind = motion.kinematics, quantity.removeprefix("marker_")
    for name in markers:
        body, _, marker = name.partition(".")
        number = motion.mechanism.number_of(body)
        if kind == "position":
            values = whole.marker_position(number, marker)
        elif kind == "displacement" and in_body:
            values = whole.displacement(number, marker)
        elif kind == "displacement":
            place = whole.marker_position(number, marker)
            values = place - place[0]
        elif kind == "velocity":
            values = whole.marker_velocity(number, marker)
        else:
            values = whole.marker_acceleration(number, marker, motion.joint_loads.accelerations)
        if in_body and kind in ("velocity", "acceleration"):
            values = _in_body(motion, body, values)
        where = f"in the axes of {body}" if in_body and kind != "position" else "in space"
        yield Variable(f"{name}.{kind}", values, _XYZ, _MARKERS[quantity], f"{kind} of {name} {where}")


def energy_variables(motion: Motion) -> list[Variable]:
    """Return the kinetic and the potential energy of all bodies."""
    kinetic, potential = motion.energies
    return [
        Variable("kinetic_energy", kinetic, (), "J", "kinetic energy"),
        Variable("potential_energy", potential, (), "J", "energy of deformation, springs and weight"),
    ]


def _in_body(motion: Motion, body: str, values: Array) -> Array:
    """Return vectors (n_times, 3) in space in a body's axes."""
    rotation = motion.kinematics.frames[motion.mechanism.number_of(body)].rotation
    return turned(np.swapaxes(rotation, 1, 2), values)
