"""Response of a rotor in bearings to an unbalance, or to a force that goes round, over its rate of rotation."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.files import whole_file
from fmd.core.limits.rotors import HALF_POWER, PEAK_DIGITS, SHARPEST
from fmd.output.campbell import RPM
from fmd.responses.circular_forces import circular_response
from fmd.responses.interpolated_models import interpolate_models
from fmd.responses.state_space import StateSpace
from fmd.stages.pipeline import Pipeline
from fmd.stages.rotor import coupled, runs_in_bearings
from fmd.stages.turning import TurningRotor


@dataclass(frozen=True)
class Critical:
    """Rate at which a marker goes farthest from the axis.

    Attributes
    ----------
    marker : str
        ``"body.marker"``.
    rate : float
        [rad/s]
    amplitude : float
        Radius of its orbit there [m].
    amplification : float
        The rate over the width of the peak at 0.707 of its height; infinite where that isn't reached on both sides.
    """

    marker: str
    rate: float
    amplitude: float
    amplification: float


@dataclass(frozen=True)
class CircularResponse:
    """Response of a rotor's axis over the rate of rotation.

    Attributes
    ----------
    title : str
        Heading.
    rates : ndarray, shape (n_rates,)
        Those that were asked for and the critical ones [rad/s].
    markers : tuple of str
        Markers on the axis, one for each place, along it.
    displacement : ndarray, shape (n_rates, n_markers)
        Complex: radius of the part of each orbit that goes round with the force [m], and its angle ahead of it.
    against : ndarray, shape (n_rates, n_markers)
        Radius of the part that goes round otherwise [m]; 0 of a rotor that is the same all around.
    criticals : tuple of Critical
        By ascending rate.
    """

    title: str
    rates: Array
    markers: tuple[str, ...]
    displacement: Array
    against: Array
    criticals: tuple[Critical, ...]

    @property
    def amplitude(self) -> Array:
        """Largest distance of each marker from the axis [m], shape (n_rates, n_markers)."""
        return np.asarray(np.abs(self.displacement) + self.against)

    def rows(self) -> list[dict[str, Any]]:
        """Return the response at each rate as plain data."""
        phases = np.degrees(np.angle(self.displacement))
        return [
            {"rate_rad_s": rate, "speed_rpm": rate / RPM}
            | {f"{name}.amplitude_m": float(x) for name, x in zip(self.markers, self.amplitude[k], strict=True)}
            | {f"{name}.phase_deg": float(x) for name, x in zip(self.markers, phases[k], strict=True)}
            for k, rate in enumerate(self.rates.tolist())
        ]

    def critical_rows(self) -> list[dict[str, Any]]:
        """Return the critical rates as plain data."""
        return [
            {"marker": at.marker, "rate_rad_s": at.rate, "speed_rpm": at.rate / RPM, "amplitude_m": at.amplitude}
            | {"amplification": at.amplification if np.isfinite(at.amplification) else None}
            for at in self.criticals
        ]


def compute_circular_response(
    run: Pipeline, place: str, force: Callable[[float], float], rates: Array, order: float = 1.0
) -> CircularResponse:
    """Compute the response to a force at a marker that goes round at a multiple of the rate of rotation.

    Parameters
    ----------
    place : str
        ``"body.marker"``.
    force : callable
        Returns its size [N] at a rate [rad/s]: ``U Ω²`` of an unbalance U [kg m].
    rates : ndarray, shape (n_rates,)
        Rates of rotation [rad/s], ascending from above 0.
    order : float
        The multiple: 1 of an unbalance, below 0 for a force that goes round backwards.

    Raises
    ------
    InputError
        The scene is no rotor in bearings, the marker is unknown, or as `fmd.stages.turning.TurningRotor`.
    """
    run = coupled(run)
    with threadpool_limits(1):
        if not runs_in_bearings(run.scene):
            mend = "isn't a rotor in bearings: its first body hangs on a free joint, and [bearing.NAME] hold it"
            raise InputError(run.scene.file, "joint", None, mend)
        rotor = TurningRotor(run, in_bearings=True)
        if place not in rotor.markers:
            raise InputError("--at", "", place, f"is no marker; the markers: {', '.join(dict.fromkeys(rotor.markers))}")
        seen = rotor.places_on_axis(place)
        forced, n_points = rotor.forced(place), len(rotor.markers)
        matrices = interpolate_models(lambda rate: _with_inputs_seen(forced(rate)), float(rates[0]), float(rates[-1]))

        def at(rate: float) -> tuple[Array, Array]:
            A, both = matrices(rate)
            C, B = both[: 3 * n_points], both[3 * n_points :].T
            rows = [C[[way * n_points + k for k in seen.values()]] for way in (0, 1)]
            forward, against = circular_response(A, B, (rows[0], rows[1]), (order - 1.0) * rate)
            return force(rate) * forward, abs(force(rate)) * against

        kind = "unbalance" if order == 1.0 else f"force of order {order:g}"
        title = f"{run.scene.title}: {kind} at {place}"

        def over(rates: Array, criticals: tuple[Critical, ...]) -> CircularResponse:
            found = [at(rate) for rate in rates.tolist()]
            displacement, against = (np.array(part) for part in zip(*found, strict=True))
            return CircularResponse(title, rates, tuple(seen), displacement, against, criticals)

        amplitude, peaks = over(rates, ()).amplitude, list[Critical]()
        for k, name in enumerate(seen):
            peaks += _find_peaks(rates, amplitude[:, k], partial(_reach, at, k), name)
        criticals = tuple(sorted(peaks, key=lambda each: each.rate))
        return over(np.union1d(rates, [each.rate for each in criticals]), criticals)  # charts show the peaks


def _with_inputs_seen(model: StateSpace) -> StateSpace:
    """Return a model without inputs, whose last outputs are the columns of its input matrix."""
    C, outputs = np.concatenate([model.C, model.B.T]), (*model.outputs, *model.inputs)
    return StateSpace(model.A, np.zeros((len(model.A), 0)), C, np.zeros((len(C), 0)), model.states, (), outputs)


def _reach(at: Callable[[float], tuple[Array, Array]], k: int, rate: float) -> float:
    """Return the largest distance of a point from the axis at a rate [rad/s]."""
    forward, against = at(rate)
    return float(abs(forward[k]) + against[k])


def _find_peaks(rates: Array, amplitudes: Array, amplitude: Callable[[float], float], name: str) -> list[Critical]:
    """Find the peaks between neighbouring rates, each to the last digits, and their widths."""
    from scipy.optimize import minimize_scalar

    found = []
    inner = np.arange(1, len(rates) - 1)
    for k in inner[(amplitudes[inner] > amplitudes[inner - 1]) & (amplitudes[inner] >= amplitudes[inner + 1])]:
        ends = (float(rates[k - 1]), float(rates[k + 1]))
        best = minimize_scalar(
            lambda rate: -amplitude(rate), bounds=ends, method="bounded", options={"xatol": PEAK_DIGITS * ends[1]}
        )
        rate, height = float(best.x), -float(best.fun)
        sides = [_half_power(amplitude, rate, end, HALF_POWER * height) for end in (rates[0], rates[-1])]
        width = sides[1] - sides[0] if all(side is not None for side in sides) else 0.0
        factor = rate / width if width > rate / SHARPEST else np.inf
        found.append(Critical(name, rate, height, factor))
    return found


def _half_power(amplitude: Callable[[float], float], rate: float, end: float, height: float) -> Any:
    """Return the rate towards an end at which the amplitude falls below a height; none if it doesn't."""
    from scipy.optimize import brentq

    inside, step = rate, 2.0 * PEAK_DIGITS * rate
    while True:
        outside = rate + np.sign(end - rate) * min(step, abs(end - rate))
        if amplitude(outside) < height:
            return float(brentq(lambda x: amplitude(x) - height, inside, outside, rtol=PEAK_DIGITS))
        if outside == end or step > abs(end - rate):
            return None
        inside, step = outside, 2.0 * step


def write_circular_response(response: CircularResponse, folder: Path) -> list[str]:
    """Write a response as a chart and as tables of it and of its critical rates; return the files' names."""
    from fmd.render.response_chart import ResponseCurve, draw_response

    folder.mkdir(parents=True, exist_ok=True)
    curves = [
        ResponseCurve(name, "m", response.amplitude[:, k] * np.exp(1j * np.angle(response.displacement[:, k])))
        for k, name in enumerate(response.markers)
    ]
    draw_response(response.rates / RPM, curves, folder / "unbalance.png", title=response.title, along="speed [rpm]")
    tables = {"unbalance.csv": response.rows(), "criticals.csv": response.critical_rows()}
    for name, rows in tables.items():
        if rows:
            with whole_file(folder / name) as part, part.open("w", newline="") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(rows[0])
                writer.writerows([f"{x:.8g}" if isinstance(x, float) else x for x in row.values()] for row in rows)
    return ["unbalance.png", *(name for name, rows in tables.items() if rows)]
