import numpy as np
import pytest

from pipeline.render.annotations import legend_rows, nearest_free, number, text_width
from pipeline.render.camera import Look
from pipeline.render.canvas import outline_for
from pipeline.render.projection import PART, fitted_view, oblique_axes
from pipeline.render.surface import Surface, doubled_areas, skin_of

SIZE = (960, 540)


@pytest.mark.parametrize("name", ["block", "beam", "propeller"])
def test_a_part_fills_its_place_in_the_picture(request: pytest.FixtureRequest, name: str) -> None:
    surface: Surface = request.getfixturevalue(name)
    for axes in oblique_axes(surface.points):
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(axes) > 0
        pixels = fitted_view(axes, surface.points, SIZE).pixels(surface.points) / SIZE
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        margins = [low[0] - PART[0], PART[1] - high[0], low[1] - (1 - PART[3]), 1 - PART[2] - high[1]]
        assert min(margins) == pytest.approx(0, abs=1e-9)


def test_motion_in_the_horizontal_plane_is_looked_at_from_above() -> None:
    for extents in ((1.0, 1.0, 0.1), (1.0, 2.0, 0.1), (2.0, 1.0, 0.0)):
        axes = next(oblique_axes(np.array([[0.0, 0.0, 0.0], extents])))
        assert axes[2, 2] > 0.8


@pytest.mark.parametrize(
    ("camera", "right", "up"),
    [
        ((0.0, 0.0), (0, 1, 0), (0, 0, 1)),
        ((-90.0, 0.0), (1, 0, 0), (0, 0, 1)),
        ((-90.0, 90.0), (1, 0, 0), (0, 1, 0)),
        ((180.0, -90.0), (0, -1, 0), (-1, 0, 0)),
    ],
)
def test_a_camera_stands_at_its_azimuth_and_elevation(
    camera: tuple[float, float], right: tuple[int, ...], up: tuple[int, ...]
) -> None:
    (axes,) = Look(camera).directions(np.eye(3))
    np.testing.assert_allclose(axes, [right, up, np.cross(right, up)], atol=1e-15)


def test_a_look_without_wishes_is_the_automatic_view(block: Surface) -> None:
    look = Look(size=SIZE)
    axes = look.directions(block.points)
    np.testing.assert_array_equal(axes, list(oblique_axes(block.points)))
    expected = fitted_view(axes[0], block.points, SIZE)
    found = look.view(axes[0], block.points)
    np.testing.assert_array_equal(found.pixels(block.points), expected.pixels(block.points))


@pytest.mark.parametrize("zoom", [0.5, 1.0, 3.0])
def test_zoom_keeps_the_part_in_the_middle_of_its_place(propeller: Surface, zoom: float) -> None:
    axes = Look((-60, 30)).directions(propeller.points)[0]
    shown = Look(size=SIZE, zoom=zoom).view(axes, propeller.points).pixels(propeller.points)
    whole = fitted_view(axes, propeller.points, SIZE).pixels(propeller.points)
    np.testing.assert_allclose(np.ptp(shown, axis=0), zoom * np.ptp(whole, axis=0))
    for end in (shown.min(axis=0) + shown.max(axis=0), whole.min(axis=0) + whole.max(axis=0)):
        np.testing.assert_allclose(end / 2 / SIZE, [(PART[0] + PART[1]) / 2, 1 - (PART[2] + PART[3]) / 2])


def test_a_close_up_has_its_focus_in_the_middle_and_its_extent_over_the_width(propeller: Surface) -> None:
    look = Look((20, 40), size=SIZE, focus=(0.3, 0.01, 0.0), extent=0.02)
    view = look.view(look.directions(propeller.points)[0], propeller.points)
    np.testing.assert_allclose(view.pixels(np.array([look.focus]))[0] / SIZE, [0.5, 1 - (PART[2] + PART[3]) / 2])
    assert view.metres_per_pixel == pytest.approx(0.02 / SIZE[0])
    depth = (propeller.points - view.centre) @ view.axes[2]
    assert np.abs(depth).max() < view.reach  # what is far before or behind the focus is drawn too


@pytest.mark.parametrize(
    ("wish", "message"),
    [
        ({"colour_map": "virids"}, "there is no colour map 'virids'; did you mean viridis"),
        ({"colour_map": "?"}, r"there is no colour map '\?'; e\.g\. turbo"),
        ({"camera": (0.0, 91.0)}, "elevation from -90 to 90"),
        ({"camera": (np.nan, 0.0)}, "expected an azimuth"),
        ({"zoom": 0.0}, "zoom = 0.0 must be positive"),
        ({"size": (0, 10)}, "width and height must be positive"),
        ({"extent": -1.0}, "extent = -1.0 must be positive"),
        ({"focus": (0.0, np.inf, 0.0)}, "expected three coordinates"),
    ],
)
def test_a_look_that_can_not_be_had_is_refused(wish: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Look(**wish)  # type: ignore[arg-type]


def test_light_breaks_at_the_edges_of_a_block_and_nowhere_else(block: Surface) -> None:
    skin = skin_of(block)
    areas = doubled_areas(block.points, block.triangles)
    normals = skin.normals(areas)
    np.testing.assert_allclose(np.abs(normals).max(axis=1), 1.0)  # along an axis, up to the edges
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
    skin = skin_of(surface)
    assert len(skin.source) == len(points)
    normals = skin.normals(doubled_areas(points, triangles))
    radial = points[skin.source] * (1, 1, 0)
    np.testing.assert_allclose(normals, radial, atol=2 * np.pi / n)
    # Seen from the side its form are the two rims that the viewer sees, and both ends.
    lines = skin.form_lines(doubled_areas(points, triangles), np.array([1.0, 0.1, 0.0]))
    upright = lines[np.ptp(points[lines][:, :, 2], axis=1) > 0]
    assert len(upright) == 2 * (m - 1)


def test_edges_that_no_triangle_has_are_refused(block: Surface) -> None:
    edges = np.array([[0, int(np.argmax(block.points.sum(axis=1)))]])
    with pytest.raises(ValueError, match="edges must be sides of triangles"):
        skin_of(Surface(block.points, block.triangles, edges))


def test_lines_that_would_smear_a_picture_are_left_out(block: Surface) -> None:
    assert block.cell == pytest.approx(0.0235, rel=0.1)  # 20 mm × 25 mm × 26.7 mm
    opacities = []
    for pixels in (4000, 400, 100, 40):
        axes = next(oblique_axes(block.points))
        outline = outline_for(block, fitted_view(axes, block.points, (pixels, pixels)))
        opacities.append(outline.opacity)
        assert outline.elements == (pixels >= 100)
    assert opacities[0] == opacities[1] > opacities[2]


def test_a_label_stands_in_the_nearest_free_box() -> None:
    picture = np.full((300, 400, 3), 255, dtype=np.uint8)
    picture[100:200, 100:300] = 0
    half, place = np.array([40.0, 10.0]), (0.0, 1.0, 0.0, 1.0)
    column, row = nearest_free(picture, np.array([200.0, 120.0]), half, place)
    assert (column, row) == pytest.approx((200, 90), abs=4)
    picture[:] = 0
    column, row = nearest_free(picture, np.array([200.0, 20.0]), half, place)
    assert (column, row) == (200, 10)


def test_a_legend_takes_as_many_rows_as_it_needs() -> None:
    names = [f"part {k} (1,980 elements)" for k in range(7)]
    rows = legend_rows(names, SIZE)
    assert [k for row in rows for k, _ in row] == list(range(7))
    assert len(rows) > 1
    for row in rows:
        k, left = row[-1]
        assert row[0][1] > 0
        assert left + text_width(names[k], 1 / 36, SIZE) < 1
    assert len(legend_rows(names[:1], SIZE)) == 1


def test_numbers_beside_a_bar_are_short() -> None:
    assert [number(value, 300.0) for value in (-150.4, 1e-15, 20.0)] == ["−150", "0", "20"]
