"""Contacts of rigid bodies: against Hertz, Hunt & Crossley, Coulomb, conservation laws and an independent model."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from fmd import Pipeline, load_scene
from fmd.contact.round_laws import DEPTH, LOAD, PEAK, SIZE, RoundLaw, ball_law, joint_modulus, pin_law
from fmd.core.errors import InputError
from fmd.output.contacts import contact_figures, contact_warnings
from fmd.output.mechanism_view import shape_surfaces
from fmd.output.pressure import draw_pressure
from tests.contact.test_contact_points import BLOCK

MASS, RADIUS, E, NU, SPEED = 0.03266, 0.01, 210e9, 0.3, 0.05
STIFF = E / (1.0 - NU**2)
STEEL = {"E": E, "nu": NU}
BALL = {
    "shape": "rigid",
    "mass": MASS,
    "inertia": [0.4 * MASS * RADIUS**2] * 3,
    "marker": {"centre": {"at": [0, 0, 0]}},
    "surface": {"skin": {"type": "ball", "radius": RADIUS, **STEEL}},
}


def free(body: str, place: list[float], speed: list[float]) -> dict[str, Any]:
    return {"type": "free", "parent": "ground", "child": body, "position": place, "velocity": speed}


def scene(
    body: dict[str, Any], joint: dict[str, Any], contact: dict[str, Any], duration: float, **simulation: Any
) -> dict[str, Any]:
    child = next(iter(joint.values()))["child"]
    usual = {"duration": duration, "output_step": duration / 200, "step": "auto", "tip": child, "gravity": [0, 0, 0]}
    runs = {"run": [{"integrator": "central-difference"}]}
    return {"title": "Rigid", "body": body, "joint": joint, "contact": contact, "simulation": usual | runs | simulation}


def ball(speed: list[float], duration: float, contact: dict[str, Any] | None = None, **simulation: Any) -> Pipeline:
    height = RADIUS if simulation else RADIUS + 1e-6
    joint = {"free": free("ball.centre", [0, 0, height], speed)}
    floor = {"between": ["ground", "ball.skin"], "normal": [0, 0, 1], **(contact or {})}
    return Pipeline(load_scene(scene({"ball": BALL}, joint, {"floor": floor}, duration, **simulation)))


@pytest.fixture(scope="module")
def dropped() -> Pipeline:
    return ball([0, 0, -SPEED], 3e-4)


def test_a_ball_bounces_as_hertz_says(dropped: Pipeline) -> None:
    """Approach ``(15 m v²/(16 E* √R))^0.4``, contact for 2.9432 of it over v (Johnson, Contact Mechanics, 11.1)."""
    floor = contact_figures(dropped)["contacts"]["floor"]
    approach = (15.0 / 16.0 * MASS * SPEED**2 / (STIFF * np.sqrt(RADIUS))) ** 0.4
    force = 4.0 / 3.0 * STIFF * np.sqrt(RADIUS) * approach**1.5
    assert floor["near_field"] == "Hertz"
    assert floor["largest_force_n"] == pytest.approx(force, rel=1e-3)
    assert floor["end_s"] - floor["begin_s"] == pytest.approx(2.9432 * approach / SPEED, rel=0.05)  # steps are 1/32
    assert floor["largest_pressure_pa"] == pytest.approx(1.5 * force / (np.pi * RADIUS * approach), rel=1e-3)
    assert floor["largest_area_m2"] == pytest.approx(np.pi * RADIUS * approach, rel=1e-3)
    assert dropped.motion.trajectory.v[-1, 2] == pytest.approx(SPEED, rel=1e-4)
    assert floor["impulse_n_s"][2] == pytest.approx(2.0 * MASS * SPEED, rel=1e-4)


@pytest.mark.parametrize("restitution", [0.9, 0.5])
def test_a_shock_leaves_the_speed_that_its_restitution_says(restitution: float) -> None:
    run = ball([0, 0, -SPEED], 4e-4, {"restitution": restitution})
    floor, kinetic = contact_figures(run)["contacts"]["floor"], 0.5 * MASS * SPEED**2
    assert run.motion.trajectory.v[-1, 2] == pytest.approx(restitution * SPEED, rel=0.02)
    assert floor["damping_work_j"] == pytest.approx((1.0 - restitution**2) * kinetic, rel=0.03)
    assert abs(floor["energy_error_j"]) < 0.01 * kinetic


def test_generalised_alpha_lets_a_ball_bounce_as_central_differences_do(dropped: Pipeline) -> None:
    step = next(iter(dropped.plans.values())).integrator.step
    other = ball([0, 0, -SPEED], 3e-4, run=[{"integrator": "generalized-alpha"}], step=step)
    first, second = (run.motion.contacts["floor"].figures for run in (dropped, other))
    assert other.motion.trajectory.v[-1, 2] == pytest.approx(SPEED, rel=0.01)
    for name in ("largest_force_n", "largest_area_m2", "largest_pressure_pa"):
        assert second[name] == pytest.approx(first[name], rel=0.01)


def test_a_blow_after_a_gentle_touch_loses_what_its_own_speed_says() -> None:
    """A ball that lies on the floor, touched at 1e-6 m/s, is struck; it leaves at 0.99 of the speed without a loss."""

    def speed(restitution: float) -> float:
        joint = {"free": free("ball.centre", [0, 0, RADIUS], [0, 0, -1e-6])}
        floor = {"between": ["ground", "ball.skin"], "normal": [0, 0, 1], "restitution": restitution}
        own = scene({"ball": BALL}, joint, {"floor": floor}, 1.3e-3, step=1e-6, gravity=[0, 0, -9.81])
        size = {"formula": "0 if t < 0.001 else (300 if t < 0.00105 else 0)", "unit": "N"}
        blow = {"type": "point force", "marker": "ball.centre", "direction": [0, 0, -1], "force": size}
        return float(Pipeline(load_scene(own | {"drive": {"blow": blow}})).motion.trajectory.v[-1, 2])

    whole = speed(1.0)
    assert whole > 0.3
    assert 0.97 * whole < speed(0.99) < whole


def test_a_blow_shorter_than_the_step_for_a_soft_contact_shortens_it() -> None:
    """A ball of rubber above the floor: half a sine of force leaves ``2 F T/π`` of momentum, by four steps or more."""
    width, force = 2e-5, 500.0
    rubber = BALL | {"surface": {"skin": {"type": "ball", "radius": RADIUS, "E": 2e6, "nu": NU}}}
    joint = {"free": free("ball.centre", [0, 0, RADIUS + 1e-3], [0, 0, 0])}
    floor = {"between": ["ground", "ball.skin"], "normal": [0, 0, 1]}
    wave = f"{force}*sin(pi*(t - 0.001)/{width})"
    size = {"formula": f"0 if t < 0.001 else ({wave} if t < {0.001 + width} else 0)", "unit": "N"}
    blow = {"type": "point force", "marker": "ball.centre", "direction": [1, 0, 0], "force": size}
    own = scene({"ball": rubber}, joint, {"floor": floor}, 2e-3)
    alone, struck = (Pipeline(load_scene(own | {"drive": drive})) for drive in ({}, {"blow": blow}))
    steps = [next(iter(run.plans.values())).integrator.step for run in (alone, struck)]
    assert steps[1] == pytest.approx(width / 4, rel=1e-9)
    assert steps[0] > 2 * width
    assert struck.motion.trajectory.v[-1, 0] == pytest.approx(2.0 * force * width / np.pi / MASS, rel=0.06)


def test_two_contacts_of_one_ball_have_the_forces_of_each_apart() -> None:
    """A ball flies into a corner, aslant; floor and wall touch at once, and neither knows of the other."""
    joint = {"free": free("ball.centre", [RADIUS + 1e-6, 0, RADIUS + 2e-6], [-SPEED, 0, -0.5 * SPEED])}
    wide = {
        "floor": {"between": ["ground", "ball.skin"], "normal": [0, 0, 1]},
        "wall": {"between": ["ground.wall", "ball.skin"], "normal": [1, 0, 0], "restitution": 0.8},
    }

    def corner(*names: str) -> Pipeline:
        own = scene({"ball": BALL}, joint, {name: wide[name] for name in names}, 3e-4, step=5e-7)
        return Pipeline(load_scene(own | {"ground": {"wall": {"at": [0, 0, 0]}}}))

    both = corner("floor", "wall")
    ((x,), own) = {len(body.points.x): body for body in both.motion.mechanism.contacts}.keys(), both.motion.contacts
    assert x == 2  # no points beside those of the contacts
    assert (own["floor"].force[:, 2] * own["wall"].force[:, 0]).max() > 0.0
    for name in wide:
        apart = corner(name).motion.contacts[name].force
        np.testing.assert_allclose(own[name].force, apart, atol=1e-6 * np.abs(apart).max())


def test_a_ball_that_slides_comes_to_roll_at_five_sevenths_of_its_speed() -> None:
    """Friction's impulse turns it as it slows it down, whatever the force over time (Routh)."""
    run = ball([0.1, 0, 0], 0.03, {"friction": 0.3, "damping": 2e-5}, gravity=[0, 0, -9.81])
    v, own = run.motion.trajectory.v, run.motion.contacts["floor"]
    assert v[-1, 0] == pytest.approx(0.1 * 5 / 7, rel=2e-3)
    assert v[-1, 4] * RADIUS == pytest.approx(v[-1, 0], rel=2e-3)  # which rolls: no more slip
    lost = 0.5 * MASS * 0.1**2 * 2 / 7  # of a ball's energy
    assert own.friction_work[-1] == pytest.approx(lost, rel=0.01)
    assert not contact_warnings(run)


def crate(friction: float, **simulation: Any) -> Pipeline:
    """A box on a plane; gravity leans by 30°."""
    size, mass = np.array([0.2, 0.1, 0.1]), 2.0
    inertia = mass / 12 * ((size**2).sum() - size**2)
    body = {"shape": "rigid", "mass": mass, "inertia": inertia.tolist(), "marker": {"middle": {"at": [0, 0, 0]}}}
    body["surface"] = {"skin": {"type": "box", "size": size.tolist(), "E": 1e9, "nu": 0.3, "rounding": 0.01}}
    joint = {"free": free("crate.middle", [0, 0, 0.05], [0, 0, 0])}
    floor = {"between": ["ground", "crate.skin"], "normal": [0, 0, 1], "friction": friction, "damping": 1e-3}
    gravity = [5.0, 0, -10.0 * np.sqrt(0.75)]
    return Pipeline(load_scene(scene({"crate": body}, joint, {"floor": floor}, 0.1, gravity=gravity, **simulation)))


def test_a_box_slides_down_a_slope_as_coulomb_says() -> None:
    """30° and μ 0.3: 2.401924 m/s²; sinking in at first takes a part of the impulse along the normal."""
    run = crate(0.3)
    own, v = run.motion.contacts["floor"], run.motion.trajectory.v[-1, 0]
    normal, across = own.impulse[-1, 2], -own.impulse[-1, 0]
    assert across == pytest.approx(0.3 * normal, rel=1e-3)  # it slides all the time
    assert v == pytest.approx(5.0 * 0.1 - across / 2.0, rel=1e-6)  # momentum
    assert v == pytest.approx(0.2401924, rel=5e-3)


def test_a_box_at_rest_on_a_slope_stays_there() -> None:
    run = crate(0.8, start="equilibrium")
    own = run.motion.contacts["floor"]
    np.testing.assert_allclose(own.force[:, 2], 20.0 * np.sqrt(0.75), rtol=1e-3)
    np.testing.assert_allclose(own.force[:, 0], -10.0, rtol=1e-3)
    assert np.abs(run.motion.trajectory.v).max() < 1e-3 * 10.0 * 0.1
    moving = crate(0.3).motion.trajectory  # next to no kinetic energy is no reason for shorter steps
    assert run.motion.trajectory.evaluations == moving.evaluations
    assert not contact_warnings(run)


def test_a_pendulum_leaves_a_stop_with_its_restitution() -> None:
    bob = {**BALL, "marker": {"hinge": {"at": [0, 0, 0.2]}, "centre": {"at": [0, 0, 0]}}}
    hinge = {"type": "revolute", "parent": "ground", "child": "bob.hinge", "axis": [0, 1, 0], "angle": -0.02}
    wall = {"between": ["ground.wall", "bob.skin"], "normal": [1, 0, 0], "restitution": 0.8}
    own = scene({"bob": bob}, {"hinge": hinge}, {"wall": wall}, 0.5, gravity=[0, 0, -9.81])
    run = Pipeline(load_scene(own | {"ground": {"wall": {"at": [-RADIUS, 0, -0.2]}}}))
    rates, angles = run.motion.trajectory.v[:, 0], run.motion.trajectory.q[:, 0]
    begin, end = run.motion.contacts["wall"].span
    assert begin is not None
    before, after = np.searchsorted(run.motion.times, begin) - 1, np.searchsorted(run.motion.times, end) + 1
    at_stop = [
        np.sqrt(r**2 + (MASS * 9.81 * 0.2) / (MASS * 0.2**2 * 1.001) * a**2)
        for r, a in ((rates[before], angles[before]), (rates[after], angles[after]))
    ]
    assert at_stop[1] / at_stop[0] == pytest.approx(0.8, rel=5e-3)


def test_two_balls_that_meet_aslant_keep_momentum_and_angular_momentum() -> None:
    """They roll and slip on each other; forces are equal, opposite and at one place."""
    joint = {
        "one": free("one.centre", [0, 0, 0], [0.05, 0, 0]),
        "two": free("two.centre", [2 * RADIUS + 1e-6, 0.006, 0.003], [-0.05, 0.02, 0]),
    }
    joint["two"]["position"][0] = float(np.sqrt(4 * RADIUS**2 - 0.006**2 - 0.003**2)) + 2e-6
    contact = {"hit": {"between": ["one.skin", "two.skin"], "friction": 0.2}}
    run = Pipeline(load_scene(scene({"one": BALL, "two": BALL}, joint, contact, 3e-4)))
    kinematics, own = run.motion.kinematics, run.motion.contacts["hit"]
    assert np.abs(own.force).max() > 10.0
    assert np.ptp(kinematics.momentum, axis=0).max() < 1e-12 * MASS * SPEED
    assert np.ptp(kinematics.angular_momentum, axis=0).max() < 1e-6 * MASS * SPEED * RADIUS
    kinetic = run.motion.energies[0]
    assert kinetic[-1] + own.friction_work[-1] == pytest.approx(kinetic[0], rel=1e-3)
    assert kinetic[-1] < kinetic[0]


def test_a_ball_in_a_bore_is_hertz_of_unlike_curvatures() -> None:
    """Greenwood's formulas for ``δ = (9 F²/(16 E*² R))^(1/3) F2``: better than 0.5 % up to κ1/κ2 = 5."""
    row = ball_law((20.0, 100.0), STIFF)[0]
    ratio, mean = 5.0, 1.0 / np.sqrt(2000.0)
    shape = 1.0 - (ratio**0.0684 - 1.0) ** 1.531
    assert row[LOAD] == pytest.approx(4.0 / 3.0 * STIFF * np.sqrt(mean) * shape**-1.5, rel=5e-3)


@pytest.mark.parametrize("bore", [np.inf, 0.0101])
def test_a_pin_presses_as_hertz_says_and_sinks_as_its_length_lets_it(bore: float) -> None:
    """Half width and pressure of a line contact; the approach by integrating Hertz's pressure over the rectangle."""
    radius, length, modulus = 0.01, 0.02, joint_modulus((E, NU), (E, NU))
    rows, _ = pin_law(radius, bore, length, modulus)
    between = radius if np.isinf(bore) else radius * bore / (bore - radius)
    for row in rows[3:12:3]:
        line = row[LOAD] / length
        half, peak = np.sqrt(4.0 * line * between / (np.pi * modulus)), np.sqrt(line * modulus / (np.pi * between))
        assert row[SIZE] == pytest.approx(2.0 * half * length, rel=0.01)
        assert row[PEAK] * row[LOAD] / row[SIZE] == pytest.approx(peak, rel=0.02)
        depth, _ = quad(
            lambda u, half=half: half * np.cos(u) ** 2 * np.arcsinh(0.5 * length / abs(half * np.sin(u))), 0, np.pi / 2
        )
        assert row[DEPTH] == pytest.approx(4.0 * peak / (np.pi * modulus) * depth, rel=0.01)


def test_the_loss_of_a_restitution_is_that_of_a_shock_with_any_law() -> None:
    """By marching ``x'' = −x^n (1 + c x'/v)``; and near 1 it is Lankarani's and Nikravesh's."""
    row = (1.0, 1.0, 1.5, 0.0, 1.0, 1.0, 1.5)
    assert RoundLaw((row,), 0.99).loss == pytest.approx(0.75 * (1.0 - 0.99**2), rel=0.02)
    for power in (1.1, 1.5):
        c, x, v, h = RoundLaw((row,), 0.6).loss, 0.0, 1.0, 1e-4
        while x >= 0.0:
            v -= h * max(0.0, x) ** power * (1.0 + c * v)
            x += h * v
        assert -v == pytest.approx(0.6, rel=1e-3)


def test_a_law_of_pieces_has_the_energy_of_its_force() -> None:
    rows, ends = pin_law(0.01, 0.0101, 0.02, STIFF)
    law = RoundLaw(rows, 1.0, ends)
    x = np.geomspace(1e-13, 0.9 * ends, 20001)
    table = np.array(rows)
    at = np.maximum(0, np.searchsorted(table[:, DEPTH], x, side="right") - 1)
    force = table[at, LOAD] * (x / table[at, DEPTH]) ** table[at, 2]
    energy = float(np.trapezoid(force, x))
    assert law.depth_under(0.0, energy) == pytest.approx(0.9 * ends, rel=1e-3)
    assert law.depth_under(float(force[-1]), 0.0) == pytest.approx(0.9 * ends, rel=1e-3)


def test_a_pin_that_sinks_into_a_plane_is_warned_of_as_one_in_a_bore_is() -> None:
    """Each by the thing that it touches; in a bore in either order, about the bore's or the pin's middle."""
    axis = {"start": [-0.01, 0, 0], "end": [0.01, 0, 0], "E": 1e5, "nu": 0.3}
    pin = BALL | {"surface": {"skin": {"type": "pin", "radius": RADIUS, **axis}}}
    bore = BALL | {"surface": {"skin": {"type": "bore", "radius": RADIUS + 1e-4, **axis}}}

    def warnings(bodies: dict[str, Any], *between: str, **contact: Any) -> list[str]:
        joint = {name: free(f"{name}.centre", [0, 0, RADIUS], [0, 0, 0]) for name in bodies}
        joint["pin"]["velocity"][2] = -2.0
        own = scene(bodies, joint, {"hit": {"between": list(between), **contact}}, 4e-3, step=2e-5)
        return [own["text"] for own in contact_warnings(Pipeline(load_scene(own))) if own["code"] == "contact-wide"]

    (text,) = warnings({"pin": pin}, "ground", "pin.skin", normal=[0, 0, 1])
    assert "into the plane" in text
    for between in (("pin.skin", "bore.skin"), ("bore.skin", "pin.skin")):
        (text,) = warnings({"pin": pin, "bore": bore}, *between)
        assert "of its bore's round" in text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"between": ["ground", "ball.centre"]}, "surface"),
        ({"near_field": "half-space"}, "round rigid surfaces have laws of their own"),
        ({"restitution": 0.0}, "restitution"),
    ],
)
def test_what_rigid_contacts_can_not_do_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ball([0, 0, 0], 1e-3, change)


def test_a_rigid_body_without_a_surface_is_told_how_to_have_one() -> None:
    with pytest.raises(InputError, match=r"without a surface; give it one, e.g. \[body.ball.surface.skin\]"):
        load_scene(
            scene(
                {"ball": BALL | {"surface": {}}},
                {"free": free("ball.centre", [0, 0, 1], [0, 0, 0])},
                {"floor": {"between": ["ground", "ball.skin"], "normal": [0, 0, 1]}},
                1e-3,
            )
        )


@pytest.mark.parametrize("kinds", [("box", "pin"), ("pin", "pin"), ("box", "bore")])
def test_surfaces_that_have_no_points_for_each_other_are_refused(kinds: tuple[str, str]) -> None:
    axis = {"start": [0, 0, -0.01], "end": [0, 0, 0.01], "radius": 0.01}
    keys = {"box": {"size": [0.01] * 3}, "pin": axis, "bore": axis}
    body = {
        name: BALL | {"surface": {"skin": {"type": kind, **STEEL, **keys[kind]}}}
        for name, kind in zip(("one", "two"), kinds, strict=True)
    }
    joint = {name: free(f"{name}.centre", [x, 0, 0], [0, 0, 0]) for name, x in (("one", 0.0), ("two", 0.1))}
    run = Pipeline(load_scene(scene(body, joint, {"hit": {"between": ["one.skin", "two.skin"]}}, 1e-3)))
    with pytest.raises(InputError, match=f"a {kinds[0]} and a {kinds[1]}'?: can't be followed"):
        _ = run.mechanism


def test_what_may_touch_is_drawn_and_pressure_has_no_mesh(dropped: Pipeline) -> None:
    ((surface, _),) = shape_surfaces(dropped, "ball", 1.0)
    np.testing.assert_allclose(np.linalg.norm(surface.points, axis=1), RADIUS, rtol=1e-12)
    output = {"output": [{"type": "pressure", "file": "p.png", "contact": "floor"}]}
    joint = {"free": free("ball.centre", [0, 0, RADIUS + 1e-6], [0, 0, -SPEED])}
    floor = {"between": ["ground", "ball.skin"], "normal": [0, 0, 1]}
    run = Pipeline(load_scene(scene({"ball": BALL}, joint, {"floor": floor}, 3e-4) | output))
    with pytest.raises(InputError, match="which has no mesh to draw it on"):
        draw_pressure(run, run.scene.output[0], None)  # type: ignore[arg-type]


def test_a_flexible_block_falls_on_a_rigid_table_as_on_the_ground() -> None:
    """The table is a box held by the ground; its top is where the plane was."""
    tilt = ['joint.free.rotate=["2 deg", "0 deg", "3 deg"]', "simulation.duration=16 ms", "contact.floor.friction=0.4"]
    tilt.append('joint.free.position=["0 m", "57 mm", "0 m"]')
    size = {"size": [1.0, 0.2, 1.0], "at": [0, -0.1, 0], "rounding": 0.02}
    table = {"shape": "rigid", "mass": 1.0, "inertia": [1.0] * 3, "marker": {"top": {"at": [0, 0, 0]}}}
    table["surface"] = {"skin": {"type": "box", **STEEL, **size}}
    held = {"type": "fixed", "parent": "ground", "child": "table.top"}
    contact = {"floor": {"between": ["table.skin", "block.bottom"], "friction": 0.4}}
    other = {"body": BLOCK["body"] | {"table": table}, "joint": BLOCK["joint"] | {"held": held}, "contact": contact}
    ground = Pipeline(load_scene(BLOCK, tilt))
    step = next(iter(ground.plans.values())).integrator.step
    runs = [Pipeline(load_scene(BLOCK | own, [*tilt, f"simulation.step={step}"])) for own in ({}, other)]
    one, two = (run.motion.contacts["floor"] for run in runs)
    assert one.impulse[-1, 1] > 0.0
    np.testing.assert_allclose(two.force, one.force, atol=1e-6 * np.abs(one.force).max())
    np.testing.assert_allclose(two.friction_work, one.friction_work, atol=1e-6 * one.friction_work[-1])
    assert not [own for own in contact_warnings(runs[1]) if own["code"] == "contact-unseen"]


def test_a_wrong_key_of_a_surface_is_named_as_it_stands_in_the_file() -> None:
    skin = {"type": "ball", "radius": RADIUS, **STEEL}
    with pytest.raises(
        InputError, match=r"body\.ball\.surface\.skin\.length.* no such key; the keys here: type, radius"
    ):
        load_scene({"title": "Ball", "body": {"ball": BALL | {"surface": {"skin": {**skin, "length": 1e-3}}}}})
