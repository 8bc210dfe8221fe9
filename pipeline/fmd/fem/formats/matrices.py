"""Bodies given by another program's stiffness and mass matrices and its nodes' positions."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError, InputError, as_input_error
from fmd.core.limits.files import IN_LINE, ISOTROPIC, SYMMETRIC
from fmd.core.limits.mesh import FACE_IN_PLANE
from fmd.fem.connections import Connections
from fmd.fem.formats import abaqus, ansys
from fmd.fem.formats.free_body import require_free_body
from fmd.fem.formats.matrix_model import MatrixModel
from fmd.fem.formats.matrix_readers import read_matrix
from fmd.fem.formats.nastran import SUFFIXES as DECKS
from fmd.fem.formats.nastran import read_grid_points
from fmd.fem.formats.node_places import read_matrix_text, read_node_table
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh
from fmd.fem.formats.six_unknowns import SixUnknownsModel, six_unknowns_model
from fmd.fem.formats.tied_matrices import references, tie_matrices
from fmd.fem.markers import Marker, weighted_marker


def read_matrices(
    stiffness: Path, mass: Path, nodes: Path, units: tuple[float, float, float], unknowns: int = 3
) -> MatrixModel:
    """Read a body's matrices and check that they are those of a free body.

    Matrices are of Matrix Market (``.mtx``), SciPy's ``.npz``, or what Abaqus writes: rows of node, direction, node,
    direction, value (``FORMAT=MATRIX INPUT`` or ``LABELS``) or of row, column, value (``FORMAT=COORDINATE``). Rows and
    columns without node numbers are x, y, z of the first node in ``nodes``, then of the second; with six unknowns a
    node the rotations [rad] about x, y, z behind each. Nastran's OUTPUT4 (``.op4``) and OUTPUT2 (``.op2``), whose rows
    are of the nodes in ascending order, as those of CalculiX (``.sti``, ``.mas``) are, and DMIG cards (``.pch``); of
    several matrices in a file those whose names begin with K and M. Ansys' ``.full``, by node numbers.

    Nodes are rows of number, x, y, z, or a deck of Nastran, Abaqus, CalculiX or Ansys. Units are those of length [m],
    which rotations' entries take, too, stiffness [N/m] and mass [kg].

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
    with as_input_error(str(path)):
        return tie_matrices(model, deck)


def _read_nodes(path: Path) -> tuple[IntArray, Array, Connections]:
    """Read node numbers (n_nodes,) and positions (n_nodes, 3) in the file's unit, and a deck's connections."""
    if path.suffix.lower() in DECKS:
        with as_input_error(str(path), of=MeshFileError):
            return read_grid_points(read_matrix_text(path))
    if path.suffix.lower() in abaqus.SUFFIXES:
        return *_nodes_of_deck(path, abaqus.read_abaqus), Connections()
    if path.suffix.lower() in ansys.SUFFIXES:
        return *_nodes_of_deck(path, ansys.read_ansys), Connections()
    labels, x = read_node_table(path)
    if len(x) < 3:
        raise InputError(str(path), "", None, "needs three nodes at least, with finite coordinates")
    return labels, x, Connections()


def _nodes_of_deck(path: Path, read: Callable[[str], RawMesh]) -> tuple[IntArray, Array]:
    """Read the nodes of a deck's elements and masses, in ascending order, as CalculiX's rows are."""
    with as_input_error(str(path), of=MeshFileError):
        raw = read(read_matrix_text(path))
    found = raw.connections
    if joined := [*found.rigid, *found.mean, *found.equations, *found.ties]:
        what = "gives unknowns by others, which the matrices leave out; write them without"
        raise InputError(str(path), "", None, f"{joined[0].label} {what}")
    used = np.unique(np.concatenate([found.points, *(cells.ravel() for _, cells in raw.blocks)]))
    order = used[np.argsort(raw.numbers[used])]
    if len(order) < 3:
        raise InputError(str(path), "", None, "has no elements, whose nodes are wanted")
    return raw.numbers[order], raw.points[order]


def node_marker(model: MatrixModel, nodes: IntArray, rigid: bool = False) -> Marker:
    """Attach a marker to nodes, by the other program's numbers; all have one weight, as there are no areas.

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
    turned = [each.nodes for k in own.tolist() if rigid and (each := model.turning_marker(k)) is not None]
    if turned:  # with their rotations
        own = np.unique(np.concatenate([own, *turned]))
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
