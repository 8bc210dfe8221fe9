"""Readers of Nastran's matrices: OUTPUT4 as text and in binary, and DMIG cards of a punch file.

OUTPUT4 (Nastran's DMAP manual): a header of columns, rows, form, type, name and format of the numbers; then for each
column its number, its first row and the number of words, and the numbers from that row on. A first row of 0 announces
strings: each has its length and its row in two words if the matrix says a negative number of rows, or in one word,
``row + 65536 (length + 1)``. A word is four bytes, also where text counts those of strings; columns without strings
have numbers counted there.
"""

import re
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.fortran import read_field, read_real
from fmd.core.limits.files import MOST_MATRIX_ROWS
from fmd.fem.formats.nastran import read_cards
from fmd.fem.formats.node_places import read_matrix_bytes

_HEADER = struct.Struct("4i8s")
_WORDS = {1: 1, 2: 2, 3: 1, 4: 2}  # of a number by the matrix' type: single and double precision, real and complex
_REAL = (1, 2)
_SYMMETRIC, _SQUARE = "6", "1"  # forms of DMIG

Entries = tuple[list[IntArray], list[IntArray], list[Array]]  # rows, columns and values


def read_op4(path: Path) -> dict[str, sp.csr_array]:
    """Read the matrices of real numbers of an OUTPUT4 file by their names.

    Raises
    ------
    InputError
        The file can't be read, or is too large.
    ValueError
        It isn't whole.
    """
    content = read_matrix_bytes(path)
    if len(content) >= 4 and content[:4] in (b"\x18\0\0\0", b"\0\0\0\x18"):
        return _read_binary(content, "<" if content[0] else ">")
    if content[:4] in (b"\x30\0\0\0", b"\0\0\0\x30"):
        raise ValueError("it has words of eight bytes; write it with words of four")
    return _read_text(content.decode("ascii", errors="replace"))


def _type_words(name: str, kind: int) -> int:
    if kind not in _WORDS:
        raise ValueError(f"matrix {name} is of type {kind}, which isn't 1 to 4")
    return _WORDS[kind]


def matrix_of_entries(name: str, shape: tuple[int, int], entries: Entries) -> sp.csr_array:
    """Return the matrix of columns of entries, or raise ``ValueError`` if they don't lie in its shape."""
    rows, columns, values = (np.concatenate([np.zeros(0), *each]) for each in entries)
    return sum_entries(f"matrix {name}", shape, rows.astype(np.int64), columns.astype(np.int64), values)


def sum_entries(what: str, shape: tuple[int, ...], row: IntArray, column: IntArray, values: Array) -> sp.csr_array:
    """Sum entries into a matrix; check indices first, since SciPy writes out of range otherwise."""
    if max(shape) > MOST_MATRIX_ROWS:
        raise ValueError(f"{what} has {shape[0]} rows and {shape[1]} columns, over {MOST_MATRIX_ROWS:.0e}")
    if len(row) and not (row.min() >= 0 and row.max() < shape[0] and column.min() >= 0 and column.max() < shape[1]):
        raise ValueError(f"{what} has entries outside of its {shape[0]} rows and {shape[1]} columns")
    return sp.csr_array((values, (row, column)), shape=shape)


def _read_binary(content: bytes, order: str) -> dict[str, sp.csr_array]:
    """Read matrices from Fortran's records, each between two words with its length."""
    records, found = fortran_records(content, order, "OUTPUT4"), dict[str, sp.csr_array]()
    for head in records:
        if len(head) != _HEADER.size:
            raise ValueError("it isn't an OUTPUT4 file: a matrix begins with a record of 24 bytes")
        n_columns, n_rows, _, kind, given = struct.unpack(f"{order}4i8s", head)
        name = given.decode("ascii", errors="replace").strip()
        words = _type_words(name, kind)
        number = np.dtype(f"{order}f{4 * words}")
        entries: Entries = ([], [], [])
        for record in records:
            (column, row, n_words), data = _integers(record, 3, order), record[12:]
            if column > n_columns:
                break
            if len(data) < 4 * n_words:
                raise ValueError(f"column {column} of matrix {name} is cut off")
            if row:
                add_entries(entries, column, row, np.frombuffer(data[: 4 * n_words], number))
                continue
            place = 0
            while place < 4 * n_words:
                if n_rows < 0:
                    length, row = _integers(data[place:], 2, order)
                    place, length = place + 8, length - 1
                else:
                    length, row = _string(*_integers(data[place:], 1, order))
                    place += 4
                if not 0 < length <= n_words:
                    raise ValueError(f"column {column} of matrix {name} has a string of {length} words")
                add_entries(entries, column, row, np.frombuffer(data[place : place + 4 * length], number))
                place += 4 * length
        else:
            raise ValueError(f"matrix {name} is cut off")
        if kind in _REAL:
            found[name] = matrix_of_entries(name, (abs(n_rows), n_columns), entries)
    return found


def _integers(data: bytes, count: int, order: str) -> tuple[int, ...]:
    """Return the integers that data begin with, or raise ``ValueError`` if there are fewer."""
    if len(data) < 4 * count:
        raise ValueError(f"a record ends after {len(data)} of {4 * count} bytes")
    return struct.unpack_from(f"{order}{count}i", data)


def fortran_records(content: bytes, order: str, kind: str) -> Iterator[bytes]:
    """Yield Fortran's records, each between two words with its length; ``ValueError`` if it isn't whole."""
    place = 0
    while place + 4 <= len(content):
        (length,) = struct.unpack(f"{order}i", content[place : place + 4])
        end = place + 4 + length
        if length < 0 or content[end : end + 4] != content[place : place + 4]:
            raise ValueError(f"it is cut off, or isn't an {kind} file of Fortran's records")
        yield content[place + 4 : end]
        place = end + 4


def _string(word: int) -> tuple[int, int]:
    """Return length in words and first row of a string from the one word that has both."""
    length, row = divmod(word, 65536)
    return length - 1, row


def add_entries(entries: Entries, column: int, row: int, values: Array) -> None:
    """Add numbers of a column from a row on, both counted from 1."""
    entries[0].append(row - 1 + np.arange(len(values)))
    entries[1].append(np.full(len(values), column - 1))
    entries[2].append(values.astype(float))


def _read_text(text: str) -> dict[str, sp.csr_array]:
    lines, found = iter(text.splitlines()), dict[str, sp.csr_array]()
    for head in lines:
        if not head.strip():
            continue
        try:
            n_columns, n_rows, _, kind = (int(head[k : k + 8]) for k in (0, 8, 16, 24))
        except ValueError:
            raise ValueError(f"'{head[:60]}' isn't the header of an OUTPUT4 matrix") from None
        name = head[32:40].strip()
        words = _type_words(name, kind)
        of_line = re.search(r"(\d+)[ED](\d+)\.\d+", head[40:].upper())
        width = int(of_line[2]) if of_line else 16
        try:
            matrix = _text_matrix(lines, (n_columns, n_rows), words, width)
            size = abs(n_rows), n_columns
            found |= {name: matrix_of_entries(name, size, matrix)} if kind in _REAL else {}
        except (StopIteration, ValueError, IndexError) as error:
            raise ValueError(f"matrix {name} is damaged or cut off: {str(error) or 'the file ends'}") from None
    return found


def _text_matrix(lines: Iterator[str], size: tuple[int, int], words: int, width: int) -> Entries:
    n_columns, n_rows = size
    entries: Entries = ([], [], [])
    while True:
        line = next(lines)
        column, row, n_words = (int(line[k : k + 8]) for k in (0, 8, 16))
        if column > n_columns:
            next(lines, None)
            return entries
        if row:
            add_entries(entries, column, row, _numbers(lines, n_words, width))
            continue
        while n_words > 0:
            head = next(lines)
            if n_rows < 0:
                length, row = int(head[:8]) - 1, int(head[8:16])
                n_words -= 2
            else:
                length, row = _string(int(head))
                n_words -= 1
            if not 0 < length <= n_words:
                raise ValueError(f"column {column} has a string of {length} words")
            add_entries(entries, column, row, _numbers(lines, length // words, width))
            n_words -= length


def _numbers(lines: Iterator[str], count: int, width: int) -> Array:
    """Read numbers of a width, which may touch one another."""
    found: list[float] = []
    while len(found) < count:
        line = next(lines)
        found += [read_real(line[k : k + width].strip()) for k in range(0, len(line.rstrip()), width)]
    if len(found) > count:
        raise ValueError(f"a line has {len(found) - count} numbers too many")
    return np.array(found)


def read_dmig(text: str) -> dict[str, dict[tuple[int, int, int, int], float]]:
    """Read the real, square matrices of DMIG cards: numbers by grid point and component of row and of column.

    Symmetric ones, form 6, have one of each pair in the file, and both in what is returned.

    Raises
    ------
    ValueError
        A card is damaged.
    """
    found: dict[str, dict[tuple[int, int, int, int], float]] = {}
    forms: dict[str, str] = {}
    for line, card, fields in read_cards(text):
        if card != "DMIG":
            continue
        try:
            name = fields[0].upper()
            if fields[1] == "0":
                forms[name] = fields[2]
                if forms[name] in (_SYMMETRIC, _SQUARE) and int(fields[3]) in _REAL:
                    found[name] = {}
                continue
            if forms[name] and name not in found:
                continue
            column = int(fields[1]), int(fields[2] or 0)
            for k in range(4, len(fields) - 3, 4):
                if not fields[k]:
                    continue
                key = (int(fields[k]), int(fields[k + 1] or 0), *column)
                found[name][key] = read_field(fields[k + 2])
                if forms[name] == _SYMMETRIC:
                    found[name][key[2:] + key[:2]] = found[name][key]
        except (KeyError, IndexError) as error:
            raise ValueError(f"line {line}: DMIG without its header or its fields: {error}") from None
    return found


def choose_matrix(names: Mapping[str, object], what: str) -> str:
    """Return the name of a file's stiffness or mass matrix, which begins with K or M; a matrix alone is the one.

    Raises
    ------
    ValueError
        There is none, or there are several.
    """
    letter = what[0].replace("s", "K").replace("m", "M")
    of_kind = [name for name in names if name.upper().lstrip("0123456789").startswith(letter)]
    chosen = of_kind if len(names) > 1 else list(names)
    if len(chosen) != 1:
        listed = ", ".join(names) or "none"
        raise ValueError(f"which matrix is the {what}? One whose name begins with {letter} is taken; it has {listed}")
    return chosen[0]
