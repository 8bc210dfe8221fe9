"""Quantities with units, read from text into SI floats.

A scene gives every quantity as text with its unit, ``"340 mm"``. The types below are floats that read this text,
convert it to SI units and refuse a wrong dimension, an unknown unit and a value that isn't finite. In a scene file
they refuse a bare number, too; in Python it is in SI units.

Radians count as a dimension here: ``"131.2 Hz"`` is no angular rate and ``"8000 rpm"`` no frequency, so no factor 2π is
lost on the way. A rotational spring or damper may leave out its radian, as is usual: ``"5 N m"`` is ``"5 N m/rad"``.
"""

from __future__ import annotations

import math
import re
from decimal import Decimal
from functools import cache, lru_cache
from importlib.metadata import version
from typing import TYPE_CHECKING, Annotated, Any, TypeGuard

from pydantic import (
    AfterValidator,
    BeforeValidator,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationInfo,
    WithJsonSchema,
)
from pydantic_core import CoreSchema, core_schema

from fmd.core.cache import Cache
from fmd.core.common_units import common_unit
from fmd.core.data_classes import dataclass
from fmd.core.limits.scene import ANY_SIZE, FORMULAS_KEPT, LONGEST_QUANTITY, POSSIBLE
from fmd.core.paths import cache_folder

if TYPE_CHECKING:
    import pint

    from fmd.core.arrays import Array

# Kinds of quantities with SI unit and example. The last rows only give wrong quantities their name.
_KINDS = {
    "length": ("m", "340 mm"),
    "stress": ("Pa", "722 MPa"),
    "density": ("kg/m^3", "2780 kg/m^3"),
    "time": ("s", "0.5 ms"),
    "frequency": ("Hz", "131.2 Hz"),
    "angle": ("rad", "90 deg"),
    "angular rate": ("rad/s", "20 rad/s"),
    "torque": ("N m", "1.5 N m"),
    "force": ("N", "10 N"),
    "mass": ("kg", "2 kg"),
    "speed": ("m/s", "3 m/s"),
    "moment of inertia": ("kg m^2", "0.5 kg m^2"),
    "translational stiffness": ("N/m", "1000 N/m"),
    "rotational stiffness": ("N m/rad", "10 N m/rad"),
    "translational damping": ("N s/m", "2 N s/m"),
    "rotational damping": ("N m s/rad", "0.1 N m s/rad"),
    "acceleration": ("m/s^2", "9.81 m/s^2"),
    "area": ("m^2", "1 m^2"),
    "volume": ("m^3", "1 m^3"),
    "inverse of a stress": ("Pa^-1", "1e-14 1/Pa"),
    "temperature": ("K", "293 K"),
}

# Other units that count as the SI unit.
_ALSO = {"rotational stiffness": "N m", "rotational damping": "N m s"}

# Only units with exponents of one digit reach pint's parser: an expression such as 9**9**9 can't.
_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|[+-]?(?:nan|inf)\b"
_UNIT = r"[A-Za-zµμ°]+(?:(?:\^|\*\*)-?[1-9]|[²³])?"
_PRODUCT = rf"(?:(?<=\s)1\s*/\s*)?{_UNIT}(?:(?:\s*[*/·]\s*|\s+){_UNIT})*"
_UNITS = re.compile(_PRODUCT)
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*({_PRODUCT})?\s*")


@cache
def _known_units() -> dict[str, list[str]]:
    """Other than common units that have been read before, with factor and base units: these need no registry."""
    known = _store().load(_known_name(), "dict")
    try:
        return {str(unit): [str(Decimal(factor)), str(base)] for unit, (factor, base) in (known or {}).items()}
    except (ValueError, TypeError, ArithmeticError):  # of another version
        return {}


def _store() -> Cache:
    return Cache(cache_folder() / "units")


def _known_name() -> str:
    return f"known-{version('pint')}"


@cache
def _registry() -> pint.UnitRegistry[Decimal]:
    """Load pint's registry of units when an unknown unit is first read; decimals make 10 us exactly 1e-05 s.

    Pint's own cache of it is made of pickles and isn't used.
    """
    import pint

    return pint.UnitRegistry(non_int_type=Decimal)


def to_si(value: object, kind: str) -> float:
    """Convert a quantity given as text, e.g. ``"340 mm"``, to the SI unit of its kind, e.g. ``"length"``.

    Raises
    ------
    ValueError
        The text is no quantity of this kind; the message gives one that works.
    """
    si, example = _KINDS[kind]
    wanted = f"{_article(kind)} is wanted, e.g. '{example}'"
    if isinstance(value, int | float):
        raise ValueError(f"needs a unit, e.g. '{example}'")
    if not isinstance(value, str) or len(value) > LONGEST_QUANTITY or not (match := _QUANTITY.fullmatch(value)):
        raise ValueError(f"isn't a number with a unit: {wanted}")
    number, unit = match.groups()
    if unit is None:
        raise ValueError(f"needs a unit, e.g. '{example}'")
    factor, base = _base_units(unit)
    if not base:
        raise ValueError(f"'{unit}' isn't a known unit: {wanted}")
    if base not in (_base_units(si)[1], _base_units(_ALSO.get(kind, si))[1]):
        raise ValueError(f"{value!r} is {_dimension(base)}, {wanted}")
    try:
        result = float(Decimal(number) * factor)
    except ArithmeticError:
        result = math.inf
    if not math.isfinite(result):
        raise ValueError(f"{value!r} isn't finite: {wanted}")
    return result


def is_si_number(value: object, info: ValidationInfo) -> TypeGuard[float]:
    """Return True for a number that stands for a quantity in SI units: in Python, but not in a scene file.

    A scene file is checked with the context ``{"units": True}``.
    """
    return isinstance(value, int | float) and not isinstance(value, bool) and not (info.context or {}).get("units")


@dataclass(frozen=True, slots=True)
class QuantityReader:
    """Reader of quantities of one kind, from text with a unit or, in Python, from numbers in SI units."""

    kind: str  # kind of quantity, e.g. ``"length"``

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_before_validator_function(self, handler(source))

    def __get_pydantic_json_schema__(self, _: CoreSchema, __: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"$quantity": self.kind}  # which `fmd.scene.schema` writes out

    def __call__(self, value: object, info: ValidationInfo) -> float:
        """Return the value in SI units, or raise ``ValueError`` as `to_si` does."""
        given = float(value) if is_si_number(value, info) else to_si(value, self.kind)
        return require_possible(given, self.kind)


def require_possible(value: float, kind: str = "number") -> float:
    """Return a quantity in SI units or a plain number, or raise ``ValueError`` if none can be so large or so small."""
    low, high = POSSIBLE.get(kind, ANY_SIZE)
    if value and not low <= abs(value) <= high:
        limit = f"the least is {low:g}" if abs(value) < low else f"the greatest is {high:g}"
        si = f" {si_unit(kind)}" if kind in _KINDS else ""
        raise ValueError(f"{value:g}{si} can't be {_article(kind)}: {limit}{si}")
    return value


def parse_quantity(text: str) -> tuple[float, str]:
    """Convert a quantity of any kind to SI units: ``parse_quantity("2 us")`` is ``(2e-06, "s")``.

    Raises
    ------
    ValueError
        The text is no number with a known unit.
    """
    match = _QUANTITY.fullmatch(text) if len(text) <= LONGEST_QUANTITY else None
    factor, base = _base_units(match[2]) if match and match[2] else (Decimal(0), "")
    if match is None or not base:
        raise ValueError(f"{text!r} isn't a number with a unit")
    unit = next((si for si, _ in _KINDS.values() if _base_units(si)[1] == base), base)
    return float(Decimal(match[1]) * factor), unit


def si_unit(kind: str) -> str:
    """Return the SI unit of a kind of quantity: ``si_unit("angular rate")`` is ``"rad/s"``."""
    return _KINDS[kind][0]


def parse_percentage(value: object) -> float:
    """Parse a percentage given as text: ``"1 %"`` is 0.01.

    Raises
    ------
    ValueError
        The value isn't a percentage as text, or not between 0.0001 % and 50 %.
    """
    match = re.fullmatch(rf"\s*({_NUMBER})\s*%\s*", value) if isinstance(value, str) else None
    if match is None:
        raise ValueError("must be a percentage as text, e.g. '1 %'")
    return _check_share(float(match[1]) / 100)


def _check_share(share: float) -> float:
    if not 1e-6 <= share <= 0.5:
        raise ValueError("must be between 0.0001 % and 50 %")
    return share


def read_share(value: object, info: ValidationInfo) -> float:
    """Return a share as a number: parsed as a percentage, or in Python given as it is."""
    return _check_share(float(value)) if is_si_number(value, info) else parse_percentage(value)


def example_of(kind: str) -> str:
    """Return a quantity of a kind, as text: ``example_of("length")`` is ``"340 mm"``."""
    return _KINDS[kind][1]


def list_units() -> dict[str, list[str]]:
    """List the names of mechanical units that can be read, without prefixes, by the kind of their quantity.

    Under the key ``""`` are those whose dimension has no name here.
    """
    registry = _registry()
    kinds = {str(registry.get_base_units(si)[1]): kind for kind, (si, _) in reversed(_KINDS.items())}
    found: dict[str, list[str]] = {kind: [] for kind in ("", *_KINDS)}
    for name in registry:
        if re.fullmatch(_UNIT, name):
            base = str(registry.get_base_units(name)[1])
            if not re.search("ampere|mole|candela|bit|count|pixel|dimensionless", base):
                found[kinds.get(base, "")].append(name)
    return found


def unit_ratio(unit: str, wanted: str) -> float:
    """Return the number of wanted units in one unit: ``unit_ratio("m", "mm")`` is 1000.

    Raises
    ------
    ValueError
        The wanted unit is unknown, or has another dimension.
    """
    factor, base = _base_units(unit)
    known = len(wanted) <= LONGEST_QUANTITY and _UNITS.fullmatch(wanted)
    wanted_factor, wanted_base = _base_units(wanted) if known else (Decimal(0), "")
    if wanted_base != base:
        raise ValueError(f"isn't a unit that {unit} converts to; '{unit}' works")
    return float(factor / wanted_factor)


def convert_values(values: Array, unit: str, wanted: str) -> Array:
    """Convert values from one unit to another; raises as `unit_ratio` does."""
    return values * unit_ratio(unit, wanted)


@lru_cache(maxsize=FORMULAS_KEPT)
def _base_units(unit: str) -> tuple[Decimal, str]:
    """Return the factor to base units (kg, m, s, rad, …) and these as text, empty for an unknown unit."""
    if (common := common_unit(unit)) is not None:
        return common
    known = _known_units()
    if unit not in known:
        registry = _registry()
        try:
            found = registry.get_base_units(registry.parse_units(unit))
        except (AttributeError, ValueError, TypeError):  # what pint's errors derive from
            return Decimal(0), ""
        known[unit] = [str(x) for x in found]
        _store().save(_known_name(), known)
    factor, base = known[unit]
    return Decimal(factor), base


def _dimension(base: str) -> str:
    """Name the dimension of base units, "a mass"; one without a name is given by the units themselves."""
    for kind, (si, _) in _KINDS.items():
        if _base_units(si)[1] == base:
            return _article(kind)
    return f"in '{base}'"


def _article(kind: str) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"


def _positive(value: float) -> float:
    if not value > 0:
        raise ValueError("must be greater than zero")
    return value


def _not_negative(value: float) -> float:
    if not value >= 0:
        raise ValueError("must not be negative")
    return value


Positive = AfterValidator(_positive)
NonNegative = AfterValidator(_not_negative)

Share = Annotated[
    float, BeforeValidator(read_share), WithJsonSchema({"type": "string", "pattern": rf"^\s*({_NUMBER})\s*%\s*$"})
]
Length = Annotated[float, QuantityReader("length")]
Stress = Annotated[float, QuantityReader("stress")]
Density = Annotated[float, QuantityReader("density")]
Time = Annotated[float, QuantityReader("time")]
Frequency = Annotated[float, QuantityReader("frequency")]
Angle = Annotated[float, QuantityReader("angle")]
AngularRate = Annotated[float, QuantityReader("angular rate")]
Torque = Annotated[float, QuantityReader("torque")]
MomentOfInertia = Annotated[float, QuantityReader("moment of inertia")]
Mass = Annotated[float, QuantityReader("mass")]
Velocity = Annotated[float, QuantityReader("speed")]
TranslationalStiffness = Annotated[float, QuantityReader("translational stiffness")]
RotationalStiffness = Annotated[float, QuantityReader("rotational stiffness")]
TranslationalDamping = Annotated[float, QuantityReader("translational damping")]
RotationalDamping = Annotated[float, QuantityReader("rotational damping")]
Force = Annotated[float, QuantityReader("force")]
Acceleration = Annotated[float, QuantityReader("acceleration")]

PositiveLength = Annotated[Length, Positive]
PositiveStress = Annotated[Stress, Positive]
PositiveDensity = Annotated[Density, Positive]
PositiveMass = Annotated[Mass, Positive]
PositiveTime = Annotated[Time, Positive]
PositiveFrequency = Annotated[Frequency, Positive]
NonNegativeTime = Annotated[Time, NonNegative]
NonNegativeCompliance = Annotated[float, QuantityReader("inverse of a stress"), NonNegative]
