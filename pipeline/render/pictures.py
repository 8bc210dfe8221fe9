"""Still pictures of a part: its mode shapes and its stress."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.checks import Array, IntArray, read_only, require_shape
from pipeline.render.stage import GHOST, add_colour_bar, add_edges, add_heading, add_marker, add_part, save, stage
from pipeline.render.view import View, fitted_view, oblique_axes, view_of_hottest

PIXELS = (1600, 900)
MODE_AMPLITUDE = 0.08  # of the part's largest extent


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


def draw_mode(
    surface: Surface,
    displacement: Array,
    path: Path,
    *,
    title: str,
    scale: float = 1.0,
    size: tuple[int, int] = PIXELS,
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
    amplitude = scale * MODE_AMPLITUDE * np.ptp(surface.points, axis=0).max()
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
    axes, hottest = view_of_hottest(list(oblique_axes(both)), points, surface.triangles, stress)
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
