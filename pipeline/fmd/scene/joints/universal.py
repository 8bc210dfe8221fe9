"""A universal (Cardan) joint in a scene file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from pydantic import model_validator

from fmd.core.arrays import Array
from fmd.core.joint_kinds import AXIS, OTHER, SPACE, ElementaryMotion, JointKind
from fmd.core.limits.round_off import SOLVED
from fmd.core.units import Angle, AngularRate
from fmd.scene.force_elements import TurningDamping, TurningStiffness
from fmd.scene.joints.joint import Along, CarryingJoint, Mark
from fmd.scene.reading import FaultError
from fmd.scene.values import Axis

UNIVERSAL = JointKind(
    "universal",
    ("rad",) * 2,
    turns=(ElementaryMotion(AXIS), ElementaryMotion(OTHER, 1)),
    points=SPACE,
    squares=(((AXIS, AXIS),),),
)


class Universal(CarryingJoint):
    """A universal (Cardan) joint: the child turns about an axis of the parent and about one of its own, across it.

    Parameters
    ----------
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

    kind = UNIVERSAL
    title = "Universal joint"
    mark = Mark("ball")

    type: Literal["universal"]
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
        if abs(sum(a * b for a, b in zip(self.axis, self.child_axis, strict=True))) > SOLVED * sizes:
            raise FaultError("must be perpendicular to axis", "child_axis")
        return self

    @property
    def along(self) -> tuple[Along, ...]:
        """Springs and dampers about both axes."""
        return tuple(Along(*at) for at in zip(self.springs, self.rests, self.dampers, strict=True))

    def start(self, into_child: Array) -> tuple[Sequence[float], Sequence[float]]:
        """Return coordinates and rates at the start."""
        return self.angles, self.rates
