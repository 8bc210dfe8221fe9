"""Residual, its tangents, frames, energies and momenta against mass points, `Kinematics` and differences."""

from dataclasses import replace

import numpy as np
from scipy.linalg import expm

from fmd.dynamics.compiler.compiled import compile_mechanism
from fmd.dynamics.kinematics import Kinematics
from fmd.reduction.body import MarkerShapes
from tests.dynamics.compiler import kane
from tests.dynamics.compiler.comparison import TIME, difference, interpreted
from tests.dynamics.compiler.mechanisms import EACH, random_mechanism


@EACH
def test_the_residual_is_mass_times_acceleration_less_force(seed: int) -> None:
    # Differences of order 8 over steps of 0.01 s leave 1e-10 or so of the bias.
    made = random_mechanism(seed, second_order=False)
    q, v = made.state(seed)
    a = np.random.default_rng(seed).normal(size=len(v))
    M, Q = kane.mass_and_force(made, TIME, q, v)
    compiled = made.compiled
    assert difference(compiled.residual(TIME, q, v, a), M @ a - Q) < 1e-8
    assert difference(compiled.mass_matrix(compiled.signal_values(TIME), q), M) < 1e-12


@EACH
def test_accelerations_leave_no_residual(seed: int) -> None:
    made = random_mechanism(seed)
    compiled = made.compiled
    q, v = made.state(seed)
    r = compiled.residual(TIME, q, v, compiled.accelerations(TIME, q, v))
    assert np.abs(r).max() < 1e-12 * max(np.abs(compiled.residual(TIME, q, v, 0.0 * v)).max(), 1.0)


@EACH
def test_tangents_are_those_of_differences(seed: int) -> None:
    made = random_mechanism(seed)
    compiled = made.compiled
    q, v = made.state(seed)
    a = np.random.default_rng(seed).normal(size=len(v))
    by_q, by_v, by_a = compiled.tangents(compiled.signal_values(TIME), q, v, a)
    # Linear in a: a difference is exact.
    still = compiled.residual(TIME, q, v, 0.0 * a)
    M = np.stack([compiled.residual(TIME, q, v, unit) - still for unit in np.eye(len(v))], axis=1)
    assert np.abs(by_a - M).max() < 1e-12 * (np.abs(M).max() + np.abs(still).max())
    for tangent, which in ((by_q, "q"), (by_v, "v")):
        # Order 4; steps of 1e-3 leave 1e-11 or so.
        state = {"q": q, "v": v, "a": a}
        columns = []
        for unit in np.eye(tangent.shape[1]):
            r = [compiled.residual(TIME, **(state | {which: state[which] + k * 1e-3 * unit})) for k in (-2, -1, 1, 2)]
            columns.append((r[0] - 8 * r[1] + 8 * r[2] - r[3]) / 12e-3)
        scale = max(np.abs(by_q).max(), np.abs(by_v).max(), 1.0)
        assert np.abs(tangent - np.stack(columns, axis=1)).max() < 1e-8 * scale


@EACH
def test_tangents_by_the_signals_are_those_of_differences(seed: int) -> None:
    made = random_mechanism(seed)
    compiled = made.compiled
    q, v = made.state(seed)
    a, inputs = np.random.default_rng(seed).normal(size=len(v)), compiled.signal_values(TIME)
    r = np.zeros(len(v))
    columns = np.zeros((len(v), len(inputs)))
    for j, unit in enumerate(np.eye(len(inputs))):
        for k, weight in ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0)):
            compiled.call("residual", inputs + k * 1e-3 * unit, q, v, a, r)
            columns[:, j] += weight / 12e-3 * r
    found = compiled.input_tangents(compiled.signal_values(TIME), q, v, a)
    assert np.abs(found - columns).max(initial=0.0) < 1e-8 * max(np.abs(columns).max(initial=0.0), 1.0)


@EACH
def test_lanes_of_machine_code_do_what_the_interpreter_does(seed: int) -> None:
    made = random_mechanism(seed)
    compiled, mechanism = made.compiled, made.mechanism
    q, v = made.state(seed)
    rng = np.random.default_rng(seed)
    sizes = {"dinputs": 3 * len(compiled.signals), "dq": len(q), "dv": len(v), "da": len(v)}
    directions = {name: rng.normal(size=(size, 8)) for name, size in sizes.items()}
    dr, a = np.zeros((mechanism.n, 8)), rng.normal(size=mechanism.n)
    compiled.call("tangents", compiled.signal_values(TIME), q, v, a, *directions.values(), dr)
    assert difference(dr, interpreted(compiled, "tangents", dr.shape, q=q, v=v, a=a, **directions)) < 1e-13


@EACH
def test_frames_are_those_of_the_mechanism(seed: int) -> None:
    made = random_mechanism(seed)
    q, v = made.state(seed)
    frames = Kinematics(made.mechanism, np.array([TIME]), q[None], v[None]).frames
    expected = [
        np.concatenate(values) for values in zip(*((at.origin, at.rotation, at.spin) for at in frames), strict=True)
    ]
    for found, wanted in zip(made.compiled.frames(TIME, q, v), expected, strict=True):
        assert np.abs(found - wanted).max() < 1e-13 * max(np.abs(wanted).max(), 1.0)


@EACH
def test_markers_are_where_their_points_are(seed: int) -> None:
    made = random_mechanism(seed)
    rng = np.random.default_rng(seed)
    links = []
    for link in made.mechanism.links:
        shapes = rng.normal(size=(2, 3, len(link.omega)))
        links.append(replace(link, markers={"tip": MarkerShapes(rng.normal(size=3), *shapes)}))
    mechanism = replace(made.mechanism, links=links)
    q, _ = made.state(seed)
    positions, rotations = compile_mechanism(mechanism).markers(TIME, q)
    bodies = kane.frames(made, TIME, q)
    for link, (origin, R, z), at, turn in zip(links, bodies, positions, rotations, strict=True):
        marker = link.markers["tip"]
        assert np.allclose(at, origin + R @ (marker.position + marker.translation @ z), rtol=0, atol=1e-12)
        assert np.allclose(turn, R @ expm(kane.tilde(marker.rotation @ z)), rtol=0, atol=1e-12)


@EACH
def test_energies_are_those_of_the_mechanism(seed: int) -> None:
    made = random_mechanism(seed)
    q, v = made.state(seed)
    energies = made.compiled.energies(TIME, q, v)
    expected = Kinematics(made.mechanism, np.array([TIME]), q[None], v[None]).energies
    assert np.allclose(energies, np.ravel(expected), rtol=1e-12, atol=1e-12)


@EACH
def test_momenta_are_those_of_the_mass_points(seed: int) -> None:
    made = random_mechanism(seed)
    q, v = made.state(seed)
    u, _ = kane.velocities(made, TIME, q, v)
    points = [o + body.moved(z) @ R.T for (o, R, z), body in zip(kane.frames(made, TIME, q), made.points, strict=True)]
    p = np.concatenate([body.m for body in made.points])[:, None] * u
    linear, angular = made.compiled.momenta(TIME, q, v)
    assert np.allclose(linear, p.sum(axis=0).real, rtol=0, atol=1e-11)
    assert np.allclose(angular, np.cross(np.concatenate(points).real, p).sum(axis=0), rtol=0, atol=1e-11)
