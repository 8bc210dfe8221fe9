"""Force elements in a scene file: springs, bushings and bearings between any two places, and end stops."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Field, GetJsonSchemaHandler, Tag, model_validator
from pydantic_core import CoreSchema

from fmd.core.units import (
    Angle,
    Force,
    Length,
    NonNegative,
    Positive,
    PositiveLength,
    RotationalDamping,
    RotationalStiffness,
    TranslationalDamping,
    TranslationalStiffness,
    Velocity,
    si_unit,
    unit_ratio,
)
from fmd.scene.curves import ForceByElongation
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.state_loads import FormulaVariable
from fmd.scene.values import Axis, Number, PlaceName, Point, Turn, Words


class BearingTable(FormulaVariable):
    """A bearing's stiffness or damping across its axis by a table over the shaft's speed or the frequency of its whirl.

    The shaft's speed is its rate of rotation against the housing. Before and after the table its first and its last
    value hold.

    Example:

        [bearing.drive_end.radial]
        arguments = [0, 1500, 3000, 6000]
        values = [62, 48, 41, 37]
        argument_unit = "rpm"
        unit = "N/um"
        between = "smooth"
    """

    kind: ClassVar[str]
    lowest: ClassVar[str]

    # ``"speed"``, or ``"whirl"``, the frequency at which the shaft's centre goes round, which linear answers of rotors
    # alone have.
    over: Literal["speed", "whirl"] = "speed"
    argument_unit: str = "rad/s"  # Unit of the arguments, e.g. ``"rpm"``, of whirl too.

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        table = super().__get_pydantic_json_schema__(schema, handler)["anyOf"][1]
        table["properties"].pop("beyond")
        return dict(table)

    @model_validator(mode="after")
    def _is_possible(self) -> BearingTable:
        for key, unit, si in (("argument_unit", self.argument_unit, "rad/s"), ("unit", self.unit, si_unit(self.kind))):
            if unit is None:
                raise FaultError(f"is missing: what the values are in, e.g. '{si}'", key)
            try:
                unit_ratio(unit, si)
            except ValueError:
                raise FaultError(f"isn't a unit of this; {'rpm' if si == 'rad/s' else si!r} works", key) from None
        if self.beyond != "hold":
            raise FaultError("must be 'hold': coefficients don't repeat", "beyond")
        if (self.arguments or (0.0,))[0] < 0.0:
            raise FaultError("must be 0 or above: a bearing is the same in both senses", "arguments", 0)
        for number, value in enumerate(self.values or ()):
            if value < 0.0 or (value == 0.0 and self.kind == "translational stiffness"):
                raise FaultError(f"must be {self.lowest}", *(("file",) if self.file else ("values", number)))
        return self


def _kind(value: Any) -> str:
    return "bearing table" if isinstance(value, dict | BearingTable) else "bearing quantity"


class StiffnessTable(BearingTable):
    """A bearing's stiffness [N/m] over speed or whirl."""

    kind, lowest = "translational stiffness", "above 0"


class DampingTable(BearingTable):
    """A bearing's damping [N s/m] over speed or whirl."""

    kind, lowest = "translational damping", "0 or above"


RadialStiffness = Annotated[
    Annotated[TranslationalStiffness, Positive, Tag("bearing quantity")]
    | Annotated[StiffnessTable, Tag("bearing table")],
    Discriminator(_kind),
]
RadialDamping = Annotated[
    Annotated[TranslationalDamping, NonNegative, Tag("bearing quantity")]
    | Annotated[DampingTable, Tag("bearing table")],
    Discriminator(_kind),
]


Stiffness = Annotated[TranslationalStiffness, NonNegative]
Damping = Annotated[TranslationalDamping, NonNegative]
TurningStiffness = Annotated[RotationalStiffness, NonNegative]
TurningDamping = Annotated[RotationalDamping, NonNegative]
Places = tuple[PlaceName, PlaceName]
SixRates = Annotated[
    tuple[Stiffness, Stiffness, Stiffness, TurningStiffness, TurningStiffness, TurningStiffness],
    Words("list of 3 translational and 3 rotational stiffnesses"),
]
SixDampings = Annotated[
    tuple[Damping, Damping, Damping, TurningDamping, TurningDamping, TurningDamping],
    Words("list of 3 translational and 3 rotational dampings"),
]
_Six = Annotated[tuple[Number, ...], Field(min_length=6, max_length=6)]
SixBySix = Annotated[tuple[_Six, _Six, _Six, _Six, _Six, _Six], Words("list of 6 lists of 6 numbers, in SI units")]


def require_a_side(low: float | None, high: float | None) -> None:
    """Raise ``FaultError`` unless an end stop has a place, and two in their order."""
    if low is None and high is None:
        raise FaultError("is missing: where the stop begins; or give low, or both", "high")
    if low is not None and high is not None and not low < high:
        raise FaultError("must be above low", "high")


class LengthStop(SceneTable):
    """End stops of a slide, or of the length of a spring: a spring and a damper beyond a place.

    Example:

        [joint.slide.stop]
        low = "-20 mm"
        high = "150 mm"
        stiffness = "500 kN/m"
        damper = "200 N s/m"
    """

    # Places below and above which the stops push back [m]; one of them or both.
    low: Length | None = None
    high: Length | None = None
    stiffness: Annotated[TranslationalStiffness, Positive]  # Stiffness of full contact [N/m].
    damper: Damping = 0.0  # Damper of full contact [N s/m].
    width: PositiveLength = 1e-4  # Way over which contact grows from none to full [m].

    def _check(self) -> None:
        require_a_side(self.low, self.high)


class AngleStop(SceneTable):
    """End stops of a hinge: a spring and a damper beyond an angle.

    Example:

        [joint.elbow.stop]
        low = "-10 deg"
        high = "140 deg"
        stiffness = "2 kN m/rad"
    """

    # Angles below and above which the stops push back [rad]; one of them or both.
    low: Angle | None = None
    high: Angle | None = None
    stiffness: Annotated[RotationalStiffness, Positive]  # Stiffness of full contact [N m/rad].
    damper: TurningDamping = 0.0  # Damper of full contact [N m s/rad].
    width: Annotated[Angle, Positive] = 1e-3  # Angle over which contact grows from none to full [rad].

    def _check(self) -> None:
        require_a_side(self.low, self.high)


class Spring(SceneTable):
    """A spring and damper along the line between two places, each a marker of a body or a place on the ground.

    Example:

        [spring.strut]
        between = ["ground.tower", "arm.seat"]
        stiffness = "18 N/mm"
        length = "310 mm"
        damper = "1200 N s/m"
        stop = { low = "240 mm", stiffness = "400 N/mm" }
    """

    mark: ClassVar[str] = "coil"

    between: Places  # The two places.
    stiffness: Stiffness = 0.0  # Stiffness [N/m].
    # Length at which the spring pulls and pushes nothing [m]; ``"start"`` takes that at the start.
    length: Annotated[Length, NonNegative] | Literal["start"] = "start"
    damper: Damping = 0.0  # Coefficient of a damper along the line [N s/m].
    force: ForceByElongation | None = None  # Force of a nonlinear spring by its elongation, in place of ``stiffness``.
    # End stops of the distance between the places; clearance, if they coincide at the start.
    stop: LengthStop | None = None
    friction: Annotated[Force, NonNegative] = 0.0  # Largest friction along the line [N].
    friction_rate: Annotated[Velocity, Positive] = 1e-3  # Speed at which friction has reached 71 % of that [m/s].

    def _check(self) -> None:
        if self.force is not None and self.stiffness:
            raise FaultError("can't stand beside stiffness: give one of the two", "force")
        if not (self.force or self.stiffness or self.damper or self.stop or self.friction):
            raise FaultError("is missing: a spring needs this, or a force, damper, stop or friction", "stiffness")


class Bushing(SceneTable):
    """Springs and dampers in six directions between two places: along axes of the first one, and about them.

    Example:

        [bushing.front]
        between = ["ground.front", "arm.front"]
        stiffness = ["4 kN/mm", "4 kN/mm", "0.3 kN/mm", "300 N m/rad", "300 N m/rad", "5 N m/rad"]
        damper = ["500 N s/m", "500 N s/m", "80 N s/m", "0.2 N m s/rad", "0.2 N m s/rad", "0.1 N m s/rad"]
    """

    mark: ClassVar[str] = "ball"

    between: Places  # The two places.
    rotation: Turn = (0.0, 0.0, 0.0)  # Rotation vector of the bushing's axes against those of the first place [rad].
    stiffness: SixRates | None = None  # Stiffnesses along x, y and z [N/m] and about them [N m/rad].
    # All 6 × 6 stiffnesses, symmetric, in place of ``stiffness`` [N/m, N, N m/rad].
    stiffness_matrix: SixBySix | None = None
    damper: SixDampings | None = None  # Coefficients of dampers along x, y and z [N s/m] and about them [N m s/rad].
    # All 6 × 6 coefficients, symmetric, in place of ``damper`` [N s/m, N s, N m s/rad].
    damper_matrix: SixBySix | None = None
    # Position of the second place against the first at rest, along the bushing's axes [m]; ``"start"`` takes that at
    # the start.
    position: Point | Literal["start"] = "start"
    # Rotation vector of the second place's axes against the bushing's at rest [rad]; ``"start"`` takes that at the
    # start. Twists stay below half a turn.
    turn: Turn | Literal["start"] = "start"

    def _check(self) -> None:
        for plain, full in (("stiffness", "stiffness_matrix"), ("damper", "damper_matrix")):
            if getattr(self, plain) is not None and getattr(self, full) is not None:
                raise FaultError(f"can't stand beside {plain}: give one of the two", full)
        if all(getattr(self, key) is None for key in ("stiffness", "stiffness_matrix", "damper", "damper_matrix")):
            raise FaultError("is missing: a bushing needs this, a damper, or the matrix of either", "stiffness")


class Bearing(SceneTable):
    """A bearing that holds a shaft along and across its axis by springs, and lets it turn and tilt.

    Example:

        [bearing.drive_end]
        between = ["ground.pedestal", "rotor.drive_end"]
        axis = [1, 0, 0]
        radial = "40 N/um"
        axial = "5 N/um"
        radial_damper = "300 N s/m"
    """

    mark: ClassVar[str] = "disc"

    between: Places  # The two places, that of the housing first.
    axis: Axis  # Direction of the axis in the axes of the first place; its length doesn't count.
    # Stiffness across the axis [N/m], a quantity or a table over the shaft's speed or the frequency of its whirl.
    radial: RadialStiffness
    axial: Stiffness = 0.0  # Stiffness along the axis [N/m].
    radial_damper: RadialDamping = 0.0  # Coefficient of a damper across the axis [N s/m], likewise.
    axial_damper: Damping = 0.0  # Coefficient of a damper along the axis [N s/m].

    @property
    def tables(self) -> dict[str, BearingTable]:
        """The coefficients that tables give, by their keys."""
        given = {"radial": self.radial, "radial_damper": self.radial_damper}
        return {key: value for key, value in given.items() if isinstance(value, BearingTable)}

    @property
    def whirl_tables(self) -> dict[str, BearingTable]:
        """Tables of the bearing over the frequency of whirl."""
        return {key: table for key, table in self.tables.items() if table.over == "whirl"}


ForceElement = Spring | Bushing | Bearing
"""Elements of any kind; ``mark`` is how pictures show one: a coil between its places, a ball at the second, a disc
across its axis at the first."""
