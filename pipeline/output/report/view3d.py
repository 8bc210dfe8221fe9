"""Data of a stressed part for the viewer of the page, which turns it in the browser."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.render.camera import Camera
from pipeline.render.colours import sample_colours, stress_limits
from pipeline.render.projection import choose_axes

if TYPE_CHECKING:
    from pipeline.stages.pipeline import Pipeline

_COLOURS = 256
_MOST_EDGES = 12_000  # with more, element edges are hidden at first


def collect_view(run: Pipeline, body: str, scale: float) -> dict[str, Any]:
    """Collect shape, deformation and stress of a body at the instant of its largest von Mises stress.

    Parameters
    ----------
    scale : float
        Factor on the deformation when the page is opened.

    Returns
    -------
    dict
        Little-endian arrays in base64: float32 ``positions`` and ``displacements`` (n, 3) [m] and ``values`` (n,)
        [MPa] of the drawn points, uint32 ``triangles`` and ``edges``, uint8 ``colours`` (256, 3); the rest are numbers:
        ``axes`` are the camera's, row by row, to the right, up and towards the viewer.
    """
    from pipeline.render.surface import Surface, build_skin

    camera = Camera()
    topology, history = run.wholes[body].surface, run.stress_of(body)
    time, _, worst = history.worst()
    frame = int(np.searchsorted(history.times, time))
    surface = Surface(run.node_positions(body)[topology.nodes], topology.triangles, topology.edges)
    displacement = run.deform(body, [frame], history.nodes)[0]
    stress = history.measure_at(np.array([frame]))[0]
    moved = surface.points + scale * displacement
    axes, _, _ = choose_axes(camera.candidate_axes(moved), moved, surface.triangles, stress)
    skin = build_skin(surface)
    drawn = np.zeros(len(surface.points), dtype=np.int64)
    drawn[skin.source] = np.arange(len(skin.source))
    middle = (surface.points.min(axis=0) + surface.points.max(axis=0)) / 2
    low, high = stress_limits(stress)
    return {
        "positions": _encode(surface.points[skin.source] - middle, "<f4"),
        "displacements": _encode(displacement[skin.source], "<f4"),
        "values": _encode(stress[skin.source] * 1e-6, "<f4"),
        "triangles": _encode(skin.triangles, "<u4"),
        "edges": _encode(drawn[surface.edges], "<u4"),
        "colours": _encode(sample_colours(camera.colour_map, _COLOURS), "u1"),
        "limits": [low * 1e-6, high * 1e-6],
        "axes": axes.ravel().tolist(),
        "radius": float(np.linalg.norm(surface.points - middle, axis=1).max()),
        "scale": scale,
        "showEdges": len(surface.edges) <= _MOST_EDGES,
        "time": time,
        "largest": worst * 1e-6,
    }


def _encode(values: NDArray[Any], kind: str) -> str:
    """Encode an array's bytes in base64."""
    return base64.b64encode(values.astype(kind).tobytes()).decode()
