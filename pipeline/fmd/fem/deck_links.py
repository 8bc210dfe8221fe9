"""Connections of a deck as links, masses, springs and equations of the finite element model.

Rigid connections that share a point with a rotation are one rigid piece. A point that isn't the body's and that
nothing ties is a rigid piece of its own. A shell's node of which a rotation is wanted turns as the elements around it.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.mesh import ON_A_LINE, RIGID_RESIDUAL
from fmd.core.rotations import rigid_motions
from fmd.fem.connections import (
    Connections,
    Equation,
    MassOnPoint,
    MeanConnection,
    RigidConnection,
    SpringBetween,
    TiedFaces,
)
from fmd.fem.joined import JoinedSpace
from fmd.fem.links import Linked, LinkedFace, LumpedMass, Relation
from fmd.fem.local_markers import single_node_marker
from fmd.fem.markers import Marker, face_marker, weighted_marker
from fmd.fem.model import FEModel
from fmd.fem.selection import body_nodes, points_of_nodes
from fmd.fem.space import member_of
from fmd.fem.ties import Tie, tie_faces


def find_deck_links(deck: Connections, fe: FEModel) -> Linked:
    """Return the links of a deck on its solid or shell, each by the name of its reference point.

    Raises
    ------
    ValueError
        A connection is of a form that links don't have; the message names it.
    """
    return _Finder(deck, fe).linked()


class _Finder:
    """Groups of points that are one rigid piece, and what is on each."""

    def __init__(self, deck: Connections, fe: FEModel) -> None:
        space = fe.discretisation
        self._deck, self._fe, self._space = deck, fe, space
        if isinstance(space, JoinedSpace):  # whose deck's points are rows
            x, self._first, self._turns = space.x, 0, space.turning
        else:
            x, rows, self._turns = body_nodes(space)
            self._first = int(rows[0])
        self._n = len(x)
        self._x = np.concatenate([x, deck.places])
        self._above: dict[int, int] = {}  # a point with rotations, and one nearer to its group's first
        self._names = {point: name for name, point in reversed(list(deck.names.items()))}

    def linked(self) -> Linked:
        """Gather the links of all groups, and what is on them."""
        deck, links = self._deck, dict[str, LinkedFace]()
        references = {int(each.points[0]) for each in (*deck.rigid, *deck.mean)}
        for point in (*sorted(references | self._turned_nodes()), *deck.points[deck.points >= self._n]):
            self._root(int(point))
        for each in deck.rigid:
            self._join(each, references)
        for first in dict.fromkeys(self._root(point) for point in list(self._above)):
            rigid = [each for each in deck.rigid if self._root(int(each.points[0])) == first]
            mean = [each for each in deck.mean if self._root(int(each.points[0])) == first]
            marker, onto = self._piece(first, rigid, mean), self._followed(first, rigid, mean)
            if onto is not None and not len(marker.nodes):
                marker, onto = onto, None
            links[self._names[first]] = LinkedFace(marker, self._x[first], self._pinned(first, rigid), onto)
        at = {point: self._names[self._root(point)] for point in self._above}
        node_masses = np.zeros(self._first + self._n)
        for mass in deck.masses:
            if (point := int(mass.points[0])) in at:
                continue
            if mass.offset.any() or mass.inertia.any():
                raise ValueError(f"{mass.label} has an offset or inertia at a node of the solid, which doesn't turn")
            node_masses[self._first + point] += mass.mass
        return Linked(
            links,
            [self._hung(mass) for mass in deck.masses if int(mass.points[0]) in at],
            node_masses,
            [self._relation(each, links) for each in deck.equations],
            [self._relation(each, links) for each in deck.springs],
            {name: (at[point], self._x[point]) for name, point in deck.names.items() if point in at},
            [self._tie(each) for each in deck.ties],
        )

    def _tie(self, each: TiedFaces) -> Tie:
        """Return the tie of two faces of solids, or of shells by their nodes."""
        row = self._first + int(each.face.flat[0])
        member = member_of(self._space.members, row)
        midsurface = member.space.mesh.midsurface
        first = member.first + (0 if midsurface is None else len(member.space.x)) - self._first
        return tie_faces(self._fe, member, replace(each, face=each.face - first, onto=each.onto - first))

    def _turned_nodes(self) -> set[int]:
        """Return the nodes of a shell whose rotations are wanted."""
        eccentric = [each.points for each in self._deck.masses if each.offset.any() or each.inertia.any()]
        turned = [each.points[each.directions >= 3] for each in (*self._deck.equations, *self._deck.springs)]
        points = np.concatenate([np.zeros(0, dtype=np.int64), *eccentric, *turned])
        return set(map(int, self._turning(points)))

    def _turning(self, points: IntArray) -> IntArray:
        """Return those of some points that are the body's nodes with rotations."""
        own = points[points < self._n]
        return np.asarray(own[self._turns[own]])

    def _root(self, point: int) -> int:
        """Return the first point of a point's group; a point of no group makes one."""
        while (above := self._above.setdefault(point, point)) != point:
            point = above
        return point

    def _join(self, each: RigidConnection, references: set[int]) -> None:
        """Put the points with rotations of a rigid connection into one group."""
        first, *others = map(int, each.points)
        for point in others:
            if point >= self._n and not each.turning:
                raise ValueError(f"{each.label} doesn't turn point {self._names[point]}, which has rotations")
            if point >= self._n or (each.turning and point in references):
                self._above[self._root(point)] = self._root(first)

    def _piece(self, first: int, rigid: list[RigidConnection], mean: list[MeanConnection]) -> Marker:
        """Return the marker of the nodes that move as one, of a shell those that turn with it."""
        tied = np.concatenate([np.array([first]), *(each.points for each in rigid)])
        tied = np.setdiff1d(tied, self._pinned(first, rigid) - self._first)
        nodes = np.unique(tied[tied < self._n])
        if not rigid and not mean and len(self._turning(nodes)):
            return single_node_marker(self._space, self._first + first)
        points = points_of_nodes(self._space, self._first + nodes)
        return weighted_marker(points, self._space.x[points], np.ones(len(points)), rigid=True)

    def _followed(self, first: int, rigid: list[RigidConnection], mean: list[MeanConnection]) -> Marker | None:
        """Return the marker of the face that the reference of a group follows in the mean."""
        if not mean:
            return None
        if len(mean) > 1:
            raise ValueError(f"{' and '.join(each.label for each in mean[:3])} move the same point; leave one")
        (own,) = mean
        if (own.points[1:] >= self._n).any():
            raise ValueError(f"{own.label} follows points that aren't nodes of the body, which isn't read")
        if not own.turning and (rigid or len(self._turning(own.points[:1]))):
            hung = rigid[0].label if rigid else "a node with rotations"
            raise ValueError(f"{own.label} doesn't turn its point, on which {hung} hangs; write 123456")
        if own.facets and not len(self._turning(np.concatenate([each.ravel() for each in own.facets]))):
            return face_marker(self._space, list(own.facets))
        weights = self._areas(own) if own.facets else own.weights
        marker = weighted_marker(self._first + own.points[1:], self._x[own.points[1:]], weights)
        if own.turning and np.linalg.matrix_rank(marker.rotation_weights.reshape(3, -1), ON_A_LINE) < 3:
            raise ValueError(f"{own.label} follows nodes that lie on a line, about which they don't turn")
        return marker

    def _pinned(self, first: int, rigid: list[RigidConnection]) -> IntArray:
        """Return the points of a shell's nodes that a group moves but doesn't turn."""
        turning = np.concatenate([np.array([first]), *(each.points for each in rigid if each.turning)])
        others = np.concatenate([np.zeros(0, dtype=np.int64), *(each.points for each in rigid)])
        return self._first + self._turning(np.setdiff1d(others, turning))

    def _areas(self, own: MeanConnection) -> Array:
        """Return the area around each of the points that an average link follows on a shell."""
        areas = np.zeros(len(self._x))
        for facets in own.facets:
            r = self._x[facets] - self._x[facets[:, :1]]
            area = sum(np.cross(r[:, k], r[:, k + 1]) for k in range(1, facets.shape[1] - 1))
            np.add.at(areas, facets, np.linalg.norm(area, axis=1)[:, None] / (2 * facets.shape[1]))
        return np.asarray(areas[own.points[1:]])

    def _hung(self, mass: MassOnPoint) -> LumpedMass:
        point = int(mass.points[0])
        for each in self._deck.mean:
            if each.points[0] == point and not each.turning and (mass.offset.any() or mass.inertia.any()):
                raise ValueError(f"{each.label} doesn't turn its point, where {mass.label} has an offset or inertia")
        return LumpedMass(self._names[self._root(point)], mass.mass, self._x[point] + mass.offset, mass.inertia)

    def _relation(self, each: Equation, found: Mapping[str, LinkedFace]) -> Relation:
        """Turn a sum of displacements of points into one of nodes and references, which no rigid motion changes."""
        nodes, links, of_rigid = dict[int, Array](), dict[str, Array](), np.zeros(6)
        for point, direction, coefficient in zip(each.points.tolist(), each.directions, each.coefficients, strict=True):
            turned = coefficient * np.eye(6)[direction]
            of_rigid += turned if direction >= 3 else coefficient * rigid_motions(self._x[[point]])[0, direction]
            if point in self._above:
                link = self._names[self._root(point)]
                arm = self._x[[point]] - found[link].at
                row = turned if direction >= 3 else coefficient * rigid_motions(arm)[0, direction]
                links[link] = links.get(link, np.zeros(6)) + row
            elif direction < 3:
                node = self._first + point
                nodes[node] = nodes.get(node, np.zeros(3)) + turned[:3]
            else:
                raise ValueError(f"{each.label} has a rotation at node {self._names[point]}, which has none")
        size = np.abs(each.coefficients).max() * np.repeat([1.0, np.ptp(self._x, axis=0).max()], 3)
        if (worst := float((np.abs(of_rigid) / size).max())) > RIGID_RESIDUAL:
            raise ValueError(
                f"{each.label} resists rigid motions, by {worst:.2g} of its coefficients: it holds the body to the "
                "ground. Springs are between points at one place; to hold a body in its frame there is support"
            )
        stiffness = each.stiffness if isinstance(each, SpringBetween) else 0.0
        return Relation(each.label, nodes, links, stiffness, int(each.points[0]) in self._above)
