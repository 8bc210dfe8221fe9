"""Superelements that other programs have made, as files hold them: matrices of nodes and modal coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.rotations import rigid_motions
from fmd.reduction.body import MarkerShapes


class Recovery(NamedTuple):
    """Motion of points within a superelement."""

    labels: Sequence[int]  # node numbers
    x: Array  # (n_points, 3): positions [m]
    matrix: Array  # (n_points, 3, n): displacements for a unit of each unknown, of displacement [m] or rotation [rad]


@dataclass(frozen=True)
class GivenSuperelement:
    """A superelement as a file holds it, in the file's units until `in_si`."""

    # Node number and component of each coordinate: 1 to 3 displacements, 4 to 6 rotations; modal coordinates are those
    # of nodes without a place.
    unknowns: tuple[tuple[int, int], ...]
    K: Array  # (n, n): stiffness
    M: Array  # (n, n): mass
    D: Array  # (n, n): damping
    nodes: Mapping[int, Array] = field(default_factory=dict)  # (3,): places of the boundary nodes
    # (3, 3): directions, as columns, of the unknowns of nodes that have axes of their own
    axes: Mapping[int, Array] = field(default_factory=dict)

    @property
    def turns(self) -> Array:
        """True for rotations, shape (n,)."""
        return np.array([node in self.nodes and component > 3 for node, component in self.unknowns])

    def in_si(self, length: float, stiffness: float, mass: float) -> GivenSuperelement:
        """Return it in SI units and in the part's axes, by units of length [m], stiffness [N/m] and mass [kg]."""
        turn = self.to_file(length)
        K, M, D = (u * turn.T @ A @ turn for u, A in ((stiffness, self.K), (mass, self.M), (stiffness, self.D)))
        return GivenSuperelement(self.unknowns, K, M, D, {k: length * np.asarray(x) for k, x in self.nodes.items()})

    def to_file(self, length: float) -> Array:
        """Return the file's unknowns by those in the part's axes and in m, (n, n), up to a factor of all.

        Raises
        ------
        ValueError
            A node has a component that is no displacement or rotation, or axes of its own and one or two displacements
            or rotations alone.
        """
        for node, component in self.unknowns:
            if node in self.nodes and not 1 <= component <= 6:
                raise ValueError(f"node {node} has component {component}; 1 to 3 are displacements, 4 to 6 rotations")
        turn = np.diag(np.where(self.turns, length, 1.0))
        place = {unknown: k for k, unknown in enumerate(self.unknowns)}
        for node, Q in self.axes.items():
            for first in (1, 4):
                own = [place[node, c] for c in range(first, first + 3) if (node, c) in place]
                if len(own) not in (0, 3):
                    raise ValueError(f"node {node} has axes of its own and {len(own)} of three unknowns in them")
                if own:
                    turn[np.ix_(own, own)] = turn[own[0], own[0]] * Q.T
        return turn

    def rigid_motions(self, centre: Array, size: float) -> Array:
        """Return rigid motions about a centre in unknowns of one unit, turned by 1 / size, shape (n, 6)."""
        R = np.zeros((len(self.unknowns), 6))
        for row, (node, component) in zip(R, self.unknowns, strict=True):
            if node in self.nodes and component <= 3:
                row[:] = rigid_motions((self.nodes[node][None] - centre) / size)[0, component - 1]
            elif node in self.nodes:
                row[component - 1] = 1.0
        return R

    def displacements(self, node: int) -> Array:
        """Return the displacements of a boundary node by the unknowns, shape (3, n)."""
        rows = np.zeros((3, len(self.unknowns)))
        for k, (own, component) in enumerate(self.unknowns):
            if own == node and component <= 3:
                rows[component - 1, k] = 1.0
        return rows

    def node_shapes(self, V: Array) -> dict[str, MarkerShapes]:
        """Return the boundary nodes with all three displacements, by label; rotations are NaN without unknowns."""
        place = {unknown: k for k, unknown in enumerate(self.unknowns)}
        found, none = dict[str, MarkerShapes](), np.full((3, V.shape[1]), np.nan)
        for node, x in self.nodes.items():
            rows = [place.get((node, component), -1) for component in range(1, 7)]
            if min(rows[:3]) >= 0:
                found[str(node)] = MarkerShapes(x, V[rows[:3]], V[rows[3:]] if min(rows[3:]) >= 0 else none)
        return found
