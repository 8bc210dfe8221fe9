"""Errors of a summary's error budget as texts, in percent."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fmd.accuracy.error_estimates import MORE_OF_MESH, MORE_OF_MODEL, NO_PART, SOURCES, percent

ERROR_COLUMNS = ("mesh", "modes", "time", "stress", "model", "stated")
"""Headings of `error_cells`."""


def error_cells(row: Mapping[str, Any]) -> list[str]:
    """Return a row's errors by source, and what is stated; ``?`` is a missing estimate, and ``>`` a lower bound."""
    parts = [
        percent(part) if isinstance(part := row[source], float) else "–" if part == NO_PART else "?"
        for source in SOURCES
    ]
    return [*parts, f"> {percent(row['total'])}" if _is_lower_bound(row) else percent(row["total"])]


def error_beside(summary: Mapping[str, Any], quantity: str) -> str:
    """Return what is stated of a quantity, to be written behind its value; nothing without a budget."""
    for row in summary.get("error_budget", {}).get("rows", ()):
        if row["quantity"] == quantity:
            return f" (± {percent(row['total'])} %{' or more' * _is_lower_bound(row)})"
    return ""


def _is_lower_bound(row: Mapping[str, Any]) -> bool:
    missing = (part for source in SOURCES if isinstance(part := row[source], str) and part != NO_PART)
    return MORE_OF_MODEL in row or MORE_OF_MESH in row or any(missing)
