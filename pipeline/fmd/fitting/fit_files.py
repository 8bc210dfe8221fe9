"""Fits as files: a chart, the histories, the figures, and the scene with the fitted numbers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fmd.core.files import whole_file
from fmd.core.limits.shown import DIGITS
from fmd.fitting.changed_scene import write_changed_scene
from fmd.fitting.fit import Fit
from fmd.output.csv_rows import write_rows


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
    fitted_numbers = dict(zip([each.parameter for each in model.varied], fit.values, strict=True))
    write_changed_scene(
        run.scene, fitted_numbers, folder / "fitted.toml", given, _describe(fit, given, data), overrides
    )
    return ["fit.png", "fit.csv", "fit.json", "fitted.toml"]


def _describe(fit: Fit, given: str, data: str) -> list[str]:
    """Return lines that say from what the fitted numbers came."""
    lines = [f"Fitted by fmd fit {given} to {data}; chi-squared {fit.chi2:.6g} of {fit.n_free} degrees of freedom."]
    for varied, value, (low, high) in zip(fit.model.varied, fit.values, fit.intervals, strict=True):
        text = f"{varied.parameter.key}: {value:.6g} {varied.parameter.meaning}".rstrip()
        lines.append(f"{text}, 95 % from {low:.6g} to {high:.6g}; it was {varied.parameter.value:.6g}.")
    return lines
