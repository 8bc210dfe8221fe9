"""Campbell diagrams: frequencies, damping and whirl over the rate of rotation, and crossings with its multiples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from fmd.accuracy.response_errors import NO_ERRORS
from fmd.accuracy.rotor_errors import estimate_frequency_errors
from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.files import write_table
from fmd.core.limits import responses as limits
from fmd.core.limits.shown import DRAWN_MODES
from fmd.core.progress import Advance, Monitor, silent
from fmd.output.error_columns import NOT_STATED
from fmd.reduction.rotating import WhirlingModes
from fmd.stages.pipeline import Pipeline
from fmd.stages.rotor import Vibrations, coupled, find_vibrations, runs_in_bearings
from fmd.stages.whirl_tables import warn_of_last_rows

RPM = 2 * np.pi / 60
"""One revolution per minute [rad/s]."""


@dataclass(frozen=True)
class Crossing:
    """Rate at which a multiple of the rate meets a frequency."""

    order: float
    mode: int  # number of the mode from 1, by ascending frequency
    rate: float  # [rad/s]
    frequency_hz: float  # frequency of the vibration there [Hz], as in `WhirlingModes`
    damping: float  # its damping ratio, as there
    whirl: float  # its whirl, as there


@dataclass(frozen=True)
class UnstableRange:
    """Range of rates in which a small motion grows by itself."""

    start: float  # [rad/s]
    end: float  # [rad/s]
    growth: float  # largest rate of growth that was found in it [1/s]


@dataclass(frozen=True)
class CampbellDiagram:
    """Vibrations over the rate of rotation."""

    title: str
    rates: Array  # (n_rates,) [rad/s]
    frequencies_hz: Array  # (n_rates, n_modes): as in `WhirlingModes` [Hz]; not a number where a rate has fewer
    growth: Array  # (n_rates, n_modes): rates of growth, likewise [1/s]
    damping: Array  # (n_rates, n_modes): damping ratios, likewise
    whirl: Array  # (n_rates, n_modes): whirl, likewise
    orders: tuple[float, ...]  # multiples of the rate that were asked for
    crossings: tuple[Crossing, ...]
    unstable: tuple[UnstableRange, ...]  # where small motions grow, by ascending rate
    in_rpm: bool  # rates are written in revolutions per minute
    # Stated errors of the frequencies, shape (n_rates, n_modes), or why there are none.
    errors_hz: Array | str = NO_ERRORS
    of_tables: tuple[dict[str, str], ...] = ()  # warnings of bearings' tables that end below the highest rate

    def with_errors(self, run: Pipeline) -> CampbellDiagram:
        """Return the diagram with the errors of its frequencies, or why none are stated."""

        def estimate() -> Array | str:
            return estimate_frequency_errors(coupled(run), self.rates, self.frequencies_hz, run.store.advance)

        return replace(self, errors_hz=run.store.compute("errors of frequencies", estimate))

    @property
    def unit(self) -> str:
        """Unit in which rates are written."""
        return "rpm" if self.in_rpm else "rad/s"

    def in_unit(self, rate: float | Array) -> Any:
        """Return a rate [rad/s] in the unit in which rates are written."""
        return rate / RPM if self.in_rpm else rate

    def rows(self) -> list[dict[str, Any]]:
        """Return the vibrations at each rate as plain data."""
        found = []
        for k, rate in enumerate(self.rates.tolist()):
            there = np.isfinite(self.frequencies_hz[k])
            row: dict[str, Any] = {"rate_rad_s": rate, "speed_rpm": rate / RPM}
            row |= {"rate_rpm": rate / RPM} if self.in_rpm else {}
            for name, values in (
                ("frequency_hz", self.frequencies_hz),
                *([] if isinstance(self.errors_hz, str) else [("error_hz", self.errors_hz)]),
                ("growth_1_s", self.growth),
                ("damping", self.damping),
                ("whirl", self.whirl),
            ):
                row[name] = values[k][there].tolist()
            row |= {"error": NOT_STATED + self.errors_hz} if isinstance(self.errors_hz, str) else {}
            found.append(row)
        return found

    def crossing_rows(self) -> list[dict[str, Any]]:
        """Return the crossings as plain data."""
        return [
            {
                "order": at.order,
                "mode": at.mode,
                "rate_rad_s": at.rate,
                **({"rate_rpm": at.rate / RPM} if self.in_rpm else {}),
                "frequency_hz": at.frequency_hz,
                "error_hz": self._error_at(at),
                "damping": at.damping,
                "whirl": whirl_word(at.whirl),
            }
            for at in self.crossings
        ]

    def _error_at(self, at: Crossing) -> float | None:
        """Return the stated error of the frequency at a crossing [Hz], if one is stated."""
        if isinstance(self.errors_hz, str):
            return None
        errors = self.errors_hz[:, at.mode - 1]
        known = np.isfinite(errors)  # of none where more modes leave fewer vibrations below the others
        return float(np.interp(at.rate, self.rates[known], errors[known])) if known.any() else None

    def largest_error(self, n_modes: int) -> float | None:
        """Return the largest stated error of the first modes' frequencies over them; none unless each is stated."""
        if isinstance(self.errors_hz, str):
            return None
        rings = self.frequencies_hz[:, :n_modes] > 0.0
        shares = self.errors_hz[:, :n_modes][rings] / self.frequencies_hz[:, :n_modes][rings]
        return float(shares.max(initial=0.0)) if np.isfinite(shares).all() else None

    def unstable_rows(self) -> list[dict[str, float]]:
        """Return the ranges in which something grows as plain data."""
        return [
            {"from_rad_s": at.start, "to_rad_s": at.end, "from_rpm": at.start / RPM, "to_rpm": at.end / RPM}
            | {"growth_1_s": at.growth}
            for at in self.unstable
        ]

    def warnings(self) -> list[dict[str, str]]:
        """Return warnings, with code and text, of each range in which something grows and of tables that end."""
        found = [*self.of_tables]
        for at in self.unstable:
            start, end = (f"{self.in_unit(rate):.5g}" for rate in (at.start, at.end))
            ends = f"to {end}" if at.end < self.rates[-1] else f"up to the highest rate, {end}"
            text = f"from {start} {ends} {self.unit} a vibration grows by itself, by up to {at.growth:.3g} 1/s"
            found.append({"code": "unstable-rotation", "text": text})
        return found


def whirl_word(whirl: float) -> str:
    """Return ``forward``, ``backward`` or ``none`` for a circulation."""
    return "none" if abs(whirl) < limits.NO_WHIRL else "forward" if whirl > 0 else "backward"


def compute_campbell(
    run: Pipeline, rates: Array, orders: Sequence[float], in_rpm: bool = False, monitor: Monitor = silent
) -> CampbellDiagram:
    """Compute the vibrations of a scene's rotor at each rate [rad/s], and where multiples of the rate meet them.

    Raises
    ------
    InputError
        As `fmd.stages.rotor.find_vibrations`.
    """
    with threadpool_limits(1):  # of matrices so small that threads would wait for each other
        return _compute(coupled(run), rates, orders, in_rpm, monitor)


def find_critical_speeds(run: Pipeline, count: int) -> tuple[list[float], float]:
    """Find the lowest rates at which the rotation itself meets a frequency, and up to which it looked [rad/s].

    It looks up to twice as many frequencies at rest as are wanted, and further while there are fewer than ``count``.

    Raises
    ------
    InputError
        As `fmd.stages.rotor.find_vibrations`.
    """
    found: list[float] = []
    with threadpool_limits(1):
        at_rest = find_vibrations(coupled(run))(0.0).frequencies_hz
    lowest, highest = 0.0, 4.0 * np.pi * float(np.sort(at_rest[at_rest > 0.0])[:count].max(initial=0.0))
    for _ in range(limits.DOUBLED_RATES if highest else 0):
        rates = np.linspace(lowest, highest, limits.LOOKED_RATES)
        found += [at.rate for at in compute_campbell(run, rates, [1.0]).crossings]
        if len(found) >= count:
            break
        lowest, highest = highest, 2.0 * highest
    return found[:count], highest if len(found) >= count else lowest


def find_critical_speed_near(run: Pipeline, rate: float) -> float | None:
    """Find the rate nearest to another one [rad/s] at which the rotation itself meets a frequency, or none close by."""
    ends = rate * np.array([1.0 - limits.NEAR_CRITICAL, 1.0 + limits.NEAR_CRITICAL])
    with threadpool_limits(1):
        vibrations = cache(find_vibrations(coupled(run)))
        values = zip(*(vibrations(end).frequencies_hz for end in ends.tolist()), strict=False)
        found = [
            at for k, both in enumerate(values) for at in _meet(vibrations, ends, np.array(both), order=1.0, mode=k)
        ]
    return min(found, key=lambda at: abs(at - rate), default=None)


def _compute(run: Pipeline, rates: Array, orders: Sequence[float], in_rpm: bool, monitor: Monitor) -> CampbellDiagram:
    vibrations = cache(find_vibrations(run, float(rates[-1])))
    found = []
    with monitor(f"{len(rates)} rates") as advance:
        for k, rate in enumerate(rates.tolist(), start=1):
            found.append(vibrations(rate))
            advance(k / len(rates))
    shape = (len(rates), max(len(at.frequencies_hz) for at in found))
    frequencies, growth, damping, whirl = tables = np.full((4, *shape), np.nan)
    for k, at in enumerate(found):
        for table, values in zip(tables, (at.frequencies_hz, at.growth, at.damping, at.whirl), strict=True):
            table[k, : len(values)] = values
    damping[np.abs(damping) < limits.NO_DAMPING] = 0.0
    still = rates == 0.0
    whirl[still] = np.where(np.isfinite(frequencies[still]), 0.0, np.nan)  # pairs of equal frequency whirl at will
    with monitor("crossings") as advance:
        crossings = _find_crossings(vibrations, rates, frequencies, orders, advance)
    unstable = _find_unstable(vibrations, rates, frequencies)
    kind = "rotor in its bearings" if runs_in_bearings(run.scene) else "frequencies on a turning hub"
    title = f"{run.scene.title}: {kind}"
    ends = warn_of_last_rows(run.scene, float(rates[-1]))
    return CampbellDiagram(
        title, rates, frequencies, growth, damping, whirl, tuple(orders), crossings, unstable, in_rpm, of_tables=ends
    )


def _find_crossings(
    vibrations: Vibrations, rates: Array, frequencies_hz: Array, orders: Sequence[float], advance: Advance
) -> tuple[Crossing, ...]:
    """Find crossings between neighbouring rates, each to the last digits."""
    found = []
    for number, order in enumerate(orders, start=1):
        for mode, values in enumerate(frequencies_hz.T):
            for rate in _meet(vibrations, rates, values, order, mode):
                at = _vibration_at(vibrations, rate, order * rate / (2 * np.pi), mode)
                frequency, damping, whirl = (float(x[mode]) for x in (at.frequencies_hz, at.damping, at.whirl))
                damping = 0.0 if abs(damping) < limits.NO_DAMPING else damping
                found.append(Crossing(order, mode + 1, rate, frequency, damping, whirl))
        advance(number / len(orders))
    return tuple(sorted(found, key=lambda at: at.rate))


def _vibration_at(vibrations: Vibrations, rate: float, hertz: float, mode: int) -> WhirlingModes:
    """Return the vibrations at a rate where a mode has a frequency, or beside it if it stands still there."""
    beside = (vibrations(rate * share) for share in (1.0, 1.0 - limits.BESIDE_MEETING, 1.0 + limits.BESIDE_MEETING))
    there = [at for at in beside if len(at.frequencies_hz) > mode]
    return min(there, key=lambda at: abs(float(at.frequencies_hz[mode]) - hertz))


def _meet(vibrations: Vibrations, rates: Array, values: Array, order: float, mode: int) -> Iterator[float]:
    """Iterate over the rates at which a mode's frequencies [Hz] are a multiple of the rate."""
    from scipy.optimize import brentq

    def difference(rate: float) -> float:
        return float(vibrations(rate).frequencies_hz[mode] - order * rate / (2 * np.pi))

    def inside(rate: float) -> float:
        """Return 0 where a whirl stands still in the turning frame, and can't be told from a rigid motion."""
        return difference(rate) if len(vibrations(rate).frequencies_hz) >= fewest else 0.0

    apart = values - order * rates / (2 * np.pi)
    for k in np.flatnonzero((apart[:-1] > 0) & (apart[1:] <= 0) | (apart[:-1] < 0) & (apart[1:] >= 0)):
        ends = (float(rates[k]), float(rates[k + 1]))
        fewest = min(len(vibrations(rate).frequencies_hz) for rate in ends)
        found = float(brentq(inside, *ends, rtol=1e-10))
        if len(vibrations(found).frequencies_hz) < fewest:
            low, high = found * (1.0 - limits.BESIDE_MEETING), found * (1.0 + limits.BESIDE_MEETING)
            found = low + (high - low) * difference(low) / (difference(low) - difference(high))
        yield found


def _find_unstable(vibrations: Vibrations, rates: Array, frequencies_hz: Array) -> tuple[UnstableRange, ...]:
    """Find the ranges of rates in which a motion grows.

    A shaft that bends unlike in two directions grows where it meets the rate itself, in ranges that may be narrow:
    so the rates at which a vibration has the frequency of the rotation are looked at, too.
    """
    meetings = {
        rate for mode, values in enumerate(frequencies_hz.T) for rate in _meet(vibrations, rates, values, 1.0, mode)
    }
    looked = sorted({*rates.tolist(), *meetings})
    grown = [_growth(vibrations(rate)) for rate in looked]
    found = []
    k = 0
    while k < len(looked):
        last = k
        while last + 1 < len(looked) and grown[k] > 0.0 and grown[last + 1] > 0.0:
            last += 1
        if grown[k] > 0.0:
            nearness = limits.UNSTABLE_EDGE * looked[-1]
            start = looked[0] if k == 0 else _edge(vibrations, looked[k], looked[k - 1], nearness)
            end = looked[-1] if last + 1 == len(looked) else _edge(vibrations, looked[last], looked[last + 1], nearness)
            found.append(UnstableRange(start, end, max(grown[k : last + 1])))
        k = last + 1
    return tuple(found)


def _growth(at: WhirlingModes) -> float:
    """Return the largest rate at which a vibration grows [1/s]; 0 if none does."""
    size = np.hypot(at.growth, 2 * np.pi * at.frequencies_hz)
    return float(np.where(at.growth > limits.GROWS * size, at.growth, 0.0).max(initial=0.0))


def _edge(vibrations: Vibrations, inside: float, outside: float, nearness: float) -> float:
    """Return the rate between two at which a vibration begins to grow, by halves."""
    while abs(outside - inside) > nearness:
        middle = 0.5 * (inside + outside)
        if _growth(vibrations(middle)):
            inside = middle
        else:
            outside = middle
    return 0.5 * (inside + outside)


def write_campbell(diagram: CampbellDiagram, folder: Path) -> list[str]:
    """Write a diagram as a chart and as tables of its modes and of its crossings; return the files' names."""
    from fmd.render.campbell_chart import draw_campbell

    n_modes = diagram.frequencies_hz.shape[1]
    header = [f"rate_{'rpm' if diagram.in_rpm else 'rad_s'}"]
    tables = {"hz": diagram.frequencies_hz, "growth_1_s": diagram.growth}
    tables |= {"damping": diagram.damping, "whirl": diagram.whirl}
    unstated = [NOT_STATED + diagram.errors_hz] if isinstance(diagram.errors_hz, str) else []
    tables |= {} if isinstance(diagram.errors_hz, str) else {"error_hz": diagram.errors_hz}
    header += [f"mode_{k + 1}_{what}" for what in tables for k in range(n_modes)] + ["error"] * len(unstated)
    columns = (diagram.in_unit(diagram.rates)[:, None], *tables.values())
    rows = []
    for row in np.concatenate(columns, axis=1):
        frequencies, others = np.split(row[1:], [n_modes])
        cells = (f"{row[0]:.6g}", *(f"{x:.8g}" for x in frequencies), *(f"{x:.5g}" for x in others))
        rows.append([*cells, *unstated])
    write_table(folder / "campbell.csv", header, rows)
    files = ["campbell.csv", "campbell.png"]
    draw_campbell(
        diagram.in_unit(diagram.rates),
        diagram.frequencies_hz[:, :DRAWN_MODES],
        folder / "campbell.png",
        title=diagram.title,
        unit=diagram.unit,
        orders=diagram.orders or None,
        crossings=[(diagram.in_unit(at.rate), at.frequency_hz) for at in diagram.crossings if at.mode <= DRAWN_MODES],
        unstable=[(diagram.in_unit(at.start), diagram.in_unit(at.end)) for at in diagram.unstable],
    )
    if diagram.crossings:
        crossings = diagram.crossing_rows()
        write_table(folder / "crossings.csv", [*crossings[0]], (row.values() for row in crossings))
        files.append("crossings.csv")
    return files
