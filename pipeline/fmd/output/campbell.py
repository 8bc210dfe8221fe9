"""Campbell diagrams: frequencies, damping and whirl over the rate of rotation, and crossings with its multiples."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.files import whole_file
from fmd.core.limits.rotors import NO_DAMPING, NO_WHIRL
from fmd.core.limits.shown import DRAWN_MODES
from fmd.responses.whirl import WhirlingModes
from fmd.stages.pipeline import Pipeline
from fmd.stages.rotor import Vibrations, find_vibrations, runs_in_bearings

RPM = 2 * np.pi / 60
"""One revolution per minute [rad/s]."""


@dataclass(frozen=True)
class Crossing:
    """Rate at which a multiple of the rate meets a frequency.

    Attributes
    ----------
    order : float
        The multiple.
    mode : int
        Number of the mode from 1, by ascending frequency.
    rate : float
        [rad/s]
    frequency_hz, damping, whirl : float
        Of the vibration there, as in `WhirlingModes`.
    """

    order: float
    mode: int
    rate: float
    frequency_hz: float
    damping: float
    whirl: float


@dataclass(frozen=True)
class CampbellDiagram:
    """Vibrations over the rate of rotation.

    Attributes
    ----------
    title : str
        Heading.
    rates : ndarray, shape (n_rates,)
        [rad/s]
    frequencies_hz, damping, whirl : ndarray, shape (n_rates, n_modes)
        As in `WhirlingModes`; not a number where a rate has fewer.
    crossings : tuple of Crossing
        By ascending rate.
    in_rpm : bool
        Rates are told in revolutions per minute.
    """

    title: str
    rates: Array
    frequencies_hz: Array
    damping: Array
    whirl: Array
    crossings: tuple[Crossing, ...]
    in_rpm: bool

    @property
    def unit(self) -> str:
        """Unit in which rates are told."""
        return "rpm" if self.in_rpm else "rad/s"

    def told(self, rate: float | Array) -> Any:
        """Return a rate [rad/s] in the unit in which rates are told."""
        return rate / RPM if self.in_rpm else rate

    def rows(self) -> list[dict[str, Any]]:
        """Return the vibrations at each rate as plain data."""
        found = []
        for k, rate in enumerate(self.rates.tolist()):
            there = np.isfinite(self.frequencies_hz[k])
            row: dict[str, Any] = {"rate_rad_s": rate} | ({"rate_rpm": rate / RPM} if self.in_rpm else {})
            for name in ("frequencies_hz", "damping", "whirl"):
                row[name] = getattr(self, name)[k][there].tolist()
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
                "damping": at.damping,
                "whirl": whirl_word(at.whirl),
            }
            for at in self.crossings
        ]


def whirl_word(whirl: float) -> str:
    """Return ``forward``, ``backward`` or ``none`` for a circulation."""
    return "none" if abs(whirl) < NO_WHIRL else "forward" if whirl > 0 else "backward"


def compute_campbell(run: Pipeline, rates: Array, orders: Sequence[float], in_rpm: bool = False) -> CampbellDiagram:
    """Compute the vibrations of a scene's rotor at each rate [rad/s], and where multiples of the rate meet them.

    Raises
    ------
    InputError
        As `fmd.stages.rotor.find_vibrations`.
    """
    vibrations = find_vibrations(run)
    found = [vibrations(float(rate)) for rate in rates]
    shape = (len(rates), max(len(at.frequencies_hz) for at in found))
    frequencies, damping, whirl = tables = np.full((len(WhirlingModes._fields), *shape), np.nan)
    for k, at in enumerate(found):
        for table, values in zip(tables, at, strict=True):
            table[k, : len(values)] = values
    damping[np.abs(damping) < NO_DAMPING] = 0.0
    still = rates == 0.0
    whirl[still] = np.where(np.isfinite(frequencies[still]), 0.0, np.nan)  # pairs of equal frequency whirl at will
    crossings = _find_crossings(vibrations, rates, frequencies, orders)
    kind = "rotor in its bearings" if runs_in_bearings(run.scene) else "frequencies on a turning hub"
    return CampbellDiagram(f"{run.scene.title}: {kind}", rates, frequencies, damping, whirl, crossings, in_rpm)


def _find_crossings(
    vibrations: Vibrations, rates: Array, frequencies_hz: Array, orders: Sequence[float]
) -> tuple[Crossing, ...]:
    """Find crossings between neighbouring rates, each to the last digits."""
    from scipy.optimize import brentq

    found = []
    for order in orders:
        for mode, values in enumerate(frequencies_hz.T):
            apart = values - order * rates / (2 * np.pi)

            def gap(rate: float, order: float = order, mode: int = mode) -> float:
                return float(vibrations(rate).frequencies_hz[mode] - order * rate / (2 * np.pi))

            for k in np.flatnonzero((apart[:-1] > 0) & (apart[1:] <= 0) | (apart[:-1] < 0) & (apart[1:] >= 0)):
                rate = float(brentq(gap, rates[k], rates[k + 1], rtol=1e-10))
                at = vibrations(rate)
                frequency, damping, whirl = (float(values[mode]) for values in at)
                damping = 0.0 if abs(damping) < NO_DAMPING else damping
                found.append(Crossing(order, mode + 1, rate, frequency, damping, whirl))
    return tuple(sorted(found, key=lambda at: at.rate))


def write_campbell(diagram: CampbellDiagram, folder: Path) -> list[str]:
    """Write a diagram as a chart and as tables of its modes and of its crossings; return the files' names."""
    from fmd.render.campbell_chart import draw_campbell

    folder.mkdir(parents=True, exist_ok=True)
    n_modes = diagram.frequencies_hz.shape[1]
    header = [f"rate_{'rpm' if diagram.in_rpm else 'rad_s'}"]
    for what in ("hz", "damping", "whirl"):
        header += [f"mode_{k + 1}_{what}" for k in range(n_modes)]
    columns = (diagram.told(diagram.rates)[:, None], diagram.frequencies_hz, diagram.damping, diagram.whirl)
    rows = [
        [f"{row[0]:.6g}", *(f"{x:.8g}" for x in row[1 : n_modes + 1]), *(f"{x:.5g}" for x in row[n_modes + 1 :])]
        for row in np.concatenate(columns, axis=1)
    ]
    _write_rows(folder / "campbell.csv", [header, *rows])
    files = ["campbell.csv", "campbell.png"]
    draw_campbell(
        diagram.told(diagram.rates),
        diagram.frequencies_hz[:, :DRAWN_MODES],
        folder / "campbell.png",
        title=diagram.title,
        unit=diagram.unit,
        orders=sorted({at.order for at in diagram.crossings}) or None,
        crossings=[(diagram.told(at.rate), at.frequency_hz) for at in diagram.crossings if at.mode <= DRAWN_MODES],
    )
    if diagram.crossings:
        told = diagram.crossing_rows()
        _write_rows(folder / "crossings.csv", [[*told[0]], *([*row.values()] for row in told)])
        files.append("crossings.csv")
    return files


def _write_rows(path: Path, rows: Sequence[Sequence[Any]]) -> None:
    with whole_file(path) as part, part.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)
