"""Quantities of a scene that may change with time: constants, formulas and tables."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, GetJsonSchemaHandler, ValidationInfo, WithJsonSchema, model_validator
from pydantic_core import CoreSchema

from fmd.core.units import NonNegativeTime, QuantityReader, unit_ratio
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.table_files import Column, check_curve, read_table, scene_folder
from fmd.scene.values import SourceFile, UnitCheck

_KEYS = ("formula", "times", "values", "file", "time", "column", "time_unit", "between", "unit")
Sample = Annotated[float, Field(strict=True)]


class TimeFunction(SceneTable):
    """A quantity that may change with time: a constant, a formula of t, or a table of times and values.

    A constant is written as the quantity itself, ``"5 N m"``. A table stands in the scene, as ``times`` and ``values``,
    or in a ``file``: text in columns, divided by commas, semicolons, tabs or spaces, with the columns' names in the
    first row or none.

    Parameters
    ----------
    constant : float, optional
        Value in SI units, if the quantity doesn't change; no key of a scene.
    formula : str, optional
        Formula of the time t in seconds; its values are in ``unit``.
    times : tuple of float, optional
        Times of a table, ascending [s]; its first and last value hold before and after.
    values : tuple of float, optional
        Values of the table in ``unit``, one for each time.
    file : str, optional
        CSV file that holds the table, relative to the scene's file; with ``time`` and ``column``.
    time : str or int, optional
        Column of the file with the times.
    column : str or int, optional
        Column of the file with the values.
    time_unit : str
        Unit of the file's times.
    between : str
        Course of a table between its times: ``"straight"`` lines, which a force or torque takes by default, or a
        ``"smooth"`` curve, which a prescribed motion must take, because a jump of its rate would be an impulse.
    unit : str, optional
        Unit of the formula's or the table's values, e.g. ``"N m"``; required with either.

    Examples
    --------
    ::

        [drive.swing.torque]
        times = ["0 s", "0.1 s", "0.3 s"]
        values = [0.0, 2.5, 0.0]
        unit = "N m"
    """

    kind: ClassVar[str]
    si: ClassVar[str]
    default_between: ClassVar[Literal["straight", "smooth"]] = "straight"

    constant: float | None = None
    formula: str | None = None
    times: Annotated[tuple[NonNegativeTime, ...], Field(min_length=2, max_length=10_000)] | None = None
    values: tuple[Sample, ...] | None = None
    file: SourceFile | None = None
    time: Column | None = None
    column: Column | None = None
    time_unit: Annotated[str, UnitCheck("s")] = "s"
    between: Literal["straight", "smooth"] | None = None
    unit: Annotated[str, WithJsonSchema({"$unit": True})] | None = None

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        table = handler.resolve_ref_schema(handler(schema))
        table["properties"].pop("constant", None)
        return {"anyOf": [{"$quantity": cls.kind}, dict(table)]}

    @model_validator(mode="before")
    @classmethod
    def _read_a_constant(cls, value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, cls):
            return value
        if not isinstance(value, dict):
            return {"constant": QuantityReader(cls.kind)(value, info)}
        if "constant" in value:
            raise FaultError(f"no such key; the keys here: {', '.join(_KEYS)}", "constant")
        return value

    @model_validator(mode="after")
    def _read_a_file(self, info: ValidationInfo) -> Self:
        table = read_table(self, "time", ("formula", "times", "values"), scene_folder(info))
        if table is None:
            return self
        if table.arguments[0] < 0:
            raise FaultError(
                f"begins at {table.arguments[0]:g} {self.time_unit}; times count from the start, 0", "file"
            )
        factor = unit_ratio(self.time_unit, "s")
        return self.model_copy(update={"times": tuple(factor * t for t in table.arguments), "values": table.values})

    @model_validator(mode="after")
    def _given_one_way(self) -> TimeFunction:
        if self.constant is not None:
            return self
        check_curve(self, "t", "times", self.kind)
        if self.between == "straight" and self.default_between == "smooth":
            # A jump of the rate is an impulse that no equation here would pass on to the other coordinates.
            raise FaultError("would let the motion's rate jump at each time; 'smooth' works", "between")
        return self

    @property
    def factor(self) -> float:
        """Factor from the unit of the values to SI units."""
        return 1.0 if self.unit is None else unit_ratio(self.unit, self.si)

    @property
    def smooth(self) -> bool:
        """True if a table is a smooth curve between its times, false if it is straight lines."""
        return (self.between or self.default_between) == "smooth"


class TorqueOverTime(TimeFunction):
    """A torque [N m] that is constant or changes with time."""

    kind, si = "torque", "N m"


class ForceOverTime(TimeFunction):
    """A force [N] that is constant or changes with time."""

    kind, si = "force", "N"


class AngleOverTime(TimeFunction):
    """A prescribed angle [rad] over time; tables are smooth, because the second derivative acts as a load."""

    kind, si, default_between = "angle", "rad", "smooth"


class PositionOverTime(TimeFunction):
    """A prescribed displacement [m] over time; tables are smooth, because the second derivative acts as a load."""

    kind, si, default_between = "length", "m", "smooth"
