"""Universal files (UFF, UNV) of measurements: datasets 58, functions at nodal degrees of freedom, as text.

The layout is that of SDRC's I-DEAS, as the Structural Dynamics Research Laboratory of the University of Cincinnati
publishes it. Nodes are named by the scene's markers.
"""

from collections.abc import Iterator, Mapping
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmd.core.arrays import Array
from fmd.core.fortran import read_real
from fmd.output.responses import response_unit
from fmd.scene.reading import FaultError

_MARK = "    -1"
_MOTIONS = {8: (".displacement", ""), 11: (".velocity",) * 2, 12: (".acceleration",) * 2}
"""What histories and responses are called, by the specific type of data."""
_UNITS = {8: "m", 11: "m/s", 12: "m/s^2"}
_FORCES = (9, 13)  # of reaction and of excitation
_DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
_WIDTHS = {(2, True): [13], (2, False): [13, 13], (4, True): [20], (4, False): [13, 20]}
_WIDTHS |= {(5, True): [13, 13], (5, False): [13] * 3, (6, True): [20, 20], (6, False): [13, 20, 20]}
"""Widths of the numbers of each value, by the type of ordinates and whether abscissas are even."""


class _Kind(IntEnum):
    """Types of functions that are read."""

    TIME_RESPONSE = 1
    FREQUENCY_RESPONSE = 4


class UniversalFunction(NamedTuple):
    """A dataset 58: a function of time or frequency at a node."""

    kind: int  # 1 for a time response, 4 for a frequency response
    response: tuple[int, int]  # node and direction of what is measured, ±1 … ±3 along and ±4 … ±6 about x, y, z
    reference: tuple[int, int]  # node and direction of what acts, likewise
    motion: int  # specific type of the ordinate's numerator
    force: int  # specific type of the ordinate's denominator
    unit: str  # what the numerator's unit is called, ``NONE`` or empty if it is not said
    x: Array  # (n,): abscissas
    values: NDArray[np.inexact]  # (n,): real or complex ordinates


def read_universal(path: Path, places: Mapping[int, str]) -> tuple[list[str], list[Array]]:
    """Read the functions of a universal file as columns with names and units; values are taken in SI units.

    Markers stand for numbers of nodes; functions at others are left out.

    Raises
    ------
    FaultError
        It isn't such a file, its functions are of several kinds or abscissas, or no node has a marker.
    """
    functions = [each for each in read_functions(path) if each.kind in list(_Kind)]
    if not functions:
        raise FaultError("has no time responses and no frequency responses (datasets 58 of type 1 and 4)")
    nodes = sorted({each.response[0] for each in functions} | {each.reference[0] for each in functions} - {0})
    unknown = sorted({*places} - {*nodes})
    if unknown:
        raise FaultError(f"has no node {unknown[0]}; there are {_list(nodes)}")
    kinds = {each.kind for each in functions}
    if len(kinds) > 1:
        raise FaultError("has time responses and frequency responses; give each kind a file of its own")
    responds = kinds == {_Kind.FREQUENCY_RESPONSE}
    there = [each for each in functions if each.response[0] in places]
    chosen = [each for each in there if each.reference[0] in places or not responds]
    if not chosen:
        raise FaultError(f"needs markers for its nodes {_list(nodes)}: FILE; {nodes[0]}=BODY.MARKER")
    x = chosen[0].x
    if any(each.x.shape != x.shape or np.abs(each.x - x).max() > 1e-6 * np.abs(x).max() for each in chosen):
        raise FaultError("has functions over several abscissas; give those of each a file of its own")
    header, columns = ["frequency [Hz]" if responds else "time [s]"], [x]
    for each in chosen:
        name, unit, values = _name_function(each, places)
        parts = {" real": values.real, " imaginary": values.imag} if responds else {"": values.real}
        for part, column in parts.items():
            header.append(f"{name}{part} [{unit}]")
            columns.append(np.array(column))
    twice = {name for name in header if header.count(name) > 1}
    if twice:
        raise FaultError(f"has {sorted(twice)[0]} twice; give each measurement a file of its own")
    return header, columns


def _name_function(function: UniversalFunction, places: Mapping[int, str]) -> tuple[str, str, NDArray[np.inexact]]:
    """Return a function's name and unit as those of a table's column, and its values in the axes' sense."""
    (node, direction), (other, along) = function.response, function.reference
    responds = function.kind == _Kind.FREQUENCY_RESPONSE
    if responds and not np.iscomplexobj(function.values):
        raise FaultError(f"has a frequency response of real numbers at node {node}, without phase; write complex ones")
    if function.motion not in _MOTIONS or not 1 <= abs(direction) <= (6 if responds else 3):
        what = f"type {function.motion} in direction {direction}"
        raise FaultError(f"has {what} at node {node}: displacements, velocities and accelerations are read")
    if _plain(function.unit) not in ("", "none", _plain(_UNITS[function.motion])):
        raise FaultError(f"has values in {function.unit!r} at node {node}; write them in {_UNITS[function.motion]}")
    axis, sign = _DIRECTIONS[abs(direction) - 1], float(np.sign(direction))
    quantity, unit = _MOTIONS[function.motion][responds], _UNITS[function.motion]
    if not responds:
        return f"{places[node]}{quantity}.{axis}", unit, sign * function.values
    if function.force not in _FORCES or not 1 <= abs(along) <= 6:
        raise FaultError(f"has a response to type {function.force} in direction {along}: those to forces are read")
    turned = unit.replace("m", "rad", 1) if abs(direction) > 3 else unit
    load = "N m" if abs(along) > 3 else "N"
    name = f"{places[node]}.{axis}{quantity} by {places[other]}.{_DIRECTIONS[abs(along) - 1]}"
    return name, response_unit(turned, load), sign * float(np.sign(along)) * function.values


def _plain(unit: str) -> str:
    """Return a unit's name without what programs write differently: m/s^2, m/s**2, M/S2."""
    return "".join(letter for letter in unit.casefold() if letter not in "^* ()")


def read_functions(path: Path) -> list[UniversalFunction]:
    """Read all datasets 58 of a universal file.

    Raises
    ------
    FaultError
        It isn't one, a dataset is cut off or binary, or its units aren't SI.
    """
    lines = path.read_bytes().decode("latin-1").splitlines()  # programs write names of tests in any of its letters
    found = []
    for kind, records in _datasets(lines):
        if kind == "58b":
            raise FaultError("has a binary dataset 58b; write it as text")
        if kind == "164" and records[0][:10].strip() != "1":
            raise FaultError("isn't in SI units (dataset 164); write it in SI units")
        if kind == "58":
            try:
                found.append(_read_function(records))
            except (ValueError, IndexError, KeyError):
                raise FaultError(f"dataset 58 number {len(found) + 1} isn't laid out as such") from None
    return found


def _datasets(lines: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield the number of each dataset and its records, which stand between lines of -1."""
    marks = [k for k, line in enumerate(lines) if line.rstrip() == _MARK]
    if not marks or len(marks) % 2:
        raise FaultError("isn't a universal file, or is cut off: datasets stand between lines of -1")
    for begin, end in zip(marks[::2], marks[1::2], strict=True):
        if end > begin + 1:
            yield lines[begin + 1][:7].strip(), lines[begin + 2 : end]


def _read_function(records: list[str]) -> UniversalFunction:
    place, size = records[5].ljust(80), records[6]
    kind, count, ordinates = int(place[:5]), int(size[10:20]), int(size[:10])
    even, first, step = int(size[20:30]) == 1, float(size[30:43]), float(size[43:56])
    widths = _WIDTHS[ordinates, even]
    numbers = _numbers(records[11:], widths, count)
    x: Array = np.array(first + step * np.arange(count)) if even else numbers[:, 0]
    rest = numbers if even else numbers[:, 1:]
    values = rest[:, 0] + 1j * rest[:, 1] if ordinates in (5, 6) else rest[:, 0]
    response, reference = (int(place[41:51]), int(place[51:55])), (int(place[66:76]), int(place[76:80]))
    motion, force = (int(records[k][:10]) for k in (8, 9))
    return UniversalFunction(kind, response, reference, motion, force, records[8][47:67].strip(), x, values)


def _numbers(lines: list[str], widths: list[int], count: int) -> Array:
    """Return so many rows of numbers of some widths; each line begins with the first of a row."""
    values = []
    for line in lines:
        at, number = 0, 0
        while at < len(line.rstrip()):
            width = widths[number % len(widths)]
            values.append(read_real(line[at : at + width]))
            at, number = at + width, number + 1
    return np.array(values).reshape(count, len(widths))


def _list(nodes: list[int]) -> str:
    return ", ".join(str(node) for node in nodes[:12]) + (", …" if len(nodes) > 12 else "")
