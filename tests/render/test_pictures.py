from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from fmd.render.annotations import BAR
from fmd.render.camera import Camera
from fmd.render.colours import sample_colours
from fmd.render.pictures import PART_COLOURS, draw_mesh, draw_mode, draw_stress
from fmd.render.projection import Projection, is_visible
from fmd.render.surface import Surface

SIZE = (960, 540)


def distance_to_top_colour(picture: np.ndarray, pixel: np.ndarray) -> float:
    """How far the colours around a pixel are from the upper end of the colour bar, at best, of 255."""
    height, width = picture.shape[:2]
    top = picture[round(height * (1 - (BAR[2] + BAR[3]) / 2)), round(width * BAR[1]) - 2, :3].astype(float)
    assert top == pytest.approx([122, 4, 3], abs=6)  # turbo's dark red
    column, row = np.round(pixel).astype(int)
    around = picture[row - 3 : row + 4, column - 3 : column + 4, :3].astype(float)
    return float(np.abs(around - top).max(axis=-1).min())


@pytest.mark.parametrize("corner", [(0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 0)])
def test_the_hottest_node_is_seen_in_the_top_colour_wherever_it_is(
    tmp_path: Path, block: Surface, corner: tuple[int, ...]
) -> None:
    distance = np.linalg.norm(block.points - corner * block.points.max(axis=0), axis=1)
    displacement = np.zeros_like(block.points)
    path = tmp_path / "stress.png"
    projection = draw_stress(block, displacement, 3e8 - 2e9 * distance, path, title="Block", camera=Camera(size=SIZE))
    picture = iio.imread(path)
    hottest, coldest = projection.pixels(block.points[[int(np.argmin(distance)), int(np.argmax(distance))]])
    assert distance_to_top_colour(picture, hottest) < 37  # a face turned from the light is up to 0.3 darker
    assert distance_to_top_colour(picture, coldest) > 60


def test_a_stress_picture_has_its_size_and_tells_the_factor_on_the_deformation(tmp_path: Path, beam: Surface) -> None:
    displacement = beam.points[:, :1] ** 2 * (0, 0.03, 0)
    stress = 1e6 * (1 - beam.points[:, 0])
    notes = []
    for scale in (1.0, 10.0):
        path = tmp_path / f"stress-{scale}.png"
        draw_stress(beam, displacement, stress, path, title="Beam", scale=scale, camera=Camera(size=SIZE))
        picture = iio.imread(path)
        assert picture.shape[:2] == SIZE[::-1]
        assert picture[:54, :300, :3].min() < 80  # the title
        notes.append(picture[:54, 700:, :3].min())
    assert notes[0] == 255
    assert notes[1] < 80


def test_a_part_without_stress_is_drawn_too(tmp_path: Path, block: Surface) -> None:
    zero = np.zeros_like(block.points)
    draw_stress(block, zero, zero[:, 0], tmp_path / "cold.png", title="Cold", camera=Camera(size=SIZE))
    assert iio.imread(tmp_path / "cold.png").std() > 0


@pytest.mark.parametrize(("given", "amplitude"), [({}, 0.08), ({"scale": 3.0}, 0.24)])
def test_a_mode_is_drawn_with_an_amplitude_of_eight_percent_times_its_scale(
    tmp_path: Path, beam: Surface, given: dict[str, float], amplitude: float
) -> None:
    displacement = -3.0 * beam.points[:, :1] ** 2 * (0, 1, 0)
    path = tmp_path / "mode.png"
    projection = draw_mode(beam, displacement, path, title="Mode 1 · 131.0 Hz", camera=Camera(size=SIZE), **given)
    picture = iio.imread(path)
    tip = beam.points[beam.points[:, 0] > 0.339]
    pixels = projection.pixels(tip - (0, amplitude * 0.34, 0))
    assert picture.shape[:2] == SIZE[::-1]
    assert min(distance_to_top_colour(picture, pixel) for pixel in pixels) < 30
    assert picture[:54, :300, :3].min() < 80  # the title


def test_arrays_that_do_not_fit_are_refused(tmp_path: Path, block: Surface) -> None:
    path = tmp_path / "picture.png"
    zero = np.zeros_like(block.points)
    with pytest.raises(ValueError, match="displacement is zero everywhere"):
        draw_mode(block, zero, path, title="")
    with pytest.raises(ValueError, match="displacement has shape"):
        draw_mode(block, zero[1:], path, title="")
    with pytest.raises(ValueError, match="stress has shape"):
        draw_stress(block, zero, zero[1:, 0], path, title="")
    with pytest.raises(ValueError, match="triangles name points beyond the 3 that there are"):
        Surface(np.zeros((3, 3)), np.array([[0, 1, 3]]), np.empty((0, 2), dtype=np.int64))
    assert not list(tmp_path.iterdir())


def test_an_error_while_writing_a_picture_leaves_nothing(
    tmp_path: Path, block: Surface, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(path: Path, _: object) -> None:
        path.write_text("half")
        raise OSError("disk full")

    monkeypatch.setattr(iio, "imwrite", fail)
    with pytest.raises(OSError, match="disk full"):
        draw_mode(block, block.points, tmp_path / "mode.png", title="", camera=Camera(size=SIZE))
    assert not list(tmp_path.iterdir())


def distance_to_bar(picture: np.ndarray, colours: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """How far a pixel's colour, at any brightness, is from colours (n, 3): angles between them [rad]."""
    column, row = np.round(pixel).astype(int)
    colour = picture[row, column, :3].astype(float)
    cosine = colours @ colour / np.linalg.norm(colours, axis=1) / np.linalg.norm(colour)
    return np.arccos(np.clip(cosine, -1, 1))


def test_colours_of_a_twisted_blade_are_found_on_the_bar_at_its_stress(tmp_path: Path, propeller: Surface) -> None:
    stress = 1e8 * np.linalg.norm(propeller.points[:, :2], axis=1)
    limits = (0.0, float(stress.max()))
    path = tmp_path / "stress.png"
    still = np.zeros_like(propeller.points)
    projection = draw_stress(propeller, still, stress, path, title="", camera=Camera(angles=(-60, 40), size=SIZE))
    picture = iio.imread(path)
    scale = sample_colours("light turbo", 256).astype(float)
    faces = propeller.points[propeller.triangles]
    seen = [k for k in range(0, len(faces), 7) if sees(projection, propeller, k)]
    shares = []
    for k in seen:
        away = distance_to_bar(picture, scale, projection.pixels(faces[k].mean(axis=0)[None])[0])
        expected = round(255 * stress[propeller.triangles[k]].mean() / limits[1])
        shares.append(away[max(0, expected - 4) : expected + 5].min())
    assert len(seen) > 40
    assert np.quantile(shares, 0.9) < 0.06


def sees(projection: Projection, surface: Surface, triangle: int) -> bool:
    """Whether a triangle is large in a picture and looks at the viewer, nothing before it."""
    corners = surface.triangles[triangle]
    a, b, c = projection.pixels(surface.points[corners])
    twice = (b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]
    return twice < -60 and all(is_visible(projection.axes, surface.points, surface.triangles, k) for k in corners)


@pytest.mark.parametrize("sign", [1, -1])
def test_of_a_component_of_stress_the_largest_absolute_value_is_marked(
    tmp_path: Path, block: Surface, sign: int
) -> None:
    stress = sign * (2e8 - 3e9 * block.points[:, 0])
    path = tmp_path / "stress.png"
    projection = draw_stress(
        block, np.zeros_like(block.points), stress, path, title="", quantity="σ_xx [MPa]", camera=Camera(size=SIZE)
    )
    hottest = projection.pixels(block.points[block.points[:, 0] == 0])
    picture = iio.imread(path)[..., :3].astype(int)
    ink = np.argwhere(np.all(picture[: round(0.76 * SIZE[1])] < 40, axis=-1))[:, ::-1]
    away = np.linalg.norm(ink[:, None] - hottest, axis=2)
    assert away.min(axis=0).min() < 1.5 * SIZE[1] / 100


def test_limits_that_do_not_ascend_are_refused(tmp_path: Path, block: Surface) -> None:
    zero = np.zeros_like(block.points)
    with pytest.raises(ValueError, match="the highest colour needs a larger stress"):
        draw_stress(block, zero, zero[:, 0], tmp_path / "no.png", title="", clim_pa=(1.0, 1.0))


def test_a_mesh_is_drawn_in_as_many_colours_as_it_has_parts(tmp_path: Path, propeller: Surface) -> None:
    part = np.repeat([0, 1, 2], len(propeller.triangles) // 3)
    names = ["first (144 elements)", "second (144 elements)", "third (144 elements)"]
    projection = draw_mesh(
        propeller, part, names, tmp_path / "mesh.png", title="Mesh", camera=Camera((-60, 40), size=SIZE)
    )
    picture = iio.imread(tmp_path / "mesh.png")[..., :3].astype(float)
    for number, colour in enumerate(PART_COLOURS[:3]):
        rgb = 255 * np.array(to_rgb(colour))
        faces = propeller.triangles[part == number]
        centres = propeller.points[faces[::5]].mean(axis=1)
        columns, rows = np.round(projection.pixels(centres)).astype(int).T
        shown = picture[rows, columns]
        cosine = shown @ rgb / np.linalg.norm(shown, axis=1) / np.linalg.norm(rgb)
        assert np.quantile(np.arccos(np.clip(cosine, -1, 1)), 0.25) < 0.05
        assert np.any(np.all(np.abs(picture[-80:] - rgb) < 3, axis=-1))  # its square in the legend


def test_a_close_up_leaves_title_and_legend_free(tmp_path: Path, propeller: Surface) -> None:
    part = np.zeros(len(propeller.triangles), dtype=np.int64)
    camera = Camera((-60, 40), focus=(0.2, 0.0, 0.0), extent=0.05, size=SIZE)
    projection = draw_mesh(propeller, part, ["blade"], tmp_path / "mesh.png", title="", camera=camera)
    picture = iio.imread(tmp_path / "mesh.png")
    assert projection.metres_per_pixel * SIZE[0] == pytest.approx(0.05)
    assert picture[: round(0.12 * SIZE[1])].min() == 255
    assert picture[round(0.2 * SIZE[1]) : round(0.8 * SIZE[1])].min() < 100
    assert picture[-round(0.1 * SIZE[1]) :, : SIZE[0] // 4].min() == 255


def test_parts_and_names_that_do_not_fit_are_refused(tmp_path: Path, block: Surface) -> None:
    part = np.zeros(len(block.triangles), dtype=np.int64)
    with pytest.raises(ValueError, match="part_of_triangle has shape"):
        draw_mesh(block, part[1:], ["all"], tmp_path / "mesh.png", title="")
    with pytest.raises(ValueError, match="beyond the 1 that have names"):
        draw_mesh(block, part + 1, ["all"], tmp_path / "mesh.png", title="")
