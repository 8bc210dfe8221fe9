"""Errors of a summary's error budget as texts: shares in percent, intervals in a result's own unit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fmd.accuracy.error_estimates import NO_PART, SOURCES, percent
from fmd.core.html import prefix_for
from fmd.core.limits.shown import NAMED_RESULTS, SEEN_BETTER

ERROR_COLUMNS = ("mesh", "modes", "time", "stress", "model", "stated", "better", "from", "to")
"""Headings of `error_cells`."""


def worst_details(budget: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the few rows of single joints and markers with the largest stated errors."""
    stated = [row for row in budget["details"] if row["total"] is not None]
    return sorted(stated, key=lambda row: -float(row["total"]))[:NAMED_RESULTS]


def error_cells(row: Mapping[str, Any]) -> list[str]:
    """Return a row's errors by source, what is stated, the better value and its interval; ``?`` is missing."""
    parts = [
        percent(part) if isinstance(part := row[source], float) else "–" if part == NO_PART else "?"
        for source in SOURCES
    ]
    if row["interval"] is None:
        return [*parts, "?", "", "", ""]
    return [*parts, percent(row["total"]), *_in_unit((row["better"], *row["interval"]), row["unit"])]


def with_error(value: float, unit: str, summary: Mapping[str, Any], quantity: str) -> str:
    """Write a value with the interval that the budget states of it, and the better value where it is another one.

    Without a budget it is the value alone; where no interval is stated, the text says why.
    """
    (alone,) = _in_unit((value,), unit)
    for row in summary.get("error_budget", {}).get("rows", ()):
        if row["quantity"] != quantity:
            continue
        if row["interval"] is None:
            return f"{alone} (error not stated: {row['why'].removeprefix('not estimated: ')})"
        low, high = _in_unit(row["interval"], unit)
        if abs(row["better"] - row["value"]) > SEEN_BETTER * row["value"]:
            (better,) = _in_unit((row["better"],), unit)
            return f"{better} (from {low} to {high}; the run itself has {alone})"
        return f"{alone} (from {low} to {high})"
    return alone


def with_plain_error(value: float, error: float | None, unit: str) -> str:
    """Write a value and its stated error, if there is one, in its own unit."""
    return f"{value:.4g} {unit}" if error is None else f"{value:.4g} ± {error:.2g} {unit}"


def _in_unit(values: tuple[float, ...], unit: str) -> list[str]:
    """Write values with one prefix, that of the last one, which is the largest."""
    factor, prefix = prefix_for(values[-1], unit)
    return [f"{value / factor:.4g} {prefix}{unit}".rstrip() for value in values]
