"""All mode shapes of a part in one picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.core.arrays import Array, require_shape
from pipeline.render.annotations import add_colour_bar, add_heading, add_text
from pipeline.render.camera import Look
from pipeline.render.canvas import add_body, add_ghost, stage
from pipeline.render.pictures import relative_shape
from pipeline.render.projection import Place, View
from pipeline.render.surface import Surface, skin_of

PIXELS = (1800, 1200)
SHEET = (0.02, 0.98, 0.12, 0.91)  # place of the shapes and their labels
BAR = (0.35, 0.75, 0.055, 0.08)
WORDS = 1 / 38
ROOM = (0.92, 0.94)  # of a cell's width, and of its height above the label, that a shape may fill
LABEL = 0.05  # height of a label's strip over the picture's


def draw_mode_sheet(
    surface: Surface,
    shapes: Array,
    labels: Sequence[str],
    path: Path,
    *,
    title: str,
    scale: float = 1.0,
    look: Look | None = None,
) -> View:
    """Draw mode shapes side by side, each as large as the others and over the undeformed part.

    Parameters
    ----------
    surface : Surface
        The part.
    shapes : ndarray, shape (n_points, 3, n_modes)
        The shapes in any scale; each is drawn with an amplitude of 8 % of the part's largest extent.
    labels : sequence of str
        What is written below each, e.g. ``mode 1, 131.0 Hz``.
    path : Path
        The picture to write.
    title : str
        Heading; may be empty.
    scale : float
        Factor on the amplitude.
    look : Look
        How the picture is taken; whole parts only.

    Returns
    -------
    View
        How the first cell was taken: where each point is in it, moved to the middle of the picture.

    Raises
    ------
    ValueError
        Shapes and labels don't fit together or to the points, a shape is zero everywhere, or ``look`` is a close-up.
    """
    look = look or Look(size=PIXELS)
    require_shape("shapes", shapes, (len(surface.points), 3, len(labels)))
    if not labels:
        raise ValueError("a sheet of modes needs at least one")
    if look.zoom != 1 or look.is_close_up:
        raise ValueError("a sheet of modes shows whole parts: zoom, focus and extent are for single pictures")
    modes = [relative_shape(surface, shapes[:, :, k], scale) for k in range(len(labels))]
    every = np.concatenate([surface.points, *(points for points, _ in modes)])
    axes = look.directions(every)[0]
    extents = np.ptp(every @ axes.T, axis=0)[:2]
    grids = [_cells(len(labels), n_columns) for n_columns in range(1, len(labels) + 1)]
    cells = min(grids, key=lambda grid: float(np.max(extents / _room(grid[0], look.size))))
    view = look.view(axes, every, _middle(cells[0]))
    skin = skin_of(surface)
    with stage(view, fineness=2) as canvas:
        for (points, relative), label, (left, right, bottom, top) in zip(modes, labels, cells, strict=True):
            # All shapes stand side by side in space before one camera.
            right_by, up_by = (np.array([left + right, bottom + LABEL + top]) - 1) / 2 * look.size
            here = replace(surface, points=view.moved(surface.points, right_by, up_by, 0))
            there = replace(surface, points=view.moved(points, right_by, up_by, 0))
            add_ghost(canvas, here, skin)
            add_body(canvas, there, skin, relative, (0.0, 1.0), look.colour_map)
            add_text(canvas, label, ((left + right) / 2, bottom + LABEL / 2), WORDS, "centre")
        add_colour_bar(canvas, "relative displacement", (0.0, 1.0), look.colour_map, BAR)
        add_heading(canvas, title)
        canvas.save(path)
    return view


def _cells(n: int, n_columns: int) -> list[Place]:
    """Divide the sheet into ``n`` equal places in rows from the top; the last row stands in the middle."""
    left, right, bottom, top = SHEET
    n_rows = -(-n // n_columns)
    wide, high = (right - left) / n_columns, (top - bottom) / n_rows
    places = []
    for k in range(n):
        row, column = divmod(k, n_columns)
        missing = max(0, (row + 1) * n_columns - n)
        x, y = left + (column + missing / 2) * wide, top - (row + 1) * high
        places.append((x, x + wide, y, y + high))
    return places


def _room(cell: Place, size: tuple[int, int]) -> Array:
    """Width and height [pixels] that a shape may fill in a cell."""
    left, right, bottom, top = cell
    return np.array([(right - left) * ROOM[0], (top - bottom - LABEL) * ROOM[1]]) * size


def _middle(cell: Place) -> Place:
    """Return a place in the middle of the picture, as large as a shape may become in a cell."""
    wide, high = _room(cell, (1, 1)) / 2
    return 0.5 - wide, 0.5 + wide, 0.5 - high, 0.5 + high
