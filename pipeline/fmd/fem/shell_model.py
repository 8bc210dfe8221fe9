"""The finite element model of a shell or of beams: points that move by displacement and rotation of nodes.

A point at r from its node moves by ``u + θ × r``. Where all points of a node lie on one line, its rotation about that
line moves none of them and is no unknown: smooth shells have five unknowns a node, and no stiffness against drilling is
made up. At folds and branches there are six. Mass is that of the layer between both faces, and so rotary inertia is in
it. The nodes themselves are points without mass, on which supports act.
"""

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.rotations import rigid_motions
from fmd.fem.arms import Arms, second_of_rigid
from fmd.fem.midsurface import Midsurface
from fmd.fem.model import FEModel


@dataclass(frozen=True)
class ShellModel(FEModel):
    """A finite element model of a shell or of beams: points of both faces, or of sections, and then the nodes."""

    positions: Array  # (n_points, 3): positions of all points [m]

    strained = False

    @property
    def x(self) -> Array:
        """Positions of all points, shape (n_points, 3) [m]."""
        return self.positions


def hang_on_nodes(layer: FEModel, midsurface: Midsurface) -> ShellModel:
    """Return the model of a shell or of beams from that of its layer of cells, whose points move freely."""
    nodes, owner = midsurface.nodes, midsurface.owner
    n_points, n_nodes = len(owner), len(nodes)
    arms = layer.x - nodes[owner]
    size, turns, node = _rotations(arms, owner, n_nodes, midsurface.alike)
    # u = 1 at the tip of an arm of mean length, for rotations as for displacements
    unit = turns / size[node, None]
    by_node = sp.csr_array((np.ones(len(node)), (node, np.arange(len(node)))), shape=(n_nodes, len(node)))
    point, column = sp.csr_array(by_node[owner]).nonzero()
    tips = np.cross(unit[column], arms[point])
    rows = (3 * point[:, None] + np.arange(3)).ravel()
    turned = sp.csr_array((tips.ravel(), (rows, np.repeat(column, 3))), shape=(3 * n_points, len(node)))
    carried = sp.csr_array((np.ones(n_points), (np.arange(n_points), owner)), shape=(n_points, n_nodes))
    moved = sp.kron(carried, sp.eye_array(3), format="csr")
    T = sp.block_array([[moved, turned], [sp.eye_array(3 * n_nodes), None]], format="csr")
    none = sp.csr_array((n_nodes, n_nodes))
    around = _directors(arms, owner, n_nodes, midsurface.alike)
    return ShellModel(
        layer.discretisation,
        layer.material,
        sp.csr_array(sp.block_diag([layer.K, sp.csr_array((3 * n_nodes, 3 * n_nodes))])),
        sp.csr_array(sp.block_diag([layer.m, none])),
        np.concatenate([layer.x, nodes]),
        T=sp.csr_array(T),
        arms=around if midsurface.has_sections else None,
        directors=None if midsurface.has_sections else around,
    )


def _rotations(arms: Array, owner: IntArray, n_nodes: int, alike: float) -> tuple[Array, Array, IntArray]:
    """Return arms' mean lengths (n_nodes,), and axes (n, 3) and nodes (n,) of all rotations that move a point."""
    second = np.zeros((n_nodes, 3, 3))
    np.add.at(second, owner, arms[:, :, None] * arms[:, None, :])
    moments, axes = np.linalg.eigh(second)
    size = np.sqrt(moments.sum(axis=1) / np.bincount(owner, minlength=n_nodes))
    folded = moments[:, 1] > alike * moments[:, 2]
    free = np.stack([np.ones_like(folded), np.ones_like(folded), folded], axis=1)
    node, which = np.nonzero(free)
    return size, axes[node, :, which], node


def _directors(arms: Array, owner: IntArray, n_nodes: int, alike: float) -> Arms:
    """Return the arms of all points, which turn with their nodes as far as they show it."""
    n_points = len(owner)
    square = (arms**2).sum(axis=1)[:, None, None] * np.eye(3) - arms[:, :, None] * arms[:, None, :]
    inertia = np.zeros((n_nodes, 3, 3))
    np.add.at(inertia, owner, square)
    inverse = np.linalg.pinv(inertia, rcond=alike, hermitian=True)
    across = rigid_motions(arms)[:, :, 3:].swapaxes(1, 2)  # r × u
    weights = inverse[owner] @ across
    points = np.arange(n_points)
    place = np.concatenate([points, n_points + owner])  # against the node's own displacement
    blocks = np.concatenate([weights, -weights])
    row = (3 * np.tile(owner, 2)[:, None, None] + np.arange(3)[:, None]) + np.zeros((1, 1, 3), dtype=int)
    column = (3 * place[:, None, None] + np.arange(3)) + np.zeros((1, 3, 1), dtype=int)
    shape = 3 * n_nodes, 3 * (n_points + n_nodes)
    turn = sp.csr_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=shape)
    return Arms(points, owner, turn, second_of_rigid(arms))
