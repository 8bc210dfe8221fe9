"""What a notebook shows of scene, modes and motion; the README's own lines."""

import base64
import io
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from matplotlib.image import imread

from fmd import load
from fmd.core.errors import InputError
from fmd.core.html import facts, scaled, table

README = Path(__file__).parents[2] / "README.md"


@pytest.fixture(scope="module")
def run():
    return load("beam", "body.beam.mesh.divisions=[24, 2, 1]", "simulation.duration=50 ms")


def cells(text: str) -> list[list[str]]:
    """The rows of a table; it must be well-formed."""
    rows = ElementTree.fromstring(text).iter("tr")
    return [["".join(cell.itertext()) for cell in row] for row in rows]


def test_a_figure_has_the_prefix_that_fits():
    given = [
        (1.728e6, "Pa"),
        (5.438e-3, "m"),
        (0.9999, "s"),
        (131.04, "Hz"),
        (0.0, "m"),
        (-2e-9, "m"),
        (0.03, "1"),
        (None, "s"),
    ]
    expected = ["1.728 MPa", "5.438 mm", "0.9999 s", "131 Hz", "0 m", "-2 nm", "0.03", "–"]
    assert [scaled(value, unit) for value, unit in given] == expected


def test_what_stands_in_a_table_is_escaped():
    assert cells(table(("a", "<b>"), [("x & y", 1)])) == [["a", "<b>"], ["x & y", "1"]]
    assert cells(facts([("<script>", "'")])) == [["<script>", "'"]]


def test_a_scene_tells_its_bodies_joints_and_runs(run):
    shown = dict(cells(run._repr_html_()))
    assert shown["bodies"] == "beam: bar"
    assert shown["joints"] == "hub: revolute, ground → beam.root"
    assert shown["simulation"] == "50 ms, output every 500 µs"
    assert shown["runs"] == "central-difference, sub-cycling 5:1, sub-cycling 10:1"
    assert run._repr_html_() == run.scene._repr_html_()


def test_modes_show_their_frequencies_and_a_motion_its_end(run):
    modes = cells(run.modes._repr_html_())
    assert [float(row[1]) for row in modes[1:]] == pytest.approx(run.modes.frequencies_hz, abs=0.006)
    motion = dict(cells(run.motion._repr_html_()))
    assert float(motion["joint positions hub"]) == pytest.approx(run.motion.joint_position("hub")[-1], rel=1e-5)
    assert motion["step"] == "2 µs"


def test_pictures_are_shown_inline(run, tmp_path):
    small = {"size": [320, 180]}
    for picture in (run.picture("modes", mode=2, **small), run.picture("stress", scale=10, **small)):
        image = imread(io.BytesIO(picture._repr_png_()))
        assert image.shape[:2] == (180, 320)
        assert image[..., :3].std() > 0.01
    run.picture("chart", quantity="tip_deflection").save(tmp_path / "tip.png")
    assert imread(tmp_path / "tip.png").shape[:2] == (960, 1600)


def test_what_a_console_shows_of_any_result_is_short(run):
    shown = [run, run.scene, run.modes, run.motion, run.stress, run.mesh, run.body, run.fe, run.surface, run.summary]
    shown += [*(motion.trajectory for motion in run.motions.values()), run.picture("mesh", size=[320, 180])]
    assert max(len(repr(result)) for result in shown) < 400
    assert repr(run) == "Result(beam: Rotating flexible beam; beam)"
    assert repr(shown[-1]).startswith("Picture(320 × 180 pixels, ")
    assert "shapes=<float64 " in repr(run.modes)


def test_the_summary_has_the_figures_of_the_run(run):
    assert run.summary["frequencies_hz"] == pytest.approx(run.modes.frequencies_hz)
    shown = dict(cells(run.summary._repr_html_()))
    assert shown["largest von Mises stress"] == scaled(run.stress.worst()[2], "Pa")


def test_a_film_is_played_inline(run, tmp_path):
    film = run.film(frames=3, size=[160, 90])
    film.save(tmp_path / "film.mp4")
    assert b"ftyp" in film.mp4[:12]  # of an MPEG-4 file
    (video,) = ElementTree.fromstring(f"<p>{film._repr_html_().replace(' controls loop', '')}</p>")
    assert base64.b64decode(video.get("src", "").partition(",")[2]) == (tmp_path / "film.mp4").read_bytes()
    assert len(repr(film)) < 40
    with pytest.raises(InputError, match="did you mean 'scale'"):
        run.film(scal=2)


@pytest.mark.parametrize(
    ("type", "settings", "said"),
    [
        ("film", {}, "picture: type = 'film': the pictures: chart, orbit, mesh"),
        ("stres", {}, "did you mean 'stress'"),
        ("stress", {"scal": 2}, "did you mean 'scale'"),
        ("modes", {"mode": 9}, "mode = 9: must be 1 … 5"),
        ("chart", {"quantity": "heat"}, "quantity = 'heat'"),
    ],
)
def test_a_picture_that_there_is_not_is_refused(run, type, settings, said):
    with pytest.raises(InputError, match=re.escape(said)):
        run.picture(type, **settings)


def test_the_lines_in_the_readme_run_as_they_are_written():
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    lines = next(block for block in blocks if "load(" in block)
    assert len(lines.splitlines()) <= 10
    names: dict[str, object] = {}
    exec(lines, names)
    assert names["run"].modes.frequencies_hz[0] == pytest.approx(167.4, rel=5e-3)  # Timoshenko, 300 mm, free
