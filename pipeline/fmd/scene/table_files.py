"""Tables in text files: columns of numbers from CSV, for quantities that change with time or with an elongation."""

import csv
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import BeforeValidator

from fmd.core.files import unreadable
from fmd.core.limits.scene import FEWEST_ROWS, MOST_ROWS, MOST_TABLE_BYTES
from fmd.scene.reading import FaultError, UnknownNameError
from fmd.scene.values import Words


def _check_column(column: object) -> object:
    if isinstance(column, bool) or not (
        (isinstance(column, str) and column.strip()) or (isinstance(column, int) and column >= 1)
    ):
        raise ValueError("must be the column's name in the file's first row, or its number from 1")
    return column


Column = Annotated[str | int, BeforeValidator(_check_column), Words("name of a column, or its number from 1")]


class TableColumns(NamedTuple):
    """Two columns of a file, row by row, in the file's units."""

    arguments: tuple[float, ...]  # column of times or elongations, ascending
    values: tuple[float, ...]  # column of values


class _Row(NamedTuple):
    """Cells of a line of the file, with the line's number from 1."""

    line: int
    cells: list[str]


def read_columns(
    folder: Path, file: str, argument: tuple[str, str | int], value: tuple[str, str | int], *, fewest: int = FEWEST_ROWS
) -> TableColumns:
    """Read two columns of a CSV file; cells are divided by commas, semicolons, tabs or spaces.

    The file is relative to the scene's folder. A column has the scene's key, ``"time"``, and its name in the first row,
    or its number; ``fewest`` rows are needed.

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
    arguments, values = _read_rows(rows, header, numbers, comma, argument[0], fewest)
    return TableColumns(arguments, values)


def read_all_columns(path: Path, *, fewest: int = FEWEST_ROWS) -> tuple[list[str], list[tuple[float, ...]]]:
    """Read the first row of a CSV file and all columns under it, of which the first ascends.

    Raises
    ------
    FaultError
        The file can't be read, a cell holds no number, or the first column doesn't ascend.
    """
    (first, *rows), comma = _split_rows(_read_text(path), str(path))
    return first.cells, _read_rows(rows, first.cells, range(len(first.cells)), comma, first.cells[0], fewest)


def _read_rows(
    rows: Sequence[_Row], header: Sequence[str], numbers: Sequence[int], comma: bool, argument: str, fewest: int
) -> list[tuple[float, ...]]:
    """Return columns by their numbers, of which the first holds arguments and ascends."""
    if len(rows) < fewest:
        raise FaultError(f"has {len(rows)} rows of numbers; a table needs {fewest} at least", "file")
    if len(rows) > MOST_ROWS:
        raise FaultError(f"has {len(rows)} rows; {MOST_ROWS} are the most", "file")
    columns = [tuple(_read_number(row, header, k, comma) for row in rows) for k in numbers]
    for row, (before, after) in zip(rows[1:], pairwise(columns[0]), strict=True):
        if not after > before:
            message = f"must be above {before:g}, the {argument} in the row before"
            raise _fault_in(row, header, numbers[0], message)
    return columns


def _read_text(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            content = stream.read(MOST_TABLE_BYTES + 1)
    except (OSError, ValueError) as error:
        raise FaultError(unreadable(error, path), "file") from None
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
