"""Still pictures of a part: its mesh, its mode shapes, its stress, and other fields on its surface."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle, islice
from pathlib import Path

import numpy as np
import pyvista as pv

from fmd.core.arrays import Array, IntArray, require_shape
from fmd.render.annotations import (
    add_colour_bar,
    add_heading,
    add_label,
    add_legend,
    add_triad,
    arrange_legend,
    cover_margins,
    format_number,
)
from fmd.render.camera import Camera
from fmd.render.canvas import Canvas, Outline, add_part_by_colours, add_part_by_values, add_undeformed, open_canvas
from fmd.render.colours import STRESS, limits_in_megapascals, stress_limits
from fmd.render.projection import PART, Projection, choose_axes
from fmd.render.surface import Surface, build_skin

MODE_AMPLITUDE = 0.08  # of the part's largest extent
PART_COLOURS = ("#7f9fc4", "#e0a458", "#7fae83", "#c5746b", "#9a86b8", "#c9bb62", "#76b5b8", "#b39b86")
LEGEND_BOTTOM, LEGEND_STEP = 0.06, 0.055  # fractions of the picture's height


def draw_mesh(
    surface: Surface,
    part_of_triangle: IntArray,
    names: Sequence[str],
    path: Path,
    *,
    title: str,
    camera: Camera | None = None,
) -> Projection:
    """Draw a mesh with each of its parts in its own colour.

    Each triangle has its part's position, (n_triangles,), among the names of the legend, e.g. ``sleeve (1,980
    elements)``.

    Raises
    ------
    ValueError
        A triangle has no part, or a part no name.
    """
    camera = camera or Camera()
    require_shape("part_of_triangle", part_of_triangle, (len(surface.triangles),))
    if not 0 <= part_of_triangle.min() <= part_of_triangle.max() < len(names):
        raise ValueError(f"part_of_triangle names parts beyond the {len(names)} that have names")
    colours = list(islice(cycle(PART_COLOURS), len(names)))
    rows = len(arrange_legend(names, camera.size))
    place = (PART[0], PART[1], LEGEND_BOTTOM + rows * LEGEND_STEP, 0.87)
    projection = camera.projection(camera.candidate_axes(surface.points)[0], surface.points, place)
    spacing = surface.outline_spacing / projection.metres_per_pixel
    width, opacity = np.clip(spacing / 12, 0.5, 2.2), np.clip(spacing / 10, 0.35, 0.85)
    outline = Outline(elements=True, width=float(width), opacity=float(opacity))
    with open_canvas(projection) as canvas:
        rgb = np.array([pv.Color(colour).int_rgb for colour in colours], dtype=np.uint8)
        add_part_by_colours(canvas, surface, build_skin(surface), rgb[part_of_triangle], outline)
        if camera.is_close_up:
            cover_margins(canvas, place)
        add_legend(canvas, names, colours, LEGEND_BOTTOM, LEGEND_STEP)
        add_heading(canvas, title)
        canvas.save(path)
    return projection


def draw_mode(
    surface: Surface,
    displacement: Array,
    path: Path,
    *,
    title: str,
    scale: float = 1.0,
    camera: Camera | None = None,
) -> Projection:
    """Draw a mode shape over the undeformed part, its amplitude 8 % of the part's largest extent times ``scale``.

    The displacement (n_points, 3) is in any scale; a title is e.g. ``Mode 1 · 131.0 Hz``.

    Raises
    ------
    ValueError
        The displacement has another shape than the points, or is zero everywhere.
    """
    camera = camera or Camera()
    points, magnitude = scale_mode(surface, displacement, scale)
    both = np.concatenate([surface.points, points])
    projection = camera.projection(camera.candidate_axes(both)[0], both)
    with open_canvas(projection, fineness=2) as canvas:
        _add_deformed(canvas, surface, points, magnitude, (0.0, 1.0), camera)
        _annotate(canvas, camera, title, "", "relative displacement", (0.0, 1.0))
        canvas.save(path)
    return projection


def scale_mode(surface: Surface, displacement: Array, scale: float = 1.0) -> tuple[Array, Array]:
    """Return a mode's deformed points, shape (n_points, 3) [m], and the displacements over the largest."""
    require_shape("displacement", displacement, surface.points.shape)
    magnitude = np.linalg.norm(displacement, axis=1)
    if not magnitude.max() > 0:
        raise ValueError("the mode's displacement is zero everywhere")
    amplitude = scale * MODE_AMPLITUDE * np.ptp(surface.points, axis=0).max()
    return surface.points + displacement * (amplitude / magnitude.max()), magnitude / magnitude.max()


def draw_stress(
    surface: Surface,
    displacement: Array,
    stress: Array,
    path: Path,
    *,
    title: str,
    scale: float = 1.0,
    quantity: str = STRESS,
    clim_pa: tuple[float, float] | None = None,
    camera: Camera | None = None,
) -> Projection:
    """Draw a stress on the deformed part over the undeformed one, and label its largest value.

    That is the largest by size of von Mises stress or a component (n_points,) [Pa], under a displacement (n_points, 3)
    [m] whose scale is noted in the picture unless it is 1. ``quantity`` is the label of the colour bar, in MPa,
    ``clim_pa`` the stress of its lowest and highest colour [Pa], by default `stress_limits`.

    Raises
    ------
    ValueError
        Shapes disagree with the points, or the limits don't ascend.
    """
    camera = camera or Camera()
    require_shape("displacement", displacement, surface.points.shape)
    require_shape("stress", stress, (len(surface.points),))
    limits = limits_in_megapascals(stress_limits(stress) if clim_pa is None else clim_pa)
    points = surface.points + scale * displacement
    both = np.concatenate([surface.points, points])
    axes, largest, visible = choose_axes(camera.candidate_axes(both), points, surface.triangles, np.abs(stress))
    projection = camera.projection(axes, both)
    with open_canvas(projection, fineness=2) as canvas:
        _add_deformed(canvas, surface, points, stress * 1e-6, limits, camera)
        value = f"{format_number(stress[largest] * 1e-6, limits[1] - limits[0])} MPa"
        _add_mark(canvas, camera, points[largest], value, visible)
        add_triad(canvas)
        _annotate(canvas, camera, title, "" if scale == 1 else f"deformation × {scale:g}", quantity, limits)
        canvas.save(path)
    return projection


def draw_field(
    surface: Surface,
    values: Array,
    path: Path,
    *,
    title: str,
    quantity: str,
    limits: tuple[float, float],
    weights: Array,
    label: str,
    camera: Camera | None = None,
) -> Projection:
    """Draw a field (n_points,) on the undeformed part, and label the point with the largest of weights (n_points,).

    The view is chosen so that this point is seen, if it can be. Limits are values of the lowest and of the highest
    colour; the quantity has its unit.

    Raises
    ------
    ValueError
        There isn't a value for each point, or the limits don't ascend.
    """
    camera = camera or Camera()
    require_shape("values", values, (len(surface.points),))
    if not limits[0] < limits[1]:
        raise ValueError(f"limits = {limits}: the highest colour needs a larger value than the lowest")
    require_shape("weights", weights, (len(surface.points),))
    axes, marked, visible = choose_axes(
        camera.candidate_axes(surface.points), surface.points, surface.triangles, weights
    )
    projection = camera.projection(axes, surface.points)
    with open_canvas(projection, fineness=2) as canvas:
        add_part_by_values(canvas, surface, build_skin(surface), values, limits, camera.colour_map)
        _add_mark(canvas, camera, surface.points[marked], label, visible)
        _annotate(canvas, camera, title, "", quantity, limits)
        canvas.save(path)
    return projection


def _add_mark(canvas: Canvas, camera: Camera, point: Array, label: str, visible: bool) -> None:
    """Label a point (3,) [m], unless it lies outside of a close-up."""
    if not camera.is_close_up or canvas.projection.contains(point, PART):
        add_label(canvas, point, label if visible else f"{label} (on the far side)", PART)


def _add_deformed(
    canvas: Canvas, surface: Surface, points: Array, values: Array, limits: tuple[float, float], camera: Camera
) -> None:
    """Add the lines of the undeformed part and the deformed part coloured by values."""
    skin = build_skin(surface)
    add_undeformed(canvas, surface, skin)
    add_part_by_values(canvas, replace(surface, points=points), skin, values, limits, camera.colour_map)


def _annotate(
    canvas: Canvas, camera: Camera, title: str, note: str, quantity: str, limits: tuple[float, float]
) -> None:
    """Add title, note and colour bar, on covered margins if the picture is a close-up."""
    if camera.is_close_up:
        cover_margins(canvas, PART)
    add_colour_bar(canvas, quantity, limits, camera.colour_map)
    add_heading(canvas, title, note)
