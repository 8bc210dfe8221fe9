"""The inertia shape integrals against direct integration over the elements."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
import skfem

from fmd.core.arrays import EPSILON, Array
from fmd.core.errors import AccuracyError
from fmd.fem.assembly import assemble
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.reduction.inertia import InertiaIntegrals, add_normal_blocks, inertia_integrals, normal_blocks

N_SHAPES = 4
SIZES = (1.2, 1.0, 0.8)


def random_shapes(fe: FEModel) -> Array:
    return np.random.default_rng(0).standard_normal((len(fe.x), 3, N_SHAPES))


@pytest.fixture(scope="module")
def integrals(distorted: FEModel) -> InertiaIntegrals:
    return inertia_integrals(distorted.x, distorted.m, random_shapes(distorted))


@pytest.fixture
def state() -> Array:
    """A random p = (1, q)."""
    return np.concatenate([[1.0], np.random.default_rng(1).standard_normal(N_SHAPES)])


def motion_fields(r: Array, shapes: list[Array]) -> list[Array]:
    """Velocity of points at r (…, 3) for a unit of each generalised speed: v₀, ω and the modes'."""
    ones = np.ones((*r.shape[:-1], 1))
    return [ones * axis for axis in np.eye(3)] + [np.cross(axis, r) for axis in np.eye(3)] + shapes


# A tetrahedron's Jacobian is constant and a regular hexahedron's too: both mass matrices are exact there.
@pytest.mark.parametrize(("cell_type", "distortion"), [("tetra", 0.2), ("hexahedron", 0.0)])
@pytest.mark.parametrize("order", [1, 2])
def test_the_mass_matrix_is_the_integral_over_the_deformed_body(
    cell_type: str, distortion: float, order: int, box_mesh: Callable[..., SolidMesh], steel: Material, state: Array
) -> None:
    """Integrate ρ δr_i · δr_j over the elements, in their deformed state, by scikit-fem's quadrature of order 8."""
    fe = assemble(box_mesh(cell_type, (3, 3, 3), SIZES, distortion), order, steel)
    Phi = random_shapes(fe)
    space = fe.discretisation
    basis = skfem.Basis(space.skfem_mesh, skfem.ElementVector(space.kind.element), intorder=8)
    at_points = [np.moveaxis(np.asarray(basis.interpolate(Phi[..., k].ravel())), 0, -1) for k in range(N_SHAPES)]
    x = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)
    r = x + sum(q * phi for q, phi in zip(state[1:], at_points, strict=True))
    fields = motion_fields(r, at_points)
    direct = steel.rho * np.array([[np.sum(a * b * basis.dx[..., None]) for a in fields] for b in fields])
    found = inertia_integrals(fe.x, fe.m, Phi).mass_matrix(state)
    assert np.abs(found - direct).max() < 1e-12 * np.abs(direct).max()


def test_the_kinetic_energy_is_that_of_the_finite_element_model(
    distorted: FEModel, integrals: InertiaIntegrals, state: Array
) -> None:
    """½ vᵀ M v with the nodal velocities v = v₀ + ω × (x + u) + u̇, for any motion."""
    rng = np.random.default_rng(2)
    Phi = random_shapes(distorted)
    for _ in range(5):
        speeds = rng.standard_normal(6 + N_SHAPES)
        v0, omega, rates = np.split(speeds, [3, 6])
        v = v0 + np.cross(omega, distorted.x + Phi @ state[1:]) + Phi @ rates
        whole = 0.5 * v.ravel() @ (distorted.M @ v.ravel())
        assert 0.5 * speeds @ integrals.mass_matrix(state) @ speeds == pytest.approx(whole, rel=1e-12)


def test_the_mass_matrix_is_symmetric_and_positive_definite(integrals: InertiaIntegrals, state: Array) -> None:
    M = integrals.mass_matrix(state)
    assert np.abs(M - M.T).max() < 1e-13 * np.abs(M).max()
    assert np.linalg.eigvalsh(M).min() > 0


def test_the_undeformed_body_has_the_inertia_of_a_box_about_its_corner(
    box_mesh: Callable[..., SolidMesh], steel: Material
) -> None:
    fe = assemble(box_mesh("hexahedron", (2, 2, 2), SIZES), 2, steel)
    integrals = inertia_integrals(fe.x, fe.m, random_shapes(fe))
    rest = np.eye(1, 1 + N_SHAPES)[0]
    mass = steel.rho * np.prod(SIZES)
    a, b, c = SIZES
    # textbook: m (b² + c²)/3 on the diagonal, −m a b/4 beside it
    inertia = mass * np.array([
        [(b * b + c * c) / 3, -a * b / 4, -a * c / 4],
        [-a * b / 4, (a * a + c * c) / 3, -b * c / 4],
        [-a * c / 4, -b * c / 4, (a * a + b * b) / 3],
    ])  # fmt: skip
    assert integrals.mass == pytest.approx(mass, rel=1e-13)
    assert integrals.S @ rest == pytest.approx(mass * np.array(SIZES) / 2, rel=1e-13)
    assert integrals.inertia(rest) == pytest.approx(inertia, rel=1e-12)
    assert integrals.second_moment(rest) == pytest.approx(np.trace(inertia) / 2 * np.eye(3) - inertia, rel=1e-12)


def test_turning_the_body_turns_its_inertia(distorted: FEModel, integrals: InertiaIntegrals, state: Array) -> None:
    turn = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    turned = inertia_integrals(
        distorted.x @ turn.T, distorted.m, np.einsum("ab,ibk->iak", turn, random_shapes(distorted))
    )
    T = np.eye(6 + N_SHAPES)
    T[:3, :3] = T[3:6, 3:6] = turn
    M = T @ integrals.mass_matrix(state) @ T.T
    assert np.abs(turned.mass_matrix(state) - M).max() < 1e-12 * np.abs(M).max()


def test_the_integrals_cannot_be_changed(integrals: InertiaIntegrals) -> None:
    for array in (integrals.G, integrals.S):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_positions_that_are_not_in_space_are_refused(small_bar: FEModel) -> None:
    with pytest.raises(ValueError, match=r"x has shape \(\d+, 2\), expected \(any, 3\)"):
        inertia_integrals(small_bar.x[:, :2], small_bar.m, random_shapes(small_bar))


def test_shapes_of_another_mesh_are_refused(small_bar: FEModel) -> None:
    n = len(small_bar.x)
    with pytest.raises(ValueError, match=rf"Phi has shape \({n - 1}, 3, 4\), expected \({n}, 3, any\)"):
        inertia_integrals(small_bar.x, small_bar.m, random_shapes(small_bar)[1:])


def test_a_mass_matrix_that_is_not_symmetric_is_refused(small_bar: FEModel) -> None:
    skew = small_bar.m + sp.csr_array(([1e-3 * small_bar.mass], ([0], [1])), shape=small_bar.m.shape)
    with pytest.raises(
        AccuracyError, match=r"the inertia shape integrals are not symmetric: relative error \d\.\de-\d\d"
    ):
        inertia_integrals(small_bar.x, skew, random_shapes(small_bar))


def test_shapes_that_are_not_finite_are_refused(small_bar: FEModel) -> None:
    shapes = random_shapes(small_bar)
    shapes[0, 0, 0] = np.nan
    with pytest.raises(AccuracyError, match="not symmetric: relative error nan"):
        inertia_integrals(small_bar.x, small_bar.m, shapes)


def symmetric(seed: int, *shape: int) -> Array:
    entries = np.random.default_rng(seed).standard_normal((*shape, N_SHAPES, N_SHAPES))
    return entries + entries.swapaxes(-1, -2)


def first_moment(integrals: InertiaIntegrals, q: Array) -> Array:
    """c, read from the coupling of rotation and translation, c̃."""
    M = integrals.mass_matrix(np.append(1.0, q))
    return np.array([M[5, 1], M[3, 2], M[4, 0]])


def test_a_displacement2_couples_translation_and_modes_as_the_first_moment_changes(
    integrals: InertiaIntegrals, state: Array
) -> None:
    """The rows of translation and modes are ∂c/∂q; c is of second order, so central differences are exact."""
    bowed = replace(integrals, displacement2=symmetric(4, 3))
    q = state[1:]
    rows = bowed.mass_matrix(state)[:3, 6:]
    differences = [first_moment(bowed, q + step) - first_moment(bowed, q - step) for step in np.eye(N_SHAPES)]
    assert rows == pytest.approx(np.array(differences).T / 2, rel=1e-10)
    assert np.abs(rows - integrals.mass_matrix(state)[:3, 6:]).max() > 1e-3 * np.abs(rows).max()
    assert first_moment(bowed, 0 * q) == pytest.approx(first_moment(integrals, 0 * q), rel=1e-14)


def test_a_rotation2_is_the_angular_momentum_of_points_that_second_order_moves(
    integrals: InertiaIntegrals, state: Array
) -> None:
    """Pairs of points at one place, of masses ±m, are moved by ±Γ: all they have is what is linear in Γ."""
    rng, Gamma = np.random.default_rng(6), symmetric(6, 4, 3)
    x, m, q, v = rng.normal(size=(4, 3)), rng.uniform(0.1, 0.4, 4), state[1:], rng.normal(size=N_SHAPES)
    turned = replace(integrals, rotation2=2.0 * np.einsum("i,abc,ib,icjk->ajk", m, EPSILON, x, Gamma))
    velocity, moved = Gamma @ v @ q, 0.5 * Gamma @ q @ q
    momentum = m @ (np.cross(x + moved, velocity) + np.cross(x - moved, velocity))
    added = turned.mass_matrix(state) - integrals.mass_matrix(state)
    assert added[3:6, 6:] @ v == pytest.approx(momentum, rel=1e-10)
    assert not added[:3].any()


def test_stiffening_counts_for_inertia_and_not_for_modal_mass(integrals: InertiaIntegrals, state: Array) -> None:
    K = symmetric(5, 3, 3)
    K = K + K.swapaxes(0, 1)
    G = integrals.G.copy()
    G[:, :, 1:, 1:] -= K
    stiff = replace(integrals, G=G, stiffening=K)
    found, before = stiff.mass_matrix(state), integrals.mass_matrix(state)
    assert found[6:, 6:] == pytest.approx(before[6:, 6:], rel=1e-12)
    assert found[3:6, 6:] == pytest.approx(before[3:6, 6:], rel=1e-9, abs=1e-9)  # K is symmetric in the axes
    fall = np.einsum("abij,i,j->ab", K, state[1:], state[1:])
    assert before[3:6, 3:6] - found[3:6, 3:6] == pytest.approx(np.trace(fall) * np.eye(3) - fall, rel=1e-9)


# One axis of turning -----------------------------------------------------------------------------------------------


class Counted:
    """A mass matrix that counts the columns it is multiplied by."""

    def __init__(self, m: Any) -> None:
        self.m, self.columns = m, 0

    def __matmul__(self, other: Array) -> Array:
        self.columns += other[0].size
        return np.asarray(self.m @ other)


@pytest.mark.parametrize("normal", range(3))
def test_a_body_that_turns_about_one_axis_takes_the_blocks_across_it_alone(
    distorted: FEModel, integrals: InertiaIntegrals, state: Array, normal: int
) -> None:
    m, Phi = Counted(distorted.m), random_shapes(distorted)
    plane = inertia_integrals(distorted.x, m, Phi, normal)
    assert m.columns == 2 * (1 + N_SHAPES) + 1  # and the nodes' masses
    across = [a for a in range(3) if a != normal]
    size = np.abs(integrals.G).max()
    assert np.abs(plane.G - integrals.G)[np.ix_(across, across)].max() < 1e-15 * size
    assert not plane.G[normal].any()
    assert not plane.G[:, normal].any()
    assert plane.inertia(state)[normal, normal] == pytest.approx(integrals.inertia(state)[normal, normal], rel=1e-14)
    assert plane.S.tobytes() == integrals.S.tobytes()
    assert plane.mass == integrals.mass
    with pytest.raises(ValueError, match=f"no more of the inertia than turning about {'xyz'[normal]} takes"):
        plane.mass_matrix(state)
    m.columns = 0
    whole = add_normal_blocks(plane, normal_blocks(distorted.x, m, Phi, normal))
    assert m.columns == 1 + N_SHAPES
    assert np.abs(whole.G - integrals.G).max() < 1e-15 * size
    assert np.abs(whole.mass_matrix(state) - integrals.mass_matrix(state)).max() < 1e-14 * size
    assert not whole.G.flags.writeable
