"""Response of a rotor in bearings to an unbalance, or to a force that goes round, over its rate of rotation."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from fmd.accuracy.response_errors import NO_ERRORS, total_error
from fmd.accuracy.rotor_errors import RicherOrbits, find_richer_orbits
from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.core.files import write_table
from fmd.core.limits.patience import OF_TWO_MESHES
from fmd.core.limits.responses import HALF_POWER, OF_PEAK, PEAK_DIGITS, POINTS_OF_PEAK, SHARPEST, WIDTHS_OF_PEAK
from fmd.output.campbell import RPM
from fmd.output.error_columns import NOT_STATED
from fmd.responses.circular_forces import circular_response
from fmd.responses.interpolated_models import interpolate_models, with_inputs_seen
from fmd.stages.pipeline import Pipeline
from fmd.stages.rotor import coupled, runs_in_bearings
from fmd.stages.turning import TurningRotor
from fmd.stages.whirl_tables import synchronous, warn_of_last_rows


@dataclass(frozen=True)
class Critical:
    """Rate at which a marker goes farthest from the axis."""

    marker: str  # ``"body.marker"``
    rate: float  # [rad/s]
    amplitude: float  # radius of its orbit there [m]
    # The rate over the width of the peak at 0.707 of its height; infinite without damping, no number where that isn't
    # reached on both sides.
    amplification: float
    rate_error: float | None = None  # stated error [rad/s]
    amplitude_error: float | None = None  # stated error [m]


@dataclass(frozen=True)
class CircularResponse:
    """Response of a rotor's axis over the rate of rotation."""

    title: str
    rates: Array  # (n_rates,): those that were asked for and the critical ones [rad/s]
    markers: tuple[str, ...]  # markers on the axis, one for each place, along it
    # (n_rates, n_markers): complex: radius of the part of each orbit that goes round with the force [m], and its angle
    # ahead of it
    displacement: Array
    # (n_rates, n_markers): radius of the part that goes round otherwise [m]; 0 of a rotor that is the same all around
    against: Array
    criticals: tuple[Critical, ...]
    # Stated errors of the amplitudes [m], shape (n_rates, n_markers), or why there are none.
    errors: Array | str = NO_ERRORS
    # Code and text for each table of a bearing that ends below the highest rate.
    warnings: tuple[dict[str, str], ...] = ()

    @property
    def amplitude(self) -> Array:
        """Largest distance of each marker from the axis [m], shape (n_rates, n_markers)."""
        return _radii((self.displacement, self.against))

    def rows(self) -> list[dict[str, Any]]:
        """Return the response at each rate as plain data."""
        columns = {"amplitude_m": self.amplitude, "phase_deg": np.degrees(np.angle(self.displacement))}
        columns |= {} if isinstance(self.errors, str) else {"amplitude_error_m": self.errors}
        return [
            {"rate_rad_s": rate, "speed_rpm": rate / RPM}
            | {f"{name}.{what}": x for what, table in columns.items() for name, x in self._named(table[k])}
            | ({"error": NOT_STATED + self.errors} if isinstance(self.errors, str) else {})
            for k, rate in enumerate(self.rates.tolist())
        ]

    def _named(self, values: Array) -> Iterator[tuple[str, float]]:
        return zip(self.markers, values.tolist(), strict=True)

    def critical_rows(self) -> list[dict[str, Any]]:
        """Return the critical rates as plain data."""
        return [
            {"marker": at.marker, "rate_rad_s": at.rate, "speed_rpm": at.rate / RPM, "amplitude_m": at.amplitude}
            | {"rate_error_rad_s": at.rate_error, "amplitude_error_m": at.amplitude_error}
            | {"amplification": at.amplification if np.isfinite(at.amplification) else None}
            for at in self.criticals
        ]


def compute_circular_response(
    run: Pipeline, place: str, force: Callable[[float], float], rates: Array, order: float = 1.0
) -> CircularResponse:
    """Compute the response to a force at a marker ``"body.marker"`` that goes round at a multiple of the rotor's rate.

    The order is 1 of an unbalance, below 0 for a force that goes round backwards. The force [N] is a function of the
    rate [rad/s], ``U Ω²`` of an unbalance U [kg m]; rates (n_rates,) ascend from above 0 [rad/s].

    Raises
    ------
    InputError
        The scene is no rotor in bearings, the marker is unknown, or as `fmd.stages.turning.TurningRotor`.
    """
    given, run = run.scene, synchronous(coupled(run), order)
    with threadpool_limits(1):
        if not runs_in_bearings(run.scene):
            mend = "isn't a rotor in bearings: its first body hangs on a free joint, and [bearing.NAME] hold it"
            raise InputError(run.scene.file, "joint", None, mend)
        seen, at = _orbits(run, place, force, rates, order)
        kind = "unbalance" if order == 1.0 else f"force of order {order:g}"
        title = f"{run.scene.title}: {kind} at {place}"

        def over(rates: Array, criticals: tuple[Critical, ...]) -> CircularResponse:
            found = [at(rate) for rate in rates.tolist()]
            displacement, against = (np.array(part) for part in zip(*found, strict=True))
            ends = warn_of_last_rows(given, float(rates[-1]), order)
            return CircularResponse(title, rates, seen, displacement, against, criticals, warnings=ends)

        amplitude, peaks = over(rates, ()).amplitude, list[Critical]()
        for k, name in enumerate(seen):
            peaks += _find_peaks(rates, amplitude[:, k], partial(_reach, at, k), name)
        criticals = tuple(sorted(peaks, key=lambda each: each.rate))
        return over(np.union1d(rates, [each.rate for each in criticals]), criticals)  # charts show the peaks


def _orbits(
    run: Pipeline, place: str, force: Callable[[float], float], rates: Array, order: float
) -> tuple[tuple[str, ...], Callable[[float], tuple[Array, Array]]]:
    """Return markers on the axis, and a function from a rate to their displacement with the force and against it."""
    rotor = TurningRotor(run, in_bearings=True)
    if place not in rotor.markers:
        raise InputError("--at", "", place, f"is no marker; the markers: {', '.join(dict.fromkeys(rotor.markers))}")
    seen = rotor.places_on_axis(place)
    forced, n_points = rotor.forced(place), len(rotor.markers)
    ends = float(rates[0]), float(rates[-1])
    matrices = interpolate_models(lambda rate: with_inputs_seen(forced(rate)), *ends, rotor.bends)

    def at(rate: float) -> tuple[Array, Array]:
        A, both = matrices(rate)
        C, B = both[: 6 * n_points], both[6 * n_points :].T
        rows = [C[[way * n_points + k for k in seen.values()]] for way in (0, 1)]
        forward, against = circular_response(A, B, (rows[0], rows[1]), (order - 1.0) * rate)
        return force(rate) * forward, abs(force(rate)) * against

    return tuple(seen), at


def with_orbit_errors(
    response: CircularResponse, run: Pipeline, place: str, force: Callable[[float], float], order: float = 1.0
) -> CircularResponse:
    """Return a response of `compute_circular_response` with the errors of its radii, or why none are stated."""

    def respond(other: Pipeline) -> Callable[[float], Array]:
        _, at = _orbits(other, place, force, response.rates, order)
        return lambda rate: _radii(at(rate))

    def estimate() -> CircularResponse:
        rotor, highest = synchronous(coupled(run), order), float(response.rates[-1])
        found = find_richer_orbits(rotor, respond, highest, order, run.store.advance)
        if isinstance(found, str):
            return replace(response, errors=found)
        errors, criticals = found.errors(response.rates, response.amplitude), list[Critical]()
        for k, at in enumerate(response.criticals):
            run.store.advance(OF_TWO_MESHES + (1.0 - OF_TWO_MESHES) * (k + 1) / (len(response.criticals) + 1))
            criticals.append(_with_errors(at, response.markers.index(at.marker), found))
        return replace(response, errors=errors, criticals=tuple(criticals))

    return run.store.compute("errors of orbits", estimate)


def _with_errors(at: Critical, k: int, richer: RicherOrbits) -> Critical:
    """Return a critical rate of marker k with its errors, by that with more modes and the mesh's shift."""

    def amplitude(rate: float) -> float:
        return float(richer.radii(rate)[k])

    near = max(OF_PEAK, WIDTHS_OF_PEAK / at.amplification)
    places = at.rate * np.linspace(1.0 - near, 1.0 + near, POINTS_OF_PEAK)
    places = places[places <= richer.highest]
    best = int(np.argmax([amplitude(rate) for rate in places.tolist()]))
    rate, height = _highest(amplitude, places[max(best - 1, 0)], places[min(best + 1, len(places) - 1)])
    share = float(richer.share(np.array([at.rate]))[0])
    off = total_error(rate - at.rate, share * at.rate), total_error(height - at.amplitude, 2.0 * share * height)
    return replace(at, rate_error=float(off[0]), amplitude_error=float(off[1]))


def _radii(both: tuple[Array, Array]) -> Array:
    """Return the largest distances of markers from the axis by their displacement with a force and against it [m]."""
    return np.asarray(np.abs(both[0]) + both[1])


def _reach(at: Callable[[float], tuple[Array, Array]], k: int, rate: float) -> float:
    """Return the largest distance of a point from the axis at a rate [rad/s]."""
    forward, against = at(rate)
    return float(abs(forward[k]) + against[k])


def _find_peaks(rates: Array, amplitudes: Array, amplitude: Callable[[float], float], name: str) -> list[Critical]:
    """Find the peaks between neighbouring rates, each to the last digits, and their widths."""
    found = []
    inner = np.arange(1, len(rates) - 1)
    for k in inner[(amplitudes[inner] > amplitudes[inner - 1]) & (amplitudes[inner] >= amplitudes[inner + 1])]:
        ends = (float(rates[k - 1]), float(rates[k + 1]))
        rate, height = _highest(amplitude, *ends)
        sides = [_half_power(amplitude, rate, end, HALF_POWER * height) for end in (rates[0], rates[-1])]
        width = sides[1] - sides[0] if all(side is not None for side in sides) else np.nan
        factor = np.inf if width <= rate / SHARPEST else rate / width
        found.append(Critical(name, rate, height, factor))
    return found


def _highest(amplitude: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Return the rate between two with the highest amplitude, to the last digits, and that."""
    from scipy.optimize import minimize_scalar

    best = minimize_scalar(
        lambda rate: -amplitude(rate), bounds=(low, high), method="bounded", options={"xatol": PEAK_DIGITS * high}
    )
    return float(best.x), -float(best.fun)


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
        ResponseCurve(
            name,
            "m",
            response.amplitude[:, k] * np.exp(1j * np.angle(response.displacement[:, k])),
            None if isinstance(response.errors, str) else response.errors[:, k],
        )
        for k, name in enumerate(response.markers)
    ]
    draw_response(response.rates / RPM, curves, folder / "unbalance.png", title=response.title, along="speed [rpm]")
    tables = {"unbalance.csv": response.rows(), "criticals.csv": response.critical_rows()}
    for name, rows in tables.items():
        if rows:
            cells = ([f"{x:.8g}" if isinstance(x, float) else x for x in row.values()] for row in rows)
            write_table(folder / name, [*rows[0]], cells)
    return ["unbalance.png", *(name for name, rows in tables.items() if rows)]
