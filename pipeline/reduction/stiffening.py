"""Geometric stiffening of a reduced body by the stress that its own inertia loads cause.

Under a static stress σ a deflection costs ``½ ∫ σ_ab ∂_a u·∂_b u`` more. The loads here are those of the floating
frame's own motion, ``ρ ẍ`` for each product of two angular rates and for each linear acceleration. By the principle of
virtual work that energy is what a displacement of second order, Γ, gives up in the load field:
``∫ρ x_b Γ_a = −K_G[a, b]``. So it enters as inertia: taken off the Gram tensor wherever position counts, it stiffens
the body, lowers its moment of inertia and keeps the energy's balance, and the equations of motion stay as they are.
Stress from angular acceleration is left out: it is bending, whose mean over a section is zero.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pipeline.core.arrays import Array, read_only
from pipeline.fem.geometric_stiffness import geometric_stiffness
from pipeline.reduction.body import FlexibleBody
from pipeline.reduction.loads import PRODUCTS, centrifugal_fields, inertia_of

if TYPE_CHECKING:
    from pipeline.fem.model import FEModel
    from pipeline.reduction.eigen import FreeBodySolver


def stiffen_body(
    body: FlexibleBody,
    fe: FEModel,
    solver: FreeBodySolver,
    held: Array | None,
    axis: Array | None = None,
    linear: bool = True,
) -> FlexibleBody:
    """Add the geometric stiffness of its inertia loads to a reduced body.

    Parameters
    ----------
    body : FlexibleBody
        Reduced from the model ``fe``.
    fe : FEModel
        The finite element model.
    solver : FreeBodySolver
        Solves with the stiffness of ``fe``.
    held : ndarray, shape (n_nodes, 3, k), optional
        Columns of the reactions of its joint, as `Marker.columns` gives them; without, the body moves freely.
    axis : ndarray, shape (3,), optional
        Axis of a planar motion, for which one load is enough; without, all six products of rates are taken.
    linear : bool
        Whether the joint is accelerated, or gravity acts.

    Returns
    -------
    FlexibleBody
        Its Gram tensor has the geometric stiffness taken off; shapes and frequencies stay.
    """
    n = len(body.omega)
    fields = centrifugal_fields(body.x, axis)
    n_spin = len(fields)
    if linear:
        fields += [np.tile(e, (len(body.x), 1)) for e in np.eye(3)]
    loads = inertia_of(fe, fields)
    if solver.rigid_modes.size:  # else supports answer to any load
        loads = _in_equilibrium(fe, loads, held)
    K_G = reduced_geometric_stiffness(fe, solver.static_response(loads), body.shapes)
    KG = np.zeros((3, 3, n, n))
    if axis is not None:  # Σ (δ_ab − e_a e_b) K_G[a, b] is the one that was computed
        across = np.eye(3) - np.outer(axis, axis) / (axis @ axis)
        KG += 0.5 * across[:, :, None, None] * K_G[0]
    else:
        for (a, b), K in zip(PRODUCTS, K_G, strict=False):
            KG[a, b] = KG[b, a] = K
    G = body.gram.G.copy()
    G[:, :, 1:, 1:] -= KG
    bow = -K_G[n_spin:] if linear else np.zeros((3, 0, 0))
    return replace(body, gram=replace(body.gram, G=read_only(G), stiffening=read_only(KG), bow=read_only(bow)))


def _in_equilibrium(fe: FEModel, f: Array, held: Array | None) -> Array:
    """Balance loads by the joint's reaction ``B μ`` and the inertia of the motions that the joint leaves free."""
    flat, R = f.reshape(-1, f.shape[-1]), fe.rigid_modes
    B = np.zeros((len(flat), 0)) if held is None else held.reshape(len(flat), -1)
    free = R @ np.linalg.svd(B.T @ R)[2][np.linalg.matrix_rank(B.T @ R) if B.shape[1] else 0 :].T
    balance = np.concatenate([B, fe.M @ free], axis=1)
    return np.asarray(flat - balance @ np.linalg.lstsq(R.T @ balance, R.T @ flat, rcond=None)[0]).reshape(f.shape)


def reduced_geometric_stiffness(fe: FEModel, u: Array, shapes: Array) -> Array:
    """Geometric stiffness of shapes, ``K_G[j, l] = ∫ σ_ab ∂_a φ_j·∂_b φ_l dV``, for the stress of each field u.

    Parameters
    ----------
    u : ndarray, shape (n_nodes, 3, k)
        Displacements that cause the stress [m].
    shapes : ndarray, shape (n_nodes, 3, n)
        Displacements that it stiffens [kg^-1/2].

    Returns
    -------
    ndarray, shape (k, n, n)
        Symmetric [N/m per unit of the shapes squared].
    """
    flat, n = shapes.reshape(len(shapes), -1), shapes.shape[2]
    K = np.array([flat.reshape(-1, n).T @ (k_G @ flat).reshape(-1, n) for k_G in geometric_stiffness(fe, u)])
    return np.asarray(0.5 * (K + K.swapaxes(1, 2)))
