"""Matrices with displacement and rotation at each node, as a model of points that carry mass.

A node with rotations moves points on arms around it: u = T y, where y are the displacements of all nodes and behind
them the rotations. Stiffness acts on the points by the displacement and the rotation that they show, ``Sᵀ K S`` with
``S T = 1``, and so ``Tᵀ Sᵀ K S T`` is the given matrix. Of the masses, what is alike in all directions between
displacements of two nodes stays. The rest is lumped: forces and moments on a node that rigid motions of the whole body
cause become those of a rigid body on the node. The inertia of the whole is exact by that.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import EPSILON, Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits.files import ISOTROPIC
from fmd.core.rotations import rigid_motions
from fmd.fem.arms import Arms, second_of_rigid
from fmd.fem.formats.matrix_model import MatrixModel
from fmd.fem.links import arms_marker, rigid_body_points
from fmd.fem.markers import Marker


@dataclass(frozen=True)
class SixUnknownsModel(MatrixModel):
    """A model of points by matrices with rotations."""

    # (n, n): the stiffness as the file has it, by y, displacements of all nodes and rotations of those that turn
    given_stiffness: sp.csr_array
    given_mass: sp.csr_array  # (n, n): the mass matrix as the file has it, by y
    shown: sp.csr_array  # (n, 3 n_points): unknowns y by the displacements of points, S
    # (n_nodes,): number of the first of the seven points around each node; -1 for a node without rotations
    turning: IntArray

    def name_point(self, k: int) -> str:
        """Return what a message calls point k: the number of the node that moves it."""
        node = k if k < len(self.turning) else np.flatnonzero(self.turning >= 0)[(k - len(self.turning)) // 7]
        return super().name_point(int(node))

    def unknowns(self, shapes: Array) -> Array:
        """Return displacements of all nodes and rotations of those that turn, by displacements of points."""
        return np.asarray(self.shown @ super().unknowns(shapes))

    def given(self, A: sp.csr_array, length: float) -> sp.csr_array:
        """Return another matrix (6 n_nodes, 6 n_nodes) of files with a unit of length [m] by these unknowns.

        Raises
        ------
        ValueError
            It has entries for rotations of nodes that have none.
        """
        n = len(self.labels)
        order = _order(n, np.flatnonzero(self.turning >= 0))
        if (kept := sp.csr_array(A[order][:, order])).count_nonzero() < A.count_nonzero():
            other = np.setdiff1d(abs(A).sum(axis=1).nonzero()[0], order)
            raise ValueError(f"node {self.labels[other[0] // 6]} turns in it, and not in the stiffness")
        arm = sp.diags_array(np.where(np.arange(len(order)) < 3 * n, 1.0, length))
        return sp.csr_array(arm @ kept @ arm)

    def rigid_by_node(self) -> Array:
        """Return rigid motions by displacement and rotation of each node, (6 n_nodes, 6); 0 for one that has none."""
        x = self.x[: len(self.labels)]
        turned = np.eye(6)[3:] * (self.turning >= 0)[:, None, None]
        return np.concatenate([rigid_motions(x), turned], axis=1).reshape(-1, 6)

    def loads_of_nodes(self, forces: Array, length: float) -> Array:
        """Return forces and moments of nodes (n_nodes, 6) that forces on points (n_points, 3) are."""
        n, turns = len(self.labels), np.flatnonzero(self.turning >= 0)
        own = (_maps(self.positions, self.x[:n], turns)[0].T @ forces.ravel()).reshape(-1, 3)
        loads = np.concatenate([own[:n], np.zeros((n, 3))], axis=1)
        loads[turns, 3:] = own[n:] / length
        return loads

    def rigid_unknowns(self) -> Array:
        """Return the six rigid motions about the nodes' middle by these unknowns, (n, 6)."""
        x = self.x[: len(self.labels)]
        return _rigid(x - x.mean(axis=0), np.flatnonzero(self.turning >= 0))

    def turning_marker(self, node: int) -> Marker | None:
        """Return the marker at a node that has rotations, by its place among the nodes; ``None`` if it has none."""
        if self.turning[node] < 0:
            return None
        points = np.concatenate([[node], self.turning[node] + np.arange(1, 7)])
        around = self.positions[self.turning[node] + np.arange(7)]
        return replace(arms_marker(points, around), position=self.positions[node])

    def frequency_changes(self, shapes: Array) -> Array:
        """Return relative changes (n,) of the frequencies of modes (n_points, 3, n) by lumping, to first order.

        The modes have unit mass by the points.
        """
        y = self.unknowns(shapes)
        return np.asarray(np.sqrt(np.einsum("ij,ij->j", y, self.given_mass @ y)) - 1.0)


def six_unknowns_model(
    path: Path, K: sp.csr_array, M: sp.csr_array, x: Array, labels: IntArray, turned: IntArray | None = None
) -> SixUnknownsModel:
    """Make the model of symmetric matrices with six unknowns a node, (6 n_nodes, 6 n_nodes).

    Unknown ``6 i + a`` is displacement (0, 1, 2) or rotation (3, 4, 5) of node i. Nodes ``turned``, references of
    links, have rotations even if their rows are zero. Messages name the file of the masses.

    Raises
    ------
    AccuracyError
        Masses aren't those of matter; with the figure.
    """
    n = len(x)
    stored = np.asarray(abs(K).sum(axis=1) + abs(M).sum(axis=1)).reshape(n, 6)
    turns = np.flatnonzero(stored[:, 3:].any(axis=1))
    turns = turns if turned is None else np.union1d(turns, turned)
    order = _order(n, turns)
    K, M = (sp.csr_array(A[order][:, order]) for A in (K, M))
    m, rest = _alike(M, n, turns)
    mass, centre, inertia = _lumps(rest, x, turns, ISOTROPIC * float(abs(M).max()))
    length = float(np.sqrt(np.ptp(x, axis=0) @ np.ptp(x, axis=0)) / max(len(x), 1) ** (1 / 2))
    weights, groups, own = np.zeros(n), [np.zeros((0, 3))], mass.copy()
    own[turns] = 0.0
    for node in turns:
        places, each = rigid_body_points(float(mass[node]), inertia[node], length)
        groups.append(x[node] + centre[node] + places)
        weights = np.concatenate([weights, each])
    weights[:n] = own
    points = np.concatenate([x, *groups])
    T, shown, arms = _maps(points, x, turns)
    m.resize((len(points), len(points)))
    model = SixUnknownsModel(
        None,  # type: ignore[arg-type]
        None,  # type: ignore[arg-type]
        sp.csr_array(shown.T @ K @ shown),
        sp.csr_array(m + sp.diags_array(weights)),
        points,
        labels,
        K,
        M,
        shown,
        np.where(np.isin(np.arange(n), turns), n + 7 * np.searchsorted(turns, np.arange(n)), -1),
        T=T,
        arms=arms if len(turns) else None,
    )
    _require_inertia(path, model, n)
    return model


def _order(n: int, turns: IntArray) -> IntArray:
    """Return the places of the unknowns y among six a node."""
    return np.concatenate([6 * np.arange(n)[:, None] + np.arange(3), 6 * turns[:, None] + np.arange(3, 6)]).ravel()


def _alike(M: sp.csr_array, n: int, turns: IntArray) -> tuple[sp.csr_array, sp.csr_array]:
    """Split masses into those alike in all directions, a scalar matrix (n, n), and the rest of M.

    The rest has the own masses of turning nodes, which may have a centre beside the node.
    """
    blocks = sp.bsr_array(sp.csr_array(M[: 3 * n, : 3 * n]), blocksize=(3, 3))
    mean = np.einsum("kaa->k", blocks.data) / 3
    apart = np.abs(blocks.data - mean[:, None, None] * np.eye(3)).max(axis=(1, 2))
    alike = np.where(apart <= ISOTROPIC * np.abs(blocks.data).max(axis=(1, 2)), mean, 0.0)
    row = np.repeat(np.arange(n), np.diff(blocks.indptr))
    alike[(row == blocks.indices) & np.isin(row, turns)] = 0.0
    m = sp.csr_array((alike, blocks.indices, blocks.indptr), shape=(n, n))
    of_all = sp.csr_array(sp.kron(m, sp.eye_array(3)))
    of_all.resize(M.shape)
    return m, sp.csr_array(M - of_all)


def _lumps(M: sp.csr_array, x: Array, turns: IntArray, least: float) -> tuple[Array, Array, Array]:
    """Return mass (n,), centre from the node (n, 3) and inertia about it (n, 3, 3) of a rigid body on each node.

    A node with a mass below ``least`` [kg] has none, and no centre.
    """
    n = len(x)
    R = _rigid(x, turns)
    blocks = np.zeros((n, 6, 6))
    felt = (M @ R).reshape(-1, 3, 6)
    blocks[:, :3], blocks[turns, 3:] = felt[:n], felt[n:]
    back = np.zeros((n, 6, 6))  # from motions about the origin to those about each node
    back[:, [0, 1, 2, 3, 4, 5], [0, 1, 2, 3, 4, 5]] = 1.0
    back[:, :3, 3:] = -rigid_motions(x)[:, :, 3:]
    blocks = blocks @ back
    mass = np.einsum("naa->n", blocks[:, :3, :3]) / 3
    mass[np.abs(mass) < least] = 0.0
    across = 0.5 * (blocks[:, 3:, :3] + blocks[:, :3, 3:].swapaxes(1, 2))
    moment = -0.5 * np.einsum("abc,nab->nc", EPSILON, across)  # m c̃ has m c as its axial vector
    centre = moment / np.where(mass != 0, mass, np.inf)[:, None]
    about_node = 0.5 * (blocks[:, 3:, 3:] + blocks[:, 3:, 3:].swapaxes(1, 2))
    square = np.einsum("na,na->n", centre, centre)[:, None, None] * np.eye(3)
    inertia = about_node - mass[:, None, None] * (square - np.einsum("na,nb->nab", centre, centre))
    return mass, centre, inertia


def _rigid(x: Array, turns: IntArray) -> Array:
    """Return rigid motions of the unknowns y: displacements of nodes, then rotations, shape (3 n + 3 n_turning, 6)."""
    turned = np.concatenate([np.zeros((3, 3)), np.eye(3)]).T
    return np.concatenate([rigid_motions(x).reshape(-1, 6), np.tile(turned, (len(turns), 1))])


def _maps(points: Array, x: Array, turns: IntArray) -> tuple[sp.csr_array, sp.csr_array, Arms]:
    """Return T of points by unknowns, S of unknowns by points, and the arms, seven points around each turning node."""
    n, k = len(x), len(turns)
    nodes = np.repeat(turns, 7)
    r = points[n:] - x[nodes]
    moves = rigid_motions(r)  # (7 k, 3, 6)
    turned = n + np.repeat(np.arange(k), 7)
    columns = np.concatenate([3 * nodes[:, None] + np.arange(3), 3 * turned[:, None] + np.arange(3)], axis=1)
    rows = 3 * (n + np.arange(7 * k))[:, None, None] + np.arange(3)[:, None] + np.zeros((1, 1, 6), dtype=int)
    entries = moves.ravel(), (rows.ravel(), np.repeat(columns[:, None], 3, axis=1).ravel())
    n_all, n_own = 3 * len(points), 3 * (n + k)
    unit = sp.csr_array((np.ones(3 * n), (np.arange(3 * n), np.arange(3 * n))), shape=(n_all, n_own))
    T = sp.csr_array(unit + sp.csr_array(entries, shape=(n_all, n_own)))
    around = points[n:].reshape(k, 7, 3)
    arms = around - around[:, :1]
    square = (arms**2).sum(axis=(1, 2)) / 6
    rotation = np.einsum("acb,kpc->kapb", EPSILON, arms) / (4 * square[:, None, None, None])
    place = 3 * (n + np.arange(7 * k)).reshape(k, 1, 7, 1) + np.arange(3) + np.zeros((1, 3, 1, 1), dtype=int)
    row = np.broadcast_to((3 * np.arange(k)[:, None] + np.arange(3))[:, :, None, None], rotation.shape)
    turn = sp.csr_array((rotation.ravel(), (row.ravel(), place.ravel())), shape=(3 * k, n_all))
    shown = sp.csr_array(sp.vstack([sp.csr_array(unit.T[: 3 * n]), turn]))
    number = np.repeat(np.arange(k), 7)
    return T, shown, Arms(n + np.arange(7 * k), number, turn, second_of_rigid(r))


def _require_inertia(path: Path, model: SixUnknownsModel, n: int) -> None:
    """Raise ``AccuracyError`` if the points' mass and inertia aren't those of the matrix."""
    x = model.x[:n] - model.x[:n].mean(axis=0)
    size = float(np.ptp(x, axis=0).max())
    turns = np.flatnonzero(model.turning >= 0)
    R = _rigid(x / size, turns)
    R[3 * n :] /= size
    T = model.T
    assert T is not None
    if not model.mass > 0:
        raise AccuracyError(f"{path}: no mass matrix: its sum is {model.mass:.3g} kg")
    given, found = (R.T @ (A @ R) for A in (model.given_mass, T.T @ model.M @ T))
    apart = float(np.abs(given - found).max() / np.abs(given).max())
    if not apart < ISOTROPIC:
        raise AccuracyError(
            f"{path}: mass and inertia of the whole differ by {apart:.1e} from those of rigid bodies on its nodes (at "
            f"most {ISOTROPIC:.0e}): masses depend on the direction, or rotations aren't in rad"
        )
