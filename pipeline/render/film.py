"""A film of a part's stress in motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import imageio.v2 as iio
import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkTextActor

from pipeline.core.arrays import Array, require_shape
from pipeline.core.files import whole_file
from pipeline.render.annotations import add_colour_bar, add_heading, add_text, cover_margins
from pipeline.render.camera import FILM_PIXELS, Camera
from pipeline.render.canvas import Canvas, DrawnPart, add_part_by_values, open_canvas
from pipeline.render.colours import STRESS, limits_in_megapascals
from pipeline.render.film_frames import FilmedMotion, FilmFrame
from pipeline.render.surface import Surface, build_skin

# Motion sweeps a region about as high as wide: the part gets the whole height, and the colour bar stands beside it.
PART = (0.16, 0.98, 0.03, 0.88)
BAR = (0.03, 0.05, 0.15, 0.7)
TILT = (12.0, 11.0)
CLOCK = "00 000 rpm   t = 0.0000 s"  # text as long as any beside the title
ORIGIN = np.zeros(3)


def film_motion(
    surface: Surface,
    motion: FilmedMotion,
    path: Path,
    *,
    title: str,
    clim_pa: tuple[float, float],
    rate: float,
    quantity: str = STRESS,
    camera: Camera | None = None,
    hub: bool = True,
) -> None:
    """Film a part whose frames are computed from its motion, as `draw_film` does, whose arguments these are."""
    draw_film(
        surface,
        motion.frames(),
        path,
        title=title,
        bounds=motion.around(),
        clim_pa=clim_pa,
        rate=rate,
        quantity=quantity,
        camera=camera,
        hub=hub,
    )


def draw_film(
    surface: Surface,
    frames: Iterable[FilmFrame],
    path: Path,
    *,
    title: str,
    bounds: Array,
    clim_pa: tuple[float, float],
    rate: float,
    quantity: str = STRESS,
    camera: Camera | None = None,
    hub: bool = True,
) -> None:
    """Film the stress of a moving part with a camera at rest.

    Parameters
    ----------
    surface : Surface
        The undeformed part.
    frames : iterable of FilmFrame
        Computed one after the other.
    path : Path
        The film, ``.mp4`` (H.264) or ``.gif``; no file is left if a frame fails.
    title : str
        Heading.
    bounds : ndarray, shape (n, 3)
        Points around the part in motion [m]; the origin, the hub, is added.
    clim_pa : tuple of float
        Stress of the lowest and of the highest colour [Pa].
    rate : float
        Frames per second.
    quantity : str
        Label of the colour bar, which is in MPa.
    camera : Camera, optional
    hub : bool
        Mark the origin; a part all around it needs no mark.

    Raises
    ------
    ValueError
        Suffix or limits can't be used, a side of the picture is odd, or a frame has another shape than the part.
    """
    camera = camera or Camera(size=FILM_PIXELS)
    _require_encodable(path, camera.size)
    limits = limits_in_megapascals(clim_pa)
    around = np.concatenate([ORIGIN[None], bounds])
    projection = camera.projection(camera.candidate_axes(around, TILT)[0], around, PART)
    with open_canvas(projection, fineness=2) as canvas:
        skin, no_stress = build_skin(surface), np.zeros(len(surface.points))
        part = add_part_by_values(canvas, surface, skin, no_stress, limits, camera.colour_map)
        if camera.is_close_up:
            cover_margins(canvas, PART)
        add_colour_bar(canvas, quantity, limits, camera.colour_map, BAR)
        clock = add_heading(canvas, title, CLOCK)
        if hub and projection.contains(ORIGIN, PART):
            column, row = projection.pixels(ORIGIN[None])[0] / camera.size
            add_text(canvas, "●", (column, 1 - row), 1 / 60, "centre")
        with whole_file(path) as file, _open_writer(file, rate) as writer:
            for picture in _draw_frames(canvas, part, clock, frames, surface.points.shape):
                writer.append_data(picture)


def _require_encodable(path: Path, size: tuple[int, int]) -> None:
    """Raise ``ValueError`` unless there is an encoder for the path's suffix and the picture's size."""
    if path.suffix not in (".mp4", ".gif"):
        raise ValueError(f"film {path.name}: a film's name ends in .mp4 or .gif")
    if size[0] % 2 or size[1] % 2:
        raise ValueError(f"a film of {size[0]} × {size[1]} pixels can't be encoded, both must be even")


def _draw_frames(
    canvas: Canvas, part: DrawnPart, clock: vtkTextActor, frames: Iterable[FilmFrame], shape: tuple[int, ...]
) -> Iterator[NDArray[np.uint8]]:
    """Move the part and set the clock frame by frame, and yield the pictures."""
    for frame in frames:
        require_shape("points", frame.points, shape)
        require_shape("stress", frame.stress, shape[:1])
        part.move(frame.points, frame.stress * 1e-6)
        clock.SetInput(f"{frame.note}   t = {frame.time:.4f} s".strip())
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
