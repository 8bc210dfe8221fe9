"""Tables of a scene that name one another: each fault has one message with the key and what would work."""

from pathlib import Path

import pytest

from fmd.scene.scene import load_scene
from tests.scene.scenes import ARM, BEAM, ELBOW, PLATE, SLIDER, refused, scene_of


@pytest.mark.parametrize("parent", ["ground", "rod.rest", "slider.centre"])
@pytest.mark.parametrize("kind", ["fixed", "spherical", "free"])
def test_a_rigid_body_hangs_on_any_joint_and_any_body(tmp_path: Path, kind: str, parent: str) -> None:
    scene = scene_of(tmp_path, SLIDER + PLATE.replace('"{}"', f'"{kind}"', 1).replace("{}", parent))
    plate = scene.body["plate"]
    assert (scene.joint["last"].type, plate.centre, plate.inertia) == (kind, (0.0, 0.0, 0.0), (0.1, 0.2, 0.3))
    assert plate.marker["a"].at == (-0.05, 0.0, 0.0)


def test_a_joint_is_driven_only_as_it_moves() -> None:
    force = 'drive.motor={type="force", joint="slide", force="2 kN"}'
    assert load_scene("rod-slider", [force]).drive["motor"].force.constant == 2000.0
    pulse = 'drive.motor={type="torque pulse", joint="hinge", duration="1 s", torque="1 N m"}'
    assert load_scene("rod-slider", [pulse]).drive["motor"].torque == 1.0
    for drive, message in {
        force.replace("slide", "hinge"): "is a revolute joint; a force needs a prismatic one",
        pulse.replace("hinge", "slide"): "is a prismatic joint; a torque pulse needs a revolute or screw one",
        "drive.motor.joint=slide": "is a prismatic joint; a torque needs a revolute or screw one",
    }.items():
        with refused(message):
            load_scene("rod-slider", [drive])


FIXED = 'joint.slide={type="fixed", parent="rod.rest", child="slider.centre"}'


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        # bodies
        (["body.rod.mass=0 kg"], "body.rod.mass = '0 kg': must be greater than zero"),
        (["body.rod.mass=2 m"], "'2 m' is a length, a mass is wanted, e.g. '2 kg'"),
        (["body.rod.length=0 m"], "body.rod.length = '0 m': must be greater than zero"),
        (["body.slider.mass=-1 kg"], "body.slider.mass = '-1 kg': must be greater than zero"),
        (["body.slider.length=1 m"], "body.slider.length = '1 m': no such key; the keys here: shape, mass, marker"),
        (["body.rod.marker.rest={face='x+'}"], "body.rod.marker.rest.face = 'x+': no such key; the keys here: at"),
        (["body.rod.marker.rest.at=['1 m', '0 m']"], "body.rod.marker.rest.at.2: is missing"),
        (["body.rod.marker.rest.at.0=1"], "body.rod.marker.rest.at.0 = 1: needs a unit"),
        # joints
        (["joint.hinge.spring=-1 N m"], "joint.hinge.spring = '-1 N m': must not be negative"),
        (["joint.hinge.damper=-1 N m s"], "joint.hinge.damper = '-1 N m s': must not be negative"),
        (["joint.hinge.spring=1 N/m"], "'1 N/m' is a translational stiffness, a rotational stiffness is wanted"),
        (["joint.hinge.damper=1 N s/m"], "'1 N s/m' is a translational damping, a rotational damping is wanted"),
        (["joint.slide.spring=-1 N/m"], "joint.slide.spring = '-1 N/m': must not be negative"),
        (["joint.slide.damper=-1 N s/m"], "joint.slide.damper = '-1 N s/m': must not be negative"),
        (["joint.slide.position=1 deg"], "'1 deg' is an angle, a length is wanted"),
        (["joint.slide.rate=1 rad/s"], "'1 rad/s' is an angular rate, a speed is wanted, e.g. '3 m/s'"),
        (["joint.slide.angle=1 rad"], "joint.slide.angle = '1 rad': no such key"),
        (["joint.slide.axis=[0, 0, 0]"], "joint.slide.axis = [0, 0, 0]: has no direction"),
        (["joint.slide.type=hinge"], "must be one of 'revolute', 'prismatic', 'fixed', 'spherical', 'free'"),
        ([FIXED.replace("}", ", axis=[1, 0, 0]}")], "joint.slide.axis = [1, 0, 0]: no such key"),
        (["joint.hinge.parent=slider.centre"], "body.rod: its joints lead round in a circle; one must lead to ground"),
        (
            ["joint.slide.parent=rod.mid"],
            "joint.slide.parent = 'rod.mid': no such marker; did you mean 'rod.hinge'? the",
        ),
        # fast joints
        (["simulation.fast=['slid']"], "simulation.fast.0 = 'slid': no such joint; did you mean 'slide'?"),
        (["simulation.fast=['hinge', 'rod']"], "simulation.fast.1 = 'rod': no such joint"),
        ([FIXED, "output=[]"], "is a fixed joint; the fast list needs a revolute, prismatic or screw one"),
        (["simulation.fast=slide"], "simulation.fast = 'slide': must be a list"),
        # charts
        (["output.0.joint=hing"], "output.0.joint = 'hing': no such joint; did you mean 'hinge'?"),
        ([FIXED, "simulation.fast=[]"], "output.1.joint = 'slide': is a fixed joint; joint_position needs a revolute"),
        (["output.0.unit=mm"], "output.0.unit = 'mm': isn't a unit that rad converts to; 'rad' works"),
        (["output.1.unit=deg"], "output.1.unit = 'deg': isn't a unit that m converts to; 'm' works"),
        (["output.1.unit=9**9**9"], "output.1.unit = '9**9**9': isn't a unit that m converts to; 'm' works"),
        (['output.0={type="chart", file="a.png", quantity="joint_position"}'], "output.0.joint: is missing: the name"),
        (
            ['output.0={type="chart", file="a.png", quantity="marker_position", marker="rod.en"}'],
            "output.0.marker = 'rod.en': no such marker; did you mean 'rod.",
        ),
        (
            ['output.0={type="chart", file="a.png", quantity="marker_position"}'],
            "output.0.marker: is missing: 'body.marker', the marker",
        ),
        (
            ['output.0={type="chart", file="a.png", quantity="modal_coordinates"}'],
            "output.0.quantity = 'modal_coordinates': needs a flexible body; this scene has none",
        ),
        (
            ['output.0={type="chart", file="a.png", quantity="modal_coordinates", body="rod"}'],
            "output.0.body = 'rod': no such flexible body",
        ),
        (
            ['output.0={type="chart", file="a.png", quantity="energy", body="rod"}'],
            "output.0.body = 'rod': belongs to the quantity 'modal_coordinates'",
        ),
        (["output.0.quantity=energy"], "output.0.joint = 'hinge': belongs to"),
        (
            ['output.0={type="chart", file="a.png", quantity="energy", unit="mm"}'],
            "output.0.unit = 'mm': belongs to",
        ),
    ],
)
def test_a_fault_in_a_chain_names_its_key_and_what_would_work(overrides: list[str], message: str) -> None:
    with refused(message):
        load_scene("rod-slider", overrides)


def test_the_unit_of_a_chart_may_be_left_out() -> None:
    chart = '{type="chart", file="a.png", quantity="joint_position", joint="slide"}'
    assert load_scene("rod-slider", [f"output.0={chart}"]).output[0].unit is None


@pytest.mark.parametrize("kind", ["modes", "stress", "film"])
def test_only_a_flexible_body_has_pictures(tmp_path: Path, kind: str) -> None:
    number = {"modes": 3, "stress": 4, "film": 5}[kind]
    text = BEAM + PLATE.replace('"{}"', '"fixed"', 1).replace("{}", "beam.tip")
    message = f"output.{number}.body = 'plate': is rigid, without modes or stress; the flexible bodies: beam"
    with refused(message):
        scene_of(tmp_path, text, f"output.{number}.body=plate")


def test_a_body_hangs_on_one_joint(tmp_path: Path) -> None:
    with refused("body.arm: hangs on no joint; give it one with child = 'arm.…'"):
        scene_of(tmp_path, BEAM + ARM)
    twice = ELBOW.format("ground") + ELBOW.format("beam.tip").replace("elbow", "other")
    assert scene_of(tmp_path, BEAM + ARM + twice).closing == ("other",)
    with refused("body.beam: its joints lead round in a circle; one must lead to ground\n"):
        scene_of(tmp_path, BEAM + ARM + ELBOW.format("beam.tip"), "joint.hub.parent=arm.b")


def test_a_chart_of_stress_takes_units_of_stress() -> None:
    chart = 'output=[{type="chart", file="a.png", quantity="element_stress", element="propeller.joint", unit="UNIT"}]'
    assert load_scene("propeller-gust", [chart.replace("UNIT", "kPa")]).output[0].unit == "kPa"  # type: ignore[union-attr]
    with refused("output.0.unit = 'mm': isn't a unit that Pa converts to; 'Pa' works"):
        load_scene("propeller-gust", [chart.replace("UNIT", "mm")])


CLOSING = 'joint.two={type="revolute", parent="rod.rest", child="ground", axis=[0, 0, 1]}'


@pytest.mark.parametrize(
    "use",
    [
        'drive.more={type="torque", joint="two", torque="1 N m"}',
        'simulation.fast=["two"]',
        "joint.two.damper=1 N m s",
    ],
)
def test_what_takes_the_coordinate_of_a_joint_from_a_carried_body_to_the_ground_is_refused(use: str) -> None:
    assert load_scene("rod-slider", [CLOSING]).closing == ("two",)
    with refused("with parent = 'ground' and child = 'rod.rest' before the other joint that carries rod, which closes"):
        load_scene("rod-slider", [CLOSING, use])


def test_of_a_body_that_hangs_on_nothing_the_cause_alone_is_told() -> None:
    with refused("hangs on nothing: parent = 'ground' and child = 'rod.hinge' work") as refusal:
        load_scene("rod-slider", ["joint.hinge.parent=rod.hinge", "joint.hinge.child=ground"])  # which a drive turns
    assert "closes a loop" not in str(refusal.value)


@pytest.mark.parametrize("kind", ["spherical", "free"])
def test_the_exponential_method_is_refused_rotations_in_space(tmp_path: Path, kind: str) -> None:
    """A joint that closes a loop adds none."""
    ball, run = SLIDER + PLATE.replace("{}", kind, 1).replace("{}", "ground"), "simulation.run=[{{integrator='{}'}}]"
    message = "takes no rotations in space, such as joint 'last' has; exponential-rosenbrock, runge-kutta and auto do"
    with refused(f"simulation.run.0.integrator = 'exponential': {message}"):
        scene_of(tmp_path, ball, run.format("exponential"))
    for other in ("exponential-rosenbrock", "auto"):
        assert scene_of(tmp_path, ball, run.format(other)).joint["last"].type == kind
    held = "joint.last.type=fixed", "joint.more={type='spherical', parent='ground', child='plate.a'}"
    assert scene_of(tmp_path, ball, run.format("exponential"), *held).closing == ("more",)
