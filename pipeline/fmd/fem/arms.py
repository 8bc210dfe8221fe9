"""Points on rigid arms, and their displacement of second order.

A point at the end of an arm r that turns by θ moves by ``θ × r``, and in second order by ``½ θ × (θ × r)``: the arm is
drawn in. A load f on it does work there, and so an arm has a geometric stiffness of its own, ``−f·(½ θ × (θ × r))``
over the square of the coordinates, without any stress. It keeps a disc on a shaft, whose inertia is that of points on
arms, from being weakened by its own turning.
"""

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import EPSILON, Array, IntArray
from fmd.core.data_classes import dataclass


@dataclass(frozen=True)
class Arms:
    """Points that turn with the links that they belong to, many to each."""

    points: IntArray  # (k,): numbers of the points
    link: IntArray  # (k,): number of the link of each
    turn: sp.csr_array  # (3 n_links, 3 n_points): rotation of each link by the displacements of all points [1/m]
    # (k, 3, 3, 3): displacement of second order by the link's rotation θ, ``½ Σ_ab second[:, :, a, b] θ_a θ_b`` [m]
    second: Array

    def second_order(self, u: Array) -> Array:
        """Return the points' displacement of second order at a displacement of all points, both (n_points, 3) [m]."""
        theta = (self.turn @ u.ravel()).reshape(-1, 3)[self.link]
        moved = np.zeros_like(u)
        np.add.at(moved, self.points, 0.5 * np.einsum("pcab,pa,pb->pc", self.second, theta, theta))
        return moved

    def stiffness(self, forces: Array, shapes: Array) -> Array:
        """Return the geometric stiffness (k, n, n) of shapes (n_points, 3, n) by forces on the arms' ends, symmetric.

        Forces (n_points, 3, k) [N] are loads less those of the elements; what is left acts on the links.
        """
        n_links = self.turn.shape[0] // 3
        moments = np.zeros((n_links, 3, 3, forces.shape[2]))
        np.add.at(moments, self.link, np.einsum("pck,pcab->pabk", forces[self.points], self.second))
        turns = (self.turn @ shapes.reshape(self.turn.shape[1], -1)).reshape(n_links, 3, -1)
        return -np.asarray(np.einsum("labk,laj,lbm->kjm", moments, turns, turns, optimize=True))


def join_arms(one: Arms | None, other: Arms | None) -> Arms | None:
    """Return the arms of both, whose points are numbered alike; ``None`` if there are none."""
    if one is None or other is None:
        return one or other
    return Arms(
        np.concatenate([one.points, other.points]),
        np.concatenate([one.link, one.turn.shape[0] // 3 + other.link]),
        sp.csr_array(sp.vstack([one.turn, other.turn])),
        np.concatenate([one.second, other.second]),
    )


def second_of_rigid(r: Array) -> Array:
    """Return ``second`` of `Arms` for arms r (k, 3) of a rigid link: ``θ × (θ × r)``, shape (k, 3, 3, 3)."""
    unit = np.eye(3)
    across = np.einsum("ca,pb->pcab", unit, r)
    return np.asarray(0.5 * (across + across.swapaxes(2, 3)) - np.einsum("pc,ab->pcab", r, unit))


def second_of_mean(r: Array, places: Array, weights: Array) -> Array:
    """Return ``second`` of `Arms` for arms r (k, 3) that follow the mean motion of nodes.

    Displacements of second order of the nodes, at places (n, 3) from their centroid [m], have a mean rotation, which is
    none of the arms'; its weights (3, n, 3) [1/m] are `Marker.rotation_weights`.
    """
    spurious = np.einsum("aid,idbc->abc", weights, second_of_rigid(places))
    return np.asarray(second_of_rigid(r) - np.einsum("cae,abd,pe->pcbd", EPSILON, spurious, r))
