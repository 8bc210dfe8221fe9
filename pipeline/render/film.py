"""A film of a part's stress in motion."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import imageio.v2 as iio
import numpy as np

from pipeline.checks import Array, require_shape
from pipeline.files import whole_file
from pipeline.render.pictures import Surface
from pipeline.render.stage import add_colour_bar, add_heading, add_part, add_text, stage
from pipeline.render.view import fitted_view, oblique_axes

PIXELS = (1280, 720)
# Motion sweeps a region about as high as wide: it gets the whole height, and the colour bar stands aside.
PART = (0.16, 0.98, 0.03, 0.88)
BAR = (0.03, 0.05, 0.15, 0.7)
TILT = (12.0, 11.0)


def draw_film(
    surface: Surface,
    frames: Iterable[tuple[float, Array, Array]],
    n_frames: int,
    path: Path,
    *,
    title: str,
    bounds: Array,
    clim_pa: tuple[float, float],
    rate: float,
    size: tuple[int, int] = PIXELS,
    on_frame: Callable[[], None] | None = None,
) -> None:
    """Film the von Mises stress of a moving part with a camera at rest.

    Parameters
    ----------
    surface : Surface
        The part; its points only tell how many there are.
    frames : iterable of (float, ndarray, ndarray)
        Time [s], positions in space (n_points, 3) [m] and von Mises stress (n_points,) [Pa].
    n_frames : int
        How many frames there are.
    path : Path
        The film to write, ``.mp4`` (H.264) or ``.gif``; nothing is left there if a frame fails.
    title : str
        Heading.
    bounds : ndarray, shape (6,)
        Least and largest x, y and z of the motion, in this order [m]; the origin, the hub, is added.
    clim_pa : tuple of float
        Stress of the lowest and of the highest colour [Pa].
    rate : float
        Frames per second.
    size : tuple of int
        Width and height [pixels], both even.
    on_frame : callable, optional
        Called after each frame.

    Raises
    ------
    ValueError
        Suffix, size or limits are of no use, or the frames' shapes or number are not as announced.
    """
    if path.suffix not in (".mp4", ".gif"):
        raise ValueError(f"film {path.name}: a film's name ends in .mp4 or .gif")
    if size[0] % 2 or size[1] % 2:
        raise ValueError(f"a film of {size[0]} × {size[1]} pixels can't be encoded, both must be even")
    if not clim_pa[0] < clim_pa[1]:
        raise ValueError(f"clim_pa = {clim_pa}: the highest colour needs a larger stress than the lowest")
    hub = np.zeros((1, 3))
    x, y, z = np.reshape(bounds, (3, 2))
    corners = np.concatenate([hub, np.array([(a, b, c) for a in x for b in y for c in z])])
    view = fitted_view(next(oblique_axes(corners, TILT)), corners, size, PART)
    limits = (clim_pa[0] * 1e-6, clim_pa[1] * 1e-6)
    n_came = 0
    with stage(view) as plotter, whole_file(path) as part, _writer(part, rate) as writer:
        faces, lines = add_part(plotter, view, surface, np.zeros(len(surface.points)), limits)
        add_colour_bar(plotter, "von Mises [MPa]", limits, BAR)
        clock = add_heading(plotter, title, " ")
        column, row = view.pixels(hub)[0] / size
        add_text(plotter, "●", (column, 1 - row), 1 / 60, "centre")
        for time, points, stress in frames:
            require_shape("points", points, surface.points.shape)
            require_shape("stress", stress, (len(surface.points),))
            faces.points = points
            lines.points = view.lifted(points)
            faces.point_data["values"] = stress * 1e-6
            clock.SetInput(f"t = {time:.4f} s")
            plotter.render()
            writer.append_data(np.asarray(plotter.screenshot(return_img=True)))
            n_came += 1
            if on_frame is not None:
                on_frame()
        if n_came != n_frames:
            raise ValueError(f"{n_frames} frames were announced, {n_came} came")


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
        quality=8,
        macro_block_size=2,
    )
