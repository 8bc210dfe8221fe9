"""Plot of a sweep: lines over one varied key, maps over two, points over each of more."""

from __future__ import annotations

import re
import threading
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.html import prefix_for
from fmd.core.limits.shown import ASKED_PANELS, SWEPT_KEYS, SWEPT_MODES, SWEPT_PANELS
from fmd.sweep.points import Variation
from fmd.sweep.table import SweepTable

if TYPE_CHECKING:
    from fmd.render.sweep_chart import SweepAxis, SweepPanel

FILE = "sweep.png"
# Figures that are drawn where points differ in them, with their label and SI unit.
_FIGURES = {
    "worst_stress.von_mises_pa": ("largest von Mises stress", "Pa"),
    "peak_tip_deflection_m": ("largest deflection of the tip", "m"),
    "largest_stable_step_s": ("largest stable step", "s"),
    "run.0.seconds": ("time of integration", "s"),
}
JOINT_FIGURE = "run.0.final.joint_positions."
_NUMBER = re.compile(r"\s*[\"']?\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\"']*?)\s*[\"']?\s*")


def prepare_charts() -> None:
    """Begin to load what charts are drawn with, while workers compute and this process waits for them."""
    threading.Thread(target=import_module, args=("fmd.render.sweep_chart",), daemon=True).start()


def draw_sweep(table: SweepTable, folder: Path, title: str) -> list[str]:
    """Draw a sweep's results, or else its main figures: lines over one key, a map over two, points over each of more.

    Points of a design are drawn over each of its keys, too. Returns the file's name; none if no point has a figure.

    Raises
    ------
    OSError
        The folder can't be written.
    """
    sweep, rows = table.sweep, table.rows
    varied = [k for k, variation in enumerate(sweep.variations) if len(variation.values) > 1]
    is_map = sweep.is_grid and len(sweep.variations) == 2
    shape = tuple(len(v.values) for v in sweep.variations) if is_map else (len(sweep.points),)
    asked = [figure for name, own in table.results.items() for figure in _results(name, *own, apart=is_map)]
    figures = asked or _figures(rows)[:SWEPT_PANELS]
    if not figures or not varied:
        return []
    from fmd.render.sweep_chart import draw_sweep_lines, draw_sweep_maps

    kept = range(2) if is_map else varied[:SWEPT_KEYS]
    texts = [v.values if is_map else tuple(p.values[k] for p in sweep.points) for k, v in enumerate(sweep.variations)]
    axes = [_axis(sweep.variations[k], texts[k]) for k in kept]
    room = ASKED_PANELS // (1 if is_map else len(axes))
    panels = [_panel(rows, figure, shape) for figure in figures[:room]]
    counts = ((len(panels), len(figures), "results"), (len(axes), len(varied), "keys"))
    if cut := ", ".join(f"{shown} of {all_of} {what}" for shown, all_of, what in counts if shown < all_of):
        title += f"\n{cut}; sweep.csv has all"
    if is_map:
        draw_sweep_maps(axes[0], axes[1], panels, folder / FILE, title=title)
    else:
        draw_sweep_lines(axes, panels, folder / FILE, title=title)
    return [FILE]


class _Figure(NamedTuple):
    """A figure of merit: label, unit, and the columns of its lines by their names."""

    label: str
    unit: str
    lines: dict[str, str]


def _results(name: str, unit: str, columns: list[str], apart: bool) -> list[_Figure]:
    """Return the figures of a result: all lines in one, or a line each for maps."""
    if apart:
        return [_Figure(column, unit, {"": column}) for column in columns]
    return [_Figure(name, unit, {column.removeprefix(name).removeprefix("."): column for column in columns})]


def _figures(rows: Sequence[dict[str, Any]]) -> list[_Figure]:
    """List the figures that some point has."""

    def has(column: str) -> bool:
        return bool(np.isfinite(_column(rows, column)).any())

    modes = {f"mode {k + 1}": f"frequencies_hz.{k}" for k in range(SWEPT_MODES)}
    found = [_Figure("frequency", "Hz", {name: column for name, column in modes.items() if has(column)})]
    named = dict(_FIGURES)
    for name in rows[0]:
        if name.startswith(JOINT_FIGURE):
            joint = name.removeprefix(JOINT_FIGURE)
            unit = next((str(row[key]) for row in rows if row.get(key := f"joint_units.{joint}")), "")
            named[name] = (f"{joint} at the end", unit)
    found += [_Figure(label, unit, {"": name}) for name, (label, unit) in named.items()]
    return [figure for figure in found if any(map(has, figure.lines.values()))]


def _column(rows: Sequence[dict[str, Any]], name: str) -> Array:
    values = [row.get(name) for row in rows]
    return np.array([value if isinstance(value, int | float) else np.nan for value in values], dtype=np.float64)


def _panel(rows: Sequence[dict[str, Any]], figure: _Figure, shape: tuple[int, ...]) -> SweepPanel:
    """Make a panel with values in a prefixed unit, of lines with their errors; a map shows the first line alone."""
    from fmd.render.sweep_chart import SweepPanel

    label, unit, lines = figure
    is_map = len(shape) == 2
    if is_map and len(lines) > 1:
        first = next(iter(lines))
        label, lines = f"{label} of {first}", {first: lines[first]}
    values = np.stack([_column(rows, column).reshape(shape) for column in lines.values()])
    errors = np.stack([_column(rows, f"{column}.error").reshape(shape) for column in lines.values()])
    factor, prefix = prefix_for(float(np.nanmax(np.abs(values), initial=0.0)), unit)
    named = f"{label} [{prefix}{unit}]" if unit else label
    if is_map:
        return SweepPanel(named, values[0] / factor)
    return SweepPanel(named, values / factor, tuple(name for name in lines if name), errors / factor)


def _axis(variation: Variation, values: tuple[str, ...]) -> SweepAxis:
    """Make the axis of a key with the values along it, in their unit if they have one in common."""
    from fmd.render.sweep_chart import SweepAxis

    key = variation.key
    found = [_NUMBER.fullmatch(value) for value in values]
    units = {match[2] for match in found if match is not None}
    if None in found or len(units) != 1:
        return SweepAxis(key, values)
    (unit,) = units
    texts = tuple(match[1] for match in found if match is not None)
    return SweepAxis(f"{key} [{unit}]" if unit else key, texts, tuple(map(float, texts)), variation.logarithmic)
