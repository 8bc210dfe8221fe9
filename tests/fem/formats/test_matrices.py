"""Matrices of other programs: every form is read, and what isn't a free body is refused."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from scipy.linalg import eigh

from fmd.core.errors import AccuracyError, InputError
from fmd.fem.formats.matrices import node_marker, nodes_in_plane, read_matrices
from fmd.fem.formats.matrix_model import MatrixModel
from fmd.fem.formats.matrix_readers import read_rows
from fmd.fem.markers import face_marker
from fmd.fem.model import FEModel

UNITS = (1.0, 1.0, 1.0)


@pytest.fixture
def files(small_bar: FEModel, tmp_path: Path) -> tuple[Path, Path, Path]:
    K, M, nodes = tmp_path / "K.npz", tmp_path / "M.npz", tmp_path / "nodes.csv"
    sp.save_npz(K, sp.csr_array(small_bar.K))
    sp.save_npz(M, sp.csr_array(small_bar.M))
    n = len(small_bar.x)
    np.savetxt(nodes, np.c_[10 + 2 * np.arange(n), small_bar.x], delimiter=",", header="node, x, y, z", comments="")
    return K, M, nodes


@pytest.fixture
def model(files: tuple[Path, Path, Path]) -> MatrixModel:
    return read_matrices(*files, UNITS)


def test_matrices_and_positions_come_back(model: MatrixModel, small_bar: FEModel) -> None:
    assert abs(model.K - small_bar.K).max() < 1e-14 * abs(small_bar.K).max()
    assert abs(model.m - small_bar.m).max() < 1e-14 * abs(small_bar.m).max()
    assert np.abs(model.x - small_bar.x).max() < 1e-15
    assert model.labels[:3].tolist() == [10, 12, 14]


@pytest.mark.parametrize("half", [False, True])
def test_text_forms_give_the_same_matrix(
    files: tuple[Path, Path, Path], small_bar: FEModel, half: bool, tmp_path: Path
) -> None:
    K = small_bar.K
    scipy.io.mmwrite(tmp_path / "K.mtx", K, symmetry="symmetric" if half else "general")
    entries = sp.coo_array(sp.tril(K) if half else K)
    rows = zip(*entries.coords, entries.data.tolist(), strict=True)
    lines = (f"{10 + 2 * (i // 3)},{i % 3 + 1}, {10 + 2 * (j // 3)},{j % 3 + 1}, {value!r}\n" for i, j, value in rows)
    (tmp_path / "K.inp").write_text("** MATRIX\n" + "".join(lines))
    for name in ("K.mtx", "K.inp"):
        read = read_matrices(tmp_path / name, *files[1:], UNITS)
        assert abs(read.K - K).max() < 1e-12 * abs(K).max()


@pytest.mark.parametrize(("matrix", "half"), [("K", None), ("K", sp.tril), ("K", sp.triu), ("M", sp.tril)])
def test_rows_and_columns_of_abaqus_coordinate_format_give_the_same_matrix(
    files: tuple[Path, Path, Path], small_bar: FEModel, half: Callable[[Any], Any] | None, matrix: str, tmp_path: Path
) -> None:
    whole = getattr(small_bar, matrix)
    entries = sp.coo_array(half(whole) if half else whole)
    rows = zip(*entries.coords, entries.data.tolist(), strict=True)
    lines = [f"{i + 1:10d} {j + 1:10d} {value:24.16e}\n".replace("e", "D") for i, j, value in rows]
    (tmp_path / "matrix.mtx").write_text("".join(lines))
    given = (tmp_path / "matrix.mtx", *files[1:]) if matrix == "K" else (files[0], tmp_path / "matrix.mtx", files[2])
    read = getattr(read_matrices(*given, UNITS), matrix)
    assert abs(read - whole).max() < 1e-14 * abs(whole).max()


def test_lines_that_do_not_fit_their_format_are_named(files: tuple[Path, Path, Path], small_bar: FEModel) -> None:
    K, n = files[0].with_suffix(".mtx"), len(small_bar.x)
    for text, message in (
        ("1 1 2.0\n1 2\n", "line 2 isn't row, column, value"),
        ("1 1 2.0\n1,1,1,1,2.0\n", "line 2 isn't row, column, value"),
        (f"1 {3 * n + 1} 2.0\n", f"line 1 has row 1 and column {3 * n + 1}, and {n} nodes have {3 * n} displacements"),
        ("10,1,10,1,2.0\n10,1,10\n", "line 2 isn't node, direction, node, direction, value"),
        ("10,4,10,1,2.0\n", "directions are 1 to 3; line 1 has 4 and 1; with rotations say matrices.unknowns = 6"),
        ("10,1,11,1,2.0\n", "line 1 names node 11, which isn't among the nodes"),
    ):
        K.write_text(text)
        with pytest.raises(InputError, match=message):
            read_matrices(K, *files[1:], UNITS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("% none\n\n% at all\n", "three whole numbers, come after its head; nothing is there"),
        ("inf 1 1\n1 1 2.0\n", "three whole numbers, come after its head; 'inf 1 1' is there"),
        ("2.7 2 1\n1 1 2.0\n", "three whole numbers, come after its head; '2.7 2 1' is there"),
        ("2 2\n1 1 2.0\n", "three whole numbers, come after its head; '2 2' is there"),
        ("2 -2 1\n1 1 2.0\n", "three whole numbers, come after its head; '2 -2 1' is there"),
        ("% a\n2 2 2\n1 1 2.0\n\n1 2\n", "line 6 isn't row, column, value: '1 2'"),
        ("2 2 2\n1 1 2.0 % a\n1 2 x\n", "line 4 isn't row, column, value: '1 2 x'"),
        ("2 2 2\n1 1 2.0\n", "its sizes speak of 2 entries, and 1 are there"),
        ("2 2 0\n1 1 2.0\n", "its sizes speak of 0 entries, and 1 are there"),
        ("2 3 2\n1 1 2.0\n1.5 1 2.0\n", "entry 2 has row 1.5 and column 1; whole numbers from 1 to 2 and from 1 to 3"),
        ("2 2 1\ninf nan 2.0\n", "entry 1 has row inf and column nan; whole numbers from 1 to 2"),
        ("2 2 1\n0 1 2.0\n", "entry 1 has row 0 and column 1; whole numbers from 1 to 2"),
        ("999999999 2 1\n1 1 2.0\n", "it has 999999999 rows and 2 columns, over"),
    ],
)
def test_what_is_wrong_with_a_matrix_market_file_is_said_by_line_or_entry(
    text: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / "odd.mtx").write_text(f"%%MatrixMarket matrix coordinate real general\n{text}")
    with pytest.raises(InputError) as caught:
        read_rows(tmp_path / "odd.mtx")
    assert message in str(caught.value)


def test_a_matrix_market_file_without_entries_is_a_matrix_of_zeros(tmp_path: Path) -> None:
    (tmp_path / "zeros.mtx").write_text("%%MatrixMarket matrix coordinate real symmetric\n% a\n 2  3 0 % b\n")
    found = read_rows(tmp_path / "zeros.mtx")
    assert (found.shape, found.nnz) == ((2, 3), 0)


def test_units_are_those_of_the_files(files: tuple[Path, Path, Path], small_bar: FEModel) -> None:
    model = read_matrices(*files, (1e3, 1e3, 1e9))  # a bar of a kilometre for each metre, of the same material
    assert model.mass == pytest.approx(1e9 * small_bar.mass, rel=1e-12)
    assert abs(model.K - 1e3 * small_bar.K).max() < 1e-12 * abs(model.K).max()
    assert model.x == pytest.approx(1e3 * small_bar.x)


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ((1e-3, 1.0, 1.0), r"in a cube of 0\.3 mm would be .* kg/m³, and no matter is so dense"),
        ((1.0, 1e3, 1.0), r"sound would run through the body at about \S+ km/s, and in no matter it is so fast"),
        ((1.0, 1.0, 1e-3), r"sound would run through the body at about \S+ km/s, and in no matter it is so fast"),
    ],
)
def test_units_that_no_matter_has_are_refused(
    files: tuple[Path, Path, Path], units: tuple[float, float, float], message: str
) -> None:
    with pytest.raises(AccuracyError, match=message):
        read_matrices(*files, units)


def test_half_a_matrix_in_another_order_of_the_nodes_is_a_half(
    files: tuple[Path, Path, Path], small_bar: FEModel, tmp_path: Path
) -> None:
    n = len(small_bar.x)
    order = np.random.default_rng(1).permutation(n)  # of the nodes in the other program's triangle
    place = np.argsort(order)
    entries = sp.coo_array(small_bar.K)
    lines = [
        f"{10 + 2 * (i // 3)},{i % 3 + 1},{10 + 2 * (j // 3)},{j % 3 + 1},{value!r}\n"
        for i, j, value in zip(*entries.coords, entries.data.tolist(), strict=True)
        if (place[i // 3], i % 3) >= (place[j // 3], j % 3)
    ]
    (tmp_path / "K.inp").write_text("".join(lines))
    read = read_matrices(tmp_path / "K.inp", *files[1:], UNITS)
    assert abs(read.K - small_bar.K).max() < 1e-12 * abs(small_bar.K).max()


def test_a_weak_spring_to_the_ground_and_too_few_digits_are_refused(
    files: tuple[Path, Path, Path], small_bar: FEModel
) -> None:
    """Both are far below the elements' own forces, and shift the lowest frequencies all the same."""
    n, K = len(small_bar.x), sp.csr_array(small_bar.K)
    spring = sp.dia_array((np.r_[np.zeros(3 * n - 1), 1e-6 * K.diagonal().max()][None], [0]), shape=K.shape)
    sp.save_npz(files[0], sp.csr_array(K + 30 * spring))
    with pytest.raises(
        AccuracyError, match=r"the body isn't free: \w+ \w+ \w as a whole it has \S+ % of the stiffness"
    ):
        read_matrices(*files, UNITS)
    rounded = sp.csr_array(sp.tril(K))
    rounded.data = np.array([float(f"{value:.3e}") for value in rounded.data])
    sp.save_npz(files[0], sp.csr_array(rounded + sp.tril(rounded, -1).T))
    with pytest.raises(AccuracyError, match="the body isn't free"):
        read_matrices(*files, UNITS)


def test_a_negative_mass_is_named(files: tuple[Path, Path, Path], small_bar: FEModel) -> None:
    sp.save_npz(files[1], sp.csr_array(-small_bar.M))
    with pytest.raises(AccuracyError, match=r"no mass matrix: node \d+ has -\S+ kg on the diagonal"):
        read_matrices(*files, UNITS)


def test_what_is_no_free_body_is_refused_with_the_figure(files: tuple[Path, Path, Path], small_bar: FEModel) -> None:
    K, M, _ = files
    held = sp.lil_array(small_bar.K)
    held[0, 0] *= 2
    sp.save_npz(K, sp.csr_array(held))
    with pytest.raises(AccuracyError, match=r"the body isn't free: moved along x as a whole it answers with"):
        read_matrices(*files, UNITS)
    held[0, 5] = 1e9 * held[0, 0]
    sp.save_npz(K, sp.csr_array(held))
    with pytest.raises(AccuracyError, match="the matrix isn't symmetric"):
        read_matrices(*files, UNITS)
    sp.save_npz(K, sp.csr_array(small_bar.K))
    lopsided = sp.csr_array(small_bar.M * np.tile([1.0, 1.0, 2.0], len(small_bar.x)))
    sp.save_npz(M, sp.csr_array(0.5 * (lopsided + lopsided.T)))
    with pytest.raises(AccuracyError, match="masses depend on the direction"):
        read_matrices(*files, UNITS)


def test_files_that_do_not_fit_are_refused(files: tuple[Path, Path, Path]) -> None:
    K, M, nodes = files
    lines = nodes.read_text().splitlines(keepends=True)
    nodes.write_text("".join(lines[:-1]))
    with pytest.raises(InputError, match=r"nodes have \d+ displacements"):
        read_matrices(K, M, nodes, UNITS)
    nodes.write_text("".join([*lines, lines[-1]]))
    with pytest.raises(InputError, match="gives a node twice"):
        read_matrices(K, M, nodes, UNITS)
    nodes.write_text("".join([*lines, "7, 1.0\n"]))
    with pytest.raises(InputError, match="must be a node's number, x, y and z"):
        read_matrices(K, M, nodes, UNITS)


def test_a_marker_on_nodes_follows_rigid_motions_as_one_on_the_face(model: MatrixModel, small_bar: FEModel) -> None:
    nodes = nodes_in_plane(model, 0, 0.3)
    marker = node_marker(model, nodes)
    face = face_marker(small_bar.discretisation, small_bar.discretisation.mesh.faces["x+"])
    assert marker.position == pytest.approx(face.position, abs=1e-12)
    R = small_bar.rigid_modes.reshape(-1, 3, 6)
    assert marker.rotation(R) == pytest.approx(face.rotation(R), abs=1e-11)  # 1 over the face's 0.02 m is 50
    assert marker.translation(R) == pytest.approx(face.translation(R), abs=1e-12)


def test_a_marker_on_too_few_nodes_is_refused(model: MatrixModel) -> None:
    with pytest.raises(ValueError, match="there is no node 11"):
        node_marker(model, np.array([10, 11]))
    with pytest.raises(ValueError, match="three nodes at least that don't lie in a line"):
        node_marker(model, np.array([10, 12]))


def test_matrices_of_calculix_have_the_rows_of_its_deck_in_ascending_order(tmp_path: Path) -> None:
    """By CalculiX 2.20, MATRIXSTORAGE; nodes of the deck come in another order, and one is of no element."""
    decks = Path(__file__).parent / "decks"
    model = read_matrices(decks / "two.sti", decks / "two.mas", decks / "two.inp", UNITS)
    assert model.labels.tolist() == [3, 12, 13, 21, 22, 31, 41, 42, 43, 51, 52, 53]
    free = np.flatnonzero(np.repeat(model.x[:, 0] > 0, 3))
    K, M = (A.toarray()[np.ix_(free, free)] for A in (model.K, model.M))
    # of the same deck, with the nodes at x = 0 held
    hz = [1565.293, 1687.008, 4251.57, 7058.731]
    assert np.sqrt(eigh(K, M, eigvals_only=True)[:4]) / (2 * np.pi) == pytest.approx(hz, rel=1e-6)
    for more, message in (
        (
            "*RIGID BODY, NSET=ALL, REF NODE=99\n",
            r"\*RIGID BODY 1 gives unknowns by others, which the matrices leave out",
        ),
        ("*ELEMENT, TYPE=C3D4\n9, 31, 12, 22, 99\n", "its last row is 36, and 13 nodes have 39 displacements"),
        ("*NODE\n99, 2, 2, 2\n", "node 99 is given twice"),
    ):
        (tmp_path / "two.inp").write_text((decks / "two.inp").read_text() + more)
        with pytest.raises(InputError, match=message):
            read_matrices(decks / "two.sti", decks / "two.mas", tmp_path / "two.inp", UNITS)
    (tmp_path / "two.inp").write_text((decks / "two.inp").read_text().partition("*ELEMENT")[0])
    with pytest.raises(InputError, match="has no elements, whose nodes are wanted"):
        read_matrices(decks / "two.sti", decks / "two.mas", tmp_path / "two.inp", UNITS)
