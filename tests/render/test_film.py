import subprocess
from collections.abc import Callable, Iterator
from itertools import pairwise, product
from pathlib import Path

import imageio_ffmpeg  # type: ignore[import-untyped]
import numpy as np
import pytest

from pipeline.render import film as film_module
from pipeline.render.camera import Camera
from pipeline.render.film import draw_film
from pipeline.render.film_frames import FilmFrame
from pipeline.render.surface import Surface


def frames(part: Surface, n_frames: int, fail_at: int = -1) -> Iterator[FilmFrame]:
    for number in range(n_frames):
        if number == fail_at:
            raise RuntimeError("diverged")
        yield FilmFrame(0.01 * number, turned(part.points, float(number)), 1e6 * (1 - part.points[:, 0]))


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def film(part: Surface, path: Path, n_frames: int = 5, **changes: object) -> Path:
    given = {
        "frames": frames(part, n_frames),
        "bounds": np.array(list(product((-0.35, 0.35), (-0.35, 0.35), (0.0, 0.01)))),
        "clim_pa": (0.0, 1e6),
        "camera": Camera(size=(320, 180)),
    } | changes
    draw_film(part, path=path, title="Part", rate=25.0, **given)  # type: ignore[arg-type]
    return path


def decoded(path: Path) -> np.ndarray:
    """Read all frames by FFmpeg itself; ImageIO's reader leaves its pipes open."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path)]
    raw = subprocess.run([*command, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], capture_output=True, check=True)
    return np.frombuffer(raw.stdout, dtype=np.uint8).reshape(-1, 180, 320, 3)


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_a_film_has_all_its_frames_and_they_differ(tmp_path: Path, beam: Surface, name: str) -> None:
    path = film(beam, tmp_path / name)
    shown = decoded(path).astype(int)
    assert len(shown) == 5
    assert list(tmp_path.iterdir()) == [path]
    for before, after in pairwise(shown):
        assert np.count_nonzero(np.abs(after - before).max(axis=-1) > 60) > 300


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_a_film_that_fails_on_the_way_leaves_nothing(tmp_path: Path, beam: Surface, name: str) -> None:
    with pytest.raises(RuntimeError, match="diverged"):
        film(beam, tmp_path / name, frames=frames(beam, 5, fail_at=2))
    with pytest.raises(ValueError, match="stress has shape"):
        film(beam, tmp_path / name, frames=(frame._replace(stress=np.zeros(3)) for frame in frames(beam, 3)))
    assert not list(tmp_path.iterdir())


def test_a_film_that_can_not_be_made_is_refused(tmp_path: Path, beam: Surface) -> None:
    with pytest.raises(ValueError, match=r"film\.avi: a film's name ends in \.mp4 or \.gif"):
        film(beam, tmp_path / "film.avi")
    with pytest.raises(ValueError, match="both must be even"):
        film(beam, tmp_path / "film.mp4", camera=Camera(size=(321, 180)))
    with pytest.raises(ValueError, match="the highest colour needs a larger stress"):
        film(beam, tmp_path / "film.mp4", clim_pa=(0.0, 0.0))


def test_a_film_has_a_note_beside_the_time(tmp_path: Path, beam: Surface) -> None:
    noted = [frame._replace(note="4 000 rpm" if frame.time > 0.015 else "") for frame in frames(beam, 4)]
    shown = decoded(film(beam, tmp_path / "film.mp4", 4, frames=noted))
    corner = shown[:, :18, 246:272].astype(int).min(axis=(1, 2, 3))
    assert np.all((corner < 120) == [False, False, True, True])


@pytest.mark.parametrize("camera", [None, (-60.0, 30.0), (10.0, 0.0), (0.0, 90.0)])
def test_no_part_of_a_turning_propeller_is_cut_off(
    tmp_path: Path, propeller: Surface, camera: tuple[float, float] | None
) -> None:
    angle = np.linspace(0, 2 * np.pi, 61)
    circle = 0.405 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    reached = (circle + np.array([[[0, 0, -0.04]], [[0, 0, 0.04]]])).reshape(-1, 3)
    camera = Camera(camera, size=(320, 180))
    path = film(propeller, tmp_path / "film.mp4", bounds=reached, hub=False, quantity="σ", camera=camera)
    part = decoded(path)[:, 19:, 49:].astype(int).min(axis=-1) < 200
    assert part.any(axis=(1, 2)).all()
    for margin in (part[:, 0], part[:, -1], part[:, :, 0], part[:, :, -1]):
        assert not margin.any()


def test_a_film_of_a_component_of_stress_has_limits_of_both_signs(tmp_path: Path, beam: Surface) -> None:
    signed = [frame._replace(stress=frame.stress - 8e5) for frame in frames(beam, 2)]
    shown = decoded(
        film(beam, tmp_path / "film.mp4", 2, frames=signed, clim_pa=(-1e6, 1e6), quantity="σ_xx [MPa]", hub=False)
    )
    assert shown.std() > 0


def test_a_film_has_one_plotter_and_one_part(tmp_path: Path, beam: Surface, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []

    def counted(name: str) -> Callable[..., object]:
        real = getattr(film_module, name)
        return lambda *arguments, **settings: made.append(name) or real(*arguments, **settings)

    for name in ("open_canvas", "add_part_by_values"):
        monkeypatch.setattr(film_module, name, counted(name))
    film(beam, tmp_path / "film.gif", n_frames=3)
    assert made == ["open_canvas", "add_part_by_values"]
