"""What pictures and films are taken on: a plotter with camera and light, and the parts that it shows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import vtkLogger

from pipeline.core.arrays import Array, IntArray
from pipeline.core.files import whole_file
from pipeline.render.projection import View
from pipeline.render.surface import Skin, Surface, doubled_areas

INK = "#1a1a1a"
GHOST = "#707070"
WIDEST = 16384  # pixels of a window's width or height, a limit of OpenGL's
MOST_PIXELS = 50_000_000  # of a window, for the sake of memory
LIGHT = (-0.3, 0.4, 1.0)  # from where, to the right, up and towards the viewer
COARSE, FINE = 14.0, 6.0  # pixels between element outlines: with more they are drawn in full, with less not at all
AMONG_COLOURS, AMONG_PARTS = 0.7, 0.42  # ambient light where colours are read off a bar, and where they are names


@dataclass(frozen=True, slots=True)
class Canvas:
    """A plotter that draws ``fineness`` times as large as the picture is, which smooths edges when it is reduced."""

    plotter: pv.Plotter
    view: View
    fineness: int

    def picture(self) -> NDArray[np.uint8]:
        """Return what the plotter shows, shape (height, width, 3): means over squares of its pixels."""
        self.plotter.render()
        fine: NDArray[np.uint8] = np.asarray(self.plotter.screenshot(return_img=True))[..., :3]
        n = self.fineness
        if n == 1:
            return fine
        rows = np.add(fine[0::n], fine[1::n], dtype=np.uint16)
        for k in range(2, n):
            rows += fine[k::n]
        picture = np.empty((len(rows), rows.shape[1] // n, 3), dtype=np.uint8)
        for channel in range(3):  # one by one: along an axis of three NumPy takes twice the time
            total = rows[:, 0::n, channel] + rows[:, 1::n, channel]
            for k in range(2, n):
                total += rows[:, k::n, channel]
            picture[..., channel] = (total + n * n // 2) // (n * n)
        return picture

    def save(self, path: Path) -> None:
        """Write the picture to a file."""
        with whole_file(path) as part:
            iio.imwrite(part, self.picture())


@contextmanager
def stage(view: View, fineness: int = 3) -> Iterator[Canvas]:
    """Lend a canvas with a white background, the camera of ``view`` and a light above its left; close it after.

    A larger window that is reduced looks as good as VTK's own anti-aliasing and takes a third of its time without a
    GPU.
    """
    finest = min(WIDEST // max(view.size), math.isqrt(MOST_PIXELS // (view.size[0] * view.size[1])))
    fineness = max(1, min(fineness, finest))
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)  # a missing X server is no news, EGL stands in
    plotter = pv.Plotter(off_screen=True, window_size=[fineness * n for n in view.size], lighting="none")
    vtkLogger.SetStderrVerbosity(verbosity)
    try:
        plotter.disable_anti_aliasing()  # multi-sampling as well
        plotter.renderer.SetBackground(1.0, 1.0, 1.0)
        plotter.renderer.SetUseOIT(False)  # only lines are translucent: sorting them by depth doubles a frame's time
        plotter.add_light(pv.Light(light_type="camera light", position=LIGHT))
        camera = plotter.camera
        camera.focal_point = view.centre
        camera.position = view.centre + 2 * view.reach * view.axes[2]
        camera.up = view.axes[1]
        camera.parallel_projection = True
        camera.parallel_scale = view.metres_per_pixel * view.size[1] / 2
        camera.clipping_range = (view.reach, 3 * view.reach)
        yield Canvas(plotter, view, fineness)
    finally:
        plotter.close()


@dataclass(frozen=True, slots=True)
class Outline:
    """Lines upon a part: outlines of elements or only those that show its form; width [pixels] and opacity."""

    elements: bool
    width: float = 1.2
    opacity: float = 1.0
    lift: float = 2.0  # pixels towards the viewer, so that lines lie over faces


def outline_for(surface: Surface, view: View, ghost: bool = False) -> Outline:
    """Choose lines that leave colours to be seen: those of elements fade as they come close, and then are left out.

    A ghost, a part that isn't there, is drawn behind what coincides with it, and never with faded lines.
    """
    cell = surface.cell / view.metres_per_pixel
    if ghost:
        elements = cell >= COARSE
        return Outline(elements, width=1.0, opacity=0.35 if elements else 0.6, lift=-1.0)
    if cell < FINE:
        return Outline(elements=False, opacity=0.6)
    share = min(1.0, (cell - FINE) / (COARSE - FINE))
    return Outline(elements=True, width=0.7 + 0.3 * share, opacity=0.2 + 0.2 * share)


@dataclass(frozen=True, slots=True)
class Body:
    """A part in a plotter: its faces, shaded smoothly but for creases, and the lines upon them."""

    view: View
    skin: Skin
    faces: pv.PolyData
    lines: pv.PolyData
    outline: Outline

    def move(self, points: Array, values: Array | None = None) -> None:
        """Put the part's points (n_points, 3) [m] where they are now, and colour it by ``values`` (n_points,)."""
        positions = points[self.skin.source]
        areas = doubled_areas(positions, self.skin.triangles)
        self.faces.points = positions
        self.faces.point_data.active_normals = self.skin.normals(areas)
        if values is not None:
            self.faces.point_data["values"] = values[self.skin.source]
        _move_lines(self.lines, self.outline, self.view, self.skin, points, areas)


def add_body(
    canvas: Canvas,
    surface: Surface,
    skin: Skin,
    values: Array,
    limits: tuple[float, float],
    colour_map: str,
    outline: Outline | None = None,
) -> Body:
    """Add a part, coloured by ``values`` (n_points,) between ``limits``; ``outline`` is chosen if none is given."""
    coloured = {"scalars": "values", "cmap": colour_map, "clim": limits, "show_scalar_bar": False}
    faces = pv.PolyData(surface.points[skin.source], faces=_cells(skin.triangles))
    faces.point_data["values"] = values[skin.source]
    return _add(canvas, faces, surface, skin, outline, coloured, AMONG_COLOURS)


def add_parts(
    canvas: Canvas, surface: Surface, skin: Skin, colours: NDArray[np.uint8], outline: Outline | None = None
) -> Body:
    """Add a part with a colour for each triangle, shape (n_triangles, 3)."""
    faces = pv.PolyData(surface.points[skin.source], faces=_cells(skin.triangles))
    faces.cell_data["colours"] = colours
    return _add(canvas, faces, surface, skin, outline, {"scalars": "colours", "rgb": True}, AMONG_PARTS)


def _add(
    canvas: Canvas,
    faces: pv.PolyData,
    surface: Surface,
    skin: Skin,
    outline: Outline | None,
    colouring: dict[str, Any],
    ambient: float,
) -> Body:
    """Add faces and lines of a part; ``ambient`` is the share of their brightness that no direction takes away."""
    actor = canvas.plotter.add_mesh(faces, ambient=ambient, diffuse=1 - ambient, specular=0.0, **colouring)
    actor.prop.interpolation = "Phong"
    outline = outline or outline_for(surface, canvas.view)
    body = Body(canvas.view, skin, faces, _added_lines(canvas, outline, INK), outline)
    body.move(surface.points)
    return body


def add_ghost(canvas: Canvas, surface: Surface, skin: Skin) -> None:
    """Add the lines of a part that isn't there."""
    outline = outline_for(surface, canvas.view, ghost=True)
    areas = doubled_areas(surface.points, surface.triangles)
    lines = _added_lines(canvas, outline, GHOST)
    _move_lines(lines, outline, canvas.view, skin, surface.points, areas)


def _added_lines(canvas: Canvas, outline: Outline, colour: str) -> pv.PolyData:
    """Add lines that are yet to be drawn."""
    lines = pv.PolyData(np.zeros((2, 3)), lines=[2, 0, 1])  # PyVista adds no shape without cells
    width = outline.width * canvas.fineness
    canvas.plotter.add_mesh(lines, color=colour, line_width=width, opacity=outline.opacity, lighting=False)
    return lines


def _move_lines(lines: pv.PolyData, outline: Outline, view: View, skin: Skin, points: Array, areas: Array) -> None:
    """Draw those lines of a surface that are wanted, at positions (n_points, 3) [m]; ``areas`` by triangle."""
    choose = skin.element_lines if outline.elements else skin.form_lines
    lines.points = view.moved(points, 0, 0, outline.lift)
    lines.lines = _cells(choose(areas, view.axes[2]))


def _cells(corners: IntArray) -> IntArray:
    """Put the number of corners before those of each cell, as VTK wants them."""
    return np.insert(corners, 0, corners.shape[1], axis=1).ravel()
