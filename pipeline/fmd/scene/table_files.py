"""Tables in text files: columns of numbers from CSV, for quantities that change with time or with an elongation."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import BeforeValidator, ValidationInfo

from fmd.core.formula import parse_formula
from fmd.core.limits.scene import FEWEST_ROWS, MOST_ROWS, MOST_TABLE_BYTES
from fmd.core.units import si_unit, unit_ratio
from fmd.scene.reading import FaultError, SceneTable, UnknownNameError
from fmd.scene.values import Words


def _check_column(column: object) -> object:
    if isinstance(column, bool) or not (
        (isinstance(column, str) and column.strip()) or (isinstance(column, int) and column >= 1)
    ):
        raise ValueError("must be the column's name in the file's first row, or its number from 1")
    return column


Column = Annotated[str | int, BeforeValidator(_check_column), Words("name of a column, or its number from 1")]


class TableColumns(NamedTuple):
    """Two columns of a file, row by row, in the file's units.

    Attributes
    ----------
    arguments : tuple of float
        Column of times or elongations, ascending.
    values : tuple of float
        Column of values.
    """

    arguments: tuple[float, ...]
    values: tuple[float, ...]


class _Row(NamedTuple):
    """Cells of a line of the file, with the line's number from 1."""

    line: int
    cells: list[str]


def scene_folder(info: ValidationInfo) -> Path:
    """Return the folder of the scene that is being checked, which its files are relative to."""
    return Path((info.context or {}).get("folder", "."))


def read_table(table: SceneTable, argument: str, others: Sequence[str], folder: Path) -> TableColumns | None:
    """Read the file of a quantity's table by its keys ``file``, ``column`` and that of the other column.

    Parameters
    ----------
    table : SceneTable
        The quantity's keys.
    argument : str
        Key of the column of times or elongations; ``argument_unit`` is that of its unit.
    others : sequence of str
        Keys that can't stand beside a file.
    folder : Path
        Folder of the scene.

    Returns
    -------
    TableColumns or None
        ``None`` if the quantity has no file.

    Raises
    ------
    FaultError
        As `read_columns`, or a key is missing or has no meaning beside another.
    """
    given = {key: getattr(table, key) for key in ("file", argument, "column")}
    if given["file"] is None:
        for key in (argument, "column", f"{argument}_unit"):
            if key in table.model_fields_set:
                raise FaultError("belongs to a table in a file: give file, too", key)
        return None
    for key in others:
        if getattr(table, key) is not None:
            raise FaultError("can't stand beside file, which holds the table", key)
    for key, column in given.items():
        if column is None:
            raise FaultError("is missing: the column's name in the file's first row, or its number from 1", key)
    return read_columns(folder, given["file"], (argument, given[argument]), ("column", given["column"]))


def check_curve(curve: Any, variable: str, arguments: str, kind: str) -> None:
    """Check a quantity that a formula or a table gives, once the table's file has been read.

    Parameters
    ----------
    curve : SceneTable
        The quantity's keys.
    variable : str
        Variable of its formula.
    arguments : str
        Key of the table's arguments, ``"times"`` or ``"elongations"``.
    kind : str
        Kind of quantity that the values are.

    Raises
    ------
    FaultError
        Not one of both is given, or it is wrong.
    """
    table, si = getattr(curve, arguments), si_unit(kind)
    ways = f"a formula of {variable}, or a table: {arguments} and values, or a file of them"
    if curve.formula is not None and table is not None:
        raise FaultError(f"can't stand beside a table: give one of the two, {ways}", "formula")
    if curve.formula is None and table is None:
        raise FaultError(f"is missing: give {ways}", "formula")
    if curve.unit is None:
        raise FaultError(f"is missing: what the values are in, e.g. '{si}'", "unit")
    try:
        unit_ratio(curve.unit, si)
    except ValueError:
        raise FaultError(f"isn't a unit of {kind}; '{si}' works", "unit") from None
    if curve.formula is not None:
        for key in ("values", "between"):
            if key in curve.model_fields_set and getattr(curve, key) is not None:
                raise FaultError(f"belongs to a table of {arguments}; a formula takes none", key)
        try:
            parse_formula(curve.formula, variable)
        except ValueError as error:
            raise FaultError(str(error), "formula") from None
        return
    word = arguments.removesuffix("s")
    if curve.values is None or len(curve.values) != len(table):
        raise FaultError(f"must hold {len(table)} values, one for each {word}", "values")
    for number, (before, after) in enumerate(pairwise(table), start=1):
        if not after > before:
            raise FaultError(f"must be above the {word} before it", arguments, number)


def read_columns(
    folder: Path, file: str, argument: tuple[str, str | int], value: tuple[str, str | int]
) -> TableColumns:
    """Read two columns of a CSV file; cells are divided by commas, semicolons, tabs or spaces.

    Parameters
    ----------
    folder : Path
        Folder of the scene.
    file : str
        The file, relative to it.
    argument, value : tuple
        Key of the scene that names the column, ``"time"``, and the column: its name in the first row, or its number.

    Raises
    ------
    FaultError
        The file can't be read, a column isn't there, a cell holds no number, or the arguments don't ascend.
    """
    rows, comma = _split_rows(_read_text(folder / file), file)
    header = rows[0].cells
    named = isinstance(argument[1], str) or isinstance(value[1], str)
    if named or not _is_number(header[0], comma):
        rows = rows[1:]
    numbers = [_find_column(header, *column) for column in (argument, value)]
    if len(rows) < FEWEST_ROWS:
        raise FaultError(f"has {len(rows)} rows of numbers; a table needs {FEWEST_ROWS} at least", "file")
    if len(rows) > MOST_ROWS:
        raise FaultError(f"has {len(rows)} rows; {MOST_ROWS} are the most", "file")
    arguments, values = (tuple(_read_number(row, header, k, comma) for row in rows) for k in numbers)
    for row, (before, after) in zip(rows[1:], pairwise(arguments), strict=True):
        if not after > before:
            message = f"must be above {before:g}, the {argument[0]} in the row before"
            raise _fault_in(row, header, numbers[0], message)
    return TableColumns(arguments, values)


def _read_text(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            content = stream.read(MOST_TABLE_BYTES + 1)
    except (OSError, ValueError) as error:
        what = getattr(error, "strerror", None) or error
        raise FaultError(f"can't be read: {what}; it is looked for at {path}", "file") from None
    if len(content) > MOST_TABLE_BYTES:
        raise FaultError(f"is over {MOST_TABLE_BYTES // 1_000_000} MB; write the columns that are wanted", "file")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FaultError("isn't text in UTF-8; save it as CSV in UTF-8", "file") from None


def _split_rows(text: str, file: str) -> tuple[list[_Row], bool]:
    """Return the rows that hold anything, and whether a comma divides a number's decimals in this file."""
    lines = [(n, line) for n, line in enumerate(text.splitlines(), start=1) if line.strip() and line.lstrip()[0] != "#"]
    if not lines:
        raise FaultError("is empty", "file")
    divider = next((mark for mark in (";", "\t", ",") if mark in lines[0][1]), None)
    if divider is None:
        return [_Row(n, line.split()) for n, line in lines], False
    try:
        cells = [next(csv.reader([line], delimiter=divider, skipinitialspace=True)) for _, line in lines]
    except csv.Error as error:
        raise FaultError(f"isn't CSV: {error}", "file") from None
    rows = [_Row(n, [cell.strip() for cell in row]) for (n, _), row in zip(lines, cells, strict=True)]
    return rows, divider != ","


def _find_column(header: Sequence[str], key: str, column: str | int) -> int:
    """Return the place of a column, from 0."""
    if isinstance(column, int):
        if column > len(header):
            raise FaultError(f"is beyond the last column: the file has {len(header)}", key)
        return column - 1
    places = [k for k, name in enumerate(header) if name == column.strip()]
    if not places:
        raise UnknownNameError("column", column, header, "the columns of the first row", key)
    if len(places) > 1:
        numbers = ", ".join(str(k + 1) for k in places)
        raise FaultError(f"is the name of several columns; give a number: {numbers}", key)
    return places[0]


def _read_number(row: _Row, header: Sequence[str], column: int, comma: bool) -> float:
    text = row.cells[column] if column < len(row.cells) else ""
    if not _is_number(text, comma):
        raise _fault_in(row, header, column, f"{text[:40]!r} is no number" if text else "the cell is empty")
    return _parse(text, comma)


def _fault_in(row: _Row, header: Sequence[str], column: int, message: str) -> FaultError:
    return FaultError(f"row {row.line}, column {header[column]!r}: {message}", "file")


def _is_number(text: str, comma: bool) -> bool:
    try:
        return math.isfinite(_parse(text, comma))
    except ValueError:
        return False


def _parse(text: str, comma: bool) -> float:
    return float(text.replace(",", ".") if comma else text)
