"""Places of nodes by number, from tables and from decks of other programs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.core.files import read_text
from fmd.core.limits.files import MOST_MATRIX_BYTES
from fmd.fem.formats import abaqus
from fmd.fem.formats.nastran import SUFFIXES, grid_places
from fmd.fem.formats.raw_mesh import MeshFileError


def read_places(path: Path) -> dict[int, Array]:
    """Read the places of all nodes of a table, or of a deck of Nastran or Abaqus, in the file's unit.

    Raises
    ------
    InputError
        The file can't be read, or a node has no place in the deck's basic axes.
    """
    try:
        if path.suffix.lower() in SUFFIXES:
            return grid_places(read_matrix_text(path))
        if path.suffix.lower() in abaqus.SUFFIXES:
            raw = abaqus.read_abaqus(read_matrix_text(path))
            return dict(zip(raw.numbers.tolist(), raw.points, strict=True))
    except MeshFileError as error:
        raise InputError(str(path), "", None, str(error)) from error
    labels, x = read_node_table(path)
    return dict(zip(labels.tolist(), x, strict=True))


def read_node_table(path: Path) -> tuple[IntArray, Array]:
    """Read rows of a node's number, x, y and z: numbers (n,) and places (n, 3), in the file's order and unit.

    Raises
    ------
    InputError
        A row is of another form, or a node is given twice.
    """
    rows: list[list[float]] = []
    for number, line in enumerate(read_matrix_text(path).splitlines(), start=1):
        items = [item for item in re.split(r"[,;\s]+", line.strip()) if item]
        if not items or items[0].startswith(("#", "*")) or (not rows and not _is_number(items[0])):
            continue  # a comment or the header
        if len(items) != 4 or not all(map(_is_number, items)):
            raise InputError(str(path), f"line {number}", None, "must be a node's number, x, y and z")
        rows.append([float(item) for item in items])
    table = np.array(rows).reshape(-1, 4)
    if not len(table) or not np.isfinite(table).all():
        raise InputError(str(path), "", None, "needs nodes with finite coordinates")
    if np.abs(table[:, 0]).max() > 2**53 or len(np.unique(table[:, 0])) < len(table):
        raise InputError(str(path), "", None, "gives a node twice, or one without a number")
    return table[:, 0].astype(np.int64), table[:, 1:]


def read_matrix_text(path: Path) -> str:
    """Read a text file of a size that memory holds, or raise ``InputError``."""
    if path.is_file() and path.stat().st_size > MOST_MATRIX_BYTES:
        raise InputError(str(path), "", None, f"is over {MOST_MATRIX_BYTES / 1e9:g} GB")
    return read_text(path)


def _is_number(item: str) -> bool:
    try:
        float(item)
    except ValueError:
        return False
    return True
