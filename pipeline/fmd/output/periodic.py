"""Figures and warnings about a motion that starts on one that repeats: its gap and its Floquet multipliers."""

from __future__ import annotations

from typing import Any

import numpy as np

from fmd.core.limits.periodic import GROWS, SHOWN_MULTIPLIERS
from fmd.stages.pipeline import Pipeline


def periodic_figures(run: Pipeline) -> dict[str, Any]:
    """Return period, gap, multipliers and work of a scene's periodic start."""
    if not run.scene.repeats:
        return {}
    motion = run.periodic
    return {
        "periodic": {
            "period_s": motion.period,
            "gap": motion.gap,
            "multipliers": [{"modulus": float(abs(mu)), "angle_rad": float(np.angle(mu))} for mu in motion.multipliers],
            "marched_periods": motion.marches,
            "marched_for_multipliers": motion.disturbed_marches,
        }
    }


def periodic_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warn of a periodic motion from which small disturbances grow: nothing settles at it by itself."""
    if not run.scene.repeats:
        return []
    largest = float(np.abs(run.periodic.multipliers).max(initial=0.0))
    if largest <= 1.0 + GROWS:
        return []
    text = (
        f"the periodic motion is unstable: a small disturbance grows {largest:.4g}-fold in each period, so no motion "
        "settles at it; runs leave it sooner or later"
    )
    return [{"code": "periodic-unstable", "text": text}]


def describe_periodic(figures: dict[str, Any]) -> str:
    """Write what a run tells of its periodic start."""
    moduli = [row["modulus"] for row in figures["multipliers"]]
    shown = ", ".join(f"{modulus:.4g}" for modulus in moduli[:SHOWN_MULTIPLIERS])
    more = " …" if len(moduli) > SHOWN_MULTIPLIERS else ""
    text = (
        f"repeats after {figures['period_s']:.6g} s within {figures['gap']:.1g}; Floquet multipliers of moduli "
        f"{shown or 'none'}{more}"
    )
    if moduli and 0.0 < moduli[0] < 1.0 - GROWS:
        periods = np.log(1000.0) / -np.log(moduli[0])
        text += f": a march from elsewhere settles to a thousandth in {max(periods, 1.0):.3g} periods"
    return text
