"""What is written and drawn over a picture: title, colour bar, legend, and a mark at a point."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import pyvista as pv
from matplotlib import colormaps, get_data_path
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkCoordinate, vtkPolyDataMapper2D, vtkTextActor

from pipeline.core.arrays import Array
from pipeline.render.canvas import INK, Canvas
from pipeline.render.projection import Place

FONT = f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf"  # the charts' font, at hand on every machine
VTK_FONT_FILE = 4
BAR = (0.3, 0.7, 0.075, 0.11)  # place in the picture
HEADING = 1 / 26  # height of letters over the picture's
WORDS = 1 / 36
MARGIN = 0.03
ABOVE_BAR = 0.13  # width of the place for what an upright bar shows, over the picture's


def add_text(
    canvas: Canvas, text: str, place: tuple[float, float], height: float, align: str = "left", colour: str = INK
) -> vtkTextActor:
    """Add text at ``place``; place and ``height`` of the letters are fractions of the picture's size."""
    label = vtkTextActor()
    label.SetInput(text)
    label.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
    label.SetPosition(*place)
    style = label.GetTextProperty()
    style.SetFontFamily(VTK_FONT_FILE)
    style.SetFontFile(FONT)
    style.SetFontSize(round(height * canvas.plotter.window_size[1]))
    style.SetColor(*pv.Color(colour).float_rgb)
    style.SetJustification(("left", "centre", "right").index(align))
    style.SetVerticalJustificationToCentered()
    canvas.plotter.renderer.AddViewProp(label)
    return label


@cache
def text_width(text: str, height: float, size: tuple[int, int]) -> float:
    """Return how wide a text is, as a fraction of the width of a picture of ``size``."""
    if not text.strip():
        return 0.0
    path = TextPath((0, 0), text, size=height * size[1], prop=FontProperties(fname=FONT))
    return float(path.get_extents().x1) / size[0]


def add_heading(canvas: Canvas, title: str, note: str = "") -> vtkTextActor:
    """Add the title at the upper left and a smaller note, which is returned, at the upper right.

    A title that would reach into the note is written smaller.
    """
    size = canvas.view.size
    taken = text_width(note, WORDS, size) + MARGIN if note.strip() else 0.0
    add_text(canvas, title, (MARGIN, 0.94), fitting(title, HEADING, 1 - 2 * MARGIN - taken, size))
    return add_text(canvas, note, (1 - MARGIN, 0.94), WORDS, "right")


def fitting(text: str, height: float, room: float, size: tuple[int, int]) -> float:
    """Return the height of letters that makes a text no wider than ``room``, ``height`` at most."""
    return height * min(1.0, room / max(text_width(text, height, size), 1e-9))


def add_colour_bar(
    canvas: Canvas, quantity: str, limits: tuple[float, float], colour_map: str, place: Place = BAR
) -> None:
    """Add a bar of the colours, lying or upright as its place is, with round numbers and the limits."""
    left, right, bottom, top = place
    start = np.array([left, bottom, 0.0])
    wide, high, _ = np.diag([right - left, top - bottom, 0.0])
    if top - bottom > right - left:
        along, across, offset, align = high, wide, np.array([right - left + 0.01, 0, 0]), "left"
        add_text(canvas, quantity, (left, top + 0.05), fitting(quantity, WORDS, ABOVE_BAR, canvas.view.size))
    else:
        along, across, offset, align = wide, high, np.array([0, -0.025, 0]), "centre"
        room = left - 0.015 - MARGIN
        height = fitting(quantity, WORDS, room, canvas.view.size)
        add_text(canvas, quantity, (left - 0.015, (bottom + top) / 2), height, "right")
    side = start + np.linspace(0, 1, 257)[:, None] * along
    k = np.arange(256)
    faces = np.column_stack([np.full(256, 4), k, k + 1, k + 258, k + 257])
    strip = pv.PolyData(np.concatenate([side, side + across]), faces=faces.ravel())
    strip.cell_data["colours"] = colormaps[colour_map](np.linspace(0, 1, 256), bytes=True)[:, :3]
    strip.set_active_scalars("colours")
    _add_flat(canvas, strip)
    span = limits[1] - limits[0]
    for tick in (limits[0], *MaxNLocator(5).tick_values(*limits), limits[1]):
        share = (tick - limits[0]) / span
        if tick in limits or 0.06 < share < 0.94:
            x, y, _ = start + share * along + offset
            add_text(canvas, number(tick, span), (x, y), 1 / 42, align)


def number(value: float, span: float) -> str:
    """Write a number in three digits with a true minus sign; what is nothing beside ``span`` is 0."""
    return "0" if abs(value) < 1e-9 * span else f"{value:.3g}".replace("-", "−")


def legend_rows(names: Sequence[str], size: tuple[int, int]) -> list[list[tuple[int, float]]]:
    """Distribute names over centred rows of a picture of ``size``: in each the numbers and left ends of its names."""
    rows: list[list[tuple[int, float]]] = [[]]
    right = 0.0
    for k, name in enumerate(names):
        wide = text_width(name, WORDS, size) + _key(size) * 3
        if rows[-1] and right + wide > 1 - 2 * MARGIN:
            rows.append([])
            right = 0.0
        rows[-1].append((k, right))
        right += wide
    return [_centred(row, names, size) for row in rows]


def _centred(row: list[tuple[int, float]], names: Sequence[str], size: tuple[int, int]) -> list[tuple[int, float]]:
    """Move a row of names to the middle."""
    last, left = row[-1]
    start = (1 - left - 1.5 * _key(size) - text_width(names[last], WORDS, size)) / 2
    return [(k, start + x) for k, x in row]


def _key(size: tuple[int, int]) -> float:
    """Width of a legend's square, as a fraction of the picture's width."""
    return WORDS * size[1] / size[0]


def add_legend(canvas: Canvas, names: Sequence[str], colours: Sequence[str], bottom: float, step: float) -> None:
    """Add a square of its colour and each name in rows ``step`` high, the lowest at ``bottom``."""
    wide = _key(canvas.view.size)
    rows = legend_rows(names, canvas.view.size)
    for line, row in enumerate(reversed(rows)):
        y = bottom + line * step
        for k, x in row:
            add_patch(canvas, (x, x + wide, y - WORDS / 2, y + WORDS / 2), colours[k])
            add_text(canvas, names[k], (x + 1.5 * wide, y), WORDS)


def add_patch(canvas: Canvas, place: Place, colour: str = "white") -> None:
    """Cover a place of the picture with a colour."""
    left, right, bottom, top = place
    corners = np.array([(left, bottom, 0.0), (right, bottom, 0.0), (right, top, 0.0), (left, top, 0.0)])
    _add_flat(canvas, pv.PolyData(corners, faces=[4, 0, 1, 2, 3]), colour)


def add_stroke(canvas: Canvas, pixels: Array) -> None:
    """Add a line through ``pixels`` (n, 2), over everything, with a white seam that sets it off from dark colours."""
    flat = pixels / canvas.view.size * (1, -1) + (0, 1)
    line = pv.lines_from_points(np.column_stack([flat, np.zeros(len(flat))]))
    _add_flat(canvas, line, "white", 3.2)
    _add_flat(canvas, line)


def _add_flat(canvas: Canvas, shape: pv.PolyData, colour: str = INK, width: float = 1.5) -> None:
    """Add a shape whose x and y are fractions of the picture's width and height, over everything.

    Its lines are ``width`` pixels wide.
    """
    fractions = vtkCoordinate()
    fractions.SetCoordinateSystemToNormalizedViewport()
    mapper = vtkPolyDataMapper2D()
    mapper.SetTransformCoordinate(fractions)
    mapper.SetInputData(shape)
    actor = vtkActor2D()
    actor.SetMapper(mapper)
    actor.GetProperty().SetColor(pv.Color(colour).float_rgb)
    actor.GetProperty().SetLineWidth(width * canvas.fineness)
    canvas.plotter.renderer.AddViewProp(actor)


def add_marker(canvas: Canvas, point: Array, text: str, place: Place) -> None:
    """Ring a point (3,) [m] and write beside it, where nothing has been drawn if there is such a spot in ``place``."""
    size = np.array(canvas.view.size)
    radius = max(size[1] / 100, 7.0)
    spot = canvas.view.pixels(point[None])[0]
    half = np.array([text_width(text, WORDS, canvas.view.size) * size[0] / 2, WORDS * size[1] * 0.6]) + radius
    middle = nearest_free(canvas.picture(), spot, half, place)
    end = np.clip(spot, middle - half + radius / 2, middle + half - radius / 2)
    away = (end - spot) / max(float(np.linalg.norm(end - spot)), 1e-9)
    angle = np.linspace(0.0, 2 * np.pi, 49)
    if np.linalg.norm(end - spot) > radius:
        add_stroke(canvas, np.stack([spot + radius * away, end]))
    add_stroke(canvas, spot + radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    style = add_text(canvas, text, (middle[0] / size[0], 1 - middle[1] / size[1]), WORDS, "centre").GetTextProperty()
    style.SetBackgroundColor(1.0, 1.0, 1.0)  # legible over the part too
    style.SetBackgroundOpacity(0.75)


def nearest_free(picture: NDArray[np.uint8], spot: Array, half: Array, place: Place) -> Array:
    """Find room for a label in a picture: the middle, column and row, of the nearest box that is white.

    Parameters
    ----------
    picture : ndarray, shape (height, width, 3)
        What has been drawn.
    spot : ndarray, shape (2,)
        Column and row [pixels] to be near to.
    half : ndarray, shape (2,)
        Half the width and half the height of the box [pixels].
    place : tuple of float
        Where the box may be; if there is no room, it is above ``spot`` as far as the place allows.
    """
    height, width = picture.shape[:2]
    sums = np.zeros((height + 1, width + 1), dtype=np.int64)
    sums[1:, 1:] = (picture.min(axis=2) < 250).cumsum(axis=0).cumsum(axis=1)
    left, right, bottom, top = place * np.array([width, width, height, height])
    across, down = np.ceil(half).astype(int)
    columns = np.arange(int(left) + across, int(right) - across, 3)
    rows = np.arange(int(height - top) + down, int(height - bottom) - down, 3)

    def corner(row: int, column: int) -> Array:
        return np.asarray(sums[np.ix_(rows + row, columns + column)])

    drawn = corner(down, across) - corner(-down, across) - corner(down, -across) + corner(-down, -across)
    distance = np.hypot(*np.meshgrid(columns - spot[0], rows - spot[1]))
    distance[drawn > 0] = np.inf
    if not np.isfinite(distance).any():
        low, high = np.array([left, height - top]) + half, np.array([right, height - bottom]) - half
        return np.asarray(np.clip(spot - (0, 4 * half[1]), low, high))
    row, column = np.unravel_index(np.argmin(distance), distance.shape)
    return np.array([columns[column], rows[row]], dtype=np.float64)
