"""RBE2 and RBE3 of a deck on the matrices that come before them: dense algebra, and what hangs on turning arms."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh, null_space

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.rotations import rigid_motions
from fmd.fem.formats.matrices import read_matrices
from fmd.fem.formats.matrix_model import MatrixModel
from fmd.reduction.eigen import FreeBodySolver
from tests.fem.formats.test_nastran_matrices import SI, deck, op4
from tests.fem.formats.test_six_unknowns import frame, lumped

HUB = np.array([0.1, 0.05, 0.2])  # a grid point without beams, number 17


def given(path: Path, *cards: str, M: Array | None = None) -> tuple[MatrixModel, Array, Array, Array]:
    """Return the model of a frame and of its hub, and positions and matrices of both."""
    x, K, _ = frame()
    x = np.concatenate([x, HUB[None]])
    masses = lumped(x) if M is None else M
    whole = np.zeros((len(x) * 6, len(x) * 6))
    whole[:-6, :-6] = K
    (path / "a.bdf").write_text(deck(x, np.arange(1, 18), *cards))
    (path / "a.op4").write_bytes(op4({"KGG": whole, "MGG": masses}, "two", True))
    return read_matrices(path / "a.op4", path / "a.op4", path / "a.bdf", SI, 6), x, whole, masses


def constrained(K: Array, M: Array, rows: Array) -> Array:
    """Return ω of the lowest elastic modes with constraints ``rows y = 0``."""
    N = null_space(rows)
    return np.sqrt(np.abs(eigh(N.T @ K @ N, N.T @ M @ N, eigvals_only=True)[6:12]))


@pytest.mark.parametrize("tied", ["123456", "123"])
def test_rigid_elements_are_those_of_dense_algebra(tmp_path: Path, tied: str) -> None:
    nodes = [3, 8, 12]
    model, x, K, M = given(tmp_path, f"RBE2,50,17,{tied},{','.join(str(k + 1) for k in nodes)}")
    rows = np.zeros((len(tied) * len(nodes), len(K)))
    for k, node in enumerate(nodes):
        six = np.eye(6)
        six[:3] = rigid_motions((x[node] - HUB)[None])[0]
        own = slice(len(tied) * k, len(tied) * (k + 1))
        rows[own, 6 * node : 6 * node + len(tied)] = np.eye(len(tied))
        rows[own, -6:] = -six[: len(tied)]
    assert FreeBodySolver(model).modes(6).omega == pytest.approx(constrained(K, M, rows), rel=1e-7)


def test_an_average_element_is_that_of_dense_algebra(tmp_path: Path) -> None:
    nodes, weights = np.array([3, 8, 12, 14]), np.array([1.0, 1.0, 2.0, 2.0])
    card = "RBE3,50,,17,123456,1.,123,4,9\n+,2.,123,13,15"
    model, x, K, M = given(tmp_path, card)
    S = rigid_motions(x[nodes] - HUB)
    normal = np.einsum("k,kai,kaj->ij", weights, S, S)
    rows = np.zeros((6, len(K)))
    for k, node in enumerate(nodes):
        rows[:, 6 * node : 6 * node + 3] = np.linalg.solve(normal, weights[k] * S[k].T)
    rows[:, -6:] = -np.eye(6)
    assert FreeBodySolver(model).modes(6).omega == pytest.approx(constrained(K, M, rows), rel=1e-7)


def test_a_mass_on_an_arm_moves_in_second_order_as_one_beside_its_node(tmp_path: Path) -> None:
    """The hub hangs on node 9 by RBE2; the same mass on node 9 itself, with its centre at the hub."""
    x, _, _ = frame()
    J, mass = np.diag([1e-3, 2e-3, 2.5e-3]), 0.7
    masses = np.zeros((17 * 6, 17 * 6))
    masses[:-6, :-6] = lumped(x)
    hung, beside = masses.copy(), masses.copy()
    hung[-6:-3, -6:-3], hung[-3:, -3:] = mass * np.eye(3), J
    arm = rigid_motions((HUB - x[8])[None])[0]
    beside[48:54, 48:54] += mass * arm.T @ arm
    beside[51:54, 51:54] += J
    found = []
    for M in (hung, beside):
        model, *_ = given(tmp_path, "RBE2,50,9,123456,17", M=M)
        pairs = FreeBodySolver(model).modes(6)
        assert model.arms is not None
        forces = (model.M @ model.x.reshape(-1)).reshape(-1, 3, 1)  # as the body turns
        found.append((pairs.omega, np.abs(np.linalg.eigvalsh(model.arms.stiffness(forces, pairs.shapes)[0]))))
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-7)
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-5, abs=1e-7 * found[1][1].max())


@pytest.mark.parametrize(
    ("cards", "message"),
    [
        (("RBE2,50,17,123456,4,9", "RBE2,51,9,123456,2"), "RBE2 51 hangs on a point that another link moves"),
        (("RBE2,50,17,123456,4,9", "RBE2,51,2,123456,9"), "a node is moved by two links"),
        (("RBE2,50,17,123456,4,9,13", "MPC,1,4,1,1.,9,1,-1."), "MPC 1 isn't in KGG, which comes before it"),
        (("RBE3,50,,17,123,1.,123,4,9\n+,13",), "RBE3 50 doesn't turn its point"),
        (("RBE1,50,17,123456",), "RBE1 isn't in KGG, which comes before it"),
    ],
)
def test_links_that_are_not_read_with_matrices_are_refused_by_card(
    tmp_path: Path, cards: tuple[str, ...], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        given(tmp_path, *cards)
