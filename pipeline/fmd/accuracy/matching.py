"""Pairs of shapes of two meshes, matched by their likeness, since frequencies may change places."""

from __future__ import annotations

from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.errors import SAME_FREQUENCY_OF_MESHES


def match_shapes(x: Array, shapes: Array, other_x: Array, other_m: Any, other_shapes: Array) -> IntArray:
    """Return the numbers of the other mesh's shapes that are most like each shape, all different.

    Likeness is the modal assurance criterion.

    Parameters
    ----------
    x, shapes : ndarray, shapes (n_nodes, 3) and (n_nodes, 3, n)
        Nodes and shapes of the one mesh, sampled at the nearest node to each of the other's.
    other_x, other_m, other_shapes : ndarray, sparse array, ndarray
        Of the other: its nodes, scalar mass matrix and mass-normalised shapes, (n_nodes', 3, n') with n' ≥ n.

    Raises
    ------
    ValueError
        The other has fewer shapes.
    """
    if other_shapes.shape[2] < shapes.shape[2]:
        raise ValueError(f"the other mesh has {other_shapes.shape[2]} shapes, fewer than {shapes.shape[2]}")
    from scipy.optimize import linear_sum_assignment

    likeness = _likeness(x, shapes, other_x, other_m, other_shapes)
    return np.asarray(linear_sum_assignment(likeness, maximize=True)[1], dtype=np.int64)


def find_counterparts(
    x: Array, shapes: Array, other_x: Array, other_m: Any, other_shapes: Array, other_omega: Array
) -> tuple[IntArray, Array]:
    """Return the most similar shapes of the other mesh, which may have fewer, and their likeness, 0 … 1, (n,) each.

    Shapes of one frequency may be turned into each other: the likeness to any of them counts. A shape without a
    counterpart has likeness 0.
    """
    from scipy.optimize import linear_sum_assignment

    likeness = _likeness(x, shapes, other_x, other_m, other_shapes)
    rows, columns = linear_sum_assignment(likeness, maximize=True)
    numbers, alike = np.zeros(len(likeness), dtype=np.int64), np.zeros(len(likeness))
    numbers[rows] = columns
    same = np.abs(other_omega / other_omega[columns, None] - 1) < SAME_FREQUENCY_OF_MESHES
    alike[rows] = (likeness[rows] * same).sum(axis=1)
    return numbers, alike


def _likeness(x: Array, shapes: Array, other_x: Array, other_m: Any, other_shapes: Array) -> Array:
    from scipy.spatial import cKDTree

    seen = shapes[cKDTree(x).query(other_x)[1]]
    mseen = (other_m @ seen.reshape(len(seen), -1)).reshape(seen.shape)
    likeness = np.tensordot(mseen, other_shapes, ((0, 1), (0, 1))) ** 2
    return np.asarray(likeness / np.einsum("iak,iak->k", seen, mseen)[:, None])
