"""Run time against error as a chart: error down, seconds to the right, one curve a method."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pipeline.core.arrays import Array
from pipeline.core.files import whole_file

_MARKERS = "osD^vP*X"
_SOLID = 10  # the methods of others come after ours, broken


def draw_work_precision(curves: Mapping[str, Array], path: Path, *, title: str, error_label: str) -> None:
    """Draw curves of (seconds, error), each of shape (n, 2), on logarithmic axes.

    Parameters
    ----------
    curves : mapping of str to ndarray
        By method.
    path : Path
        PNG, PDF or SVG.
    """
    figure = Figure(figsize=(10, 6), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for number, (label, points) in enumerate(curves.items()):
        marker, style = _MARKERS[number % len(_MARKERS)], "-" if number < _SOLID else "--"
        axes.loglog(points[:, 0], points[:, 1], marker=marker, linestyle=style, label=label, linewidth=1.5)
    axes.set_xlabel("run time [s]", fontsize=12)
    axes.set_ylabel(error_label, fontsize=12)
    axes.set_title(title, fontsize=14)
    axes.grid(True, which="major", color="0.88")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right center", fontsize=11, frameon=False)
    with whole_file(path) as part:
        figure.savefig(part)
