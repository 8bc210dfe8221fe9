"""Keys of joints with one angle and with two, and what acts along these."""

from __future__ import annotations

from typing import Annotated

from fmd.core.units import Angle, AngularRate, NonNegative, Positive, Torque
from fmd.scene.force_elements import AngleStop, TurningDamping, TurningStiffness
from fmd.scene.joints.joint import Along, CarryingJoint
from fmd.scene.values import Axis


class OneAngleJoint(CarryingJoint):
    """A spring, a damper, end stops and friction act about a joint's axis."""

    start_keys = (("angle",), ("rate",))

    axis: Axis  # Direction of the axis in the axes of the parent's marker or place; its length doesn't count.
    angle: Angle = 0.0  # Angle at the start [rad].
    rate: AngularRate = 0.0  # Angular rate at the start [rad/s].
    spring: TurningStiffness = 0.0  # Stiffness of a spring about the axis [N m/rad].
    rest: Angle = 0.0  # Angle at which the spring is unstretched [rad].
    damper: TurningDamping = 0.0  # Coefficient of a damper about the axis [N m s/rad].
    stop: AngleStop | None = None  # End stops.
    friction: Annotated[Torque, NonNegative] = 0.0  # Largest friction about the axis [N m].
    # Angular rate at which friction has reached 71 % of that [rad/s].
    friction_rate: Annotated[AngularRate, Positive] = 1e-2


class TwoAngleJoint(CarryingJoint):
    """Springs and dampers act against both angles of a joint."""

    start_keys = (("angles",), ("rates",))

    angles: tuple[Angle, Angle] = (0.0, 0.0)  # Both angles at the start [rad].
    rates: tuple[AngularRate, AngularRate] = (0.0, 0.0)  # Their rates at the start [rad/s].
    springs: tuple[TurningStiffness, TurningStiffness] = (0.0, 0.0)  # Stiffnesses of springs against them [N m/rad].
    rests: tuple[Angle, Angle] = (0.0, 0.0)  # Angles at which the springs are unstretched [rad].
    dampers: tuple[TurningDamping, TurningDamping] = (0.0, 0.0)  # Coefficients of dampers against them [N m s/rad].

    @property
    def along(self) -> tuple[Along, ...]:
        """Springs and dampers against both angles."""
        return tuple(Along(*at) for at in zip(self.springs, self.rests, self.dampers, strict=True))
