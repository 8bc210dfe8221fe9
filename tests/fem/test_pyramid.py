"""Pyramids: quadrature, neighbours, and boxes of them against closed forms and hexahedra."""

from collections.abc import Callable
from math import factorial

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh, spsolve

from fmd.core.arrays import Array
from fmd.fem.assembly import assemble
from fmd.fem.cells.pyramid import Pyramid
from fmd.fem.cells.table import CELLS
from fmd.fem.elements import shape_functions
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.partition import divide_mesh
from fmd.fem.space import Discretisation
from fmd.recovery.stress import modal_stress

SIZES = (1.2, 1.0, 0.8)
MATERIAL = Material(70e9, 0.33, 2700.0)


def pyramid_box(box_mesh: Callable[..., SolidMesh], n: int, order: int, moved: float = 0.0, sizes=SIZES) -> FEModel:
    """Return a box of n³ hexahedra that are split into the six pyramids over their faces."""
    hexahedra = box_mesh("hexahedron", (n, n, n), sizes, moved)
    faces = np.array(CELLS["hexahedron"].shape.faces)[:, ::-1]
    centres = len(hexahedra.points) + np.arange(len(hexahedra.cells))
    cells = np.column_stack([hexahedra.cells[:, faces].reshape(-1, 4), np.repeat(centres, 6)])
    points = np.concatenate([hexahedra.points, hexahedra.points[hexahedra.cells].mean(axis=1)])
    if order == 2:
        ends = np.sort(cells[:, np.array(Pyramid.edges)], axis=2)
        edges, number = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
        cells = np.column_stack([cells, len(points) + number.reshape(len(cells), -1)])
        points = np.concatenate([points, points[edges].mean(axis=1)])
    cell_type = {1: "pyramid", 2: "pyramid13"}[order]
    return assemble(SolidMesh(points, cells, cell_type, {}, {}), order, MATERIAL)


@pytest.mark.parametrize("degree", [2, 3, 5, 7])
def test_the_pyramids_quadrature_is_exact(degree: int) -> None:
    (x, y, z), w = Pyramid.quadrature(degree)
    for a in range(degree + 1):
        for b in range(degree + 1 - a):
            c = degree - a - b
            # ∫ x^a y^b over the square of side 1 − z, then Euler's beta function over z
            exact = factorial(c) * factorial(a + b + 2) / factorial(a + b + c + 3) / ((a + 1) * (b + 1))
            assert w @ (x**a * y**b * z**c) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("order", [1, 2])
def test_rational_matrices_of_affine_pyramids_are_integrated_exactly(order: int) -> None:
    kind = CELLS[{1: "pyramid", 2: "pyramid13"}[order]].element(order)

    def products(degree: int, gradients: bool) -> Array:
        X, w = kind.quadrature(degree)
        N, dN = shape_functions(kind.element, X)
        return np.einsum("aiq,bjq,q->aibj", dN, dN, w) if gradients else np.einsum("aq,bq,q->ab", N, N, w)

    for degree, gradients in ((kind.stiffness_order, True), (kind.mass_order, False)):
        assert np.abs(products(degree, gradients) - products(15, gradients)).max() < 1e-14


@pytest.mark.parametrize("order", [1, 2])
def test_on_a_face_a_pyramid_is_its_neighbour(order: int) -> None:
    kind = CELLS[{1: "pyramid", 2: "pyramid13"}[order]].element(order)
    rng = np.random.default_rng(0)
    for polygon in kind.facet_polygons:
        nodes = kind.element.doflocs[polygon]
        start, sides = nodes[0], nodes[[order, -order]] - nodes[0]
        X = (start + rng.uniform(0, 0.45, (9, 2)) @ sides).T
        N, _ = shape_functions(kind.element, X)
        others = np.setdiff1d(np.arange(len(N)), polygon)
        assert np.abs(N[others]).max() < 1e-15

        def terms(x: Array, start: Array = start, sides: Array = sides, count: int = len(polygon)) -> Array:
            r, s = np.linalg.lstsq(sides.T, x - start[:, None], rcond=None)[0]
            one = np.ones_like(r)
            by_count = {3: (one, r, s), 4: (one, r, s, r * s), 6: (one, r, s, r * s, r**2, s**2)}
            by_count[8] = (*by_count[6], r**2 * s, r * s**2)
            return np.stack(by_count[count])

        # the triangle's or the serendipity square's own functions, from their polynomials' values at the face's nodes
        assert np.abs(np.linalg.solve(terms(nodes.T), terms(X)) - N[polygon]).max() < 1e-13


@pytest.mark.parametrize("order", [1, 2])
def test_a_box_of_pyramids_has_the_volume_inertia_and_rigid_modes_of_the_box(box_mesh, order: int) -> None:
    fe = pyramid_box(box_mesh, 2, order)
    assert fe.discretisation.mesh.volume == pytest.approx(np.prod(SIZES), rel=1e-14)
    assert fe.mass == pytest.approx(2700 * np.prod(SIZES), rel=1e-13)
    # the functions span x, so that ∫ ρ x xᵀ dV is exact
    r = fe.x - np.array(SIZES) / 2
    second = fe.mass * np.diag(np.square(SIZES)) / 12
    assert np.abs(r.T @ (fe.m @ r) - second).max() < 1e-12 * second.max()
    stiffness = np.linalg.eigvalsh(fe.K.toarray()) / abs(fe.K).max()
    assert np.abs(stiffness[:6]).max() < 1e-13
    assert stiffness[6] > 1e-4


@pytest.mark.parametrize("order", [1, 2])
def test_crooked_pyramids_pass_the_patch_test(box_mesh, order: int) -> None:
    # inner points are moved, so that bases are warped
    fe = pyramid_box(box_mesh, 3, order, moved=0.2)
    exact = fe.x @ np.random.default_rng(1).standard_normal((3, 3))
    held = (np.isclose(fe.x, 0) | np.isclose(fe.x, SIZES)).any(axis=1).repeat(3)
    K, u = sp.csc_array(fe.K), exact.ravel().copy()
    u[~held] = spsolve(K[~held][:, ~held], -K[~held][:, held] @ u[held])
    assert np.abs(u - exact.ravel()).max() < 1e-12 * np.abs(exact).max()
    stress = modal_stress(fe.discretisation, MATERIAL, u.reshape(-1, 3, 1), np.arange(len(fe.x)))
    assert np.abs(stress - stress[0]).max() < 1e-10 * np.abs(stress).max()


def test_a_hanging_bar_of_quadratic_pyramids_stretches_as_it_should(box_mesh) -> None:
    # Timoshenko & Goodier, Theory of Elasticity, section 86: stress ρ g z alone, displacements of second degree
    fe, E, nu = pyramid_box(box_mesh, 2, 2), MATERIAL.E, MATERIAL.nu
    weight = MATERIAL.rho * 9.81
    x, y, z = (fe.x - [SIZES[0] / 2, SIZES[1] / 2, 0]).T
    exact = weight / E * np.stack([-nu * x * z, -nu * y * z, (z**2 + nu * (x**2 + y**2)) / 2], axis=1)
    held = np.isclose(z, SIZES[2]).repeat(3)
    K, u = sp.csc_array(fe.K), exact.ravel().copy()
    load = (fe.m @ np.tile([0, 0, -9.81], (len(fe.x), 1))).ravel()
    u[~held] = spsolve(K[~held][:, ~held], load[~held] - K[~held][:, held] @ u[held])
    assert np.abs(u - exact.ravel()).max() < 1e-11 * np.abs(exact).max()
    stress = modal_stress(fe.discretisation, MATERIAL, u.reshape(-1, 3, 1), np.arange(len(fe.x)))[..., 0]
    wanted = weight * z[:, None] * [0, 0, 1, 0, 0, 0]
    assert np.abs(stress - wanted).max() < 1e-9 * wanted.max()


@pytest.mark.parametrize(("order", "counts"), [(1, (3, 6)), (2, (2, 4))])
def test_lames_modes_of_a_cube_converge_at_the_elements_order(box_mesh, order: int, counts: tuple[int, int]) -> None:
    # u = (cos πx sin πy, −sin πx cos πy, 0) leaves a cube of side 1 free of traction: ω² = 2 μ/ρ π²
    exact = 2 * np.pi**2 * MATERIAL.lame[1] / MATERIAL.rho
    errors = []
    for n in counts:
        fe = pyramid_box(box_mesh, n, order, sizes=(1.0, 1.0, 1.0))
        M = sp.csc_array(sp.kron(fe.m, sp.eye_array(3)))
        values, shapes = eigsh(sp.csc_array(fe.K), 20, M, sigma=-0.01 * exact)
        x, y, _ = np.pi * fe.x.T
        lame = np.stack([np.cos(x) * np.sin(y), -np.sin(x) * np.cos(y), 0 * x], axis=1).ravel()
        errors.append(float(values[np.abs(lame @ M @ shapes).argmax()]) / exact - 1)
    assert np.log2(errors[0] / errors[1]) > 2 * order - 0.4


def test_a_box_of_pyramids_is_divided_into_connected_pieces(box_mesh) -> None:
    space: Discretisation = pyramid_box(box_mesh, 3, 1, sizes=(6.0, 1.0, 1.0)).discretisation
    labels = divide_mesh(space, 3)
    assert np.bincount(labels, space.volumes) == pytest.approx([2.0, 2.0, 2.0], rel=0.05)
