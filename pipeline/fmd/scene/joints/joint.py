"""Tables of joints of any kind: coordinates at the start, forces along them, and marks in pictures."""

from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.joint_kinds import JointKind
from fmd.core.units import Angle, AngularRate, NonNegative, Positive, Torque
from fmd.scene.force_elements import AngleStop, LengthStop, TurningDamping, TurningStiffness
from fmd.scene.orientation import Orientation
from fmd.scene.reading import SceneTable
from fmd.scene.values import Axis, MarkerName, PlaceName

POSITION_KEYS = frozenset({"angle", "angles", "position"})
"""Keys of joints that give coordinates at the start."""
RATE_KEYS = ("rate", "rates", "spin", "velocity")
"""Keys of joints that give rates at the start."""


@dataclass(frozen=True)
class Mark:
    """A joint's mark in pictures."""

    # ``ball``, ``pin`` along the axis, ``box`` with its last edge along the axis, ``line`` from place to place, or
    # empty for none.
    shape: str = ""
    edges: tuple[float, float, float] = (1.0, 1.0, 1.0)  # edges of a box in radii of a mark
    rail: bool = False  # true if a line shows the way of the child on the ground
    stands: bool = True  # true if the ground is shown where it holds the joint


@dataclass(frozen=True)
class Along:
    """Spring, damper, end stops and friction along a joint's coordinate, in SI units."""

    spring: float = 0.0
    rest: float = 0.0
    damper: float = 0.0
    stop: LengthStop | AngleStop | None = None
    friction: float = 0.0
    friction_rate: float = 1.0


class JointTable(SceneTable):
    """Answers of a joint of any kind, of which a kind overrides those that are its own."""

    kind: ClassVar[JointKind]  # coordinates, motion and constraints
    title: ClassVar[str]  # heading of its section in the page about scenes
    mark: ClassVar[Mark] = Mark()  # in pictures
    # True if a joint of this kind can carry a body; else it closes a loop wherever it is.
    carries: ClassVar[bool] = True
    # Keys of the coordinates at the start, and of their rates.
    start_keys: ClassVar[tuple[tuple[str, ...], tuple[str, ...]]] = ((), ())
    closing_keys: ClassVar[tuple[str, ...]] = ()  # keys that have an effect only where the joint closes a loop
    # True if coordinates are measured along or about directions across the axis, in the child's own axes.
    measured_across: ClassVar[bool] = False
    # True if ``rotate`` and ``axes`` turn the child at the start, and not the joint.
    starts_turned: ClassVar[bool] = False
    cannot_close: ClassVar[str] = ""  # why a joint of this kind can't close a loop, if so

    @property
    def kept_distance(self) -> float:
        """Distance that the joint keeps between its places [m]; 0 for none."""
        return 0.0

    @property
    def lead_per_angle(self) -> float:
        """Displacement for an angle, where one coordinate is for both [m/rad]."""
        return 0.0

    @property
    def given_keys(self) -> set[str]:
        """Keys that the scene gives about the start."""
        return set()

    @property
    def position_key(self) -> str:
        """Key of the coordinate of a joint that has one."""
        return next(key for key, unit in (("position", "m"), ("angle", "rad")) if unit == self.kind.unit)

    @property
    def along(self) -> tuple[Along, ...]:
        """Spring, damper, stops and friction along each coordinate; empty where none can be."""
        keys = ("spring", "rest", "damper", "stop", "friction", "friction_rate")  # of joints with one coordinate
        return (Along(*(getattr(self, key) for key in keys)),) if self.kind.unit else ()

    def start(self, into_child: Array) -> tuple[Sequence[float], Sequence[float]]:
        """Return coordinates and rates at the start; of a rotation in space that starts at none the rates alone.

        ``into_child`` (3, 3) turns the joint's axes into those of the child's body.
        """
        coordinates, rates = (np.hstack([getattr(self, key) for key in keys] or [[]]) for keys in self.start_keys)
        return coordinates.tolist(), rates.tolist()

    def direction(self, *keys: str) -> Array:
        """Return the direction that the first given of some keys has, shape (3,); z where none has one."""
        found = (given for key in keys if (given := getattr(self, key, None)) is not None)
        return np.array(next(found, (0.0, 0.0, 1.0)), dtype=float)

    @property
    def axis_of_child(self) -> Array:
        """The joint's axis in the axes of the child's marker, shape (3,)."""
        return self.direction(*(key for key in ("child_axis", "axis") if key == "axis" or key in self.closing_keys))


class CarryingJoint(JointTable, Orientation):
    """A joint holds a marker of a body, its child, on another body's marker or a place on the ground, its parent."""

    # Marker or place on the ground, ``"ground.NAME"``, that the joint hangs on; ``"ground"`` is its origin.
    parent: PlaceName
    child: MarkerName  # Marker of the body that the joint carries.

    @property
    def given_keys(self) -> set[str]:
        """Keys that the scene gives; the turn of a joint that starts turned is its position, too."""
        return self.model_fields_set | ({"position"} if self.starts_turned and self.is_turned else set())

    @property
    def of_coordinates(self) -> list[str]:
        """Keys that the scene gives about coordinates, of which a joint that closes a loop has none."""
        general = {"type", *CarryingJoint.model_fields, *self.closing_keys}
        optional = [name for name, field in type(self).model_fields.items() if not field.is_required()]
        return [name for name in optional if name not in general and name in self.model_fields_set]


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
