"""Charts of one quantity over another: paths in a plane, fronts of two aims, run time against error."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.render.charts import COLOURS, DASHES, fit_length, open_figure, style_axes

_MARKERS = "osD^vP*X"
_SOLID = 9  # methods of other programs follow ours, with dashed lines


def draw_work_precision(curves: Mapping[str, Array], path: Path, *, title: str, error_label: str) -> None:
    """Draw a curve of run time [s] and error (n, 2) for each method on logarithmic axes.

    The error's label has its unit in brackets.
    """
    with open_figure(path, (10, 6), 120) as figure:
        axes = figure.add_subplot()
        for number, (label, points) in enumerate(curves.items()):
            marker, style = _MARKERS[number % len(_MARKERS)], "-" if number < _SOLID else "--"
            axes.loglog(points[:, 0], points[:, 1], marker=marker, linestyle=style, label=label, linewidth=1.5)
        style_axes(axes, "run time of integration alone [s]", error_label, title)
        figure.legend(loc="outside right center", fontsize=11, frameon=False)


def draw_front(x: Sequence[float], y: Sequence[float], path: Path, *, title: str, labels: tuple[str, str]) -> None:
    """Draw the designs of a front as numbered points on a line, by both aims of each, in the order of the front.

    A PNG has 1120 × 800 pixels; labels are the aims' names with their units in brackets.
    """
    with open_figure(path, (7, 5), 160) as figure:
        frame = figure.add_subplot()
        frame.plot(x, y, marker="o", markersize=5, linewidth=1.5, color=COLOURS[0])
        for number, place in enumerate(zip(x, y, strict=True), start=1):
            frame.annotate(str(number), place, xytext=(5, 5), textcoords="offset points", fontsize=10)
        frame.margins(0.08)
        style_axes(frame, *labels, title)


def draw_orbits(paths: Mapping[str, Array], path: Path, *, title: str, axes: str) -> None:
    """Draw paths (n_times, 2) [m] in a plane, by their labels, a dot where each begins.

    A PNG has 1120 × 1120 pixels; axes have names such as ``"yz"``.
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
