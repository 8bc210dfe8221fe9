"""Fits as files: a chart, the histories, the figures, and the scene with the fitted numbers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fmd.core.files import number_texts, write_table, write_text
from fmd.fitting.changed_scene import write_changed_scene
from fmd.fitting.fit import Fit
from fmd.scene.scene import Scene


def write_fit(
    fit: Fit, scene: Scene, folder: Path, given: str, data: Sequence[str], overrides: Sequence[str] = ()
) -> list[str]:
    """Write a fit's files into a folder and return their names.

    Parameters
    ----------
    folder : Path
        Made if it is missing.
    given : str
        The scene's name or path, as it was given.
    data : sequence of str
        File of each experiment's measurements.
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

    model, files = fit.model, []
    both = zip(model.predict(np.zeros(len(fit.shares))), model.predict(fit.shares), strict=True)
    for number, (experiment, (first, fitted)) in enumerate(zip(model.experiments, both, strict=True), start=1):
        name = "fit" if number == 1 else f"fit-{number}"
        channels = zip(experiment.channels, first, fitted, strict=True)
        histories = [
            FittedHistory(f"{own.name} [{own.unit}]".removesuffix(" []"), own.values, before, after, own.sigma)
            for own, before, after in channels
        ]
        title = f"{scene.title}: fit to {Path(data[number - 1].partition(';')[0]).name}"
        draw_fit(experiment.axis, histories, folder / f"{name}.png", title=title)
        columns = [
            (f"{own.label} {kind}", getattr(own, kind)) for own in histories for kind in ("measured", "first", "fitted")
        ]
        if str(number) in fit.likeness:
            columns.append(("modal assurance criterion", np.array(fit.likeness[str(number)])))
        table = np.column_stack([experiment.axis[1], *(values for _, values in columns)])
        header = [experiment.axis[0], *(name for name, _ in columns)]
        write_table(folder / f"{name}.csv", header, number_texts(table))
        files += [f"{name}.png", f"{name}.csv"]
    write_text(folder / "fit.json", json.dumps(fit.summary(), indent=1))
    pairs = zip([each.parameter for each in model.varied], fit.values, strict=True)
    fitted_numbers = {parameter: value for parameter, value in pairs if not parameter.clock}
    write_changed_scene(
        scene, fitted_numbers, folder / "fitted.toml", given, _describe(fit, given, ", ".join(data)), overrides
    )
    return [*files, "fit.json", "fitted.toml"]


def _describe(fit: Fit, given: str, data: str) -> list[str]:
    """Return lines that say from what the fitted numbers came."""
    lines = [f"Fitted by fmd fit {given} to {data}; chi-squared {fit.chi2:.6g} of {fit.n_free} degrees of freedom."]
    for varied, value, (low, high) in zip(fit.model.varied, fit.values, fit.intervals, strict=True):
        text = f"{varied.parameter.key}: {value:.6g} {varied.parameter.meaning}".rstrip()
        lines.append(f"{text}, 95 % from {low:.6g} to {high:.6g}; it was {varied.parameter.value:.6g}.")
    return lines
