"""Bodies given by another program's stiffness and mass matrices and its nodes' positions."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import StringIO
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError, InputError, blaming
from fmd.core.limits.files import IN_LINE, ISOTROPIC, MOST_MATRIX_BYTES, SYMMETRIC
from fmd.core.limits.mesh import FACE_IN_PLANE
from fmd.fem.connections import Connections
from fmd.fem.formats import abaqus
from fmd.fem.formats.free_body import require_free_body
from fmd.fem.formats.matrix_model import MatrixModel
from fmd.fem.formats.nastran import SUFFIXES as DECKS
from fmd.fem.formats.nastran import read_grid_points
from fmd.fem.formats.nastran_matrices import choose_matrix, read_dmig, read_op4, sum_entries
from fmd.fem.formats.nastran_op2 import read_op2
from fmd.fem.formats.node_places import read_matrix_text, read_node_table
from fmd.fem.formats.raw_mesh import MeshFileError
from fmd.fem.formats.six_unknowns import SixUnknownsModel, six_unknowns_model
from fmd.fem.formats.tied_matrices import references, tie_matrices
from fmd.fem.markers import Marker, weighted_marker

_WHAT = {3: "displacements", 6: "displacements and rotations"}  # unknowns of a node
_Line = tuple[int, list[str]]  # number and items of a line of text
_OUTPUTS = {".op4": read_op4, ".op2": read_op2}


def read_matrices(
    stiffness: Path, mass: Path, nodes: Path, units: tuple[float, float, float], unknowns: int = 3
) -> MatrixModel:
    """Read a body's matrices and check that they are those of a free body.

    Parameters
    ----------
    stiffness, mass : Path
        Matrix Market (``.mtx``), SciPy's ``.npz``, or what Abaqus writes: rows of node, direction, node, direction,
        value (``FORMAT=MATRIX INPUT`` or ``LABELS``) or of row, column, value (``FORMAT=COORDINATE``). Rows and columns
        without node numbers are x, y, z of the first node in ``nodes``, then of the second; with six unknowns a node
        the rotations about x, y, z behind each. Nastran's OUTPUT4 (``.op4``) and OUTPUT2 (``.op2``), whose rows are of
        the nodes in ascending order, as those of CalculiX (``.sti``, ``.mas``) are, and DMIG cards (``.pch``); of
        several matrices in a file those whose names begin with K and M.
    nodes : Path
        Rows of number, x, y, z, or a deck of Nastran, Abaqus or CalculiX.
    units : tuple of float
        The files' units of length [m], stiffness [N/m] and mass [kg].
    unknowns : int
        Unknowns a node: 3 displacements, or 6 with rotations [rad], whose entries take the file's unit of length.

    Raises
    ------
    InputError
        A file can't be read, or they don't fit together.
    AccuracyError
        A matrix isn't symmetric, a rigid motion isn't free, masses depend on the direction, or no matter is so dense
        or so stiff; with the figure.
    """
    labels, x, deck = _read_nodes(nodes)
    x = x * units[0]
    given = (("stiffness", stiffness, units[1]), ("mass", mass, units[2]))
    K, M = (read_matrix(path, labels, unknowns, what) * unit for what, path, unit in given)
    if unknowns == 6:
        arm = sp.diags_array(np.tile(np.repeat([1.0, units[0]], 3), len(x)))
        K, M = (sp.csr_array(arm @ A @ arm) for A in (K, M))
    for path, A in ((stiffness, K), (mass, M)):
        apart = abs(A - A.T).max() / abs(A).max() if A.nnz else np.inf
        if not apart < SYMMETRIC:
            raise AccuracyError(f"{path}: the matrix isn't symmetric, entries differ by {apart:.1e} of the largest")
    K, M = (sp.csr_array(0.5 * (A + A.T)) for A in (K, M))
    K.eliminate_zeros()  # its pattern tells what is connected
    if unknowns == 6:
        model: MatrixModel = _tied(six_unknowns_model(mass, K, M, x, labels, references(deck)), deck, nodes)
    else:
        model = MatrixModel(None, None, K, _scalar(mass, M), x, labels)  # type: ignore[arg-type]
        _require_mass(mass, model)
        if deck.rigid or deck.mean or deck.equations:
            first = (*deck.rigid, *deck.mean, *deck.equations)[0]
            raise InputError(str(nodes), "", None, f"{first.label} needs rotations; say matrices.unknowns = 6")
    require_free_body(stiffness, model)
    return model


def _require_mass(path: Path, model: MatrixModel) -> None:
    """Raise ``AccuracyError`` if a matrix is no mass matrix by its sum or its diagonal."""
    diagonal = model.m.diagonal()
    if not (diagonal >= 0).all():
        number, least = model.labels[diagonal.argmin()], diagonal.min()
        raise AccuracyError(f"{path}: no mass matrix: node {number} has {least:.3g} kg on the diagonal")
    if not model.mass > 0:
        raise AccuracyError(f"{path}: no mass matrix: its sum is {model.mass:.3g} kg")


def _scalar(path: Path, M: sp.csr_array) -> sp.csr_array:
    """Return ``m`` of ``M = m ⊗ 1₃``; raise ``AccuracyError`` if masses depend on the direction."""
    m = sp.csr_array(M[::3][:, ::3])
    apart = abs(M - sp.kron(m, sp.eye_array(3), format="csr")).max() / abs(M).max()
    if not apart < ISOTROPIC:
        raise AccuracyError(
            f"{path}: masses depend on the direction, by {apart:.1e} of the largest (at most {ISOTROPIC:.0e}); "
            "matrices of solid elements are wanted, of displacements alone and not reduced"
        )
    return m


def _tied(model: SixUnknownsModel, deck: Connections, path: Path) -> SixUnknownsModel:
    """Return the model with what a deck's links join, which aren't in its matrices."""
    if not (deck.rigid or deck.mean or deck.equations):
        return model
    with blaming(str(path)):
        return tie_matrices(model, deck)


def _read_nodes(path: Path) -> tuple[IntArray, Array, Connections]:
    """Read node numbers (n_nodes,) and positions (n_nodes, 3) in the file's unit, and a deck's connections."""
    if path.suffix.lower() in DECKS:
        with blaming(str(path), of=MeshFileError):
            return read_grid_points(read_matrix_text(path))
    if path.suffix.lower() in abaqus.SUFFIXES:
        return *_nodes_of_deck(path), Connections()
    labels, x = read_node_table(path)
    if len(x) < 3:
        raise InputError(str(path), "", None, "needs three nodes at least, with finite coordinates")
    return labels, x, Connections()


def _nodes_of_deck(path: Path) -> tuple[IntArray, Array]:
    """Read the nodes of the elements of a deck of Abaqus or CalculiX, in ascending order, as CalculiX's rows are."""
    with blaming(str(path), of=MeshFileError):
        raw = abaqus.read_abaqus(read_matrix_text(path))
    found = raw.connections
    if joined := [*found.rigid, *found.mean, *found.equations, *found.ties]:
        what = "gives unknowns by others, which the matrices leave out; write them without"
        raise InputError(str(path), "", None, f"{joined[0].label} {what}")
    used = np.unique(np.concatenate([found.points, *(cells.ravel() for _, cells in raw.blocks)]))
    order = used[np.argsort(raw.numbers[used])]
    if len(order) < 3:
        raise InputError(str(path), "", None, "has no elements, whose nodes are wanted")
    return raw.numbers[order], raw.points[order]


def read_matrix(path: Path, labels: IntArray, unknowns: int, what: str) -> sp.csr_array:
    """Read the stiffness or the mass of some unknowns a node, shape (unknowns n_nodes, unknowns n_nodes)."""
    n = unknowns * len(labels)
    with _told_of(path):
        match path.suffix.lower():
            case ".npz":
                A = _read_npz(path)
            case ".op4" | ".op2":
                A = _read_output(path, labels, unknowns, what)
            case ".pch":
                A = _read_dmig(path, labels, unknowns, what)
            case _:
                A = _read_text(path, labels, unknowns)
    if A.shape != (n, n):
        mend = f"has {A.shape[0]} rows and {A.shape[1]} columns; {len(labels)} nodes have {n} {_WHAT[unknowns]}"
        if A.shape[0] == 2 * n and unknowns == 3:
            mend += ", and this is twice as many: with rotations say matrices.unknowns = 6"
        raise InputError(str(path), "", None, mend)
    if not np.isfinite(A.data).all():
        bad = np.count_nonzero(~np.isfinite(A.data))
        raise AccuracyError(f"{path}: {bad} entries aren't finite numbers")
    return A


@contextmanager
def _told_of(path: Path) -> Iterator[None]:
    """Raise whatever damaged bytes lead to as an ``InputError`` of their file."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # those of NumPy, SciPy and zipfile are of many kinds
        raise InputError(str(path), "", None, f"can't be read as a matrix: {' '.join(str(error).split())}") from error


def _read_output(path: Path, labels: IntArray, unknowns: int, what: str) -> sp.csr_array:
    """Read a matrix of OUTPUT4 or OUTPUT2, whose rows are of ascending node numbers."""
    found = _OUTPUTS[path.suffix.lower()](path)
    A = sp.coo_array(found[choose_matrix(found, what)])
    if A.shape != 2 * (unknowns * len(labels),):
        return sp.csr_array(A)  # its size is refused where all are
    place = (unknowns * np.argsort(labels)[:, None] + np.arange(unknowns)).ravel()
    row, column, values = place[A.coords[0]], place[A.coords[1]], A.data
    if _is_half(row, column, A.shape[0]):
        row, column, values = _both_halves(row, column, values)
    return _real_matrix(A.shape, row, column, values)


def _read_dmig(path: Path, labels: IntArray, unknowns: int, what: str) -> sp.csr_array:
    """Read a matrix of DMIG cards by node labels."""
    found = read_dmig(read_matrix_text(path))
    name = choose_matrix(found, what)
    lines = [(0, [*map(str, key), repr(value)]) for key, value in found[name].items()]
    try:
        row, column, values = _label_entries(lines, labels, unknowns)
    except ValueError as error:
        raise ValueError(f"matrix {name}: {str(error).replace('line 0', 'an entry')}") from None
    return _real_matrix(2 * (unknowns * len(labels),), row, column, values)


def read_rows(path: Path) -> sp.csr_array:
    """Read a matrix of any shape, the first of its file: OUTPUT4, OUTPUT2, ``.npz`` or Matrix Market.

    Raises
    ------
    InputError
        It can't be read, or isn't of finite numbers.
    """
    with _told_of(path):
        match path.suffix.lower():
            case ".op4" | ".op2":
                found = _OUTPUTS[path.suffix.lower()](path)
                if not found:
                    raise ValueError("it holds no real matrix")
                A = next(iter(found.values()))
            case ".npz":
                A = _read_npz(path)
            case _:
                A = _read_matrix_market(read_matrix_text(path))
        if not np.isfinite(A.data).all():
            raise ValueError("its entries aren't all finite")
    return A


def _read_npz(path: Path) -> sp.csr_array:
    """Read a matrix that SciPy has saved."""
    with zipfile.ZipFile(path) as archive:
        if sum(item.file_size for item in archive.infolist()) > MOST_MATRIX_BYTES:
            raise ValueError(f"unpacked it is over {MOST_MATRIX_BYTES / 1e9:g} GB")
    A = sp.load_npz(path)
    if A.format not in ("csr", "csc", "coo"):
        raise ValueError(f"it is in SciPy's format {A.format}; csr, csc and coo are read")
    if A.format != "coo":
        A.check_format(full_check=True)  # SciPy trusts the indices in the file
    A = sp.coo_array(A)
    row, column = A.coords
    return _real_matrix(A.shape, row, column, A.data)


def _real_matrix(shape: tuple[int, ...], row: IntArray, column: IntArray, values: Array) -> sp.csr_array:
    """Sum real entries into a matrix."""
    if np.iscomplexobj(values):
        raise ValueError("its entries are complex")
    return sum_entries("it", shape, row, column, np.asarray(values, dtype=float))


def _read_text(path: Path, labels: IntArray, unknowns: int) -> sp.csr_array:
    """Read a matrix in Matrix Market form or in Abaqus' rows, of five items by node labels or of three by numbers."""
    text = read_matrix_text(path)
    if text.startswith("%%MatrixMarket"):
        return _read_matrix_market(text)
    n = unknowns * len(labels)
    table = _coordinate_table(text, n)
    if by_numbers := table is not None:
        row, column, values = table
    else:
        lines = []
        for number, line in enumerate(text.splitlines(), start=1):
            items = [item for item in re.split(r"[,\s]+", line.strip()) if item]
            if items and not items[0].startswith(("*", "#", "%")):
                lines.append((number, items))
        by_numbers = bool(lines) and len(lines[0][1]) == 3
        row, column, values = (_coordinate_entries if by_numbers else _label_entries)(lines, labels, unknowns)
    last = 1 + int(max(row.max(initial=-1), column.max(initial=-1)))
    if by_numbers and last < n - (unknowns - 3):  # rotations of a last node may have no stiffness
        raise ValueError(f"its last row is {last}, and {len(labels)} nodes have {n} {_WHAT[unknowns]}")
    if _is_half(row, column, n):
        row, column, values = _both_halves(row, column, values)
    return _real_matrix((n, n), row, column, values)


def _coordinate_table(text: str, n: int) -> tuple[IntArray, IntArray, Array] | None:
    """Return what `_coordinate_entries` does, of numbers between blanks without a fault; else ``None``."""
    if len(text.lstrip().partition("\n")[0].split()) != 3:
        return None
    try:
        table = np.loadtxt(StringIO(text), ndmin=2)
    except ValueError:
        return None
    if table.shape[1] != 3 or not len(table):
        return None
    index = table[:, :2]
    if not ((index >= 1) & (index <= n) & (index == np.floor(index))).all():
        return None
    row, column = index.T.astype(np.int64) - 1
    return row, column, table[:, 2]


def _label_entries(lines: Sequence[_Line], labels: IntArray, unknowns: int) -> tuple[IntArray, IntArray, Array]:
    """Return rows, columns and values of lines of node, direction, node, direction, value."""
    place = {int(label): k for k, label in enumerate(labels)}
    rows, columns, values = [], [], []
    for number, items in lines:
        try:
            node, direction, other, along = map(int, items[:4])
            value = _real(items[4])
        except (IndexError, ValueError):
            raise ValueError(f"line {number} isn't node, direction, node, direction, value") from None
        if not (1 <= direction <= unknowns and 1 <= along <= unknowns):
            more = "; with rotations say matrices.unknowns = 6" if unknowns == 3 and max(direction, along) <= 6 else ""
            raise ValueError(f"directions are 1 to {unknowns}; line {number} has {direction} and {along}{more}")
        try:
            rows.append(unknowns * place[node] + direction - 1)
            columns.append(unknowns * place[other] + along - 1)
        except KeyError as error:
            raise ValueError(f"line {number} names node {error}, which isn't among the nodes") from None
        values.append(value)
    return np.array(rows, dtype=int), np.array(columns, dtype=int), np.array(values)


def _coordinate_entries(lines: Sequence[_Line], labels: IntArray, unknowns: int) -> tuple[IntArray, IntArray, Array]:
    """Return rows, columns and values of lines of row, column, value, counted from 1 through the nodes' unknowns."""
    n = unknowns * len(labels)
    rows, columns, values = [], [], []
    for number, items in lines:
        try:
            row, column = map(int, items[:2])
            value = _real(items[2])
            if len(items) > 3:
                raise ValueError
        except (IndexError, ValueError):
            raise ValueError(f"line {number} isn't row, column, value") from None
        if not (1 <= row <= n and 1 <= column <= n):
            raise ValueError(
                f"line {number} has row {row} and column {column}, and {len(labels)} nodes have {n} {_WHAT[unknowns]}"
            )
        rows.append(row - 1)
        columns.append(column - 1)
        values.append(value)
    return np.array(rows, dtype=int), np.array(columns, dtype=int), np.array(values)


def _real(item: str) -> float:
    """Return a number that may have Fortran's exponent, ``1.0D+05``."""
    return float(item.upper().replace("D", "E"))


def _read_matrix_market(text: str) -> sp.csr_array:
    """Read Matrix Market's coordinate form; SciPy's own reader crashes on some damaged files."""
    head, *lines = (line for line in text.splitlines() if line.strip() and (line[:2] == "%%" or line[0] != "%"))
    kind, field, symmetry = [*head.lower().split(), "", "", "", "", ""][2:5]
    if kind != "coordinate" or field not in ("real", "integer") or symmetry not in ("general", "symmetric"):
        raise ValueError(f"'{head}': coordinates of real numbers are read, general or symmetric")
    n_rows, n_columns, n_entries = map(int, lines[0].split())
    table = np.array(" ".join(lines[1:]).split(), dtype=float)
    if table.size != 3 * n_entries:
        raise ValueError(f"its head speaks of {n_entries} entries, and {table.size / 3:g} are there")
    row, column, values = table.reshape(-1, 3).T
    row, column = (np.nan_to_num(index, nan=0.0).astype(np.int64) - 1 for index in (row, column))
    if symmetry == "symmetric":
        row, column, values = _both_halves(row, column, values)
    return _real_matrix((n_rows, n_columns), row, column, values)


def _is_half(row: IntArray, column: IntArray, n: int) -> bool:
    """Tell whether none of a matrix's entries off the diagonal has its mirror image.

    Abaqus writes symmetric matrices whole or one half of them. That is a triangle in its own order of the nodes.
    """
    off = row != column
    return bool(off.any()) and not np.isin(row[off] * n + column[off], column[off] * n + row[off]).any()


def _both_halves(row: IntArray, column: IntArray, values: Array) -> tuple[IntArray, IntArray, Array]:
    """Add the mirror images of a symmetric matrix's entries off the diagonal."""
    off = row != column
    return np.r_[row, column[off]], np.r_[column, row[off]], np.r_[values, values[off]]


def node_marker(model: MatrixModel, nodes: IntArray, rigid: bool = False) -> Marker:
    """Attach a marker to nodes of equal weight, since there are no areas without elements.

    Parameters
    ----------
    nodes : ndarray, shape (n,)
        Node numbers in the other program.

    Raises
    ------
    ValueError
        A node is missing, or all lie in a line, about which they have no rotation.
    """
    place = {int(label): k for k, label in enumerate(model.labels)}
    missing = [int(node) for node in nodes if int(node) not in place]
    if missing:
        raise ValueError(f"there is no node {missing[0]} (of {len(missing)} that aren't there)")
    own = np.array(sorted({place[int(node)] for node in nodes}), dtype=np.int64)
    if len(own) == 1 and (turning := model.turning_marker(int(own[0]))) is not None:
        return turning
    r = model.x[own] - model.x[own].sum(axis=0) / max(len(own), 1)
    second = r.T @ r
    if len(own) < 3 or np.linalg.eigvalsh(second)[1] <= IN_LINE * np.trace(second):
        raise ValueError("a marker takes three nodes at least that don't lie in a line")
    return weighted_marker(own, model.x[own], np.ones(len(own)), rigid)


def nodes_in_plane(model: MatrixModel, axis: int, place: float) -> IntArray:
    """Return the numbers of the nodes in the plane across an axis at ``place`` [m]."""
    x = model.x[: len(model.labels)]
    near = FACE_IN_PLANE * float(np.ptp(x, axis=0).max())
    return np.asarray(model.labels[np.abs(x[:, axis] - place) <= near])
