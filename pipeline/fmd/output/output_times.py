"""Warnings about output times that are too far apart for the largest stress."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.limits.recovery import MISSED_STRESS, UNRESOLVED_STRESS
from fmd.recovery.envelope import estimate_missed_peak, estimate_missed_vibration

if TYPE_CHECKING:
    from fmd.stages.pipeline import Pipeline


def output_time_warnings(run: Pipeline, worst: Mapping[str, int]) -> list[dict[str, str]]:
    """Return warnings about output times that are too far apart for a body's largest stress.

    Parameters
    ----------
    worst : mapping of str to int
        For each body with stress the place among its surface's nodes where stress is largest.
    """
    found = []
    for body, node in worst.items():
        missed = _missed(run, body, node)
        if missed > MISSED_STRESS:
            step = _one_digit_below(1e3 * run.scene.simulation.output_step * math.sqrt(MISSED_STRESS / missed))
            beyond = f"{100 * missed:.2g} %{' or more' if missed > UNRESOLVED_STRESS else ''}"
            tells = "tells more" if missed > UNRESOLVED_STRESS else f"resolves it to {100 * MISSED_STRESS:g} %"
            text = (
                f"{body}: its largest stress may be {beyond} larger between output times; "
                f"simulation.output_step = '{step} ms' {tells}"
            )
            found.append({"code": "coarse-output-times", "body": body, "text": text})
    return found


def _missed(run: Pipeline, body: str, node: int) -> float:
    """Return the part of a body's largest stress that may lie between output times."""
    stress, motion = run.stress_of(body), run.motion
    pieces = [part.name for part in run.pieces_of(body)]
    rates = [motion.kinematics.modal_rates(motion.mechanism.number_of(piece)) for piece in pieces]
    omega = np.concatenate([run.bodies[piece].omega for piece in pieces])
    vibrating = replace(stress, modal=stress.modal[..., : len(omega)], q=stress.q[:, : len(omega)])
    hidden = estimate_missed_vibration(vibrating, node, np.concatenate(rates, axis=1), omega)
    return max(hidden, estimate_missed_peak(stress, node))


def _one_digit_below(value: float) -> str:
    """Write the largest number of one digit that isn't above a value."""
    unit = 10.0 ** math.floor(math.log10(value))
    return f"{math.floor(value / unit) * unit:.1g}"
