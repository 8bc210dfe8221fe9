"""Matrices of Ansys' ``.full``: the reader's own sample, and files written here in the sample's form."""

import builtins
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.fem.formats.matrices import read_matrices
from fmd.fem.formats.matrix_readers import read_matrix
from fmd.reduction.eigen import FreeBodySolver
from tests.fem.formats.test_six_unknowns import SI, exact, frame, lumped

pytestmark = pytest.mark.skipif(find_spec("ansys") is None, reason="ansys-mapdl-reader isn't installed")


def sample(name: str) -> Path:
    """Return a file of the reader's, which takes a second to load: none is where other files' tests are collected."""
    return Path(getattr(import_module("ansys.mapdl.reader.examples"), name))


def record(values: Array | IntArray) -> bytes:
    """Return a record of whole or real numbers: its words, a flag, the numbers, its words again."""
    whole = np.issubdtype(values.dtype, np.integer)
    data = values.astype("<i4" if whole else "<f8").tobytes()
    n = len(data) // 4
    return np.array([n, -(2**31) if whole else 0], "<i4").tobytes() + data + np.array([n], "<i4").tobytes()


def rows(A: Array) -> bytes:
    """Return the rows of one half of a matrix, in each what follows the diagonal and then this."""
    out = b""
    for i, row in enumerate(A):
        kept = np.r_[i + 1 + np.flatnonzero(row[i + 1 :]), i]
        out += record(kept + 1) + record(row[kept])
    return out


def full(
    K: Array, M: Array, nodes: IntArray, held: tuple[int, ...] = (), equations: int = 0, kinds: int | None = None
) -> bytes:
    """Write matrices (k n, k n) of nodes, in their order, as Ansys does with k unknowns each."""
    n, k = len(K), len(K) // len(nodes)
    signs = np.arange(1, n + 1)
    signs[list(held)] *= -1
    standard = np.fromfile(sample("fullfile"), "<i4", 102)[2:]  # names of program and machine
    begin = record(np.arange(1, (kinds or k) + 1)) + record(nodes)
    bodies = [rows(K), rows(M), record(np.full(len(nodes), k)) + record(signs)]
    starts = 103 + 106 + np.cumsum([0, *(len(body) for body in (begin, *bodies))]) // 4
    header = np.zeros(103, dtype=np.int64)
    header[0] = -4
    for place, value in (
        (1, n),
        (2, n),
        (3, 2),
        (6, len(nodes)),
        (7, kinds or k),
        (8, np.count_nonzero(np.triu(K)) + np.count_nonzero(np.diag(K) == 0)),
        (18, starts[1]),
        (20, equations),
        (26, starts[2]),
        (32, len(nodes)),
        (33, np.count_nonzero(np.triu(M)) + np.count_nonzero(np.diag(M) == 0)),
        (35, starts[3]),
    ):
        header[place] = value
    return b"".join([record(standard), record(header), begin, *bodies])


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path, Array, Array]:
    """A frame of beams whose nodes stand in another order in the file than in the table."""
    x, K, _ = frame(n=6)
    M = lumped(x)
    labels = np.array([3, 17, 4, 90, 8, 11])
    order = np.random.default_rng(1).permutation(6)
    own = (6 * order[:, None] + np.arange(6)).ravel()
    path, nodes = tmp_path / "file.full", tmp_path / "nodes.csv"
    path.write_bytes(full(K[np.ix_(own, own)], M[np.ix_(own, own)], labels[order]))
    nodes.write_text("\n".join(",".join(map(repr, [int(n), *p.tolist()])) for n, p in zip(labels, x, strict=True)))
    return path, nodes, K, M


def test_matrices_of_a_full_file_come_in_the_order_of_the_nodes(files: tuple[Path, Path, Array, Array]) -> None:
    path, nodes, K, M = files
    model = read_matrices(path, path, nodes, SI, unknowns=6)
    assert FreeBodySolver(model).modes(6).omega == pytest.approx(exact(K, M)[:6], rel=1e-9)
    labels = np.array([3, 17, 4, 90, 8, 11])
    assert read_matrix(path, labels, 6, "stiffness").toarray() == pytest.approx(K, abs=1e-6)
    assert read_matrix(path, labels, 6, "mass").toarray() == pytest.approx(M, abs=1e-15)


def test_what_is_no_free_body_in_a_full_file_is_refused_by_name(files: tuple[Path, Path, Array, Array]) -> None:
    path, _, K, M = files
    labels = np.array([3, 17, 4, 90, 8, 11])

    def refused(message: str, unknowns: int = 6, nodes: IntArray = labels) -> None:
        with pytest.raises(InputError, match=message):
            read_matrix(path, nodes, unknowns, "mass")

    refused("a node has 6 unknowns; with rotations say matrices.unknowns = 6", unknowns=3)
    refused("has unknowns of node 90 and 0 more, which nodes doesn't have", nodes=np.array([3, 17, 4, 8, 11]))
    refused("has no unknowns of node 5 and 1 more of nodes", nodes=np.array([3, 17, 4, 90, 8, 11, 5, 6]))
    path.write_bytes(full(K, M, labels, held=(7, 8)))
    refused("2 unknowns of 1 nodes, the first 17, are held by supports")
    path.write_bytes(full(K, M, labels, equations=4))
    refused("4 constraint equations are in it; write it without CE, CP and CERIG")
    path.write_bytes(full(K, M, labels, kinds=7))
    refused(r"its nodes have unknowns \[1, 2, 3, 4, 5, 6, 7\]")
    path.write_bytes(b"no binary file")
    refused("can't be read as a matrix: Unable to determine endian type")
    path.write_bytes(sample("rstfile").read_bytes())
    refused("it is another of Ansys' binary files; K and M are in .full")


def test_the_readers_own_sample_is_refused_for_its_supports() -> None:
    """40 SOLID186 of Ansys 19.4: 21 nodes of the foot are held, and the file leaves out their rows."""
    with pytest.raises(InputError, match="63 unknowns of 21 nodes, the first 1, are held by supports"):
        read_matrix(sample("fullfile"), np.arange(1, 322), 3, "stiffness")


def test_without_the_package_its_name_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *args: object, **kwargs: object) -> object:
        if name.startswith("ansys"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    (tmp_path / "file.full").write_bytes(b"")
    with pytest.raises(InputError, match="pip install ansys-mapdl-reader"):
        read_matrix(tmp_path / "file.full", np.arange(3), 3, "mass")
