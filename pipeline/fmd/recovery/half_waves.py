"""Lengths of the half waves in which shapes bend a shell, over its thickness."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.recovery import BENDS

if TYPE_CHECKING:
    from fmd.fem.space import Discretisation


def half_waves(space: Discretisation, shapes: Array) -> Array:
    """Return the half wave length over the mean thickness of each shape (n_nodes, 3, n), infinite of those in plane.

    It is π times the root of ``∫ w² dA / ∫ |∇w|² dA``, w along the normal: a of the half sine of a plate's width a
    that bends one way, a/√2 of a square plate that bends both ways alike.
    """
    nodes = space.element_nodes
    lower, upper = np.split(space.x[nodes], 2, axis=1)
    moved = np.mean(np.split(shapes[nodes], 2, axis=1), axis=0)
    way = (upper - lower).mean(axis=1)
    thickness = np.linalg.norm(way, axis=1)
    w = np.einsum("ea,ekan->ekn", way / thickness[:, None], moved)
    x = (lower + upper) / 2
    a, b = x[:, 2] - x[:, 0], x[:, -1] - x[:, 1]
    area = np.linalg.norm(np.cross(a, b), axis=1)  # twice that of triangles alike; all elements are of one kind
    if x.shape[1] == 3:
        turned = b[:, :, None] * (w[:, None, 2] - w[:, None, 0]) - a[:, :, None] * (w[:, None, 2] - w[:, None, 1])
        slope2 = (turned**2).sum(axis=1) / area[:, None] ** 2
    else:
        length = np.linalg.norm(np.roll(x, -1, axis=1) - x, axis=2)
        slope2 = 2 * (((np.roll(w, -1, axis=1) - w) / length[:, :, None]) ** 2).mean(axis=1)
    across, steep, whole = (area @ each for each in ((w**2).mean(axis=1), slope2, (moved**2).sum(axis=2).mean(axis=1)))
    waves = np.pi * np.sqrt(across / np.where(steep > 0, steep, np.inf)) * area.sum() / (area @ thickness)
    return np.asarray(np.where((steep > 0) & (across > BENDS * whole), waves, np.inf))
