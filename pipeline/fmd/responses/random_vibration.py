"""Random vibration: root mean squares of outputs by the spectral density of one input."""

from collections.abc import Callable

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass


@dataclass(frozen=True)
class RandomResponse:
    """Answer to a stationary random input."""

    frequencies_hz: Array  # (n_frequencies,) [Hz]
    density: Array  # (n_frequencies, n_outputs): one-sided power spectral density of the outputs [unit²/Hz]
    rms: Array  # (n_outputs,): root of the integral of the density over the frequencies [unit]

    @property
    def rates_hz(self) -> Array:
        """Mean number of upward crossings of zero in a second (Rice 1945) [Hz], shape (n_outputs,)."""
        square = self.frequencies_hz[:, None] ** 2 * self.density
        moments = np.trapezoid(square, self.frequencies_hz, axis=0)
        return np.asarray(np.sqrt(np.divide(moments, self.rms**2, out=np.zeros_like(moments), where=self.rms > 0)))


def random_response(frequencies_hz: Array, response: Array, input_density: Callable[[Array], Array]) -> RandomResponse:
    """Return the densities ``|H|² S`` of outputs by one input, and their root mean squares.

    Frequencies [Hz] ascend, closer about the resonances; the response (n_frequencies, n_outputs) is complex, and the
    input's one-sided power spectral density a function of frequencies [unit²/Hz] (Newland, An Introduction to Random
    Vibrations, Spectral and Wavelet Analysis, 3rd ed., 1993, chapter 7).
    """
    density = np.abs(response) ** 2 * input_density(frequencies_hz)[:, None]
    return RandomResponse(frequencies_hz, density, np.sqrt(np.trapezoid(density, frequencies_hz, axis=0)))
