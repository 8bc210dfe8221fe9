"""A basis of modes and their static derivatives for a solid of large displacements.

Modal derivatives: Idelsohn & Cardona, Comp Meth Appl Mech Eng 49 (1985); static ones: Slaats, de Jongh & Sauren,
Computers & Structures 54 (1995).
"""

from __future__ import annotations

from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from nonlinear_solid import NonlinearSolid
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh, splu

DEPENDENT = 1e-6  # of a shape by mass: a smaller rest beside the others is no direction of its own
_AMPLITUDE = 0.1  # of the length of the solid: displacement by which second-order forces are computed


def bending_modes(solid: NonlinearSolid, count: int, direction: Any) -> Any:
    """Return the lowest modes that move mainly along a direction (3,), shape (n_nodes, 3, count).

    Raises
    ------
    ValueError
        There are fewer among the lowest modes.
    """
    if count == 0:
        return np.zeros((*solid.fe.x.shape, 0))
    free, fe = solid.free, solid.fe
    K, M = (matrix[free][:, free].tocsc() for matrix in (fe.K, fe.M))
    _, vectors = eigsh(K, 5 * count + 5, M, sigma=0.0, v0=np.ones(len(free)))
    modes = np.zeros((fe.K.shape[0], vectors.shape[1]))
    modes[free] = vectors
    modes = modes.reshape(len(fe.x), 3, -1)
    along = np.einsum("xak,a->xk", modes, direction)
    chosen = np.flatnonzero((along * (fe.m @ along)).sum(axis=0) > 0.5)[:count]
    if len(chosen) < count:
        raise ValueError(f"found {len(chosen)} modes along {direction}, expected {count}")
    return modes[:, :, chosen]


def twist_shape(solid: NonlinearSolid, axis: int) -> Any:
    """Return the static displacements by a torque at the tip about an axis of space, shape (n_nodes, 3, 1)."""
    free, shape = solid.free, np.zeros(solid.fe.x.size)
    torque = solid.tip.columns(len(solid.fe.x), np.eye(3)[axis : axis + 1])[:, :, 3].ravel()
    shape[free] = splu(solid.fe.K[free][:, free].tocsc()).solve(torque[free])
    return shape.reshape(*solid.fe.x.shape, 1)


def static_derivatives(solid: NonlinearSolid, modes: Any) -> Any:
    """Return the static derivatives of modes (n_nodes, 3, n), shape (n_nodes, 3, n (n + 1)/2).

    ``K θ_ij = −∂K/∂q_j φ_i`` without inertia. The right side is that part of the internal forces which is of second
    order, found exactly by adding those of opposite displacements.
    """
    length = np.ptp(solid.fe.x, axis=0).max()
    shapes = modes * (_AMPLITUDE * length / np.abs(modes).max(axis=(0, 1)))

    def second_order(u: Any) -> Any:
        return 0.5 * (solid.force(u) + solid.force(-u))

    pairs = list(combinations_with_replacement(range(shapes.shape[2]), 2))
    own = [second_order(shapes[:, :, k]) for k in range(shapes.shape[2])]
    forces = np.array([second_order(shapes[:, :, i] + shapes[:, :, j]) - own[i] - own[j] for i, j in pairs])
    free = solid.free
    K = solid.fe.K[free][:, free].tocsc()
    found = np.zeros((3 * len(shapes), len(pairs)))
    found[free] = splu(K).solve(np.ascontiguousarray(-forces.reshape(len(pairs), -1)[:, free].T))
    return found.reshape(*shapes.shape[:2], -1)


def orthonormalise(solid: NonlinearSolid, shapes: Any) -> tuple[Any, Any]:
    """Return modes of the undeformed solid within the span of shapes, (n_nodes, 3, n), and their ω (n,) [rad/s].

    Gram and Schmidt's way by mass, the shape with the largest rest first, each made orthogonal twice.
    """
    M, left = solid.fe.M, shapes.reshape(-1, shapes.shape[2]).copy()
    left /= np.sqrt(np.einsum("xi,xi->i", left, M @ left))
    V = np.zeros((len(left), 0))
    for _ in range(left.shape[1]):
        sizes = np.sqrt(np.einsum("xi,xi->i", left, M @ left))
        first = int(sizes.argmax())
        if sizes[first] < DEPENDENT:
            break
        v = left[:, first] / sizes[first]
        v -= V @ (V.T @ (M @ v))
        V = np.column_stack([V, v / np.sqrt(v @ (M @ v))])
        left -= V @ (V.T @ (M @ left))
    squares, turned = eigh(V.T @ (solid.fe.K @ V))
    return (V @ turned).reshape(*shapes.shape[:2], -1), np.sqrt(squares)
