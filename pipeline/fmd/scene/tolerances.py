"""Tolerances of a scene's numbers, ``mass = "0.4 kg ± 2 %"``: how far real machines may be from their drawing."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from fmd.core.units import parse_percentage, parse_quantity
from fmd.scene.reading import Fault
from fmd.scene.toml_lines import KeyPath

_TOLERANCE = re.compile(r"\s*([-+]?[0-9.].*?)\s*(?:±|\+/-|\+-)\s*(.*?)\s*")
_MARKS = ("±", "+/-", "+-")
_TEXTS = ("title", "source")


def split_tolerances(tables: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, float], list[Fault]]:
    """Split the tolerances of a scene's tables, as they are read, from the numbers that have them.

    Returns the tables with the numbers alone; tolerances, relative to these, by dotted keys; and what is wrong with
    them.
    """
    found: dict[str, float] = {}
    faults: list[Fault] = []
    whole = {  # to look for the marks in a whole table's text takes a tenth of the time of looking through its values
        key: _split(table, (key,), found, faults) if key not in _TEXTS and _has_mark(_text_of(table)) else table
        for key, table in tables.items()
    }
    return whole, found, faults


def _text_of(table: Any) -> str:
    try:
        return repr(table)
    except ValueError:  # an integer of more digits than are written, which a check refuses
        return _MARKS[0]


def _has_mark(text: str) -> bool:
    return any(mark in text for mark in _MARKS)


def _split(node: Any, path: KeyPath, found: dict[str, float], faults: list[Fault]) -> Any:
    if not isinstance(node, str):  # most are text, and to ask for a mapping takes long
        if isinstance(node, list):
            return [_split(value, (*path, k), found, faults) for k, value in enumerate(node)]
        if isinstance(node, Mapping):
            return {key: _split(value, (*path, key), found, faults) for key, value in node.items()}
        return node
    match = _TOLERANCE.fullmatch(node) if _has_mark(node) else None
    if match is None:
        return node
    try:
        found[".".join(str(key) for key in path)] = _relative(*match.groups())
    except ValueError as error:
        faults.append(
            Fault(path, f"{error}; a tolerance is a share or a quantity like the number, e.g. '0.4 kg ± 2 %'")
        )
    return next(_plain_numbers(match[1]), match[1])


def _relative(number: str, tolerance: str) -> float:
    """Return a tolerance relative to its number, between 0.0001 % and 50 %."""
    if "%" in tolerance:
        return parse_percentage(tolerance)
    sizes = [next(_plain_numbers(text), None) for text in (number, tolerance)]
    if sizes[0] is None or sizes[1] is None:
        (value, unit), (size, other) = parse_quantity(number), parse_quantity(tolerance)
        if unit != other:
            raise ValueError(f"{tolerance!r} isn't in a unit of {number!r}")
        sizes = [value, size]
    value, size = (float(x or 0.0) for x in sizes)
    return parse_percentage(f"{100.0 * size / abs(value) if value else 0.0!r} %")


def _plain_numbers(text: str) -> Iterator[float]:
    """Yield the number of a text that has no unit."""
    if re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", text):
        yield float(text)
