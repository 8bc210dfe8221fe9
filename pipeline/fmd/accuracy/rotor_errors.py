"""Errors of a rotor's frequencies and orbits over its speed, by more modes and by what meshes do to frequencies.

They come from the variants by which frequency responses have theirs.
"""

from collections.abc import Callable

import numpy as np

from fmd.accuracy.response_errors import SHIFTS, shift_frequencies, total_error
from fmd.accuracy.time_limit import FAULTS
from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.patience import OF_TWO_MESHES, WITH_RATES
from fmd.core.progress import Advance
from fmd.stages.pipeline import Pipeline
from fmd.stages.rotor import find_vibrations
from fmd.stages.whirl_tables import without_whirl_tables


def estimate_frequency_errors(
    run: Pipeline, rates: Array, frequencies_hz: Array, advance: Advance = lambda done: None
) -> Array | str:
    """Estimate the errors of a rotor's frequencies (n_rates, n_modes) [Hz] at some rates, or say why there is none.

    Rates (n_rates,) [rad/s] ascend, and frequencies at each of them; they aren't numbers where a rate has fewer.
    ``advance`` takes the part that is done.
    """
    if not run.parts:
        return np.zeros_like(frequencies_hz)
    try:
        shift = shift_frequencies(without_whirl_tables(run), lambda done: advance(OF_TWO_MESHES * done))
        if isinstance(shift, str):
            return shift
        richer = shift.richer.variant(shift.richer.scene.model_copy(update={"bearing": run.scene.bearing}))
        vibrations, more = find_vibrations(richer, float(rates[-1])), np.full_like(frequencies_hz, np.nan)
        for k, rate in enumerate(rates.tolist()):
            advance(WITH_RATES + (1.0 - WITH_RATES) * k / len(rates))
            there = vibrations(rate).frequencies_hz[: frequencies_hz.shape[1]]
            more[k, : len(there)] = there
    except FAULTS as fault:  # of a variant: the frequencies themselves are there
        return f"{fault}"
    return total_error(more - frequencies_hz, shift.share(frequencies_hz) * frequencies_hz)


@dataclass(frozen=True)
class RicherOrbits:
    """Radii of a rotor's orbits with more modes, and what the mesh does to its frequencies."""

    radii: Callable[[float], Array]  # returns the radii at a rate [rad/s], (n_markers,) [m]
    share: Callable[[Array], Array]  # share by which the mesh raises frequencies, at a rate of rotation [rad/s]
    highest: float  # rate up to which the radii are known [rad/s]

    def errors(self, rates: Array, amplitude: Array) -> Array:
        """Return the stated errors of radii (n_rates, n_markers) [m] at rates (n_rates,) [rad/s]."""
        share, more = self.share(rates), self._at(rates)
        moved = np.max([np.abs(self._at(rates * (1.0 + times * share)) - more) for times in SHIFTS], axis=0)
        return total_error(more - amplitude, moved, 2.0 * share[:1] * more)

    def _at(self, rates: Array) -> Array:
        # Beyond the highest rate as far below it: a flank is about as steep on both sides.
        inside = np.where(rates > self.highest, 2.0 * self.highest - rates, rates)
        return np.array([self.radii(rate) for rate in inside.tolist()])


def find_richer_orbits(
    run: Pipeline,
    respond: Callable[[Pipeline], Callable[[float], Array]],
    highest: float,
    order: float,
    advance: Advance = lambda done: None,
) -> RicherOrbits | str:
    """Find by which variants a run's orbits have errors up to a rate [rad/s], or why there are none.

    ``respond`` returns of a run a function from a rate [rad/s] to the radii there [m], (n_markers,); ``order`` is how
    often the force goes round in a turn, and ``advance`` takes the part that is done.
    """
    try:
        shift = shift_frequencies(run, lambda done: advance(OF_TWO_MESHES * done)) if run.parts else None
        if isinstance(shift, str):
            return shift
        if shift is None:  # all is rigid
            return RicherOrbits(respond(run), np.zeros_like, highest)
        share = shift.share
        return RicherOrbits(respond(shift.richer), lambda rates: share(abs(order) * rates / (2 * np.pi)), highest)
    except FAULTS as fault:
        return f"{fault}"
