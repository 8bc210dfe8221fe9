"""Charts of paths in a plane, with equal scales on both axes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.render.charts import COLOURS, DASHES, fit_length
from fmd.render.figure import open_figure, style_axes


def draw_orbits(paths: Mapping[str, Array], path: Path, *, title: str, axes: str) -> None:
    """Draw paths in a plane, a dot where each begins.

    Parameters
    ----------
    paths : mapping of str to ndarray, shape (n_times, 2)
        Places by the label of each path [m].
    path : Path
        PNG of 1120 × 1120 pixels, PDF or SVG.
    axes : str
        Names of the two axes, e.g. ``"yz"``.
    """
    largest = max(float(np.abs(points).max()) for points in paths.values())
    (factor, xlabel), (_, ylabel) = (fit_length(f"{name} [m]", largest) for name in axes)
    with open_figure(path, (7, 7), 160) as figure:
        frame = figure.add_subplot()
        for number, (label, points) in enumerate(paths.items()):
            colour, dashes = COLOURS[number % len(COLOURS)], DASHES[(number - 1) % len(DASHES)] if number else "-"
            x, y = factor * points.T
            frame.plot(x, y, color=colour, linestyle=dashes, linewidth=1.5, label=label)
            frame.plot(x[:1], y[:1], color=colour, marker="o", markersize=6)
        frame.set_aspect("equal", adjustable="datalim")
        frame.margins(0.05)
        style_axes(frame, xlabel, ylabel, title)
        if len(paths) > 1:
            figure.legend(loc="outside lower center", ncols=2, fontsize=12, frameon=False)
