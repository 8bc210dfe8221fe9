"""The most wanted figures of a run's summary, as texts for pages and notebooks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fmd.core.html import scaled
from fmd.core.limits.stepping import SHOWN_SPREAD
from fmd.output.stated_errors import with_error


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


def run_time(row: Mapping[str, Any]) -> tuple[str, str]:
    """Write a run's time, with its spread where that matters, and its ratio to the first run's unless it is within."""
    spread, ratio = row.get("spread", 0.0), row["ratio_to_plain"]
    time = scaled(row["seconds"], "s", 3) + (f" (median +{100 * spread:.0f} %)" if spread > SHOWN_SPREAD else "")
    return time, f"{ratio:.2f}" if ratio == 1.0 or abs(ratio - 1.0) > spread else "–"
