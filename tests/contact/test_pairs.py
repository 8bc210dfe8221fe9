"""Two bodies that touch: closed forms, momentum, energy, and forces against the derivative of a potential."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import nnls

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.protocol import evaluate, move_positions
from fmd.output.contacts import contact_figures

ALUMINIUM = {"shape": "bar", "E": "70 GPa", "nu": 0.3, "rho": "2700 kg/m^3"}


def simulation(duration: str, output_step: str, tip: str) -> dict[str, Any]:
    run = [{"integrator": "central-difference"}]
    times = {"duration": duration, "output_step": output_step, "step": "auto"}
    return times | {"tip": tip, "gravity": ["0 m/s^2"] * 3, "run": run}


def bars(*overrides: str) -> Pipeline:
    """Two equal bars of length 10 and wave speed 30, the first at 10 m/s, half a metre before the other."""
    side = dict.fromkeys(("depth", "width"), "1 m") | {"length": "10 m", "E": "900 Pa", "nu": 0.0, "rho": "1 kg/m^3"}
    bar = {"shape": "bar", **side, "modes": {"count": 20, "family": "axial", "enrich": "none"}}
    bar |= {"marker": {"left": {"face": "x-"}, "right": {"face": "x+"}}}
    mesh = {"first": [44, 1, 1], "second": [44, 2, 1]}
    joint = {"type": "prismatic", "axis": [1, 0, 0], "parent": "ground"}
    scene = {
        "title": "Bars",
        "body": {name: bar | {"mesh": {"divisions": own, "order": 1}} for name, own in mesh.items()},
        "joint": {
            "one": joint | {"child": "first.left", "rate": "10 m/s"},
            "other": joint | {"child": "second.left", "position": "10.5 m"},
        },
        "contact": {"hit": {"between": ["first.right", "second.left"]}},
        "simulation": simulation("0.9 s", "10 ms", "second.right"),
    }
    return Pipeline(load_scene(scene, overrides))


def test_two_equal_bars_exchange_their_speeds_in_the_time_of_a_wave_to_and_fro() -> None:
    """Contact for 2 L/c and the impulse m v (Timoshenko & Goodier, Theory of Elasticity, on bars that strike)."""
    run = bars()
    hit, momentum = run.motion.contacts["hit"], run.motion.kinematics.momentum
    assert hit.impulse[-1] == pytest.approx([100.0, 0.0, 0.0], abs=1.2)
    assert hit.span[0] == pytest.approx(0.05, abs=1e-3)
    assert hit.span[1] == pytest.approx(0.05 + 20.0 / 30.0, rel=0.02)
    assert hit.force[10:65, 0].mean() == pytest.approx(150.0, rel=0.05)  # ρ c A v/2, with the ripple of twenty modes
    assert hit.area.max() == pytest.approx(1.0)
    assert np.abs(hit.energy_error).max() < 2e-3 * 500.0
    assert np.abs(momentum[:, 0] - 100.0).max() < 1e-11 * 100.0
    assert contact_figures(run)["contacts"]["hit"]["impulse_n_s"][0] > 0.0  # on the second of the two


def test_a_clearance_delays_the_contact_and_the_other_order_turns_the_force_round() -> None:
    run = bars("contact.hit.clearance=1 m", 'contact.hit.between=["second.left", "first.right"]')
    hit = run.motion.contacts["hit"]
    assert hit.span[0] == pytest.approx(0.15, abs=1e-3)
    assert hit.impulse[-1, 0] == pytest.approx(-100.0, abs=1.2)


def rod_on_block(friction: float, step: str) -> Pipeline:
    """A rod that spins and strikes a free block aslant, both with six modes."""
    rod = ALUMINIUM | {
        "length": "200 mm",
        **dict.fromkeys(("depth", "width"), "20 mm"),
        "modes": {"count": 6, "enrich": "none"},
    }
    rod |= {"mesh": {"divisions": [10, 2, 2], "order": 1}}
    block = ALUMINIUM | {
        "length": "100 mm",
        "depth": "100 mm",
        "width": "40 mm",
        "modes": {"count": 6, "enrich": "none"},
    }
    block |= {"mesh": {"divisions": [4, 4, 2], "order": 1}}
    middle = {"rod": {"at": ["100 mm", "0 mm", "0 mm"]}, "block": {"at": ["50 mm", "0 mm", "0 mm"]}}
    joint = {"type": "free", "parent": "ground"}
    above = {"position": ["7 mm", "150.5 mm", "0 mm"], "rotate": ["0 deg", "0 deg", "86 deg"]}
    flying = {"velocity": ["1 m/s", "-3 m/s", "0.2 m/s"], "spin": ["5 rad/s", "0 rad/s", "20 rad/s"]}
    scene = {
        "title": "Rod and block",
        "body": {
            "rod": rod | {"marker": {"middle": middle["rod"], "end": {"face": "x-"}}},
            "block": block | {"marker": {"middle": middle["block"], "side": {"face": "y+"}}},
        },
        "joint": {
            "flight": joint | {"child": "rod.middle"} | above | flying,
            "turn": joint | {"child": "block.middle", "spin": ["0 rad/s", "3 rad/s", "0 rad/s"]},
        },
        "contact": {"hit": {"between": ["block.side", "rod.end"], "friction": friction}},
        "simulation": simulation("0.3 ms", "20 us", "rod.middle") | {"step": step},
    }
    return Pipeline(load_scene(scene))


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_spinning_rod_on_a_free_block_keeps_momentum_and_energy(friction: float) -> None:
    """Angular momentum is kept but for the order 2 of central differences with velocities of a free body."""
    drift = []
    for step in ("0.8 us", "0.4 us"):
        motion = rod_on_block(friction, step).motion
        hit, linear, angular = motion.contacts["hit"], motion.kinematics.momentum, motion.kinematics.angular_momentum
        assert np.abs(linear - linear[0]).max() < 1e-14 * np.abs(linear[0]).max() * len(motion.times)
        energy = np.sum(motion.energies, axis=0)
        lost = energy[0] - energy[-1] - hit.friction_work[-1]
        assert abs(lost) < 5e-3 * energy[0]
        assert hit.impulse[-1, 1] > 0.5
        assert bool(hit.friction_work[-1] > 0.1) is (friction > 0.0)
        drift.append(np.abs(angular - angular[0]).max() / np.abs(angular[0]).max())
    assert drift[1] < 3e-7
    assert drift[0] > 2.5 * drift[1]


def pressed_state(run: Pipeline, rng: np.random.Generator, deformed: float) -> Array:
    """Return random positions of both bodies with the rod moved along y until its deepest point is 0–2 µm deep."""
    p, n, mechanism = run.system.parameters, run.mechanism.n, run.mechanism
    change = 0.02 * rng.standard_normal(n) * np.tile([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, *[0.0] * 6], 2)
    for body in (0, 1):
        change[mechanism.modes_of(body)] = deformed * rng.standard_normal(6)
    q, wanted = move_positions(p, run.start[0], change), -rng.uniform(0.0, 2e-6)
    for _ in range(3):
        gaps = []
        for y in (0.0, 1e-7):
            evaluate(p, 0.0, move_positions(p, q, np.eye(n)[1] * y), np.zeros(n), np.zeros(n))
            gaps.append(p.contact.free[p.contact.seen[:, 0] == 1, 0].min())
        q = move_positions(p, q, np.eye(n)[1] * (wanted - gaps[0]) / (gaps[1] - gaps[0]) * 1e-7)
    return q


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_forces_at_a_state_are_equal_and_opposite_at_one_place(friction: float) -> None:
    run, rng = rod_on_block(friction, "auto"), np.random.default_rng(12)
    p, a = run.system.parameters, np.zeros(run.mechanism.n)
    for _ in range(10):
        evaluate(p, 0.0, pressed_state(run, rng, 1e-6), run.start[1], a)
        push, R, r = p.contact.push, p.rotations, p.origins
        force = np.einsum("lab,lb->la", R, push[:, :3])
        moment = np.einsum("lab,lb->la", R, push[:, 3:]) + np.cross(r, force)
        assert np.abs(force).max() > 0.0
        assert np.abs(force.sum(axis=0)).max() < 1e-14 * np.abs(force).max()
        assert np.abs(moment.sum(axis=0)).max() < 1e-12 * np.abs(moment).max()


def potential(run: Pipeline, q: Array) -> float:
    """Energy of the pressed pair by NumPy alone: every point above every triangle, forces by least squares."""
    bodies, n = {own.body: own for own in run.mechanism.contacts}, run.mechanism.n
    origins, rotations, _ = run.system.compiled.frames(0.0, q, np.zeros(n))
    shift, ends = run.mechanism.n_positions - n, {}
    for name, own in bodies.items():
        k = run.mechanism.number_of(name)
        u = own.points.shapes @ q[run.mechanism.modes_of(k) + shift]
        ends[name] = own.points, origins[k] + (own.points.x + u) @ rotations[k].T, rotations[k]
    rows, gaps, softer = list[dict[str, Array]](), list[float](), list[float]()
    for one, face, other, beyond in (("rod", "end", "block", "side"), ("block", "side", "rod", "end")):
        mine, places, _ = ends[one]
        theirs, corners, _ = ends[other]
        triangles = theirs.surfaces[beyond]
        points = mine.faces[face] if one == "rod" else rim_of(mine.x, mine.surfaces[face])
        for i in points:
            for triangle in triangles:
                a, b, c = corners[triangle]
                normal = np.cross(b - a, c - a)
                normal /= np.linalg.norm(normal)
                w = np.linalg.solve(np.stack([b - a, c - a, normal], axis=1), places[i] - a)
                weights = np.array([1.0 - w[0] - w[1], w[0], w[1]])
                if weights.min() >= 0.0:
                    row = {name: np.zeros((len(ends[name][0].x), 3)) for name in ends}
                    row[one][i] += normal @ ends[one][2]
                    row[other][triangle] -= np.outer(weights, normal @ ends[other][2])
                    rows, gaps = [*rows, row], [*gaps, w[2]]
                    softer.append(0.0 if one == "rod" else 0.1)
                    break
    D = np.zeros((len(rows), len(rows)))
    for name, (points, _, _) in ends.items():
        B = np.array([row[name].ravel() for row in rows])
        D += B @ points.G.reshape(B.shape[1], -1) @ B.T
    D += np.diag(np.diag(D) * softer)
    L = np.linalg.cholesky(D)
    force, _ = nnls(L.T, -np.linalg.solve(L, np.array(gaps)), maxiter=1000)
    return float(-0.5 * force @ D @ force - force @ np.array(gaps))


def rim_of(x: Array, triangles: Array) -> Array:
    """Return the points of a flat rectangle's triangles that are on its sides."""
    points = np.unique(triangles)
    flat = x[points][:, np.ptp(x[points], axis=0) > 1e-9]
    return points[(np.isclose(flat, flat.min(axis=0)) | np.isclose(flat, flat.max(axis=0))).any(axis=1)]


def test_forces_on_frames_and_modes_of_both_are_the_derivative_of_the_potential() -> None:
    run, rng = rod_on_block(0.0, "auto"), np.random.default_rng(34)
    p, n = run.system.parameters, run.mechanism.n
    plain, size = CompiledSystem(run.mechanism), np.tile([1e-9] * 3 + [1e-8] * 3 + [1e-9] * 6, 2)
    for _ in range(2):
        q, a = pressed_state(run, rng, 1e-6), np.zeros(n)
        evaluate(p, 0.0, q, np.zeros(n), a)
        force = plain.mass_matrix(q) @ (a - plain.accelerations(0.0, q, np.zeros(n)))
        exact = np.zeros(n)
        for k, h in enumerate(size):
            ends = [potential(run, move_positions(p, q, np.eye(n)[k] * sign * h)) for sign in (1.0, -1.0)]
            exact[k] = -(ends[0] - ends[1]) / (2 * h)
        assert np.abs(force).max() > 0.0
        np.testing.assert_allclose(force, exact, atol=1e-3 * np.abs(exact).max())


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ('contact.hit.between=["first.right", "first.left"]', "one body, which can't touch itself"),
        ('contact.own={ between = ["first.right", "first.left"], normal = [1, 0, 0] }', "one body, which can't touch"),
        ('contact.hit.between=["first.right", "second.left", "second.right"]', "must be two surfaces"),
        ("contact.hit.normal=[1, 0, 0]", "faces of bodies have normals of their own"),
        ("contact.hit.near_field=half-space", "'mesh' works between bodies"),
        ('contact.hit.between=["ground", "second.left"]', "normal: is missing"),
        ('contact.again={ between = ["second.left", "first.right"] }', "two faces make one contact"),
        ('contact.hit.between=["first.right", "second.lift"]', "lift"),
    ],
)
def test_what_can_not_touch_is_refused_with_what_can(override: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        bars(override)


@pytest.mark.parametrize(
    ("position", "message"),
    [
        ("9.99 m", r"contact.hit: begins 0.01 m deep"),
        ("9.7 m", "past the edge of its face"),
        ("8.9 m", "deep into a body"),
    ],
)
def test_bodies_that_begin_in_one_another_are_refused(position: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        _ = bars(f'joint.other.position="{position}"').plans


def test_an_interference_presses_bodies_apart_with_its_energy() -> None:
    still = ("joint.one.rate=0 m/s", "joint.other.position=10 m", "simulation.duration=0.2 s")
    motion = bars(*still, "contact.hit.clearance=-1 mm").motion
    hit = motion.contacts["hit"]
    assert hit.span[0] == 0.0
    assert hit.impulse[-1, 0] > 0.0
    assert motion.kinematics.momentum[-1, 0] == pytest.approx(0.0, abs=1e-12)
    kept = np.sum(motion.energies, axis=0) + hit.energy
    assert kept[-1] == pytest.approx(hit.energy[0], rel=0.05)
