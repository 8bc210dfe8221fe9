"""Static responses that truncated free modes lack: to inertia loads and to the reaction at the joint.

Low free modes carry almost none of the stretch under centrifugal load, so stress from them alone is wrong however
many bending modes are kept. Load-dependent vectors mend it (MacNeal 1971, Wilson, Yuan & Dickens 1982).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh, null_space

from pipeline.core.arrays import Array
from pipeline.reduction.modes import Modes

if TYPE_CHECKING:
    from pipeline.fem.markers import Marker
    from pipeline.fem.model import FEModel
    from pipeline.reduction.eigen import FreeBodySolver

# A static response with less than this part of its norm outside the modes adds nothing but round-off.
_NEW = 1e-4
# Round-off in motions that no load excites grows from one generation to the next if they are softer than those that
# are; of what is excited, the first generation holds the softest but for a part of its frequency.
_SOFTER = 0.5


def inertia_loads(
    fe: FEModel, marker: Marker, axis: Array | None, outboard: Sequence[tuple[Marker, Array | None]] = ()
) -> Array:
    """Loads that motion puts on a body, shape (n_nodes, 3, n_loads).

    The centrifugal loads of unit rates, and unit forces and torques at its joints, spread over the markers' faces. The
    loads of linear and angular acceleration are not among them: in a free body they are balanced by themselves, what
    they bend comes from the joint's reaction.

    Parameters
    ----------
    marker : Marker
        At the joint that carries the body.
    axis : ndarray, shape (3,), optional
        Normal of the plane to which all motion keeps: one centrifugal load, two forces and one torque at each marker.
        Without, the six products of two rates, and three forces and three torques at each marker.
    outboard : sequence of (Marker, ndarray or None)
        Where other bodies hang on this one, or loads act, and the normal of the plane to which those keep.
    """
    r = fe.x - marker.position
    if axis is None:
        fields = [(np.outer(r[:, b], e) + np.outer(r[:, a], f)) / 2 for a, b, e, f in _products()]
    else:
        fields = [r - np.outer(r @ axis, axis) / (axis @ axis)]
    reactions = []
    flat = axis is not None and all(normal is not None for _, normal in outboard)
    for at, normal in ((marker, axis if flat else None), *outboard):  # the joint answers to every load
        directions, torques = _planar(normal)
        columns = at.columns(len(fe.x), torques)
        reactions += [columns[:, :, :3] @ directions.T, columns[:, :, 3:]]
    return np.concatenate([np.stack([fe.m @ field for field in fields], axis=-1), *reactions], axis=-1)


def _planar(normal: Array | None) -> tuple[Array, Array]:
    """Directions of forces and of torques, as rows, that keep to a plane; all of them without a plane."""
    if normal is None:
        return np.eye(3), np.eye(3)
    e = normal / np.linalg.norm(normal)
    return np.linalg.svd(np.eye(3) - np.outer(e, e))[0].T[:2], e[None]


def _products() -> Iterator[tuple[int, int, Array, Array]]:
    unit = np.eye(3)
    yield from ((a, b, unit[a], unit[b]) for a in range(3) for b in range(a, 3))


def enriched(
    modes: Modes,
    fe: FEModel,
    solver: FreeBodySolver,
    loads: Array,
    held: Array | None = None,
    generations: int = 1,
) -> tuple[Array, Array]:
    """Add the static responses to ``loads`` to a modal basis; orthonormalise and diagonalise again.

    Parameters
    ----------
    modes : Modes
        Eigenvectors; they come back unchanged in front of the new ones.
    loads : ndarray, shape (n_nodes, 3, n_loads)
    held : ndarray, shape (n_nodes, 3, k), optional
        What holds the body in its modes; the responses are moved as rigid bodies until it holds them too.
    generations : int
        1 for the responses to the loads; each further one adds those to the inertia of the one before.

    Returns
    -------
    omega : ndarray, shape (n,)
        Angular frequencies of the enlarged basis [rad/s], ``Φᵀ K Φ = diag(ω²)``; n ≤ n_modes + generations · n_loads.
    shapes : ndarray, shape (n_nodes, 3, n)
        With unit modal mass [kg^-1/2].
    """
    Phi = modes.shapes.reshape(fe.K.shape[0], -1)
    B = None if held is None else held.reshape(fe.K.shape[0], -1)
    basis, n_modes = Phi, Phi.shape[1]
    new = solver.static_response(loads)
    for generation in range(generations):
        U = (solver.inertia_response(new) if generation else new).reshape(fe.K.shape[0], -1)
        U = _beside(basis, U if B is None else _moved(U, fe, B), fe)
        basis, new = np.concatenate([basis, U], axis=1), U.reshape(len(fe.x), 3, -1)
        if not generation:
            softest = eigh(U.T @ (fe.K @ U), eigvals_only=True)[:1].min(initial=np.inf)
    U = basis[:, n_modes:]
    omega2, turn = eigh(U.T @ (fe.K @ U))
    excited = omega2 >= _SOFTER**2 * softest
    shapes = np.concatenate([Phi, U @ turn[:, excited]], axis=1).reshape(len(fe.x), 3, -1)
    return np.concatenate([modes.omega, np.sqrt(omega2[excited])]), shapes


def _beside(basis: Array, U: Array, fe: FEModel) -> Array:
    """What is new in the columns of U beside an M-orthonormal basis, M-orthonormal itself."""
    U = U[:, U.any(axis=0)]
    U = U / np.sqrt(np.einsum("ij,ij->j", U, fe.M @ U))
    for _ in range(2):  # twice is enough (Parlett)
        U = U - basis @ (basis.T @ (fe.M @ U))
    weight, turn = eigh(U.T @ (fe.M @ U))
    new = weight > _NEW**2
    return np.asarray(U @ (turn[:, new] / np.sqrt(weight[new])))


def _moved(U: Array, fe: FEModel, B: Array) -> Array:
    """Add rigid motions: ``Bᵀ U = 0``, and U is M-orthogonal to the rigid motions that B leaves."""
    R = fe.rigid_modes
    U = U - R @ np.linalg.lstsq(B.T @ R, B.T @ U, rcond=None)[0]
    left = R @ null_space(B.T @ R)
    if left.shape[1]:
        U = U - left @ np.linalg.solve(left.T @ (fe.M @ left), left.T @ (fe.M @ U))
    return np.asarray(U)
