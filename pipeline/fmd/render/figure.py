"""Matplotlib figures without a window, saved whole or not at all, and the style that all charts share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from fmd.core.files import whole_file


@contextmanager
def open_figure(path: Path, size: tuple[float, float], dots_per_inch: int, padding: float = 0.04) -> Iterator[Figure]:
    """Open an empty figure and, unless an error occurs, save it in the format of the path's suffix.

    Parameters
    ----------
    size : tuple of float
        Width and height [inches].
    dots_per_inch : int
        Resolution of a PNG.
    padding : float
        Space around the contents [inches].
    """
    figure = Figure(figsize=size, dpi=dots_per_inch, layout=ConstrainedLayoutEngine(w_pad=padding, h_pad=padding))
    FigureCanvasAgg(figure)
    yield figure
    with whole_file(path) as part:
        figure.savefig(part)


def style_axes(axes: Axes, xlabel: str, ylabel: str, title: str = "") -> None:
    """Label the axes, add a grid, and leave out the frame's top and right."""
    axes.set_xlabel(xlabel, fontsize=12)
    axes.set_ylabel(ylabel, fontsize=12)
    axes.set_title(title, fontsize=14)
    axes.grid(True, which="major", color="0.88")
    axes.spines[["top", "right"]].set_visible(False)
