"""Work–precision charts: error over run time, one curve a method."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from fmd.core.arrays import Array
from fmd.render.figure import open_figure, style_axes

_MARKERS = "osD^vP*X"
_SOLID = 9  # methods of other programs follow ours, with dashed lines


def draw_work_precision(curves: Mapping[str, Array], path: Path, *, title: str, error_label: str) -> None:
    """Draw a curve of run time and error for each method on logarithmic axes.

    Parameters
    ----------
    curves : mapping of str to ndarray, shape (n, 2)
        Seconds and errors of each method.
    error_label : str
        The error with its unit in brackets.
    """
    with open_figure(path, (10, 6), 120) as figure:
        axes = figure.add_subplot()
        for number, (label, points) in enumerate(curves.items()):
            marker, style = _MARKERS[number % len(_MARKERS)], "-" if number < _SOLID else "--"
            axes.loglog(points[:, 0], points[:, 1], marker=marker, linestyle=style, label=label, linewidth=1.5)
        style_axes(axes, "run time of integration alone [s]", error_label, title)
        figure.legend(loc="outside right center", fontsize=11, frameon=False)
