"""Simple solids: by the divergence theorem their triangles, seen from outside, enclose the volume."""

import numpy as np
import pytest

from fmd.render.solids import make_ball, make_box, make_cylinder, make_plate, make_pyramid
from fmd.render.surface import Surface, build_skin

ALONG = np.array([0.3, -0.2, 0.6])
SQUARE = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]])
SIDES = 40 / 2 * np.sin(2 * np.pi / 40)  # area of a regular polygon of 40 corners on the unit circle


@pytest.mark.parametrize(
    ("surface", "volume", "tolerance"),
    [
        (make_box(np.array([1.0, 2.0, 3.0]), np.array([4.0, 0.0, 0.0])), 6.0, 1e-12),
        (make_cylinder(np.ones(3), np.ones(3) + ALONG, 0.1), SIDES * 0.01 * np.linalg.norm(ALONG), 1e-12),
        (make_ball(np.array([1.0, 2.0, 3.0]), 0.5), np.pi / 6, 0.05),
        (make_plate(SQUARE, 0.1), 0.2, 1e-12),
        (make_plate(SQUARE[::-1], 0.1), 0.2, 1e-12),
        (make_pyramid(np.ones(3), ALONG, 0.3, 0.2), 0.3 * 0.04 / 3, 1e-12),
    ],
)
def test_a_solid_is_closed_and_has_its_volume(surface: Surface, volume: float, tolerance: float) -> None:
    a, b, c = (surface.points[surface.triangles[:, k]] for k in range(3))
    assert np.einsum("ti,ti->", a, np.cross(b, c)) / 6 == pytest.approx(volume, rel=tolerance)
    between = build_skin(surface).between
    assert (between[:, 0] != between[:, 1]).all()  # no border
