"""Enhanced strain of linear hexahedra: Simo and Rifai's own formulas, single elements, patches, and what it is for."""

from collections.abc import Callable
from itertools import permutations, product

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from fmd.core.arrays import Array
from fmd.fem.assembly import assemble
from fmd.fem.cells.hexahedron import Hexahedron
from fmd.fem.markers import face_marker
from fmd.fem.material import Material, MaterialOfElements
from fmd.fem.mesh import SolidMesh
from fmd.fem.space import Discretisation
from fmd.fem.strain import condensed_stiffness, strains, stresses
from fmd.meshes.bar import hexahedral_bar

METAL = Material(1.0, 0.3, 1.0)
RUBBER = Material(1.0, 0.4995, 1.0)
CUBE = np.array(list(product((0.0, 1.0), repeat=3)))[[0, 4, 6, 2, 1, 5, 7, 3]]
GAUSS = np.array(list(product((-1, 1), repeat=3))).T / np.sqrt(3)
VOIGT = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))  # Simo and Rifai's order


def elements_apart(x: Array, formulation: str = "enhanced") -> Discretisation:
    """Return elements with corners x (n, 8, 3) that share no node."""
    mesh = SolidMesh(x.reshape(-1, 3), np.arange(8 * len(x)).reshape(-1, 8), "hexahedron", {}, {})
    return Discretisation(mesh, 1, formulation)


def stiffness_of(x: Array, material: Material = METAL) -> Array:
    """Return the enhanced stiffness of elements in the order of the corners x, shape (n, 24, 24)."""
    space = elements_apart(x)
    K = np.empty((len(x), 8, 3, 8, 3))
    own = space.element_nodes - 8 * np.arange(len(x))[:, None]
    given = condensed_stiffness(space, material, np.arange(len(x))).reshape(K.shape)
    for k, local in enumerate(own):
        K[k][np.ix_(local, range(3), local, range(3))] = given[k]
    return K.reshape(-1, 24, 24)


@pytest.fixture(scope="module")
def crooked() -> Array:
    """A thousand distorted elements: cubes with moved corners, then stretched up to ten times, sheared and turned."""
    rng = np.random.default_rng(0)
    x = CUBE + rng.uniform(-0.28, 0.28, (3000, 8, 3))
    turn = np.linalg.qr(rng.standard_normal((3000, 3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))[:, None, None]
    shear = np.triu(rng.uniform(-0.4, 0.4, (3000, 3, 3)), 1) + np.eye(3)
    stretch = 10 ** rng.uniform(-0.5, 0.5, (3000, 1, 3))
    x = (x @ shear) * stretch @ turn
    x = x[Hexahedron.scaled_jacobian(x) > 0.05]
    assert len(x) >= 1000
    return x[:1000]


def simo_rifai(x: Array, material: Material, volumes: bool = False) -> Array:
    """Return one element's stiffness by Simo & Rifai (1990), eqs. 5.1-5.10: strains mapped by T₀, Voigt's vectors."""
    signs = 2 * CUBE - 1
    lam, mu = material.lame
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam

    def gradients_at(xi: Array) -> tuple[Array, Array]:
        factors = 1 + signs * xi
        dN = np.stack([signs[:, a] * np.delete(factors, a, axis=1).prod(axis=1) / 8 for a in range(3)], axis=1)
        J = x.T @ dN
        return dN @ np.linalg.inv(J), J

    _, J0 = gradients_at(np.zeros(3))
    F = np.linalg.inv(J0)
    T = np.zeros((6, 6))  # E = Fᵀ Ê F for the vectors of Voigt
    for column, (i, j) in enumerate(VOIGT):
        E = np.zeros((3, 3))
        E[i, j] = E[j, i] = 1.0 if i == j else 0.5
        mapped = F.T @ E @ F
        T[:, column] = [mapped[p, q] * (1 if p == q else 2) for p, q in VOIGT]
    n = 12 if volumes else 9
    K, Gamma, H = np.zeros((24, 24)), np.zeros((n, 24)), np.zeros((n, n))
    for xi in GAUSS.T:
        g, J = gradients_at(xi)
        det, M = np.linalg.det(J), np.zeros((6, 9))
        M[[0, 1, 2], [0, 1, 2]] = xi
        M[3, 3:5], M[4, 5:7], M[5, 7:9] = xi[[0, 1]], xi[[1, 2]], xi[[0, 2]]
        G = np.linalg.det(J0) / det * T @ M
        if volumes:
            volume = np.array([[1, 1, 1, 0, 0, 0]]).T * (xi * np.roll(xi, -1))
            G = np.concatenate([G, np.linalg.det(J0) / det * volume], axis=1)
        B = np.zeros((6, 8, 3))
        for row, (p, q) in enumerate(VOIGT):
            B[row, :, p] += g[:, q]
            if p != q:
                B[row, :, q] += g[:, p]
        B = B.reshape(6, 24)
        K += det * B.T @ C @ B
        Gamma += det * G.T @ C @ B
        H += det * G.T @ C @ G
    return K - Gamma.T @ np.linalg.solve(H, Gamma)


@pytest.mark.parametrize("material", [METAL, RUBBER], ids=["nine", "twelve"])
def test_the_stiffness_is_simo_and_rifais(crooked: Array, material: Material) -> None:
    found = stiffness_of(crooked[:40], material)
    for x, K in zip(crooked, found, strict=False):
        exact = simo_rifai(x, material, volumes=material is RUBBER)
        assert np.abs(K - exact).max() < 1e-11 * np.abs(exact).max()


# Single elements ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("material", [METAL, RUBBER], ids=["nine", "twelve"])
def test_a_thousand_elements_have_six_zeros_and_eighteen_stiffnesses(crooked: Array, material: Material) -> None:
    K = stiffness_of(crooked, material)
    assert np.array_equal(K, K.swapaxes(1, 2))
    values = np.linalg.eigvalsh(K)
    assert (np.abs(values[:, :6]) < 1e-12 * values[:, -1:]).all()
    assert (values[:, 6] > 1e-4 * values[:, -1] * (1 - 2 * material.nu)).all()


def test_a_thousand_elements_do_not_resist_rigid_motions(crooked: Array) -> None:
    K = stiffness_of(crooked)
    centred = crooked - crooked.mean(axis=1, keepdims=True)
    for e in np.eye(3):
        for field in (np.tile(e, (len(K), 8, 1)), np.cross(e, centred)):
            force = (K @ field.reshape(-1, 24, 1))[..., 0]
            assert (np.abs(force).max(axis=1) < 1e-12 * np.abs(K).max(axis=(1, 2)) * np.abs(field).max()).all()


@pytest.mark.parametrize("material", [METAL, RUBBER], ids=["nine", "twelve"])
def test_a_thousand_elements_take_constant_strain_exactly(crooked: Array, material: Material) -> None:
    """Pass the patch test element by element: a linear displacement has its own strain everywhere, and plain forces."""
    slope = np.random.default_rng(1).standard_normal((3, 3))
    u = (crooked @ slope.T).reshape(-1, 3, 1)
    X = np.random.default_rng(2).uniform(size=(3, 5))
    space, elements = elements_apart(crooked), np.arange(len(crooked))
    found = strains(space, material, u, X, elements)[..., 0]
    exact = (slope + slope.T)[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]] * ([0.5] * 3 + [1.0] * 3)
    assert np.abs(found - exact).max() < 1e-10
    forces = assemble(space.mesh, 1, material).K @ u.ravel()
    plain = assemble(space.mesh, 1, material, "plain").K @ u.ravel()
    assert np.abs(forces - plain).max() < 1e-11 * np.abs(plain).max()


def test_a_thousand_elements_are_softer_than_plain_ones(crooked: Array) -> None:
    # a minimum over more strains is no higher
    enhanced = stiffness_of(crooked[:200])
    mesh = elements_apart(crooked[:200]).mesh
    u = np.random.default_rng(3).standard_normal((200, 24, 30))
    plain = assemble(mesh, 1, METAL, "plain").K
    energies = np.einsum("eik,eij,ejk->ek", u, enhanced, u, optimize=True)
    stiffer = np.einsum("eik,eik->ek", u, (plain @ u.reshape(-1, 30)).reshape(u.shape))
    assert (energies < stiffer).all()


def test_turned_elements_and_renumbered_corners_have_the_same_stiffness(crooked: Array) -> None:
    x = crooked[:1]
    K = stiffness_of(x)[0].reshape(8, 3, 8, 3)
    turn = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    turned = stiffness_of(x @ turn.T)[0].reshape(8, 3, 8, 3)
    back = np.einsum("ai,nakb,bj->nikj", turn, turned, turn)
    assert np.abs(back - K).max() < 1e-12 * np.abs(K).max()
    order = {tuple(corner): k for k, corner in enumerate(CUBE.astype(int).tolist())}
    for axes in permutations(range(3)):
        for flips in product((0, 1), repeat=3):
            mapped = np.abs(CUBE[:, list(axes)] - flips).astype(int)
            corners = [order[tuple(corner)] for corner in mapped.tolist()]
            if np.linalg.det(mapped[[1, 3, 4]] - mapped[0]) > 0:
                again = stiffness_of(x[:, corners])[0].reshape(8, 3, 8, 3)
                assert np.abs(again - K[np.ix_(corners, range(3), corners, range(3))]).max() < 1e-12 * np.abs(K).max()


@pytest.mark.parametrize(
    ("nu", "formulation", "stiff"),
    [(0.49999, "enhanced", 1), (0.49999, "plain", 7), (0.49, "enhanced", 4)],
    ids=["twelve", "plain", "nine"],
)
def test_volume_locks_in_one_mode_of_an_incompressible_cube_only(nu: float, formulation: str, stiff: int) -> None:
    # Andelfinger & Ramm 1993: of a trilinear displacement's dilatation 1, ξ, η, ζ, ξη, ηζ, ζξ nine modes free the
    # linear terms, twelve all but the constant
    mesh = SolidMesh(CUBE.copy(), np.arange(8)[None], "hexahedron", {}, {})
    shear = Material(1.0, nu, 1.0).lame[1]
    values = np.linalg.eigvalsh(assemble(mesh, 1, Material(1.0, nu, 1.0), formulation).K.toarray())
    assert np.count_nonzero(values > 2.5 * shear) == stiff


# Bodies ------------------------------------------------------------------------------------------------------------


def test_a_thousand_elements_together_pass_the_patch_test(box_mesh: Callable[..., SolidMesh]) -> None:
    """Leave no force at the inner nodes of a distorted mesh under a linear displacement (Irons & Razzaque 1972)."""
    mesh = box_mesh("hexahedron", (10, 10, 10), (1.2, 1.0, 0.8), 0.2)
    fe = assemble(mesh, 1, METAL)
    inner = ((fe.x > 1e-9) & (fe.x < np.array([1.2, 1.0, 0.8]) - 1e-9)).all(axis=1)
    assert inner.sum() == 9**3
    u = fe.x @ np.random.default_rng(5).standard_normal((3, 3))
    force = (fe.K @ u.ravel()).reshape(-1, 3)
    assert np.abs(force[inner]).max() < 1e-13 * np.abs(force).max()


def test_each_element_has_the_modes_of_its_own_material(box_mesh: Callable[..., SolidMesh]) -> None:
    mesh = box_mesh("hexahedron", (3, 2, 2), distortion=0.2)
    numbers = np.arange(12) % 2
    mixed = MaterialOfElements((METAL, RUBBER), numbers)
    K = assemble(mesh, 1, mixed).K
    space, u = Discretisation(mesh, 1), np.random.default_rng(6).standard_normal((36, 3, 2))
    X = np.random.default_rng(7).uniform(size=(3, 3))
    found, forces = stresses(space, mixed, u, X, np.arange(12)), np.zeros((36, 3, 2))
    for k, material in enumerate((METAL, RUBBER)):
        mine = np.flatnonzero(numbers == k)
        for number, each in zip(mine, condensed_stiffness(space, material, mine), strict=True):
            nodes = space.element_nodes[number]
            forces[nodes] += (each @ u[nodes].reshape(24, 2)).reshape(8, 3, 2)
        assert np.array_equal(found[mine], stresses(space, material, u, X, mine))
    assert np.abs(K @ u.reshape(-1, 2) - forces.reshape(-1, 2)).max() < 1e-12 * np.abs(forces).max()


def test_the_energy_is_that_of_the_enhanced_strain(box_mesh: Callable[..., SolidMesh]) -> None:
    fe = assemble(box_mesh("hexahedron", (3, 2, 2), distortion=0.2), 1, METAL)
    space, u = fe.discretisation, np.random.default_rng(8).standard_normal((36, 3, 1))
    X, w = space.kind.quadrature(space.kind.stiffness_order)
    strain = strains(space, METAL, u, X, np.arange(12))[..., 0]
    energy = np.einsum("eqi,ij,eqj,eq,q", strain, METAL.stiffness, strain, np.abs(np.linalg.det(space.jacobians(X))), w)
    assert u.ravel() @ (fe.K @ u.ravel()) == pytest.approx(energy, rel=1e-12)


# Cantilevers -------------------------------------------------------------------------------------------------------

LENGTH, DEPTH = 10.0, 1.0


def straight(x: Array) -> Array:
    return x


def skewed(x: Array) -> Array:
    return x + np.outer(x[:, 1], [np.tan(np.pi / 6), 0, 0])


def twisted(x: Array) -> Array:
    angle = np.pi / 2 * x[:, 0] / LENGTH
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([x[:, 0], c * x[:, 1] - s * x[:, 2], s * x[:, 1] + c * x[:, 2]], axis=1)


def thin(x: Array) -> Array:
    return x * [1.0, 0.02, 1.0]


SHAPES = {"straight": straight, "skewed": skewed, "twisted": twisted, "thin": thin}


def compliance(shape: Callable[[Array], Array], divisions: tuple[int, int, int], order: int, formulation: str) -> float:
    """Return the deflection of a clamped bar's tip by a unit force along y over the end's face."""
    made = hexahedral_bar(LENGTH, DEPTH, DEPTH, divisions)
    mesh = SolidMesh(shape(np.array(made[0])), *made[1:])
    fe = assemble(mesh, order, METAL, formulation)
    ends = [face_marker(fe.discretisation, mesh.faces[name]) for name in ("x-", "x+")]
    f = np.zeros((len(fe.x), 3))
    f[ends[1].nodes, 1] = ends[1].translation_weights
    free = np.ones(f.shape, dtype=bool)
    free[ends[0].nodes] = False
    free = free.ravel()
    u = spsolve(sp.csc_array(fe.K)[free][:, free], f.ravel()[free])
    return float(f.ravel()[free] @ u)


@pytest.fixture(scope="module", params=list(SHAPES))
def cantilever(request: pytest.FixtureRequest) -> tuple[Callable[[Array], Array], float]:
    """A shape and its compliance by quadratic hexahedra."""
    shape = SHAPES[request.param]
    return shape, compliance(shape, (30, 3, 3), 2, "enhanced")


# Of the compliance by quadratic elements. The clamp holds the section's contraction, which skewed and thin bars notice.
WITHIN = {straight: (0.01, 0.005), skewed: (0.03, 0.005), twisted: (0.02, 0.005), thin: (0.08, 0.025)}


@pytest.mark.parametrize("layers", [1, 3])
def test_cantilevers_bend_as_they_should(cantilever: tuple[Callable[[Array], Array], float], layers: int) -> None:
    shape, exact = cantilever
    divisions = 10 * layers, layers, layers
    assert compliance(shape, divisions, 1, "enhanced") == pytest.approx(exact, rel=WITHIN[shape][layers > 1])
    assert compliance(shape, divisions, 1, "plain") < (0.66 if layers == 1 else 0.95) * exact


def test_a_straight_cantilever_has_the_compliance_of_beam_theory() -> None:
    # Timoshenko's beam with Cowper's shear factor; the clamp's grip of the section's contraction takes off 1.3 %
    inertia, shear = DEPTH**4 / 12, 10 * 1.3 / (12 + 11 * 0.3) / 2.6 * DEPTH**2
    exact = LENGTH**3 / (3 * inertia) + LENGTH / shear
    assert compliance(straight, (20, 2, 2), 1, "enhanced") == pytest.approx(exact, rel=0.02)
