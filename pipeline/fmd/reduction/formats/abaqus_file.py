"""Substructures of Abaqus as ``*SUBSTRUCTURE MATRIX OUTPUT, OUTPUT FILE=USER DEFINED`` writes them.

The file is the definition of a linear user element (Abaqus Keywords Reference, ``*USER ELEMENT`` and ``*MATRIX``): its
nodes in a comment, the components of the first node and, from a node's place in that list on, those of the others, and
one half of each matrix, row by row.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.files import read_text
from fmd.core.fortran import read_real
from fmd.reduction.formats.body_format import BodyFormat
from fmd.reduction.given_superelement import GivenSuperelement

_NODES = re.compile(r"\*\*\s*ELEMENT\s+NODES", re.I)
_LISTED = re.compile(r"\*\*[\s\d,]+")  # a comment of numbers alone


def read_substructure(path: Path) -> GivenSuperelement:
    """Read a substructure, whose nodes have no places yet.

    Raises
    ------
    InputError
        The file is of another kind, is cut off, or lacks the mass, as CalculiX's does.
    """
    try:
        return _substructure(read_text(path).splitlines())
    except (ValueError, IndexError, OverflowError) as error:
        raise InputError(str(path), "", None, f"is no substructure as Abaqus writes it: {error}") from None


def _substructure(lines: Sequence[str]) -> GivenSuperelement:
    nodes, components, values = list[int](), list[list[float]](), dict[str, list[float]]()
    block, listing = "", False
    for line in map(str.strip, lines):
        if line.startswith("**"):
            listing = bool(_NODES.match(line)) or (listing and bool(_LISTED.fullmatch(line)))
            nodes += map(int, re.findall(r"\d+", line)) if listing else ()
        elif line.startswith("*"):
            card = line.upper().replace(" ", "")
            kind = re.search(r"TYPE=(\w+)", card)
            block = kind[1] if kind and card.startswith("*MATRIX") else card.split(",")[0]
        elif line:
            items = [read_real(item) for item in re.split(r"[,\s]+", line.strip(", "))]
            if block == "*USERELEMENT":
                components.append(items)
            else:
                values.setdefault(block, []).extend(items)
    if not (nodes and components and values):
        raise ValueError("it has no list '** ELEMENT NODES', no components or no *MATRIX")
    if missing := [what for what in ("STIFFNESS", "MASS") if what not in values]:
        raise ValueError(
            f"it has no *MATRIX,TYPE={missing[0]}; write it with MASS=YES. CalculiX writes the stiffness alone: take "
            "its matrices, .sti and .mas, as matrices of a body"
        )
    unknowns = _unknowns(nodes, components)
    K, M = (_half(values[what], len(unknowns), what) for what in ("STIFFNESS", "MASS"))
    D = _half(values["VISCOUSDAMPING"], len(K), "VISCOUSDAMPING") if "VISCOUSDAMPING" in values else 0 * K
    return GivenSuperelement(unknowns, K, M, D)


def _unknowns(nodes: Sequence[int], lines: Sequence[Sequence[float]]) -> tuple[tuple[int, int], ...]:
    """Return node and component of each unknown; each line but the first begins with the place that it holds from."""
    starts = {1: [int(item) for item in lines[0]]} | {int(line[0]): [int(c) for c in line[1:]] for line in lines[1:]}
    own, found = list[int](), list[tuple[int, int]]()
    for place, node in enumerate(nodes, start=1):
        own = starts.get(place, own)
        found += [(node, component) for component in own]
    return tuple(found)


def _half(values: Sequence[float], n: int, what: str) -> Array:
    """Return a symmetric matrix from its lower half, row by row."""
    if len(values) != n * (n + 1) // 2:
        raise ValueError(f"TYPE={what} has {len(values)} numbers; one half of {n} rows has {n * (n + 1) // 2}")
    A = np.zeros((n, n))
    A[np.tril_indices(n)] = values
    return A + np.tril(A, -1).T


FORMAT = BodyFormat(read_superelement=read_substructure)
