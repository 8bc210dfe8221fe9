"""Quantities of a scene that change with time: a constant, a formula or a table."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from pipeline.core.units import NonNegativeTime, to_si, unit_ratio
from pipeline.scene.reading import FaultError, Table

_KEYS = ("formula", "times", "values", "between", "unit")
Sample = Annotated[float, Field(strict=True)]


class TimeFunction(Table):
    """A quantity over time: ``"5 N m"``, or ``{ formula = "5*sin(2*pi*t)", unit = "N m" }``, or a table.

    Parameters
    ----------
    constant : float, optional
        Its value in SI units if it doesn't change; in a scene this is the quantity itself.
    formula : str, optional
        Of the time t in seconds.
    times : tuple of float, optional
        Of the table [s]; the first and the last value hold before and after.
    values : tuple of float, optional
        One for each time.
    between : str
        How the table goes on between its times.
    unit : str, optional
        Of the formula's or the table's values.
    """

    kind: ClassVar[str]
    si: ClassVar[str]
    default_between: ClassVar[Literal["straight", "smooth"]] = "straight"

    constant: float | None = None
    formula: str | None = None
    times: Annotated[tuple[NonNegativeTime, ...], Field(min_length=2, max_length=10_000)] | None = None
    values: tuple[Sample, ...] | None = None
    between: Literal["straight", "smooth"] | None = None
    unit: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _read_a_constant(cls, value: Any) -> Any:
        if isinstance(value, cls):
            return value
        if not isinstance(value, dict):
            return {"constant": to_si(value, cls.kind)}
        if "constant" in value:
            raise FaultError(f"no such key; the keys here: {', '.join(_KEYS)}", "constant")
        return value

    @model_validator(mode="after")
    def _given_one_way(self) -> TimeFunction:
        if self.constant is not None:
            return self
        if (self.formula is None) == (self.times is None):
            raise FaultError(
                "is missing: give a formula of t, or a table of times and values, one of the two", "formula"
            )
        if self.unit is None:
            raise FaultError(f"is missing: what the values are in, e.g. '{self.si}'", "unit")
        try:
            unit_ratio(self.unit, self.si)
        except ValueError:
            raise FaultError(f"isn't a unit of {self.kind}; '{self.si}' works", "unit") from None
        if self.formula is not None:
            for key in ("values", "between"):
                if getattr(self, key) is not None:
                    raise FaultError("belongs to a table of times; a formula takes none", key)
            from pipeline.core.formula import parse_formula

            try:
                parse_formula(self.formula)
            except ValueError as error:
                raise FaultError(str(error), "formula") from None
        if self.times is not None:
            if self.values is None or len(self.values) != len(self.times):
                raise FaultError(f"must hold {len(self.times)} values, one for each time", "values")
            for number, (before, after) in enumerate(pairwise(self.times), start=1):
                if not after > before:
                    raise FaultError("must come after the time before it", "times", number)
        if self.between == "straight" and self.default_between == "smooth":
            # Such a jump is an impulse that no equation here would pass on to the other coordinates.
            raise FaultError("would let the motion's rate jump at each time; 'smooth' works", "between")
        return self

    @property
    def factor(self) -> float:
        """SI units in one unit of the values."""
        return 1.0 if self.unit is None else unit_ratio(self.unit, self.si)

    @property
    def smooth(self) -> bool:
        """Whether a table goes on as a smooth curve."""
        return (self.between or self.default_between) == "smooth"


class TorqueOverTime(TimeFunction):
    """A torque [N m]."""

    kind, si = "torque", "N m"


class ForceOverTime(TimeFunction):
    """A force [N]."""

    kind, si = "force", "N"


class AngleOverTime(TimeFunction):
    """An angle [rad]; a table of it is smooth, for its second derivative acts as a load."""

    kind, si, default_between = "angle", "rad", "smooth"


class PositionOverTime(TimeFunction):
    """A displacement [m]; a table of it is smooth, for its second derivative acts as a load."""

    kind, si, default_between = "length", "m", "smooth"
