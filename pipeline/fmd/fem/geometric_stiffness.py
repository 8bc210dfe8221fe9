"""Geometric stiffness: the change of a body's stiffness by a static stress.

Under a stress σ a displacement u takes the additional energy ``½ ∫ σ_ab ∂_a u·∂_b u dV``, alike for its three
components. So the matrix is ``k ⊗ 1₃`` with a number ``k_ij = ∫ σ_ab ∂_a N_i ∂_b N_j dV`` for each pair of nodes. The
stress is that of enhanced strain where elements have it, the gradients are those of the nodes' displacements alone; so
the matrix turns the nodes' forces as the body turns, ``k (θ × x) = θ × f``.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array
from fmd.core.limits.memory import STRESSED_AT_ONCE
from fmd.fem.gradients import gradients
from fmd.fem.model import FEModel
from fmd.fem.strain import stresses

_TENSOR = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])  # places of the components in a vector of six


def geometric_stiffness(fe: FEModel, u: Array) -> list[sp.csr_array]:
    """Assemble the geometric stiffness of the linear stress of each displacement.

    Parameters
    ----------
    fe : FEModel
        The body.
    u : ndarray, shape (n_nodes, 3, k)
        Displacements [m].

    Returns
    -------
    list of sparse array, shape (n_nodes, n_nodes)
        Scalar matrices [N/m] in the pattern of ``fe.m``, each for all three components of a displacement.
    """
    space = fe.discretisation
    X, w = space.kind.quadrature(space.kind.stiffness_order)
    n_elements, n_local = space.element_nodes.shape
    entries = np.empty((n_elements, n_local, n_local, u.shape[2]))
    for start in range(0, n_elements, STRESSED_AT_ONCE):
        part = np.arange(start, min(start + STRESSED_AT_ONCE, n_elements))
        g, det = gradients(space, X, part)
        stress = stresses(space, fe.material, u, X, part)[:, :, _TENSOR] * (det * w)[..., None, None, None]
        flat = g.swapaxes(1, 2).reshape(len(g), n_local, -1)
        for k in range(u.shape[2]):
            pulled = (g @ stress[..., k]).swapaxes(1, 2).reshape(flat.shape)
            entries[part, ..., k] = pulled @ flat.swapaxes(1, 2)
    pairs = space.structure.sums(entries)
    return [space.structure.scalar_matrix(pairs[:, k].copy()) for k in range(u.shape[2])]
