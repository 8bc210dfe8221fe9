"""Stiffness and damping of bearings over the shaft's speed or the frequency of its whirl."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, GetJsonSchemaHandler, Tag, model_validator
from pydantic_core import CoreSchema

from fmd.core.units import NonNegative, Positive, TranslationalDamping, TranslationalStiffness, si_unit, unit_ratio
from fmd.scene.reading import FaultError
from fmd.scene.state_loads import FormulaVariable


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
