"""What pictures and films are composed of: a plotter with its camera, the part, colour bar, text and markers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

import imageio.v3 as iio
import numpy as np
import pyvista as pv
from matplotlib import colormaps, get_data_path
from matplotlib.ticker import MaxNLocator
from vtkmodules.vtkCommonCore import vtkLogger
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkCoordinate, vtkPolyDataMapper2D, vtkTextActor

from pipeline.checks import Array
from pipeline.files import whole_file
from pipeline.render.view import Place, View

if TYPE_CHECKING:
    from pipeline.render.pictures import Surface

COLOUR_MAP: Final = "turbo"
FONT = f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf"  # the charts' font, at hand on every machine
VTK_FONT_FILE = 4
INK = "#1a1a1a"
GHOST = "#707070"
BAR = (0.3, 0.7, 0.075, 0.11)  # place in the picture


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
