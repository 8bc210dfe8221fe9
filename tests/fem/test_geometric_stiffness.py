"""Geometric stiffness as matrices: equal to its integral, in the structure of stiffness and mass."""

import numpy as np
import pytest

import fmd.fem.model
from fmd.core.arrays import Array
from fmd.fem.assembly import assemble
from fmd.fem.geometric_stiffness import geometric_stiffness
from fmd.fem.material import Material, MaterialOfElements
from fmd.fem.model import FEModel
from fmd.fem.space import BlockStructure


def integral(fe: FEModel, u: Array, shapes: Array) -> Array:
    """``∫ σ_ab ∂_a φ_j·∂_b φ_l dV`` straight from the fields' slopes at the quadrature points, without any matrix."""
    space = fe.discretisation
    X, w = space.kind.quadrature(space.kind.stiffness_order)
    g, det = space.gradients(X, slice(None))
    slopes, pull = (np.einsum("eqna,enik->eqaik", g, field[space.element_nodes]) for field in (shapes, u))
    found = np.zeros((u.shape[2], shapes.shape[2], shapes.shape[2]))
    for own, mine in fe.material.over(slice(None)):
        lam, mu = own.lame
        strain = 0.5 * (pull[mine] + pull[mine].swapaxes(2, 3))
        stress = 2 * mu * strain + lam * np.einsum("eqcck,ab->eqabk", strain, np.eye(3))
        weighted = stress * (det[mine] * w)[..., None, None, None]
        found += np.einsum("eqabk,eqaij,eqbil->kjl", weighted, slopes[mine], slopes[mine], optimize=True)
    return found


def assert_equal_to_the_integral(fe: FEModel) -> None:
    rng = np.random.default_rng(0)
    u, shapes = rng.standard_normal((len(fe.x), 3, 2)), rng.standard_normal((len(fe.x), 3, 3))
    exact = integral(fe, u, shapes)
    for k_G, wanted in zip(geometric_stiffness(fe, u), exact, strict=True):
        found = np.einsum("nij,nil->jl", shapes, (k_G @ shapes.reshape(len(shapes), -1)).reshape(shapes.shape))
        assert np.abs(found - wanted).max() < 1e-12 * np.abs(exact).max()


def test_geometric_stiffness_is_its_integral(distorted: FEModel) -> None:
    space = distorted.discretisation
    assert_equal_to_the_integral(assemble(space.mesh, space.order, distorted.material, "plain"))


def test_the_forces_of_a_stressed_body_turn_with_it(distorted: FEModel) -> None:
    # with forces f = K u at the nodes, a small rotation θ of body and stress together changes them by θ × f
    space = distorted.discretisation
    materials = Material(1.0, 0.3, 1.0), Material(5.0, 0.495, 2.0)
    material = MaterialOfElements(materials, np.arange(len(space.element_nodes)) % 2)
    fe = assemble(space.mesh, space.order, material)
    u = np.random.default_rng(2).standard_normal((len(fe.x), 3, 1))
    force, theta = (fe.K @ u.ravel()).reshape(-1, 3), np.array([0.3, -0.5, 0.7])
    (k_G,) = geometric_stiffness(fe, u)
    assert np.abs(k_G @ np.cross(theta, fe.x) - np.cross(theta, force)).max() < 1e-12 * np.abs(force).max()


def test_each_part_has_the_stress_of_its_own_material(distorted: FEModel) -> None:
    space = distorted.discretisation
    numbers = np.arange(len(space.element_nodes)) % 2
    material = MaterialOfElements((Material(1.0, 0.3, 1.0), Material(5.0, 0.1, 2.0)), numbers)
    assert_equal_to_the_integral(assemble(space.mesh, space.order, material, "plain"))


def test_stiffness_mass_and_every_geometric_stiffness_are_in_one_structure_built_once(
    distorted: FEModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    built = []

    class Counted(BlockStructure):
        def __init__(self, *arguments: Array) -> None:
            built.append(self)
            super().__init__(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(fmd.fem.space, "BlockStructure", Counted)
    space = distorted.discretisation
    fe = assemble(space.mesh, space.order, distorted.material)
    u = np.random.default_rng(1).standard_normal((len(fe.x), 3, 2))
    for k_G in geometric_stiffness(fe, u) + geometric_stiffness(fe, u[..., :1]):
        assert np.array_equal(k_G.indices, fe.m.indices)
        assert np.array_equal(k_G.indptr, fe.m.indptr)
        assert abs(k_G - k_G.T).max() < 1e-13 * abs(k_G).max()
        assert np.abs(k_G @ np.ones(len(fe.x))).max() < 1e-12 * abs(k_G).max()  # a translation has no slopes
    assert np.array_equal(fe.K.indptr[::3], 9 * fe.m.indptr)
    assert len(built) == 1
