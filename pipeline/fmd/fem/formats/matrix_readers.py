"""Readers of matrices in files: Matrix Market, SciPy's, Abaqus', Nastran's, Ansys' and Code_Aster's."""

import re
import zipfile
from collections.abc import Iterator, Sequence
from io import StringIO
from itertools import chain
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError, InputError, as_input_error
from fmd.core.fortran import read_real
from fmd.core.limits.files import MOST_MATRIX_BYTES, SHOWN_OF_LINE
from fmd.fem.formats.ansys_full import read_full
from fmd.fem.formats.code_aster import is_code_aster, read_code_aster
from fmd.fem.formats.nastran_matrices import choose_matrix, read_dmig, read_op4, sum_entries
from fmd.fem.formats.nastran_op2 import read_op2
from fmd.fem.formats.node_places import read_matrix_text

_UNREADABLE = "can't be read as a matrix"  # whatever NumPy, SciPy and zipfile raise of damaged bytes
_WHAT = {3: "displacements", 6: "displacements and rotations"}  # unknowns of a node
_Line = tuple[int, list[str]]  # number and items of a line of text
_OUTPUTS = {".op4": read_op4, ".op2": read_op2}


def read_matrix(path: Path, labels: IntArray, unknowns: int, what: str) -> sp.csr_array:
    """Read the stiffness or the mass of some unknowns a node, shape (unknowns n_nodes, unknowns n_nodes)."""
    n = unknowns * len(labels)
    with as_input_error(str(path), of=Exception, what=_UNREADABLE):
        match path.suffix.lower():
            case ".npz":
                A = _read_npz(path)
            case ".op4" | ".op2":
                A = _read_output(path, labels, unknowns, what)
            case ".pch":
                A = _read_dmig(path, labels, unknowns, what)
            case ".full":
                A = _completed(read_full(path, labels, unknowns, what))
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


def _read_output(path: Path, labels: IntArray, unknowns: int, what: str) -> sp.csr_array:
    """Read a matrix of OUTPUT4 or OUTPUT2, whose rows are of ascending node numbers."""
    found = _OUTPUTS[path.suffix.lower()](path)
    A = sp.coo_array(found[choose_matrix(found, what)])
    if A.shape != 2 * (unknowns * len(labels),):
        return sp.csr_array(A)  # its size is refused where all are
    place = (unknowns * np.argsort(labels)[:, None] + np.arange(unknowns)).ravel()
    return _completed(sp.coo_array((A.data, (place[A.coords[0]], place[A.coords[1]])), shape=A.shape))


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
    with as_input_error(str(path), of=Exception, what=_UNREADABLE):
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
    """Read Matrix Market's form, Code_Aster's, or Abaqus' rows of five items by labels or of three by numbers."""
    text = read_matrix_text(path)
    if text.startswith("%%MatrixMarket"):
        return _read_matrix_market(text)
    if is_code_aster(text):
        return _completed(read_code_aster(text, labels, unknowns))
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
    return _completed(sp.coo_array((values, (row, column)), shape=(n, n)))


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
            value = read_real(items[4])
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
            value = read_real(items[2])
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


def _read_matrix_market(text: str) -> sp.csr_array:
    """Read Matrix Market's coordinate form; SciPy's own reader crashes on some damaged files."""
    lines = StringIO(text)
    head = lines.readline().rstrip()
    kind, field, symmetry = [*head.lower().split(), "", "", "", "", ""][2:5]
    if kind != "coordinate" or field not in ("real", "integer") or symmetry not in ("general", "symmetric"):
        raise ValueError(f"'{head}': coordinates of real numbers are read, general or symmetric")
    line, (n_rows, n_columns, n_entries) = _read_sizes(lines)
    try:
        table = np.loadtxt(chain([line], lines), comments="%", ndmin=2)[1:]
    except ValueError:
        raise ValueError(_find_fault(text)) from None
    if len(table) != n_entries:
        raise ValueError(f"its sizes speak of {n_entries} entries, and {len(table)} are there")
    index, values = table[:, :2], table[:, 2]
    wrong = ~((index >= 1) & (index <= (n_rows, n_columns)) & (index == np.floor(index))).all(axis=1)
    if wrong.any():
        first = int(wrong.argmax())
        place = "row {:.15g} and column {:.15g}".format(*index[first])
        raise ValueError(
            f"entry {first + 1} has {place}; whole numbers from 1 to {n_rows} and from 1 to {n_columns} are read"
        )
    row, column = index.T.astype(np.int64) - 1
    if symmetry == "symmetric":
        row, column, values = _both_halves(row, column, values)
    return _real_matrix((n_rows, n_columns), row, column, values)


def _read_sizes(lines: Iterator[str]) -> tuple[str, list[int]]:
    """Return the line after a Matrix Market file's head and comments, and rows, columns and entries by it."""
    line = next((line for line in lines if _items(line)), "")
    if not re.fullmatch(r"\d{1,18} \d{1,18} \d{1,18}", " ".join(_items(line))):
        there = f"{line.strip()[:SHOWN_OF_LINE]!r} is" if line else "nothing is"
        raise ValueError(f"rows, columns and entries, three whole numbers, come after its head; {there} there")
    return line, [*map(int, _items(line))]


def _find_fault(text: str) -> str:
    """Return a text with the first line of a Matrix Market file that isn't of three numbers."""
    for number, line in enumerate(StringIO(text), start=1):
        try:
            _, _, _ = map(float, _items(line))
        except ValueError:
            if _items(line):
                return f"line {number} isn't row, column, value: {line.strip()[:SHOWN_OF_LINE]!r}"
    return "its lines aren't row, column, value"


def _items(line: str) -> list[str]:
    """Return what stands between blanks before a Matrix Market file's comment."""
    return line.partition("%")[0].split()


def _completed(A: sp.coo_array) -> sp.csr_array:
    """Return a matrix of which one half may be given."""
    (row, column), values = A.coords, A.data
    if _is_half(row, column, A.shape[0]):
        row, column, values = _both_halves(row, column, values)
    return _real_matrix(A.shape, row, column, values)


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
