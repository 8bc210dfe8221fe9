"""Still pictures of a part: its mode shapes and its stress."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Final

import imageio.v3 as iio
import numpy as np
import pyvista as pv
from matplotlib import colormaps, get_data_path
from matplotlib.ticker import MaxNLocator
from vtkmodules.vtkCommonCore import vtkLogger
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkCoordinate, vtkPolyDataMapper2D, vtkTextActor

from pipeline.checks import Array, IntArray, read_only, require_shape
from pipeline.render.charts import whole_file

PIXELS = (1600, 900)
COLOUR_MAP: Final = "turbo"
Place = tuple[float, float, float, float]
FONT = f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf"  # the charts' font, at hand on every machine
VTK_FONT_FILE = 4
INK = "#1a1a1a"
GHOST = "#707070"
MODE_AMPLITUDE = 0.08  # of the part's largest extent
# Places in the picture, as fractions of it: left, right, bottom, top.
PART = (0.04, 0.96, 0.24, 0.84)
BAR = (0.3, 0.7, 0.075, 0.11)
TILT = (24.0, 22.0)  # of the camera [degrees], about the upright axis and about the horizontal one
SLENDER = 0.4  # second extent over longest
SAME_EXTENT = 1.3  # extents that differ by less than this factor count as equal


@dataclass(frozen=True, slots=True)
class Surface:
    """The visible surface of a part.

    Attributes
    ----------
    points : ndarray, shape (n_points, 3)
        Undeformed positions [m].
    triangles : ndarray, shape (n_triangles, 3)
        Positions in ``points``.
    edges : ndarray, shape (n_edges, 2)
        Positions in ``points``: the lines to draw upon the surface, such as element outlines.
    """

    points: Array
    triangles: IntArray
    edges: IntArray

    def __post_init__(self) -> None:
        require_shape("points", self.points, (None, 3))
        require_shape("triangles", self.triangles, (None, 3))
        require_shape("edges", self.edges, (None, 2))
        for name, corners in (("triangles", self.triangles), ("edges", self.edges)):
            if corners.size and not 0 <= corners.min() <= corners.max() < len(self.points):
                raise ValueError(f"{name} name points beyond the {len(self.points)} that there are")
        for array in (self.points, self.triangles, self.edges):
            read_only(array)


@dataclass(frozen=True, slots=True)
class View:
    """A parallel projection onto a picture.

    Attributes
    ----------
    axes : ndarray, shape (3, 3)
        Unit vectors as rows: to the right, up, and towards the viewer.
    centre : ndarray, shape (3,)
        The point in the middle of the picture [m].
    metres_per_pixel : float
        Length that a pixel shows.
    size : tuple of int
        Width and height in pixels.
    """

    axes: Array
    centre: Array
    metres_per_pixel: float
    size: tuple[int, int]

    def pixels(self, points: Array) -> Array:
        """Place points (n, 3) [m] in the picture: columns from the left, rows from the top, shape (n, 2)."""
        flat = (points - self.centre) @ self.axes[:2].T / self.metres_per_pixel
        return np.asarray(np.array(self.size) / 2 + flat * (1, -1))

    def lifted(self, points: Array) -> Array:
        """Move points (n, 3) [m] a little towards the viewer, so that lines lie over faces."""
        lift: Array = 3 * self.metres_per_pixel * self.axes[2]
        return points + lift


def fitted_view(axes: Array, points: Array, size: tuple[int, int], place: Place = PART) -> View:
    """Look along the last of ``axes`` so that ``points`` (n, 3) [m] fill a place in the picture."""
    low, high = (points @ axes.T).min(axis=0), (points @ axes.T).max(axis=0)
    left, right, bottom, top = place
    room = np.array([(right - left) * size[0], (top - bottom) * size[1]])
    scale = float(np.max((high - low)[:2] / room)) or 1.0
    aside = np.array([(left + right - 1) * size[0], (bottom + top - 1) * size[1], 0.0]) / 2 * scale
    return View(axes, ((low + high) / 2 - aside) @ axes, scale, size)


def oblique_axes(points: Array, tilt: tuple[float, float] = TILT) -> Iterator[Array]:
    """Yield camera axes (3, 3), the best first, all oblique to the plane of the longest two extents."""
    extents = np.ptp(points, axis=0)
    steps = np.log(np.maximum(extents / extents.max(), 1e-9)) / np.log(SAME_EXTENT)
    slender = np.sort(extents)[1] < SLENDER * extents.max()
    right, up, _ = np.eye(3)[np.argsort(-np.round(steps), kind="stable")]
    if np.cross(right, up)[2] < 0:  # planar motion is looked at from above: turning left stays turning left
        up = -up
    front = np.array([right, up, np.cross(right, up)])
    for back, rise, turn in product((1, -1), (1, -1), (1, -1)):
        about_up, about_right = np.radians(tilt) * (turn, rise)
        c, s = np.cos(about_up), np.sin(about_up)
        aside = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        c, s = np.cos(about_right), np.sin(about_right)
        above = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        # A slender part lies level, any other stands upright.
        turned = aside @ above if slender else above @ aside
        yield turned @ (front * [[back], [1], [back]])


def is_seen(view_axes: Array, points: Array, triangles: IntArray, number: int) -> bool:
    """Tell whether no triangle lies between a point and the viewer."""
    seen = points @ view_axes.T - view_axes @ points[number]
    a, b, c = np.moveaxis(seen[triangles[np.all(triangles != number, axis=1)]], 1, 0)

    def doubled_area(p: Array, q: Array) -> Array:
        return np.asarray(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])

    weights = np.stack([doubled_area(b, c), doubled_area(c, a), doubled_area(a, b)], axis=1)
    over = np.all(weights >= 0, axis=1) | np.all(weights <= 0, axis=1)
    depth = np.einsum("tk,tk->t", weights, np.stack([a, b, c], axis=1)[:, :, 2])
    return not np.any(over & (depth * weights.sum(axis=1) > 0))


@contextmanager
def stage(view: View) -> Iterator[pv.Plotter]:
    """Lend a plotter with a white background, the camera of ``view`` and a light at it; close it after."""
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)  # a missing X server is no news, EGL stands in
    plotter = pv.Plotter(off_screen=True, window_size=list(view.size), lighting="none")
    vtkLogger.SetStderrVerbosity(verbosity)
    try:
        plotter.renderer.SetBackground(1.0, 1.0, 1.0)
        plotter.enable_anti_aliasing("ssaa")
        plotter.add_light(pv.Light(light_type="headlight"))
        reach = view.metres_per_pixel * sum(view.size)
        camera = plotter.camera
        camera.focal_point = view.centre
        camera.position = view.centre + 2 * reach * view.axes[2]
        camera.up = view.axes[1]
        camera.parallel_projection = True
        camera.parallel_scale = view.metres_per_pixel * view.size[1] / 2
        camera.clipping_range = (reach, 3 * reach)
        yield plotter
    finally:
        plotter.close()


def add_part(
    plotter: pv.Plotter, view: View, surface: Surface, values: Array, limits: tuple[float, float]
) -> tuple[pv.PolyData, pv.PolyData]:
    """Add the part, coloured by ``values`` between ``limits``; return its faces and lines, to be moved."""
    faces = pv.PolyData(surface.points, faces=np.insert(surface.triangles, 0, 3, axis=1).ravel())
    faces.point_data["values"] = values
    plotter.add_mesh(
        faces,
        scalars="values",
        cmap=COLOUR_MAP,
        clim=limits,
        ambient=0.7,
        diffuse=0.3,
        specular=0.0,
        show_scalar_bar=False,
    )
    return faces, add_edges(plotter, view, surface, INK)


def add_edges(plotter: pv.Plotter, view: View, surface: Surface, colour: str) -> pv.PolyData:
    """Add the part's edges."""
    lines = pv.PolyData(view.lifted(surface.points), lines=np.insert(surface.edges, 0, 2, axis=1).ravel())
    plotter.add_mesh(lines, color=colour, line_width=1.2, opacity=0.45, lighting=False)
    return lines


def add_colour_bar(plotter: pv.Plotter, quantity: str, limits: tuple[float, float], place: Place = BAR) -> None:
    """Add a bar of the colours, lying or upright as its place is, with round numbers and the limits."""
    left, right, bottom, top = place
    start = np.array([left, bottom, 0.0])
    wide, high, _ = np.diag([right - left, top - bottom, 0.0])
    if top - bottom > right - left:
        along, across, offset, align = high, wide, np.array([right - left + 0.01, 0, 0]), "left"
        add_text(plotter, quantity, (left, top + 0.05), 1 / 36)
    else:
        along, across, offset, align = wide, high, np.array([0, -0.025, 0]), "centre"
        add_text(plotter, quantity, (left - 0.015, (bottom + top) / 2), 1 / 36, "right")
    side = start + np.linspace(0, 1, 257)[:, None] * along
    k = np.arange(256)
    faces = np.column_stack([np.full(256, 4), k, k + 1, k + 258, k + 257])
    strip = pv.PolyData(np.concatenate([side, side + across]), faces=faces.ravel())
    strip.cell_data["colours"] = colormaps[COLOUR_MAP](k, bytes=True)[:, :3]
    strip.set_active_scalars("colours")
    _add_flat(plotter, strip)
    for tick in (limits[0], *MaxNLocator(5).tick_values(*limits), limits[1]):
        share = (tick - limits[0]) / (limits[1] - limits[0])
        if tick in limits or 0.06 < share < 0.94:
            x, y, _ = start + share * along + offset
            add_text(plotter, f"{tick:.3g}", (x, y), 1 / 42, align)


def add_text(
    plotter: pv.Plotter, text: str, place: tuple[float, float], height: float, align: str = "left"
) -> vtkTextActor:
    """Add text at ``place``; place and ``height`` of the letters are fractions of the picture's size."""
    label = vtkTextActor()
    label.SetInput(text)
    label.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
    label.SetPosition(*place)
    look = label.GetTextProperty()
    look.SetFontFamily(VTK_FONT_FILE)
    look.SetFontFile(FONT)
    look.SetFontSize(round(height * plotter.window_size[1]))
    look.SetColor(*pv.Color(INK).float_rgb)
    look.SetJustification(("left", "centre", "right").index(align))
    look.SetVerticalJustificationToCentered()
    plotter.renderer.AddViewProp(label)
    return label


def add_heading(plotter: pv.Plotter, title: str, note: str = "") -> vtkTextActor:
    """Add the title at the upper left and a smaller note, which is returned, at the upper right."""
    add_text(plotter, title, (0.03, 0.94), 1 / 26)
    return add_text(plotter, note, (0.97, 0.94), 1 / 34, "right")


def add_stroke(plotter: pv.Plotter, view: View, pixels: Array) -> None:
    """Add a line through ``pixels`` (n, 2), over everything."""
    flat = pixels / view.size * (1, -1) + (0, 1)
    _add_flat(plotter, pv.lines_from_points(np.column_stack([flat, np.zeros(len(flat))])))


def _add_flat(plotter: pv.Plotter, shape: pv.PolyData) -> None:
    """Add a shape whose x and y are fractions of the picture's width and height, over everything."""
    fractions = vtkCoordinate()
    fractions.SetCoordinateSystemToNormalizedViewport()
    mapper = vtkPolyDataMapper2D()
    mapper.SetTransformCoordinate(fractions)
    mapper.SetInputData(shape)
    actor = vtkActor2D()
    actor.SetMapper(mapper)
    actor.GetProperty().SetColor(pv.Color(INK).float_rgb)
    actor.GetProperty().SetLineWidth(2.0)
    plotter.renderer.AddViewProp(actor)


def add_marker(plotter: pv.Plotter, view: View, point: Array, text: str) -> None:
    """Ring a point (3,) [m] and write beside it, on its outer side if there is room."""
    width, height = view.size
    spot = view.pixels(point[None])[0]
    outward = np.where(spot < np.array(view.size) / 2, -1, 1)
    aside = outward * (1 if 0.2 < spot[0] / width < 0.8 else -1, 1)
    end = spot + aside * height / 14
    end[1] = max(end[1], 0.12 * height)  # below the heading
    start = spot + (end - spot) * (height / 100) / np.linalg.norm(end - spot)
    angle = np.linspace(0.0, 2 * np.pi, 49)
    add_stroke(plotter, view, spot + height / 100 * np.column_stack([np.cos(angle), np.sin(angle)]))
    add_stroke(plotter, view, np.stack([start, end]))
    place = (end + aside * (height / 150, 0)) / view.size
    align = "left" if aside[0] > 0 else "right"
    look = add_text(plotter, text, (place[0], 1 - place[1]), 1 / 36, align).GetTextProperty()
    look.SetBackgroundColor(1.0, 1.0, 1.0)  # legible over the part too
    look.SetBackgroundOpacity(0.75)


def save(plotter: pv.Plotter, path: Path) -> None:
    """Write what the plotter shows to a picture file."""
    picture = np.asarray(plotter.screenshot(return_img=True))
    with whole_file(path) as part:
        iio.imwrite(part, picture)


def draw_mode(surface: Surface, displacement: Array, path: Path, *, title: str, size: tuple[int, int] = PIXELS) -> View:
    """Draw a mode shape over the undeformed part, its amplitude 8 % of the part's largest extent.

    Parameters
    ----------
    surface : Surface
        The part.
    displacement : ndarray, shape (n_points, 3)
        The shape in any scale.
    path : Path
        The picture to write.
    title : str
        Heading, e.g. ``Mode 1 · 131.0 Hz``.
    size : tuple of int
        Width and height [pixels].

    Returns
    -------
    View
        How the picture was taken: where each point is in it.

    Raises
    ------
    ValueError
        The displacement has another shape than the points, or is zero everywhere.
    """
    require_shape("displacement", displacement, surface.points.shape)
    magnitude = np.linalg.norm(displacement, axis=1)
    if not magnitude.max() > 0:
        raise ValueError("the mode's displacement is zero everywhere")
    amplitude = MODE_AMPLITUDE * np.ptp(surface.points, axis=0).max()
    points = surface.points + displacement * (amplitude / magnitude.max())
    both = np.concatenate([surface.points, points])
    view = fitted_view(next(oblique_axes(both)), both, size)
    with stage(view) as plotter:
        add_edges(plotter, view, surface, GHOST)
        add_part(plotter, view, replace(surface, points=points), magnitude / magnitude.max(), (0.0, 1.0))
        add_colour_bar(plotter, "relative displacement", (0.0, 1.0))
        add_heading(plotter, title)
        save(plotter, path)
    return view


def draw_stress(
    surface: Surface,
    displacement: Array,
    stress: Array,
    path: Path,
    *,
    title: str,
    scale: float = 1.0,
    size: tuple[int, int] = PIXELS,
) -> View:
    """Draw the von Mises stress on the deformed part over the undeformed one and mark its hottest point.

    Parameters
    ----------
    surface : Surface
        The part.
    displacement : ndarray, shape (n_points, 3)
        Displacement of the points [m].
    stress : ndarray, shape (n_points,)
        Von Mises stress at the points [Pa].
    path : Path
        The picture to write.
    title : str
        Heading.
    scale : float
        Factor on the displacement; the picture tells it unless it is 1.
    size : tuple of int
        Width and height [pixels].

    Returns
    -------
    View
        How the picture was taken: where each point is in it.

    Raises
    ------
    ValueError
        Displacement or stress have other shapes than the points.
    """
    require_shape("displacement", displacement, surface.points.shape)
    require_shape("stress", stress, (len(surface.points),))
    points = surface.points + scale * displacement
    both = np.concatenate([surface.points, points])
    axes, hottest = _view_of_hottest(list(oblique_axes(both)), points, surface.triangles, stress)
    view = fitted_view(axes, both, size)
    limits = (0.0, float(stress.max()) * 1e-6 or 1.0)
    with stage(view) as plotter:
        add_edges(plotter, view, surface, GHOST)
        add_part(plotter, view, replace(surface, points=points), stress * 1e-6, limits)
        add_colour_bar(plotter, "von Mises [MPa]", limits)
        add_heading(plotter, title, "" if scale == 1 else f"deformation × {scale:g}")
        add_marker(plotter, view, points[hottest], f"{stress[hottest] * 1e-6:.3g} MPa")
        save(plotter, path)
    return view


def _view_of_hottest(candidates: list[Array], points: Array, triangles: IntArray, stress: Array) -> tuple[Array, int]:
    """Choose the first camera that sees a point as hot as the hottest, to a thousandth, and that point."""
    hot = np.flatnonzero(stress >= (1 - 1e-3) * stress.max())
    for axes, number in product(candidates, hot.tolist()):
        if is_seen(axes, points, triangles, number):
            return axes, number
    return candidates[0], int(np.argmax(stress))
