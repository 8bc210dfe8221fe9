"""Nastran's OUTPUT2: matrices that Nastran has written and computed with, and random ones in both precisions."""

import struct
from pathlib import Path

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.fem.formats.matrices import read_matrices
from fmd.fem.formats.nastran_op2 import read_op2
from tests.fem.formats.test_nastran_matrices import deck, random_matrix, strings
from tests.fem.formats.test_six_unknowns import frame, lumped

# Of pyNastran's samples (models/matrix/mymatrix.op2, BSD-3-Clause, see the licence beside it), written by Nastran.
SAMPLE = Path(__file__).parent / "decks" / "products.op2"


def op2(matrices: dict[str, Array], precision: int = 2, order: str = "<", head: bool = True) -> bytes:
    """Write matrices as OUTPUT2, with a table before them that is passed over."""

    def record(data: bytes) -> bytes:
        length = struct.pack(f"{order}i", len(data))
        return length + data + length

    def keys(*numbers: int) -> bytes:
        return b"".join(record(struct.pack(f"{order}i", number)) for number in numbers)

    def block(name: str, trailer: tuple[int, ...]) -> bytes:
        title = name.ljust(8).encode()
        start = keys(2) + record(title) + keys(-1, 7) + record(struct.pack(f"{order}7i", *trailer))
        return start + keys(-2, 1, 0, 2) + record(title) + keys(-3, 1)

    out = keys(3) + record(bytes(12)) + keys(7) + record(b"NASTRAN FORT TAPE ID CODE - ") + keys(2)
    out = out + record(b"XXXXXXXX") + keys(-1, 0) if head else b""
    out += block("CASECC", (101, 1, 0, 0, 0, 0, 0)) + keys(0, 4) + record(bytes(16)) + keys(-4, 1, 0, 0)
    for name, A in matrices.items():
        out += block(name, (101, A.shape[1], A.shape[0], 2, precision, 0, 0))
        for k, column in enumerate(A.T):
            out += keys(1)
            for row, values in strings(column):
                data = struct.pack(f"{order}i", row) + values.astype(f"{order}f{4 * precision}").tobytes()
                out += keys(precision * len(values)) + record(data)
            out += keys(-4 - k, 1)
        out += keys(0, 0)
    return out + keys(0)


def test_products_that_nastran_has_computed_are_those_of_its_factors() -> None:
    found = {name: A.toarray() for name, A in read_op2(SAMPLE).items()}
    assert found["A"].tolist() == [[1.0, 0.0], [3.0, 6.0], [5.0, 0.0], [0.0, 8.0]]
    assert found["ATB"].tolist() == (found["A"].T @ found["B"]).tolist()
    assert found["BTA"].tolist() == (found["B"].T @ found["A"]).tolist()
    assert np.abs(found["ATB"]).max() == 100.0


@pytest.mark.parametrize(("precision", "order", "head"), [(1, "<", True), (2, "<", False), (2, ">", True)])
def test_random_matrices_come_back(tmp_path: Path, precision: int, order: str, head: bool) -> None:
    given = {"KGG": random_matrix(1), "MGG": random_matrix(2), "NULL": np.zeros((3, 3))}
    if precision == 1:
        given = {name: A.astype(np.float32).astype(float) for name, A in given.items()}
    (tmp_path / "a.op2").write_bytes(op2(given, precision, order, head))
    found = read_op2(tmp_path / "a.op2")
    assert list(found) == list(given)
    for name, A in given.items():
        assert found[name].toarray().tolist() == A.tolist()


def test_kgg_and_mgg_of_one_file_are_a_body(tmp_path: Path) -> None:
    x, K, _ = frame()
    (tmp_path / "a.bdf").write_text(deck(x, np.arange(1, 1 + len(x))))
    (tmp_path / "a.op2").write_bytes(op2({"KGG": K, "MGG": lumped(x)}))
    model = read_matrices(*[tmp_path / "a.op2"] * 2, tmp_path / "a.bdf", (1.0, 1.0, 1.0), 6)
    assert model.mass == pytest.approx(lumped(x)[::6, ::6].trace(), rel=1e-12)


def with_short_string(data: bytes) -> bytes:
    """Cut the last string of numbers down to two bytes."""
    last = random_matrix(1)[:, -1]
    size = 4 + 8 * len(strings(last)[-1][1])
    start = data.rindex(struct.pack("<2i", size, strings(last)[-1][0]))
    return data[:start] + struct.pack("<i2xi", 2, 2) + data[start + size + 8 :]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data[: len(data) // 2], "cut off"),
        (lambda data: b"\x08" + data[1:], "words of eight bytes"),
        (lambda data: data[:-12].replace(struct.pack("<3i", 101, 9, 12), struct.pack("<3i", 101, 9, 3)), "outside"),
        (lambda data: data.replace(struct.pack("<3i", 101, 9, 12), struct.pack("<3i", 101, 9, 2**31 - 1)), "over 1e"),
        (with_short_string, "matrix KGG has a string of 2 bytes in column 9"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(tmp_path: Path, change, message: str) -> None:
    (tmp_path / "a.op2").write_bytes(change(op2({"KGG": random_matrix(1)})))
    x, *_ = frame()
    (tmp_path / "a.bdf").write_text(deck(x, np.arange(1, 1 + len(x))))
    with pytest.raises(InputError, match=message):
        read_matrices(*[tmp_path / "a.op2"] * 2, tmp_path / "a.bdf", (1.0, 1.0, 1.0), 6)
