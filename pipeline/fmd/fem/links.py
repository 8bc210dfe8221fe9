"""Links and lumped masses on a solid: points that carry mass, moved by one linear map from independent unknowns.

The points of a body are the nodes of its mesh and, behind them, those of its links and masses. They move as
``u = T y``: a rigid link (RBE2) has six unknowns in place of those of its nodes, an average one (RBE3) follows its
nodes and has none. Stiffness and mass are matrices of the points, and ``Tᵀ K T``, ``Tᵀ (m ⊗ 1₃) T`` those of y. Rotary
inertia is that of points on rigid arms, exact for every length of the arms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import EPSILON, Array, IntArray
from fmd.core.limits.mesh import DEEPEST_LINKS
from fmd.core.rotations import rigid_motions
from fmd.fem.arms import Arms, second_of_mean, second_of_rigid
from fmd.fem.markers import Marker
from fmd.fem.model import FEModel


@dataclass(frozen=True)
class LinkedFace:
    """A reference point that moves a face rigidly, or follows it in the mean.

    Attributes
    ----------
    marker : Marker
        The face; rigid or averaged.
    at : ndarray, shape (3,)
        The reference point [m].
    """

    marker: Marker
    at: Array


@dataclass(frozen=True)
class LumpedMass:
    """A rigid body on the reference point of a link.

    Attributes
    ----------
    link : str
        Name of the link.
    mass : float
        [kg]
    centre : ndarray, shape (3,)
        Centre of mass [m].
    inertia : ndarray, shape (3, 3)
        Inertia tensor about the centre of mass [kg m²].
    """

    link: str
    mass: float
    centre: Array
    inertia: Array


@dataclass(frozen=True)
class LinkedModel(FEModel):
    """A finite element model with links and masses, whose points are more than the nodes of its mesh.

    Attributes
    ----------
    positions : ndarray, shape (n_points, 3)
        Positions of all points [m], those of the mesh's nodes first.
    references : mapping of str to ndarray, shape (7,)
        Numbers of the points that show the motion of each link: its reference, and six on arms around it.
    """

    positions: Array
    references: Mapping[str, IntArray]

    @property
    def x(self) -> Array:
        """Positions of all points, shape (n_points, 3) [m]."""
        return self.positions

    def marker(self, link: str) -> Marker:
        """Return the marker at the reference point of a link."""
        points = self.references[link]
        return arms_marker(points, self.positions[points])


def arms_marker(points: IntArray, x: Array) -> Marker:
    """Return the marker at the first of seven points x (7, 3), which turns as the other six, ±a along three axes."""
    arms = x[1:] - x[0]
    square = float((arms**2).sum()) / 6
    rotation = np.zeros((3, 7, 3))
    rotation[:, 1:] = np.einsum("acb,pc->apb", EPSILON, arms) / (4 * square)  # Σ r × (θ × r) = 4 a² θ
    return Marker(x[0], points, np.eye(7)[0], rotation)


def inertia_points(mass: float, inertia: Array, length: float) -> tuple[Array, Array]:
    """Return places (7, 3) about the centre of mass and masses (7,) of points with a body's inertia.

    The second moment ``W = ½ tr(J) 1 − J`` is that of pairs of points along its principal axes, ``w_k = 2 μ_k a²``.
    Their mass is taken off the point in the middle. Without inertia all others are 0.

    Parameters
    ----------
    inertia : ndarray, shape (3, 3)
        Inertia tensor J about the centre of mass [kg m²].
    length : float
        Length of the arms where the inertia doesn't give one [m].
    """
    w, e = np.linalg.eigh(0.5 * np.trace(inertia) * np.eye(3) - inertia)
    total = float(w.sum())
    if mass > 0 and total > 0:
        length = float(np.sqrt(total / mass))  # no mass is left in the middle
    places = np.concatenate([np.zeros((1, 3)), length * e.T, -length * e.T])
    around = w / (2 * length**2)
    return places, np.concatenate([[mass - 2 * around.sum()], around, around])


class Constraints:
    """Equations that give some unknowns of nodes and grid points by others, solved for all by the independent ones.

    Unknowns are three of each node, then six of each grid point, its displacement and its rotation.

    Parameters
    ----------
    n_nodes : int
        Number of nodes.
    n_grids : int
        Number of grid points.
    """

    def __init__(self, n_nodes: int, n_grids: int) -> None:
        self._n, self.n_nodes = 3 * n_nodes + 6 * n_grids, n_nodes
        self._is_given = np.zeros(self._n, dtype=bool)
        self._rows: list[IntArray] = []
        self._columns: list[IntArray] = []
        self._values: list[Array] = []

    def unknowns(self, nodes: IntArray) -> IntArray:
        """Return the unknowns of nodes (k,), shape (3 k,)."""
        return np.asarray((3 * nodes[:, None] + np.arange(3)).ravel())

    def grid(self, k: int) -> IntArray:
        """Return the six unknowns of a grid point."""
        return 3 * self.n_nodes + 6 * k + np.arange(6)

    def give(self, unknowns: IntArray, others: IntArray, matrix: Array) -> None:
        """Let ``u[unknowns] = matrix @ u[others]``.

        Raises
        ------
        ValueError
            One of the unknowns is given already.
        """
        if self._is_given[unknowns].any():
            raise ValueError("a node is moved by two links")
        self._is_given[unknowns] = True
        row, column = np.nonzero(matrix)
        self._rows.append(unknowns[row])
        self._columns.append(others[column])
        self._values.append(matrix[row, column])

    def transformation(self) -> tuple[sp.csr_array, int]:
        """Return T of ``u = T y``, shape (n, n_independent), and how many of y are unknowns of grid points.

        Raises
        ------
        ValueError
            Unknowns give one another in a circle.
        """
        place = np.concatenate([*self._rows, np.zeros(0, int)]), np.concatenate([*self._columns, np.zeros(0, int)])
        D = sp.csr_array((np.concatenate([*self._values, np.zeros(0)]), place), shape=(self._n, self._n))
        independent = np.flatnonzero(~self._is_given)
        T = E = sp.csr_array(sp.eye_array(self._n, format="csr")[:, independent])
        for _ in range(DEEPEST_LINKS):  # links that hang on links; usually once
            following = sp.csr_array(D @ T + E)
            if abs(following - T).sum() == 0.0:
                return T, int(np.count_nonzero(independent >= 3 * self.n_nodes))
            T = following
        raise ValueError(f"links hang on one another in a circle, or more than {DEEPEST_LINKS} deep")


def link_points(fe: FEModel, links: Mapping[str, LinkedFace], masses: Sequence[LumpedMass] = ()) -> LinkedModel:
    """Add links and lumped masses to the model of a solid.

    Parameters
    ----------
    fe : FEModel
        The solid alone.
    links : mapping of str to LinkedFace
        By name; rigid ones have no node in common.
    masses : sequence of LumpedMass
        On those links.

    Raises
    ------
    ValueError
        Two rigid links share nodes.
    """
    n, constraints = len(fe.x), Constraints(len(fe.x), len(links))
    groups, weights = [], [np.zeros(0)]
    for k, (name, link) in enumerate(links.items()):
        marker, r = link.marker, fe.x[link.marker.nodes] - link.at
        own, grid = constraints.unknowns(marker.nodes), constraints.grid(k)
        if marker.rigid:
            constraints.give(own, grid, rigid_motions(r).reshape(-1, 6))
        else:
            constraints.give(grid, own, _mean_motion(marker, link.at))
        length = float(np.linalg.norm(fe.x[marker.nodes] - marker.position, axis=1).max())
        on_it = [mass for mass in masses if mass.link == name]
        points = [inertia_points(mass.mass, mass.inertia, length) for mass in on_it]
        shown, none = inertia_points(0.0, np.zeros((3, 3)), length)
        places = [mass.centre + at for mass, (at, _) in zip(on_it, points, strict=True)]
        groups.append(np.concatenate([link.at + shown, *places]))
        weights += [none, *(each for _, each in points)]
    T, n_linked = constraints.transformation()
    rows = [
        sp.csr_array(rigid_motions(x - link.at).reshape(-1, 6)) @ T[constraints.grid(k)]
        for k, (link, x) in enumerate(zip(links.values(), groups, strict=True))
    ]
    x = np.concatenate([fe.x, *groups])
    starts = np.cumsum([n, *(len(own) for own in groups)])
    more = 3 * (len(x) - n)
    return LinkedModel(
        fe.discretisation,
        fe.material,
        sp.csr_array(sp.block_diag([fe.K, sp.csr_array((more, more))])),
        sp.csr_array(sp.block_diag([fe.m, sp.diags_array(np.concatenate(weights))])),
        x,
        {name: start + np.arange(7) for name, start in zip(links, starts[:-1], strict=True)},
        T=sp.csr_array(sp.vstack([T[: 3 * n], *rows])),
        link_unknowns=n_linked,
        arms=_arms(x, list(links.values()), starts),
    )


def _mean_motion(marker: Marker, at: Array) -> Array:
    """Return displacement and rotation of a point that follows a face in the mean, shape (6, 3 n)."""
    turn = marker.rotation_weights.reshape(3, -1)
    move = np.kron(marker.translation_weights, np.eye(3))
    return np.concatenate([move + np.cross(turn, at - marker.position, axis=0), turn])


def _arms(x: Array, links: Sequence[LinkedFace], starts: IntArray) -> Arms:
    """Return the arms of all links: their points, from ``starts`` on, and the nodes of the rigid ones."""
    points, number, second, turns = [], [], [], []
    for k, link in enumerate(links):
        marker, own = link.marker, np.arange(starts[k], starts[k + 1])
        if marker.rigid:
            own = np.concatenate([marker.nodes, own])
            second.append(second_of_rigid(x[own] - link.at))
        else:
            places = x[marker.nodes] - marker.position
            second.append(second_of_mean(x[own] - marker.position, places, marker.rotation_weights))
        points.append(own)
        number.append(np.full(len(own), k))
        shown = starts[k] + np.arange(7)
        rotation = arms_marker(shown, x[shown]).rotation_weights.reshape(3, -1)
        place = (np.repeat(np.arange(3), 21), np.tile((3 * shown[:, None] + np.arange(3)).ravel(), 3))
        turns.append(sp.csr_array((rotation.ravel(), place), shape=(3, 3 * len(x))))
    return Arms(np.concatenate(points), np.concatenate(number), sp.csr_array(sp.vstack(turns)), np.concatenate(second))
