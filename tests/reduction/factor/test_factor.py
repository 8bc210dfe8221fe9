"""Each solver gives the same answers, says what it takes, and refuses what doesn't fit."""

import ctypes
import gc
import tracemalloc
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from threadpoolctl import ThreadpoolController

from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.memory import BYTES_FOR_RESPONSES, SLENDER
from fmd.core.memory import available_memory
from fmd.fem.assembly import assemble
from fmd.fem.markers import face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.meshes.bar import hexahedral_bar, tetrahedral_bar
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.factor import factor, multifrontal, order
from fmd.reduction.factor.factor import MissingSolverError, TooLargeError, factor_nonzeros, factorise, predict_bytes
from fmd.reduction.factor.order import fill_reducing_order, node_graph

pytestmark = pytest.mark.slow

without_cvxopt = pytest.mark.skipif(find_spec("cvxopt") is None, reason="cvxopt is not installed")

SOLVERS = (pytest.param("cholesky", marks=without_cvxopt), "multifrontal")


@pytest.fixture(scope="module")
def tetrahedra(steel: Material) -> FEModel:
    return assemble(SolidMesh(*tetrahedral_bar(0.1, 0.09, 0.08, 0.024)), 2, steel)


@pytest.fixture(scope="module")
def hexahedra(steel: Material) -> FEModel:
    return assemble(SolidMesh(*hexahedral_bar(0.3, 0.02, 0.02, (28, 4, 4))), 2, steel)


def without(monkeypatch: pytest.MonkeyPatch, *missing: str) -> None:
    """Make as if packages weren't installed."""
    for module in (factor, order):
        monkeypatch.setattr(module, "find_spec", lambda name: None if name in missing else find_spec(name))


def positive(fe: FEModel) -> sp.csr_array:
    return sp.csr_array(fe.K + 1e6 * fe.M)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("missing", [(), ("pymetis",)])
def test_every_solver_in_every_order_solves(
    solver: factor.Solver, missing: tuple[str, ...], tetrahedra: FEModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    without(monkeypatch, *missing)
    monkeypatch.setattr(factor, "SMALL_SYSTEM", 0)
    A = positive(tetrahedra)
    u = np.random.default_rng(0).standard_normal((A.shape[0], 2))
    made = factorise(A, solver)
    assert made.figures.order == ("MMD" if missing else "METIS")
    for wanted in (u, u[:, 0]):
        assert np.abs(made.solve(A @ wanted) - wanted).max() < 1e-9


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("missing", [(), ("pymetis",)])
def test_modes_are_those_of_a_small_factor(
    solver: factor.Solver, missing: tuple[str, ...], tetrahedra: FEModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(factor, "SMALL_SYSTEM", tetrahedra.K.shape[0] + 1)
        small = FreeBodySolver(tetrahedra, factorise=partial(factorise)).modes(12)
    without(monkeypatch, *missing)
    other = FreeBodySolver(tetrahedra, factorise=partial(factorise, solver=solver)).modes(12)
    assert small.factor is not None
    assert small.factor.solver == "SuperLU"
    assert other.factor is not None
    assert other.factor.solver == {"cholesky": "CHOLMOD"}.get(solver, solver)
    assert other.omega == pytest.approx(small.omega, rel=1e-10)
    assert other.shapes == pytest.approx(small.shapes, abs=1e-8 * np.abs(small.shapes).max())


def test_large_matrices_take_fronts(tetrahedra: FEModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(factor, "SMALL_SYSTEM", 0)
    assert factorise(positive(tetrahedra)).figures.solver == "multifrontal"


@pytest.mark.parametrize("zeros", [0, 200, 100_000])
def test_fronts_solve_random_matrices_whatever_is_merged(zeros: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against NumPy: patterns of several roots and unknowns that nothing couples are among them."""
    monkeypatch.setattr(multifrontal, "FRONT_ZEROS", zeros)
    rng = np.random.default_rng(zeros)
    for n in (1, 2, 3, 30, 46, 91, 150, 201):
        half = np.where(rng.random((n, n)) < 2.0 / n, rng.standard_normal((n, n)), 0.0)
        A = half @ half.T + np.eye(n)
        made = factorise(sp.csr_array(A), "multifrontal")
        for shape in ((n,), (n, 1), (n, 5), (n, 19), (n, 0)):
            f = rng.standard_normal(shape)
            u = made.solve(f)
            assert u.shape == shape
            np.testing.assert_allclose(u, np.linalg.solve(A, f.reshape(n, -1)).reshape(shape), rtol=1e-9, atol=1e-11)


def test_fronts_take_entries_of_which_round_off_left_one_of_a_pair() -> None:
    """Against NumPy; a graph without both has no row for some in a front, which then writes beyond itself."""
    rng = np.random.default_rng(1)
    for n in (5, 30, 63, 100):
        half = np.where(rng.random((n, n)) < 1.5 / n, rng.standard_normal((n, n)), 0.0)
        A = half @ half.T + np.eye(n)
        stray = np.triu(np.where((A == 0.0) & (rng.random((n, n)) < 5.0 / n), 1e-18, 0.0))
        whole = node_graph(sp.csr_array(A + stray + stray.T))[0]
        f = rng.standard_normal(n)
        for B in (sp.csr_array(A + stray), sp.csr_array(A + stray.T)):
            assert (node_graph(B)[0] != whole).nnz == 0
            np.testing.assert_allclose(
                factorise(B, "multifrontal").solve(f), np.linalg.solve(A, f), rtol=1e-9, atol=1e-11
            )


@pytest.mark.parametrize(("n", "size"), [(30, 3), (30, 1), (31, 1), (3, 3), (1, 1)])
def test_nodes_are_coupled_that_any_of_their_unknowns_are(n: int, size: int) -> None:
    """Beside NumPy's blocks of dense entries, of both halves, of one of a pair, and of rows that aren't ascending."""
    rng = np.random.default_rng(n)
    for density in (0.0, 0.1, 0.3):
        nodes = (rng.random((n // size, n // size)) < density) | np.eye(n // size, dtype=bool)
        for pattern in (nodes, nodes | nodes.T):
            A = sp.csr_array(np.kron(pattern, np.ones((size, size))))
            for row in range(n):
                A.indices[A.indptr[row] : A.indptr[row + 1]] = rng.permutation(
                    A.indices[A.indptr[row] : A.indptr[row + 1]]
                )
            graph, found = node_graph(A)
            if density or size > 1:
                assert found == size
            coupled = A.toarray().reshape(n // found, found, n // found, found).any(axis=(1, 3))
            np.testing.assert_array_equal(graph.toarray() > 0, coupled | coupled.T)
            assert graph.nnz == np.count_nonzero(coupled | coupled.T)


def test_slender_bodies_alone_are_eliminated_from_their_ends(
    tetrahedra: FEModel, hexahedra: FEModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the operations of both orders: a column of k entries takes about k² of them."""
    pytest.importorskip("pymetis")

    def operations(fe: FEModel, slender: float) -> tuple[str, float]:
        monkeypatch.setattr(order, "SLENDER", slender)
        found = fill_reducing_order(*node_graph(fe.K))
        return found.name, float((multifrontal.elimination_tree(found.graph)[0] ** 2).sum())

    for fe, usual in ((tetrahedra, "METIS"), (hexahedra, "MMD")):
        names, counts = zip(*(operations(fe, slender) for slender in (SLENDER, 0.0, np.inf)), strict=True)
        assert names == (usual, "MMD", "METIS")
        assert counts[0] == min(counts) < max(counts)


@pytest.mark.parametrize("body", ["tetrahedra", "hexahedra"])
def test_corners_alone_are_ordered_and_fill_in_no_more(body: str, request: pytest.FixtureRequest) -> None:
    """Beside METIS' order of all nodes; each of the others comes before the first corner that has all its couplings."""
    pymetis = pytest.importorskip("pymetis")
    A = positive(request.getfixturevalue(body))
    graph, size = node_graph(A)
    found = fill_reducing_order(graph, size)
    assert len(found.ends) < 0.35 * graph.shape[0]
    others = sp.csr_array(graph - sp.eye_array(graph.shape[0], dtype=np.int8))
    others.eliminate_zeros()
    whole = np.array(pymetis.nested_dissection(pymetis.CSRAdjacency(others.indptr, others.indices))[0])
    nonzeros, all_nodes = (
        factor_nonzeros(multifrontal.elimination_tree(sp.csr_array(graph[own][:, own]))[0], 3)
        for own in (found.nodes, whole)
    )
    assert nonzeros < 1.1 * all_nodes
    for first, last in zip(np.append(0, found.ends[:-1] + 1), found.ends, strict=True):
        coupled = {int(last), *found.graph[[last]].indices}
        assert all(coupled >= {k, *found.graph[[k]].indices} for k in range(first, last))


def test_what_is_coupled_to_all_leaves_the_order_of_the_others(tetrahedra: FEModel) -> None:
    """A point that all stiffness hangs on would cover all nodes, and fill in six times as much."""
    A, n = positive(tetrahedra), tetrahedra.K.shape[0]
    arms = sp.csr_array(np.tile(np.eye(3), (n // 3, 1)))
    hub = sp.csr_array(sp.block_array([[A, -1e-3 * arms], [-1e-3 * arms.T, 1e6 * sp.eye_array(3)]]))
    alone, made = factorise(A, "multifrontal"), factorise(hub, "multifrontal")
    assert made.figures.nonzeros < 1.15 * alone.figures.nonzeros
    u = np.random.default_rng(0).standard_normal(n + 3)
    assert np.abs(made.solve(hub @ u) - u).max() < 1e-9


def test_unknowns_that_supports_have_shifted_fill_in_no_more(tetrahedra: FEModel) -> None:
    """Of three unknowns less, blocks of three would have parts of two nodes each, and twice as many nonzeros."""
    A = positive(tetrahedra)
    shifted = sp.csr_array(A[1:-2, 1:-2])
    made = factorise(shifted, "multifrontal")
    assert made.figures.nonzeros < 1.05 * factorise(A, "multifrontal").figures.nonzeros
    u = np.random.default_rng(0).standard_normal(shifted.shape[0])
    assert np.abs(made.solve(shifted @ u) - u).max() < 1e-9


def test_small_products_of_fronts_have_one_thread(tetrahedra: FEModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two, each waits for the other: a factor took six times as long."""
    solve, seen, pools = multifrontal.dtrsm, set(), ThreadpoolController().select(user_api="blas")

    def spy(*arguments: Any, **options: Any) -> Any:
        seen.update(pool.num_threads for pool in pools.lib_controllers)
        return solve(*arguments, **options)

    monkeypatch.setattr(multifrontal, "dtrsm", spy)
    with pools.limit(limits=2):
        factorise(positive(tetrahedra), "multifrontal")
        assert seen == {1}
        assert max(pool.num_threads for pool in pools.lib_controllers) == 2


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_factors_refuse_what_is_no_number(wrong: float) -> None:
    A = np.eye(9) + 0.1
    A[2, 7] = A[7, 2] = wrong
    for solver in ("auto", "multifrontal"):
        with pytest.raises(AccuracyError, match="2 entries of the stiffness are no finite numbers"):
            factorise(sp.csr_array(A), solver)


def test_fronts_refuse_singular_matrices_with_what_they_measured(tetrahedra: FEModel) -> None:
    """A stiffness without shift has pivots of round-off, of either sign; an unknown without stiffness has none."""
    refused = r"not positive definite: the factor ends at pivot \d+, which is -?\d\.\de.\d+ of a|singular to .* so thin"
    with pytest.raises(AccuracyError, match=refused):
        factorise(sp.csr_array(tetrahedra.K), "multifrontal")
    chain = 2.0 * np.eye(40) - np.eye(40, k=1) - np.eye(40, k=-1)
    chain[0, 0] = chain[-1, -1] = 1.0
    slightly = chain + np.diag(np.full(40, 4e-17)) + np.eye(40) * 1e-16
    with pytest.raises(AccuracyError, match=refused):
        factorise(sp.csr_array(slightly), "multifrontal")
    chain[:, 7] = chain[7] = 0.0
    with pytest.raises(AccuracyError, match=r"pivot \d+, which is 0\.0e\+00 of a diagonal of 0\.0e\+00"):
        factorise(sp.csr_array(chain + 1e-3 * np.diag(np.arange(40) != 7)), "multifrontal")


@without_cvxopt
def test_static_responses_and_rigid_faces_are_the_same(hexahedra: FEModel) -> None:
    marker = face_marker(hexahedra.discretisation, hexahedra.discretisation.mesh.faces["x-"], True)
    loads = np.random.default_rng(0).standard_normal((len(hexahedra.x), 3, 2))
    solvers: tuple[factor.Solver, ...] = ("cholesky", "multifrontal")
    u, v = (
        FreeBodySolver(hexahedra, [marker], factorise=partial(factorise, solver=solver)).static_response(loads)
        for solver in solvers
    )
    assert u == pytest.approx(v, abs=1e-8 * np.abs(v).max())


def test_cholesky_without_cvxopt_says_what_to_install(tetrahedra: FEModel, monkeypatch: pytest.MonkeyPatch) -> None:
    without(monkeypatch, "cvxopt")
    with pytest.raises(MissingSolverError, match="cvxopt, which brings CHOLMOD, is not installed: pip install cvxopt"):
        factorise(positive(tetrahedra), "cholesky")


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_matrix_that_is_not_positive_definite_is_refused(solver: factor.Solver, tetrahedra: FEModel) -> None:
    with pytest.raises(AccuracyError, match=r"not positive definite: (CHOLMOD stopped|the factor ends) at pivot \d+"):
        factorise(tetrahedra.K - 1e12 * tetrahedra.M, solver)


@pytest.mark.parametrize("missing", [(), ("pymetis",)])
@pytest.mark.parametrize("body", ["tetrahedra", "hexahedra", "small_bar"])
def test_the_predicted_nonzeros_are_those_of_a_factor(
    body: str, missing: tuple[str, ...], request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SuperLU's own count, which has each node's few zeros left out, is no more and at most 2 % less."""
    without(monkeypatch, *missing)
    monkeypatch.setattr(factor, "SMALL_SYSTEM", 0)
    A = positive(request.getfixturevalue(body))
    found = fill_reducing_order(*node_graph(A))
    assert found.size == 3
    nonzeros, places = factor_nonzeros(multifrontal.elimination_tree(found.graph)[0], 3), found.unknowns
    assert factorise(A).figures.nonzeros == nonzeros
    real = splu(
        sp.csc_array(A[places][:, places]), permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    assert 0.98 * nonzeros < real.L.nnz <= nonzeros


def test_a_graphs_factor_is_counted_as_by_elimination() -> None:
    """Eliminate a random graph's nodes one by one, joining each one's later neighbours."""
    n = 40
    pattern = np.random.default_rng(0).random((n, n)) < 0.06
    pattern = np.triu(pattern, 1) | np.triu(pattern, 1).T
    filled = pattern.copy()
    for k in range(n):
        later = np.flatnonzero(filled[k, k + 1 :]) + k + 1
        filled[np.ix_(later, later)] = True
    expected = n + np.count_nonzero(np.tril(filled, -1))
    counts, _ = multifrontal.elimination_tree(sp.csr_array(pattern.astype(float)))
    assert factor_nonzeros(counts) == expected
    # three unknowns a node: each entry a 3 × 3 block, those on the diagonal lower triangles
    assert factor_nonzeros(counts, 3) == 9 * expected - 3 * n


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_memory_of_a_factor_is_predicted_within_a_third(solver: factor.Solver, hexahedra: FEModel) -> None:
    """By the growth of this process."""
    statm, trim = Path("/proc/self/statm"), getattr(ctypes.CDLL(None), "malloc_trim", None)
    if not statm.exists() or trim is None:
        pytest.skip("the memory of a process is read from /proc, and trimmed by glibc")

    def resident() -> int:
        trim(0)  # else a factor takes what other tests have left, and the process doesn't grow
        return 4096 * int(statm.read_text().split()[1])

    A = positive(assemble(SolidMesh(*hexahedral_bar(0.3, 0.1, 0.1, (15, 5, 5))), 2, hexahedra.material))
    factorise(A, solver).solve(np.ones(A.shape[0]))  # what is loaded and made once
    gc.collect()
    kept, sizes = [], [resident()]
    for _ in range(3):
        kept.append(factorise(A, solver))
        sizes.append(resident())
    grown = np.median(np.diff(sizes))  # what other tests have left may go meanwhile
    assert 0.67 < kept[0].figures.memory / grown < 1.5


@pytest.mark.parametrize("body", ["tetrahedra", "hexahedra"])
def test_fronts_take_no_more_at_their_peak_than_was_looked_for(
    body: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By tracemalloc, which counts NumPy's arrays; METIS' own are not counted."""
    needed = []
    monkeypatch.setattr(factor, "_refuse_too_large", lambda figures, beside: needed.append(figures.memory + beside))
    A = positive(request.getfixturevalue(body))
    factorise(A, "multifrontal")  # what is loaded and compiled once
    tracemalloc.start()
    kept = factorise(A, "multifrontal")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert kept.figures.memory < peak < needed[0] < 1.5 * peak


@pytest.mark.parametrize("body", ["tetrahedra", "hexahedra"])
def test_a_search_for_modes_takes_at_its_peak_what_was_predicted(
    body: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By tracemalloc, mesh and matrices included."""
    monkeypatch.setattr(factor, "SMALL_SYSTEM", 0)
    fe = request.getfixturevalue(body)
    FreeBodySolver(fe).modes(10)  # what is loaded and compiled once
    tracemalloc.start()
    again = assemble(fe.discretisation.mesh, 2, fe.material)
    FreeBodySolver(again).modes(10)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.8 < predict_bytes(again.discretisation.element_nodes, 10) / peak < 1.3


def test_static_responses_take_no_more_at_their_peak_than_was_looked_for(hexahedra: FEModel) -> None:
    solver, f = FreeBodySolver(hexahedra), np.random.default_rng(0).standard_normal((*hexahedra.x.shape, 8))
    solver.static_response(f[:, :, :2])  # what is kept whatever the loads
    tracemalloc.start()
    solver.remembered_response(f)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.8 * peak < BYTES_FOR_RESPONSES * f.size < 1.3 * peak


def test_what_does_not_fit_is_refused_before_it_is_factorised(
    tetrahedra: FEModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(factor, "SMALL_SYSTEM", 0)
    monkeypatch.setattr(factor, "available_memory", lambda: 8e6)
    monkeypatch.setattr(multifrontal, "factorise_fronts", lambda *_: pytest.fail("was factorised"))
    needs = r"the factor of its \d+ unknowns needs about [\d.]+ GB of memory \(multifrontal, METIS order, [\d.e+]+ non"
    with pytest.raises(
        TooLargeError, match=needs + r"zeros\), the machine has 0.008 GB to spare; make the mesh coarser"
    ):
        factorise(positive(tetrahedra))


def test_memory_is_the_least_of_what_machine_and_container_leave(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("psutil.virtual_memory", lambda: SimpleNamespace(available=8e9))
    container = tmp_path / "container"
    assert available_memory(container) == 8e9
    container.mkdir()
    (container / "memory.max").write_text("3000000000\n")
    (container / "memory.current").write_text("1500000000\n")
    (container / "memory.stat").write_text("anon 1000000000\nactive_file 200000000\ninactive_file 300000000\n")
    assert available_memory(container) == 2e9  # pages of files make room
    (container / "memory.max").write_text("max\n")
    assert available_memory(container) == 8e9


def test_memory_is_read_from_control_groups_of_version_1_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("psutil.virtual_memory", lambda: SimpleNamespace(available=8e9))
    group = tmp_path / "memory"
    group.mkdir()
    (group / "memory.limit_in_bytes").write_text("4000000000\n")
    (group / "memory.usage_in_bytes").write_text("3000000000\n")
    (group / "memory.stat").write_text("cache 0\ntotal_active_file 100000000\ntotal_inactive_file 400000000\n")
    assert available_memory(tmp_path) == 1.5e9


def test_this_machine_has_memory_to_spare() -> None:
    assert 1e8 < available_memory() < 1e14


def test_a_scene_whose_factor_does_not_fit_ends_in_a_message(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from fmd import Pipeline, load_scene
    from fmd.core.cache import Cache

    monkeypatch.setattr(factor, "available_memory", lambda: 1e6)
    small = ["body.beam.modes.solver='multifrontal'", "body.beam.mesh.divisions=[12,2,1]"]
    scene = load_scene("beam-paper", small)
    needs = r"body\.beam\.mesh: the factor of its \d+ unknowns needs about .* make the mesh"
    with pytest.raises(InputError, match=needs):
        Pipeline(scene, Cache(tmp_path)).modes  # noqa: B018
    monkeypatch.undo()
    run = Pipeline(load_scene("beam-paper", [*small, "body.beam.modes.enrich='inertia'"]), Cache(tmp_path))
    run.modes  # noqa: B018
    monkeypatch.setattr(factor, "available_memory", lambda: 1e4)
    needs = r"body\.beam\.mesh: the static responses of its \d+ unknowns to \d+ loads need"
    with pytest.raises(InputError, match=needs):
        run.body  # noqa: B018
