"""Projections: a part fills its place, and points in front hide those behind."""

import numpy as np
import pytest

from fmd.render.projection import PART, choose_axes, fit_projection, is_visible, oblique_axes, upright_axes
from fmd.render.surface import Surface

SIZE = (960, 540)


@pytest.mark.parametrize("name", ["block", "beam", "propeller"])
def test_a_part_fills_its_place_in_the_picture(request: pytest.FixtureRequest, name: str) -> None:
    surface: Surface = request.getfixturevalue(name)
    for axes in oblique_axes(surface.points):
        assert np.allclose(axes @ axes.T, np.eye(3), rtol=1e-7, atol=1e-12)
        assert np.linalg.det(axes) > 0
        pixels = fit_projection(axes, surface.points, SIZE).pixels(surface.points) / SIZE
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        margins = [low[0] - PART[0], PART[1] - high[0], low[1] - (1 - PART[3]), 1 - PART[2] - high[1]]
        assert min(margins) == pytest.approx(0, abs=1e-9)


def test_a_place_of_the_picture_contains_what_lies_in_it() -> None:
    """`PART` leaves 24 % of the picture's height below and 16 % above, 4 % of its width on both sides."""
    projection = fit_projection(np.eye(3), np.eye(3), SIZE)
    inside = [(0.5, 0.26), (0.5, 0.82), (0.05, 0.5), (0.95, 0.5)]
    outside = [(0.5, 0.22), (0.5, 0.86), (0.03, 0.5), (0.97, 0.5)]
    for right, up in inside + outside:
        from_middle = np.array([(right - 0.5) * SIZE[0], (up - 0.5) * SIZE[1], 0.0])
        assert projection.contains(projection.centre + projection.metres_per_pixel * from_middle, PART) == (
            (right, up) in inside
        )


def test_motion_in_the_horizontal_plane_is_looked_at_from_above() -> None:
    for extents in ((1.0, 1.0, 0.1), (1.0, 2.0, 0.1), (2.0, 1.0, 0.0)):
        axes = next(oblique_axes(np.array([[0.0, 0.0, 0.0], extents])))
        assert axes[2, 2] > 0.8


@pytest.mark.parametrize("up", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, 0.6, 0.8)])
def test_what_is_up_in_space_is_up_in_the_picture(up: tuple[float, float, float]) -> None:
    points = np.random.default_rng(1).normal(size=(50, 3)) * (1.0, 3.0, 2.0)
    for axes in upright_axes(points, np.array(up)):
        assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(axes) > 0
        right, upwards, towards = axes @ up
        assert abs(right) < 1e-12
        assert upwards > 0.9
        assert towards > 0  # seen from above


def test_planar_motion_under_gravity_is_seen_along_its_normal() -> None:
    flat = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.1]])
    axes = next(upright_axes(flat, np.array([0.0, 1.0, 0.0])))
    assert axes[2, 2] > 0.8
    assert axes[0, 0] > 0.8


def test_a_point_is_visible_unless_a_triangle_lies_before_it() -> None:
    far, near = np.array([[0.2, 0.2, 0.0]]), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    points, triangles = np.concatenate([far, near]), np.array([[1, 2, 3]])
    assert not is_visible(np.eye(3), points, triangles, 0)
    assert is_visible(np.diag([1.0, -1.0, -1.0]), points, triangles, 0)  # from below
    assert is_visible(np.eye(3), points, triangles, 1)


def test_the_first_axes_that_show_the_largest_value_are_chosen() -> None:
    points = np.array([[0.2, 0.2, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    triangles, values = np.array([[1, 2, 3]]), np.array([5.0, 1.0, 2.0, 3.0])
    above, below = np.eye(3), np.diag([1.0, -1.0, -1.0])
    axes, number, visible = choose_axes([above, below], points, triangles, values)
    assert (axes is below, number, visible) == (True, 0, True)
    axes, number, visible = choose_axes([above], points, triangles, values)
    assert (axes is above, number, visible) == (True, 0, False)
