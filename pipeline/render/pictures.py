"""Still pictures of a part: its mesh, its mode shapes and its stress."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle, islice
from pathlib import Path

import numpy as np
import pyvista as pv

from pipeline.core.arrays import Array, IntArray, require_shape
from pipeline.render.annotations import (
    add_colour_bar,
    add_heading,
    add_legend,
    add_marker,
    add_patch,
    legend_rows,
    number,
)
from pipeline.render.camera import Look
from pipeline.render.canvas import Canvas, Outline, add_body, add_ghost, add_parts, stage
from pipeline.render.projection import PART, Place, View, view_of_hottest
from pipeline.render.surface import Surface, skin_of

__all__ = ["Look", "Surface", "draw_mesh", "draw_mode", "draw_stress", "relative_shape", "stress_limits"]

MODE_AMPLITUDE = 0.08  # of the part's largest extent
STRESS = "von Mises [MPa]"
PART_COLOURS = ("#7f9fc4", "#e0a458", "#7fae83", "#c5746b", "#9a86b8", "#c9bb62", "#76b5b8", "#b39b86")
LEGEND_BOTTOM, LEGEND_STEP = 0.06, 0.055  # fractions of the picture's height


def draw_mesh(
    surface: Surface,
    part_of_triangle: IntArray,
    names: Sequence[str],
    path: Path,
    *,
    title: str,
    look: Look | None = None,
) -> View:
    """Draw a mesh with each of its parts in a colour of its own.

    Parameters
    ----------
    surface : Surface
        The mesh's.
    part_of_triangle : ndarray, shape (n_triangles,)
        Which part each triangle belongs to: a position in ``names``.
    names : sequence of str
        What the legend calls the parts, e.g. ``sleeve (1,980 elements)``.
    path : Path
        The picture to write.
    title : str
        Heading.
    look : Look
        How the picture is taken.

    Returns
    -------
    View
        How the picture was taken: where each point is in it.

    Raises
    ------
    ValueError
        There isn't a part for each triangle, or not a name for each part.
    """
    look = look or Look()
    require_shape("part_of_triangle", part_of_triangle, (len(surface.triangles),))
    if not 0 <= part_of_triangle.min() <= part_of_triangle.max() < len(names):
        raise ValueError(f"part_of_triangle names parts beyond the {len(names)} that have names")
    colours = list(islice(cycle(PART_COLOURS), len(names)))
    rows = len(legend_rows(names, look.size))
    place = (PART[0], PART[1], LEGEND_BOTTOM + rows * LEGEND_STEP, 0.87)
    view = look.view(look.directions(surface.points)[0], surface.points, place)
    cell = surface.cell / view.metres_per_pixel
    outline = Outline(
        elements=True, width=float(np.clip(cell / 12, 0.5, 2.2)), opacity=float(np.clip(cell / 10, 0.35, 0.85))
    )
    with stage(view) as canvas:
        rgb = np.array([pv.Color(colour).int_rgb for colour in colours], dtype=np.uint8)
        add_parts(canvas, surface, skin_of(surface), rgb[part_of_triangle], outline)
        clear_around(canvas, look, place)
        add_legend(canvas, names, colours, LEGEND_BOTTOM, LEGEND_STEP)
        add_heading(canvas, title)
        canvas.save(path)
    return view


def draw_mode(
    surface: Surface,
    displacement: Array,
    path: Path,
    *,
    title: str,
    scale: float = 1.0,
    look: Look | None = None,
) -> View:
    """Draw a mode shape over the undeformed part, its amplitude 8 % of the part's largest extent times ``scale``.

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
    scale : float
        Factor on the amplitude.
    look : Look
        How the picture is taken.

    Returns
    -------
    View
        How the picture was taken: where each point is in it.

    Raises
    ------
    ValueError
        The displacement has another shape than the points, or is zero everywhere.
    """
    look = look or Look()
    points, relative = relative_shape(surface, displacement, scale)
    both = np.concatenate([surface.points, points])
    view = look.view(look.directions(both)[0], both)
    skin = skin_of(surface)
    with stage(view) as canvas:
        add_ghost(canvas, surface, skin)
        add_body(canvas, replace(surface, points=points), skin, relative, (0.0, 1.0), look.colour_map)
        clear_around(canvas, look, PART)
        add_colour_bar(canvas, "relative displacement", (0.0, 1.0), look.colour_map)
        add_heading(canvas, title)
        canvas.save(path)
    return view


def relative_shape(surface: Surface, displacement: Array, scale: float = 1.0) -> tuple[Array, Array]:
    """Return where a mode puts the points, shape (n_points, 3) [m], and their displacement over the largest."""
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
    look: Look | None = None,
) -> View:
    """Draw a stress on the deformed part over the undeformed one and mark its hottest point.

    Parameters
    ----------
    surface : Surface
        The part.
    displacement : ndarray, shape (n_points, 3)
        Displacement of the points [m].
    stress : ndarray, shape (n_points,)
        Stress at the points [Pa]: von Mises or a component; the hottest point has the largest absolute value.
    path : Path
        The picture to write.
    title : str
        Heading.
    scale : float
        Factor on the displacement; the picture tells it unless it is 1.
    quantity : str
        What the colour bar shows, in MPa.
    clim_pa : tuple of float, optional
        Stress of the lowest and of the highest colour [Pa]; else from 0, or from the least stress if that is negative,
        to the largest.
    look : Look
        How the picture is taken.

    Returns
    -------
    View
        How the picture was taken: where each point is in it.

    Raises
    ------
    ValueError
        Displacement or stress have other shapes than the points, or the limits are of no use.
    """
    look = look or Look()
    require_shape("displacement", displacement, surface.points.shape)
    require_shape("stress", stress, (len(surface.points),))
    limits = in_megapascals(stress_limits(stress) if clim_pa is None else clim_pa)
    points = surface.points + scale * displacement
    both = np.concatenate([surface.points, points])
    axes, hottest, seen = view_of_hottest(look.directions(both), points, surface.triangles, np.abs(stress))
    view = look.view(axes, both)
    skin = skin_of(surface)
    text = f"{number(stress[hottest] * 1e-6, limits[1] - limits[0])} MPa" + ("" if seen else " (on the far side)")
    with stage(view) as canvas:
        add_ghost(canvas, surface, skin)
        add_body(canvas, replace(surface, points=points), skin, stress * 1e-6, limits, look.colour_map)
        if not look.is_close_up or view.holds(points[hottest], PART):
            add_marker(canvas, points[hottest], text, PART)
        clear_around(canvas, look, PART)
        add_colour_bar(canvas, quantity, limits, look.colour_map)
        add_heading(canvas, title, "" if scale == 1 else f"deformation × {scale:g}")
        canvas.save(path)
    return view


def stress_limits(stress: Array) -> tuple[float, float]:
    """Return the limits of colours for a stress [Pa]: from 0, or the least if that is negative, to the largest."""
    low, high = min(0.0, float(stress.min())), float(stress.max())
    return (low, high) if low < high else (low, low + 1e6)


def in_megapascals(clim_pa: tuple[float, float]) -> tuple[float, float]:
    """Return limits of colours in MPa; refuse those that are none."""
    if not clim_pa[0] < clim_pa[1]:
        raise ValueError(f"clim_pa = {clim_pa}: the highest colour needs a larger stress than the lowest")
    return clim_pa[0] * 1e-6, clim_pa[1] * 1e-6


def clear_around(canvas: Canvas, look: Look, place: Place) -> None:
    """Keep a close-up out of the places of title, colour bar and legend."""
    if look.is_close_up:
        left, _, bottom, top = place
        add_patch(canvas, (0.0, 1.0, 0.0, bottom))
        add_patch(canvas, (0.0, 1.0, top, 1.0))
        if left > 0.1:  # else it is a margin, where nothing is written
            add_patch(canvas, (0.0, left, 0.0, 1.0))
