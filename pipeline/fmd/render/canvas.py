"""Off-screen plotters with camera and light, and the parts that they draw."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkLogger, vtkUnsignedCharArray

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.files import whole_file
from fmd.render.colours import sample_colours
from fmd.render.projection import Projection
from fmd.render.surface import Skin, Surface, area_normals

INK = "#1a1a1a"
UNDEFORMED = "#707070"
MOST_PIXELS_ACROSS = 16384  # of a window's width or height, a limit of OpenGL's
MOST_PIXELS = 50_000_000  # of a window, for the sake of memory
LIGHT = (-0.3, 0.4, 1.0)  # position of the light, to the right, up and towards the viewer
COARSE, FINE = 14.0, 6.0  # pixels between element outlines: with more they are drawn in full, with less not at all
AMBIENT_OF_VALUES, AMBIENT_OF_COLOURS = 0.7, 0.42  # little shading where colours are compared with the colour bar


@dataclass(frozen=True, slots=True)
class Canvas:
    """A plotter whose window is ``fineness`` times as large as the picture, to smooth its edges."""

    plotter: pv.Plotter
    projection: Projection
    fineness: int

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture [pixels]."""
        return self.projection.size

    def picture(self) -> NDArray[np.uint8]:
        """Render the picture, shape (height, width, 3), as means over squares of the window's pixels."""
        fine, n = self._render(), self.fineness
        if n == 1:
            return fine
        rows = np.add(fine[0::n], fine[1::n], dtype=np.uint16)
        for k in range(2, n):
            rows += fine[k::n]
        picture = np.empty((len(rows), rows.shape[1] // n, 3), dtype=np.uint8)
        for channel in range(3):  # one by one: along an axis of length three NumPy takes twice the time
            total = rows[:, 0::n, channel] + rows[:, 1::n, channel]
            for k in range(2, n):
                total += rows[:, k::n, channel]
            picture[..., channel] = (total + n * n // 2) // (n * n)
        return picture

    def _render(self) -> NDArray[np.uint8]:
        """Render the window's pixels, the upper row first; the buffer that a screen would show is left out."""
        self.plotter.render()
        window: Any = self.plotter.render_window
        width, height = self.plotter.window_size
        window.SetSwapBuffers(False)
        window.Render()
        pixels = vtkUnsignedCharArray()
        window.GetPixelData(0, 0, width - 1, height - 1, 0, pixels, 0)
        flat: NDArray[np.uint8] = vtk_to_numpy(pixels)  # type: ignore[no-untyped-call]
        return flat.reshape(height, width, 3)[::-1]

    def save(self, path: Path) -> None:
        """Write the picture to a file, whole or not at all."""
        with whole_file(path) as part:
            iio.imwrite(part, self.picture())


_Windows = dict[tuple[int, int], pv.Plotter]
_KEPT: ContextVar[_Windows | None] = ContextVar("windows", default=None)


@contextmanager
def keep_windows() -> Iterator[None]:
    """Keep the windows of canvases for later ones of equal size: a new one takes longer than a picture."""
    windows: _Windows = {}
    token = _KEPT.set(windows)
    try:
        yield
    finally:
        _KEPT.reset(token)
        for plotter in windows.values():
            plotter.close()


@contextmanager
def open_canvas(projection: Projection, fineness: int = 3) -> Iterator[Canvas]:
    """Open a white canvas with a camera and a light above its left, and close it afterwards.

    A larger window that is reduced looks as good as VTK's own anti-aliasing and takes a third of its time without a
    GPU.
    """
    width, height = projection.size
    finest = min(MOST_PIXELS_ACROSS // max(width, height), math.isqrt(MOST_PIXELS // (width * height)))
    fineness = max(1, min(fineness, finest))
    with _open_window((fineness * width, fineness * height)) as plotter:
        plotter.add_light(pv.Light(light_type="camera light", position=LIGHT))
        camera = plotter.camera
        camera.focal_point = projection.centre
        camera.position = projection.centre + 2 * projection.half_depth * projection.axes[2]
        camera.up = projection.axes[1]
        camera.parallel_projection = True
        camera.parallel_scale = projection.metres_per_pixel * projection.size[1] / 2
        camera.clipping_range = (projection.half_depth, 3 * projection.half_depth)
        yield Canvas(plotter, projection, fineness)


@contextmanager
def _open_window(size: tuple[int, int]) -> Iterator[pv.Plotter]:
    """Open an empty window [pixels], or take one that is kept; it is closed, or emptied and kept."""
    kept = _KEPT.get()
    plotter = kept.pop(size) if kept and size in kept else _new_window(size)
    try:
        yield plotter
    except BaseException:
        plotter.close()
        raise
    if kept is None or size in kept:
        plotter.close()
    else:
        plotter.clear()
        plotter.renderer.RemoveAllViewProps()
        plotter.renderer.RemoveAllLights()
        kept[size] = plotter


def _new_window(size: tuple[int, int]) -> pv.Plotter:
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)  # no warning of a missing X server: EGL replaces it
    plotter = pv.Plotter(off_screen=True, window_size=list(size), lighting="none")
    vtkLogger.SetStderrVerbosity(verbosity)
    plotter.disable_anti_aliasing()  # and multi-sampling with it
    plotter.renderer.SetBackground(1.0, 1.0, 1.0)
    plotter.renderer.SetUseOIT(False)  # only lines are translucent: sorting them by depth doubles a frame's time
    return plotter


@dataclass(frozen=True, slots=True)
class Outline:
    """Style of the lines on a part."""

    elements: bool  # true for the outlines of elements, False for the lines of the part's form alone
    width: float = 1.2  # [pixels]
    opacity: float = 1.0  # from 0 to 1
    lift: float = 2.0  # distance towards the viewer, so that lines lie over faces [pixels]


def choose_outline(surface: Surface, projection: Projection) -> Outline:
    """Choose a part's lines so that its colours stay visible: close outlines of elements fade, then disappear."""
    spacing = surface.outline_spacing / projection.metres_per_pixel
    if spacing < FINE:
        return Outline(elements=False, opacity=0.6)
    share = min(1.0, (spacing - FINE) / (COARSE - FINE))
    return Outline(elements=True, width=0.7 + 0.3 * share, opacity=0.2 + 0.2 * share)


def choose_undeformed_outline(surface: Surface, projection: Projection) -> Outline:
    """Choose the lines of the undeformed part, which lie behind the deformed one where both coincide."""
    elements = surface.outline_spacing / projection.metres_per_pixel >= COARSE
    return Outline(elements, width=1.0, opacity=0.35 if elements else 0.6, lift=-1.0)


@dataclass(frozen=True, slots=True)
class DrawnPart:
    """A part in a plotter: its faces, shaded smoothly except at creases, and the lines on them."""

    projection: Projection
    skin: Skin
    faces: pv.PolyData
    lines: pv.PolyData
    outline: Outline
    actor: pv.Actor

    def move(self, points: Array, values: Array | None = None) -> None:
        """Move the part's points to (n_points, 3) [m] and, if given, colour it by ``values`` (n_points,)."""
        positions = points[self.skin.source]
        normals = area_normals(positions, self.skin.triangles)
        self.faces.points = positions
        self.faces.point_data.active_normals = self.skin.normals(normals)
        if values is not None:
            self.faces.point_data["values"] = values[self.skin.source]
        _move_lines(self.lines, self.outline, self.projection, self.skin, points, normals)


def add_part_by_values(
    canvas: Canvas, surface: Surface, skin: Skin, values: Array, limits: tuple[float, float], colour_map: str
) -> DrawnPart:
    """Add a part with its points coloured by ``values`` (n_points,) between two limits."""
    faces = pv.PolyData(surface.points[skin.source], faces=_vtk_cells(skin.triangles))
    faces.point_data["values"] = values[skin.source]
    colours = ["#{:02x}{:02x}{:02x}".format(*colour) for colour in sample_colours(colour_map, 256).tolist()]
    colouring = {"scalars": "values", "cmap": colours, "clim": limits, "show_scalar_bar": False}
    outline = choose_outline(surface, canvas.projection)
    return _add_part(canvas, faces, surface, skin, outline, AMBIENT_OF_VALUES, colouring)


def add_part_by_colours(
    canvas: Canvas,
    surface: Surface,
    skin: Skin,
    colours: NDArray[np.uint8],
    outline: Outline,
    ambient: float = AMBIENT_OF_COLOURS,
) -> DrawnPart:
    """Add a part with a colour for each of its triangles, shape (n_triangles, 3)."""
    faces = pv.PolyData(surface.points[skin.source], faces=_vtk_cells(skin.triangles))
    faces.cell_data["colours"] = colours
    return _add_part(canvas, faces, surface, skin, outline, ambient, {"scalars": "colours", "rgb": True})


def _add_part(
    canvas: Canvas,
    faces: pv.PolyData,
    surface: Surface,
    skin: Skin,
    outline: Outline,
    ambient: float,
    colouring: dict[str, Any],
) -> DrawnPart:
    """Add a part's faces and lines; ``ambient`` is the share of light that doesn't depend on direction."""
    actor = canvas.plotter.add_mesh(faces, ambient=ambient, diffuse=1 - ambient, specular=0.0, **colouring)
    actor.prop.interpolation = "Phong"
    part = DrawnPart(canvas.projection, skin, faces, _add_lines(canvas, outline, INK), outline, actor)
    part.move(surface.points)
    return part


def add_undeformed(canvas: Canvas, surface: Surface, skin: Skin) -> None:
    """Add the grey lines of the undeformed part."""
    outline = choose_undeformed_outline(surface, canvas.projection)
    lines = _add_lines(canvas, outline, UNDEFORMED)
    normals = area_normals(surface.points, surface.triangles)
    _move_lines(lines, outline, canvas.projection, skin, surface.points, normals)


def _add_lines(canvas: Canvas, outline: Outline, colour: str) -> pv.PolyData:
    """Add lines whose points `_move_lines` sets."""
    lines = pv.PolyData(np.zeros((2, 3)), lines=[2, 0, 1])  # PyVista adds no shape without cells
    width = outline.width * canvas.fineness
    canvas.plotter.add_mesh(lines, color=colour, line_width=width, opacity=outline.opacity, lighting=False)
    return lines


def _move_lines(
    lines: pv.PolyData, outline: Outline, projection: Projection, skin: Skin, points: Array, normals: Array
) -> None:
    """Set the lines of a surface by its points (n_points, 3) [m] and its triangles' `area_normals`."""
    choose = skin.element_lines if outline.elements else skin.form_lines
    lines.points = projection.shift(points, 0, 0, outline.lift)
    lines.lines = _vtk_cells(choose(normals, projection.axes[2]))


def _vtk_cells(corners: IntArray) -> IntArray:
    """Return cells as VTK lists them: the number of corners before those of each cell."""
    return np.insert(corners, 0, corners.shape[1], axis=1).ravel()
