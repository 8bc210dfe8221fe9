"""The modes of a free body: complete, accurate, independent of units; refused when they fail their checks."""

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh, null_space
from scipy.sparse.linalg import splu

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.fem.assembly import assemble
from fmd.fem.markers import face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.meshes.bar import hexahedral_bar
from fmd.reduction import eigen, inertia_relief
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.factor import factor
from fmd.reduction.factor.factor import TooLargeError
from fmd.reduction.loads import motion_loads
from fmd.reduction.mode_families import classify_modes, lowest_modes
from fmd.reduction.modes import TooManyModesError

Z = np.array([0.0, 0.0, 1.0])


def bar(
    sizes: tuple[float, float, float], divisions: tuple[int, int, int], material: Material, order: int = 2
) -> FEModel:
    return assemble(SolidMesh(*hexahedral_bar(*sizes, divisions)), order, material)


def submesh(mesh: SolidMesh, keep: Array) -> SolidMesh:
    """Mesh of the cells to keep, with no points left over."""
    used, cells = np.unique(mesh.cells[keep], return_inverse=True)
    number = np.full(len(mesh.points), -1)
    number[used] = np.arange(len(used))
    faces = {name: number[points[number[points] >= 0]] for name, points in mesh.faces.items()}
    return SolidMesh(mesh.points[used], cells.reshape(-1, mesh.cells.shape[1]), mesh.cell_type, {}, faces)


def modes_below(fe: FEModel, omega: float) -> int:
    """Count the modes below ω [rad/s], rigid-body modes included, by Sylvester's law of inertia.

    The negative pivots of ``K − ω² M`` are as many as the eigenvalues below ω²; no iteration is behind them.
    """
    A = sp.csc_array(fe.K - omega**2 * fe.M)
    factor = splu(A, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    assert np.array_equal(factor.perm_r, factor.perm_c)  # else the pivots don't show the inertia
    return int(np.count_nonzero(factor.U.diagonal() < 0))


@pytest.fixture(scope="module")
def square_bar(steel: Material) -> FEModel:
    """A bar of square section: each bending frequency is a pair."""
    return bar((0.2, 0.02, 0.02), (8, 2, 2), steel)


@pytest.fixture(scope="module")
def slender_bar(steel: Material) -> FEModel:
    """A bar forty times as long as deep."""
    return bar((0.8, 0.02, 0.01), (40, 2, 2), steel)


def test_all_modes_equal_those_of_a_dense_solver(small_bar: FEModel) -> None:
    pairs = FreeBodySolver(small_bar).modes(20)
    dense = eigh(small_bar.K.toarray(), small_bar.M.toarray(), eigvals_only=True)
    assert np.count_nonzero(dense < 1e-6 * dense[6]) == pairs.n_rigid == 6
    assert pairs.omega**2 == pytest.approx(dense[6:26], rel=1e-9)


def test_modes_are_orthonormal_and_in_balance(small_bar: FEModel) -> None:
    K, M = small_bar.K, small_bar.M
    pairs = FreeBodySolver(small_bar).modes(20)
    Phi = pairs.shapes.reshape(K.shape[0], -1)
    assert np.abs(Phi.T @ M @ Phi - np.eye(20)).max() < 1e-9
    assert np.abs(small_bar.rigid_modes.T @ (M @ Phi)).max() < 1e-9 * np.sqrt(small_bar.mass)
    inertia = pairs.omega**2 * (M @ Phi)
    residual = np.linalg.norm(K @ Phi - inertia, axis=0) / np.linalg.norm(inertia, axis=0)
    assert residual.max() < 1e-8
    assert pairs.residual < 1e-9


def test_a_seventh_of_a_small_meshs_modes_come_from_all_at_once(square_bar: FEModel) -> None:
    """Round-off is what is left of them; Lanczos' method leaves 1e-11 and more, and takes twice as long."""
    pairs = FreeBodySolver(square_bar).modes(square_bar.K.shape[0] // 7)
    assert pairs.residual < 5e-12


def test_modes_come_out_the_same_each_time(small_bar: FEModel) -> None:
    once, again = (FreeBodySolver(small_bar).modes(8) for _ in range(2))
    assert np.array_equal(once.omega, again.omega)
    assert np.array_equal(once.shapes, again.shapes)


def test_the_largest_component_of_a_mode_is_positive(small_bar: FEModel) -> None:
    shapes = FreeBodySolver(small_bar).modes(8).shapes.reshape(-1, 8)
    assert (shapes[np.abs(shapes).argmax(axis=0), range(8)] > 0).all()


@pytest.mark.parametrize("body", ["small_bar", "square_bar"])
def test_no_mode_is_skipped(body: str, request: pytest.FixtureRequest) -> None:
    """Sylvester's count of the modes below a frequency equals the number found, between all neighbours."""
    fe = request.getfixturevalue(body)
    omega = FreeBodySolver(fe).modes(14).omega
    apart = np.flatnonzero(np.diff(omega) > 1e-4 * omega[1:])
    assert len(apart) >= 6
    for k in apart:
        assert modes_below(fe, (omega[k] + omega[k + 1]) / 2) == 6 + k + 1
    assert modes_below(fe, omega[0] / 2) == 6


def test_pairs_of_equal_frequency_come_back_complete(square_bar: FEModel) -> None:
    pairs = FreeBodySolver(square_bar).modes(14)
    families, _ = classify_modes(square_bar, pairs, Z)
    across = {name: pairs.omega[[f == name for f in families]] for name in ("in-plane bending", "out-of-plane bending")}
    n = min(map(len, across.values()))
    assert n >= 3
    assert across["in-plane bending"][:n] == pytest.approx(across["out-of-plane bending"][:n], rel=1e-9)


@pytest.mark.parametrize("joined", [False, True])
def test_more_modes_are_sought_beside_known_ones(
    joined: bool, slender_bar: FEModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All at once, they are the same, constrained by a joint or not."""
    face = face_marker(slender_bar.discretisation, slender_bar.discretisation.mesh.faces["x-"])
    B = face.columns(len(slender_bar.x), np.eye(3)) if joined else None
    solver = FreeBodySolver(slender_bar)
    few, many = solver.modes(9, B), solver.modes(16, B)
    sought: list[int] = []
    lanczos = solver._block_lanczos
    monkeypatch.setattr(
        solver, "_block_lanczos", lambda count, *given: (sought.append(count), lanczos(count, *given))[1]
    )
    found = solver.modes(16, B, few)
    assert solver.modes(9, B, few) is few
    assert sought == [7]
    assert found.n_rigid == many.n_rigid
    assert found.omega**2 == pytest.approx(many.omega**2, rel=1e-11)
    signs = np.sign(np.einsum("iak,iak->k", found.shapes, many.shapes))  # two places of a symmetric bar move most
    np.testing.assert_allclose(signs * found.shapes, many.shapes, atol=1e-7 * np.abs(many.shapes).max())
    assert np.array_equal(found.shapes[:, :, :9], few.shapes)


def test_two_unconnected_pieces_are_refused(box_mesh: Callable[..., SolidMesh], steel: Material) -> None:
    box = box_mesh("hexahedron", (5, 1, 1))
    with pytest.raises(
        AccuracyError, match="the mesh is in 2 unconnected pieces, so it has 12 rigid-body modes instead of 6; join"
    ):
        FreeBodySolver(assemble(submesh(box, [True, True, False, True, True]), 1, steel))


def test_a_lumped_mass_leaves_the_body_in_one_piece(small_bar: FEModel) -> None:
    own = small_bar.m.diagonal()  # Hinton, Rock & Zienkiewicz: in proportion to the consistent diagonal
    lumped = replace(small_bar, m=sp.diags_array(own * (small_bar.mass / own.sum())).tocsr())
    pairs = FreeBodySolver(lumped).modes(4)
    dense = eigh(lumped.K.toarray(), lumped.M.toarray(), eigvals_only=True)
    assert pairs.n_rigid == 6
    assert pairs.omega**2 == pytest.approx(dense[6:10], rel=1e-9)
    assert pairs.omega[0] == pytest.approx(FreeBodySolver(small_bar).modes(1).omega[0], rel=0.05)


@pytest.mark.parametrize(("corner", "n_rigid"), [((1, 1, 0), 7), ((1, 1, 1), 9)])
def test_a_body_with_a_hinge_in_it_is_refused(
    corner: tuple[int, int, int], n_rigid: int, box_mesh: Callable[..., SolidMesh], steel: Material
) -> None:
    # Two cubes that share an edge turn about it, two that share a corner about all three axes.
    box = box_mesh("hexahedron", (2, 2, 2))
    place = np.floor(box.points[box.cells].mean(axis=1) * 2).astype(int)
    keep = (place == 0).all(axis=1) | (place == corner).all(axis=1)
    with pytest.raises(AccuracyError, match=f"found {n_rigid} rigid-body modes, a free body has 6"):
        FreeBodySolver(assemble(submesh(box, keep), 2, steel)).modes(6)


def test_the_shift_is_negative_and_below_the_lowest_elastic_eigenvalue(small_bar: FEModel) -> None:
    solver = FreeBodySolver(small_bar)
    lowest = solver.modes(1).omega[0] ** 2
    # Rayleigh and Ritz: a bound from above. Constant curvature, which is among the fields, is near a bent bar's own.
    assert lowest < solver.bound < 2 * lowest
    assert -lowest < solver.shift < 0


@pytest.mark.parametrize("softer", [1e-6, 1e6])
def test_frequencies_go_with_the_root_of_youngs_modulus(small_bar: FEModel, steel: Material, softer: float) -> None:
    other = bar((0.3, 0.04, 0.02), (7, 2, 1), Material(steel.E * softer, steel.nu, steel.rho))
    solver, reference = FreeBodySolver(other), FreeBodySolver(small_bar)
    assert solver.shift == pytest.approx(softer * reference.shift, rel=1e-9)
    assert solver.modes(8).omega == pytest.approx(np.sqrt(softer) * reference.modes(8).omega, rel=1e-9)


def test_frequencies_do_not_depend_on_the_units(small_bar: FEModel, steel: Material) -> None:
    # millimetre, tonne, second: E in MPa, density in t/mm³
    other = bar((300.0, 40.0, 20.0), (7, 2, 1), Material(steel.E * 1e-6, steel.nu, steel.rho * 1e-12))
    assert FreeBodySolver(other).modes(8).omega == pytest.approx(FreeBodySolver(small_bar).modes(8).omega, rel=1e-9)


def test_frequencies_do_not_depend_on_place_and_direction(small_bar: FEModel, steel: Material) -> None:
    mesh = small_bar.discretisation.mesh
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = SolidMesh(mesh.points @ turn.T + [3.0, -2.0, 1.0], mesh.cells.copy(), mesh.cell_type, {}, {})
    solver = FreeBodySolver(assemble(moved, 2, steel))
    assert solver.modes(8).omega == pytest.approx(FreeBodySolver(small_bar).modes(8).omega, rel=1e-8)


@pytest.fixture(scope="module")
def single_element(steel: Material) -> FEModel:
    """One hex8: 24 unknowns, of which 6 are rigid motions."""
    return bar((0.1, 0.1, 0.1), (1, 1, 1), steel, order=1)


@pytest.mark.parametrize("count", [1, 10, 16, 17, 18, 30])
def test_a_single_element_gives_all_the_modes_that_it_has(count: int, single_element: FEModel) -> None:
    pairs = FreeBodySolver(single_element).modes(count)
    n = min(count, 18)
    assert pairs.shapes.shape == (8, 3, n)
    dense = eigh(single_element.K.toarray(), single_element.M.toarray(), eigvals_only=True)
    assert pairs.omega**2 == pytest.approx(dense[6 : 6 + n], rel=1e-9)


def test_modes_that_the_mesh_does_not_have_are_refused(single_element: FEModel) -> None:
    solver = FreeBodySolver(single_element)
    assert lowest_modes(solver, 18).numbers == tuple(range(1, 19))
    with pytest.raises(
        TooManyModesError, match="at most 18 modes can be computed of this mesh; take fewer, or refine it"
    ):
        lowest_modes(solver, 19)


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        ("LARGEST_RESIDUAL", r"mode \d+ at [\d.]+ Hz has a residual of \d\.\de-\d\d, above 1e-18"),
        ("LARGEST_OVERLAP", r"modes are not M-orthonormal: error \d\.\de-\d\d exceeds 1e-18"),
    ],
)
def test_modes_beyond_a_limit_are_refused_with_the_figure(
    limit: str, message: str, small_bar: FEModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(eigen, limit, 1e-18)  # below round-off
    monkeypatch.setattr(eigen, "OF_ROUND_OFF", 0.0)
    with pytest.raises(AccuracyError, match=message):
        FreeBodySolver(small_bar).modes(4)


def test_round_off_of_thin_elements_is_no_wrong_mode(steel: Material) -> None:
    """K φ of a strip is round-off beside the stiffness of its elements: the frequencies are a beam's all the same."""
    strip = bar((0.3, 0.2e-3, 0.01), (10, 1, 1), steel)
    pairs = FreeBodySolver(strip).modes(2)
    assert pairs.residual > eigen.LARGEST_RESIDUAL
    exact = np.array([4.730041, 7.853205]) ** 2 * np.sqrt(steel.E * 0.2e-3**2 / (12 * steel.rho)) / 0.3**2
    np.testing.assert_allclose(pairs.omega[:2], exact, rtol=0.03)


def test_a_slender_bar_on_a_hinge_has_its_modes(steel: Material) -> None:
    """With a shift a tenth as large rigid motions leave a residual of 5e-4, which is refused."""
    strip = bar((0.312, 0.007, 6e-4), (13, 1, 1), steel)
    end, B = strip.x[:, 0] == strip.x[:, 0].min(), np.zeros((len(strip.x), 3, 5))
    B[end] = strip.rigid_modes.reshape(-1, 3, 6)[end][..., :5]  # which leaves rotations about z, across the bar's width
    pairs = FreeBodySolver(strip).modes(7, B)
    assert pairs.n_rigid == 1
    N = null_space(B.reshape(-1, 5).T)
    exact = eigh(N.T @ strip.K @ N, N.T @ strip.M @ N, eigvals_only=True)[1:8]
    np.testing.assert_allclose(pairs.omega**2, exact, rtol=1e-3)  # round-off of this is 2e-4 of the lowest


def test_round_off_of_a_thin_bar_that_is_held_at_a_face_is_no_wrong_mode(steel: Material) -> None:
    thickness = 1e-3  # leaves 5e-5 or so, 50 times the limit
    strip = bar((1.0, 0.06, thickness), (40, 4, 1), steel)
    face = face_marker(strip.discretisation, strip.discretisation.mesh.faces["x-"])
    pairs = FreeBodySolver(strip).modes(4, face.columns(len(strip.x), np.eye(3)))
    assert pairs.residual > eigen.LARGEST_RESIDUAL
    assert pairs.omega[0] == pytest.approx(3.516 * np.sqrt(steel.E * thickness**2 / (12 * steel.rho)), rel=0.03)


@pytest.mark.parametrize("thickness", [1e-4, 5e-5])
def test_elements_too_thin_for_double_precision_are_refused_with_the_reason(steel: Material, thickness: float) -> None:
    with pytest.raises(AccuracyError, match=r"; round-off alone leaves .*, since elements are so thin"):
        FreeBodySolver(bar((0.3, thickness, 0.01), (10, 1, 1), steel)).modes(2)


def test_a_wrong_mode_is_named_with_its_frequency(small_bar: FEModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """Spoil the third elastic mode on its way out of Lanczos: the message has to name it."""
    found = FreeBodySolver(small_bar).modes(4)

    def spoilt(*args: object, **options: object) -> tuple[Array, Array]:
        values, vectors = lanczos(*args, **options)
        order = np.argsort(values)
        values, vectors = values[order], vectors[:, order]
        values[2] *= 1.0001
        return values, vectors

    lanczos = eigen.eigsh
    monkeypatch.setattr(eigen, "eigsh", spoilt)
    wrong = 1.0001 * found.omega[2] ** 2
    # r = K φ − λ' M φ = (λ − λ') M φ and (K − σ M)⁻¹ M φ = φ / (λ − σ): r weighs 1e-4 λ / √((λ − σ)(λ' − σ))
    solver = FreeBodySolver(small_bar)
    residual = 1e-4 * found.omega[2] ** 2 / np.sqrt((found.omega[2] ** 2 - solver.shift) * (wrong - solver.shift))
    message = f"mode 3 at {np.sqrt(wrong) / (2 * np.pi):.6g} Hz has a residual of {residual:.1e}, above 1e-06"
    with pytest.raises(AccuracyError, match=message):
        solver.modes(4)


def test_a_mode_that_lanczos_loses_always_is_noticed(square_bar: FEModel, monkeypatch: pytest.MonkeyPatch) -> None:
    def forgetful(A: object, k: int, *args: object, **options: object) -> tuple[Array, Array]:
        values, vectors = lanczos(A, k + 1, *args, **options)
        order = np.argsort(values)[1:]
        return values[order], vectors[:, order]

    lanczos = eigen.eigsh
    monkeypatch.setattr(eigen, "eigsh", forgetful)
    with pytest.raises(AccuracyError, match=r"Lanczos missed a mode at [\d.]+ Hz, below its highest, 3 times"):
        FreeBodySolver(square_bar).modes(14)


@pytest.mark.parametrize("lost", [0, 6, 12])
def test_a_second_search_finds_what_the_first_has_missed(
    lost: int, square_bar: FEModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Leave one of fifteen modes out (the last two are a pair): nothing in the others gives it away."""
    expected = FreeBodySolver(square_bar).modes(14).omega
    tries = []

    def forgetful_once(A: object, k: int, *args: object, **options: object) -> tuple[Array, Array]:
        tries.append(k)
        values, vectors = lanczos(A, k + 1, *args, **options)
        order = np.delete(np.argsort(values), lost if len(tries) == 1 else k)
        return values[order], vectors[:, order]

    lanczos = eigen.eigsh
    monkeypatch.setattr(eigen, "eigsh", forgetful_once)
    assert FreeBodySolver(square_bar).modes(14).omega == pytest.approx(expected, rel=1e-12)
    assert tries == [14, 14]


@pytest.fixture(scope="module")
def pulled(small_bar: FEModel) -> Array:
    """Unit tension on both ends, a self-balanced load, (n_nodes, 3, 1)."""
    loads = np.zeros((len(small_bar.x), 3, 1))
    for face, sign in (("x-", -1.0), ("x+", 1.0)):
        marker = face_marker(small_bar.discretisation, small_bar.discretisation.mesh.faces[face])
        loads[marker.nodes, 0, 0] += sign * marker.translation_weights
    return loads


def test_a_static_response_is_that_of_a_pulled_bar(small_bar: FEModel, steel: Material, pulled: Array) -> None:
    # uniform stress F/A: the ends move apart by F L / (E A), the sides come in by ν times as much per length
    u = FreeBodySolver(small_bar).static_response(pulled)[..., 0]
    strain = 1.0 / (steel.E * 0.04 * 0.02)
    centre = small_bar.m.sum(axis=0) @ small_bar.x / small_bar.mass
    exact = strain * (small_bar.x - centre) * [1, -steel.nu, -steel.nu]
    assert np.abs(u - exact).max() < 1e-10 * np.abs(exact).max()


def test_a_static_response_is_in_balance_and_free_of_rigid_motion(small_bar: FEModel) -> None:
    f = np.random.default_rng(0).standard_normal((len(small_bar.x), 3, 3))
    u = FreeBodySolver(small_bar).static_response(f).reshape(-1, 3)
    R, M = small_bar.rigid_modes, small_bar.M
    flat = f.reshape(-1, 3)
    # what is left of the load once the mass has taken up the rigid acceleration that the load causes
    balanced = flat - M @ R @ np.linalg.solve(R.T @ M @ R, R.T @ flat)
    assert np.abs(R.T @ balanced).max() < 1e-10
    assert np.linalg.norm(small_bar.K @ u - balanced, axis=0).max() < 1e-8 * np.linalg.norm(balanced, axis=0).min()
    assert np.abs(R.T @ (M @ u)).max() < 1e-10 * np.abs(M @ u).sum()


def test_static_responses_and_modes_say_how_far_they_are(small_bar: FEModel) -> None:
    solver, answers, modes = FreeBodySolver(small_bar), list[float](), list[float]()
    with solver.telling(answers.append):
        solver.static_response(np.random.default_rng(1).standard_normal((*small_bar.x.shape, 3)))
        with solver.telling(modes.append):
            solver.modes(8)
    solver.modes(4)  # after which nobody asks
    assert answers[0] == modes[0] == 0.0
    assert 0.0 < answers[1] < 0.9
    assert answers[-1] == max(answers) > 0.9
    assert 0.0 < modes[1] < 0.1
    assert len(modes) > 20
    assert modes == sorted(modes)
    assert 0.3 < modes[-1] <= 1.0  # a restart more or less


def test_loads_are_answered_once(small_bar: FEModel, monkeypatch: pytest.MonkeyPatch) -> None:
    f = np.random.default_rng(2).standard_normal((*small_bar.x.shape, 5))
    f[0, 0, 1] = 0.0
    solver, solved = FreeBodySolver(small_bar), list[int]()
    every = solver.static_response(f)
    places = {f[..., k].tobytes(): k for k in range(5)}

    def answer(loads: Array) -> Array:
        solved.append(loads.shape[2])
        return every[:, :, [places[loads[..., k].tobytes()] for k in range(loads.shape[2])]]

    monkeypatch.setattr(solver, "static_response", answer)
    assert np.array_equal(solver.remembered_response(f[..., [0, 1, 2, 1]]), every[..., [0, 1, 2, 1]])
    f[0, 0, 1] = -0.0
    assert np.array_equal(solver.remembered_response(f), every)
    assert solver.remembered_response(f[..., :0]).shape == (*small_bar.x.shape, 0)
    assert solved == [3, 2]


def test_responses_that_do_not_fit_are_refused_before_they_are_solved_for(
    small_bar: FEModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    solver, f = FreeBodySolver(small_bar), np.ones((*small_bar.x.shape, 4)) * np.arange(4.0)
    solver.remembered_response(f[..., :2])
    monkeypatch.setattr(factor, "available_memory", lambda: 2e3)
    solver.remembered_response(f[..., :2])  # which it has
    monkeypatch.setattr(solver, "static_response", lambda _: pytest.fail("was solved"))
    needs = r"responses of its \d+ unknowns to 2 loads need about [\d.e-]+ GB of memory, the machine has 2e-06 GB"
    with pytest.raises(TooLargeError, match=needs):
        solver.remembered_response(f)


def test_a_search_that_does_not_fit_is_refused_before_it_begins(
    small_bar: FEModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    solver = FreeBodySolver(small_bar)
    monkeypatch.setattr(factor, "available_memory", lambda: 2e3)
    monkeypatch.setattr(solver, "_lanczos", lambda *_: pytest.fail("was searched"))
    needs = r"search for 5 modes of its \d+ unknowns needs about [\d.e-]+ GB of memory, .*, or take fewer modes"
    with pytest.raises(TooLargeError, match=needs):
        solver.modes(5)


@pytest.mark.parametrize(("count", "at_once"), [(60, 1), (10, 8)])
def test_the_memory_of_a_search_is_foreseen(
    slender_bar: FEModel, count: int, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # tracemalloc counts what NumPy allocates.
    made = partial(factor.factorise, solver="multifrontal") if at_once > 1 else factor.factorise
    solver = FreeBodySolver(slender_bar, factorise=made)
    foreseen: list[float] = []
    monkeypatch.setattr(factor, "refuse_too_large", lambda needed, *_, **__: foreseen.append(needed))
    tracemalloc.start()
    solver.modes(count)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert 0.5 * foreseen[0] < peak < foreseen[0]


def test_alike_loads_share_their_search_and_answer_each_alone(small_bar: FEModel) -> None:
    # each column by itself is the independent path: a search along one direction at a time
    f = np.random.default_rng(3).standard_normal((len(small_bar.x), 3, 6))
    f[..., 4], f[..., 5] = f[..., 0] - 2.0 * f[..., 1], 0.0  # of others, and none
    f[..., 3] = f[..., 2] * (1.0 + 1e-13)
    solver = FreeBodySolver(small_bar)
    together = solver.static_response(f)
    alone = np.concatenate([solver.static_response(f[..., [k]]) for k in range(5)], axis=2)
    assert np.abs(together[..., :5] - alone).max() < 1e-9 * np.abs(alone).max()
    assert not together[..., 5].any()


def test_a_static_response_is_found_for_a_body_with_a_slender_neck(steel: Material) -> None:
    # Its lowest frequency is far below that of any quadratic field, by which the shift is chosen.
    grid = SolidMesh(*hexahedral_bar(1.2, 0.4, 0.4, (12, 4, 4)))
    x, y, z = np.abs(grid.points[grid.cells].mean(axis=1) - [0.6, 0.0, 0.0]).T
    dumbbell = assemble(submesh(grid, (x > 0.2) | ((y < 0.1) & (z < 0.1))), 1, steel)
    marker = face_marker(dumbbell.discretisation, dumbbell.discretisation.mesh.faces["x-"])
    loads = motion_loads(dumbbell, marker, Z)
    u = FreeBodySolver(dumbbell).static_response(loads).reshape(-1, 4)
    R, M = dumbbell.rigid_modes, dumbbell.M
    flat = loads.reshape(-1, 4)
    balanced = flat - M @ R @ np.linalg.solve(R.T @ M @ R, R.T @ flat)
    defect = np.linalg.norm(dumbbell.K @ u - balanced, axis=0) / np.linalg.norm(balanced, axis=0)
    assert defect.max() < 1e-8


def test_a_static_response_beyond_its_limit_is_refused_with_the_figure(
    small_bar: FEModel, pulled: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inertia_relief, "STATIC_RESIDUAL", 1e-18)
    monkeypatch.setattr(inertia_relief, "OF_ROUND_OFF", 0.0)
    loads = np.concatenate([pulled, 2 * pulled], axis=2)
    with pytest.raises(AccuracyError, match=r"static response \d: residual \d\.\de-\d\d exceeds 1e-18"):
        FreeBodySolver(small_bar).static_response(loads)


def bent_at_three_points(thickness: float, steel: Material) -> tuple[float, float]:
    """How far a strip's middle is pushed from the line of its ends, and what a beam's would be [m]."""
    strip = bar((0.3, thickness, 0.01), (10, 1, 1), steel)
    of_end = [np.isclose(strip.x[:, 0], x) for x in (strip.x[:, 0].min(), strip.x[:, 0].max())]
    middle = np.isclose(strip.x[:, 0], strip.x[:, 0].mean())
    f = np.zeros((len(strip.x), 3, 1))
    for nodes, force in ((of_end[0], 0.5), (of_end[1], 0.5), (middle, -1.0)):
        f[nodes, 1] = force / nodes.sum()
    u = FreeBodySolver(strip).static_response(f)[:, 1, 0]
    beam = 0.3**3 / (48 * steel.E * 0.01 * thickness**3 / 12)
    return float(0.5 * (u[of_end[0]].mean() + u[of_end[1]].mean()) - u[middle].mean()), beam


def test_round_off_of_thin_elements_is_no_wrong_static_response(
    steel: Material, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inertia_relief, "STATIC_RESIDUAL", 1e-15)
    found, beam = bent_at_three_points(3e-5, steel)
    assert found == pytest.approx(beam, rel=0.02)
    monkeypatch.setattr(inertia_relief, "OF_ROUND_OFF", 0.0)
    with pytest.raises(AccuracyError, match=r"residual .* exceeds 1e-15"):
        bent_at_three_points(3e-5, steel)


def test_static_responses_beyond_double_precision_are_refused_with_the_reason(steel: Material) -> None:
    with pytest.raises(AccuracyError, match=r"response 0: round-off is larger .*, since elements are so thin"):
        bent_at_three_points(3e-6, steel)


def test_a_response_whose_energy_round_off_makes_negative_is_refused() -> None:
    K, opposed = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([[1.0], [-1.0]])
    with pytest.raises(AccuracyError, match="static response 0: round-off is larger than the response"):
        inertia_relief.solve_balanced(K, np.eye(2), np.ones((2, 1)), lambda loads: -loads, opposed)
    assert inertia_relief.flexibility_at(K, np.eye(2), np.ones((2, 1)), lambda loads: -loads, opposed) is None
    with (
        pytest.raises(AccuracyError, match="static response 0: residual"),
        np.errstate(all="ignore"),
    ):  # beyond any number
        inertia_relief.solve_balanced(1e300 * K, np.eye(2), np.ones((2, 1)), lambda loads: 1e9 * loads, opposed)


def test_a_long_bar_bends_as_euler_and_bernoulli_say(slender_bar: FEModel, steel: Material) -> None:
    # ω = (βL)² √(EI/ρA) / L² with βL = 4.730041, 7.853205 (free–free). Shear and rotary inertia, left out of it,
    # take (βL)²/2 (1/12 + E/12κG) (d/L)² off, roughly: 0.3 % and 0.8 % at L/d = 40.
    pairs = FreeBodySolver(slender_bar).modes(12)
    families, _ = classify_modes(slender_bar, pairs, Z)
    found = pairs.omega[[family == "in-plane bending" for family in families]]
    exact = np.array([4.730041, 7.853205]) ** 2 * np.sqrt(steel.E * 0.02**2 / (12 * steel.rho)) / 0.8**2
    assert found[0] == pytest.approx(exact[0], rel=0.004)
    assert found[1] == pytest.approx(exact[1], rel=0.01)
    assert (found[:2] < exact).all()


def test_a_long_bar_bends_as_timoshenko_says(
    slender_bar: FEModel, steel: Material, timoshenko: Callable[..., Any]
) -> None:
    pairs = FreeBodySolver(slender_bar).modes(16)
    families, _ = classify_modes(slender_bar, pairs, Z)
    for family, depth, width in (("in-plane bending", 0.02, 0.01), ("out-of-plane bending", 0.01, 0.02)):
        found = pairs.omega[[f == family for f in families]][:3] / (2 * np.pi)
        assert found == pytest.approx(timoshenko(0.8, depth, width, steel).frequencies_hz(3), rel=1e-3)


def test_a_long_bar_rings_lengthwise_at_half_its_wave_transit_rate(slender_bar: FEModel, steel: Material) -> None:
    # f = n c / 2L with c = √(E/ρ); lateral inertia takes (ν n π r / L)²/2 off, r the polar radius of gyration (Love)
    pairs = FreeBodySolver(slender_bar).modes(30)
    families, _ = classify_modes(slender_bar, pairs, Z)
    found = pairs.omega[[family == "axial" for family in families]] / (2 * np.pi)
    assert len(found) >= 2
    n, speed, gyration = np.array([1, 2]), np.sqrt(steel.E / steel.rho), np.sqrt((0.02**2 + 0.01**2) / 12)
    love = 1 - (steel.nu * n * np.pi * gyration / 0.8) ** 2 / 2
    assert found[:2] == pytest.approx(n * speed / (2 * 0.8) * love, rel=1e-5)
