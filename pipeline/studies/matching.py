"""Which shapes of one mesh are those of another: by their likeness, for frequencies may change places."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from pipeline.checks import Array, IntArray


def matched(x: Array, shapes: Array, other_x: Array, other_m: Any, other_shapes: Array) -> IntArray:
    """Number of the other mesh's shape that is most like each shape, all different, by the modal assurance criterion.

    Parameters
    ----------
    x, shapes : ndarray, shapes (n_nodes, 3) and (n_nodes, 3, n)
        Of the one mesh; what the other's nodes see of it is the nearest node's.
    other_x, other_m, other_shapes : ndarray, sparse array, ndarray
        Of the other: its nodes, scalar mass matrix and mass-normalised shapes, (n_nodes', 3, n') with n' ≥ n.

    Raises
    ------
    ValueError
        The other has fewer shapes.
    """
    if other_shapes.shape[2] < shapes.shape[2]:
        raise ValueError(f"the other mesh has {other_shapes.shape[2]} shapes, fewer than {shapes.shape[2]}")
    seen = shapes[cKDTree(x).query(other_x)[1]]
    mseen = (other_m @ seen.reshape(len(seen), -1)).reshape(seen.shape)
    likeness = np.tensordot(mseen, other_shapes, ((0, 1), (0, 1))) ** 2
    likeness /= np.einsum("iak,iak->k", seen, mseen)[:, None]
    return np.asarray(linear_sum_assignment(likeness, maximize=True)[1], dtype=np.int64)
