"""Wear by Archard's law: depth by pressure and slip, against closed forms and friction's work."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.contact.histories import FRICTION, MOST_WORN, WORN
from fmd.contact.recorded import ContactRecord
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.central_difference import CentralDifference
from fmd.output.contacts import contact_figures, contact_warnings
from fmd.output.pressure import draw_pressure
from fmd.recovery.wear import worn_faces
from fmd.scene.stress_outputs import ContactPressure
from tests.contact.test_rigid_contacts import scene
from tests.contact.test_surface_files import grid, write_stl
from tests.contact.touching_mechanisms import soft_footed_block

RATE, MASS, AREA = 1e-12, 2.0, 0.4


def worn_block(friction: float, gravity: Array, damping: float = 1e-4) -> tuple[Mechanism, float]:
    mechanism, sunk = soft_footed_block((AREA, 0.2), MASS, gravity, friction, 1e6, damping=damping)
    (body,) = mechanism.contacts
    planes = tuple(replace(plane, wear=RATE) for plane in body.planes)
    return replace(mechanism, contacts=[replace(body, planes=planes)]), sunk


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_block_on_a_slope_loses_by_its_weight_and_its_way(friction: float) -> None:
    """Its volume is ``k/H N s``; without friction, too. With it, all heat is μ times the force over the same way."""
    tilt = np.deg2rad(30.0)
    gravity = 10.0 * np.array([-np.sin(tilt), 0.0, -np.cos(tilt)])
    mechanism, sunk = worn_block(friction, gravity)
    system = share_system(mechanism)
    q0, v0 = mechanism.rest_positions, np.zeros(6)
    q0[2] = 0.1 - sunk
    times = np.linspace(0.0, 0.5, 51)
    motion = CentralDifference(0.25 * system.largest_step).march(system, q0, v0, times)
    values, way = motion.contacts, q0[0] - motion.q[:, 0]
    later = motion.times > 0.2
    normal = MASS * 10.0 * np.cos(tilt)
    found = np.polyfit(way[later], values[later, WORN], 1)[0]
    assert found == pytest.approx(RATE * normal, rel=1e-4)
    record = ContactRecord(mechanism.contacts, motion.contacts)
    depths = record.worn["block"] / (AREA / 8)
    np.testing.assert_allclose(record.worn["block"].sum(axis=1), values[:, WORN], rtol=1e-12)
    np.testing.assert_allclose(depths.max(axis=1), values[:, MOST_WORN], rtol=1e-12)
    assert (np.diff(depths, axis=0) >= 0.0).all()
    if friction > 0.0:
        assert values[-1, FRICTION] == pytest.approx(friction / RATE * values[-1, WORN], rel=2e-3)


def test_a_pin_that_turns_in_a_bore_loses_by_load_and_circumference() -> None:
    """Volume ``k/H F ω R t`` of a shaft that carries a weight, without friction: closed form of Archard's law."""
    radius, width, load, rate, duration = 0.01, 0.02, 20.0, 40.0, 0.02
    axis = {"start": [0, 0, -width / 2], "end": [0, 0, width / 2], "E": 207e9, "nu": 0.3}
    hub = {"mass": load / 10.0, "inertia": [1e-3] * 3, "marker": {"middle": {"at": [0, 0, 0]}}}
    bodies = {
        "shaft": {"mass": 1.0, "inertia": [1e-3] * 3, "marker": {"middle": {"at": [0, 0, 0]}}},
        "hub": hub | {"surface": {"bore": {"type": "bore", "radius": radius + 1e-4, **axis}}},
    }
    bodies["shaft"]["surface"] = {"journal": {"type": "pin", "radius": radius, **axis}}
    joints = {
        "turn": {"type": "revolute", "axis": [0, 0, 1], "parent": "ground", "child": "shaft.middle", "rate": rate},
        "slide": {"type": "prismatic", "axis": [0, 1, 0], "parent": "ground", "child": "hub.middle", "position": -1e-4},
    }
    fit = {"between": ["hub.bore", "shaft.journal"], "wear": "1e-14 1/Pa", "damping": 1e-4}
    table = scene({k: {"shape": "rigid"} | own for k, own in bodies.items()}, joints, {"fit": fit}, duration)
    table["simulation"]["gravity"] = [0, -10, 0]
    run = Pipeline(load_scene(table))
    figures = contact_figures(run)["contacts"]["fit"]
    assert figures["wear_volume_m3"] == pytest.approx(1e-14 * load * rate * radius * duration, rel=2e-3)
    assert "wear_depths_m" not in figures  # rigid bodies have no field
    assert "largest_wear_depth_m" not in figures  # and round ones no areas of points


def test_both_faces_of_a_pair_lose_the_volume_that_force_and_slip_say() -> None:
    """Of each face the depths over its areas are the volume, and of one pass the body with the larger face has less."""
    run = sliding_blocks()
    hit, (small, large) = run.motion.contacts["rub"], worn_faces(run.motion, "rub")
    assert (small.body, large.body) == ("small", "large")
    assert hit.wear_volume[-1] == pytest.approx(hit.friction_work[-1] * 1e-12 / 0.3, rel=0.02)  # all points slide
    volumes = run.motion.contact_wear
    np.testing.assert_allclose(volumes["small"].sum(axis=1), hit.wear_volume, rtol=1e-9)
    np.testing.assert_allclose(volumes["large"].sum(axis=1), hit.wear_volume, rtol=1e-9)
    assert small.depths[-1].max() == pytest.approx(hit.wear_depth[-1], rel=1e-9)
    figures = contact_figures(run)["contacts"]["rub"]["wear_depths_m"]
    assert figures == {"small.bottom": small.depths[-1].max(), "large.top": large.depths[-1].max()}
    assert 0.0 < figures["large.top"] < figures["small.bottom"]


def sliding_blocks(*overrides: str) -> Pipeline:
    """A block pressed by its weight that slides along a longer one, which is held by stiff springs of its own mesh."""
    return Pipeline(load_scene(blocks(), overrides))


def blocks() -> dict[str, Any]:
    """Tables of `sliding_blocks`."""
    material = {"E": "2 GPa", "nu": 0.3, "rho": "2000 kg/m^3", "shape": "bar"}
    modes = {"count": 2, "enrich": "none"}
    small = material | {"length": "20 mm", "depth": "20 mm", "width": "10 mm", "modes": modes}
    small |= {"mesh": {"divisions": [2, 2, 1], "order": 1}}
    large = material | {"length": "60 mm", "depth": "20 mm", "width": "20 mm", "modes": modes}
    large |= {"mesh": {"divisions": [4, 1, 1], "order": 1}}
    return {
        "title": "Sliding blocks",
        "body": {
            "small": small | {"marker": {"middle": {"at": ["10 mm", "0 mm", "0 mm"]}, "bottom": {"face": "y-"}}},
            "large": large | {"marker": {"base": {"face": "y-"}, "top": {"face": "y+"}}},
        },
        "joint": {
            "hold": {"type": "fixed", "parent": "ground", "child": "large.base"},
            "slide": {
                "type": "free",
                "parent": "ground",
                "child": "small.middle",
                "position": ["-15 mm", "30 mm", "0 mm"],
                "velocity": ["1 m/s", "0 m/s", "0 m/s"],
            },
        },
        "contact": {"rub": {"between": ["large.top", "small.bottom"], "friction": 0.3, "wear": "1e-12 1/Pa"}},
        "simulation": {
            "duration": "5 ms",
            "output_step": "0.1 ms",
            "step": "auto",
            "tip": "small.middle",
            "gravity": ["0 m/s^2", "-100 m/s^2", "0 m/s^2"],
            "run": [{"integrator": "central-difference"}],
        },
    }


def test_a_block_that_slides_over_finer_triangles_is_drawn_with_its_wear(tmp_path: Path) -> None:
    """Pressure is found at the triangles' corners, which aren't drawn; volumes are spread over the block's face."""
    flat, triangles = grid(0.02, 9)
    write_stl(tmp_path / "top.stl", np.pad(flat, ((0, 0), (0, 1))), triangles)
    table = blocks()
    surface = {"type": "file", "file": str(tmp_path / "top.stl"), "E": 2e9, "nu": 0.3, "rotation": [-np.pi / 2, 0, 0]}
    large = {"shape": "rigid", "mass": 1, "inertia": [1, 1, 1], "marker": {"base": {"at": [0, 0, 0]}}}
    table["body"]["large"] = large | {"surface": {"top": surface}}
    table["joint"]["slide"]["position"] = ["-15 mm", "10 mm", "0 mm"]
    run = Pipeline(load_scene(table, ["simulation.duration=1 ms"]))
    output = {"type": "pressure", "file": "wear.png", "contact": "rub"}
    drawn: dict[str, Any] = {}

    def keep(_name: str, _surface: Any, values: Any, _path: Path, **_words: Any) -> None:
        drawn.update(values=values)

    draw_pressure(run, ContactPressure.model_validate(output | {"quantity": "wear"}), tmp_path, keep)
    depths = contact_figures(run)["contacts"]["rub"]["wear_depths_m"]
    assert list(depths) == ["large.top", "small.bottom"]
    assert drawn["values"].max() == pytest.approx(1e6 * depths["small.bottom"], rel=1e-12)
    with pytest.raises(InputError, match="is of points of a rigid body"):
        draw_pressure(run, ContactPressure.model_validate(output), tmp_path, keep)


def test_pictures_of_wear_show_the_depth_of_either_face(tmp_path: Path) -> None:
    output = {"type": "pressure", "file": "wear.png", "contact": "rub", "quantity": "wear"}
    run = sliding_blocks()
    for chosen, number in (({}, 0), ({"body": "large"}, 1)):
        drawn: dict[str, Any] = {}

        def keep(
            _name: str, _surface: Any, values: Any, _path: Path, into: dict[str, Any] = drawn, **words: Any
        ) -> None:
            into.update(words, values=values)

        draw_pressure(run, ContactPressure.model_validate(output | chosen), tmp_path, keep)
        deepest = 1e6 * worn_faces(run.motion, "rub")[number].depths[-1].max()
        assert drawn["values"].max() == pytest.approx(deepest, rel=1e-12)
        assert drawn["quantity"] == "wear [µm]"


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ("contact.rub.wear=0.0", "needs the contact's wear"),
        ('output=[{type="pressure",file="p.png",contact="rub",quantity="wear",body="smal"}]', "smal"),
        ('output=[{type="pressure",file="p.png",contact="rub",body="small"}]', "is for wear"),
    ],
)
def test_pictures_of_wear_that_isnt_there_are_refused(override: str, told: str) -> None:
    picture = 'output=[{type="pressure",file="p.png",contact="rub",quantity="wear"}]'
    with pytest.raises(InputError, match=told):
        sliding_blocks(picture, override)


def test_wear_deeper_than_its_surface_gives_way_is_warned_of() -> None:
    found = {own["code"] for own in contact_warnings(sliding_blocks())}
    more = {own["code"] for own in contact_warnings(sliding_blocks('contact.rub.wear="1e-7 1/Pa"'))}
    assert "contact-worn" not in found
    assert "contact-worn" in more
