"""Reactions of all joints: by d'Alembert's principle on mass points, in loops, and by statics."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.dynamics.closures import Coupler
from fmd.dynamics.elements import Attachment
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.links import Link, PointLoad, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.reactions import JointLoads, joint_loads
from fmd.dynamics.signals.signal import constant
from fmd.reduction.body import MarkerShapes
from fmd.scene.joints.fixed import FIXED
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from fmd.scene.joints.screw import SCREW
from tests.dynamics.compiler import kane
from tests.dynamics.compiler.comparison import TIME
from tests.dynamics.compiler.mechanisms import PointMechanism, random_mechanism
from tests.dynamics.compiler.random_elements import with_elements
from tests.verification.random_loops import random_loop

Z = np.array([0.0, 0.0, 1.0])


def loads_at(mechanism: Mechanism, q: Array, v: Array, t: float = TIME) -> JointLoads:
    return joint_loads(mechanism, mechanism, np.array([t]), q[None], v[None])


def named(made: PointMechanism) -> PointMechanism:
    links = [replace(link, joint_name=f"joint {k}") for k, link in enumerate(made.mechanism.links)]
    return PointMechanism(replace(made.mechanism, links=links), made.points)


def load_wrench(made: PointMechanism, load: PointLoad, q: Array) -> tuple[Array, Array]:
    """Force and moment of a load about the ground's origin, by its place and section."""
    k = made.mechanism.number_of(load.body)
    origin, R, z = kane.frames(made, TIME, q)[k]
    bent, turned = kane.marker_motion(load.marker.translation, load.marker.rotation, load.marker.displacement2, z)
    value = load.size.value(TIME)[0] * load.direction / np.linalg.norm(load.direction)
    value = R @ kane.rotation(turned) @ value if load.following else value
    value, place = value.real, (origin + R @ (load.marker.position + bent)).real
    return (np.zeros(3), value) if load.torque else (value, np.cross(place, value))


def element_pushes(mechanism: Mechanism, q: Array, v: Array) -> dict[str, list[tuple[Array, Array]]]:
    """Force and moment about the ground's origin of the springs and bushings on each body."""
    motion = Kinematics(mechanism, np.array([TIME]), q[None], v[None])
    found: dict[str, list[tuple[Array, Array]]] = {}
    for element in mechanism.elements:
        for end, wrench in zip(element.ends, motion.wrenches(element)[0], strict=True):
            (force, moment), place = np.split(wrench, 2), motion.place_motion(end).origin[0]
            found.setdefault(end.body, []).append((force, moment + np.cross(place, force)))
    return found


@pytest.mark.parametrize("seed", [13, 39, 40])
@pytest.mark.parametrize("kind", ["plain", "second order", "with springs"])
def test_each_joint_moves_the_mass_points_that_it_carries(seed: int, kind: str) -> None:
    """Force and moment are Σ m (ẍ − g) and Σ x × m (ẍ − g) of all points beyond the joint, less the loads there."""
    made = named(with_elements(seed)[0] if kind == "with springs" else random_mechanism(seed, kind == "second order"))
    mechanism = made.mechanism
    q, v = made.state(seed)
    pushes = element_pushes(mechanism, q, v)
    found = loads_at(mechanism, q, v)
    a = found.accelerations[0]
    J = np.stack([kane.velocities(made, TIME, q, unit, flow=0.0)[0] for unit in np.eye(mechanism.n)], axis=-1)
    pulls = J @ a + kane.bias(made, TIME, q, v) - mechanism.gravity
    frames = [(o.real, R.real, z.real) for o, R, z in kane.frames(made, TIME, q)]
    ends = np.cumsum([0, *(len(body.m) for body in made.points)])
    for k, link in enumerate(mechanism.links):
        carried = [k]
        for j in range(k + 1, len(mechanism.links)):
            carried += [j] if mechanism.links[j].parent in carried else []
        force, moment = np.zeros(3), np.zeros(3)
        for j in carried:
            origin, R, z = frames[j]
            x = origin + made.points[j].moved(z) @ R.T
            pull = made.points[j].m[:, None] * pulls[ends[j] : ends[j + 1]]
            force, moment = force + pull.sum(axis=0), moment + np.cross(x, pull).sum(axis=0)
            for load in mechanism.loads:
                if load.body == mechanism.links[j].name:
                    own = load_wrench(made, load, q)
                    force, moment = force - own[0], moment - own[1]
            for own in pushes.get(mechanism.links[j].name, []):
                force, moment = force - own[0], moment - own[1]
        on_parent, on_child = found.reactions[f"joint {k}"][0]
        scale = 1.0 + np.abs(force).max() + np.abs(moment).max()
        assert on_child[:3] == pytest.approx(force, abs=1e-8 * scale)
        assert on_child[3:] == pytest.approx(moment - np.cross(frames[k][0], force), abs=1e-8 * scale)
        place = link.place.position
        if link.parent >= 0:
            origin, R, z = frames[link.parent]
            place = origin + R @ (
                place + kane.marker_motion(link.place.translation, link.place.rotation, link.place.displacement2, z)[0]
            )
        assert on_parent[:3] == pytest.approx(-force, abs=1e-8 * scale)
        assert on_parent[3:] == pytest.approx(-moment + np.cross(place, force), abs=1e-8 * scale)


@pytest.mark.parametrize("seed", [5, 37])
def test_a_marker_moves_as_the_joint_that_sits_on_it(seed: int) -> None:
    made = named(random_mechanism(seed, second_order=True))
    links = list(made.mechanism.links)
    frozen = [k for k, link in enumerate(links) if link.parent >= 0 and link.joint not in (PRISMATIC, SCREW)]
    for k in frozen:
        carrier = links[k].parent
        markers = {**links[carrier].markers, f"joint {k}": links[k].place}
        links[carrier] = replace(links[carrier], markers=markers)
    q, v = made.state(seed)
    motion = Kinematics(replace(made.mechanism, links=links), np.array([TIME]), q[None], v[None])
    loads = loads_at(made.mechanism, q, v)
    rigid = [k for k in frozen if links[k].n_slides == 0]
    assert rigid
    for k in rigid:
        at = links[k].parent, f"joint {k}"
        assert motion.marker_velocity(*at)[0] == pytest.approx(motion.frames[k].velocity[0], abs=1e-12)
        found = motion.marker_acceleration(*at, loads.accelerations)[0]
        assert found == pytest.approx(loads.frames[0, k, :3], rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("seed", [5, 13, 38])
def test_ideal_joints_do_no_work(seed: int) -> None:
    """The power of force and moment on the parent's place and on the child's sums up to nothing, while bodies bend."""
    made = named(random_mechanism(seed, second_order=True))
    bare = {"spring": 0.0, "damper": 0.0, "load": constant(0.0), "laws": (), "motion": None}
    mechanism = replace(made.mechanism, links=[replace(link, **bare) for link in made.mechanism.links])
    q, v = PointMechanism(mechanism, made.points).state(seed)
    motion, loads = Kinematics(mechanism, np.array([TIME]), q[None], v[None]), loads_at(mechanism, q, v)
    turns = 0
    for k, link in enumerate(mechanism.links):
        on_parent, on_child = loads.reactions[f"joint {k}"][0]
        name = mechanism.links[link.parent].name if link.parent >= 0 else ""
        place = motion.place_motion(Attachment(name, link.place))
        power = [on_parent[:3] @ place.velocity[0], on_parent[3:] @ place.spin[0]]
        power += [on_child[:3] @ motion.frames[k].velocity[0], on_child[3:] @ motion.frames[k].spin[0]]
        assert sum(power) == pytest.approx(0.0, abs=1e-11 * (1.0 + np.abs(power).max()))
        turns += np.abs(power).max() > 0.1
    assert turns


@pytest.mark.parametrize("spatial", [False, True])
def test_reactions_in_a_loop_balance_each_body_and_do_no_work(spatial: bool) -> None:
    """Accelerations are those of the reference in absolute coordinates, from rest."""
    loop = random_loop(3, spatial)
    links = [replace(link, joint_name=link.name) for link in loop.mechanism.links]
    mechanism, n = replace(loop.mechanism, links=links), len(links)
    q, v = mechanism.rest_positions, np.zeros(mechanism.n)
    found = loads_at(mechanism, q, v, 0.0)
    origins = loop.places[:n]
    start = np.concatenate([origins.ravel(), np.tile([0.0, 0.0, 0.0, 1.0], n), np.zeros(6 * n)])
    reference = loop.reference._rates(0.0, start)[7 * n :].reshape(n, 6)
    assert found.frames[0] == pytest.approx(reference, abs=1e-7)
    for k in range(n):
        mass, centre = loop.reference.masses[k], loop.reference.centres[k]
        a, alpha = reference[k, :3], reference[k, 3:]
        pull = mass * (a + np.cross(alpha, centre) - loop.reference.gravity)
        turn = loop.reference.inertias[k] @ alpha + np.cross(centre, pull)
        outer = found.reactions[f"body{k + 1}"][0, 0] if k + 1 < n else found.reactions["end"][0, 0]
        own, arm = found.reactions[f"body{k}"][0, 1], loop.places[k + 1] - origins[k]
        assert own[:3] + outer[:3] == pytest.approx(pull, abs=1e-6)
        assert own[3:] + outer[3:] + np.cross(arm, outer[:3]) == pytest.approx(turn, abs=1e-6)
        axis = links[k].axis / np.linalg.norm(links[k].axis)
        about = own[3:] @ axis if links[k].joint == REVOLUTE else np.linalg.norm(own[3:])
        assert about == pytest.approx(0.0, abs=1e-9)
    assert found.reactions["end"][0, 0, :3] == pytest.approx(-found.reactions["end"][0, 1, :3])


def test_a_hanging_chain_carries_the_weight_below_each_joint() -> None:
    rod = rigid_integrals(2.0, np.array([0.5, 0.0, 0.0]), np.diag([0.0, 0.2, 0.2]))
    ends = [np.zeros(3), *3 * [np.array([1.0, 0.0, 0.0])]]
    links = [Link(f"rod{k}", rod, REVOLUTE, k - 1, MarkerShapes(ends[k]), Z, joint_name=f"{k}") for k in range(4)]
    found = loads_at(Mechanism(links, gravity=np.array([10.0, 0.0, 0.0])), np.zeros(4), np.zeros(4))
    for k in range(4):
        assert found.reactions[f"{k}"][0, 1] == pytest.approx([-20.0 * (4 - k), 0, 0, 0, 0, 0], abs=1e-12)


def test_a_pendulum_s_hinge_bears_weight_and_centrifugal_force() -> None:
    """At the angle φ from the vertical: m g cos φ + m l ω² along the rod, m g sin φ (1 − m l²/J) across it."""
    mass, arm, g, phi, omega = 2.0, 0.5, 9.81, 0.7, 3.0
    J = 0.2 + mass * arm**2
    links = [Link("rod", rigid_integrals(mass, np.array([arm, 0.0, 0.0]), np.diag([0.0, 0.2, 0.2])), REVOLUTE, axis=Z)]
    links = [replace(links[0], joint_name="hinge")]
    angle = phi - np.pi / 2
    found = loads_at(Mechanism(links, gravity=np.array([0.0, -g, 0.0])), np.array([angle]), np.array([omega]))
    force, moment = np.split(found.reactions["hinge"][0, 1], 2)
    along, across = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
    assert force @ along == pytest.approx(-mass * (g * np.cos(phi) + arm * omega**2))
    assert force @ across == pytest.approx(mass * g * np.sin(phi) * (1.0 - mass * arm**2 / J))
    assert moment == pytest.approx(np.zeros(3), abs=1e-12)


def test_gears_load_the_joints_that_they_couple() -> None:
    """A motor of 3 N m turns J₁ = 0.2 and, twice as slowly, J₂ = 0.8 kg m²: α₁ = 3/(J₁ + J₂/4)."""
    wheels = [rigid_integrals(1.0, np.zeros(3), np.diag([0.1, 0.1, J])) for J in (0.2, 0.8)]
    links = [Link(f"wheel{k}", integrals, REVOLUTE, axis=Z, joint_name=f"{k}") for k, integrals in enumerate(wheels)]
    links[0] = replace(links[0], load=constant(3.0))
    gear = Coupler("gear", ["wheel0", "wheel1"], [1.0, 2.0])
    found = loads_at(Mechanism(links, closures=[gear]), np.zeros(2), np.zeros(2))
    assert found.accelerations[0] == pytest.approx([7.5, -3.75])
    assert found.reactions["0"][0, 1, 5] == pytest.approx(0.2 * 7.5)
    assert found.reactions["1"][0, 1, 5] == pytest.approx(-0.8 * 3.75)


def test_a_prescribed_joint_states_the_torque_that_its_motion_takes() -> None:
    from fmd.core.formula import parse_formula
    from fmd.dynamics.signals.signal import formula

    rod = rigid_integrals(2.0, np.array([0.5, 0.0, 0.0]), np.diag([0.0, 0.2, 0.2]))
    link = Link("rod", rod, REVOLUTE, axis=Z, joint_name="hinge", motion=formula(parse_formula("2*t*t")))
    load = Link(
        "load",
        rigid_integrals(1.0, np.zeros(3), np.eye(3)),
        FIXED,
        0,
        MarkerShapes(np.array([1.0, 0, 0])),
        joint_name="grip",
    )
    slide = Link("slide", rigid_integrals(1.0, np.zeros(3), np.eye(3)), PRISMATIC, axis=Z, joint_name="slide")
    found = loads_at(Mechanism([link, load, slide]), np.zeros(1), np.zeros(1), 0.0)
    assert found.reactions["hinge"][0, 1, 5] == pytest.approx(4.0 * (0.2 + 2.0 * 0.25 + 1.0 + 1.0))
    assert found.reactions["grip"][0, 1] == pytest.approx([0.0, 4.0, 0.0, 0.0, 0.0, 4.0])
    assert found.reactions["slide"][0] == pytest.approx(np.zeros((2, 6)), abs=1e-12)


STRIP = """
title = "Strip"
[body.strip]
shape = "bar"
length = "400 mm"
depth = "4 mm"
width = "20 mm"
E = "70 GPa"
nu = 0.0
rho = "2700 kg/m^3"
mesh = { order = 2, divisions = [16, 1, 1] }
modes = { count = 1, family = "in-plane bending", boundary = "joint", enrich = "none" }
marker = { root = { face = "x-" }, tip = { face = "x+" } }
[joint.clamp]
type = "fixed"
parent = "ground"
child = "strip.root"
[drive.push]
type = "point force"
marker = "strip.tip"
direction = [0, 1, 0]
force = { formula = "20*sin(pi*t/0.02)**2 if t < 0.02 else 0", unit = "N" }
[simulation]
duration = "60 ms"
output_step = "0.1 ms"
tip = "strip.tip"
stiffening = "on"
run = [{ integrator = "runge-kutta", tolerance = 1e-9 }]
"""


def test_a_clamp_bears_the_inertia_of_a_strip_that_is_drawn_in_as_it_swings(tmp_path: Path) -> None:
    """Its points come nearer by ``½ ∫ w'²``, whose acceleration no motion of first order takes: the clamp had none."""
    file = tmp_path / "strip.toml"
    file.write_text(STRIP)
    motion = Pipeline(load_scene(file)).motion
    # Euler and Bernoulli's first mode w(x) of the clamped strip, w(L) = 1; the deflection over time is the tip's.
    k, x = 1.875104 / 0.4, np.linspace(0.0, 0.4, 2001)
    ratio = (np.cosh(0.4 * k) + np.cos(0.4 * k)) / (np.sinh(0.4 * k) + np.sin(0.4 * k))
    slope = k * (np.sinh(k * x) + np.sin(k * x) - ratio * (np.cosh(k * x) - np.cos(k * x))) / 2
    drawn_in = cumulative_trapezoid(slope**2, x, initial=0.0) / 2
    squared = motion.tip_deflection[:, 1] ** 2
    mass, step = 2700 * 0.02 * 0.004, 1e-4
    exact = -mass * np.trapezoid(drawn_in, x) * np.diff(squared, 2) / step**2
    found = motion.joint_loads.reactions["clamp"][1:-1, 1, 0]
    np.testing.assert_allclose(found, exact, atol=0.02 * np.abs(exact).max())
