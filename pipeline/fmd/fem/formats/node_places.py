"""Places of nodes by number, from tables and from decks of other programs."""

import re
from collections.abc import Mapping
from dataclasses import field
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError, as_input_error
from fmd.core.files import read_text
from fmd.core.fortran import read_field
from fmd.core.limits.files import MOST_MATRIX_BYTES
from fmd.fem.formats import abaqus
from fmd.fem.formats.coordinate_systems import BASIC, CoordinateSystems
from fmd.fem.formats.nastran import SUFFIXES, grid_systems, read_cards
from fmd.fem.formats.raw_mesh import MeshFileError


@dataclass(frozen=True)
class Places:
    """Places of nodes, as a file gives them."""

    places: Mapping[int, Array]  # (3,): by node number, in the file's unit
    # (3, 3): directions, as columns, of the unknowns of nodes that don't move along the basic axes
    axes: Mapping[int, Array] = field(default_factory=dict)
    # Node and component of an external superelement's unknowns, in their order, if the file lists them (EXTRN).
    unknowns: tuple[tuple[int, int], ...] = ()


def read_places(path: Path) -> Places:
    """Read the places of all nodes of a table, or of a deck of Nastran or Abaqus.

    Raises
    ------
    InputError
        The file can't be read, or a node is in a coordinate system that isn't read.
    """
    with as_input_error(str(path), of=MeshFileError):
        if path.suffix.lower() in (*SUFFIXES, ".pch", ".asm"):
            return nastran_places(read_matrix_text(path))
        if path.suffix.lower() in abaqus.SUFFIXES:
            raw = abaqus.read_abaqus(read_matrix_text(path))
            return Places(dict(zip(raw.numbers.tolist(), raw.points, strict=True)))
    labels, x = read_node_table(path)
    return Places(dict(zip(labels.tolist(), x, strict=True)))


def nastran_places(text: str) -> Places:
    """Return the grid points of bulk data, and the unknowns that its EXTRN cards list.

    Raises
    ------
    MeshFileError
        A card has fields that aren't numbers, or a system isn't rectangular.
    """
    cards = list(read_cards(text))
    systems = CoordinateSystems((name, fields) for _, name, fields in cards)
    places, axes, unknowns = dict[int, Array](), dict[int, Array](), list[tuple[int, int]]()
    default = next((fields for _, name, fields in cards if name == "GRDSET"), [])
    for line, name, fields in cards:
        try:
            if name == "GRID":
                number = int(fields[0])
                given, moves = grid_systems((fields[1], "".join(fields[5:6])), default)
                x = [read_field(item) for item in (*fields[2:5], "", "", "")[:3]]
                places[number] = systems.find(given).place(np.array(x))
                if (turned := systems.find(moves)) is not BASIC:
                    if not turned.is_straight:
                        raise MeshFileError(f"moves in coordinate system {moves}, which is no CORD2R")
                    axes[number] = turned.axes
            elif name == "EXTRN":
                for node, components in zip(fields[::2], fields[1::2], strict=False):
                    unknowns += [(int(node), int(c)) for c in components or "0"] if node else []
        except MeshFileError as error:
            raise MeshFileError(f"line {line}: {name} {fields[0]}: {error}") from None
        except (ValueError, IndexError):
            raise MeshFileError(f"line {line}: {name} has fields that aren't the numbers they should be") from None
    return Places(places, axes, tuple(unknowns))


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
    _require_size(path)
    return read_text(path)


def read_matrix_bytes(path: Path) -> bytes:
    """Read a binary file of a size that memory holds, or raise ``InputError``."""
    _require_size(path)
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(str(path), "", None, f"can't be read: {error.strerror or error}") from error


def _require_size(path: Path) -> None:
    if path.is_file() and path.stat().st_size > MOST_MATRIX_BYTES:
        raise InputError(str(path), "", None, f"is over {MOST_MATRIX_BYTES / 1e9:g} GB")


def _is_number(item: str) -> bool:
    try:
        float(item)
    except ValueError:
        return False
    return True
