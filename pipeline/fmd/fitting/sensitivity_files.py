"""Sensitivities as files: a table, a chart, and the derivatives of histories over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fmd.core.arrays import Array
from fmd.core.files import write_table
from fmd.core.limits.shown import DIGITS
from fmd.fitting.sensitivities import Sensitivity
from fmd.fitting.uncertainty import Uncertainty


def write_sensitivities(found: Sequence[Sensitivity], times: Array | None, folder: Path, title: str) -> list[str]:
    """Write sensitivities into a folder and return the names of the files.

    Parameters
    ----------
    found : sequence of Sensitivity
        One at least.
    times : ndarray, optional
        Output times of the histories among them [s].
    title : str
        Heading of the chart.

    Raises
    ------
    OSError
        The folder can't be written.
    """
    rows = [each.row() for each in found]
    cells = [{**row, **_bounds(row.pop("interval"))} for row in rows]
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
        from fmd.render.tornado_chart import draw_tornado

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
    from fmd.render.tornado_chart import draw_tornado

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


def _bounds(interval: list[float] | None) -> dict[str, float | None]:
    low, high = interval or (None, None)
    return {"relative_low": low, "relative_high": high}


def _write(path: Path, header: list[str], rows: Sequence[Sequence[object]]) -> None:
    write_table(path, header, ([f"{x:.{DIGITS}g}" if isinstance(x, float) else x for x in row] for row in rows))
