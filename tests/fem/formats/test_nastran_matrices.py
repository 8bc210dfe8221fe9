"""Nastran's matrices: OUTPUT4 in all of its encodings, DMIG cards, decks as nodes, and what is refused by name."""

import gzip
import struct
from pathlib import Path

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.fem.formats.matrices import read_matrices
from fmd.fem.formats.nastran_matrices import read_dmig, read_op4
from fmd.reduction.eigen import FreeBodySolver
from tests.fem.formats.test_six_unknowns import exact, frame, lumped

SI = (1.0, 1.0, 1.0)
DECKS = Path(__file__).parent / "decks"
# MYSTRAN 17.0 (77d970d) on mystran.bdf, its modes 7 to 14: CQUAD4, CBAR, RBE2, RBE3, CONM2 with inertia.
MYSTRAN_HZ = [69.47858, 109.9686, 196.6058, 304.1913, 315.821, 376.4759, 517.5857, 537.1977]
# Sparse text as Nastran's manual shows it, with strings of words: a lower triangle of columns 1, 2 and 4.
MANUAL = """       4      -4       2       2LOW     1P,3E23.16
       1       0      10
       9       1
 1.0000000000000000E+00 2.0000000000000000E+00-3.0000000000000000E+00
 4.0000000000000000E+00
       2       0       8
       3       2
 5.0000000000000000E+00
       3       4
-6.0000000000000000+100
       4       0       4
       3       4
 7.0000000000000000D+00
       5       1       1
 1.0000000000000000E+00
"""


def strings(column: Array) -> list[tuple[int, Array]]:
    """Return first rows, from 1, and numbers of the runs of a column that aren't zero."""
    rows = np.flatnonzero(column)
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return [(int(run[0]) + 1, column[run]) for run in runs if len(run)]


def record(data: bytes, order: str = "<") -> bytes:
    """Return a record of Fortran."""
    length = struct.pack(f"{order}i", len(data))
    return length + data + length


def op4(matrices: dict[str, Array], form: str, binary: bool, precision: int = 2, order: str = "<") -> bytes:
    """Write matrices as OUTPUT4: ``dense``, sparse with ``one`` word a string, or with ``two``."""
    out, words = b"", precision

    def numbers(values: Array) -> bytes:
        if binary:
            return values.astype(f"{order}f{4 * words}").tobytes()
        items = [f"{value:23.16E}" for value in values]
        return "".join("".join(items[k : k + 3]) + "\n" for k in range(0, len(items), 3)).encode()

    for name, A in matrices.items():
        n_rows, n_columns = A.shape
        head = n_columns, -n_rows if form == "two" else n_rows, 1, precision
        if binary:
            out += record(struct.pack(f"{order}4i8s", *head, name.ljust(8).encode()), order)
        else:
            out += ("".join(f"{n:8d}" for n in head) + f"{name:8s}1P,3E23.16\n").encode()
        for k, column in enumerate(A.T, start=1):
            runs = strings(column)
            if not runs:
                continue
            if form == "dense":
                first = runs[0][0]
                own = column[first - 1 : np.flatnonzero(column)[-1] + 1]
                start = k, first, len(own) * (words if binary else 1)
                data = numbers(own)
            else:
                data, n_words = b"", 0
                for row, values in runs:
                    length = words * len(values)
                    mark = (length + 1, row) if form == "two" else (row + 65536 * (length + 1),)
                    data += struct.pack(f"{order}{len(mark)}i", *mark) if binary else b"".join(b"%8d" % m for m in mark)
                    data += (b"" if binary else b"\n") + numbers(values)
                    n_words += len(mark) + length
                start = k, 0, n_words
            out += record(struct.pack(f"{order}3i", *start) + data, order) if binary else b"%8d%8d%8d\n" % start + data
        last, one = (n_columns + 1, 1, 1), numbers(np.ones(1))
        out += record(struct.pack(f"{order}3i", *last) + one, order) if binary else b"%8d%8d%8d\n" % last + one
    return out


def random_matrix(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return np.where(rng.random((12, 9)) < 0.4, rng.standard_normal((12, 9)) * 10.0 ** rng.integers(-12, 12, (12, 9)), 0)


@pytest.mark.parametrize("form", ["dense", "one", "two"])
@pytest.mark.parametrize("binary", [False, True], ids=["text", "binary"])
@pytest.mark.parametrize(("precision", "order"), [(1, "<"), (2, "<"), (2, ">")])
def test_random_matrices_come_back_from_every_encoding(
    tmp_path: Path, form: str, binary: bool, precision: int, order: str
) -> None:
    given = {"KGG": random_matrix(1), "MGG": random_matrix(2), "NULL": np.zeros((3, 3))}
    if precision == 1 and binary:
        given = {name: A.astype(np.float32).astype(float) for name, A in given.items()}
    path = tmp_path / "a.op4"
    path.write_bytes(op4(given, form, binary, precision, order))
    found = read_op4(path)
    assert list(found) == list(given)
    for name, A in given.items():
        assert found[name].toarray() == pytest.approx(A, rel=1e-15, abs=0.0)


def test_text_of_the_manuals_form_is_read_with_exponents_of_both_kinds(tmp_path: Path) -> None:
    (tmp_path / "a.op4").write_text(MANUAL)
    wanted = np.array([[1.0, 0, 0, 0], [2, 5, 0, 0], [-3, 0, 0, 0], [4, -6e100, 0, 7]])
    assert read_op4(tmp_path / "a.op4")["LOW"].toarray().tolist() == wanted.tolist()


def deck(x: Array, labels: Array, *more: str) -> str:
    rows = [f"GRID,{label},,{a!r},{b!r},{c!r}" for label, (a, b, c) in zip(labels, x.tolist(), strict=True)]
    return "\n".join(["BEGIN BULK", *rows, *more, "ENDDATA"])


def dmig(name: str, A: Array, labels: Array) -> str:
    """Write the upper half of a symmetric matrix as DMIG cards of large fields."""
    lines = [f"DMIG    {name:8s}       0       6       2       0"]
    for column in range(len(A)):
        rows = np.flatnonzero(A[: column + 1, column])
        if len(rows):
            lines.append(f"DMIG*   {name:16s}{labels[column // 6]:16d}{column % 6 + 1:16d}")
        lines += [f"*       {labels[r // 6]:16d}{r % 6 + 1:16d}{A[r, column]:16.9E}".replace("E", "D") for r in rows]
    return "\n".join([*lines, ""])


@pytest.mark.parametrize("kind", ["text", "binary", "half", "punch"])
def test_a_frame_by_its_deck_and_matrices_has_the_matrices_own_frequencies(tmp_path: Path, kind: str) -> None:
    """Grid points of the deck come in any order; rows of OUTPUT4 are of ascending numbers."""
    x, K, _ = frame()
    M = lumped(x)
    labels = 100 + np.random.default_rng(1).permutation(len(x))
    (tmp_path / "a.bdf").write_text(deck(x, labels))
    ascending = (6 * np.argsort(labels)[:, None] + np.arange(6)).ravel()
    given = {"KGG": K[np.ix_(ascending, ascending)], "MGG": M[np.ix_(ascending, ascending)]}
    path = tmp_path / ("a.pch" if kind == "punch" else "a.op4")
    if kind == "punch":
        path.write_text(dmig("KAAX", K, labels) + dmig("MAAX", M, labels))
    else:
        halves = {name: np.triu(A) for name, A in given.items()}
        path.write_bytes(op4(halves if kind == "half" else given, "two", kind == "binary"))
    model = read_matrices(path, path, tmp_path / "a.bdf", SI, 6)
    T = model.T
    assert T is not None
    order = np.concatenate([6 * np.arange(16)[:, None] + np.arange(3), 6 * np.arange(16)[:, None] + np.arange(3, 6)])
    own = K[np.ix_(ascending, ascending)][np.ix_(order.ravel(), order.ravel())]
    assert np.abs((T.T @ model.K @ T).toarray() - own).max() < 1e-9 * np.abs(K).max()
    if kind != "punch":  # whose ten digits leave too much of the rigid motions of a frame as slender as this one
        assert FreeBodySolver(model).modes(6).omega == pytest.approx(exact(K, M)[:6], rel=1e-7)


def test_cards_of_dmig_in_small_fields_and_without_symmetry_are_read() -> None:
    text = "DMIG,K2,0,1,2,0\nDMIG,K2,1,1,,1,1,5.,,\n+,2,3,-1.5+2\nDMIG,K2,2,3,,2,3,7.\n"
    text += "DMIG,C,0,1,3,0\nDMIG,C,1,1,,1,1,5.,2."
    assert read_dmig(text) == {"K2": {(1, 1, 1, 1): 5.0, (2, 3, 1, 1): -150.0, (2, 3, 2, 3): 7.0}}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda K, M: op4({"KGG": K[:-3, :-3], "MGG": M}, "two", True), "has 93 rows and 93 columns; 16 nodes have 96"),
        (lambda K, M: op4({"K1": K, "K2": K, "MGG": M}, "two", True), "which matrix is the stiffness.*K1, K2, MGG"),
        (lambda K, M: op4({"A": K, "B": M}, "two", True), "which matrix is the stiffness.*A, B"),
        (lambda K, M: op4({"KGG": K, "MGG": M}, "two", True)[:-300], r"MGG is cut off|it is cut off"),
        (lambda K, M: op4({"KGG": K, "MGG": M}, "dense", False)[:-400], "matrix MGG is damaged or cut off"),
        (lambda K, M: record(struct.pack("<4i8s", 1, 1, 2, 2, b"KGG")) + record(bytes(8)), "ends after 8 of 12 bytes"),
        (
            lambda K, M: record(struct.pack("<4i8s", 1, -1, 2, 2, b"KGG")) + record(struct.pack("<4i", 1, 0, 1, 3)),
            "ends after 4 of 8 bytes",
        ),
        (lambda K, M: b"\x30\0\0\0" + b"0" * 100, "words of eight bytes"),
        (lambda K, M: b"GRID    1\n", "isn't the header of an OUTPUT4 matrix"),
    ],
)
def test_files_that_are_not_a_bodys_matrices_are_refused_by_name(tmp_path: Path, change: object, message: str) -> None:
    x, K, _ = frame()
    (tmp_path / "a.bdf").write_text(deck(x, np.arange(1, 17)))
    (tmp_path / "a.op4").write_bytes(change(K, lumped(x)))  # type: ignore[operator]
    with pytest.raises(InputError, match=message):
        read_matrices(tmp_path / "a.op4", tmp_path / "a.op4", tmp_path / "a.bdf", SI, 6)


@pytest.mark.parametrize(
    ("card", "message"),
    [
        ("GRID,90,,0.,0.,0.,3", "grid point 90 moves in coordinate system 3, its CD"),
        ("SPOINT,90", "SPOINT 90 has rows without a grid point"),
        ("GRID,90,4,0.,0.,0.", "grid point 90: coordinate system 4 isn't there"),
    ],
)
def test_decks_whose_matrices_are_of_other_unknowns_are_refused_by_card(
    tmp_path: Path, card: str, message: str
) -> None:
    x, K, _ = frame()
    (tmp_path / "a.bdf").write_text(deck(x, np.arange(1, 17), card))
    (tmp_path / "a.op4").write_bytes(op4({"KGG": K, "MGG": lumped(x)}, "two", True))
    with pytest.raises(InputError, match=message):
        read_matrices(tmp_path / "a.op4", tmp_path / "a.op4", tmp_path / "a.bdf", SI, 6)


def test_dmig_of_points_that_the_deck_lacks_or_of_rotations_by_three_unknowns_is_refused(tmp_path: Path) -> None:
    x, K, _ = frame()
    labels = np.arange(1, 17)
    (tmp_path / "a.bdf").write_text(deck(x[:-1], labels[:-1]))
    (tmp_path / "a.pch").write_text(dmig("KAAX", K, labels))
    with pytest.raises(InputError, match="matrix KAAX: an entry names node 16, which isn't among the nodes"):
        read_matrices(tmp_path / "a.pch", tmp_path / "a.pch", tmp_path / "a.bdf", SI, 6)
    (tmp_path / "a.bdf").write_text(deck(x, labels))
    with pytest.raises(InputError, match=r"directions are 1 to 3.*matrices.unknowns = 6"):
        read_matrices(tmp_path / "a.pch", tmp_path / "a.pch", tmp_path / "a.bdf", SI)


def test_matrices_of_mystran_with_the_links_of_its_deck_have_its_frequencies(tmp_path: Path) -> None:
    path = tmp_path / "plate.op4"
    path.write_bytes(gzip.decompress((DECKS / "mystran.op4.gz").read_bytes()))
    model = read_matrices(path, path, DECKS / "mystran.bdf", SI, unknowns=6)
    hz = FreeBodySolver(model).modes(8).omega / (2 * np.pi)
    assert [float(f"{f:.7g}") for f in hz] == MYSTRAN_HZ
