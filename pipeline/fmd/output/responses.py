"""Linear answers of a scene as files: frequency responses, random vibration and state-space models."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fmd.accuracy.error_budget import ERROR_BUDGET
from fmd.accuracy.response_errors import NO_ERRORS, BandErrors, Request, ResponseErrors, estimate_response_errors
from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, InputError
from fmd.core.files import whole_file, write_table
from fmd.core.limits.responses import AWAY_FROM_POLE, FINE_RATIO, NEAR_POLE, RESONANT, UNBOUNDED, UNDAMPED
from fmd.core.limits.shown import LINE_POLES
from fmd.core.netcdf import NetcdfVariable, write_netcdf
from fmd.output.error_columns import NOT_STATED
from fmd.output.output_kinds import OutputKind, ResponseKind, key_of
from fmd.output.stated_errors import with_plain_error
from fmd.responses.random_vibration import RandomResponse, random_response
from fmd.responses.state_space import choose_frequencies
from fmd.scene.outputs import FrequencyResponseChart
from fmd.stages.linear_model import LinearModel, linearise_scene, read_density
from fmd.stages.pipeline import Pipeline


@dataclass(frozen=True)
class FrequencyResponse:
    """Frequency response of a scene, and what a random input makes of it."""

    linear: LinearModel
    frequencies_hz: Array  # (n_frequencies,) [Hz]
    values: Array  # (n_frequencies, n_outputs, n_inputs): complex
    request: Request  # names of inputs and outputs, and the state, that it was computed for
    random: RandomResponse | None = None  # answer of the outputs to a random input, the first
    density: Callable[[Array], Array] | None = None  # spectral density of that
    errors: ResponseErrors | None = None  # stated errors, if they were estimated

    @property
    def why(self) -> str:
        """Why no errors are stated; empty if they are."""
        return NO_ERRORS if self.errors is None else self.errors.why

    @property
    def inputs(self) -> list[tuple[str, str]]:
        """Names and units of the inputs."""
        return self.linear.input_names(as_positions=True)

    @property
    def outputs(self) -> list[tuple[str, str]]:
        """Names and units of the outputs."""
        return [(channel.name, channel.unit) for channel in self.linear.model.outputs]

    def summary(self) -> dict[str, Any]:
        """Return poles, zeros and, of a random input, root mean squares, as plain data."""
        model = self.linear.model
        found: dict[str, Any] = {
            "about": self.linear.about,
            "inputs": [name for name, _ in self.inputs],
            "outputs": [name for name, _ in self.outputs],
            "poles_hz": model.poles_hz.tolist(),
            "damping": model.damping.tolist(),
            "warnings": self.linear.warnings,
            "holds_to_hz": self.linear.holds_to_hz,
            "largest_errors": self._largest_errors(),
        }
        top = self.frequencies_hz[-1]
        found["zeros_hz"] = {
            f"{output} by {name}": [float(f) for f in model.zeros_hz(k, j) if f <= top]
            for k, (name, _) in enumerate(self.inputs)
            for j, (output, _) in enumerate(self.outputs)
        }
        if self.random is not None:
            rows = zip(self.outputs, self.random.rms, self.random.rates_hz, self._errors_of_rms(), strict=True)
            found["random"] = [
                {"output": name, "unit": unit, "rms": float(rms), "crossings_hz": float(rate), "error": error}
                for (name, unit), rms, rate, error in rows
            ]
        return found

    def _largest_errors(self) -> list[dict[str, Any]]:
        """Return the largest error of each pair's response over the largest response, or why none is stated."""
        if self.errors is None or self.why:
            return [{"why": self.why}]
        largest = np.abs(self.values).max(axis=0)
        worst = self.errors.values.max(axis=0)
        return [
            {"output": output, "input": name, "unit": response_unit(of, by), "error": float(worst[j, k])}
            | {"of_largest": float(worst[j, k] / largest[j, k]) if largest[j, k] else 0.0}
            for k, (name, by) in enumerate(self.inputs)
            for j, (output, of) in enumerate(self.outputs)
        ]

    def _errors_of_rms(self) -> list[float | None]:
        stated = self.errors is not None and not self.why
        return [float(x) for x in self.errors.rms] if stated and self.errors else [None] * len(self.outputs)

    def with_errors(self, run: Pipeline) -> FrequencyResponse:
        """Return the response with its stated errors."""
        found = estimate_response_errors(run, self.linear, self.request, self.frequencies_hz, self.density)
        return replace(self, errors=found)


def compute_response(
    run: Pipeline,
    inputs: Sequence[str],
    outputs: Sequence[str],
    highest: float,
    lowest: float | None = None,
    points: int = 1000,
    about: str = "start",
    psd: tuple[str, Path, tuple[str, str]] | None = None,
) -> FrequencyResponse:
    """Compute the frequency response of a scene, between channels that are named as in docs/responses.md.

    The range [Hz] is from a thousandth of the highest by default; so many points are evenly spaced, beside those about
    resonances. The state is as `linearise_scene` takes it, and the spectral density of the only input as `read_density`
    does.

    Raises
    ------
    InputError, AccuracyError
        As `linearise_scene` and `read_density`; or a random input isn't the only one.
    """
    density = None if psd is None else read_density(*psd)
    if psd is not None and len(inputs) != 1:
        raise InputError(*psd[2], psd[0], f"belongs to one input; {len(inputs)} are given")
    linear = linearise_scene(run, inputs, outputs, about)
    lowest = highest / 1000 if lowest is None else lowest
    frequencies = choose_frequencies(linear.model, lowest, highest, points)
    values = linear.frequency_response(frequencies)
    finite = np.isfinite(values).all(axis=(1, 2))  # not so at 0 Hz, where nothing holds what is pushed
    random = None
    if density is not None:
        _require_stationary(linear, lowest, highest)
        fine = choose_frequencies(linear.model, lowest, highest, points, FINE_RATIO)
        random = random_response(fine, linear.frequency_response(fine)[:, :, 0], density)
    request = (inputs, outputs, about)
    return FrequencyResponse(linear, frequencies[finite], values[finite], request, random, density)


def _require_stationary(linear: LinearModel, lowest: float, highest: float) -> None:
    """Raise ``AccuracyError`` unless the mean squares of all outputs to noise in a range [Hz] are finite."""
    model = linear.model
    if model.growth:
        problem = f"from the state of linearisation ({linear.about}) a small motion grows by {model.growth:.3g} 1/s"
        raise AccuracyError(f"no root mean square: {problem}, so noise has no stationary answer")
    if not np.isfinite(linear.frequency_response(np.array([lowest]))).all():
        raise AccuracyError(f"no root mean square: the response is unbounded at {lowest:g} Hz; begin above, by --from")
    undamped = model.poles_hz[(np.abs(model.damping) < UNDAMPED) & (model.poles_hz >= lowest)]
    for pole in undamped[undamped <= highest]:
        near, away = np.abs(linear.frequency_response(pole * (1.0 + np.array([NEAR_POLE, AWAY_FROM_POLE]))))
        if (near > RESONANT * away).any():
            problem = f"the mode at {pole:.5g} Hz has no damping, so noise makes it grow without bound"
            raise AccuracyError(f"no root mean square: {problem}; modes.damping, or dampers, bound it")


def write_response(found: FrequencyResponse, path: Path, title: str, chart: bool = True) -> list[str]:
    """Write a frequency response as a chart, as a table and as NetCDF files of its name; return the files' names."""
    files = []
    if chart:
        _draw(found, path, title)
        files.append(path.name)
    _write_table(found, path.with_suffix(".csv"))
    _write_netcdf(found, path.with_suffix(".nc"))
    return [*files, path.with_suffix(".csv").name, path.with_suffix(".nc").name]


def write_scene_response(
    run: Pipeline, output: FrequencyResponseChart, found: FrequencyResponse, folder: Path, chart: bool
) -> dict[str, Any]:
    """Write a frequency response that a scene lists; return its summary with its files."""
    title = output.title or f"{run.scene.title}: response to {output.input}"
    if ERROR_BUDGET.name in run.results:  # errors are asked for
        found = found.with_errors(run)
    return {**found.summary(), "files": write_response(found, folder / output.file, title, chart)}


def tabulate_poles(summary: dict[str, Any]) -> dict[str, Any]:
    """Return the table of poles and damping of a response's summary."""
    pairs = zip(summary["poles_hz"], summary["damping"], strict=True)
    rows = [(k, f"{hertz:.5g}", f"{damping:.3g}") for k, (hertz, damping) in enumerate(pairs, start=1)]
    return {"header": ("pole", "Hz", "damping ratio"), "rows": rows}


def describe_response(summary: dict[str, Any]) -> list[str]:
    """Return the lines that a run writes of a response's summary: its poles, and root mean squares."""
    poles = ", ".join(f"{pole:.4g}" for pole in summary["poles_hz"][:LINE_POLES])
    rms = (
        f"RMS of {row['output']}: {with_plain_error(row['rms'], row['error'], row['unit'])}"
        for row in summary.get("random", ())
    )
    return [f"{summary['files'][0]}: linear about {summary['about']}, poles at {poles} … Hz", *rms]


def compute_scene_response(run: Pipeline, output: FrequencyResponseChart) -> FrequencyResponse:
    """Compute a frequency response that a scene lists.

    Raises
    ------
    InputError, AccuracyError
        As `compute_response`; the message names the key of the scene.
    """
    scene = run.scene
    psd = (
        None if output.psd is None else (output.psd, Path(scene.file).parent, (scene.file, key_of(run, output, "psd")))
    )
    try:
        return compute_response(
            run, [output.input], output.outputs, output.to, output.from_, output.points, output.about, psd
        )
    except InputError as error:
        keys = {"--in": "input", "--out": "output", "--about": "about"}
        if error.file not in keys:
            raise
        raise InputError(scene.file, key_of(run, output, keys[error.file]), error.value, error.mend) from None


def write_model(
    linear: LinearModel, folder: Path, formats: Sequence[str], errors: BandErrors | None = None
) -> list[str]:
    """Write a linear model as ``model.npz`` and ``model.mat``, those whose suffixes are given; return their names."""
    more: dict[str, Any] = {} if linear.holds_to_hz is None else {"holds_to_hz": linear.holds_to_hz}
    if errors is None or errors.why:
        more["error"] = NOT_STATED + (NO_ERRORS if errors is None else errors.why)
    else:
        more |= {"error": errors.values, "error_edges_hz": errors.edges_hz}
    for suffix in formats:
        linear.model.save(folder / f"model{suffix}", more)
    return [f"model{suffix}" for suffix in formats]


def response_unit(output: str, unit: str) -> str:
    """Return the unit of an output over that of an input: ``m/N``, or ``m/(m/s^2)``."""
    if output == unit:
        return "1"
    return f"{output}/({unit})" if any(sign in unit for sign in "/ ") else f"{output}/{unit}"


def _draw(found: FrequencyResponse, path: Path, title: str) -> None:
    from fmd.render.response_chart import ResponseCurve, draw_response

    curves = []
    for k, (name, unit) in enumerate(found.inputs):
        for j, (output, of_output) in enumerate(found.outputs):
            label = f"{output} by {name}" if len(found.inputs) > 1 else output
            values = np.where(np.abs(found.values[:, j, k]) < UNBOUNDED, found.values[:, j, k], np.nan)
            error = None if found.errors is None or found.why else found.errors.values[:, j, k]
            curves.append(ResponseCurve(label, response_unit(of_output, unit), values, error))
    if found.random is not None:
        for j, (output, unit) in enumerate(found.outputs):
            at = found.frequencies_hz
            density = np.interp(at, found.random.frequencies_hz, found.random.density[:, j])
            label = f"{output}, RMS {found.random.rms[j]:.3g} {unit}"
            squared = f"({unit})^2" if "/" in unit else f"{unit}^2"
            curves.append(ResponseCurve(label, f"{squared}/Hz", density))
    draw_response(found.frequencies_hz, curves, path, title=title)


def _write_table(found: FrequencyResponse, path: Path) -> None:
    header, columns = ["frequency_hz"], [found.frequencies_hz]
    for k, (name, unit) in enumerate(found.inputs):
        for j, (output, of_output) in enumerate(found.outputs):
            values, unit_of = found.values[:, j, k], response_unit(of_output, unit)
            pair = f"{output} by {name}"
            header += [f"{pair} {part} [{unit_of}]" for part in ("real", "imaginary", "magnitude")]
            header.append(f"{pair} phase [deg]")
            columns += [values.real, values.imag, np.abs(values), np.degrees(np.angle(values))]
            if found.errors is not None and not found.why:
                header.append(f"{pair} error [{unit_of}]")
                columns.append(found.errors.values[:, j, k])
    if found.random is not None:
        for j, (output, unit) in enumerate(found.outputs):
            header.append(f"{output} spectral density [({unit})^2/Hz]")
            columns.append(np.interp(found.frequencies_hz, found.random.frequencies_hz, found.random.density[:, j]))
    write_table(path, header, ([f"{x:.9g}" for x in row] for row in np.stack(columns, axis=1)))


def _write_netcdf(found: FrequencyResponse, path: Path) -> None:
    dims = ("frequency", "output", "input")
    units = [[response_unit(of, by) for _, by in found.inputs] for _, of in found.outputs]
    model = found.linear.model
    error = NOT_STATED + found.why if found.why else "variable error"
    variables = [
        NetcdfVariable("frequency", dims[:1], found.frequencies_hz, {"units": "Hz", "long_name": "frequency"}),
        NetcdfVariable("output", dims[1:2], np.array([name for name, _ in found.outputs])),
        NetcdfVariable("input", dims[2:], np.array([name for name, _ in found.inputs])),
        NetcdfVariable("units", dims[1:], np.array(units)),
        NetcdfVariable("real", dims, found.values.real, {"long_name": "real part, in units", "error": error}),
        NetcdfVariable("imaginary", dims, found.values.imag, {"long_name": "imaginary part, in units", "error": error}),
        NetcdfVariable("pole", ("pole",), model.poles_hz, {"units": "Hz", "long_name": "natural frequencies"}),
        NetcdfVariable("damping", ("pole",), model.damping, {"units": "1", "long_name": "damping ratios"}),
    ]
    if found.errors is not None and not found.why:
        text: dict[str, str | float] = {"long_name": "stated size of the complex response's error, in units"}
        variables.append(NetcdfVariable("error", dims, found.errors.values, text))
    with whole_file(path) as part:
        write_netcdf(part, variables)


KINDS = {
    "frf": OutputKind(
        response=ResponseKind(compute_scene_response, write_scene_response, tabulate_poles, describe_response)
    )
}
