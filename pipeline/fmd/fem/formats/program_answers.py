"""Answers of another program for a body that is given by its matrices: stress and geometric stiffness."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import IntArray
from fmd.core.errors import AccuracyError, InputError, as_input_error
from fmd.core.limits.files import NOT_SCALAR
from fmd.fem.formats import abaqus
from fmd.fem.formats.deck_surface import deck_surface
from fmd.fem.formats.matrix_model import MatrixModel, StressedStiffness, StressFields
from fmd.fem.formats.matrix_readers import read_matrix
from fmd.fem.formats.node_places import read_matrix_text
from fmd.fem.formats.program_fields import ProgramFields, read_csv_fields, read_frd
from fmd.fem.surface import SurfaceTopology

_READERS: dict[str, Callable[[str], ProgramFields]] = {".frd": read_frd, ".csv": read_csv_fields}


def read_stress(model: MatrixModel, path: Path, nodes: Path, units: tuple[float, float]) -> MatrixModel:
    """Return a body with the stress of displacements from a file.

    Parameters
    ----------
    path : Path
        CalculiX's results (``.frd``), or rows of case, node, displacements and stresses (``.csv``).
    nodes : Path
        The body's nodes; a deck's elements give the surface.
    units : tuple of float
        The file's units of length [m] and stress [Pa].

    Raises
    ------
    InputError
        The file can't be read, or has nodes that the body hasn't.
    """
    if path.suffix.lower() not in _READERS:
        raise InputError(str(path), "", None, f"stress is read from {' and '.join(_READERS)}")
    with as_input_error(str(path)):
        found = _READERS[path.suffix.lower()](read_matrix_text(path))
    place = {int(label): k for k, label in enumerate(model.labels)}
    if other := [int(label) for label in found.labels if int(label) not in place]:
        mend = f"has node {other[0]} (and {len(other) - 1} more), which isn't among the nodes"
        raise InputError(str(path), "", None, mend)
    own = np.array([place[int(label)] for label in found.labels])
    order = np.argsort(own)
    known = own[order]
    u, stress = found.displacement[order] * units[0], found.stress[order] * units[1]
    return replace(model, fields=StressFields(path.name, known, u, stress, *_surface(model, nodes, known)))


def _surface(model: MatrixModel, nodes: Path, known: IntArray) -> tuple[SurfaceTopology, str]:
    """Return the surface of a deck's solids if stress is known at all of its nodes; else one of nodes, and why."""
    alone = SurfaceTopology(known, *(np.zeros((0, n), dtype=int) for n in (3, 2)))
    untold = (
        "has nodes without solid elements: the deck (.inp) of Abaqus or CalculiX that its matrices are of tells them"
    )
    if nodes.suffix.lower() not in abaqus.SUFFIXES:
        return alone, untold
    raw = abaqus.read_abaqus(read_matrix_text(nodes))
    order = np.argsort(model.labels)
    place = order[np.searchsorted(model.labels[order], raw.numbers).clip(max=len(order) - 1)]  # of elements' nodes
    surface = deck_surface(model.x, [(kind, place[cells]) for kind, cells in raw.blocks])
    if surface is None:
        return alone, untold
    missing = model.labels[np.setdiff1d(surface.nodes, known)]
    if len(missing):
        return alone, f"has no stress at node {missing[0]} (and {len(missing) - 1} more) of its surface"
    return surface, ""


def read_geometric_stiffness(model: MatrixModel, paths: Sequence[Path], unknowns: int, unit: float) -> MatrixModel:
    """Return a body with its geometric stiffness under the loads of some files, one load each.

    Parameters
    ----------
    paths : sequence of Path
        Matrices in any of the formats of `read_matrices`: geometric stiffness alone, or with the stiffness in it.
    unit : float
        The files' unit of stiffness [N/m].

    Raises
    ------
    InputError
        A file can't be read.
    AccuracyError
        A matrix isn't that of a stress: it holds back translations or differs between directions.
    """
    if unknowns != 3:
        what = "geometric stiffness is read for three unknowns a node; with rotations leave it out"
        raise InputError(str(paths[0]), "", None, what)
    matrices = tuple(_scalar(path, model, read_matrix(path, model.labels, 3, "stiffness") * unit) for path in paths)
    return replace(model, stressed=StressedStiffness(f"{paths[0].name} … {paths[-1].name}", matrices))


def _scalar(path: Path, model: MatrixModel, A: sp.csr_array) -> sp.csr_array:
    """Return k of ``A = k ⊗ 1₃`` or ``A = K + k ⊗ 1₃``, whichever is a geometric stiffness."""
    found = [_mean_of_directions(A), _mean_of_directions(sp.csr_array(A - model.K))]
    k, apart, pushed = min(found, key=lambda one: max(one[1:]))
    if not max(apart, pushed) < NOT_SCALAR:
        raise AccuracyError(
            f"{path}: no geometric stiffness: of its largest entry directions differ by {apart:.1e}, and a translation "
            f"has a force of {pushed:.1e} (at most {NOT_SCALAR:.0e}); a program that adds terms of the displacement "
            "takes the stress as initial stress, as the decks of fmd export --to load-cases have it"
        )
    return k


def _mean_of_directions(A: sp.csr_array) -> tuple[sp.csr_array, float, float]:
    """Return the mean k of a matrix's three directions, how far it is from ``k ⊗ 1₃``, and the force of a translation.

    Both are parts of the largest entry.
    """
    entries = sp.coo_array(A)
    (row, a), (column, b) = (np.divmod(index, 3) for index in entries.coords)
    n = A.shape[0] // 3
    own = [
        sp.csr_array((entries.data[mine], (row[mine], column[mine])), shape=(n, n))
        for mine in ((a == b) & (a == axis) for axis in range(3))
    ]
    k = sp.csr_array((own[0] + own[1] + own[2]) / 3)
    size = abs(k).max() if k.nnz else 0.0
    if not size > 0.0:
        return k, np.inf, np.inf
    apart = max(np.abs(entries.data[a != b]).max(initial=0.0), *(abs(one - k).max() for one in own)) / size
    return sp.csr_array(0.5 * (k + k.T)), float(apart), float(np.abs(k.sum(axis=0)).max() / size)
