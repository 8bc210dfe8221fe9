"""Tables for the terminal that more than one command prints."""

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from fmd.core.limits.shown import MOST_WARNINGS, UNCUT
from fmd.scene.magnitudes import UNUSUAL


def new_table(title: str, *columns: str, wide: int = 0) -> Table:
    """Make an empty table: figures to the right, the first column and the column ``wide`` to the left."""
    table = Table(title=title, title_justify="left")
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k in (0, wide) else "right", no_wrap=k == 0, overflow="fold")
    return table


def print_table(title: str, columns: Mapping[str, str], rows: Iterable[Sequence[Any]], wide: int = 0) -> None:
    """Print a table whose columns are those of `new_table`.

    Parameters
    ----------
    columns : mapping of str to str
        Format of the values of each column, e.g. ``"{:.3g} s"``, by the column's heading.
    rows : iterable of sequence
        Values, ``None`` for an empty cell.
    wide : int
        Number of a column that stands to the left.
    """
    table = new_table(title, *columns, wide=wide)
    for row in rows:
        table.add_row(*("" if x is None else form.format(x) for x, form in zip(row, columns.values(), strict=True)))
    open_console().print(table)


def print_records(title: str, columns: Mapping[str, str], records: Iterable[Mapping[str, Any]]) -> None:
    """Print a table of records, whose columns are named by ``"key"`` or ``"key:format"`` of their values."""
    keys = [form.partition(":")[0] for form in columns.values()]
    forms = {name: f"{{{form[len(key) :]}}}" for (name, form), key in zip(columns.items(), keys, strict=True)}
    print_table(title, forms, ([record[key] for key in keys] for record in records))


def print_frequencies(summary: dict[str, Any]) -> None:
    """Print a table of each flexible body's frequencies; those of the first stand beside the scene's reference."""
    beside = [
        (f"{hertz:.1f}", f"{100 * error:+.2f} %")
        for hertz, error in zip(summary["reference_hz"], summary["relative_error"], strict=True)
    ]
    for name, body in summary["bodies"].items():
        more = {"reference Hz": "{}", "difference": "{}"} if beside else {}
        rows = [
            (k, hertz, *(beside[k - 1] if k <= len(beside) else (None,) * len(more)))
            for k, hertz in enumerate(body["frequencies_hz"], start=1)
        ]
        print_table(f"Frequencies of {name}, {body['boundary']}", {"mode": "{}", "Hz": "{:.2f}", **more}, rows)
        beside = []


def print_warnings(warnings: Sequence[Mapping[str, Any]], where: str = "--json") -> None:
    """Print the first few warnings, and where the others are; unusual values were told as the scene was opened."""
    console = open_console()
    warnings = [warning for warning in warnings if warning["code"] != UNUSUAL]
    for warning in warnings[:MOST_WARNINGS]:
        console.print(f"warning: {warning['text']}")
    if (more := len(warnings) - MOST_WARNINGS) > 0:
        console.print(f"and {more} more {'warning' if more == 1 else 'warnings'}: {where}")


def tell_apart(*values: float) -> list[str]:
    """Write numbers with as many digits as tell them apart, two of what they differ by and six at least."""
    span, size = max(values) - min(values), max(map(abs, values))
    digits = 6 if span <= 0.0 else max(6, math.ceil(math.log10(size / span)) + 2)
    return [f"{value:.{min(digits, 15)}g}" for value in values]


def open_console() -> Console:
    """Open standard output for text and tables; a file or a pipe gets lines as long as they are, none cut."""
    console = Console(markup=False, emoji=False)  # [body.arm] is a name
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = UNCUT
    return console


def print_files(folder: Path, files: Sequence[str]) -> None:
    """Print which files a command has written."""
    open_console().print(f"in {folder}/: {', '.join(files)}")
