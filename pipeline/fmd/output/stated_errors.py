"""A summary's most wanted figures and the errors of its budget as texts: shares in percent, intervals in units."""

from collections.abc import Mapping
from typing import Any

from fmd.accuracy.error_estimates import NO_PART, SOURCES, percent
from fmd.core.html import prefix_for, scaled
from fmd.core.limits.shown import NAMED_RESULTS, SEEN_BETTER
from fmd.core.limits.stepping import SHOWN_SPREAD


def key_figures(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """List a summary's most wanted figures with their names and units: results, and how long was simulated how."""
    if "integrations" not in summary:
        return key_results(summary)
    simulated = ("simulated", scaled(summary["final"]["time_s"], "s"))
    return [
        *key_results(summary),
        simulated,
        ("largest stable step", scaled(summary["largest_stable_step_s"], "s", 3)),
    ]


def key_results(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """List a summary's most wanted results with their names and units."""
    figures: list[tuple[str, str]] = []
    if "frequencies_hz" in summary:
        figures.append(("first frequency", f"{summary['frequencies_hz'][0]:.2f} Hz"))
    for name, body in summary.get("bodies", {}).items():
        figures.append((f"mass of {name}", scaled(body["mass_kg"], "kg")))
    if "worst_stress" in summary:
        figures.append(("largest von Mises stress", largest_stress(summary)))
    if "peak_tip_deflection_m" in summary:
        figures.append(("largest tip deflection", largest_deflection(summary)))
    return figures


def largest_stress(summary: Mapping[str, Any]) -> str:
    """Write a summary's largest von Mises stress with what the error budget states of it."""
    stress = summary["worst_stress"]
    quantity = f"{stress['body']}, largest von Mises stress"
    return with_error(stress["von_mises_pa"], "Pa", summary, quantity)


def largest_deflection(summary: Mapping[str, Any]) -> str:
    """Write a summary's largest deflection of the tip with what the error budget states of it."""
    return with_error(summary["peak_tip_deflection_m"], "m", summary, "tip, largest deflection")


def run_time(row: Mapping[str, Any], first: Mapping[str, Any]) -> tuple[str, str]:
    """Write a run's time, with its spread where that matters, and its ratio to the first run's unless it is within.

    It is within the larger spread of the two.
    """
    spread, ratio = row.get("spread", 0.0), row["ratio_to_plain"]
    time = scaled(row["seconds"], "s", 3) + (f" (median +{100 * spread:.0f} %)" if spread > SHOWN_SPREAD else "")
    shown = ratio is not None and (ratio == 1.0 or abs(ratio - 1.0) > max(spread, first.get("spread", 0.0)))
    return time, f"{ratio:.2f}" if shown else "–"


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
