"""Joints of two or three coordinates in a scene file, and screws: universal, cylindrical, planar."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import model_validator

from fmd.core.units import Angle, AngularRate, Length, NonNegative, Positive, Torque, Velocity
from fmd.scene.force_elements import AngleStop, Damping, Stiffness, TurningDamping, TurningStiffness
from fmd.scene.orientation import Orientation
from fmd.scene.reading import FaultError
from fmd.scene.values import Axis, MarkerName, PlaceName

_ROUND_OFF = 1e-9


class Universal(Orientation):
    """A universal (Cardan) joint: the child turns about an axis of the parent and about one of its own, across it.

    Parameters
    ----------
    parent : str
        Marker or place on the ground, ``"ground.NAME"``, that the joint hangs on; ``"ground"`` is its origin.
    child : str
        Marker of the body that the joint carries.
    axis : tuple of float
        Direction of the parent's axis, in the axes of its marker or place; its length doesn't count.
    child_axis : tuple of float
        Direction of the child's axis, in the axes of its marker; perpendicular to ``axis`` at angles 0.
    angles : tuple of float
        Angles about both axes at the start [rad].
    rates : tuple of float
        Angular rates about both axes at the start [rad/s].
    springs : tuple of float
        Stiffnesses of springs about both axes [N m/rad].
    rests : tuple of float
        Angles at which the springs are unstretched [rad].
    dampers : tuple of float
        Coefficients of dampers about both axes [N m s/rad].

    Examples
    --------
    ::

        [joint.cardan]
        type = "universal"
        parent = "shaft.end"
        child = "output.start"
        axis = [0, 1, 0]
        child_axis = [0, 0, 1]
    """

    type: Literal["universal"]
    parent: PlaceName
    child: MarkerName
    axis: Axis
    child_axis: Axis
    angles: tuple[Angle, Angle] = (0.0, 0.0)
    rates: tuple[AngularRate, AngularRate] = (0.0, 0.0)
    springs: tuple[TurningStiffness, TurningStiffness] = (0.0, 0.0)
    rests: tuple[Angle, Angle] = (0.0, 0.0)
    dampers: tuple[TurningDamping, TurningDamping] = (0.0, 0.0)

    @model_validator(mode="after")
    def _axes_cross(self) -> Universal:
        sizes = math.hypot(*self.axis) * math.hypot(*self.child_axis)
        if abs(sum(a * b for a, b in zip(self.axis, self.child_axis, strict=True))) > _ROUND_OFF * sizes:
            raise FaultError("must be perpendicular to axis", "child_axis")
        return self


class Cylindrical(Orientation):
    """A slide that also lets the child turn about its axis.

    Parameters
    ----------
    parent : str
        Marker or place on the ground, ``"ground.NAME"``, that the joint hangs on; ``"ground"`` is its origin.
    child : str
        Marker of the body that the joint carries.
    axis : tuple of float
        Direction of the axis in the axes of the parent's marker or place; its length
        doesn't count.
    position : float
        Displacement of the child's marker from the parent's at the start [m].
    angle : float
        Angle at the start [rad].
    velocity : float
        Speed along the axis at the start [m/s].
    rate : float
        Angular rate at the start [rad/s].
    spring : float
        Stiffness of a spring along the axis [N/m].
    rest : float
        Displacement at which that spring is unstretched [m].
    damper : float
        Coefficient of a damper along the axis [N s/m].
    turning_spring : float
        Stiffness of a spring about the axis [N m/rad].
    rest_angle : float
        Angle at which that spring is unstretched [rad].
    turning_damper : float
        Coefficient of a damper about the axis [N m s/rad].

    Examples
    --------
    ::

        [joint.quill]
        type = "cylindrical"
        parent = "ground"
        child = "spindle.nose"
        axis = [0, 0, 1]
        spring = "12 N/mm"
        rate = "3000 rpm"
    """

    type: Literal["cylindrical"]
    parent: PlaceName
    child: MarkerName
    axis: Axis
    position: Length = 0.0
    angle: Angle = 0.0
    velocity: Velocity = 0.0
    rate: AngularRate = 0.0
    spring: Stiffness = 0.0
    rest: Length = 0.0
    damper: Damping = 0.0
    turning_spring: TurningStiffness = 0.0
    rest_angle: Angle = 0.0
    turning_damper: TurningDamping = 0.0


class Planar(Orientation):
    """A plane on a plane: the child slides in two directions and turns about their normal.

    Parameters
    ----------
    parent : str
        Marker or place on the ground, ``"ground.NAME"``, that the joint hangs on; ``"ground"`` is its origin.
    child : str
        Marker of the body that the joint carries.
    axis : tuple of float
        Direction of the normal in the axes of the parent's marker or place; its length
        doesn't count.
    position : tuple of float
        Displacements of the child's marker from the parent's at the start [m]: along that of x, y and z that is most
        across the normal, turned into the plane, and along the normal's cross product with it. They are x and y for the
        normal z, and y and z for x.
    angle : float
        Angle at the start [rad].
    velocity : tuple of float
        Rates of both displacements at the start [m/s].
    rate : float
        Angular rate at the start [rad/s].

    Examples
    --------
    ::

        [joint.table]
        type = "planar"
        parent = "ground"
        child = "puck.middle"
        axis = [0, 0, 1]
        velocity = ["1 m/s", "0 m/s"]
        rate = "10 rad/s"
    """

    type: Literal["planar"]
    parent: PlaceName
    child: MarkerName
    axis: Axis
    position: tuple[Length, Length] = (0.0, 0.0)
    angle: Angle = 0.0
    velocity: tuple[Velocity, Velocity] = (0.0, 0.0)
    rate: AngularRate = 0.0


class Screw(Orientation):
    """A screw: the child turns about an axis and moves along it in proportion.

    Parameters
    ----------
    parent : str
        Marker or place on the ground, ``"ground.NAME"``, that the joint hangs on; ``"ground"`` is its origin.
    child : str
        Marker of the body that the joint carries.
    axis : tuple of float
        Direction of the axis in the axes of the parent's marker or place; its length
        doesn't count.
    lead : float
        Displacement along the axis for a whole turn [m]; below 0 for a left-handed thread.
    angle : float
        Angle at the start [rad].
    rate : float
        Angular rate at the start [rad/s].
    spring : float
        Stiffness of a spring about the axis [N m/rad].
    rest : float
        Angle at which the spring is unstretched [rad].
    damper : float
        Coefficient of a damper about the axis [N m s/rad].
    stop : AngleStop, optional
        End stops.
    friction : float
        Largest friction about the axis [N m].
    friction_rate : float
        Angular rate at which friction has reached 71 % of that [rad/s].

    Examples
    --------
    ::

        [joint.spindle]
        type = "screw"
        parent = "ground"
        child = "nut.thread"
        axis = [0, 0, 1]
        lead = "5 mm"
        friction = "0.02 N m"
    """

    type: Literal["screw"]
    parent: PlaceName
    child: MarkerName
    axis: Axis
    lead: Length
    angle: Angle = 0.0
    rate: AngularRate = 0.0
    spring: TurningStiffness = 0.0
    rest: Angle = 0.0
    damper: TurningDamping = 0.0
    stop: AngleStop | None = None
    friction: Annotated[Torque, NonNegative] = 0.0
    friction_rate: Annotated[AngularRate, Positive] = 1e-2
