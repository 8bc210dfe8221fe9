"""Files of fits, designs and sensitivities: tables, charts, and scenes with the numbers found."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.core.files import number_texts, write_table, write_text
from fmd.core.limits.round_off import SOLVED
from fmd.core.limits.shown import DIGITS
from fmd.fitting.fit_result import Fit
from fmd.fitting.optimise import Optimum
from fmd.fitting.parameters import Parameter, change_parameters, find_parameter, list_settings
from fmd.fitting.sensitivities import Sensitivity
from fmd.fitting.uncertainty import Uncertainty
from fmd.scene.bodies import Deformable
from fmd.scene.scene import Scene, load_scene
from fmd.scene.toml_files import list_ready_scenes


def write_changed_scene(
    scene: Scene,
    values: Mapping[Parameter, float],
    path: Path,
    given: str,
    comments: Sequence[str],
    overrides: Sequence[str] = (),
) -> None:
    """Write a scene that is the given one with other numbers [SI], and check that it reads back so.

    Comments are its first lines, which say from what the numbers came; overrides are values ``key=value`` that were
    used instead of the scene's own.

    Raises
    ------
    OSError
        The file can't be written.
    AccuracyError
        A number reads back as another one.
    """
    base = given if given in list_ready_scenes() else os.path.relpath(given, path.parent)
    settings = [text for parameter, value in values.items() for text in list_settings(scene, parameter, value)]
    settings += _list_kept_elements(scene, change_parameters(scene, values))
    lines = [*(f"# {text}" for text in comments), "", f"base = {json.dumps(base)}", "set = ["]
    lines += [f"    {json.dumps(text)}," for text in [*overrides, *settings]]
    write_text(path, "\n".join([*lines, "]"]) + "\n")
    again = load_scene(path)
    for parameter, value in values.items():
        found = find_parameter(again, parameter.key)
        if not parameter.is_factor and not abs(found.value - value) <= SOLVED * abs(value):
            raise AccuracyError(f"{path}: {parameter.key} reads back as {found.value!r}, not {value!r}")


def _list_kept_elements(scene: Scene, changed: Scene) -> list[str]:
    """Return what sets at which dimensions bodies were meshed, of those that keep the elements of another scene."""
    bodies = {name: body for name, body in changed.body.items() if isinstance(body, Deformable)}
    kept = {name: body.kept_elements for name, body in bodies.items() if body != scene.body[name]}
    return [f"body.{name}.{text}" for name, text in kept.items() if text]


def write_sensitivities(found: Sequence[Sensitivity], times: Array | None, folder: Path, title: str) -> list[str]:
    """Write sensitivities into a folder and return the names of the files.

    They are one at least; times (n_times,) [s] are those of the histories among them.

    Raises
    ------
    OSError
        The folder can't be written.
    """
    rows = [each.row() for each in found]
    ends = ("relative_low", "relative_high")
    cells = [row | dict(zip(ends, row.pop("interval") or (None, None), strict=True)) for row in rows]
    _write(folder / "sensitivities.csv", list(cells[0]), [[*row.values()] for row in cells])
    files = ["sensitivities.csv"]
    histories = [each for each in found if each.value.ndim]
    if histories and times is not None:
        columns = {each.channel.name: (each.channel, each.value) for each in histories}
        header = ["time [s]", *(f"{channel.name} [{channel.unit}]" for channel, _ in columns.values())]
        header += [f"d {each.channel.name} / d ln {each.parameter.key} [{each.channel.unit}]" for each in histories]
        arrays = [times, *(value for _, value in columns.values())]
        arrays += [each.slope * each.parameter.value for each in histories]
        _write(
            folder / "sensitivity-histories.csv", header, [[float(x) for x in row] for row in zip(*arrays, strict=True)]
        )
        files.append("sensitivity-histories.csv")
    bars: dict[str, list[tuple[str, float, float]]] = {}
    for each in found:
        if each.row()["relative"] is not None:
            bars.setdefault(each.channel.name, []).append((each.parameter.key, each.relative, each.relative_error))
    if bars:
        from fmd.render.fit_chart import draw_tornado

        label = "change of the result [%] by a change of the number of 1 %"
        draw_tornado(bars, folder / "sensitivities.png", title=title, label=label)
        files.append("sensitivities.png")
    return files


def write_uncertainties(found: Sequence[Uncertainty], folder: Path, title: str) -> list[str]:
    """Write what tolerances make of results as a table and a chart into a folder, and return the files' names.

    Raises
    ------
    OSError
        The folder can't be written.
    """
    from fmd.render.fit_chart import draw_tornado

    cells: list[list[object]] = []
    bars: dict[str, list[tuple[str, float, float]]] = {}
    for each in found:
        row = each.row()
        for key, change in each.shares.items():
            parts = [each.channel.name, each.value, each.channel.unit, row["half_width"], key, change]
            cells.append([*parts, row["contributions"][key]])
            if each.value:
                bars.setdefault(each.channel.name, []).append((key, 100.0 * change / abs(each.value), 0.0))
    header = ["of", "value", "unit", "half_width", "number", "change_by_tolerance", "part_of_variance"]
    _write(folder / "uncertainties.csv", header, cells)
    if not bars:
        return ["uncertainties.csv"]
    label = "change of the result [%] by the number's tolerance"
    draw_tornado(bars, folder / "uncertainties.png", title=title, label=label)
    return ["uncertainties.csv", "uncertainties.png"]


def _write(path: Path, header: list[str], rows: Sequence[Sequence[object]]) -> None:
    write_table(path, header, ([f"{x:.{DIGITS}g}" if isinstance(x, float) else x for x in row] for row in rows))


def write_design(found: Optimum, folder: Path, given: str, overrides: Sequence[str], name: str = "design") -> list[str]:
    """Write a design as a scene and its figures as JSON into a folder, and return the files' names.

    They have one ``name``; overrides are values ``key=value`` that were used instead of the scene's own.

    Raises
    ------
    OSError
        The folder can't be written.
    """
    aim, *others = found.summary()["results"]
    comments = [f"The design of {given} with the {'least' if found.sign > 0 else 'largest'} {_value(aim)}"]
    comments += [f"{_value(row)} {row['must']} {row['limit']:.6g}" if row["must"] else _value(row) for row in others]
    write_changed_scene(found.space.run.scene, found.design.values, folder / f"{name}.toml", given, comments, overrides)
    write_text(folder / f"{name}.json", json.dumps(found.summary(), indent=1))
    return [f"{name}.toml", f"{name}.json"]


def write_front(found: Sequence[Optimum], folder: Path, given: str, overrides: Sequence[str], title: str) -> list[str]:
    """Write the designs of a front, a table and a chart of them into a folder, and return the files' names."""
    from fmd.render.plane_charts import draw_front

    files = [
        name
        for number, each in enumerate(found, start=1)
        for name in write_design(each, folder, given, overrides, f"design-{number}")
    ]
    first = found[0].design
    names = [f"{parameter.key} [{parameter.unit}]".removesuffix(" []") for parameter in first.values]
    names += [f"{channel.name} [{channel.unit}]".removesuffix(" []") for channel in first.channels]
    rows = [[*each.design.values.values(), *(float(x) for x in each.design.results)] for each in found]
    write_table(folder / "front.csv", names, number_texts(rows))
    aims = (len(first.values), len(names) - 1)
    x, y = ([row[k] for row in rows] for k in aims)
    draw_front(x, y, folder / "front.png", title=title, labels=(names[aims[0]], names[aims[1]]))
    return [*files, "front.csv", "front.png"]


def _value(row: dict[str, object]) -> str:
    value = row["value"]
    return f"{row['name']} = {'infinite' if value is None else f'{value:.6g}'} {row['unit']}".rstrip()


def write_fit(
    fit: Fit, scene: Scene, folder: Path, given: str, data: Sequence[str], overrides: Sequence[str] = ()
) -> list[str]:
    """Write a fit's files into a folder, which is made if it is missing, and return their names.

    Data are the files of the experiments, overrides values ``key=value`` that were used instead of the scene's own.

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
