"""Surfaces: creases, normals and outlines."""

import numpy as np
import pytest

from fmd.render.surface import Surface, area_normals, build_skin


def test_light_breaks_at_the_edges_of_a_block_and_nowhere_else(block: Surface) -> None:
    skin = build_skin(block)
    areas = area_normals(block.points, block.triangles)
    normals = skin.normals(areas)
    assert np.allclose(np.abs(normals).max(axis=1), 1.0)  # along an axis, up to the edges
    outward = (block.points - block.points.mean(axis=0))[skin.source]
    assert np.all(np.einsum("pi,pi->p", normals, outward) > 0)
    sharp = block.points[skin.sides[skin.is_sharp]]
    on_sides = np.isclose(sharp, 0) | np.isclose(sharp, block.points.max(axis=0))
    assert np.all(on_sides.all(axis=1).sum(axis=1) >= 2)
    assert len(sharp) == 4 * (6 + 4 + 3)


def test_normals_of_a_cylinder_are_radial() -> None:
    n, m = 48, 4
    angle = np.repeat(2 * np.pi * np.arange(n) / n, m)
    points = np.stack([np.cos(angle), np.sin(angle), np.tile(np.arange(m), n)], axis=1)
    k, low = np.meshgrid(np.arange(n), np.arange(m - 1), indexing="ij")
    a, b = (k * m + low).ravel(), ((k + 1) % n * m + low).ravel()
    triangles = np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])
    surface = Surface(points, triangles, np.empty((0, 2), dtype=np.int64))
    skin = build_skin(surface)
    assert len(skin.source) == len(points)
    normals = skin.normals(area_normals(points, triangles))
    radial = points[skin.source] * (1, 1, 0)
    assert np.allclose(normals, radial, rtol=1e-7, atol=2 * np.pi / n)
    # Seen from the side its form are the two rims that the viewer sees, and both ends.
    lines = skin.form_lines(area_normals(points, triangles), np.array([1.0, 0.1, 0.0]))
    upright = lines[np.ptp(points[lines][:, :, 2], axis=1) > 0]
    assert len(upright) == 2 * (m - 1)


def test_edges_that_no_triangle_has_are_refused(block: Surface) -> None:
    edges = np.array([[0, int(np.argmax(block.points.sum(axis=1)))]])
    with pytest.raises(ValueError, match="edges must be sides of triangles"):
        build_skin(Surface(block.points, block.triangles, edges))
