"""Tables for the terminal that more than one command prints."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from fmd.core.limits.shown import UNCUT


def new_table(title: str, *columns: str, wide: int = 0) -> Table:
    """Make an empty table: figures to the right, the first column and the column ``wide`` to the left."""
    table = Table(title=title, title_justify="left")
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k in (0, wide) else "right", no_wrap=k == 0, overflow="fold")
    return table


def frequency_tables(summary: dict[str, Any]) -> list[Table]:
    """Make a table of each flexible body's frequencies; those of the first stand beside the scene's reference."""
    beside = [
        (f"{hertz:.1f}", f"{100 * error:+.2f} %")
        for hertz, error in zip(summary["reference_hz"], summary["relative_error"], strict=True)
    ]
    tables = []
    for name, body in summary["bodies"].items():
        table = new_table(f"Frequencies of {name}", "mode", "Hz", *(("reference Hz", "difference") if beside else ()))
        for k, frequency in enumerate(body["frequencies_hz"]):
            table.add_row(str(k + 1), f"{frequency:.2f}", *(beside[k] if k < len(beside) else ()))
        tables.append(table)
        beside = []
    return tables


def open_console() -> Console:
    """Open standard output for text and tables; a file or a pipe gets lines as long as they are, none cut."""
    console = Console(markup=False, emoji=False)  # [body.arm] is a name
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = UNCUT
    return console


def print_files(folder: Path, files: Sequence[str]) -> None:
    """Print which files a command has written."""
    open_console().print(f"in {folder}/: {', '.join(files)}")
