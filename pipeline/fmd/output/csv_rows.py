"""Tables written as CSV."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path


def write_rows(path: Path, header: list[str], rows: Iterable[list[str]]) -> None:
    """Write a header and rows of text."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(header)
        table.writerows(rows)
