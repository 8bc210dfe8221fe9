"""Films and stills of a whole mechanism, its flexible bodies coloured by their stress."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import imageio.v2 as iio
import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkProp, vtkTextActor

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.files import whole_file
from fmd.render.annotations import add_colour_bar, add_heading, add_label, add_triad, cover_margins, format_number
from fmd.render.camera import FILM_PIXELS, Camera
from fmd.render.canvas import (
    Canvas,
    DrawnPart,
    Outline,
    add_part_by_colours,
    add_part_by_values,
    choose_outline,
    open_canvas,
)
from fmd.render.colours import STRESS, UNCOLOURED, limits_in_megapascals, stress_limits
from fmd.render.moving_bodies import MovingMechanism
from fmd.render.projection import PART as STILL
from fmd.render.projection import TILT as STILL_TILT
from fmd.render.projection import Place, Projection, choose_axes
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


# Motion sweeps a region about as high as wide: the bodies get the whole height, and the colour bar stands beside them.
PART = (0.16, 0.98, 0.03, 0.88)
BAR = (0.03, 0.05, 0.22, 0.72)
WITHOUT_BAR = (0.09, 0.98, 0.03, 0.88)
TILT = (20.0, 17.0)
_NO_LIMITS = (0.0, 1.0)


def draw_film(
    moving: MovingMechanism,
    path: Path,
    *,
    title: str,
    rate: float,
    clim_pa: Array | None = None,
    quantity: str = STRESS,
    camera: Camera | None = None,
) -> None:
    """Film a mechanism with a camera at rest that sees the whole motion, at a rate of frames per second.

    The file is ``.mp4`` (H.264) or ``.gif``; none is left if a frame fails. The stress of the lowest and of the highest
    colour in each frame is ``clim_pa`` (n_frames, 2) [Pa]; without, there is no colour bar, whose label ``quantity`` is
    in MPa.

    Raises
    ------
    ValueError
        Suffix or limits can't be used, or a side of the picture is odd.
    """
    camera = camera or Camera(size=FILM_PIXELS)
    _require_encodable(path, camera.size)
    limits = [_NO_LIMITS] if clim_pa is None else [limits_in_megapascals(ends) for ends in clim_pa.tolist()]
    place = WITHOUT_BAR if clim_pa is None else PART
    projection = fit_mechanism(camera, moving, TILT, place)
    with open_canvas(projection, fineness=2) as canvas:
        drawn = add_mechanism(canvas, moving, limits[0], camera.colour_map)
        if camera.is_close_up:
            cover_margins(canvas, place)
        scale = None if clim_pa is None else ColourScale(canvas, drawn, quantity, limits, camera.colour_map)
        add_triad(canvas)
        clock = add_heading(canvas, title, moving.clock(len(moving.times) - 1))
        with whole_file(path) as file, _open_writer(file, rate) as writer:
            for picture in _draw_frames(canvas, drawn, clock, scale):
                writer.append_data(picture)


@dataclass
class ColourScale:
    """A film's colour scale and its bar, which is drawn anew where the limits [MPa] change from frame to frame."""

    canvas: Canvas
    drawn: DrawnMechanism
    quantity: str
    limits: list[tuple[float, float]]
    colour_map: str
    _shown: tuple[float, float] | None = None
    _bar: Sequence[vtkProp] = ()

    def show(self, frame: int) -> None:
        """Show a frame's scale; its bar marks limits that some stress under this scale exceeds."""
        limits = self.limits[frame]
        if limits == self._shown:
            return
        for prop in self._bar:
            self.canvas.plotter.renderer.RemoveViewProp(prop)
        self.drawn.set_limits(limits)
        same = [k for k, other in enumerate(self.limits) if other == limits]
        stresses = [body.stress[same] * 1e-6 for body in self.drawn.moving.bodies if body.stress is not None]
        beyond = any(s.min() < limits[0] for s in stresses), any(s.max() > limits[1] for s in stresses)
        self._bar = add_colour_bar(self.canvas, self.quantity, limits, self.colour_map, BAR, beyond=beyond)
        self._shown = limits


def draw_mechanism(
    moving: MovingMechanism,
    path: Path,
    *,
    title: str,
    clim_pa: tuple[float, float] | None = None,
    quantity: str = STRESS,
    camera: Camera | None = None,
    label: bool = False,
) -> Projection:
    """Draw a mechanism as it is in its only frame, with a label of the largest stress or without.

    Stress of the lowest and of the highest colour is in Pa, by default from 0 to the largest; the colour bar, which is
    in MPa, has the quantity's name.

    Raises
    ------
    ValueError
        The limits don't ascend.
    """
    camera = camera or Camera()
    stresses = [body.stress[0] for body in moving.bodies if body.stress is not None]
    limits = _NO_LIMITS
    if stresses:
        limits = limits_in_megapascals(stress_limits(np.concatenate(stresses)) if clim_pa is None else clim_pa)
    place = STILL if stresses else (STILL[0], STILL[1], 0.06, STILL[3])
    largest = _find_largest(camera, moving) if stresses and label else None
    projection = fit_mechanism(camera, moving, STILL_TILT, place, None if largest is None else largest.axes)
    with open_canvas(projection, fineness=2) as canvas:
        add_mechanism(canvas, moving, limits, camera.colour_map)
        if largest is not None and projection.contains(largest.point, place):
            value = f"{format_number(largest.stress * 1e-6, limits[1] - limits[0])} MPa"
            add_label(canvas, largest.point, value if largest.visible else f"{value} (on the far side)", place)
        if camera.is_close_up:
            cover_margins(canvas, place)
        if stresses:
            add_colour_bar(canvas, quantity, limits, camera.colour_map)
        add_triad(canvas)
        add_heading(canvas, title)
        canvas.save(path)
    return projection


class Largest(NamedTuple):
    """Where a mechanism's stress is largest, and the camera axes (3, 3) that show the place if any do."""

    point: Array
    stress: float
    axes: Array
    visible: bool


def _find_largest(camera: Camera, moving: MovingMechanism) -> Largest:
    """Find the largest stress of the first frame; the body that it is on may hide it, others aren't looked at."""
    bodies = [(body, body.stress[0]) for body in moving.bodies if body.stress is not None]
    body, stress = max(bodies, key=lambda pair: float(np.abs(pair[1]).max()))
    points = body.points(0)
    candidates = camera.candidate_axes(moving.around(), STILL_TILT, moving.up)
    axes, number, visible = choose_axes(candidates, points, body.surface.triangles, np.abs(stress))
    return Largest(points[number], float(stress[number]), axes, visible)


def _require_encodable(path: Path, size: tuple[int, int]) -> None:
    """Raise ``ValueError`` unless there is an encoder for the path's suffix and the picture's size."""
    if path.suffix not in (".mp4", ".gif"):
        raise ValueError(f"film {path.name}: a film's name ends in .mp4 or .gif")
    if size[0] % 2 or size[1] % 2:
        raise ValueError(f"a film of {size[0]} × {size[1]} pixels can't be encoded, both must be even")


def _draw_frames(
    canvas: Canvas, drawn: DrawnMechanism, clock: vtkTextActor, scale: ColourScale | None
) -> Iterator[NDArray[np.uint8]]:
    """Move the mechanism, set clock and colour scale frame by frame, and yield the pictures."""
    for frame in range(len(drawn.moving.times)):
        drawn.move(frame)
        if scale is not None:
            scale.show(frame)
        clock.SetInput(drawn.moving.clock(frame))
        yield canvas.picture()


def _open_writer(path: Path, rate: float) -> Any:
    """Open an encoder of ``rate`` frames per second for the path's suffix."""
    if path.suffix == ".gif":
        return iio.get_writer(path, mode="I", duration=1000 / rate, loop=0)
    return iio.get_writer(
        path,
        format="FFMPEG",
        mode="I",
        fps=rate,
        codec="libx264",
        pixelformat="yuv420p",
        quality=None,
        output_params=["-preset", "veryfast", "-crf", "17"],
        macro_block_size=2,
    )
