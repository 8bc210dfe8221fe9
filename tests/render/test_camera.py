"""Cameras: directions, close-ups and what is refused."""

import numpy as np
import pytest

from fmd.render.camera import Camera
from fmd.render.projection import PART, fit_projection, oblique_axes
from fmd.render.surface import Surface

SIZE = (960, 540)


@pytest.mark.parametrize(
    ("angles", "right", "up"),
    [
        ((0.0, 0.0), (0, 1, 0), (0, 0, 1)),
        ((-90.0, 0.0), (1, 0, 0), (0, 0, 1)),
        ((-90.0, 90.0), (1, 0, 0), (0, 1, 0)),
        ((180.0, -90.0), (0, -1, 0), (-1, 0, 0)),
    ],
)
def test_a_camera_stands_at_its_azimuth_and_elevation(
    angles: tuple[float, float], right: tuple[int, ...], up: tuple[int, ...]
) -> None:
    (axes,) = Camera(angles).candidate_axes(np.eye(3))
    assert np.allclose(axes, [right, up, np.cross(right, up)], rtol=1e-7, atol=1e-15)


def test_a_camera_by_default_is_oblique_and_holds_the_whole_part(block: Surface) -> None:
    camera = Camera(size=SIZE)
    axes = camera.candidate_axes(block.points)
    assert np.array_equal(axes, list(oblique_axes(block.points)))
    expected = fit_projection(axes[0], block.points, SIZE)
    found = camera.projection(axes[0], block.points)
    assert np.array_equal(found.pixels(block.points), expected.pixels(block.points))


@pytest.mark.parametrize("zoom", [0.5, 1.0, 3.0])
def test_zoom_keeps_the_part_in_the_middle_of_its_place(propeller: Surface, zoom: float) -> None:
    axes = Camera((-60, 30)).candidate_axes(propeller.points)[0]
    shown = Camera(size=SIZE, zoom=zoom).projection(axes, propeller.points).pixels(propeller.points)
    whole = fit_projection(axes, propeller.points, SIZE).pixels(propeller.points)
    assert np.allclose(np.ptp(shown, axis=0), zoom * np.ptp(whole, axis=0), rtol=1e-7, atol=0)
    for end in (shown.min(axis=0) + shown.max(axis=0), whole.min(axis=0) + whole.max(axis=0)):
        assert np.allclose(end / 2 / SIZE, [(PART[0] + PART[1]) / 2, 1 - (PART[2] + PART[3]) / 2])


def test_a_close_up_has_its_focus_in_the_middle_and_its_extent_over_the_width(propeller: Surface) -> None:
    camera = Camera((20, 40), size=SIZE, focus=(0.3, 0.01, 0.0), extent=0.02)
    projection = camera.projection(camera.candidate_axes(propeller.points)[0], propeller.points)
    assert np.allclose(
        projection.pixels(np.array([camera.focus]))[0] / SIZE, [0.5, 1 - (PART[2] + PART[3]) / 2], rtol=1e-7, atol=0
    )
    assert projection.metres_per_pixel == pytest.approx(0.02 / SIZE[0])
    depth = (propeller.points - projection.centre) @ projection.axes[2]
    assert np.abs(depth).max() < projection.half_depth  # what is far before or behind the focus is drawn too


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"colour_map": "virids"}, "there is no colour map 'virids'; did you mean viridis"),
        ({"colour_map": "?"}, r"there is no colour map '\?'; e\.g\. light turbo"),
        ({"angles": (0.0, 91.0)}, "elevation from -90 to 90"),
        ({"angles": (np.nan, 0.0)}, "expected an azimuth"),
        ({"zoom": 0.0}, "zoom = 0.0 must be positive"),
        ({"size": (0, 10)}, "width and height must be positive"),
        ({"extent": -1.0}, "extent = -1.0 must be positive"),
        ({"focus": (0.0, np.inf, 0.0)}, "expected three coordinates"),
    ],
)
def test_values_out_of_range_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Camera(**changes)  # type: ignore[arg-type]
