"""Forces and torques that change with time or by a formula of the mechanism's own motion, as a controller's do."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import AfterValidator, Field, GetJsonSchemaHandler, ValidationInfo, WithJsonSchema, model_validator
from pydantic_core import CoreSchema

from fmd.core.formula import OF_TIME
from fmd.core.limits.scene import CLOSES
from fmd.core.state_formula import StateFormula, depends_on_state, parse_state_formula
from fmd.core.units import parse_quantity, require_possible
from fmd.scene.curves import TimeFunction
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.table_files import Column, read_columns
from fmd.scene.values import Number, SourceFile

OWN = {"q": 0, "rate": 1}
"""Names of the position and the rate of the joint that a drive acts on, with their orders."""

_DERIVATIVES = {"rate": 1, "acceleration": 2}
_VARIABLE = "[A-Za-z][A-Za-z0-9_]{0,39}"


def _check_variable(name: str) -> str:
    if not re.fullmatch(_VARIABLE, name) or name in OF_TIME or name in OWN:
        raise ValueError(
            "a variable's name is a letter and up to 39 letters, digits or '_', and no function, t, q or rate"
        )
    return name


VariableName = Annotated[
    str, AfterValidator(_check_variable), WithJsonSchema({"type": "string", "pattern": f"^{_VARIABLE}$"})
]
AnyUnit = Annotated[str, WithJsonSchema({"$unit": True})]


class MeasuredName(NamedTuple):
    """Name of a quantity of the motion in a formula."""

    place: str  # a joint, or a marker with its body
    axis: int  # axis of space, of a marker's motion; -1 for a joint's
    order: int  # 0 for a position, 1 for a rate or velocity


def read_measured(name: str) -> MeasuredName | None:
    """Read ``"joint.angle"``, ``"joint.rate"``, ``"body.marker.x"`` or ``"body.marker.vx"``; nothing else is one."""
    place, _, what = name.rpartition(".")
    if what in ("position", "angle", "rate") and place and "." not in place:
        return MeasuredName(place, -1, int(what == "rate"))
    if re.fullmatch("v?[xyz]", what) and place.count(".") == 1:
        return MeasuredName(place, "xyz".index(what[-1]), len(what) - 1)
    return None


class FormulaVariable(SceneTable):
    """A variable of a formula: a number, a quantity, a part of the motion, or a curve that the formula calls.

    A number is in SI units, ``40.0``, a quantity has its unit, ``"40 N m/rad"``. A part of the motion is a joint's
    ``"joint.angle"`` (or ``position``) or ``"joint.rate"``, or a marker's place or velocity in space,
    ``"body.marker.x"`` or ``"body.marker.vx"``. A curve is a table, in the scene or in a file. The formula calls it
    with a value, ``gas(q)``, or with the time, ``ref(t)``; ``ref.rate`` and ``ref.acceleration`` are its derivatives.

    Example:

        [drive.gas.torque.variables.pressure]
        arguments = [0, 10, 30, 60, 180, 540, 720]
        values = [40, 62, 31, 12, 3, 1, 40]
        argument_unit = "deg"
        unit = "bar"
        beyond = "repeat"
    """

    constant: float | None = None  # Value in SI units; no key of a scene.
    measured: str | None = None  # Part of the motion; no key of a scene.
    # Arguments of a curve in ``argument_unit``, ascending.
    arguments: Annotated[tuple[Number, ...], Field(min_length=2, max_length=10_000)] | None = None
    values: tuple[Number, ...] | None = None  # Values of the curve in ``unit``, one for each.
    file: SourceFile | None = None  # CSV file that holds the curve, relative to the scene's file.
    # Columns of the file with the arguments and with the values.
    argument: Column | None = None
    column: Column | None = None
    # Units of the arguments and of the values; SI without them.
    argument_unit: AnyUnit | None = None
    unit: AnyUnit | None = None
    # Course between the arguments: ``"straight"`` lines or a ``"smooth"`` curve.
    between: Literal["straight", "smooth"] = "straight"
    # What holds before and after the arguments: the first and the last value (``"hold"``), or the curve again and again
    # (``"repeat"``), as a force by a crank's angle over 720° does.
    beyond: Literal["hold", "repeat"] = "hold"

    _not_keys: ClassVar[tuple[str, ...]] = ("constant", "measured")

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        table = handler.resolve_ref_schema(handler(schema))
        for key in cls._not_keys:
            table["properties"].pop(key, None)
        return {"anyOf": [{"type": ["number", "string"]}, dict(table)]}

    @model_validator(mode="before")
    @classmethod
    def _read_a_value(cls, value: Any) -> Any:
        if isinstance(value, cls):
            return value
        if isinstance(value, dict):
            for key in cls._not_keys:
                if key in value:
                    keys = ", ".join(key for key in cls.model_fields if key not in cls._not_keys)
                    raise FaultError(f"no such key; the keys here: {keys}", key)
            return value
        if isinstance(value, int | float) and not isinstance(value, bool):
            return {"constant": require_possible(float(value))}
        if isinstance(value, str) and read_measured(value):
            return {"measured": value}
        if isinstance(value, str) and re.match(r"\s*[-+.0-9]", value):
            return {"constant": require_possible(parse_quantity(value)[0])}
        ways = "a number, a quantity such as '40 N m/rad', 'joint.angle', 'body.marker.x', or a table of a curve"
        raise ValueError(f"must be {ways}")

    @model_validator(mode="after")
    def _is_a_curve(self, info: ValidationInfo) -> FormulaVariable:
        if not self.is_curve:
            return self
        for key, unit in self._units:
            unit_factor(unit, key)
        if self.file is not None:
            for key in ("arguments", "values"):
                if getattr(self, key) is not None:
                    raise FaultError("can't stand beside file, which holds the curve", key)
            for key in ("argument", "column"):
                if getattr(self, key) is None:
                    raise FaultError("is missing: the column's name in the file's first row, or its number from 1", key)
            assert self.argument is not None
            assert self.column is not None
            folder = Path((info.context or {}).get("folder", "."))
            table = read_columns(folder, self.file, ("argument", self.argument), ("column", self.column))
            self._require_closed(table.values)
            return self.model_copy(update={"arguments": table.arguments, "values": table.values})
        for key in ("argument", "column"):
            if getattr(self, key) is not None:
                raise FaultError("belongs to a curve in a file: give file, too", key)
        if self.arguments is None:
            raise FaultError("is missing: a curve has arguments and values, or a file of them", "arguments")
        if self.values is None or len(self.values) != len(self.arguments):
            raise FaultError(f"must hold {len(self.arguments)} values, one for each argument", "values")
        for number, (before, after) in enumerate(pairwise(self.arguments), start=1):
            if not after > before:
                raise FaultError("must be above the argument before it", "arguments", number)
        self._require_closed(self.values)
        return self

    def _require_closed(self, values: tuple[float, ...]) -> None:
        if self.beyond == "repeat" and abs(values[-1] - values[0]) > CLOSES * (max(map(abs, values)) or 1.0):
            raise FaultError("needs a curve that ends as it begins; 'hold' works", "beyond")

    @property
    def is_curve(self) -> bool:
        """True for a curve."""
        return self.constant is None and self.measured is None

    @property
    def _units(self) -> tuple[tuple[str, str | None], ...]:
        return (("argument_unit", self.argument_unit), ("unit", self.unit))

    @property
    def rows(self) -> tuple[list[float], list[float]]:
        """Arguments and values of a curve in SI units."""
        of_arguments, of_values = (unit_factor(unit, key) for key, unit in self._units)
        return [of_arguments * x for x in self.arguments or ()], [of_values * x for x in self.values or ()]


def unit_factor(unit: str | None, key: str) -> float:
    """Return how many SI units a unit is, 1 for none; raises ``FaultError`` at a key if it is unknown."""
    if unit is None:
        return 1.0
    try:
        return parse_quantity(f"1 {unit}")[0]
    except ValueError:
        raise FaultError("isn't a known unit", key) from None


class FormulaVariables(SceneTable):
    """A table whose formulas may name variables of its own."""

    # Variables of formulas, as those of a drive's.
    variables: dict[VariableName, FormulaVariable] = Field(default_factory=dict)

    def parse(self, text: str) -> StateFormula:
        """Parse a formula of the motion; raises ``ValueError`` as `parse_state_formula` does."""
        return parse_state_formula(text, [name for name, of in self.variables.items() if of.is_curve])

    def find_unused(self, formulas: Sequence[StateFormula]) -> Iterator[str]:
        """Yield the variables that none of some formulas names."""
        used = {name for formula in formulas for name in (*formula.names, *formula.curves)}
        for name in self.variables:
            if not used & {name, *(f"{name}.{suffix}" for suffix in _DERIVATIVES)}:
                yield name

    def find_derivative(self, name: str) -> tuple[FormulaVariable, int] | None:
        """Return the curve that a name is, or is a derivative of, and of which order; none for another name."""
        own, _, suffix = name.rpartition(".")
        order = _DERIVATIVES.get(suffix, 0) if own else 0
        curve = self.variables.get(own if order else name)
        return (curve, order) if curve is not None and curve.is_curve else None

    def find_constant(self, name: str) -> float | None:
        """Return the value of a variable that is a number."""
        return self.variables[name].constant if name in self.variables else None

    def find_measured(self, name: str) -> MeasuredName | None:
        """Return the part of the motion that a name stands for, but for the driven joint's own."""
        measured = self.variables[name].measured if name in self.variables else name
        return read_measured(measured or "")


class LoadOverTime(TimeFunction, FormulaVariables):
    """A force or torque that is constant, changes with time, or follows the mechanism's own motion by a formula.

    Example:

        [drive.servo.torque]
        formula = "k*(0.3*sin(2*t) - q) - c*rate"
        unit = "N m"
        variables = { k = "400 N m/rad", c = "20 N m s/rad" }
    """

    # Variables of the formula by name; so it may depend on the motion of joints and markers. Without any it may name
    # ``q`` and ``rate``, position and rate of the joint that it drives [rad, m], parts of the motion such as
    # ``elbow.angle`` and ``arm.tip.x``, and controllers.
    variables: dict[VariableName, FormulaVariable] = Field(default_factory=dict)

    @property
    def state(self) -> StateFormula | None:
        """Formula of the mechanism's state; none where the time alone counts."""
        if self.formula is None or not depends_on_state(self.formula):
            return None
        return self.parse(self.formula)

    def _check_formula(self, text: str) -> None:
        try:
            state = self.state
        except ValueError as error:
            raise FaultError(str(error), "formula") from None
        if state is None:
            super()._check_formula(text)
        for name in self.find_unused([state] if state else []):
            raise FaultError("isn't in the formula", "variables", name)

    @model_validator(mode="after")
    def _has_a_formula(self) -> LoadOverTime:
        if self.variables and self.formula is None:
            raise FaultError("belongs to a formula", "variables")
        return self


class TorqueOverTime(LoadOverTime):
    """A torque [N m]: constant, over time, or by a formula of the motion."""

    kind = "torque"


class ForceOverTime(LoadOverTime):
    """A force [N]: constant, over time, or by a formula of the motion."""

    kind = "force"
