"""Data of a moving mechanism for the viewer of the page, which turns it and plays its motion in the browser."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fmd.core.arrays import Array, IntArray
from fmd.output.instants import choose_instants, find_worst
from fmd.output.mechanism_view import view_mechanism
from fmd.render.camera import Camera
from fmd.render.colours import FILM_RANGES, UNCOLOURED, film_limits, sample_colours, stress_limits

if TYPE_CHECKING:
    from fmd.render.moving_bodies import MovingBody, MovingMechanism, MovingShape
    from fmd.stages.pipeline import Pipeline

_COLOURS = 256
_LARGEST = 32767  # of a 16-bit number
_MOST_EDGES = 12_000  # with more, element edges are hidden at first
_MOST_FRAMES, _LEAST_FRAMES = 81, 2
_MOST_BYTES = 4_000_000  # of deformation and stress in all frames
_BYTES_A_POINT = 8  # three 16-bit displacements and a stress
_REACHED = 1.05  # of the mechanism's reach from its middle is shown at first


def collect_view(run: Pipeline, scale: float, camera: Camera) -> dict[str, Any]:
    """Collect the bodies of a run, their places and deformation over its motion, and their stress.

    The page is opened with the deformation times ``scale``, seen from the camera's direction and in its colours. The
    result is as of `describe_mechanism`, with the number of the worst instant's frame, and ``spans`` [MPa], the limits
    that the colours can have in each frame, by their names in `film_limits`.
    """
    meshed = [name for name, part in run.wholes.items() if part.is_drawn]
    first, at_worst, largest = find_worst(run, meshed) if meshed else ("", 0, 0.0)
    n_points = sum(len(run.wholes[name].surface.nodes) for name in meshed)
    n_frames = _MOST_BYTES // max(_BYTES_A_POINT * n_points, 1)
    chosen = choose_instants(run, int(np.clip(n_frames, _LEAST_FRAMES, _MOST_FRAMES)), meshed)
    chosen = np.union1d(chosen, [at_worst])
    moving = view_mechanism(run.at_instants, chosen, scale=scale)
    shown = int(np.searchsorted(chosen, at_worst))
    stresses = [body.stress for body in moving.bodies if body.stress is not None]
    stress = np.concatenate(stresses, axis=1) if stresses else np.zeros((len(chosen), 1))
    return describe_mechanism(moving, camera, scale, stress_limits(stress)) | {
        "clocks": [moving.clock(frame) for frame in range(len(chosen))],
        "spans": {span: (film_limits(stress, span) * 1e-6).tolist() for span in FILM_RANGES} if stresses else {},
        "frame": shown,
        "worst": {"body": first, "time": float(moving.times[shown]), "largest": largest * 1e-6} if meshed else None,
    }


def describe_mechanism(
    moving: MovingMechanism, camera: Camera, scale: float, limits: tuple[float, float]
) -> dict[str, Any]:
    """Describe a mechanism in all its frames as the viewer takes it: ``bodies`` and ``lines``; arrays are base64.

    Of each body: float32 ``positions`` (n, 3) of its drawn points in its frame [m], float32 ``origin`` (n_frames, 3)
    [m] and ``rotation`` (n_frames, 3, 3) of the frame, uint32 ``triangles`` and ``edges``, ``rgb`` if it has one
    colour, and its ``name``. Of one that deforms also int16 ``displacements`` (n_frames, n, 3), a unit of which is
    ``step`` [m], and of one with stress uint16 ``levels`` (n_frames, n) between the least and the largest, the
    ``limits`` [MPa]. Arrays are little-endian. The camera gives the colours and the direction at first: ``axes`` are
    its own, row by row, to the right, up and towards the viewer. ``scale`` is the deformation's when the page is
    opened, and limits are given in Pa.
    """
    around = moving.around()
    middle = (around.min(axis=0) + around.max(axis=0)) / 2
    axes = camera.candidate_axes(around, up=moving.up)[0]
    reach = np.abs((around - middle) @ axes[:2].T).max(axis=0)
    bodies = [_flexible(body, limits) for body in moving.bodies]
    n_edges = sum(len(body.surface.edges) for body in moving.bodies)
    return {
        "bodies": bodies + [_rigid(shape) for shape in moving.shapes],
        "lines": [{"points": encode(line.points, "<f4"), "rgb": _rgb(line.colour)} for line in moving.lines],
        "colours": encode(sample_colours(camera.colour_map, _COLOURS), "u1"),
        "limits": [limits[0] * 1e-6, limits[1] * 1e-6],
        "axes": axes.ravel().tolist(),
        "middle": middle.tolist(),
        "reach": (_REACHED * np.maximum(reach, 1e-9)).tolist(),
        "radius": float(np.linalg.norm(around - middle, axis=1).max()) or 1.0,
        "scale": scale,
        "showEdges": n_edges <= _MOST_EDGES,
    }


def _flexible(body: MovingBody, limits: tuple[float, float]) -> dict[str, Any]:
    """Collect a flexible body: displacements of its drawn points and its stress as 16-bit numbers."""
    from fmd.render.surface import build_skin

    skin = build_skin(body.surface)
    drawn = np.zeros(len(body.surface.points), dtype=np.int64)
    drawn[skin.source] = np.arange(len(skin.source))
    placed = _placed(body.surface.points[skin.source], skin.triangles, body) | {
        "edges": encode(drawn[body.surface.edges], "<u4"),
        "rgb": _rgb(UNCOLOURED) if body.stress is None else None,
    }
    displacements = np.stack([body.shapes @ q for q in body.coordinates])
    if largest := float(np.abs(displacements).max(initial=0.0)):
        step = largest / _LARGEST
        placed |= {"step": step, "displacements": encode(np.rint(displacements[:, skin.source] / step), "<i2")}
    if body.stress is not None:
        levels = (body.stress - limits[0]) / (limits[1] - limits[0]) * np.iinfo(np.uint16).max
        placed["levels"] = encode(np.rint(levels[:, skin.source]), "<u2")
    return placed


def _rigid(shape: MovingShape) -> dict[str, Any]:
    """Collect a rigid shape."""
    from fmd.render.surface import build_skin

    skin = build_skin(shape.surface)
    return _placed(shape.surface.points[skin.source], skin.triangles, shape) | {"edges": "", "rgb": _rgb(shape.colour)}


def _placed(points: Array, triangles: IntArray, frame: MovingBody | MovingShape) -> dict[str, Any]:
    return {
        "positions": encode(points, "<f4"),
        "triangles": encode(triangles, "<u4"),
        "origin": encode(frame.origin, "<f4"),
        "rotation": encode(frame.rotation, "<f4"),
        "name": frame.name,
    }


def _rgb(colour: str) -> list[float]:
    return [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]


def encode(values: NDArray[Any], kind: str) -> str:
    """Encode an array's bytes in base64."""
    return base64.b64encode(values.astype(kind).tobytes()).decode()
