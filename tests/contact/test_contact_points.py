"""Points of faces and their residual flexibility, against dense algebra and the derivative of a potential."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import nnls

from fmd import Pipeline, load_scene
from fmd.contact.flexibility import pressed_nodes
from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.protocol import evaluate, move_positions
from fmd.output.contacts import contact_warnings

BLOCK: dict[str, Any] = {
    "title": "Block",
    "body": {
        "block": {
            "shape": "bar",
            "length": "200 mm",
            "depth": "100 mm",
            "width": "60 mm",
            "E": "70 GPa",
            "nu": 0.3,
            "rho": "2700 kg/m^3",
            "mesh": {"divisions": [4, 3, 2], "order": 1},
            "modes": {"count": 4, "enrich": "none"},
            "marker": {"middle": {"at": ["100 mm", "0 mm", "0 mm"]}, "bottom": {"face": "y-"}},
        }
    },
    "joint": {
        "free": {"type": "free", "parent": "ground", "child": "block.middle", "position": ["0 m", "60 mm", "0 m"]}
    },
    "contact": {"floor": {"between": ["ground", "block.bottom"], "normal": [0, 1, 0]}},
    "simulation": {
        "duration": "60 ms",
        "output_step": "1 ms",
        "step": "auto",
        "tip": "block.middle",
        "gravity": ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"],
        "run": [{"integrator": "central-difference"}],
    },
}
MESHES = {
    "linear hexahedra": "{ divisions = [4, 3, 2], order = 1 }",
    "linear tetrahedra": '{ element = "tetrahedron", size = "40 mm", order = 1 }',
    "quadratic hexahedra": "{ divisions = [4, 3, 2], order = 2 }",
    "quadratic tetrahedra": '{ element = "tetrahedron", size = "40 mm", order = 2 }',
}


def block(*overrides: str) -> Pipeline:
    return Pipeline(load_scene(BLOCK, overrides))


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_forces_of_a_constant_pressure_push_and_have_its_resultant(mesh: str) -> None:
    part = block(f"body.block.mesh={mesh}").parts["block"]
    nodes, areas = pressed_nodes(part.markers["bottom"])
    assert areas.min() > 0.0
    assert areas.sum() == pytest.approx(0.2 * 0.06)
    assert areas @ part.space.x[nodes] / areas.sum() == pytest.approx([0.1, -0.05, 0.0], abs=1e-12)


@pytest.mark.parametrize("mesh", ["quadratic hexahedra", "quadratic tetrahedra"])
def test_quadratic_facets_are_pressed_in_the_middles_of_their_sides(mesh: str) -> None:
    part = block(f"body.block.mesh={MESHES[mesh]}").parts["block"]
    nodes, _ = pressed_nodes(part.markers["bottom"])
    assert not np.isin(nodes, part.space.mesh.corners).any()


def test_a_face_of_both_quadratic_triangles_and_quadrilaterals_is_refused() -> None:
    marker = block("body.block.mesh.order=2").parts["block"].markers["bottom"]
    mixed = replace(marker, areas=np.where(marker.areas < 0.0, 0.5, 1.0) * marker.areas)
    with pytest.raises(ValueError, match="quadratic triangles and quadrilaterals"):
        pressed_nodes(mixed)


@pytest.mark.parametrize("joint", ["free", "prismatic"])
def test_the_flexibility_is_that_of_all_modes_but_those_kept(joint: str) -> None:
    """Dense: all elastic modes of the free body, less the part of the kept ones."""
    more = ['joint.free.type="prismatic"', "joint.free.axis=[0,1,0]", "joint.free.position=60 mm"]
    part = block(*(more if joint == "prismatic" else ())).parts["block"]
    points, fe = part.contact_points, part.fe
    K, M = (A.toarray() for A in (fe.K, fe.M))
    values, vectors = eigh(K, M)
    nodes, _ = pressed_nodes(part.markers["bottom"])
    B = vectors.reshape(len(fe.x), 3, -1)[nodes].reshape(3 * len(nodes), -1)
    left = slice(6 + len(part.body.omega), None)
    exact = (B[:, left] / values[left]) @ B[:, left].T
    n = 3 * len(nodes)
    assert points.raised == 0.0
    np.testing.assert_allclose(points.G.reshape(n, n), exact, atol=1e-8 * np.abs(exact).max())


@pytest.mark.parametrize("width", ["60 mm", "1 mm"])
def test_the_flexibility_of_points_is_what_static_responses_give(width: str) -> None:
    """Of the thin block round-off is too much for one solution a column, and static responses stand in its place."""
    part = block(f"body.block.width={width}").parts["block"]
    nodes, _ = pressed_nodes(part.markers["bottom"])
    n = 3 * len(nodes)
    f = np.zeros((len(part.fe.x), 3, n))
    f[nodes[np.arange(n) // 3], np.arange(n) % 3, np.arange(n)] = 1.0
    exact = part.model.solver.static_response(f)[nodes].reshape(n, n)
    np.testing.assert_allclose(part.model.solver.flexibility(nodes), exact, atol=1e-9 * np.abs(exact).max())


def potential(run: Pipeline, q: Array) -> float:
    """Energy of contact, ``max over λ ≥ 0 of −½ λᵀ D λ − λᵀ y``, by non-negative least squares."""
    points, link = run.parts["block"].contact_points, run.mechanism
    origins, rotations, _ = run.system.compiled.frames(0.0, q, np.zeros(link.n))
    modal = q[link.modes_of(0) + link.n_positions - link.n]
    y = (origins[0] + (points.x + points.shapes @ modal) @ rotations[0].T)[:, 1]
    normal = rotations[0][1]
    D = np.einsum("a,iajb,b->ij", normal, points.G, normal)
    L = np.linalg.cholesky(D)
    force, _ = nnls(L.T, -np.linalg.solve(L, y), maxiter=1000)
    return float(-0.5 * force @ D @ force - force @ y)


def test_forces_are_the_derivative_of_the_potential_at_random_states() -> None:
    run, rng = block(), np.random.default_rng(34)
    system, n = run.system, run.mechanism.n
    plain, touched = CompiledSystem(run.mechanism), 0
    for _ in range(30):
        q0 = move_positions(
            system.parameters, run.start[0], rng.standard_normal(n) * np.r_[0, 0, 0, 0.04, 0.1, 0.04, [0] * 4]
        )
        q0[run.mechanism.modes_of(0) + 1] = rng.standard_normal(4) * 1e-6
        p = system.parameters
        a = np.zeros(n)
        evaluate(p, 0.0, q0, np.zeros(n), a)
        q0[1] -= p.contact.free[:, 0].min() + rng.uniform(0.0, 2e-6)
        evaluate(p, 0.0, q0, np.zeros(n), a)
        force = plain.mass_matrix(q0) @ (a - plain.accelerations(0.0, q0, np.zeros(n)))
        size = np.r_[[1e-9] * 3, [1e-8] * 3, [1e-9] * 4]
        exact = np.zeros(n)
        for k, h in enumerate(size):
            step = np.eye(n)[k] * h
            ends = [potential(run, move_positions(p, q0, sign * step)) for sign in (1.0, -1.0)]
            exact[k] = -(ends[0] - ends[1]) / (2 * h)
        touched += force[1] > 0.0
        np.testing.assert_allclose(force, exact, atol=2e-4 * np.abs(exact).max())
    assert touched > 25


def test_where_modes_are_all_of_a_mesh_some_flexibility_is_added_and_steps_stay_bounded() -> None:
    """Without it ω with all points held would be that of round-off, more than 1e7 times the highest mode's."""
    mesh = ("body.block.mesh.divisions=[1, 1, 1]", "body.block.modes.count=18")
    run = block(*mesh, "simulation.duration=12 ms", 'joint.free.position=["0 m", "50.1 mm", "0 m"]')
    part = run.parts["block"]
    assert part.contact_points.raised == 1.0
    assert 2.0 / run.system.largest_step < 60.0 * part.body.omega[-1]
    assert "contact-flexibility" in [own["code"] for own in contact_warnings(run)]
    floor, kinetic = run.motion.contacts["floor"], run.motion.energies[0].max()
    assert abs(floor.energy_error[-1]) < 0.01 * kinetic


def test_forces_with_friction_keep_gaps_cones_and_directions_at_random_states() -> None:
    """Signorini's and Coulomb's conditions, from G by NumPy, for random slips since the last step."""
    run, rng, slid = block("contact.floor.friction=0.4"), np.random.default_rng(7), 0
    n, points = run.mechanism.n, run.parts["block"].contact_points
    for _ in range(30):
        turn = rng.standard_normal(n) * np.r_[0, 0, 0, 0.02, 1.0, 0.02, [0] * 4]
        p, a = run.system.parameters, np.zeros(n)
        q = move_positions(p, run.start[0], turn)
        evaluate(p, 0.0, q, np.zeros(n), a)
        q[1] -= p.contact.free[:, 0].min() + rng.uniform(0.0, 2e-6)
        evaluate(p, 0.0, q, np.zeros(n), a)
        p.contact.tip[:] = p.contact.spot + rng.standard_normal((len(points.x), 3)) * rng.choice([1e-8, 1e-6])
        p.contact.seen[:, 1] = 1
        evaluate(p, 0.0, q, np.zeros(n), a)
        p.contact.seen[:, 1] = 0
        Q, force = p.contact.turned[0], p.contact.force
        y = p.contact.free + np.einsum("ka,iajb,cb,jc->ik", Q, points.G, Q, force)
        gap, slip = y[:, 0], y[:, 1:]
        size = 1e-8 * np.abs(p.contact.free[:, 0].min()) + 1e-15
        bound, across = 0.4 * force[:, 0], np.linalg.norm(force[:, 1:], axis=1)
        assert force[:, 0].min() >= 0.0
        assert gap.min() > -size
        assert np.abs(gap[force[:, 0] > 0.0]).max() < size
        assert (across <= bound * (1.0 + 1e-9)).all()
        held, slides = across < bound * (1.0 - 1e-6), (across >= bound * (1.0 - 1e-6)) & (bound > 1e-6 * bound.max())
        assert np.abs(slip[held]).max(initial=0.0) < size
        along = np.einsum("ia,ia->i", slip, force[:, 1:])[slides]
        apart = np.abs(np.linalg.norm(slip, axis=1)[slides] * across[slides] + along)
        assert (apart <= 1e-6 * across[slides] * np.linalg.norm(slip, axis=1)[slides] + size * across[slides]).all()
        slid += int(slides.sum())
    assert slid > 20
