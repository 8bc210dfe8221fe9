"""Annotations over a picture: title, colour bar, legend, and a label at a point."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pyvista as pv
from matplotlib import get_data_path
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkCoordinate, vtkPolyDataMapper2D, vtkProp, vtkTextActor

from fmd.core.arrays import Array
from fmd.render.canvas import INK, Canvas
from fmd.render.colours import sample_colours
from fmd.render.projection import Place

FONT = f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf"  # the charts' font, which comes with Matplotlib
VTK_FONT_FILE = 4
BAR = (0.3, 0.7, 0.075, 0.11)  # place of the colour bar
TITLE_HEIGHT = 1 / 26  # of letters, over the picture's height
LABEL_HEIGHT = 1 / 36
TICK_HEIGHT = 1 / 42
MARGIN = 0.03
TRIAD = (0.085, 0.085)  # its middle from the picture's left and bottom, over its height
TRIAD_LENGTH = 0.045
TRIAD_COLOURS = ("#c0392b", "#2d8a4a", "#2c5fa8")
ABOVE_BAR = 0.13  # width of the label of an upright colour bar, over the picture's


def add_text(
    canvas: Canvas, text: str, place: tuple[float, float], height: float, align: str = "left", colour: str = INK
) -> vtkTextActor:
    """Add text at a place, with letters of a height, both as fractions of the picture's size."""
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
    """Return the width of a text as a fraction of that of a picture of ``size`` [pixels]."""
    if not text.strip():
        return 0.0
    path = TextPath((0, 0), text, size=height * size[1], prop=FontProperties(fname=FONT))
    return float(path.get_extents().x1) / size[0]


def add_heading(canvas: Canvas, title: str, note: str = "") -> vtkTextActor:
    """Add a title at the upper left and a smaller note at the upper right, and return the note's actor.

    A title that would reach into the note gets smaller letters.
    """
    size = canvas.size
    taken = text_width(note, LABEL_HEIGHT, size) + MARGIN if note.strip() else 0.0
    add_text(canvas, title, (MARGIN, 0.94), fit_height(title, TITLE_HEIGHT, 1 - 2 * MARGIN - taken, size))
    return add_text(canvas, note, (1 - MARGIN, 0.94), LABEL_HEIGHT, "right")


def fit_height(text: str, height: float, room: float, size: tuple[int, int]) -> float:
    """Return the height of letters, at most ``height``, at which a text is no wider than ``room``."""
    return height * min(1.0, room / max(text_width(text, height, size), 1e-9))


def add_colour_bar(
    canvas: Canvas,
    quantity: str,
    limits: tuple[float, float],
    colour_map: str,
    place: Place = BAR,
    *,
    beyond: tuple[bool, bool] = (False, False),
) -> list[vtkProp]:
    """Add a colour bar, horizontal or upright as its place is, with its quantity, round numbers and limits.

    ``beyond`` says which of the limits, the lower and the upper one, are marked as ones that some values exceed.
    What is returned are the bar's parts.
    """
    left, right, bottom, top = place
    start = np.array([left, bottom, 0.0])
    wide, high, _ = np.diag([right - left, top - bottom, 0.0])
    if top - bottom > right - left:
        along, across, offset, align, near = high, wide, np.array([right - left + 0.01, 0, 0]), "left", 0.06
        height = fit_height(quantity, LABEL_HEIGHT, ABOVE_BAR, canvas.size)
        name = add_text(canvas, quantity, (left, top + 0.05), height)
    else:
        along, across, offset, align, near = wide, high, np.array([0, -0.025, 0]), "centre", 0.1
        room = left - 0.015 - MARGIN
        height = fit_height(quantity, LABEL_HEIGHT, room, canvas.size)
        name = add_text(canvas, quantity, (left - 0.015, (bottom + top) / 2), height, "right")
    side = start + np.linspace(0, 1, 257)[:, None] * along
    k = np.arange(256)
    faces = np.column_stack([np.full(256, 4), k, k + 1, k + 258, k + 257])
    strip = pv.PolyData(np.concatenate([side, side + across]), faces=faces.ravel())
    strip.cell_data["colours"] = sample_colours(colour_map, 256)
    strip.set_active_scalars("colours")
    parts: list[vtkProp] = [name, _add_flat(canvas, strip)]
    span = limits[1] - limits[0]
    for tick in (limits[0], *MaxNLocator(5).tick_values(*limits), limits[1]):
        share = (tick - limits[0]) / span
        if tick in limits or near < share < 1 - near:  # numbers side by side need more room
            x, y, _ = start + share * along + offset
            sign = next((s for s, end, b in zip("≤≥", limits, beyond, strict=True) if b and tick == end), "")
            parts.append(add_text(canvas, f"{sign} {format_number(tick, span)}".strip(), (x, y), TICK_HEIGHT, align))
    return parts


def format_number(value: float, span: float) -> str:
    """Write a number in three digits with a true minus sign; round-off of a range ``span`` is 0."""
    return "0" if abs(value) < 1e-9 * span else f"{value:.3g}".replace("-", "−")


def arrange_legend(names: Sequence[str], size: tuple[int, int]) -> list[list[tuple[int, float]]]:
    """Distribute names over centred rows; return the numbers and left ends of the names in each."""
    rows: list[list[tuple[int, float]]] = [[]]
    right = 0.0
    for k, name in enumerate(names):
        width = text_width(name, LABEL_HEIGHT, size) + _key_width(size) * 3
        if rows[-1] and right + width > 1 - 2 * MARGIN:
            rows.append([])
            right = 0.0
        rows[-1].append((k, right))
        right += width
    return [_centre_row(row, names, size) for row in rows]


def _centre_row(row: list[tuple[int, float]], names: Sequence[str], size: tuple[int, int]) -> list[tuple[int, float]]:
    """Move a row of names to the middle of the picture."""
    last, left = row[-1]
    start = (1 - left - 1.5 * _key_width(size) - text_width(names[last], LABEL_HEIGHT, size)) / 2
    return [(k, start + x) for k, x in row]


def _key_width(size: tuple[int, int]) -> float:
    """Width of a legend's square, as a fraction of the picture's width."""
    return LABEL_HEIGHT * size[1] / size[0]


def add_legend(canvas: Canvas, names: Sequence[str], colours: Sequence[str], bottom: float, step: float) -> None:
    """Add a legend of coloured squares and names in rows ``step`` high, the lowest at ``bottom``."""
    width = _key_width(canvas.size)
    rows = arrange_legend(names, canvas.size)
    for line, row in enumerate(reversed(rows)):
        y = bottom + line * step
        for k, x in row:
            add_patch(canvas, (x, x + width, y - LABEL_HEIGHT / 2, y + LABEL_HEIGHT / 2), colours[k])
            add_text(canvas, names[k], (x + 1.5 * width, y), LABEL_HEIGHT)


def add_patch(canvas: Canvas, place: Place, colour: str = "white") -> None:
    """Cover a place of the picture with a colour."""
    left, right, bottom, top = place
    corners = np.array([(left, bottom, 0.0), (right, bottom, 0.0), (right, top, 0.0), (left, top, 0.0)])
    _add_flat(canvas, pv.PolyData(corners, faces=[4, 0, 1, 2, 3]), colour)


def add_stroke(canvas: Canvas, pixels: Array) -> None:
    """Add a line through ``pixels`` (n, 2) over everything, with a white rim that sets it off from dark colours."""
    flat = pixels / canvas.size * (1, -1) + (0, 1)
    line = pv.lines_from_points(np.column_stack([flat, np.zeros(len(flat))]))
    _add_flat(canvas, line, "white", 3.2)
    _add_flat(canvas, line)


def _add_flat(canvas: Canvas, shape: pv.PolyData, colour: str = INK, width: float = 1.5) -> vtkActor2D:
    """Add a shape over everything, its x and y as fractions of the picture's width and height.

    Lines are ``width`` pixels wide.
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
    return actor


def add_triad(canvas: Canvas) -> None:
    """Add the directions of x, y and z in space at the lower left."""
    width, height = canvas.size
    centre = np.array([TRIAD[0] * height, (1 - TRIAD[1]) * height])
    flat = canvas.projection.axes[:2].T * (1, -1)  # to the right and down, one row an axis
    for k in np.argsort(canvas.projection.axes[2]):  # the axis towards the viewer last, over the others
        end = centre + TRIAD_LENGTH * height * flat[k]
        points = np.stack([centre, end]) / canvas.size * (1, -1) + (0, 1)
        _add_flat(canvas, pv.lines_from_points(np.column_stack([points, np.zeros(2)])), TRIAD_COLOURS[k], 2.5)
        if np.linalg.norm(flat[k]) > 0.2:
            x, y = centre + (TRIAD_LENGTH * height + 0.6 * TICK_HEIGHT * height / np.linalg.norm(flat[k])) * flat[k]
            add_text(canvas, "xyz"[k], (x / width, 1 - y / height), TICK_HEIGHT, "centre", TRIAD_COLOURS[k])


def cover_margins(canvas: Canvas, place: Place) -> None:
    """Cover a close-up outside of its place, where title, colour bar and legend stand."""
    left, _, bottom, top = place
    add_patch(canvas, (0.0, 1.0, 0.0, bottom))
    add_patch(canvas, (0.0, 1.0, top, 1.0))
    if left > 0.1:  # else it is a narrow margin without annotations
        add_patch(canvas, (0.0, left, 0.0, 1.0))


def add_label(canvas: Canvas, point: Array, text: str, place: Place) -> None:
    """Ring a point (3,) [m] and label it nearby, on free ground of ``place`` if there is any."""
    size = np.array(canvas.size)
    radius = max(size[1] / 100, 7.0)
    spot = canvas.projection.pixels(point[None])[0]
    half_width = text_width(text, LABEL_HEIGHT, canvas.size) * size[0] / 2
    half = np.array([half_width, LABEL_HEIGHT * size[1] * 0.6]) + radius
    middle = find_free_place(canvas.picture(), spot, half, place)
    end = np.clip(spot, middle - half + radius / 2, middle + half - radius / 2)
    away = (end - spot) / max(float(np.linalg.norm(end - spot)), 1e-9)
    angle = np.linspace(0.0, 2 * np.pi, 49)
    if np.linalg.norm(end - spot) > radius:
        add_stroke(canvas, np.stack([spot + radius * away, end]))
    add_stroke(canvas, spot + radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    label = add_text(canvas, text, (middle[0] / size[0], 1 - middle[1] / size[1]), LABEL_HEIGHT, "centre")
    label.GetTextProperty().SetBackgroundColor(1.0, 1.0, 1.0)  # legible over the part too
    label.GetTextProperty().SetBackgroundOpacity(0.75)


def find_free_place(picture: NDArray[np.uint8], spot: Array, half: Array, place: Place) -> Array:
    """Find the white box of a picture nearest to a spot, and return the column and row of its middle.

    All is in pixels: the picture (height, width, 3) so far, the spot by column and row, half the width and the height
    of the box. If nothing is free within the bounds ``place``, it is above the spot as far as they allow.
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
