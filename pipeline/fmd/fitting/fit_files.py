"""Fits as files: a chart, the histories, the figures, and the scene with the fitted numbers."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fmd.core.errors import AccuracyError
from fmd.core.files import whole_file
from fmd.core.limits.round_off import SOLVED
from fmd.core.limits.shown import DIGITS
from fmd.fitting.fit import Fit
from fmd.fitting.parameters import Parameter, find_parameter, list_settings
from fmd.output.csv_rows import write_rows
from fmd.scene.scene import Scene, load_scene
from fmd.scene.toml_files import list_ready_scenes


def write_fit(fit: Fit, folder: Path, given: str, data: str, overrides: Sequence[str] = ()) -> list[str]:
    """Write a fit's files into a folder and return their names.

    Parameters
    ----------
    fit : Fit
        The fit.
    folder : Path
        Made if it is missing.
    given : str
        The scene's name or path, as it was given.
    data : str
        File of the measurements.
    overrides : sequence of str
        Values that were used instead of the scene's own, ``key=value``.

    Raises
    ------
    OSError
        The folder can't be written.
    AccuracyError
        The scene with the fitted numbers reads back as another one.
    """
    from fmd.render.fit_chart import FittedHistory, draw_fit

    folder.mkdir(parents=True, exist_ok=True)
    model, run = fit.model, fit.model.run
    first, fitted = model.histories(np.zeros(len(fit.shares))), model.histories(fit.shares)
    channels = [(each, f"{each.channel.name} [{each.channel.unit}]") for each in model.measured.channels]
    histories = [
        FittedHistory(label, each.values, before, after, each.sigma)
        for (each, label), before, after in zip(channels, first, fitted, strict=True)
    ]
    draw_fit(model.measured.times, histories, folder / "fit.png", title=f"{run.scene.title}: fit to {Path(data).name}")
    columns = [
        (f"{own.label} {kind}", getattr(own, kind)) for own in histories for kind in ("measured", "first", "fitted")
    ]
    table = np.column_stack([model.measured.times, *(values for _, values in columns)])
    with whole_file(folder / "fit.csv") as part:
        header = ["time [s]", *(name for name, _ in columns)]
        write_rows(part, header, ([f"{x:.{DIGITS}g}" for x in row] for row in table))
    with whole_file(folder / "fit.json") as part:
        part.write_text(json.dumps(fit.summary(), indent=1), encoding="utf-8")
    _write_scene(fit, folder / "fitted.toml", given, data, overrides)
    return ["fit.png", "fit.csv", "fit.json", "fitted.toml"]


def _write_scene(fit: Fit, path: Path, given: str, data: str, overrides: Sequence[str]) -> None:
    """Write a scene that is the given one with the fitted numbers, and check that it reads back so."""
    base = given if given in list_ready_scenes() else os.path.relpath(given, path.parent)
    scene = fit.model.run.scene
    fitted = [
        setting
        for varied, value in zip(fit.model.varied, fit.values, strict=True)
        for setting in list_settings(scene, varied.parameter, value)
    ]
    lines = [f"# Fitted by fmd fit {given} to {data}; chi-squared {fit.chi2:.6g} of {fit.n_free} degrees of freedom."]
    for varied, value, (low, high) in zip(fit.model.varied, fit.values, fit.intervals, strict=True):
        unit = varied.parameter.unit or ("times the scene's" if varied.parameter.is_factor else "")
        text = f"# {varied.parameter.key}: {value:.6g} {unit}".rstrip()
        lines.append(f"{text}, 95 % from {low:.6g} to {high:.6g}; it was {varied.parameter.value:.6g}.")
    lines += ["", f"base = {json.dumps(base)}", "set = ["]
    lines += [f"    {json.dumps(text)}," for text in [*overrides, *fitted]]
    lines.append("]")
    with whole_file(path) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")
    again = load_scene(path)
    for varied, value in zip(fit.model.varied, fit.values, strict=True):
        _require_value(again, varied.parameter, value, path)


def _require_value(scene: Scene, parameter: Parameter, value: float, path: Path) -> None:
    found = find_parameter(scene, parameter.key)
    if not parameter.is_factor and not abs(found.value - value) <= SOLVED * abs(value):
        raise AccuracyError(f"{path}: {parameter.key} reads back as {found.value!r}, not {value!r}")
