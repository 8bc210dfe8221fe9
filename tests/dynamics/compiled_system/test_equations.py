"""A compiled system's equations of motion on random chains, against mass points and d'Alembert's principle."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.kinematics import Kinematics
from fmd.integrators.protocol import evaluate, evaluate_velocities
from fmd.reduction.body import MarkerShapes

Make = Callable[..., Any]

SEEDS = range(4)
WEIGHT = (1.0, -2.0, -9.81)  # aslant, so that no axis of the ground is special
SECTIONS = pytest.mark.parametrize("section", [0.0, 1.0], ids=["stiff-sections", "turning-sections"])


def accelerations(system: CompiledSystem, q: Array, v: Array) -> Array:
    a = np.full(system.n, np.nan)
    evaluate(system.parameters, 0.0, q, v, a)
    return a


def by_points(chain: Any, q: Array, v: Array) -> Array:
    """Solve d'Alembert's principle, Σ m Jᵀ (J a + bias − g) = Q over all points (Kane & Levinson, Dynamics, 1985)."""
    J = chain.jacobian(q)
    M = np.einsum("i,iaj,iak->jk", chain.masses, J, J)
    lack = chain.tree.gravity - chain.bias(q, v)
    return np.asarray(np.linalg.solve(M, np.einsum("i,iaj,ia->j", chain.masses, J, lack) + chain.loads(q, v)))


def test_the_mass_matrix_is_that_of_the_points(chain: Make, name: str) -> None:
    # T = ½ Σ m |J v|², so its Hessian by the rates is Σ m JᵀJ.
    some = chain(name)
    for seed in SEEDS:
        q, _ = some.state(seed)
        J = some.jacobian(q)
        want = np.einsum("i,iaj,iak->jk", some.masses, J, J)
        M = some.system.mass_matrix(q)
        assert pytest.approx(want, abs=1e-12 * np.abs(want).max()) == M
        assert pytest.approx(M.T, abs=1e-13 * np.abs(want).max()) == M
        assert np.linalg.eigvalsh(M)[0] > 0


def test_accelerations_follow_from_dalemberts_principle_on_the_points(chain: Make, name: str) -> None:
    # Springs, dampers, loads, weight, modal damping and sections that turn with the modes, all at once.
    some = chain(name, gravity=WEIGHT)
    for seed in SEEDS:
        q, v = some.state(seed)
        want = by_points(some, q, v)
        assert accelerations(some.system, q, v) == pytest.approx(want, abs=1e-11 * np.abs(want).max())


@pytest.mark.parametrize("size", [0.0, *10.0 ** np.arange(-6.0, 0.1, 0.5)], ids=lambda size: f"{size:.0e}")
def test_a_place_turned_by_the_modes_is_right_at_angles_of_any_size(chain: Make, size: float) -> None:
    some = chain("free-flexible")
    link = some.tree.links[1]
    q, v = some.state(0, 1.0)
    (first, *_, last), inner = some.positions_of(np.arange(len(q)))[1], np.array([1.0, 0.7])
    q[first[0] : last[-1] + 1] = 0.0
    q[first] = size * inner / np.linalg.norm(link.place.rotation @ inner)
    want = by_points(some, q, v)
    assert accelerations(some.system, q, v) == pytest.approx(want, abs=1e-12 * np.abs(want).max())


def test_shapes_that_are_left_out_count_as_zero(chain: Make, name: str) -> None:
    whole = chain(name, gravity=WEIGHT)
    links = [
        replace(
            link,
            damping=0 * link.damping,
            joint_rotation=0 * link.joint_rotation,
            place=replace(link.place, translation=0 * link.place.translation, rotation=0 * link.place.rotation),
        )
        for link in whole.tree.links
    ]
    none: dict[str, Array] = {"damping": np.zeros(0), "joint_rotation": np.zeros(0)}
    links_without = [replace(link, place=MarkerShapes(link.place.position), **none) for link in whole.tree.links]
    bare = replace(whole.tree, links=links_without)
    zeros = replace(whole.tree, links=links)
    q, v = whole.state(17)
    assert np.array_equal(accelerations(CompiledSystem(bare), q, v), accelerations(CompiledSystem(zeros), q, v))
    energies = [Kinematics(tree, np.zeros(1), q[None], v[None]).energies for tree in (bare, zeros)]
    assert np.array_equal(*energies)
    assert CompiledSystem(bare).highest_frequency == CompiledSystem(zeros).highest_frequency


def test_positions_change_at_the_rates(chain: Make, name: str) -> None:
    some = chain(name)
    q, v = some.state(6)
    found = np.full(len(q), np.nan)
    evaluate_velocities(some.system.parameters, q, v, found)
    assert found == pytest.approx(some.derivative(q, v), abs=1e-15)


def test_the_undeformed_chain_has_all_frames_parallel_to_the_ground(chain: Make, name: str) -> None:
    tree = chain(name).tree
    places: dict[int, Array] = {-1: np.zeros(3)}
    frames = Kinematics(tree, np.zeros(1), tree.rest_positions[None], np.zeros((1, tree.n))).frames
    for k, link in enumerate(tree.links):
        places[k] = places[link.parent] + link.place.position
        assert frames[k].origin[0] == pytest.approx(places[k], abs=1e-15)
        assert np.array_equal(frames[k].rotation[0], np.eye(3))


def test_slow_joints_come_first_then_fast_ones_then_modes(chain: Make) -> None:
    tree = chain("free-flexible").tree
    assert list(tree.fast_joints) == ["body 3"]
    # 6 free, 1 revolute, 3 spherical and 1 revolute are slow; 1 prismatic and 10 modes fast; 2 rotations in space.
    assert (tree.n_slow, tree.n, tree.n_positions) == (11, 22, 24)
    rate, position = tree.layout.rate, tree.layout.position
    assert rate.tolist() == [0, 6, 7, 11, 10, 11]
    assert position.tolist() == [0, 7, 8, 13, 12, 13]
    assert [tree.modes_of(k).tolist()[:1] for k in range(6)] == [[12], [14], [], [17], [19], [21]]
    assert np.flatnonzero(tree.rest_positions).tolist() == [6, 11]  # scalar parts of the quaternions


def test_each_caller_of_parameters_has_room_of_its_own(chain: Make) -> None:
    some = chain("free-flexible", gravity=WEIGHT)
    one, other = some.system.parameters, some.system.parameters
    for field in ("inputs", "clock"):
        assert not np.shares_memory(getattr(one, field), getattr(other, field))


@SECTIONS
def test_the_frequencies_that_limit_the_step_are_those_of_small_motions(chain: Make, name: str, section: float) -> None:
    # Undeformed, with all frames parallel to the ground: K x = ω² M x with the inertia of the points.
    some = chain(name).with_sections(section)
    q = np.zeros(some.tree.n_positions)
    for place in some.positions_of(np.arange(q.size))[0]:
        q[place[-1:]] = float(place.size >= 4)
    J = some.jacobian(q)
    M, K, first = np.einsum("i,iaj,iak->jk", some.masses, J, J), some.stiffness(), some.tree.n_slow
    assert some.system.highest_frequency == pytest.approx(np.sqrt(eigh(K, M)[0][-1]), rel=1e-9)
    if first < some.tree.n:
        fast = np.sqrt(eigh(K[first:, first:], M[first:, first:])[0][-1])
        assert some.system.highest_fast_frequency == pytest.approx(fast, rel=1e-9)
