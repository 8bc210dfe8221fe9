"""A film of a part's stress in motion."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import imageio.v2 as iio
import numpy as np

from pipeline.core.arrays import Array, require_shape
from pipeline.core.files import whole_file
from pipeline.render.annotations import add_colour_bar, add_heading, add_text
from pipeline.render.camera import Look
from pipeline.render.canvas import add_body, stage
from pipeline.render.pictures import STRESS, clear_around, in_megapascals
from pipeline.render.surface import Surface, skin_of

PIXELS = (1280, 720)
# Motion sweeps a region about as high as wide: it gets the whole height, and the colour bar stands aside.
PART = (0.16, 0.98, 0.03, 0.88)
BAR = (0.03, 0.05, 0.15, 0.7)
TILT = (12.0, 11.0)
CLOCK = "00 000 rpm   t = 0.0000 s"  # the room that is kept for it


class Frame(NamedTuple):
    """An instant of a film.

    Attributes
    ----------
    time : float
        [s]
    points : ndarray, shape (n_points, 3)
        Positions in space [m].
    stress : ndarray, shape (n_points,)
        [Pa]
    note : str
        What is told beside the time, e.g. ``4000 rpm``.
    """

    time: float
    points: Array
    stress: Array
    note: str = ""


def draw_film(
    surface: Surface,
    frames: Iterable[tuple[float, Array, Array] | tuple[float, Array, Array, str]],
    n_frames: int,
    path: Path,
    *,
    title: str,
    bounds: Array,
    clim_pa: tuple[float, float],
    rate: float,
    quantity: str = STRESS,
    look: Look | None = None,
    hub: bool = True,
    on_frame: Callable[[], None] | None = None,
) -> None:
    """Film the stress of a moving part with a camera at rest.

    Parameters
    ----------
    surface : Surface
        The part as it is undeformed.
    frames : iterable of Frame
        Or of tuples of a frame's values; the note may be left out.
    n_frames : int
        How many frames there are.
    path : Path
        The film to write, ``.mp4`` (H.264) or ``.gif``; nothing is left there if a frame fails.
    title : str
        Heading.
    bounds : ndarray, shape (6,) or (any, 3)
        Least and largest x, y and z of the motion, in this order [m], or points about all that moves, which is tighter;
        the origin, the hub, is added.
    clim_pa : tuple of float
        Stress of the lowest and of the highest colour [Pa].
    rate : float
        Frames per second.
    quantity : str
        What the colour bar shows, in MPa.
    look : Look
        How the film is taken; width and height must be even.
    hub : bool
        Whether to mark the origin; a part around it shows where it is.
    on_frame : callable, optional
        Called after each frame.

    Raises
    ------
    ValueError
        Suffix, size or limits are of no use, or the frames' shapes or number are not as announced.
    """
    look = look or Look(size=PIXELS)
    if path.suffix not in (".mp4", ".gif"):
        raise ValueError(f"film {path.name}: a film's name ends in .mp4 or .gif")
    if look.size[0] % 2 or look.size[1] % 2:
        raise ValueError(f"a film of {look.size[0]} × {look.size[1]} pixels can't be encoded, both must be even")
    limits = in_megapascals(clim_pa)
    origin = np.zeros(3)
    reached = np.concatenate([origin[None], bounds if bounds.ndim == 2 else _corners(bounds)])
    view = look.view(look.directions(reached, TILT)[0], reached, PART)
    n_came = 0
    with stage(view, fineness=2) as canvas, whole_file(path) as part, _writer(part, rate) as writer:
        body = add_body(canvas, surface, skin_of(surface), np.zeros(len(surface.points)), limits, look.colour_map)
        clear_around(canvas, look, PART)
        add_colour_bar(canvas, quantity, limits, look.colour_map, BAR)
        clock = add_heading(canvas, title, CLOCK)
        if hub and view.holds(origin, PART):
            column, row = view.pixels(origin[None])[0] / look.size
            add_text(canvas, "●", (column, 1 - row), 1 / 60, "centre")
        for frame in frames:
            time, points, stress, note = Frame(*frame)
            require_shape("points", points, surface.points.shape)
            require_shape("stress", stress, (len(surface.points),))
            body.move(points, stress * 1e-6)
            clock.SetInput(f"{note}   t = {time:.4f} s".strip())
            writer.append_data(canvas.picture())
            n_came += 1
            if on_frame is not None:
                on_frame()
        if n_came != n_frames:
            raise ValueError(f"{n_frames} frames were announced, {n_came} came")


def _corners(bounds: Array) -> Array:
    """Return the corners (8, 3) of a box from least and largest x, y and z."""
    return np.stack(np.meshgrid(*np.reshape(bounds, (3, 2)), indexing="ij"), axis=-1).reshape(8, 3)


def _writer(path: Path, rate: float) -> Any:
    """Open a film for writing."""
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
