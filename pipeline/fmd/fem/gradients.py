"""Spatial gradients of shape functions and Jacobian determinants of many elements at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError
from fmd.fem.elements import shape_functions

if TYPE_CHECKING:
    from fmd.fem.space import Discretisation


def gradients(space: Discretisation, X: Array, elements: slice | IntArray) -> tuple[Array, Array]:
    """Return spatial gradients of the shape functions and Jacobian determinants at reference points X (3, n_q).

    Returns
    -------
    g : ndarray, shape (n_elements, n_q, n_local, 3) [1/m]
    det : ndarray, shape (n_elements, n_q) [m³]
    """
    _, dN = shape_functions(space.kind.element, X)
    J = space.jacobians(X[:, :1] if space.kind.is_affine else X, elements)
    inverse, det = inverse_and_determinant(J)
    n_elements, n_jacobians = det.shape
    g = dN.transpose(2, 0, 1).reshape(n_jacobians, -1, 3) @ inverse
    return g.reshape(n_elements, X.shape[1], len(dN), 3), np.broadcast_to(det, (n_elements, X.shape[1]))


def determinants(J: Array) -> Array:
    """Return the determinants of Jacobians J (n_elements, n_q, 3, 3), positive for left-handed elements too.

    scikit-fem's hexahedra are left-handed.

    Raises
    ------
    AccuracyError
        Determinants differ in sign; the message counts the elements.
    """
    return inverse_and_determinant(J)[1]


def inverse_and_determinant(J: Array) -> tuple[Array, Array]:
    """Return the inverses of Jacobians (n_elements, n_q, 3, 3) by Cramer's rule, and `determinants`."""
    J = np.moveaxis(J, (2, 3), (0, 1))
    cofactor = np.empty((3, 3, *J.shape[2:]))
    for i in range(3):
        for k in range(3):
            (a, b), (c, d) = ((i + 1) % 3, (i + 2) % 3), ((k + 1) % 3, (k + 2) % 3)
            cofactor[k, i] = J[a, c] * J[b, d] - J[a, d] * J[b, c]
    det = (J[0] * cofactor[:, 0]).sum(axis=0)
    hand = np.sign(np.median(det)) or 1.0
    if (hand * det).min() <= 0:
        bad = np.count_nonzero((hand * det <= 0).any(axis=1))
        raise AccuracyError(f"{bad} elements are inverted (Jacobian ≤ 0 at a quadrature point)")
    return np.ascontiguousarray(np.moveaxis(cofactor / det, (0, 1), (2, 3))), hand * det
