"""Surfaces to draw: a block, a slender beam, and a propeller of three twisted blades."""

import numpy as np
import pytest

from fmd.render.surface import Surface


def box(*extents: float, divisions: tuple[int, int, int] = (6, 4, 3)) -> Surface:
    """Return the six sides of a box as triangles, with the outlines of their rectangles."""
    nodes = np.stack(np.meshgrid(*(np.arange(n + 1) for n in divisions), indexing="ij"), axis=-1)
    number = np.arange(nodes[..., 0].size).reshape(nodes.shape[:3])
    quads = []
    for axis in range(3):
        for end in (0, -1):
            side = np.take(number, end, axis)
            corners = [side[:-1, :-1], side[1:, :-1], side[1:, 1:], side[:-1, 1:]]
            outward = (axis == 1) == (end == 0)  # counter-clockwise as it is
            quads.append(np.stack(corners if outward else corners[::-1], axis=-1).reshape(-1, 4))
    used, local = np.unique(np.concatenate(quads), return_inverse=True)
    local = local.reshape(-1, 4)
    edges = np.stack([local, np.roll(local, -1, axis=1)], axis=-1).reshape(-1, 2)
    triangles = np.concatenate([local[:, :3], local[:, [0, 2, 3]]])
    points = nodes.reshape(-1, 3)[used] / divisions * extents
    return Surface(points, triangles, np.unique(np.sort(edges, axis=1), axis=0))


@pytest.fixture(scope="session")
def block() -> Surface:
    return box(0.12, 0.1, 0.08)


@pytest.fixture(scope="session")
def beam() -> Surface:
    return box(0.34, 0.025, 0.01, divisions=(24, 4, 2))


@pytest.fixture(scope="session")
def propeller() -> Surface:
    """Three blades of 0.4 m radius about z, their chord turning from 60° to 15° on the way out."""
    blade = box(0.34, 0.08, 0.008, divisions=(24, 6, 1))
    x, y, z = (blade.points - (0, 0.04, 0.004)).T
    angle = np.radians(60 - 45 * x / 0.34)
    twisted = [x + 0.06, y * np.cos(angle) - z * np.sin(angle), y * np.sin(angle) + z * np.cos(angle)]
    turns = np.radians([0, 120, 240])
    points = [
        np.column_stack(
            [
                np.cos(t) * twisted[0] - np.sin(t) * twisted[1],
                np.sin(t) * twisted[0] + np.cos(t) * twisted[1],
                twisted[2],
            ]
        )
        for t in turns
    ]
    first = len(blade.points) * np.arange(3)[:, None, None]
    return Surface(
        np.concatenate(points), (blade.triangles + first).reshape(-1, 3), (blade.edges + first).reshape(-1, 2)
    )
