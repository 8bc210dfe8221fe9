"""The page of a mechanism before it runs: names, faces, sliders, and that a browser moves them."""

import base64
from importlib.resources import files

import numpy as np
import pytest

from fmd import load
from fmd.output.report.view_page import collect_poses, make_view_page
from tests.output.test_report import Page, answers

COARSE = "body.forearm.mesh.divisions=[6, 1, 1]"
PUSH = 'drive.push={type="point force",marker="gripper.wrist",direction=[0,-1,0],force="1 N"}'
# Points around each marker and at an empty corner, and moves two sliders.
HARNESS = """<script>
const answer = (value) => document.documentElement.dataset.answer = JSON.stringify(value);
addEventListener("error", (e) => answer(e.message));
addEventListener("load", () => {
  const figure = document.querySelector("figure"), canvas = document.querySelector("canvas"), states = [];
  const said = (name) => document.querySelector(`[name=${name}]`).textContent;
  const sliders = [...document.querySelectorAll("[name=clip]")];
  const labels = [...document.querySelectorAll(".labels span")];
  const tip = () => labels.at(-1).style.left + labels.at(-1).style.top;
  const point = (x, y) => {
    const box = canvas.getBoundingClientRect();
    const at = { pointerId: 1, clientX: box.left + x, clientY: box.top + y };
    canvas.dispatchEvent(new PointerEvent("pointermove", at));
    return said("over");
  };
  const names = new Set();
  for (const label of labels)
    for (let x = -40; x <= 40; x += 4)
      for (let y = -40; y <= 40; y += 4)
        names.add(point((parseFloat(label.style.left) / 100) * canvas.clientWidth + x,
          (parseFloat(label.style.top) / 100) * canvas.clientHeight + y));
  states.push([said("clock"), tip(), labels.map((label) => label.textContent), [...names], point(1, 1)]);
  const move = (k, value) => { sliders[k].value = value; sliders[k].dispatchEvent(new Event("input")); };
  move(1, sliders[1].max);
  states.push([said("clock"), tip(), sliders.map((slider) => slider.value)]);
  move(0, 3);
  states.push([said("clock"), tip(), sliders.map((slider) => slider.value)]);
  answer(states);
});
</script></body>"""

# Moves the crank by its prescribed angle and by the run to the same times, and plays the run.
PLAYED = """<script>
const answer = (value) => document.documentElement.dataset.answer = JSON.stringify(value);
addEventListener("error", (e) => answer(e.message));
addEventListener("load", async () => {
  const sliders = [...document.querySelectorAll("[name=clip]")], found = [];
  const clock = () => document.querySelector("[name=clock]").textContent;
  for (const value of [1, 16, 29, 48]) for (const slider of [sliders[0], sliders.at(-1)]) {
    slider.value = value; slider.dispatchEvent(new Event("input"));
    const labels = [...document.querySelectorAll(".labels span")];
    found.push([clock(), labels.map((label) => [parseFloat(label.style.left), parseFloat(label.style.top)])]);
  }
  document.querySelector("[name=play]").click();
  await new Promise((then) => setTimeout(then, 200));
  const shown = [clock(), sliders[0].value];
  sliders[0].value = 5; sliders[0].dispatchEvent(new Event("input"));
  await new Promise((then) => setTimeout(then, 200));
  answer([found, shown, clock(), document.querySelector("[name=play]").textContent]);
});
</script></body>"""


def unpacked(text, kind, *shape):
    return np.frombuffer(base64.b64decode(text), dtype=kind).reshape(*shape)


@pytest.fixture(scope="module")
def arm():
    return load("arm", COARSE, PUSH).run


def test_the_page_holds_each_coordinates_poses_markers_and_faces(arm):
    view = collect_poses(arm)
    assert [clip["name"] for clip in view["clips"]] == ["shoulder", "elbow", "wrist"]
    first, count = view["clips"][1]["first"], view["clips"][1]["count"]
    assert view["clocks"][0] == "at the start"
    assert len(view["clocks"]) == 1 + 3 * count
    names = view["markers"]["names"]
    assert "upper.elbow, forearm.elbow" in names  # one label where two markers coincide
    points = unpacked(view["markers"]["points"], "<f4", len(view["clocks"]), len(names), 3)
    elbow = points[first : first + count, names.index("upper.elbow, forearm.elbow")]
    assert np.ptp(elbow, axis=0).max() < 1e-6
    wrist = points[first : first + count, names.index("forearm.wrist, gripper.wrist")]
    away = np.linalg.norm(wrist - elbow, axis=1)
    assert away == pytest.approx(np.full(count, away[0]), rel=1e-5)  # on a circle around it
    forearm = next(body for body in view["bodies"] if body["name"] == "forearm")
    assert "displacements" not in forearm
    triangles, faces = unpacked(forearm["triangles"], "<u4", -1, 3), unpacked(forearm["faces"]["of"], "<u2", -1)
    corners = unpacked(forearm["positions"], "<f4", -1, 3)[triangles]
    far = forearm["faces"]["names"].index("x+")
    largest = corners[..., 0].max()
    assert np.array_equal(faces == far, (np.abs(corners[..., 0] - largest) < 1e-6).all(axis=1))
    drawn = {body["name"] for body in view["bodies"]}
    assert {"joint.elbow, revolute", "ground", "drive.push, point force", "drive.swing, torque"} <= drawn


def test_the_page_needs_no_network_and_no_motion(arm):
    page = Page(make_view_page(arm, ["a='</code><b>'"]))
    assert page.addresses == []
    assert "b" not in page.tags
    assert "motion" not in arm.results


def test_a_part_alone_has_nothing_to_view(fmd, tmp_path, capsys):
    scene, path = (files("fmd.models") / "beam.toml").read_text(), tmp_path / "part.toml"
    path.write_text(scene[: scene.index("[joint.hub]")])
    assert fmd("view", path, "--no-browser", "--out", tmp_path / "view.html") == 2
    assert "`fmd mesh` and `fmd modes` show a part" in capsys.readouterr().err
    assert not (tmp_path / "view.html").exists()


@pytest.mark.slow
def test_a_browser_names_what_the_pointer_is_over_and_moves_joints(fmd, tmp_path):
    path = tmp_path / "view.html"
    assert fmd("view", "arm", "--set", COARSE, "--no-browser", "--out", path) == 0
    start, turned, other = answers(tmp_path, path.read_text(encoding="utf-8"), HARNESS)
    assert start[0] == "at the start"
    assert {"upper.shoulder", "upper.elbow, forearm.elbow"} <= set(start[2])
    assert {"", "upper"} <= set(start[3])
    assert any(name.startswith("forearm, face ") for name in start[3])
    assert start[4] == ""
    assert (turned[0], turned[2][0]) == ("elbow 180.0°", "24")
    assert turned[1] != start[1]
    assert other[0].startswith("shoulder ")
    assert other[2][1] == "24"  # the other slider is back at the start


CRANK = ["body.rod.mesh.divisions=[8,1,1]", "body.rod.modes.count=2", "simulation.duration=48 ms"]
CRANK += ["simulation.output_step=1 ms", 'simulation.run=[{integrator="runge-kutta"}]']


def test_a_run_is_shown_where_its_markers_are():
    run = load("slider-crank", *CRANK).run
    view = collect_poses(run, run.motion)
    film, names = view["clips"][view["film"]], view["markers"]["names"]
    assert (film["name"], film["count"], view["clocks"][film["first"] + 16]) == ("run", 49, "run 16 ms")
    points = unpacked(view["markers"]["points"], "<f4", len(view["clocks"]), len(names), 3)
    ran = points[film["first"] :, names.index("rod.slider, slider.pin")]
    assert ran == pytest.approx(run.motion.tip_position, abs=1e-6)
    rod = next(body for body in view["bodies"] if body["name"] == "rod")
    bent = rod["step"] * unpacked(rod["displacements"], "<i2", len(view["clocks"]), -1)
    assert np.abs(bent[film["first"] :]).max() > 1e-3 > 1e9 * np.abs(bent[: film["first"]]).max()


def test_what_touches_is_shown_before_it_runs():
    view = collect_poses(load("drop", "body.plate.mesh.divisions=[4, 2, 1]", "body.plate.modes.count=1").run)
    assert view["film"] is None
    assert "plate" in {body["name"] for body in view["bodies"]}


@pytest.mark.slow
def test_a_browser_moves_the_crank_by_its_slider_as_it_ran_and_plays_the_run(fmd, tmp_path):
    path = tmp_path / "view.html"
    assert (
        fmd("view", "slider-crank", "--run", *(f"--set={each}" for each in CRANK), "--no-browser", "--out", path) == 0
    )
    found, shown, left, button = answers(tmp_path, path.read_text(encoding="utf-8"), PLAYED)
    for (moved, places), (ran, marched) in zip(found[::2], found[1::2], strict=True):
        assert ran == moved.replace("time", "run")
        assert np.array(places) == pytest.approx(np.array(marched), abs=0.1)  # [%]: the rod's ends come nearer, bent
    assert np.ptp([places for _, places in found], axis=0).max() > 20
    assert shown[0].startswith("run ")
    assert shown[0] != "run 48 ms"
    assert (shown[1], left, button) == ("0", "time 5 ms", "play")
