"""Answers of another program for a body that is given by its matrices: stress and geometric stiffness."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError, InputError, as_input_error
from fmd.core.limits.files import NOT_SCALAR
from fmd.fem.formats import abaqus
from fmd.fem.formats.deck_surface import deck_surface
from fmd.fem.formats.matrix_model import MatrixModel, StressedStiffness, StressFields
from fmd.fem.formats.matrix_readers import read_matrix
from fmd.fem.formats.node_places import read_matrix_text
from fmd.fem.formats.program_fields import ProgramFields, read_csv_fields, read_frd
from fmd.fem.formats.six_unknowns import SixUnknownsModel
from fmd.fem.surface import SurfaceTopology

_READERS: dict[str, Callable[[str], ProgramFields]] = {".frd": read_frd, ".csv": read_csv_fields}


def read_stress(model: MatrixModel, path: Path, nodes: Path, units: tuple[float, float]) -> MatrixModel:
    """Return a body with the stress of displacements from a file.

    The file is CalculiX's results (``.frd``), or rows of case, node, displacements and stresses (``.csv``), in units of
    length [m] and stress [Pa]. If the body's nodes are in a deck, its elements give the surface.

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


def read_geometric_stiffness(model: MatrixModel, paths: Sequence[Path], units: tuple[float, float]) -> MatrixModel:
    """Return a body with its geometric stiffness under the loads of some files, one load each.

    They are in any of the formats of `read_matrices`, of geometric stiffness alone or with the stiffness in it, in
    units of length [m] and stiffness [N/m].

    Raises
    ------
    InputError
        A file can't be read, or has rotations that the body hasn't.
    AccuracyError
        A matrix isn't that of a stress: it holds back translations, or a rotation doesn't turn its load.
    """
    turns = isinstance(model, SixUnknownsModel)
    each = list[tuple[sp.csr_array, Array]]()
    for path in paths:
        A = read_matrix(path, model.labels, 6 if turns else 3, "stiffness") * units[1]
        if isinstance(model, SixUnknownsModel):
            with as_input_error(str(path)):
                A = model.given(A, units[0])
            alone = sp.csr_array(A - model.given_stiffness)  # the larger of both has the stiffness in it
            found = [_turned_loads(model, min((A, alone), key=lambda one: float(abs(one).max())))]
        else:
            found = [_mean_of_directions(model.x, A), _mean_of_directions(model.x, sp.csr_array(A - model.K))]
        k, load, faults = min(found, key=lambda one: max(one[2].values()))
        if not max(faults.values()) < NOT_SCALAR:
            faulty = ", ".join(f"{what} {size:.1e}" for what, size in faults.items())
            raise AccuracyError(
                f"{path}: no geometric stiffness: of its largest entry {faulty} (at most {NOT_SCALAR:.0e}); a program "
                "that adds terms of the displacement takes the stress as initial stress, as the decks of fmd export "
                "--to load-cases have it"
            )
        each.append((k, load))
    matrices, loads = zip(*each, strict=True)
    files = f"{paths[0].name} … {paths[-1].name}"
    return replace(model, stressed=StressedStiffness(files, matrices, np.stack(loads, axis=1)))


def _turned_loads(model: SixUnknownsModel, A: sp.csr_array) -> tuple[sp.csr_array, Array, dict[str, float]]:
    """Return a matrix, the load on points that its rotations tell, and how far it is from the stiffness of a stress.

    The energy of a stress is that of displacements and of rotation vectors, so a rotation ``e`` of the whole turns
    forces f by ``e × f`` and moments m by ``½ e × m``.
    """
    A, R, axes, n = sp.csr_array(0.5 * (A + A.T)), model.rigid_unknowns(), np.eye(3), len(model.labels)
    length = float(np.ptp(model.x[:n], axis=0).max())
    R[:, :3] *= length
    felt, size = (A @ R).reshape(-1, 3, 6), (abs(A) @ np.abs(R)).reshape(-1, 3, 6)
    turned = 0.5 * np.cross(felt[:, :, 3:], axes[:, None], axisa=1, axisb=0, axisc=1).sum(axis=2)
    off = np.concatenate([felt[:, :, :3], felt[:, :, 3:] - np.cross(axes, turned[:, None]).swapaxes(1, 2)], axis=2)
    for each in (off, size):
        each[:n] *= length  # forces beside moments
    largest = size.max() if A.nnz else 0.0
    faults = [float(np.abs(off[:, :, k : k + 3]).max()) / largest if largest else np.inf for k in (0, 3)]
    turned[n:] *= 2
    named = dict(zip(("a translation has a force of", "a rotation doesn't turn its load by"), faults, strict=True))
    return A, np.asarray(model.shown.T @ turned.ravel()), named


def _mean_of_directions(x: Array, A: sp.csr_array) -> tuple[sp.csr_array, Array, dict[str, float]]:
    """Return the mean k of a matrix's three directions, its load, and how far it is from ``k ⊗ 1₃`` of a stress.

    Since ``k (θ × x) = θ × f`` for any rotation, its load is ``k x``.
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
        return k, np.zeros(3 * n), {"directions differ by": np.inf}
    apart = max(np.abs(entries.data[a != b]).max(initial=0.0), *(abs(one - k).max() for one in own)) / size
    pushed = float(np.abs(k.sum(axis=0)).max() / size)
    k = sp.csr_array(0.5 * (k + k.T))
    return k, (k @ x).ravel(), {"directions differ by": float(apart), "a translation has a force of": pushed}
