import subprocess
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import imageio.v3 as iio
import imageio_ffmpeg  # type: ignore[import-untyped]
import numpy as np
import pytest

from pipeline.render.film import draw_film
from pipeline.render.pictures import Surface, draw_mode, draw_stress
from pipeline.render.stage import BAR
from pipeline.render.view import PART, fitted_view, oblique_axes

SIZE = (960, 540)


def box(*extents: float, divisions: tuple[int, int, int] = (6, 4, 3)) -> Surface:
    """Return the six sides of a box as triangles, with the outlines of their rectangles."""
    nodes = np.stack(np.meshgrid(*(np.arange(n + 1) for n in divisions), indexing="ij"), axis=-1)
    number = np.arange(nodes[..., 0].size).reshape(nodes.shape[:3])
    sides = [np.take(number, end, axis) for axis in range(3) for end in (0, -1)]
    corners = [np.stack([s[:-1, :-1], s[1:, :-1], s[1:, 1:], s[:-1, 1:]], axis=-1) for s in sides]
    quads = np.concatenate([c.reshape(-1, 4) for c in corners])
    edges = np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2)
    used, local = np.unique(np.concatenate([quads.ravel(), edges.ravel()]), return_inverse=True)
    quads, edges = local[: quads.size].reshape(-1, 4), local[quads.size :].reshape(-1, 2)
    points = nodes.reshape(-1, 3)[used] / divisions * extents
    triangles = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    return Surface(points, triangles, np.unique(np.sort(edges, axis=1), axis=0))


BLOCK = box(0.12, 0.1, 0.08)
BEAM = box(0.34, 0.025, 0.01, divisions=(24, 4, 2))


def distance_to_top_colour(picture: np.ndarray, pixel: np.ndarray) -> float:
    """How far the colours around a pixel are from the upper end of the colour bar, at best, of 255."""
    height, width = picture.shape[:2]
    top = picture[round(height * (1 - (BAR[2] + BAR[3]) / 2)), round(width * BAR[1]) - 2, :3].astype(float)
    assert top == pytest.approx([122, 4, 3], abs=6)  # turbo's dark red
    column, row = np.round(pixel).astype(int)
    around = picture[row - 3 : row + 4, column - 3 : column + 4, :3].astype(float)
    return float(np.abs(around - top).max(axis=-1).min())


CORNERS = [number for number, p in enumerate(BLOCK.points) if np.all((p == 0) | (p == BLOCK.points.max(axis=0)))]


@pytest.mark.parametrize("corner", CORNERS)
def test_the_hottest_node_is_seen_in_the_top_colour_wherever_it_is(tmp_path: Path, corner: int) -> None:
    distance = np.linalg.norm(BLOCK.points - BLOCK.points[corner], axis=1)
    displacement = np.zeros_like(BLOCK.points)
    path = tmp_path / "stress.png"
    view = draw_stress(BLOCK, displacement, 3e8 - 2e9 * distance, path, title="Block", size=SIZE)
    picture = iio.imread(path)
    hottest, coldest = view.pixels(BLOCK.points[[corner, int(np.argmax(distance))]])
    assert distance_to_top_colour(picture, hottest) < 30  # a tilted face is up to a fifth darker
    assert distance_to_top_colour(picture, coldest) > 60


def test_a_stress_picture_has_its_size_and_tells_the_factor_on_the_deformation(tmp_path: Path) -> None:
    displacement = BEAM.points[:, :1] ** 2 * (0, 0.03, 0)
    stress = 1e6 * (1 - BEAM.points[:, 0])
    notes = []
    for scale in (1.0, 10.0):
        path = tmp_path / f"stress-{scale}.png"
        draw_stress(BEAM, displacement, stress, path, title="Beam", scale=scale, size=SIZE)
        picture = iio.imread(path)
        assert picture.shape[:2] == SIZE[::-1]
        assert picture[:54, :300, :3].min() < 80  # the title
        notes.append(picture[:54, 700:, :3].min())
    assert notes[0] == 255
    assert notes[1] < 80


def test_a_part_without_stress_is_drawn_too(tmp_path: Path) -> None:
    zero = np.zeros_like(BLOCK.points)
    draw_stress(BLOCK, zero, zero[:, 0], tmp_path / "cold.png", title="Cold", size=SIZE)
    assert iio.imread(tmp_path / "cold.png").std() > 0


@pytest.mark.parametrize(("given", "amplitude"), [({}, 0.08), ({"scale": 3.0}, 0.24)])
def test_a_mode_is_drawn_with_an_amplitude_of_eight_percent_times_its_scale(
    tmp_path: Path, given: dict[str, float], amplitude: float
) -> None:
    displacement = -3.0 * BEAM.points[:, :1] ** 2 * (0, 1, 0)
    path = tmp_path / "mode.png"
    view = draw_mode(BEAM, displacement, path, title="Mode 1 · 131.0 Hz", size=SIZE, **given)
    picture = iio.imread(path)
    tip = BEAM.points[BEAM.points[:, 0] > 0.339]
    pixels = view.pixels(tip - (0, amplitude * 0.34, 0))
    assert picture.shape[:2] == SIZE[::-1]
    assert min(distance_to_top_colour(picture, pixel) for pixel in pixels) < 30
    assert picture[:54, :300, :3].min() < 80  # the title


def test_arrays_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    zero = np.zeros_like(BLOCK.points)
    with pytest.raises(ValueError, match="displacement is zero everywhere"):
        draw_mode(BLOCK, zero, path, title="")
    with pytest.raises(ValueError, match="displacement has shape"):
        draw_mode(BLOCK, zero[1:], path, title="")
    with pytest.raises(ValueError, match="stress has shape"):
        draw_stress(BLOCK, zero, zero[1:, 0], path, title="")
    with pytest.raises(ValueError, match="triangles name points beyond the 3 that there are"):
        Surface(np.zeros((3, 3)), np.array([[0, 1, 3]]), np.empty((0, 2), dtype=np.int64))
    assert not list(tmp_path.iterdir())


def test_an_error_while_writing_a_picture_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(path: Path, _: object) -> None:
        path.write_text("half")
        raise OSError("disk full")

    monkeypatch.setattr(iio, "imwrite", fail)
    with pytest.raises(OSError, match="disk full"):
        draw_mode(BLOCK, BLOCK.points, tmp_path / "mode.png", title="", size=SIZE)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("surface", [BLOCK, BEAM], ids=["block", "beam"])
def test_a_part_fills_its_place_in_the_picture(surface: Surface) -> None:
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


def frames(n_frames: int, fail_at: int = -1) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    for number in range(n_frames):
        if number == fail_at:
            raise RuntimeError("diverged")
        c, s = np.cos(number), np.sin(number)
        turned = BEAM.points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        yield 0.01 * number, turned, 1e6 * (1 - BEAM.points[:, 0])


def film(path: Path, n_frames: int = 5, **changes: object) -> Path:
    given = {
        "frames": frames(n_frames),
        "size": (320, 180),
        "clim_pa": (0.0, 1e6),
        "on_frame": None,
    } | changes
    swept = np.array([-0.35, 0.35, -0.35, 0.35, 0.0, 0.01])
    draw_film(BEAM, n_frames=n_frames, path=path, title="Beam", bounds=swept, rate=25.0, **given)  # type: ignore[arg-type]
    return path


def decoded(path: Path) -> np.ndarray:
    """Read all frames by FFmpeg itself; ImageIO's reader leaves its pipes open."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path)]
    raw = subprocess.run([*command, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], capture_output=True, check=True)
    return np.frombuffer(raw.stdout, dtype=np.uint8).reshape(-1, 180, 320, 3)


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_a_film_has_the_frames_asked_for_and_they_differ(tmp_path: Path, name: str) -> None:
    called: list[int] = []
    path = film(tmp_path / name, on_frame=lambda: called.append(1))
    shown = decoded(path).astype(int)
    assert len(shown) == len(called) == 5
    assert list(tmp_path.iterdir()) == [path]
    for before, after in pairwise(shown):
        assert np.count_nonzero(np.abs(after - before).max(axis=-1) > 60) > 300


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_a_film_that_fails_on_the_way_leaves_nothing(tmp_path: Path, name: str) -> None:
    with pytest.raises(RuntimeError, match="diverged"):
        film(tmp_path / name, frames=frames(5, fail_at=2))
    with pytest.raises(ValueError, match="5 frames were announced, 3 came"):
        film(tmp_path / name, frames=frames(3))
    assert not list(tmp_path.iterdir())


def test_a_film_that_can_not_be_made_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"film\.avi: a film's name ends in \.mp4 or \.gif"):
        film(tmp_path / "film.avi")
    with pytest.raises(ValueError, match="both must be even"):
        film(tmp_path / "film.mp4", size=(321, 180))
    with pytest.raises(ValueError, match="the highest colour needs a larger stress"):
        film(tmp_path / "film.mp4", clim_pa=(0.0, 0.0))
