"""Matrices of Nastran's OUTPUT2 files, in binary.

A file is records of Fortran, each between two words with its length (DMAP Programmer's Guide, OUTPUT2). A record of one
word is a key. A data block begins with the key 2 and its name, the key -1 and its trailer: number, columns, rows, form,
type, words, density. Behind each further negative key stands whether a column of a matrix follows, and then each string
of the column: its number of words, and a record of its first row and its numbers.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from fmd.fem.formats.nastran_matrices import Entries, add_entries, fortran_records, matrix_of_entries
from fmd.fem.formats.node_places import read_matrix_bytes

_TRAILER = struct.Struct("7i")
_REAL = {1: 4, 2: 8}  # bytes of a number by the matrix' type: single and double precision


def read_op2(path: Path) -> dict[str, sp.csr_array]:
    """Read the matrices of real numbers of an OUTPUT2 file by their names; tables are passed over.

    Raises
    ------
    InputError
        The file can't be read, or is too large.
    ValueError
        It isn't whole, or has words of eight bytes.
    """
    content = read_matrix_bytes(path)
    if content[:4] in (b"\x08\0\0\0", b"\0\0\0\x08"):
        raise ValueError("it has words of eight bytes; write it with words of four")
    order = "<" if content[:4] == b"\x04\0\0\0" else ">"
    records, found = _Records(content, order), dict[str, sp.csr_array]()
    while (key := records.key()) is not None:
        if key != 2:  # words of a block's name; others are of the file's head, date and label
            if key > 0:
                records.record()
            continue
        name = records.record().decode("ascii", errors="replace").strip()
        found |= _data_block(records, name)
    return found


def _data_block(records: _Records, name: str) -> dict[str, sp.csr_array]:
    """Read the rest of a data block; none if it is a table, or complex."""
    if records.key() != -1 or records.key() == 0:  # no block, but the label at the end of the file's head
        return {}
    trailer = records.record()
    if len(trailer) != _TRAILER.size:
        raise ValueError(f"data block {name} has no trailer of seven words")
    _, n_columns, n_rows, _, kind, *_ = struct.unpack(f"{records.order}7i", trailer)
    entries: Entries = ([], [], [])
    column, is_matrix = 0, False
    key = records.key()
    while key is not None and key < 0:
        records.key()
        if records.key() == 1:
            column, is_matrix = column + 1, True
        while (key := records.key()) is not None and key > 0:
            record = records.record()
            if is_matrix and kind in _REAL:
                if len(record) % _REAL[kind] != 4 % _REAL[kind] or len(record) < 4:
                    raise ValueError(f"matrix {name} has a string of {len(record)} bytes in column {column}")
                (row,), number = struct.unpack_from(f"{records.order}i", record), f"{records.order}f{_REAL[kind]}"
                add_entries(entries, column, row, np.frombuffer(record[4:], number))
    if key is None:
        raise ValueError(f"data block {name} is cut off")
    if not is_matrix or kind not in _REAL:
        return {}
    return {name: matrix_of_entries(name, (n_rows, n_columns), entries)}


class _Records:
    """The records of a file, read one after the other."""

    def __init__(self, content: bytes, order: str) -> None:
        self.order = order
        self._each = fortran_records(content, order, "OUTPUT2")

    def record(self) -> bytes:
        """Return the next record; raises ``ValueError`` at the end of the file."""
        if (found := next(self._each, None)) is None:
            raise ValueError("the file is cut off")
        return found

    def key(self) -> int | None:
        """Return the key that the next record is, ``None`` at the end of the file."""
        if (found := next(self._each, None)) is None:
            return None
        if len(found) != 4:
            raise ValueError(f"a record of {len(found)} bytes stands where a key should be")
        return int(struct.unpack(f"{self.order}i", found)[0])
