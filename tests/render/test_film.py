import subprocess
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import imageio.v3 as iio
import imageio_ffmpeg  # type: ignore[import-untyped]
import numpy as np
import pytest

from fmd.render import film as film_module
from fmd.render.camera import Camera
from fmd.render.colours import film_limits
from fmd.render.film import draw_film, draw_mechanism
from fmd.render.moving_bodies import MovingBody, MovingLine, MovingMechanism, MovingShape
from fmd.render.solids import make_ball
from fmd.render.surface import Surface

PART, TICKS = np.s_[50:], np.s_[18:40]  # columns of a film


def turning(part: Surface, n_frames: int, **changes: object) -> MovingMechanism:
    """A rigid part that turns about z by 1 rad a frame, with a stress that falls along x."""
    angle = np.arange(n_frames, dtype=float)
    c, s, zero, one = np.cos(angle), np.sin(angle), 0 * angle, 0 * angle + 1
    rotation = np.stack([c, -s, zero, s, c, zero, zero, zero, one], axis=1).reshape(-1, 3, 3)
    stress = np.tile(1e6 * (1 - part.points[:, 0]), (n_frames, 1))
    still = np.zeros((len(part.points), 3, 0)), np.zeros((n_frames, 0)), np.zeros((n_frames, 3))
    body = MovingBody(part, *still, rotation, stress=stress)
    return replace(MovingMechanism(0.01 * angle, (body,)), **changes)  # type: ignore[arg-type]


def film(moving: MovingMechanism, path: Path, **changes: object) -> Path:
    given = {"clim_pa": np.tile((0.0, 1e6), (len(moving.times), 1)), "camera": Camera(size=(320, 180))} | changes
    draw_film(moving, path, title="Part", rate=25.0, **given)  # type: ignore[arg-type]
    return path


def decoded(path: Path) -> np.ndarray:
    """Read all frames by FFmpeg itself; ImageIO's reader leaves its pipes open."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path)]
    raw = subprocess.run([*command, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], capture_output=True, check=True)
    return np.frombuffer(raw.stdout, dtype=np.uint8).reshape(-1, 180, 320, 3)


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_a_film_has_all_its_frames_and_they_differ(tmp_path: Path, beam: Surface, name: str) -> None:
    path = film(turning(beam, 5), tmp_path / name)
    shown = decoded(path).astype(int)
    assert len(shown) == 5
    assert list(tmp_path.iterdir()) == [path]
    for before, after in pairwise(shown):
        assert np.count_nonzero(np.abs(after - before).max(axis=-1) > 60) > 300


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_a_film_that_fails_on_the_way_leaves_nothing(
    tmp_path: Path, beam: Surface, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = MovingBody.points

    def fail(body: MovingBody, frame: int) -> np.ndarray:
        if frame == 2:
            raise RuntimeError("diverged")
        return points(body, frame)

    monkeypatch.setattr(MovingBody, "points", fail)
    with pytest.raises(RuntimeError, match="diverged"):
        film(turning(beam, 5), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_film_that_can_not_be_made_is_refused(tmp_path: Path, beam: Surface) -> None:
    moving = turning(beam, 2)
    with pytest.raises(ValueError, match=r"film\.avi: a film's name ends in \.mp4 or \.gif"):
        film(moving, tmp_path / "film.avi")
    with pytest.raises(ValueError, match="both must be even"):
        film(moving, tmp_path / "film.mp4", camera=Camera(size=(321, 180)))
    with pytest.raises(ValueError, match="the highest colour needs a larger stress"):
        film(moving, tmp_path / "film.mp4", clim_pa=np.zeros((2, 2)))
    with pytest.raises(ValueError, match="stress has shape"):
        replace(moving.bodies[0], stress=np.zeros((2, 3)))


def test_a_film_has_a_note_beside_the_time(tmp_path: Path, beam: Surface) -> None:
    noted = turning(beam, 4, notes=("", "", "4 000 rpm", "4 000 rpm"))
    shown = decoded(film(noted, tmp_path / "film.mp4"))
    corner = shown[:, :18, 230:262].astype(int).min(axis=(1, 2, 3))
    assert np.all((corner < 120) == [False, False, True, True])


@pytest.mark.parametrize(
    ("times", "text"),
    [
        (np.linspace(0, 12, 97), "t = 12.0 s"),
        (np.linspace(0, 2, 61), "t = 2.00 s"),
        (np.linspace(0, 0.5, 81), "t = 500 ms"),
        (np.linspace(0, 0.02, 51), "t = 20.0 ms"),
        (np.zeros(1), "t = 0.0 ms"),
    ],
)
def test_the_clock_shows_as_many_digits_as_tell_the_frames_apart(times: np.ndarray, text: str) -> None:
    assert MovingMechanism(times).clock(len(times) - 1) == text


@pytest.mark.parametrize("camera", [None, (-60.0, 30.0), (0.0, 90.0)])
def test_no_part_of_a_turning_propeller_is_cut_off(
    tmp_path: Path, propeller: Surface, camera: tuple[float, float] | None
) -> None:
    path = film(turning(propeller, 8), tmp_path / "film.mp4", quantity="σ", camera=Camera(camera, size=(320, 180)))
    part = decoded(path)[:, 19:, 49:].astype(int).min(axis=-1) < 200
    assert part.any(axis=(1, 2)).all()
    for margin in (part[:, 0], part[:, -1], part[:, :, 0], part[:, :, -1]):
        assert not margin.any()


def test_no_frame_is_a_dark_silhouette(tmp_path: Path, block: Surface) -> None:
    moving = turning(block, 2)
    cold = replace(moving, bodies=(replace(moving.bodies[0], stress=np.zeros((2, len(block.points)))),))
    shown = decoded(film(cold, tmp_path / "film.mp4", camera=Camera(size=(320, 180))))
    inside = shown[:, 60:120, 150:210].astype(int).max(axis=-1)
    assert np.median(inside) > 140


def test_rigid_shapes_and_lines_move_with_the_bodies(tmp_path: Path, beam: Surface) -> None:
    moving = turning(beam, 3)
    away = np.array([[0.0, 0.2, 0.0], [0.0, 0.0, 0.0], [0.0, -0.2, 0.0]])
    ball = MovingShape(make_ball(np.zeros(3), 0.03), "#00aa00", away, np.tile(np.eye(3), (3, 1, 1)))
    ends = away[:, None] + np.array([[-0.2, 0.0, 0.0], [-0.1, 0.0, 0.0]])
    line = MovingLine(ends, "#0000ff", 4.0)
    moving = replace(moving, shapes=(ball,), lines=(line,))
    camera = Camera(angles=(0.0, 90.0), size=(320, 180))  # from above: +y is right of -y
    shown = decoded(film(moving, tmp_path / "film.gif", clim_pa=None, camera=camera)).astype(int)[:, 20:, 30:]
    red, green, blue = np.moveaxis(shown, -1, 0)
    for colour in ((green - np.maximum(red, blue)) > 60, (blue - np.maximum(red, green)) > 100):
        columns = [np.flatnonzero(frame.any(axis=0)).mean() for frame in colour]
        steps = np.diff(columns)
        assert steps[0] == pytest.approx(steps[1], abs=2.0)  # 0.2 m each
        assert abs(steps[0]) > 25


def test_a_film_without_stress_has_no_colour_bar(tmp_path: Path, beam: Surface) -> None:
    moving = turning(beam, 2)
    plain = replace(moving, bodies=(replace(moving.bodies[0], stress=None),))
    shown = decoded(film(plain, tmp_path / "film.gif", clim_pa=None)).astype(int)
    assert (shown[:, 50:140, :18].max(axis=-1) - shown[:, 50:140, :18].min(axis=-1)).max() < 40


def test_a_film_of_a_component_of_stress_has_limits_of_both_signs(tmp_path: Path, beam: Surface) -> None:
    shown = decoded(
        film(turning(beam, 2), tmp_path / "film.mp4", clim_pa=np.tile((-1e6, 1e6), (2, 1)), quantity="σ_xx [MPa]")
    )
    assert shown.std() > 0


def test_a_films_colours_and_their_bar_can_follow_each_frame(tmp_path: Path, beam: Surface) -> None:
    moving = turning(beam, 2)
    body = moving.bodies[0]
    assert body.stress is not None
    still = np.tile(np.eye(3), (2, 1, 1))
    growing = replace(body, rotation=still, stress=body.stress * [[0.25], [1.0]])
    moving = replace(moving, bodies=(growing,))
    spans = {span: film_limits(growing.stress, span) for span in ("largest", "frame")}  # type: ignore[arg-type]
    shown = {span: decoded(film(moving, tmp_path / f"{span}.gif", clim_pa=limits)) for span, limits in spans.items()}
    changed = {
        span: [np.abs(np.diff(frames[:, 45:, columns].astype(int), axis=0)).mean() for columns in (PART, TICKS)]
        for span, frames in shown.items()
    }
    assert changed["largest"][0] > 10 * changed["frame"][0]  # the same share of its own scale in each frame
    assert changed["frame"][1] > 4 * changed["largest"][1]  # the numbers of the bar, beside a palette's rounding


def test_a_film_has_one_plotter_and_one_part(tmp_path: Path, beam: Surface, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []

    def counted(module: object, name: str) -> Callable[..., object]:
        real = getattr(module, name)
        return lambda *arguments, **settings: made.append(name) or real(*arguments, **settings)

    for name in ("open_canvas", "add_part_by_values"):
        monkeypatch.setattr(film_module, name, counted(film_module, name))
    film(turning(beam, 3), tmp_path / "film.gif")
    assert made == ["open_canvas", "add_part_by_values"]


def test_a_still_labels_the_largest_stress_where_it_is(tmp_path: Path, block: Surface) -> None:
    moving = turning(block, 1, up=np.array([0.0, 0.0, 1.0]))
    corner = int(np.argmax(block.points @ (1, 1, 1)))
    stress = 3e8 - 2e9 * np.linalg.norm(block.points - block.points[corner], axis=1)
    moving = replace(moving, bodies=(replace(moving.bodies[0], stress=stress[None]),))
    pictures = []
    for label in (False, True):
        path = tmp_path / f"{label}.png"
        projection = draw_mechanism(moving, path, title="Block", camera=Camera(size=(960, 540)), label=label)
        pictures.append(iio.imread(path)[..., :3].astype(int))
    column, row = np.round(projection.pixels(block.points[[corner]])[0]).astype(int)
    changed = np.abs(pictures[1] - pictures[0]).max(axis=-1) > 40
    assert changed[row - 12 : row + 13, column - 12 : column + 13].sum() > 50  # a ring around the corner
    assert projection.axes[1] @ (0, 0, 1) > 0.9  # z is upwards
