"""Quantities of a scene that a formula or a table gives: over time, or by a spring's elongation."""

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, GetJsonSchemaHandler, ValidationInfo, WithJsonSchema, model_validator
from pydantic_core import CoreSchema

from fmd.core.formula import parse_formula
from fmd.core.limits.round_off import SOLVED
from fmd.core.limits.scene import CLOSES, MOST_ELONGATIONS, MOST_REPEATED_ROWS
from fmd.core.state_formula import StateFormula
from fmd.core.units import Length, NonNegativeTime, QuantityReader, require_possible, si_unit, unit_ratio
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.table_files import Column, TableColumns, read_columns
from fmd.scene.values import LengthUnit, Number, SourceFile, UnitCheck


class FormulaOrTable(SceneTable):
    """A quantity by a formula of one variable, or by a table in the scene or in a CSV file."""

    kind: ClassVar[str]  # kind of quantity that the values are
    variable: ClassVar[str]  # variable of a formula
    argument: ClassVar[str]  # key of a file's column with the table's arguments; those in the scene have its plural
    # Course of a table between its rows, unless the scene says it.
    default_between: ClassVar[Literal["straight", "smooth"]] = "straight"

    formula: str | None = None
    values: tuple[Number, ...] | None = None  # Values of the table in ``unit``, one for each row.
    file: SourceFile | None = None  # CSV file that holds the table, relative to the scene's file.
    column: Column | None = None  # Column of the file with the values.
    between: Literal["straight", "smooth"] | None = None
    # Unit of the formula's or the table's values, e.g. ``"N m"``; required with either.
    unit: Annotated[str, WithJsonSchema({"$unit": True})] | None = None

    @property
    def factor(self) -> float:
        """Factor from the unit of the values to SI units."""
        return 1.0 if self.unit is None else unit_ratio(self.unit, si_unit(self.kind))

    @property
    def smooth(self) -> bool:
        """True if a table is a smooth curve between its rows, false if it is straight lines."""
        return (self.between or self.default_between) == "smooth"

    def _is_constant(self) -> bool:
        """Return True if neither a formula nor a table is needed."""
        return False

    def _check_file(self, table: TableColumns) -> None:
        """Raise ``FaultError`` if a file's table can't be one of this quantity."""

    @model_validator(mode="after")
    def _read_a_file(self, info: ValidationInfo) -> Self:
        given = {key: getattr(self, key) for key in (self.argument, "column")}
        if self.file is None:
            for key in (*given, f"{self.argument}_unit"):
                if key in self.model_fields_set:
                    raise FaultError("belongs to a table in a file: give file, too", key)
            return self
        for key in ("formula", f"{self.argument}s", "values"):
            if getattr(self, key) is not None:
                raise FaultError("can't stand beside file, which holds the table", key)
        for key, column in given.items():
            if column is None:
                raise FaultError("is missing: the column's name in the file's first row, or its number from 1", key)
        folder = Path((info.context or {}).get("folder", "."))  # of the scene
        table = read_columns(folder, self.file, *given.items())
        self._check_file(table)
        unit = getattr(self, f"{self.argument}_unit")
        factor = unit_ratio(unit, "s" if self.argument == "time" else "m")
        arguments = tuple(factor * x for x in table.arguments)
        return self.model_copy(update={f"{self.argument}s": arguments, "values": table.values})

    @model_validator(mode="after")
    def _given_one_way(self) -> Self:
        if self._is_constant():
            return self
        arguments, si = f"{self.argument}s", si_unit(self.kind)
        table = getattr(self, arguments)
        ways = f"a formula of {self.variable}, or a table: {arguments} and values, or a file of them"
        if self.formula is not None and table is not None:
            raise FaultError(f"can't stand beside a table: give one of the two, {ways}", "formula")
        if self.formula is None and table is None:
            raise FaultError(f"is missing: give {ways}", "formula")
        if self.unit is None:
            raise FaultError(f"is missing: what the values are in, e.g. '{si}'", "unit")
        try:
            unit_ratio(self.unit, si)
        except ValueError:
            raise FaultError(f"isn't a unit of {self.kind}; '{si}' works", "unit") from None
        if self.formula is None:
            self._check_table(table, arguments)
            return self
        for key in ("values", "between", "beyond"):
            if getattr(self, key, None) is not None:
                raise FaultError(f"belongs to a table of {arguments}; a formula takes none", key)
        self._check_formula(self.formula)
        return self

    def _check_formula(self, text: str) -> None:
        try:
            parse_formula(text, self.variable)
        except ValueError as error:
            raise FaultError(str(error), "formula") from None

    def _check_table(self, table: tuple[float, ...], arguments: str) -> None:
        if self.values is None or len(self.values) != len(table):
            raise FaultError(f"must hold {len(table)} values, one for each {self.argument}", "values")
        for number, (before, after) in enumerate(pairwise(table), start=1):
            if not after > before:
                raise FaultError(f"must be above the {self.argument} before it", arguments, number)
        for number, value in enumerate(self.values):
            try:
                require_possible(self.factor * value, self.kind)
            except ValueError as error:
                raise FaultError(str(error), *(("file",) if self.file else ("values", number))) from None


class TimeFunction(FormulaOrTable):
    """A quantity that may change with time: a constant, a formula of t, or a table of times and values.

    A constant is written as the quantity itself, ``"5 N m"``. A table stands in the scene, as ``times`` and ``values``,
    or in a ``file``: text in columns, divided by commas, semicolons, tabs or spaces, with the columns' names in the
    first row or none.

    Example:

        [drive.swing.torque]
        times = ["0 s", "0.1 s", "0.3 s"]
        values = [0.0, 2.5, 0.0]
        unit = "N m"
    """

    variable = "t"
    argument = "time"

    formula: str | None = None  # Formula of the time t in seconds; its values are in ``unit``.
    # Course of a table between its times: ``"straight"`` lines, which a force or torque takes by default, or a
    # ``"smooth"`` curve, which a prescribed motion must take, because a jump of its rate would be an impulse.
    between: Literal["straight", "smooth"] | None = None
    constant: float | None = None  # Value in SI units, if the quantity doesn't change; no key of a scene.
    # Times of a table, ascending [s].
    times: Annotated[tuple[NonNegativeTime, ...], Field(min_length=2, max_length=10_000)] | None = None
    time: Column | None = None  # Column of the file with the times.
    time_unit: Annotated[str, UnitCheck("s")] = "s"  # Unit of the file's times.
    # What holds before and after a table's times: its first and last value (``"hold"``), 0 (``"zero"``), or the table
    # again and again (``"repeat"``), up to the simulation's end. A table that doesn't cover the simulation must say.
    beyond: Literal["hold", "zero", "repeat"] | None = None

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
            keys = ", ".join(key for key in cls.model_fields if key != "constant")
            raise FaultError(f"no such key; the keys here: {keys}", "constant")
        return value

    def _is_constant(self) -> bool:
        return self.constant is not None

    def _check_file(self, table: TableColumns) -> None:
        if table.arguments[0] < 0:
            first = f"{table.arguments[0]:g} {self.time_unit}"
            raise FaultError(f"begins at {first}; times count from the start, 0", "file")

    @property
    def state(self) -> StateFormula | None:
        """Formula of the mechanism's state; none where the time alone counts."""
        return None

    @property
    def gap(self) -> float:
        """Difference of a table's last and first value over its largest one; 0 of others."""
        if not self.values:
            return 0.0
        return abs(self.values[-1] - self.values[0]) / (max(map(abs, self.values)) or 1.0)

    @model_validator(mode="after")
    def _goes_on(self) -> Self:
        if self.beyond is None:
            return self
        if self.times is None:
            raise FaultError("belongs to a table of times", "beyond")
        moves = self.default_between == "smooth"
        if self.beyond == "repeat" and self.smooth and self.gap > CLOSES:
            mend = "'hold' works" if moves else "'hold' works, or between = 'straight'"
            off = f"{self.gap:.2g} of its largest value"
            raise FaultError(f"needs a curve that ends as it begins, not {off} away from there; {mend}", "beyond")
        if self.beyond == "zero" and moves and self.values and (self.values[0] or self.values[-1]):
            raise FaultError("would let the motion jump to 0; 'hold' works", "beyond")
        return self

    def check_duration(self, duration: float) -> None:
        """Raise ``FaultError`` unless a table covers a simulation [s] or says what holds beyond it."""
        if self.times is None:
            return
        begin, end = self.times[0], self.times[-1]
        if self.beyond is None and (begin > 0 or end < duration * (1 - SOLVED)):
            covers = f"the table covers {begin:g} … {end:g} s of the simulation's {duration:g} s"
            raise FaultError(f"is missing: {covers}; say 'hold', 'zero' or 'repeat'", "beyond")
        rows = len(self.times) * duration / (end - begin)
        if self.beyond == "repeat" and rows > MOST_REPEATED_ROWS:
            raise FaultError(f"takes {rows:.0f} rows; {MOST_REPEATED_ROWS} are the most; a formula does it", "beyond")

    @model_validator(mode="after")
    def _without_jumps(self) -> Self:
        if self.between == "straight" and self.default_between == "smooth":
            # A jump of the rate is an impulse that no equation here would pass on to the other coordinates.
            raise FaultError("would let the motion's rate jump at each time; 'smooth' works", "between")
        return self


class AngleOverTime(TimeFunction):
    """A prescribed angle [rad] over time; tables are smooth, because the second derivative acts as a load."""

    kind, default_between = "angle", "smooth"


class PositionOverTime(TimeFunction):
    """A prescribed displacement [m] over time; tables are smooth, because the second derivative acts as a load."""

    kind, default_between = "length", "smooth"


class ForceByElongation(FormulaOrTable):
    """Force of a nonlinear spring by its elongation: a formula, or a table in the scene or in a CSV file.

    Example:

        [spring.bump.force]
        elongations = ["-30 mm", "-10 mm", "0 mm", "40 mm"]
        values = [-9, -1.2, 0, 4.1]
        between = "smooth"
        unit = "kN"
    """

    kind = "force"
    variable = "x"
    argument = "elongation"

    # Formula of the elongation x in metres, e.g. ``"2000*x + 5e5*x**3"``; a formula or a table.
    formula: str | None = None
    # Course of a table between its elongations: ``"straight"`` lines, by default, or a ``"smooth"`` curve.
    between: Literal["straight", "smooth"] | None = None
    # Elongations of a table, ascending [m]. Beyond its ends the force goes on straight.
    elongations: Annotated[tuple[Length, ...], Field(min_length=2, max_length=MOST_ELONGATIONS)] | None = None
    elongation: Column | None = None  # Column of the file with the elongations.
    elongation_unit: LengthUnit = "m"  # Unit of the file's elongations.

    def _check_file(self, table: TableColumns) -> None:
        if len(table.values) > MOST_ELONGATIONS:
            raise FaultError(f"has {len(table.values)} rows; {MOST_ELONGATIONS} are the most", "file")
