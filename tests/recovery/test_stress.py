"""Stress at nodes against closed forms, von Mises' stress, and the history over a motion."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from fmd.core.arrays import Array
from fmd.fem.assembly import assemble
from fmd.fem.markers import face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.space import Discretisation
from fmd.fem.strain import stresses
from fmd.meshes.bar import hexahedral_bar, tetrahedral_bar
from fmd.recovery.stress import StressHistory, modal_stress, von_mises
from fmd.reduction.eigen import FreeBodySolver

SIZES = (0.3, 0.04, 0.02)
HEX8, HEX20, TET10 = ("hex8", "hexahedron", 1), ("hex20", "hexahedron", 2), ("tet10", "tetra", 2)
XY = 5


@pytest.fixture(scope="module")
def bar(element: Any) -> Discretisation:
    """A bar of each element; the tetrahedra are as Gmsh makes them."""
    made = tetrahedral_bar(*SIZES, 0.02) if element.cell_type == "tetra" else hexahedral_bar(*SIZES, (7, 3, 2))
    return Discretisation(SolidMesh(*made), element.order)


def stress_of(space: Discretisation, material: Material, u: Array) -> Array:
    return modal_stress(space, material, u[:, :, None], np.arange(len(u)))[..., 0]


def tensors(n: int, **components: Array | float) -> Array:
    """Stress tensors (n, 6) with the given components and zeros."""
    stress = np.zeros((n, 6))
    for name, value in components.items():
        stress[:, ("xx", "yy", "zz", "yz", "xz", "xy").index(name)] = value
    return stress


def assert_equal_stress(found: Array, exact: Array, part: float) -> None:
    assert np.abs(found - exact).max() < part * np.abs(exact).max()


def test_a_pulled_bar_has_uniform_stress(bar: Discretisation, steel: Material) -> None:
    # σ_xx = σ: u = σ/E (x, −ν y, −ν z)
    u = 1e6 / steel.E * bar.x * [1, -steel.nu, -steel.nu]
    assert_equal_stress(stress_of(bar, steel, u), tensors(len(u), xx=1e6), 1e-9)


def test_a_bar_pulled_by_its_markers_has_uniform_stress(distorted: FEModel) -> None:
    # a force F on either end, as a uniform traction: σ = F / A = 1 / (1 × 0.8), whatever the inner nodes' places
    space = distorted.discretisation
    loads = np.zeros((len(distorted.x), 3, 1))
    for face, sign in (("x-", -1), ("x+", 1)):
        marker = face_marker(space, space.mesh.faces[face])
        loads[marker.nodes, 0, 0] += sign * marker.translation_weights
    u = FreeBodySolver(distorted).static_response(loads)
    found = modal_stress(space, distorted.material, u, np.arange(len(u)))[..., 0]
    assert_equal_stress(found, tensors(len(u), xx=1 / 0.8), 1e-8)


# A quadratic field is in the space of elements of order 2, and by their enhanced strain in that of linear hexahedra.
@pytest.mark.parametrize("element", [HEX8, HEX20, TET10], ids=["hex8", "hex20", "tet10"], indirect=True)
def test_a_bent_bar_has_stress_linear_over_its_depth(bar: Discretisation, steel: Material) -> None:
    # Timoshenko & Goodier, Theory of Elasticity, pure bending to the curvature κ: σ_xx = −E κ y
    x, y, z = bar.x.T
    kappa, nu = 1e-2, steel.nu
    u = kappa * np.stack([-x * y, (x**2 + nu * (y**2 - z**2)) / 2, nu * y * z], axis=1)
    assert_equal_stress(stress_of(bar, steel, u), tensors(len(u), xx=-steel.E * kappa * y), 1e-8)


# Bilinear fields, x y, y z and z x, are in the space of hex8 too.
@pytest.mark.parametrize("element", [HEX8, HEX20, TET10], ids=["hex8", "hex20", "tet10"], indirect=True)
def test_a_twisted_bar_has_saint_venants_stress(bar: Discretisation, steel: Material) -> None:
    # Saint-Venant's torsion with the warping function c·y·z of an ellipse, an exact solution inside any section:
    # u = α (c y z, −x z, x y), τ_xy = G α (c − 1) z, τ_xz = G α (c + 1) y.
    x, y, z = bar.x.T
    alpha, c, shear = 1e-2, -0.6, steel.E / (2 * (1 + steel.nu))
    u = alpha * np.stack([c * y * z, -x * z, x * y], axis=1)
    exact = tensors(len(u), xy=shear * alpha * (c - 1) * z, xz=shear * alpha * (c + 1) * y)
    assert_equal_stress(stress_of(bar, steel, u), exact, 1e-8)


def test_rigid_motions_have_no_stress(bar: Discretisation, steel: Material) -> None:
    u = np.array([1.0, 2.0, 3.0]) + np.cross([0.3, -0.1, 0.2], bar.x)
    assert np.abs(stress_of(bar, steel, u)).max() < 1e-10 * steel.E


def test_a_bar_twisted_by_its_ends_has_the_series_stress_on_its_long_side(steel: Material) -> None:
    """Solve for end torques; far from them the shear is Saint-Venant's, largest at the middle of the long side."""
    depth, width, torque = 0.04, 0.02, 1.0
    mesh = SolidMesh(*hexahedral_bar(0.2, depth, width, (14, 6, 4)))
    fe = assemble(mesh, 2, steel)
    loads = np.zeros((len(fe.x), 3, 1))
    for face, sign in (("x-", -torque), ("x+", torque)):
        marker = face_marker(fe.discretisation, mesh.faces[face])
        loads[marker.nodes, :, 0] += sign * marker.rotation_weights[0]
    u = FreeBodySolver(fe).static_response(loads)
    place = int(np.linalg.norm(fe.x - [0.1, 0, width / 2], axis=1).argmin())
    found = modal_stress(fe.discretisation, steel, u, np.array([place]))[0, :, 0]
    # Timoshenko & Goodier, section 109: τ_max = 2 G θ a (1 − 8/π² Σ 1/(n² cosh(n π b / 2a))) with 2a the shorter
    # side, T = G θ (2a)³ 2b/3 (1 − 192/π⁵ a/b Σ tanh(n π b / 2a)/n⁵), n odd
    a, b, n = width / 2, depth / 2, np.arange(1, 40, 2)
    twist = torque / (
        (2 * a) ** 3 * 2 * b / 3 * (1 - 192 / np.pi**5 * a / b * np.sum(np.tanh(n * np.pi * b / 2 / a) / n**5))
    )
    exact = 2 * twist * a * (1 - 8 / np.pi**2 * np.sum(1 / (n**2 * np.cosh(n * np.pi * b / 2 / a))))
    assert np.linalg.norm(fe.x[place] - [0.1, 0, width / 2]) < 1e-9
    # e_x × r at the top side z = a points along −y: τ_xy = −τ_max
    assert found[XY] == pytest.approx(-exact, rel=0.01)
    assert np.abs(np.delete(found, XY)).max() < 0.01 * exact


def test_only_the_chosen_nodes_are_evaluated_and_come_out_the_same(
    distorted: FEModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    space, n = distorted.discretisation, len(distorted.x)
    shapes = np.random.default_rng(0).standard_normal((n, 3, 3))
    whole = modal_stress(space, distorted.material, shapes, np.arange(n))
    some = np.random.default_rng(1).permutation(n)[: n // 5]
    evaluated: list[int] = []

    def noted(*arguments: Any) -> Array:
        evaluated.extend(arguments[-1])
        return stresses(*arguments)

    monkeypatch.setattr("fmd.fem.strain.stresses", noted)
    found = modal_stress(space, distorted.material, shapes, some)
    assert np.abs(found - whole[some]).max() < 1e-14 * np.abs(whole).max()
    touching = [k for k, nodes in enumerate(space.element_nodes) if {*nodes} & {*some}]
    assert sorted(evaluated) == touching
    assert len(touching) < len(space.element_nodes)


def test_stress_is_linear_in_the_shapes(distorted: FEModel) -> None:
    space, n = distorted.discretisation, len(distorted.x)
    rng = np.random.default_rng(2)
    shapes, q = rng.standard_normal((n, 3, 3)), rng.standard_normal(3)
    summed = modal_stress(space, distorted.material, (shapes @ q)[:, :, None], np.arange(n))[..., 0]
    separate = modal_stress(space, distorted.material, shapes, np.arange(n)) @ q
    assert np.abs(summed - separate).max() < 1e-12 * np.abs(summed).max()


def test_elements_beyond_one_batch_are_evaluated_too(box_mesh: Callable[..., SolidMesh], steel: Material) -> None:
    # 6 × 5 × 5 × 5 = 750 tetrahedra, more than the 512 that are treated at a time
    space = Discretisation(box_mesh("tetra", (5, 5, 5), distortion=0.2), 1)
    u = 1e6 / steel.E * space.x * [1, -steel.nu, -steel.nu]
    assert_equal_stress(stress_of(space, steel, u), tensors(len(u), xx=1e6), 1e-9)


def test_shapes_of_another_mesh_are_refused(small_bar: FEModel) -> None:
    n = len(small_bar.x)
    with pytest.raises(ValueError, match=rf"shapes has shape \({n - 1}, 3, 1\), expected \({n}, 3, any\)"):
        modal_stress(small_bar.discretisation, small_bar.material, np.zeros((n - 1, 3, 1)), np.arange(3))


# Closed forms: |σ| in tension, √3 |τ| in shear, nothing under pressure, |σ₁ − σ₂|-like sums in between.
@pytest.mark.parametrize(
    ("tensor", "exact"),
    [
        ([5, 0, 0, 0, 0, 0], 5),
        ([0, -5, 0, 0, 0, 0], 5),
        ([0, 0, 0, 0, 0, 2], 2 * np.sqrt(3)),
        ([0, 0, 0, -2, 0, 0], 2 * np.sqrt(3)),
        ([0, 0, 0, 0, 2, 0], 2 * np.sqrt(3)),
        ([7, 7, 7, 0, 0, 0], 0),
        ([3, -3, 0, 0, 0, 0], 3 * np.sqrt(3)),  # pure shear at 45°
        ([4, 0, 0, 0, 0, 3], np.sqrt(4**2 + 3 * 3**2)),  # a twisted and pulled shaft
    ],
)
def test_von_mises_stress_of_simple_states(tensor: list[float], exact: float) -> None:
    assert von_mises(np.array([tensor], dtype=float)) == pytest.approx([exact], abs=1e-14)


def matrices(stress: Array) -> Array:
    xx, yy, zz, yz, xz, xy = stress.T
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@given(
    arrays(float, 6, elements=st.floats(-1e3, 1e3)),
    arrays(float, 3, elements=st.floats(-3, 3)),
    st.floats(-1e3, 1e3),
)
def test_von_mises_stress_does_not_change_with_the_axes_or_with_pressure(stress: Array, turn: Array, p: float) -> None:
    R = Rotation.from_rotvec(turn).as_matrix()
    turned = R @ matrices(stress) @ R.T - p * np.eye(3)
    rotated = turned[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
    assert von_mises(rotated[None]) == pytest.approx(von_mises(stress[None]), rel=1e-9, abs=1e-5)


@given(arrays(float, 6, elements=st.floats(-1e3, 1e3)))
def test_von_mises_stress_is_that_of_the_deviator(stress: Array) -> None:
    # √(3/2 s:s), s the deviator
    sigma = matrices(stress)
    s = sigma - np.trace(sigma) / 3 * np.eye(3)
    assert von_mises(stress[None]) == pytest.approx([np.sqrt(1.5 * np.sum(s * s))], rel=1e-9, abs=1e-9)


def test_von_mises_stress_takes_many_states_at_once() -> None:
    stress = np.random.default_rng(3).standard_normal((5, 6, 4))
    for k in range(4):
        assert von_mises(stress)[:, k] == pytest.approx(von_mises(stress[..., k]), rel=1e-14)


def random_history(n_nodes: int, n_times: int, n: int = 3) -> StressHistory:
    rng = np.random.default_rng(4)
    times = np.cumsum(rng.uniform(0.5, 1.5, n_times))
    return StressHistory(
        np.arange(100, 100 + n_nodes), rng.standard_normal((n_nodes, 6, n)), times, rng.standard_normal((n_times, n))
    )


# 2e7 values are formed at a time: the second history takes three turns, the last a short one
@pytest.mark.parametrize(("n_nodes", "n_times"), [(50, 40), (150_000, 45)])
def test_the_worst_stress_is_the_largest_of_all(n_nodes: int, n_times: int) -> None:
    history = random_history(n_nodes, n_times)
    every = np.stack([von_mises(history.modal @ q) for q in history.q])
    k, place = np.unravel_index(every.argmax(), every.shape)
    time, found_place, value = history.worst()
    assert (time, found_place) == (history.times[k], place)
    assert value == pytest.approx(every.max(), rel=1e-12)
    assert history.von_mises(time)[found_place] == pytest.approx(value, rel=1e-12)


def test_tensors_are_formed_for_the_wanted_frames_only() -> None:
    history, formed = random_history(9, 50), []

    def noted(tensors: Array) -> Array:
        formed.append(tensors.shape)
        return von_mises(tensors)

    wanted = np.array([3, 41, 7])
    values = history.measure_at(wanted, noted)
    assert formed == [(9, 6, 3)]
    assert values == pytest.approx(np.stack([von_mises(history.modal @ history.q[k]) for k in wanted]), rel=1e-12)


def test_stress_at_an_output_time_is_the_sum_of_the_modes() -> None:
    history = random_history(7, 5)
    for k, time in enumerate(history.times):
        assert history.tensor(time) == pytest.approx(np.einsum("nsj,j->ns", history.modal, history.q[k]), rel=1e-12)


def test_stress_between_output_times_is_interpolated_as_a_tensor() -> None:
    history = random_history(7, 5)
    before, after = history.times[2:4]
    halfway = (history.tensor(before) + history.tensor(after)) / 2
    assert history.tensor((before + after) / 2) == pytest.approx(halfway, rel=1e-12)
    assert history.von_mises((before + after) / 2) == pytest.approx(von_mises(halfway), rel=1e-12)


@pytest.mark.parametrize("outside", [-1e-9, 1e-9, np.nan])
def test_stress_outside_the_motion_is_refused(outside: float) -> None:
    history = random_history(2, 5)
    first, last = history.times[0], history.times[-1]
    time = first + outside if outside < 0 else last + outside
    with pytest.raises(ValueError, match=rf"t = {time} s is outside the motion, {first} … {last} s"):
        history.tensor(time)
