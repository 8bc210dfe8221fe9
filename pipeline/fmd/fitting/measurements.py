"""Measured histories from a table, with the noise of each channel."""

import math
import re
from collections.abc import Mapping

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.core.limits.fitting import NOISE_ORDER, WHOLE_WINDOW
from fmd.core.units import unit_ratio
from fmd.fitting.measured_tables import MeasuredTable
from fmd.output.channels import ResultChannel, find_channels
from fmd.stages.pipeline import Pipeline

_COLUMN = re.compile(r"(.+?)\s*(?:\[(.*)\])?\s*")


@dataclass(frozen=True)
class MeasuredChannel:
    """Measured values of one result."""

    name: str  # the result
    unit: str  # its SI unit
    values: Array  # (n,): in that unit
    # (n,): standard deviation of the noise, in the same unit; that of each value where it is a share of these
    sigma: float | Array
    given: bool  # true if that is given, false if it is estimated from the values

    @property
    def noise(self) -> tuple[float, str]:
        """Standard deviation and its unit, or as a share of each value."""
        if isinstance(self.sigma, np.ndarray):
            return float((self.sigma / self.values).mean()), "of each value"
        return self.sigma, self.unit


@dataclass(frozen=True)
class Measurements:
    """Measured histories at common times."""

    times: Array  # (n_times,): from the start of the scene's motion, ascending [s]
    channels: tuple[MeasuredChannel, ...]  # one at least
    results: tuple[ResultChannel, ...]


def read_measurements(run: Pipeline, table: MeasuredTable, sigmas: Mapping[str, float]) -> Measurements:
    """Read measured histories from a table as `History` writes them: times in the first column, a result in each other.

    Columns' names have units, ``time [s]`` and e.g. ``forearm.wrist.position.y [mm]``; one without is in SI units. The
    standard deviation of the noise [SI] of a result that ``sigmas`` doesn't name is estimated from differences of its
    successive values, in which a smooth history cancels.

    Raises
    ------
    InputError
        A column is no result of the scene or in a wrong unit, or times lie outside the motion.
    """
    file, header, table_columns = table
    if len(header) < 2:
        raise InputError(file, "", None, "has one column; give times and, in each further column, a result")
    names, units = zip(*(name_and_unit(file, text) for text in header), strict=True)
    times = table_columns[0] * unit_factor(file, header[0], units[0] or "s", "s")
    end = run.scene.simulation.duration
    if times[0] < 0.0 or times[-1] > end * (1.0 + 1e-9):
        mend = f"times go from {times[0]:g} s to {times[-1]:g} s, the scene's motion from 0 s to {end:g} s"
        raise InputError(file, header[0], None, mend)
    channels, results = [], []
    for text, name, unit, column in zip(header[1:], names[1:], units[1:], table_columns[1:], strict=True):
        found = find_channels(run, name, file)
        if len(found) != 1 or found[0].name != name or not found[0].moves or found[0].largest is not None:
            raise InputError(file, text, None, "is no history of one number; those of a vector have .x, .y and .z")
        values = column * unit_factor(file, text, unit or found[0].unit, found[0].unit)
        sigma = sigmas.get(name) or estimate_noise(times, values)
        if not sigma > 0.0:
            mend = f"shows no noise and would have infinite weight; give it, e.g. --sigma {name}=1e-6, or leave it out"
            raise InputError(file, text, None, mend)
        channels.append(MeasuredChannel(name, found[0].unit, values, sigma, name in sigmas))
        results.append(found[0])
    return Measurements(times, tuple(channels), tuple(results))


def estimate_noise(times: Array, values: Array) -> float:
    """Estimate the standard deviation of white noise on a smooth history, (n,), by its divided differences of order 4.

    Those of a polynomial of third degree are 0, those of noise have the variance of the squares of their weights. Of
    differences over longer times than usual, as beside gaps, a history isn't smooth: they are left out.
    """
    if len(values) <= NOISE_ORDER:
        return 0.0
    t, y = (sliding_window_view(x, NOISE_ORDER + 1) for x in (times, values))
    spans = t[:, -1] - t[:, 0]
    usual = spans <= WHOLE_WINDOW * np.median(spans)
    t, y = (t - t[:, :1])[usual] / spans[usual, None], y[usual]
    others = [[j for j in range(NOISE_ORDER + 1) if j != k] for k in range(NOISE_ORDER + 1)]
    weights = np.array([1.0 / np.prod(t[:, [k]] - t[:, own], axis=1) for k, own in enumerate(others)]).T
    return float(np.sqrt(np.mean((weights * y).sum(axis=1) ** 2 / (weights**2).sum(axis=1))))


def noise_spread() -> float:
    """Return the variance of chi-squared by the noise of `estimate_noise`, over that by known noise.

    For many values: differences of order m of white noise have the squares of correlations that sum to
    ``C(4 m, 2 m) / C(2 m, m)²``, and the estimate varies with the residuals, which takes 1 off. By it 1.8 % of noises
    of 400 values have a probability below 1 %, and 3 % of 50 values.
    """
    m = NOISE_ORDER
    return math.comb(4 * m, 2 * m) / math.comb(2 * m, m) ** 2 - 1.0


def name_and_unit(file: str, text: str) -> tuple[str, str]:
    """Return the name of a column and its unit in brackets, empty if it has none."""
    match = _COLUMN.fullmatch(text)
    if match is None:
        raise InputError(file, "", text, "is no name of a column; the first row has names, e.g. 'time [s]'")
    return match[1], match[2] or ""


def unit_factor(file: str, column: str, unit: str, si: str) -> float:
    """Return the factor from a column's unit to its SI unit; raises ``InputError`` if there is none."""
    if unit == si:
        return 1.0
    try:
        return unit_ratio(unit, si)
    except ValueError:
        raise InputError(file, column, unit, f"is no unit of this result; {si} works") from None
