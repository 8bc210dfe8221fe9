"""Rotations of a shell's nodes by the model's unknowns."""

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import IntArray
from fmd.core.limits.mesh import ON_A_LINE
from fmd.fem.arms import Arms
from fmd.fem.constraints import rows_of
from fmd.fem.markers import weighted_marker
from fmd.fem.space import Member


def node_turns(T: sp.csr_array, directors: Arms, member: Member, nodes: IntArray) -> sp.csr_array:
    """Return the rotations of nodes, numbered from 0, by the unknowns of T, shape (3 n, n_unknowns).

    About its director a node turns as the nodes of the elements around it do in the mean.
    """
    mesh = member.space.mesh
    assert mesh.midsurface is not None
    x, first = mesh.midsurface.nodes, member.first + len(member.space.x)
    cells = mesh.midsurface.owner[mesh.cells]
    found = []
    for node in nodes.tolist():
        around = np.unique(cells[(cells == node).any(axis=1)])
        around = np.append(around[around != node], node)
        mean = weighted_marker(around[:-1], x[around[:-1]] - x[node], np.ones(len(around) - 1)).rotation_weights
        relative = np.concatenate([mean, -mean.sum(axis=1, keepdims=True)], axis=1).reshape(3, -1)
        by_mean = sp.csr_array(relative) @ T[rows_of(first + around)]
        turned = sp.csr_array(directors.turn[3 * node + np.arange(3)] @ T)
        shown = turned[:, np.unique(turned.indices)].toarray() if turned.nnz else np.zeros((3, 0))
        axes, sizes, _ = np.linalg.svd(shown) if shown.size else (np.eye(3), np.zeros(3), None)
        left = axes[:, np.count_nonzero(sizes > ON_A_LINE * sizes.max(initial=0.0)) :]
        found.append(turned + sp.csr_array(left @ left.T) @ by_mean)
    return sp.csr_array(sp.vstack(found))
