"""Nodal loads that the motion of a body puts on it: the right-hand sides of its static responses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel

PRODUCTS = tuple((a, b) for a in range(3) for b in range(a, 3))
"""Axes a ≤ b of the six products of two angular rates, in the order of `centrifugal_fields`."""


def motion_loads(
    fe: FEModel, marker: Marker, axis: Array | None, outboard: Sequence[tuple[Marker, Array | None]] = ()
) -> Array:
    """Centrifugal loads of unit rates, and unit forces and torques at the body's joints.

    Forces and torques are spread over the markers' faces. Loads of linear and angular acceleration are left out: a free
    body balances them by itself, and what bends it is the reaction of its joint.

    Parameters
    ----------
    marker : Marker
        At the joint that carries the body.
    axis : ndarray, shape (3,), optional
        Normal of the plane to which all motion keeps: one centrifugal load, two forces and one torque at each marker.
        Without, the six products of two rates, and three forces and three torques at each marker.
    outboard : sequence of (Marker, ndarray or None)
        Where other bodies are attached or loads act, and the normal of the plane to which those keep.

    Returns
    -------
    ndarray, shape (n_nodes, 3, n_loads)
        Nodal loads [N for unit rates, forces and torques].
    """
    fields = centrifugal_fields(fe.x - marker.position, axis)
    reactions = []
    in_plane = axis is not None and all(normal is not None for _, normal in outboard)
    for at, normal in ((marker, axis if in_plane else None), *outboard):  # the joint answers to every load
        forces, torques = _directions(normal)
        columns = at.columns(len(fe.x), torques)
        reactions += [columns[:, :, :3] @ forces.T, columns[:, :, 3:]]
    return np.concatenate([inertia_of(fe, fields), *reactions], axis=-1)


def acceleration_loads(fe: FEModel, centre: Array, axis: Array | None) -> Array:
    """Inertia loads of unit accelerations of a support, linear ones and angular ones about its centre.

    A free body balances them by itself, a supported one bends.

    Parameters
    ----------
    centre : ndarray, shape (3,)
        Point about which the support is turned [m].
    axis : ndarray, shape (3,), optional
        Normal of the plane to which all motion keeps: two linear accelerations and one angular. Without, three of each.

    Returns
    -------
    ndarray, shape (n_nodes, 3, n_loads)
        Nodal loads [N for unit accelerations].
    """
    r = fe.x - centre
    moves, turns = _directions(axis)
    return inertia_of(fe, [np.tile(e, (len(r), 1)) for e in moves] + [np.cross(e, r) for e in turns])


def centrifugal_fields(r: Array, axis: Array | None) -> list[Array]:
    """Acceleration fields of unit products of two angular rates, at places r from the centre.

    Parameters
    ----------
    r : ndarray, shape (n_nodes, 3)
        Places relative to a point that rests [m].
    axis : ndarray, shape (3,), optional
        Axis of a plane motion, which has the one field across it. Without, all six of `PRODUCTS`.

    Returns
    -------
    list of ndarray, shape (n_nodes, 3)
        Fields whose inertia pulls outwards [m].
    """
    if axis is not None:
        return [r - np.outer(r @ axis, axis) / (axis @ axis)]
    unit = np.eye(3)
    return [(np.outer(r[:, b], unit[a]) + np.outer(r[:, a], unit[b])) / 2 for a, b in PRODUCTS]


def inertia_of(fe: FEModel, fields: Sequence[Array]) -> Array:
    """Nodal loads ``M a`` of acceleration fields a (n_nodes, 3), shape (n_nodes, 3, n_fields)."""
    return np.stack([fe.m @ field for field in fields], axis=-1)


def _directions(normal: Array | None) -> tuple[Array, Array]:
    """Directions of forces and of torques, as rows, that keep to a plane; all of them without a plane."""
    if normal is None:
        return np.eye(3), np.eye(3)
    e = normal / np.linalg.norm(normal)
    return np.linalg.svd(np.eye(3) - np.outer(e, e))[0].T[:2], e[None]
