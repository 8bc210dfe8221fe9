"""Displacements of second order, of bodies and of markers: forces, inertia and energies that come with them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from fmd.dynamics.closures import Place
from fmd.dynamics.compiler.compiled import compile_mechanism
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import constant
from tests.dynamics.compiler import kane
from tests.dynamics.compiler.comparison import TIME, difference, interpreted
from tests.dynamics.compiler.mechanisms import EACH, SEEDS, PointMechanism, random_mechanism


@pytest.mark.parametrize("seed", [seed for seed in SEEDS if seed != 1])  # which takes long, and no way of its own
def test_with_their_whole_energy_they_accelerate_mass_points_by_dalemberts_principle_alone(seed: int) -> None:
    """Points are moved by affine fields of second order, and nothing is added to their inertia."""
    made = random_mechanism(seed, second_order=True, whole=True)
    compiled, n = made.compiled, made.mechanism.n
    q, v = made.state(seed)
    a = interpreted(compiled, "accelerations", (n,), q=q, v=v)
    assert difference(a, kane.accelerations(made, TIME, q, v)) < 1e-8
    r = interpreted(compiled, "residual", (n,), q=q, v=v, a=a)
    assert np.abs(r).max() < 1e-11 * max(np.abs(interpreted(compiled, "residual", (n,), q=q, v=v, a=0 * v)).max(), 1.0)
    plain = Kinematics(made.mechanism, np.array([TIME]), q[None], v[None])
    u, _ = kane.velocities(made, TIME, q, v)
    m = np.concatenate([body.m for body in made.points])
    assert np.isclose(plain.energies[0][0], 0.5 * m @ (u**2).sum(axis=1), rtol=1e-11)
    assert np.allclose(plain.momentum[0], m @ u, rtol=0, atol=1e-11 * np.abs(u).max() * m.sum())
    assert np.allclose(
        interpreted(compiled, "energies", (2,), q=q, v=v), np.ravel(plain.energies), rtol=1e-11, atol=1e-12
    )
    momenta = np.concatenate([plain.momentum[0], plain.angular_momentum[0]])
    assert np.allclose(interpreted(compiled, "momenta", (6,), q=q, v=v), momenta, rtol=1e-10, atol=1e-11)


@EACH
def test_accelerations_leave_no_residual(seed: int) -> None:
    made = random_mechanism(seed, second_order=True)
    compiled, n = made.compiled, made.mechanism.n
    q, v = made.state(seed)
    a = interpreted(compiled, "accelerations", (n,), q=q, v=v)
    r = interpreted(compiled, "residual", (n,), q=q, v=v, a=a)
    assert np.abs(r).max() < 1e-11 * max(np.abs(interpreted(compiled, "residual", (n,), q=q, v=v, a=0 * v)).max(), 1.0)


@EACH
def test_tangents_are_those_of_differences(seed: int) -> None:
    made = random_mechanism(seed, second_order=True)
    compiled = made.compiled
    q, v = made.state(seed)
    a = np.random.default_rng(seed).normal(size=len(v))
    by_q, by_v, by_a = compiled.tangents(compiled.signal_values(TIME), q, v, a)
    assert difference(compiled.solve(TIME, q, by_a), np.eye(len(v))) < 1e-10
    for tangent, which in ((by_q, "q"), (by_v, "v")):
        # Order 4; steps of 1e-3 leave 1e-11 or so.
        state = {"q": q, "v": v, "a": a}
        columns = []
        for unit in np.eye(tangent.shape[1]):
            r = [compiled.residual(TIME, **(state | {which: state[which] + k * 1e-3 * unit})) for k in (-2, -1, 1, 2)]
            columns.append((r[0] - 8 * r[1] + 8 * r[2] - r[3]) / 12e-3)
        scale = max(np.abs(by_q).max(), np.abs(by_v).max(), 1.0)
        assert np.abs(tangent - np.stack(columns, axis=1)).max() < 1e-8 * scale


def conservative(made: PointMechanism) -> Mechanism:
    """Without loads, dampers and motions; gravity, springs and modes are left."""
    still = {"damping": np.zeros(0), "damper": 0.0, "load": constant(0.0), "motion": None}
    return replace(made.mechanism, links=[replace(link, **still) for link in made.mechanism.links], loads=[])


@EACH
def test_energy_stays_what_it_is_along_every_motion(seed: int) -> None:
    """dE/dt = 0 at a random state, by differences of order 8 along q̇(v) and v̇ = a."""
    made = random_mechanism(seed, second_order=True)
    mechanism = conservative(made)
    if not mechanism.n:
        return
    made = PointMechanism(mechanism, made.points)
    q, v = made.state(seed)
    compiled = compile_mechanism(mechanism)
    a = interpreted(compiled, "accelerations", (mechanism.n,), q=q, v=v)
    dq = kane.rate_of_positions(made, q, v)

    def energy(h: float) -> float:
        kinetic, potential = Kinematics(mechanism, np.zeros(1), (q + h * dq)[None], (v + h * a)[None]).energies
        return float(kinetic[0] + potential[0])

    step = 1e-3
    change = sum(w * (energy(k * step) - energy(-k * step)) for k, w in enumerate(kane.WEIGHTS, start=1)) / step
    kinetic, potential = Kinematics(mechanism, np.zeros(1), q[None], v[None]).energies
    rate = max(np.abs(v).max(), 1.0) * (float(kinetic[0]) + abs(float(potential[0])) + 1.0)
    assert abs(change) < 1e-9 * rate


@EACH
def test_energies_momenta_and_frames_of_compiled_code_are_those_of_numpy(seed: int) -> None:
    made = random_mechanism(seed, second_order=True)
    q, v = made.state(seed)
    compiled, plain = made.compiled, Kinematics(made.mechanism, np.array([TIME]), q[None], v[None])
    assert np.allclose(compiled.energies(TIME, q, v), np.ravel(plain.energies), rtol=1e-12, atol=1e-12)
    for found, expected in zip(compiled.momenta(TIME, q, v), (plain.momentum, plain.angular_momentum), strict=True):
        assert np.allclose(found, expected[0], rtol=1e-11, atol=1e-12)
    frames = [
        np.concatenate(values)
        for values in zip(*((at.origin, at.rotation, at.spin) for at in plain.frames), strict=True)
    ]
    for found, expected in zip(compiled.frames(TIME, q, v), frames, strict=True):
        assert np.abs(found - expected).max() < 1e-13 * max(np.abs(expected).max(), 1.0)


@EACH
def test_momenta_are_those_of_the_mass_points(seed: int) -> None:
    made = random_mechanism(seed, second_order=True)
    q, v = made.state(seed)
    u, _ = kane.velocities(made, TIME, q, v)
    points = [o + body.moved(z) @ R.T for (o, R, z), body in zip(kane.frames(made, TIME, q), made.points, strict=True)]
    p = np.concatenate([body.m for body in made.points])[:, None] * u
    plain = Kinematics(made.mechanism, np.array([TIME]), q[None], v[None])
    assert np.allclose(plain.momentum[0], p.sum(axis=0).real, rtol=0, atol=1e-11)
    assert np.allclose(
        plain.angular_momentum[0], np.cross(np.concatenate(points).real, p).real.sum(axis=0), rtol=0, atol=1e-11
    )


@EACH
def test_markers_are_where_their_points_are_and_turned_as_these_say(seed: int) -> None:
    made = random_mechanism(seed, second_order=True)
    q, v = made.state(seed)
    plain, bodies = Kinematics(made.mechanism, np.array([TIME]), q[None], v[None]), kane.frames(made, TIME, q)
    for k, link in enumerate(made.mechanism.links):
        for name, at in link.markers.items():
            origin, R, z = bodies[k]
            moved, turned = kane.marker_motion(at.translation, at.rotation, at.displacement2, z)
            place, section = origin + R @ (at.position + moved), plain.place_motion(Place(link.name, at))
            assert np.allclose(plain.marker_position(k, name)[0], place, rtol=0, atol=1e-12)
            assert np.allclose(section.origin[0], place, rtol=0, atol=1e-12)
            assert np.allclose(section.rotation[0], R @ expm(kane.tilde(turned)), rtol=0, atol=1e-12)
