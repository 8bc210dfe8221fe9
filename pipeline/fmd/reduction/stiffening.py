"""Geometric stiffening of a reduced body by the stress of all loads that pass through it.

Under a static stress σ a deflection costs ``½ ∫ σ_ab ∂_a u·∂_b u`` more. By the principle of virtual work that energy
is what a displacement of second order, Γ, gives up in the load f that causes the stress: ``f·Γ = −½ qᵀ K_G[f] q``. Γ is
how far a bent body is drawn in. So stiffening is kinematics: every load works on Γ where it acts, no stress needs to be
known while the body moves, and energy keeps its balance. The geometric stiffness of a unit load each gives

- the inertia integrals of Γ, from loads ``ρ ẍ`` of the frame's own motion: products of two angular rates, taken off
  the inertia shape integrals wherever position counts, and linear and angular accelerations (``displacement2`` and
  ``rotation2``);
- displacement and rotation of a marker by Γ, from forces and torques there (`MarkerShapes.displacement2`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, read_only
from fmd.core.limits.memory import ENTRIES_AT_ONCE, FEW_ENTRIES
from fmd.core.limits.patience import SOLVING
from fmd.core.limits.round_off import SOLVED
from fmd.core.progress import Advance
from fmd.fem.geometric_stiffness import reduced_geometric_stiffness
from fmd.reduction.body import FlexibleBody, MarkerShapes
from fmd.reduction.loads import PRODUCTS, centrifugal_fields, inertia_of

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel
    from fmd.reduction.eigen import FreeBodySolver


def stiffen_body(
    body: FlexibleBody,
    fe: FEModel,
    solver: FreeBodySolver,
    constraints: Array | None,
    axis: Array | None = None,
    linear: bool = True,
    moving: Mapping[str, Marker] | None = None,
    free: Array | None = None,
    elements: bool = True,
    advance: Advance = lambda done: None,
) -> FlexibleBody:
    """Add the displacement of second order to a reduced body: to its inertia, and to its markers; frequencies stay.

    ``constraints`` (n_nodes, 3, k) are columns of the reactions of its joint, as `Marker.columns` gives them; without,
    the body moves freely. About directions ``free`` (k, 3) the joint lets a body turn that stands on supports. With the
    axis (3,) of a plane motion there are one product of rates and one angular acceleration; without, six and three.
    Unless ``linear``, what the body has of the displacement's momentum as the frame is accelerated stays. ``moving``
    are the markers whose displacement of second order is wanted: those that bodies or loads act on, and any to look at.
    Without ``elements`` only the arms of links count, which need no stress. ``advance`` takes the part that is done.
    """
    x, n = body.x, len(body.omega)
    moving, turns = moving or {}, np.eye(3) if axis is None else axis[None] / np.linalg.norm(axis)
    pushes = [np.tile(e, (len(x), 1)) for e in np.eye(3)] if linear else []
    fields = centrifugal_fields(x, axis), pushes, [np.cross(e, x) for e in turns]
    inertia = inertia_of(fe, [field for group in fields for field in group])
    columns = [marker.columns(len(x), np.eye(3)) for marker in moving.values()]
    support = _Support(body, fe, solver, constraints, np.zeros((0, 3)) if free is None else free)
    K_G = support.geometric_stiffness(
        np.concatenate([inertia, *columns], axis=2), elements, advance
    )  # one solution for all loads
    ends = np.cumsum([*(len(group) for group in fields), *(6 for _ in moving)])
    spin, push, turn, *unit = np.split(K_G, ends[:-1])
    KG = np.zeros((3, 3, n, n))
    if axis is not None:  # Σ (δ_ab − e_a e_b) K_G[a, b] is the one that was computed
        across = np.eye(3) - np.outer(axis, axis) / (axis @ axis)
        KG += 0.5 * across[:, :, None, None] * spin[0]
    else:
        for (a, b), K in zip(PRODUCTS, spin, strict=True):
            KG[a, b] = KG[b, a] = K
    G = body.integrals.G.copy()
    if body.integrals.stiffening.size:  # by its arms alone, which KG has again
        G[:, :, 1:, 1:] += body.integrals.stiffening
    G[:, :, 1:, 1:] -= KG
    displacement2 = -push if linear else body.integrals.displacement2
    rotation2 = -np.einsum("ka,kij->aij", turns, turn) if turn.any() else np.zeros((3, 0, 0))
    integrals = replace(
        body.integrals,
        G=read_only(G),
        stiffening=read_only(KG),
        displacement2=read_only(displacement2),
        rotation2=read_only(rotation2),
    )
    stiffened = {
        name: _with_displacement2(x, body.markers[name], marker, K)
        for (name, marker), K in zip(moving.items(), unit, strict=True)
    }
    return replace(body, integrals=integrals, markers={**body.markers, **stiffened})


class _Support:
    """Forces that balance loads on a body: the reactions of its joint, and its inertia where the joint lets it move."""

    def __init__(
        self, body: FlexibleBody, fe: FEModel, solver: FreeBodySolver, constraints: Array | None, free: Array
    ) -> None:
        self._fe, self._solver, self._shapes = fe, solver, body.shapes
        R = solver.rigid_modes
        self._held = np.zeros((0, *2 * [body.shapes.shape[2]]))
        if R.size:
            B = np.zeros((len(R), 0)) if constraints is None else constraints.reshape(len(R), -1)
            moves = R @ np.linalg.svd(B.T @ R)[2][np.linalg.matrix_rank(B.T @ R) if B.shape[1] else 0 :].T
            self._tests, self._balance = R, np.concatenate([B, fe.M @ moves], axis=1)
            self._bending = B  # the inertia of moving as a whole is balanced by itself
            if constraints is not None and moves.size:
                self._held = _turned_face(body.markers[body.joint], body.x, constraints)
        else:  # supports answer to any load, and the frame floats about the joint
            self._tests = np.cross(free, body.x[:, None]).swapaxes(1, 2).reshape(fe.M.shape[0], -1)
            self._balance = self._bending = fe.M @ self._tests

    def geometric_stiffness(self, loads: Array, elements: bool, advance: Advance) -> Array:
        """Return the geometric stiffness of the body's shapes under nodal loads (n_nodes, 3, k), shape (k, n, n)."""
        flat = loads.reshape(-1, loads.shape[-1])
        T, P = self._tests, self._balance
        reactions = np.linalg.lstsq(T.T @ P, T.T @ flat, rcond=None)[0] if P.size else np.zeros((0, flat.shape[1]))
        rest = flat - P @ reactions
        felt = np.flatnonzero(np.abs(rest).max(axis=0) > SOLVED * np.abs(flat).max(axis=0))
        each = np.concatenate([flat[:, felt], self._bending], axis=1).reshape(*loads.shape[:2], -1)
        with self._solver.telling(lambda done: advance(SOLVING * done)):
            answers = self._solver.remembered_response(each)
        u = answers[:, :, : len(felt)] - answers[:, :, len(felt) :] @ reactions[: self._bending.shape[1], felt]
        out = np.zeros((flat.shape[1], self._shapes.shape[2], self._shapes.shape[2]))
        entries = max(ENTRIES_AT_ONCE, FEW_ENTRIES // max(1, self._shapes.shape[0]))
        at_a_time = max(1, entries // self._fe.local_pairs)
        by_elements = self._fe.products @ u.reshape(len(rest), -1)
        strained = np.flatnonzero(np.abs(by_elements).max(axis=0) > SOLVED * np.abs(flat[:, felt]).max(axis=0))
        for first in range(0, len(strained) if elements else 0, at_a_time):
            advance(SOLVING + (1.0 - SOLVING) * first / len(strained))
            part = strained[first : first + at_a_time]
            out[felt[part]] = reduced_geometric_stiffness(self._fe, u[:, :, part], self._shapes)
        both = [self._fe.arms, self._fe.directors if elements else None]
        if arms := [one for one in both if one is not None]:
            left = rest[:, felt] - by_elements
            out[felt] += sum(one.stiffness(left.reshape(u.shape), self._shapes) for one in arms)
        if elements:  # the joint holds its face's rotation of second order, not the face's linear mean rotation
            out -= np.tensordot(reactions[: len(self._held)].T, self._held, axes=1)
        return out


def _turned_face(marker: MarkerShapes, x: Array, loads: Array) -> Array:
    """Return the second moments of loads (n_nodes, 3, k) on a face that turns with its marker, shape (k, n, n).

    Forces f at places r of a face that turns by θ do the work ``½ f·θ̃²r`` beside that of its rotation of second order.
    """
    A = np.einsum("ia,ibk->kab", x - marker.position, loads)
    own = 0.5 * (A + A.swapaxes(1, 2)) - np.trace(A, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    return np.asarray(marker.rotation.T @ own @ marker.rotation)


def _with_displacement2(x: Array, shapes: MarkerShapes, marker: Marker, K_G: Array) -> MarkerShapes:
    """Add its displacement and rotation of second order to a marker, from K_G of unit forces and torques there."""
    if not K_G.any():  # fixed by the joint
        return shapes
    displacement2 = -K_G - _turned_face(shapes, x, marker.columns(len(x), np.eye(3)))
    return replace(shapes, displacement2=read_only(displacement2))
