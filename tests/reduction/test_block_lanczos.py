"""Lanczos' method with blocks finds what matrices have by construction: pairs and more, bases that end, none lost."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.fem.assembly import assemble
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.meshes.bar import hexahedral_bar
from fmd.reduction import block_lanczos, eigen
from fmd.reduction.block_lanczos import largest_pairs
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.factor.factor import Factor, factorise
from fmd.reduction.missed_modes import missed_eigenvalue

by_fronts = partial(factorise, solver="multifrontal")


@pytest.fixture(scope="module")
def square_bar(steel: Material) -> FEModel:
    """A bar of square section: each bending frequency is a pair."""
    return assemble(SolidMesh(*hexahedral_bar(0.2, 0.02, 0.02, (8, 2, 2))), 2, steel)


@pytest.mark.parametrize("seed", range(40))
def test_the_largest_are_found_with_all_of_their_multiplicity(seed: int) -> None:
    """By construction: K = C Q λ Qᵀ Cᵀ of M = C Cᵀ; equal eigenvalues are as many as a block has vectors."""
    rng = np.random.default_rng(seed)
    n, known, block = int(rng.integers(12, 150)), int(rng.integers(0, 7)), int(rng.choice([2, 4, 8]))
    count = int(rng.integers(1, max(2, (n - known) // 2)))
    values = np.sort(np.exp(rng.uniform(0.0, 8.0, n)))
    if seed % 2:
        values[known : known + block] = values[known]
    mass = np.diag(rng.random(n) + 0.1)
    C, Q = np.sqrt(mass), np.linalg.qr(rng.standard_normal((n, n)))[0]
    modes = np.linalg.solve(C, Q)
    inverse = modes @ (modes / values).T
    size = max(2 * count, count + 6 * block)
    start = rng.standard_normal((n, block))
    theta, Phi, near = largest_pairs(lambda f: inverse @ f, sp.csr_array(mass), modes[:, :known], count, size, start)
    assert theta == pytest.approx(1.0 / values[known : known + count], rel=1e-12)
    assert np.abs(Phi.T @ mass @ Phi - np.eye(count)).max() < 1e-11
    assert np.abs(modes[:, :known].T @ mass @ Phi).max(initial=0.0) < 1e-11
    answers = inverse @ mass @ near  # further ones that have nearly converged
    defects = np.linalg.norm(np.sqrt(mass) @ (answers - near * np.einsum("ij,ij->j", mass @ near, answers)), axis=0)
    assert (defects < 2e-6 * np.einsum("ij,ij->j", mass @ near, answers)).all()


@pytest.mark.parametrize("rank", [3, 12, 30])
def test_bodies_with_few_masses_have_as_many_modes(rank: int) -> None:
    """Against LAPACK; the check misses what is left out, and nothing else."""
    rng = np.random.default_rng(rank)
    half, mass = rng.standard_normal((120, 120)), np.zeros(120)
    mass[:rank] = rng.random(rank) + 0.5
    K, M = half @ half.T + 5.0 * np.eye(120), sp.csr_array(np.diag(mass))
    inverse, none = np.linalg.inv(K), np.zeros((120, 0))
    exact = 1.0 / np.sort(eigh(np.diag(mass), K, eigvals_only=True))[::-1]
    for count in (2, rank, rank + 4):
        start = rng.standard_normal((120, 8))
        theta, Phi, _ = largest_pairs(lambda f: inverse @ f, M, none, count, count + 48, start)
        assert 1.0 / theta == pytest.approx(exact[: min(count, rank)], rel=1e-11)
        known, highest = np.delete(Phi, 1, axis=1), 1.0 / theta[-1]
        assert missed_eigenvalue(M, Phi, lambda f: inverse @ f, 0.0, highest, 8) is None
        if count > 2:
            found = missed_eigenvalue(M, known, lambda f: inverse @ f, 0.0, highest, 8)
            assert exact[1] * (1.0 - 1e-9) < found < highest  # type: ignore[operator]


def test_what_does_not_converge_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(block_lanczos, "BLOCK_RESTARTS", 2)
    inverse, start = np.diag(1.0 - 1e-9 * np.arange(200.0)), np.random.default_rng(0).standard_normal((200, 2))
    with pytest.raises(AccuracyError, match=r"\d of 4 modes have converged after 2 restarts of Lanczos' method"):
        largest_pairs(lambda f: inverse @ f, sp.eye_array(200, format="csr"), np.zeros((200, 0)), 4, 8, start)


def test_modes_are_those_of_single_vectors(square_bar: FEModel) -> None:
    single, told = FreeBodySolver(square_bar).modes(20), list[float]()
    solver = FreeBodySolver(square_bar, factorise=by_fronts)
    with solver.telling(told.append):
        found = solver.modes(20)
    assert found.omega == pytest.approx(single.omega, rel=1e-11)
    assert told[0] == 0.0
    assert 0.0 < told[1] < 0.2
    assert told == sorted(told)


@pytest.mark.parametrize("lost", [0, 6, 12])
def test_a_mode_that_blocks_lose_is_found(lost: int, square_bar: FEModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave one of fifteen modes out (the last two are a pair), and the same of those that are found after them."""
    tries = []

    def forgetful(inverse: object, M: object, Z: Array, count: int, *others: object) -> tuple[Array, ...]:
        tries.append(count)
        theta, Phi, near = largest_pairs(inverse, M, Z, count + 1, *others)  # type: ignore[arg-type]
        return np.delete(theta, lost), np.delete(Phi, lost, axis=1), near

    expected = FreeBodySolver(square_bar).modes(14).omega
    monkeypatch.setattr(eigen, "largest_pairs", forgetful)
    solver = FreeBodySolver(square_bar, factorise=by_fronts)
    if lost:
        assert solver.modes(14).omega == pytest.approx(expected, rel=1e-11)
        assert tries == [14, 14]
    else:
        with pytest.raises(AccuracyError, match=r"Lanczos missed a mode at [\d.]+ Hz, below its highest, 3 times"):
            solver.modes(14)


@pytest.mark.parametrize("block", [1, 2, 4, 8])
def test_prongs_on_a_held_base_have_each_mode_as_often_as_they_are(block: int, steel: Material) -> None:
    """Twelve of them: a start of fewer vectors has no more of a mode than these, nor has a check that starts alike."""
    n = 12
    points, cells = hexahedral_bar(0.02 * (2 * n + 1), 0.04, 0.01, (2 * n + 1, 3, 1))[:2]
    x, y, _ = (points[cells].mean(axis=1) - points.min(axis=0)).T
    used, cells = np.unique(cells[(y < 0.013) | ((x / 0.02).astype(int) % 2 == 1)], return_inverse=True)
    fe = assemble(SolidMesh(points[used], cells.reshape(-1, 8), "hexahedron", {}, {}), 2, steel)
    held = np.flatnonzero(fe.x[:, 1] < points[:, 1].min() + 0.014)

    def factorised(A: sp.csr_array) -> Factor:
        return replace(by_fronts(A), at_once=block)

    solver = FreeBodySolver(fe, fixed=(3 * held[:, None] + np.arange(3)).ravel(), factorise=factorised)
    for count in (10, 12, 13):
        omega = solver.modes(count).omega
        assert omega[:12] == pytest.approx(omega[0], rel=1e-9)
        assert (omega[12:] > 1.1 * omega[0]).all()
