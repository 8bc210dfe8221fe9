"""The page of all results: what is in it, that it needs no network, and that a browser turns the part."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from importlib.metadata import version
from importlib.resources import files

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.image import imread

from pipeline import load
from pipeline.output.report.page import make_page
from pipeline.output.report.view3d import collect_view

QUICK = ["body.beam.mesh.divisions=[24, 2, 1]", "simulation.duration=100 ms"]
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
# Drags, zooms and goes back as a user would; after each: the canvas's covered share, a sum of its pixels, the reddest.
HARNESS = """<script>
const answer = (value) => document.documentElement.dataset.answer = JSON.stringify(value);
addEventListener("error", (e) => answer(e.message));
addEventListener("load", async () => {
  const canvas = document.querySelector("canvas"), states = [];
  const look = async (change) => {
    const before = canvas.dataset.drawn; // without a screen, frames come a minute of virtual time apart
    change();
    for (let tries = 0; tries < 6000 && canvas.dataset.drawn === before; tries++)
      await new Promise((then) => setTimeout(then, 100));
    const gl = canvas.getContext("webgl2"), pixels = new Uint8Array(canvas.width * canvas.height * 4);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let covered = 0, sum = 0, red = 0;
    for (let k = 0; k < pixels.length; k += 4) if (pixels[k + 3]) {
      covered++; sum = (31 * sum + pixels[k] + 7 * pixels[k + 1] + 13 * pixels[k + 2] + k) % 1000000007;
      red = Math.max(red, pixels[k] - pixels[k + 2]);
    }
    states.push([covered / (canvas.width * canvas.height), sum, red]);
  };
  const send = (type, x, y) => canvas.dispatchEvent(new PointerEvent(type, { pointerId: 1, clientX: x, clientY: y }));
  canvas.setPointerCapture = () => {};
  await look(() => {});
  await look(() => { send("pointerdown", 300, 300); send("pointermove", 380, 340); send("pointerup", 380, 340); });
  await look(() => canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: -300 })));
  await look(() => canvas.dispatchEvent(new MouseEvent("dblclick")));
  answer(states);
});
</script></body>"""


class Page(HTMLParser):
    """The text of a page's cells, and every address that it names."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.cells: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [str(value) for name, value in attrs if name in ("src", "href", "srcset", "action", "data")]

    def handle_data(self, data):
        self.cells.append(data.strip())


@pytest.fixture(scope="module")
def text(fmd, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "beam.html"
    assert fmd("report", "beam", *(word for value in QUICK for word in ("--set", value)), "--out", path) == 0
    return path.read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_page_holds_frequencies_pictures_charts_run_times_errors_and_versions(text):
    page = Page(text)
    hertz = load("beam", *QUICK).modes.frequencies_hz
    assert {f"{value:.2f}" for value in hertz} <= set(page.cells)
    assert {"central-difference", "sub-cycling 5:1", "sub-cycling 10:1"} <= set(page.cells)
    assert {"beam, largest von Mises stress", "stated", version("gmsh"), version("scikit-fem")} <= set(page.cells)
    pictures = [base64.b64decode(at.partition(",")[2]) for at in page.addresses]
    assert len(pictures) == 1 + 5 + 3  # the part as a still, its modes, the scene's charts
    assert all(picture.startswith(b"\x89PNG") for picture in pictures)
    assert len(text) < 3e6


@pytest.mark.slow
def test_the_page_needs_no_network(text):
    page = Page(text)
    assert all(address.startswith("data:image/png;base64,") for address in page.addresses)
    assert not {"link", "iframe", "object", "embed", "base"} & set(page.tags)
    assert "default-src 'none'" in text  # the browser's own ban
    assert re.findall(r"url\(|@import|https?:|fetch\(|XMLHttp|import\(", re.sub(r"base64,[\w+/=]+", "", text)) == []


def test_the_part_in_the_page_is_the_stressed_surface():
    run = load("beam", *QUICK)
    data = collect_view(run, "beam", 10.0)

    def unpacked(name, kind, width):
        return np.frombuffer(base64.b64decode(data[name]), dtype=kind).reshape(-1, width)

    positions, triangles = unpacked("positions", "<f4", 3), unpacked("triangles", "<u4", 3)
    time, _, worst = run.stress.worst()
    assert (data["time"], unpacked("values", "<f4", 1).max()) == (time, pytest.approx(worst * 1e-6, rel=1e-6))
    # By the divergence theorem the triangles, seen from outside, enclose the bar's volume.
    a, b, c = (positions[triangles[:, k]].astype(float) for k in range(3))
    assert np.einsum("ti,ti->", a, np.cross(b, c)) / 6 == pytest.approx(0.34 * 0.025 * 0.01, rel=1e-5)
    # What a section at the hub sees of the tip: its displacement less what the section's own place and turn make of it.
    moved, at_hub = unpacked("displacements", "<f4", 3), np.isclose(positions[:, 0], -0.17)
    hub, tip = (moved[np.isclose(positions[:, 0], x), 1].mean() for x in (-0.17, 0.17))
    turn = -np.polyfit(positions[at_hub, 1], moved[at_hub, 0], 1)[0]
    deflection = run.motion.tip_deflection[:, 1][int(np.searchsorted(run.motion.times, time))]
    assert tip - hub - 0.34 * turn == pytest.approx(deflection, rel=0.02)
    assert unpacked("colours", "u1", 3)[255].tolist() == pytest.approx(
        255 * np.array(colormaps["turbo"](1.0)[:3]), abs=1
    )
    assert unpacked("edges", "<u4", 2).max() < len(positions)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine: apt-get install chromium")
def test_the_part_turns_in_a_browser(text, tmp_path):
    path = tmp_path / "page.html"
    path.write_text(text.replace("</body>", HARNESS), encoding="utf-8")
    options = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    options += ["--virtual-time-budget=20000000", "--window-size=1280,1000", "--host-resolver-rules=MAP * ~NOTFOUND"]
    options += [f"--user-data-dir={tmp_path / 'profile'}", f"--screenshot={tmp_path / 'page.png'}", "--dump-dom"]
    done = subprocess.run(
        [str(CHROMIUM), *options, path.as_uri()], capture_output=True, text=True, check=True, timeout=180
    )
    answer = re.search(r'data-answer="(.*?)"', done.stdout)
    assert answer is not None, done.stderr
    start, turned, nearer, home = json.loads(answer[1])
    assert 0.03 < start[0] < 0.6
    assert start[2] > 100  # the hottest colour is red
    assert turned[1] != start[1]
    assert nearer[0] > 1.3 * turned[0]
    assert home == start
    assert imread(tmp_path / "page.png")[..., :3].std() > 0.05


@pytest.mark.slow
def test_a_rigid_scene_has_a_page_too(fmd, tmp_path, capsys):
    path = tmp_path / "rod.html"
    assert fmd("report", "rod-slider", "--set", "simulation.duration=1 s", "--no-budget", "--out", path, "--json") == 0
    assert json.loads(capsys.readouterr().out)["bytes"] == path.stat().st_size
    page = Page(path.read_text(encoding="utf-8"))
    assert "canvas" not in page.tags
    assert len(page.addresses) == 2  # the charts of Figs. 4 to 7


def test_a_part_alone_has_a_page_with_its_modes(fmd, tmp_path):
    scene = (files("models") / "beam.toml").read_text()
    path = tmp_path / "part.toml"
    path.write_text(scene[: scene.index("[joint.hub]")])
    coarse = [QUICK[0], "body.beam.modes.count=1"]
    assert fmd("report", path, "--set", coarse[0], "--set", coarse[1], "--out", tmp_path / "p.html") == 0
    page = Page((tmp_path / "p.html").read_text(encoding="utf-8"))
    assert f"{load(path, *coarse).modes.frequencies_hz[0]:.2f}" in page.cells
    assert len(page.addresses) == 1


def test_titles_and_overrides_are_text_even_where_they_look_like_html(tmp_path):
    title, note = "<script>alert(1)</script> & more", "'</code><b>"
    run = load("beam", QUICK[0], "body.beam.modes.count=1")
    run.scene = run.scene.model_copy(update={"title": title, "simulation_table": None})
    text = make_page(run, [note])
    assert title not in text
    assert note not in text
    page = Page(text)
    assert title in page.cells
    assert page.tags.count("script") == 1  # the viewer's own
    assert "b" not in page.tags


def test_a_page_that_cannot_be_written_is_refused_before_anything_is_computed(fmd, tmp_path, capsys, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr("pipeline.output.report.page.make_page", lambda *_: pytest.fail("computed"))
    assert fmd("report", "beam", "--out", tmp_path / "file" / "page.html") == 2
    assert "can't be written" in capsys.readouterr().err
