"""Rows of the CSV files of this folder, and how tables show them."""

import csv
import platform
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
SAME_DERIVATIVE = 1e-8  # of the largest: what tangents are to be of extrapolated differences


class Cell(str):
    """An entry of a CSV file, formatted as a number: ``:t`` is a time [s], ``:r`` a ratio, ``:d`` a count."""

    __slots__ = ()

    def __format__(self, spec: str) -> str:
        """Return the text; with a format, that of the number."""
        if spec == "d":
            return f"{int(self):,}"
        special = {"t": format_seconds, "r": format_ratio}.get(spec)
        return special(float(self)) if special else format(float(self), spec) if spec else str(self)


Row = dict[str, Cell]


def read_rows(name: str) -> list[Row]:
    """Read a CSV file of this folder; lines that start with # are comments."""
    with (HERE / f"{name}.csv").open(newline="") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return [{key: Cell(value) for key, value in row.items()} for row in rows]


def group_rows(rows: Iterable[Row], *keys: str) -> dict[Any, list[Row]]:
    """Collect the rows that have the same entries, in the order of their first ones, by these or by the only one."""
    groups: dict[Any, list[Row]] = {}
    for row in rows:
        entries = tuple(str(row[key]) for key in keys)
        groups.setdefault(entries if len(keys) > 1 else entries[0], []).append(row)
    return groups


def markdown(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Format a Markdown table."""
    head = list(header)
    lines = [head, ["---"] * len(head), *(list(row) for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def listed(name: str, columns: Mapping[str, str], rows: Iterable[Row] | None = None) -> str:
    """Tabulate a CSV file, or some of its rows: heading and format of each column, ``"{seconds:t} in all"``."""
    chosen = read_rows(name) if rows is None else rows
    return markdown(columns, ([form.format_map(row) for form in columns.values()] for row in chosen))


def format_seconds(seconds: float) -> str:
    """Format a duration with two figures and its unit, a dash for none."""
    if not isfinite(seconds):
        return "–"
    units = ((1, "s"), (1e3, "ms"), (1e6, "µs"), (1e9, "ns"))
    factor, unit = next(((f, u) for f, u in units if seconds * f >= 1), units[-1])
    return f"{seconds * factor:.2g} {unit}" if seconds * factor < 100 else f"{seconds * factor:.0f} {unit}"


def format_ratio(ratio: float) -> str:
    """Format a ratio with two figures, or three from 100 on."""
    return f"{ratio:.0f}" if ratio >= 100 else f"{ratio:.2g}"


def write_rows(path: Path, rows: Iterable[Any], *remarks: str, digits: int = 3) -> None:
    """Write dataclasses or dictionaries with the same keys as a CSV file after remarks; real numbers to some digits."""
    tables = [row if isinstance(row, dict) else asdict(row) for row in rows]
    with path.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {remark}\n" for remark in remarks)
        table = csv.DictWriter(file, list(tables[0]), lineterminator="\n")
        table.writeheader()
        for row in tables:
            table.writerow({name: f"{x:.{digits}g}" if isinstance(x, float) else x for name, x in row.items()})


def renew_rows(path: Path, rows: Iterable[Any], keys: tuple[str, ...], order: Any, *remarks: str) -> None:
    """Write rows as `write_rows` does, those that a file has for other values of the keys with them, in an order."""
    anew = [row if isinstance(row, dict) else asdict(row) for row in rows]
    made = {tuple(str(row[key]) for key in keys) for row in anew}
    kept = [row for row in read_rows(path.stem) if tuple(row[key] for key in keys) not in made] if path.exists() else []
    write_rows(path, sorted([*anew, *kept], key=order), *remarks)


def machine() -> str:
    """Name the machine and the version of Python, as remark of a table of times."""
    return f"{platform.machine()}, {platform.system()}, Python {platform.python_version()}"
