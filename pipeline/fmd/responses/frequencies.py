"""Frequencies at which a response is evaluated: evenly spaced, and closer about each resonance."""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.responses import LEAST_DAMPING, NEAREST_TO_POLE
from fmd.responses.state_space import StateSpace


def choose_frequencies(model: StateSpace, lowest: float, highest: float, points: int, ratio: float = 1.3) -> Array:
    """Return frequencies [Hz], ascending, with no resonance between two of them.

    Parameters
    ----------
    lowest, highest : float
        Range [Hz].
    points : int
        Number of evenly spaced frequencies.
    ratio : float
        Of the distances from a pole of two neighbours about it.
    """
    even = np.linspace(lowest, highest, points)
    spacing = (highest - lowest) / max(points - 1, 1)
    found: list[Array] = [even]
    for frequency, damping in zip(model.poles_hz, model.damping, strict=True):
        half = frequency * max(abs(damping), LEAST_DAMPING)
        count = int(
            np.ceil(np.log(max(spacing / (ratio - 1.0) / (NEAREST_TO_POLE * half), 20.0 * ratio)) / np.log(ratio))
        )
        away = NEAREST_TO_POLE * half * ratio ** np.arange(count)
        peak = frequency * np.sqrt(max(1.0 - 2.0 * damping**2, 0.0))
        found += [peak - away, peak + away, np.full(int(abs(damping) >= LEAST_DAMPING), peak)]
    every = np.unique(np.concatenate(found))
    return np.asarray(every[(every >= lowest) & (every <= highest)])
