"""Stiffness and mass: equal to scikit-fem's own, and true to the laws of elasticity and mechanics."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
import skfem
from scipy.sparse.linalg import spsolve
from skfem.helpers import dot
from skfem.models.elasticity import lame_parameters, linear_elasticity

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.fem.assembly import assemble
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.surface import surface_topology
from fmd.recovery.stress import modal_stress


@skfem.BilinearForm
def inner_product(u: Any, v: Any, _: Any) -> Any:
    return dot(u, v)


def vector_basis(fe: FEModel, order: int) -> skfem.Basis:
    space = fe.discretisation
    return skfem.Basis(space.skfem_mesh, skfem.ElementVector(space.kind.element), intorder=order)


def relative(A: Any, B: Any) -> float:
    return float(abs(A - B).max() / abs(B).max())


def test_stiffness_equals_scikit_fems_own(distorted: FEModel) -> None:
    material, space = distorted.material, distorted.discretisation
    basis = vector_basis(distorted, space.kind.stiffness_order)
    K = linear_elasticity(*lame_parameters(material.E, material.nu)).assemble(basis)
    assert relative(assemble(space.mesh, space.order, material, "plain").K, K) < 1e-12
    assert (relative(distorted.K, K) < 1e-12) == (space.kind.name != "hex8")  # which is enhanced unless wanted plain


def test_mass_equals_scikit_fems_own(distorted: FEModel) -> None:
    basis = vector_basis(distorted, distorted.discretisation.kind.mass_order)
    M = distorted.material.rho * inner_product.assemble(basis)
    assert relative(distorted.M, M) < 1e-12


def test_nodes_lie_where_scikit_fem_puts_them(distorted: FEModel) -> None:
    basis = vector_basis(distorted, 2)
    assert np.abs(distorted.x - basis.doflocs[:, ::3].T).max() < 1e-15


def test_stiffness_and_mass_are_symmetric_to_the_last_bit(distorted: FEModel) -> None:
    assert abs(distorted.K - distorted.K.T).max() == 0
    assert abs(distorted.M - distorted.M.T).max() == 0


def test_mass_is_positive_definite_and_stiffness_has_six_zeros_and_no_negative(distorted: FEModel) -> None:
    assert np.linalg.eigvalsh(distorted.m.toarray()).min() > 0
    stiffness = np.linalg.eigvalsh(distorted.K.toarray()) / distorted.material.E
    assert np.abs(stiffness[:6]).max() < 1e-13
    assert stiffness[6] > 1e-3


def test_rigid_motions_need_no_force(distorted: FEModel) -> None:
    K, R = distorted.K, distorted.rigid_modes
    assert np.linalg.matrix_rank(R) == 6
    assert np.abs(K @ R).max() < 1e-13 * abs(K).max()


def test_rigid_modes_are_translations_and_turns_about_the_origin(distorted: FEModel) -> None:
    for a, axis in enumerate(np.eye(3)):
        assert np.array_equal(distorted.rigid_modes[:, a], np.tile(axis, len(distorted.x)))
        assert np.array_equal(distorted.rigid_modes[:, 3 + a], np.cross(axis, distorted.x).ravel())


def test_mass_and_first_moments_are_those_of_the_box(distorted: FEModel) -> None:
    # 1.2 × 1 × 0.8 m with a corner at the origin; the moved inner points change nothing
    mass = distorted.material.rho * 1.2 * 1.0 * 0.8
    assert distorted.mass == pytest.approx(mass, rel=1e-13)
    assert distorted.m.sum(axis=0) @ distorted.x == pytest.approx(mass * np.array([0.6, 0.5, 0.4]), rel=1e-13)


@pytest.mark.parametrize("cell_type", ["tetra", "hexahedron"])
@pytest.mark.parametrize("order", [1, 2])
def test_second_moments_of_an_undistorted_box_are_exact(
    cell_type: str, order: int, box_mesh: Callable[..., SolidMesh], steel: Material
) -> None:
    fe = assemble(box_mesh(cell_type, (2, 3, 2), (1.2, 1.0, 0.8)), order, steel)
    sizes = np.array([1.2, 1.0, 0.8])
    # ∫ρ x_a x_b over the box: mass · s_a s_b / 4 off the diagonal, mass · s_a² / 3 on it
    expected = fe.mass * np.outer(sizes, sizes) * (np.full((3, 3), 1 / 4) + np.eye(3) / 12)
    assert fe.x.T @ (fe.m @ fe.x) == pytest.approx(expected, rel=1e-13)


def test_a_linear_displacement_of_the_boundary_gives_constant_stress_inside(distorted: FEModel) -> None:
    """Pass the patch test (Irons & Razzaque 1972)."""
    space, material = distorted.discretisation, distorted.material
    gradient = np.random.default_rng(1).standard_normal((3, 3))
    exact = distorted.x @ gradient.T
    held = np.zeros(exact.shape, dtype=bool)
    held[surface_topology(space).nodes] = True
    held = held.ravel()
    assert not held.all()
    u = np.where(held, exact.ravel(), 0.0)
    K = sp.csc_array(distorted.K)
    u[~held] = spsolve(K[~held][:, ~held], -K[~held][:, held] @ u[held])
    assert np.abs(u.reshape(-1, 3) - exact).max() < 1e-12 * np.abs(exact).max()
    strain = (gradient + gradient.T) / 2
    lam, mu = lame_parameters(material.E, material.nu)
    hooke = lam * np.trace(strain) * np.eye(3) + 2 * mu * strain
    stress = modal_stress(space, material, u.reshape(-1, 3, 1), np.arange(len(distorted.x)))[..., 0]
    wanted = hooke[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
    assert np.abs(stress - wanted).max() < 1e-11 * np.abs(wanted).max()


def test_strain_energy_of_a_stretch_is_half_stress_times_strain_times_volume(distorted: FEModel) -> None:
    # uniaxial stress σ: u = σ/E (x, −ν y, −ν z), energy σ²/2E per volume
    E, nu = distorted.material.E, distorted.material.nu
    u = (distorted.x * [1, -nu, -nu] * 1e-3).ravel()
    assert 0.5 * u @ distorted.K @ u == pytest.approx(0.5 * E * 1e-6 * 0.96, rel=1e-12)


def test_the_order_of_the_cells_does_not_matter(element: Any, box_mesh: Callable[..., SolidMesh]) -> None:
    # Node numbers differ, so what is compared is independent of them: the spectrum.
    material = Material(1.0, 0.3, 1.0)
    box = box_mesh(element.cell_type, (2, 2, 2), distortion=0.2)
    shuffled = np.random.default_rng(2).permutation(box.cells)

    def spectrum(cells: Array) -> Array:
        mesh = SolidMesh(box.points.copy(), cells, box.cell_type, {}, {})
        return np.linalg.eigvalsh(assemble(mesh, element.order, material).K.toarray())

    assert spectrum(shuffled) == pytest.approx(spectrum(box.cells.copy()), abs=1e-13)


def test_elements_beyond_one_batch_are_assembled_too(box_mesh: Callable[..., SolidMesh], steel: Material) -> None:
    # 6 × 8 × 8 × 8 = 3072 tetrahedra, more than the 2048 that are treated at a time
    fe = assemble(box_mesh("tetra", (8, 8, 8)), 1, steel)
    assert fe.mass == pytest.approx(steel.rho, rel=1e-12)
    basis = vector_basis(fe, 0)
    K = linear_elasticity(*lame_parameters(steel.E, steel.nu)).assemble(basis)
    assert relative(fe.K, K) < 1e-12


# Right-handed at all eight corners, which is what the mesh checks, yet inside out further in: found by search.
CROOKED = np.array(
    [(1, 0.5, -1), (0, 0, -0.5), (1, 1, 1), (0, 0.5, 0), (1, 2, 0), (-0.5, 2, 1.5), (0, -0.5, 1), (1, -1, 1)]
)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_elements_that_are_inverted_inside_are_counted_wherever_they_stand(
    order: int, place: int, box_mesh: Callable[..., SolidMesh], steel: Material
) -> None:
    good = box_mesh("hexahedron", (2, 1, 1))
    points = np.concatenate([good.points, CROOKED + 5.0])
    cells = np.insert(good.cells, place, np.arange(12, 20), axis=0)
    mesh = SolidMesh(points, cells, "hexahedron", {}, {})
    assert mesh.quality.min() > 0
    with pytest.raises(AccuracyError, match=r"^1 elements are inverted \(Jacobian ≤ 0 at a quadrature point\)"):
        assemble(mesh, order, steel)
