"""A sheet of mode shapes side by side in one picture."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array, require_shape
from fmd.render.annotations import add_colour_bar, add_heading, add_text
from fmd.render.camera import SHEET_PIXELS, Camera
from fmd.render.canvas import add_part_by_values, add_undeformed, open_canvas
from fmd.render.pictures import scale_mode
from fmd.render.projection import Place, Projection
from fmd.render.surface import Surface, build_skin

SHEET = (0.02, 0.98, 0.12, 0.91)  # place of the shapes and their labels
BAR = (0.35, 0.75, 0.055, 0.08)
LABEL_HEIGHT = 1 / 38  # of letters, over the picture's height
LABEL_ROW = 0.05  # height of the strip with a cell's label
FILL = (0.92, 0.94)  # of a cell's width, and of its height above the label, that a shape may fill


def draw_mode_sheet(
    surface: Surface,
    shapes: Array,
    labels: Sequence[str],
    path: Path,
    *,
    title: str,
    scale: float = 1.0,
    camera: Camera | None = None,
) -> Projection:
    """Draw mode shapes side by side in one scale, each over the undeformed part; return the middle cell's projection.

    Shapes (n_points, 3, n_modes) are in any scale; each gets an amplitude of 8 % of the part's largest extent times
    ``scale``. Labels, e.g. ``mode 1, 131.0 Hz``, stand below.

    Raises
    ------
    ValueError
        Shapes, labels and points disagree, a shape is zero everywhere, or the camera takes a close-up.
    """
    camera = camera or Camera(size=SHEET_PIXELS)
    require_shape("shapes", shapes, (len(surface.points), 3, len(labels)))
    _require_sheet(labels, camera)
    modes = [scale_mode(surface, shapes[:, :, k], scale) for k in range(len(labels))]
    every = np.concatenate([surface.points, *(points for points, _ in modes)])
    axes = camera.candidate_axes(every)[0]
    cells = _choose_cells(len(labels), np.ptp(every @ axes.T, axis=0)[:2], camera.size)
    projection = camera.projection(axes, every, _middle_place(cells[0]))
    skin = build_skin(surface)
    with open_canvas(projection, fineness=2) as canvas:
        for (points, magnitude), label, (left, right, bottom, top) in zip(modes, labels, cells, strict=True):
            # The shapes stand side by side in space before one camera.
            right_by, up_by = (np.array([left + right, bottom + LABEL_ROW + top]) - 1) / 2 * camera.size
            undeformed = replace(surface, points=projection.shift(surface.points, right_by, up_by, 0))
            deformed = replace(surface, points=projection.shift(points, right_by, up_by, 0))
            add_undeformed(canvas, undeformed, skin)
            add_part_by_values(canvas, deformed, skin, magnitude, (0.0, 1.0), camera.colour_map)
            add_text(canvas, label, ((left + right) / 2, bottom + LABEL_ROW / 2), LABEL_HEIGHT, "centre")
        add_colour_bar(canvas, "relative displacement", (0.0, 1.0), camera.colour_map, BAR)
        add_heading(canvas, title)
        canvas.save(path)
    return projection


def _require_sheet(labels: Sequence[str], camera: Camera) -> None:
    """Raise ``ValueError`` unless there are modes and the camera shows whole parts."""
    if not labels:
        raise ValueError("a sheet of modes needs at least one")
    if camera.zoom != 1 or camera.is_close_up:
        raise ValueError("a sheet of modes shows whole parts: zoom, focus and extent are for single pictures")


def _choose_cells(n: int, extents: Array, size: tuple[int, int]) -> list[Place]:
    """Choose the grid of ``n`` cells in which shapes of the given extents (2,) [m] are largest."""
    grids = [_grid(n, n_columns) for n_columns in range(1, n + 1)]
    return min(grids, key=lambda cells: float(np.max(extents / _room(cells[0], size))))


def _grid(n: int, n_columns: int) -> list[Place]:
    """Divide the sheet into ``n`` equal cells in rows from the top, the last row centred."""
    left, right, bottom, top = SHEET
    n_rows = -(-n // n_columns)
    width, height = (right - left) / n_columns, (top - bottom) / n_rows
    places = []
    for k in range(n):
        row, column = divmod(k, n_columns)
        missing = max(0, (row + 1) * n_columns - n)
        x, y = left + (column + missing / 2) * width, top - (row + 1) * height
        places.append((x, x + width, y, y + height))
    return places


def _room(cell: Place, size: tuple[int, int]) -> Array:
    """Return the width and height [pixels] that a shape may fill in a cell."""
    left, right, bottom, top = cell
    return np.array([(right - left) * FILL[0], (top - bottom - LABEL_ROW) * FILL[1]]) * size


def _middle_place(cell: Place) -> Place:
    """Return a place in the middle of the picture with the room of a shape in a cell."""
    half_width, half_height = _room(cell, (1, 1)) / 2
    return 0.5 - half_width, 0.5 + half_width, 0.5 - half_height, 0.5 + half_height
