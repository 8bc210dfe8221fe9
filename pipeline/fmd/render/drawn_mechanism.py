"""A mechanism on a canvas, moved from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyvista as pv

from fmd.core.arrays import Array
from fmd.render.camera import Camera
from fmd.render.canvas import Canvas, DrawnPart, Outline, add_part_by_colours, add_part_by_values, choose_outline
from fmd.render.colours import UNCOLOURED
from fmd.render.moving_bodies import MovingMechanism
from fmd.render.projection import Place, Projection
from fmd.render.surface import Surface, build_skin

_AMBIENT = 0.62  # of light, so that what is turned from it stays pale
_FORM = Outline(elements=False, width=1.0, opacity=0.55)


@dataclass(frozen=True, slots=True)
class DrawnMechanism:
    """Bodies, shapes and lines of a mechanism in a plotter."""

    moving: MovingMechanism
    bodies: tuple[DrawnPart, ...]
    shapes: tuple[DrawnPart, ...]
    lines: tuple[pv.PolyData, ...]

    def move(self, frame: int) -> None:
        """Move everything to where it is in a frame, and colour it."""
        for body, drawn in zip(self.moving.bodies, self.bodies, strict=True):
            drawn.move(body.points(frame), None if body.stress is None else body.stress[frame] * 1e-6)
        for shape, drawn in zip(self.moving.shapes, self.shapes, strict=True):
            drawn.move(shape.points(frame))
        for line, points in zip(self.moving.lines, self.lines, strict=True):
            points.points = line.points[frame]

    def set_limits(self, limits: tuple[float, float]) -> None:
        """Set the stress [MPa] of the lowest and of the highest colour."""
        for body, drawn in zip(self.moving.bodies, self.bodies, strict=True):
            if body.stress is not None:
                drawn.actor.mapper.scalar_range = limits


def add_mechanism(
    canvas: Canvas, moving: MovingMechanism, limits: tuple[float, float], colour_map: str
) -> DrawnMechanism:
    """Add a mechanism to a canvas as it is in the first frame; limits of the colours are in MPa."""
    bodies, shapes, lines = [], [], []
    for body in moving.bodies:
        if body.stress is None:
            bodies.append(
                _add_in_one_colour(canvas, body.surface, UNCOLOURED, choose_outline(body.surface, canvas.projection))
            )
        else:
            no_stress = np.zeros(len(body.surface.points))
            bodies.append(
                add_part_by_values(canvas, body.surface, build_skin(body.surface), no_stress, limits, colour_map)
            )
    shapes = [_add_in_one_colour(canvas, shape.surface, shape.colour, _FORM) for shape in moving.shapes]
    for line in moving.lines:
        drawn = pv.lines_from_points(line.points[0])
        width = line.width * canvas.fineness
        canvas.plotter.add_mesh(drawn, color=line.colour, line_width=width, lighting=False)
        lines.append(drawn)
    mechanism = DrawnMechanism(moving, tuple(bodies), tuple(shapes), tuple(lines))
    mechanism.move(0)
    return mechanism


def _add_in_one_colour(canvas: Canvas, surface: Surface, colour: str, outline: Outline) -> DrawnPart:
    rgb = np.tile(np.array(pv.Color(colour).int_rgb, dtype=np.uint8), (len(surface.triangles), 1))
    return add_part_by_colours(canvas, surface, build_skin(surface), rgb, outline, _AMBIENT)


def fit_mechanism(
    camera: Camera, moving: MovingMechanism, tilt: tuple[float, float], place: Place, axes: Array | None = None
) -> Projection:
    """Return the projection that shows a mechanism in all frames, along camera ``axes`` (3, 3) or the best ones."""
    around = moving.around()
    return camera.projection(camera.candidate_axes(around, tilt, moving.up)[0] if axes is None else axes, around, place)
