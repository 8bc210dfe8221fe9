"""Charts of the front of two aims: designs of which none is better in both."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fmd.render.charts import COLOURS
from fmd.render.figure import open_figure, style_axes


def draw_front(x: Sequence[float], y: Sequence[float], path: Path, *, title: str, labels: tuple[str, str]) -> None:
    """Draw the designs of a front as numbered points on a line.

    Parameters
    ----------
    x, y : sequence of float
        Both aims of each design, in the order of the front.
    path : Path
        PNG of 1120 × 800 pixels, PDF or SVG.
    labels : tuple of str
        Names of the aims with their units in brackets.
    """
    with open_figure(path, (7, 5), 160) as figure:
        frame = figure.add_subplot()
        frame.plot(x, y, marker="o", markersize=5, linewidth=1.5, color=COLOURS[0])
        for number, place in enumerate(zip(x, y, strict=True), start=1):
            frame.annotate(str(number), place, xytext=(5, 5), textcoords="offset points", fontsize=10)
        frame.margins(0.08)
        style_axes(frame, *labels, title)
