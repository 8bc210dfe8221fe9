"""The most wanted figures of a run's summary, as texts for pages and notebooks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.core.html import scaled


def key_figures(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """List a summary's most wanted figures with their names and units."""
    figures: list[tuple[str, str]] = []
    if "frequencies_hz" in summary:
        figures.append(("first frequency", f"{summary['frequencies_hz'][0]:.2f} Hz"))
    for name, body in summary.get("bodies", {}).items():
        figures.append((f"mass of {name}", scaled(body["mass_kg"], "kg")))
    if "worst_stress" in summary:
        figures.append(("largest von Mises stress", scaled(summary["worst_stress"]["von_mises_pa"], "Pa")))
    if "peak_tip_deflection_m" in summary:
        figures.append(("largest tip deflection", scaled(summary["peak_tip_deflection_m"], "m")))
    if "integrations" in summary:
        figures.append(("simulated", scaled(summary["final"]["time_s"], "s")))
        figures.append(("largest stable step", scaled(summary["largest_stable_step_s"], "s", 3)))
    return figures
