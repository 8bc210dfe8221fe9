"""Common units of mechanics, as pint has them: loading its registry takes longer than many a scene's whole run."""

import re
from collections import Counter
from decimal import Decimal

_BASES = {"m": "meter", "kg": "kilogram", "s": "second", "rad": "radian", "K": "kelvin"}

# Units, each by a factor and earlier ones; decimals of π/180 and π/30 are as many as pint's.
_DEFINED = {
    "g": ("0.001", "kg"),
    "t": ("1000", "kg"),
    "N": ("1", "kg m/s^2"),
    "Pa": ("1", "N/m^2"),
    "J": ("1", "N m"),
    "W": ("1", "J/s"),
    "Hz": ("1", "s^-1"),
    "min": ("60", "s"),
    "deg": ("0.01745329251994329576923690768", "rad"),
    "rpm": ("0.1047197551196597746154214461", "rad/s"),
}
_PREFIXES = {"G": "1e9", "M": "1e6", "k": "1e3", "c": "1e-2", "m": "1e-3", "u": "1e-6", "µ": "1e-6", "n": "1e-9"}
_PREFIXED = {
    "m": "kcmuµn",
    "s": "muµn",
    "g": "m",
    "rad": "m",
    "N": "Mkmu",
    "Pa": "GMk",
    "J": "km",
    "W": "km",
    "Hz": "GMk",
}
_POWERS = {"²": 2, "³": 3}
_FACTOR = re.compile(r"(\s*[*/·]\s*|\s+|)([A-Za-zµ]+)(?:(?:\^|\*\*)(-?[1-9])|([²³]))?")

_Unit = tuple[Decimal, Counter[str]]


def common_unit(text: str) -> tuple[Decimal, str] | None:
    """Return a unit's factor to base units and these as text, as pint writes them; ``None`` if one isn't common."""
    if (found := _multiply(text, _COMMON)) is None or not any(found[1].values()):
        return None
    powers = sorted(found[1].items())
    above = [_power(name, power) for name, power in powers if power > 0]
    below = [_power(name, -power) for name, power in powers if power < 0]
    return found[0], " / ".join([" * ".join(above) or "1", *below])


def _power(name: str, power: int) -> str:
    return name if power == 1 else f"{name} ** {power}"


def _multiply(text: str, units: dict[str, _Unit]) -> _Unit | None:
    """Return the product of units in a text; ``None`` if one isn't known."""
    factor, powers, end = Decimal(1), Counter[str](), 0
    while match := _FACTOR.match(text, end):
        if (unit := units.get(match[2])) is None or bool(match[1]) != (end > 0):
            return None
        power = int(match[3] or _POWERS.get(match[4], 1)) * (-1 if "/" in match[1] else 1)
        factor, end = factor * unit[0] ** power, match.end()
        for name, own in unit[1].items():
            powers[name] += own * power
    return (factor, powers) if end == len(text) else None


def _all_units() -> dict[str, _Unit]:
    units = {symbol: (Decimal(1), Counter({name: 1})) for symbol, name in _BASES.items()}
    for symbol, (size, of) in _DEFINED.items():
        made = _multiply(of, units)
        assert made is not None
        units[symbol] = Decimal(size) * made[0], made[1]
    for symbol, prefixes in _PREFIXED.items():
        for prefix in prefixes:
            units.setdefault(prefix + symbol, (Decimal(_PREFIXES[prefix]) * units[symbol][0], units[symbol][1]))
    return units


_COMMON = _all_units()
