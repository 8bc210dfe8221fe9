"""Charts of parameter studies: lines over one varied value, maps over two."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.shown import SAME_VALUE
from fmd.render.charts import COLOURS, open_figure, style_axes

_PANEL_INCHES = (6.4, 4.4)
_WIDE = 30.0  # largest value over the smallest, from which on an axis is logarithmic


@dataclass(frozen=True, slots=True)
class SweepAxis:
    """A varied key with its values."""

    label: str  # the key, with the unit of its values in brackets
    texts: tuple[str, ...]  # the values as they were given, one a point; of a map each once
    numbers: tuple[float, ...] | None = None  # the values as numbers, if they all are
    logarithmic: bool = False  # true if they were asked for with equal ratios


@dataclass(frozen=True, slots=True)
class SweepPanel:
    """One figure of merit at all points."""

    label: str  # the figure with its unit in brackets
    # (n_lines, n_points) or (n_first, n_second): lines over the one key, or a map over the two; not a number where a
    # point has none
    values: Array
    names: tuple[str, ...] = ()  # names of the lines, if there are several
    errors: Array | None = None  # (n_lines, n_points): errors of the lines' values; not a number where none is stated


def draw_sweep_lines(keys: Sequence[SweepAxis], panels: Sequence[SweepPanel], path: Path, *, title: str) -> None:
    """Draw figures over varied keys, a frame for each figure and key; lines join the points of a single key."""
    with _open_panels(len(panels) * len(keys), path, title, max(len(keys), 2)) as (figure, frames):
        for (panel, axis), axes in zip(product(panels, keys), frames, strict=True):
            _draw_lines(axes, axis, panel, width=1.8 if len(keys) == 1 else 0.0)
        figure.align_ylabels()


def _draw_lines(axes: Axes, axis: SweepAxis, panel: SweepPanel, width: float) -> None:
    words = list(dict.fromkeys(axis.texts))
    x = np.array([words.index(text) for text in axis.texts] if axis.numbers is None else axis.numbers, dtype=float)
    order = np.argsort(x, kind="stable")
    for number, line in enumerate(panel.values):
        colour = COLOURS[number % len(COLOURS)]
        name = panel.names[number] if panel.names else ""
        axes.plot(x[order], line[order], marker="o", markersize=4.5, linewidth=width, color=colour, label=name)
        if panel.errors is not None and (stated := order[np.isfinite(panel.errors[number][order])]).size:
            ends = np.clip(panel.errors[number][stated], 0.0, None)
            axes.errorbar(x[stated], line[stated], yerr=ends, fmt="none", ecolor=colour, capsize=3.0)
    _set_ticks(axes, axis, x)
    style_axes(axes, axis.label, panel.label)
    low, high = axes.get_ylim()
    if high - low < SAME_VALUE * max(abs(low), abs(high)):  # a line, not its round-off
        axes.set_ylim(low - 0.01 * abs(low), high + 0.01 * abs(high))
    if len(panel.names) > 1:
        axes.legend(fontsize=10, framealpha=0.85, edgecolor="none")


def draw_sweep_maps(
    first: SweepAxis, second: SweepAxis, panels: Sequence[SweepPanel], path: Path, *, title: str
) -> None:
    """Draw figures over two varied keys as maps, the first key to the right, the second upwards."""
    with _open_panels(len(panels), path, title) as (figure, frames):
        for panel, axes in zip(panels, frames, strict=True):
            values = np.ma.masked_invalid(panel.values.T)
            image = axes.imshow(values, origin="lower", aspect="auto", cmap="viridis")
            figure.colorbar(image, ax=axes, label=panel.label)
            style_axes(axes, first.label, second.label)
            axes.grid(visible=False)
            for axis, place in ((first, axes.xaxis), (second, axes.yaxis)):
                steps = range(0, len(axis.texts), -(-len(axis.texts) // 12))  # values that all stand at their axis
                place.set_ticks([*steps], [axis.texts[k] for k in steps])
            if values.size <= 120:  # cells of a map that hold their numbers
                _write_numbers(axes, values)


def _write_numbers(axes: Axes, values: np.ma.MaskedArray) -> None:
    """Write each cell's number into it, dark on light and light on dark; a cross where there is none."""
    low, span = (float(values.min()), float(np.ptp(values))) if values.count() else (0.0, 0.0)
    for row, column in np.ndindex(values.shape):
        value = values[row, column]
        if value is np.ma.masked:
            axes.text(column, row, "×", ha="center", va="center", color="0.4")
        else:
            light = span == 0 or (float(value) - low) / span < 0.6
            colour = "white" if light else "black"
            axes.text(column, row, f"{float(value):.3g}", ha="center", va="center", color=colour, fontsize=9)


@contextmanager
def _open_panels(count: int, path: Path, title: str, in_a_row: int = 2) -> Iterator[tuple[Figure, list[Axes]]]:
    """Open a figure with frames side by side, two in a row by default, that is saved at the end."""
    columns = min(count, in_a_row)
    rows = math.ceil(count / columns)
    size = (columns * _PANEL_INCHES[0], rows * _PANEL_INCHES[1] + 0.4)
    with open_figure(path, size, 120, padding=0.1) as figure:
        figure.suptitle(title, fontsize=14)
        yield figure, [figure.add_subplot(rows, columns, number + 1) for number in range(count)]


def _set_ticks(axes: Axes, axis: SweepAxis, x: Array) -> None:
    """Set the ticks of the axis along which the points lie: at the values where there are few."""
    if axis.numbers is None:
        words = list(dict.fromkeys(axis.texts))
        axes.set_xticks(range(len(words)), words, rotation=20 if max(map(len, words)) > 12 else 0)
    elif x.min() > 0 and (axis.logarithmic or x.max() > _WIDE * x.min()):
        axes.set_xscale("log")
