"""Still pictures of one number at each point of a part's surface, in any unit."""

from __future__ import annotations

from pathlib import Path

from fmd.core.arrays import Array, require_shape
from fmd.render.annotations import add_colour_bar, add_heading, add_label, cover_margins
from fmd.render.camera import Camera
from fmd.render.canvas import add_part_by_values, open_canvas
from fmd.render.projection import PART, Projection, choose_axes
from fmd.render.surface import Surface, build_skin


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
    """Draw a field on the undeformed part, and label one of its points.

    Parameters
    ----------
    surface : Surface
        The part.
    values : ndarray, shape (n_points,)
        Of the field.
    path : Path
        The picture to write.
    title, quantity : str
        Heading, and label of the colour bar with its unit.
    limits : tuple of float
        Values of the lowest and of the highest colour.
    weights : ndarray, shape (n_points,)
        The point with the largest is labelled; the view is chosen so that it is seen, if it can be.
    label : str
        Its label.
    camera : Camera, optional

    Returns
    -------
    Projection
        From points in space to pixels.

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
        if camera.is_close_up:
            cover_margins(canvas, PART)
        if not camera.is_close_up or projection.contains(surface.points[marked], PART):
            add_label(canvas, surface.points[marked], label if visible else f"{label} (on the far side)", PART)
        add_colour_bar(canvas, quantity, limits, camera.colour_map)
        add_heading(canvas, title)
        canvas.save(path)
    return projection
