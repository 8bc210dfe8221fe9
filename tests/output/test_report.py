"""The page of all results: what is in it, that it needs no network, and that a browser turns the part."""

import base64
import json
import re
import shutil
import subprocess
from contextlib import suppress
from functools import cache
from html import unescape
from html.parser import HTMLParser
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.image import imread

from fmd import load, load_scene, solve
from fmd.output.report.contents import show_outputs
from fmd.output.report.page import make_page
from fmd.output.report.view3d import collect_view
from fmd.render.camera import Camera

QUICK = ["body.beam.mesh.divisions=[12, 2, 1]", "simulation.duration=50 ms"]
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
BROWSER = [
    *("--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--virtual-time-budget=5000", "--host-resolver-rules=MAP * ~NOTFOUND"),
]
# Frames are drawn at once, so that nothing has to be waited for.
AT_ONCE = "<script>window.requestAnimationFrame = (paint) => (paint(0), 0);</script>"
# Drags, zooms, goes back, moves the time and plays as a user would; after each: the canvas's covered share, a sum of
# its pixels, the reddest, the middle of what is covered, and the clock.
HARNESS = """<script>
const answer = (value) => document.documentElement.dataset.answer = JSON.stringify(value);
addEventListener("error", (e) => answer(e.message));
addEventListener("load", async () => {
  const canvas = document.querySelector("canvas"), states = [], time = document.querySelector("[name=time]");
  const look = (change) => {
    change();
    const gl = canvas.getContext("webgl2"), pixels = new Uint8Array(canvas.width * canvas.height * 4);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let covered = 0, sum = 0, red = 0, across = 0, up = 0;
    for (let k = 0; k < pixels.length; k += 4) if (pixels[k + 3]) {
      covered++; sum = (31 * sum + pixels[k] + 7 * pixels[k + 1] + 13 * pixels[k + 2] + k) % 1000000007;
      red = Math.max(red, pixels[k] - pixels[k + 2]);
      across += (k / 4) % canvas.width; up += Math.floor(k / 4 / canvas.width);
    }
    const clock = document.querySelector("[name=clock]").textContent;
    states.push([covered / (canvas.width * canvas.height), sum, red, across / covered, up / covered, clock]);
  };
  const send = (type, x, y) => canvas.dispatchEvent(new PointerEvent(type, { pointerId: 1, clientX: x, clientY: y }));
  const set = (value) => { time.value = value; time.dispatchEvent(new Event("input")); };
  const own = time.value;
  canvas.setPointerCapture = () => {};
  look(() => {});
  look(() => { send("pointerdown", 300, 300); send("pointermove", 380, 340); send("pointerup", 380, 340); });
  look(() => canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: -300 })));
  look(() => canvas.dispatchEvent(new MouseEvent("dblclick")));
  look(() => set(0));
  look(() => set(time.max));
  look(() => set(own));
  const span = document.querySelector("[name=span]"), ticks = [...document.querySelectorAll(".ticks span")];
  const choose = (name) => { span.value = name; span.dispatchEvent(new Event("change")); };
  set(Math.round(time.max / 5));
  for (const name of ["largest", "frame", "usual"]) {
    look(() => choose(name));
    states.at(-1).push(ticks.at(-1).textContent);
  }
  choose("largest"); set(own);
  document.querySelector("[name=play]").click();
  await new Promise((then) => setTimeout(then, 200));
  look(() => document.querySelector("[name=play]").click());
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
    assert fmd("report", "beam", *(word for value in QUICK for word in ("--set", value)), "--out", path, "--json") == 0
    return path.read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_page_holds_frequencies_pictures_charts_run_times_errors_and_versions(text):
    page = Page(text)
    hertz = load("beam", *QUICK).modes.frequencies_hz
    assert {f"{value:.2f}" for value in hertz} <= set(page.cells)
    assert "<p>beam, free of its joint; " in text
    assert {"central-difference", "sub-cycling 5:1", "sub-cycling 10:1"} <= set(page.cells)
    assert {"beam, largest von Mises stress", "stated", version("gmsh"), version("scikit-fem")} <= set(page.cells)
    pictures = [base64.b64decode(at.partition(",")[2]) for at in page.addresses]
    assert len(pictures) == 1 + 5 + 3 + 1  # the worst instant, the modes, the scene's charts and its stress picture
    assert all(picture.startswith(b"\x89PNG") for picture in pictures)
    assert len(text) < 3e6


@pytest.mark.slow
def test_the_page_needs_no_network(text):
    page = Page(text)
    assert all(address.startswith("data:image/png;base64,") for address in page.addresses)
    assert not {"link", "iframe", "object", "embed", "base"} & set(page.tags)
    assert "default-src 'none'" in text  # the browser's own ban
    assert re.findall(r"url\(|@import|https?:|fetch\(|XMLHttp|import\(", re.sub(r"base64,[\w+/=]+", "", text)) == []


def test_the_mechanism_in_the_page_moves_and_is_stressed_as_the_run_is():
    run = load("beam", *QUICK)
    data = collect_view(run.run, 10.0, Camera())
    beam, *marks = data["bodies"]

    def unpacked(body, name, kind, *shape):
        return np.frombuffer(base64.b64decode(body[name]), dtype=kind).reshape(*shape)

    n_frames = len(data["clocks"])
    positions, triangles = unpacked(beam, "positions", "<f4", -1, 3), unpacked(beam, "triangles", "<u4", -1, 3)
    n = len(positions)
    # By the divergence theorem the triangles, seen from outside, enclose the bar's volume.
    a, b, c = (positions[triangles[:, k]].astype(float) for k in range(3))
    assert np.einsum("ti,ti->", a, np.cross(b, c)) / 6 == pytest.approx(0.34 * 0.025 * 0.01, rel=1e-5)
    # What a section at the hub sees of the tip: its displacement less what the section's own place and turn make of it.
    time, _, worst = run.stress.worst()
    frame = data["frame"]
    displacements = beam["step"] * unpacked(beam, "displacements", "<i2", n_frames, n, 3)
    moved, x = displacements[frame], positions[:, 0] - positions[:, 0].min()
    at_hub = np.isclose(x, 0.0, atol=1e-6)
    hub, tip = (moved[np.isclose(x, at, atol=1e-6), 1].mean() for at in (0.0, 0.34))
    turn = -np.polyfit(positions[at_hub, 1], moved[at_hub, 0], 1)[0]
    deflection = run.motion.tip_deflection[:, 1][int(np.searchsorted(run.motion.times, time))]
    assert tip - hub - 0.34 * turn == pytest.approx(deflection, rel=0.02)
    # Colours: levels between the least and the largest stress, and what the colours can span in each frame.
    levels, (low, high) = unpacked(beam, "levels", "<u2", n_frames, n), data["limits"]
    assert (low, levels[frame].max()) == (0.0, 65535)
    assert data["worst"] == {"body": "beam", "time": time, "largest": pytest.approx(worst * 1e-6)}
    assert high == pytest.approx(data["worst"]["largest"])
    last = levels[-1].max() / 65535 * high
    assert last * 1e6 == pytest.approx(run.stress.von_mises(run.motion.times[-1]).max(), abs=high * 1e6 / 65535)
    assert data["spans"]["largest"] == [[low, pytest.approx(high)]] * n_frames
    assert data["spans"]["frame"][-1] == [0.0, pytest.approx(last, abs=high / 65535)]
    assert 0.5 * high < data["spans"]["usual"][0][1] < high
    # The tip in space, from place and axes of the frame.
    origin, rotation = unpacked(beam, "origin", "<f4", n_frames, 3), unpacked(beam, "rotation", "<f4", n_frames, 3, 3)
    ends = np.isclose(x, 0.34, atol=1e-6)
    for k in (0, n_frames - 1):
        place = origin[k] + (positions[ends].mean(axis=0) + displacements[k, ends].mean(axis=0)) @ rotation[k].T
        assert place == pytest.approx(run.motion.tip_position[-1 if k else 0], abs=2e-4)
    assert unpacked(data, "colours", "u1", -1, 3)[255].tolist() == pytest.approx(
        255 * np.array(colormaps["turbo"](1.0)[:3]), abs=1
    )
    assert unpacked(beam, "edges", "<u4", -1, 2).max() < n
    assert len(marks) == 2  # the hinge and its ground
    assert all(mark["rgb"] is not None and "levels" not in mark for mark in marks)


@cache
def browser_starts() -> bool:
    """Return whether there is a Chromium that starts here and has WebGL 2, as containers don't always let it."""
    asked = "data:text/html,<script>document.title=!!document.createElement('canvas').getContext('webgl2')</script>"
    with TemporaryDirectory() as profile, suppress(subprocess.TimeoutExpired):
        return CHROMIUM is not None and "<title>true" in in_browser(Path(profile), asked).stdout
    return False


def in_browser(folder: Path, address: str, *options: str) -> subprocess.CompletedProcess[str]:
    command = [str(CHROMIUM), *BROWSER, f"--user-data-dir={folder / 'profile'}", *options, "--dump-dom", address]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


def answers(folder: Path, page: str, harness: str, *options: str) -> Any:
    """Return what the harness in a page finds as it acts in a browser."""
    if not browser_starts():
        pytest.skip("no Chromium with WebGL starts on this machine: apt-get install chromium")
    path = folder / "page-with-harness.html"
    path.write_text(page.replace("<title>", f"{AT_ONCE}<title>", 1).replace("</body>", harness), encoding="utf-8")
    done = in_browser(folder, path.as_uri(), *options)
    answer = re.search(r'data-answer="(.*?)"(?: |>)', done.stdout)
    assert answer is not None, done.stderr
    return json.loads(unescape(answer[1]))


@pytest.mark.slow
def test_the_mechanism_turns_and_moves_in_a_browser(text, tmp_path):
    screenshot = "--window-size=800,700", f"--screenshot={tmp_path / 'page.png'}"
    found = answers(tmp_path, text, HARNESS, *screenshot)
    start, turned, nearer, home, first, last, back, all_instants, instant, usual, played = found
    assert 0.01 < start[0] < 0.6
    assert start[2] > 100  # the hottest colour is red
    assert turned[1] != start[1]
    assert nearer[0] > 1.3 * turned[0]
    assert home == start
    assert (first[5], last[5]) == ("0 rpm   t = 0.0 ms", "96 rpm   t = 50.0 ms")
    assert last[4] > first[4] + 5  # it has turned counter-clockwise, from the x axis upwards
    assert first[2] < 60  # without stress it has none of the hot colours
    assert back == start
    assert all_instants[2] + 30 < instant[2]  # this instant's largest stress is red on its own scale
    assert float(instant[6]) < float(all_instants[6])
    assert float(usual[6].removeprefix("≥ ")) < float(all_instants[6])
    assert usual[6].startswith("≥ ")
    assert played[5] != back[5]
    assert imread(tmp_path / "page.png")[..., :3].std() > 0.05


def test_pictures_and_tables_of_any_output_are_on_the_page():
    wanted = """output=[{type="envelope", file="worst.csv", body="beam", count=50},
      {type="envelope", file="all.png", body="beam", size=[160, 90]},
      {type="table", file="t.csv", quantities=["marker_position"], markers=["beam.tip"]},
      {type="film", file="f.mp4", frames=2, rate=1.0}, {type="envelope", file="all.vtu", body="beam"}]"""
    nodes, picture, table = show_outputs(load("beam", *QUICK, wanted).run)
    assert (nodes["title"], nodes["pictures"]) == ("Envelope: worst.csv", [])
    assert (nodes["table"]["header"][0], len(nodes["table"]["rows"]), nodes["table"]["left_out"]) == ("node", 12, 38)
    assert base64.b64decode(picture["pictures"][0]["png"]).startswith(b"\x89PNG")
    assert (picture["table"], table["pictures"]) == (None, [])
    assert table["table"]["rows"]


@pytest.mark.slow
def test_a_rigid_scene_has_a_page_too(fmd, tmp_path, capsys):
    path = tmp_path / "rod.html"
    assert fmd("report", "rod-slider", "--set", "simulation.duration=1 s", "--no-budget", "--out", path, "--json") == 0
    assert json.loads(capsys.readouterr().out)["bytes"] == path.stat().st_size
    page = Page(path.read_text(encoding="utf-8"))
    assert "canvas" in page.tags
    assert "element edges" not in page.cells
    assert len(page.addresses) == 3  # the mechanism, and the charts of Figs. 4 to 7


def test_a_part_alone_has_a_page_with_its_modes(fmd, tmp_path):
    scene = (files("fmd.models") / "beam.toml").read_text()
    path = tmp_path / "part.toml"
    path.write_text(scene[: scene.index("[joint.hub]")])
    coarse = [QUICK[0], "body.beam.modes.count=1"]
    assert fmd("report", path, "--set", coarse[0], "--set", coarse[1], "--out", tmp_path / "p.html") == 0
    page = Page((tmp_path / "p.html").read_text(encoding="utf-8"))
    assert f"{load(path, *coarse).modes.frequencies_hz[0]:.2f}" in page.cells
    assert len(page.addresses) == 1


def test_titles_and_overrides_are_text_even_where_they_look_like_html(tmp_path):
    title, note = "<script>alert(1)</script> & more", "'</code><b>"
    scene = load_scene("beam", [QUICK[0], "body.beam.modes.count=1"])
    text = make_page(solve(scene.model_copy(update={"title": title, "simulation_table": None})), [note])
    assert title not in text
    assert note not in text
    page = Page(text)
    assert title in page.cells
    assert page.tags.count("script") == 1  # the viewer's own
    assert "b" not in page.tags


def test_a_page_that_cannot_be_written_is_refused_before_anything_is_computed(fmd, tmp_path, capsys, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr("fmd.output.report.page.make_page", lambda *_: pytest.fail("computed"))
    assert fmd("report", "beam", "--out", tmp_path / "file" / "page.html") == 2
    assert "can't be written" in capsys.readouterr().err
