"""Solids, shells and beams as one body: a mesh of each kind of elements, and the nodes by which they hang together.

Rows of the body are the points of the first mesh, the nodes of its midsurface if it has one, then those of the next. A
node that two of them have in common is a row of each, and one of both leads. A node moves on as a point: where solids
lead, a shell or a beam is held by a ball joint, since solids have no rotations; where a shell leads, a beam turns with
it.
"""

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from fmd.core.arrays import Array, BoolArray, IntArray, short_repr
from fmd.core.data_classes import dataclass
from fmd.fem.connections import Connections
from fmd.fem.elements import Formulation
from fmd.fem.mesh import SolidMesh
from fmd.fem.midsurface import Layup
from fmd.fem.space import Discretisation, Member

HINGE_MEND = "let their set follow the solids' face by mesh.tie, or let elements lie on the solids"
"""End of notes about nodes that turn freely where they should not."""
STRUT_MEND = "take the end to several nodes by RBE2, RBE3 or *COUPLING"
"""End of notes about beams whose moment one node of a shell bears."""


@dataclass(frozen=True)
class Seam:
    """Nodes of shells and beams that move and turn with a face of solids."""

    label: str  # what it is, for messages
    nodes: IntArray  # (n,): rows of the nodes
    onto: IntArray  # (m,) or (m, 3 or 4): rows of the face's points, or of the corners of its facets
    within: float | None = None  # how far apart both may be [m]; a share of the facets' size by default


@dataclass(frozen=True)
class JoinedMesh:
    """Meshes of solids, shells and beams that are one body."""

    members: tuple[SolidMesh, ...]  # of each kind, solids first
    shared: IntArray  # (n, 2): rows of nodes that are one; the second follows the first
    seams: tuple[Seam, ...] = ()
    notes: tuple[str, ...] = ()
    connections: Connections | None = None  # links, masses, springs and equations of the file, by rows

    sectors = 1  # it isn't cyclic

    __repr__ = short_repr

    @property
    def firsts(self) -> IntArray:
        """Row of the first point of each member, and the number of all rows, shape (n_members + 1,)."""
        return np.cumsum([0, *(len(own.points) + count_nodes(own) for own in self.members)])

    @property
    def first_cells(self) -> IntArray:
        """Number of the first cell of each member, and of all cells, shape (n_members + 1,)."""
        return np.cumsum([0, *(len(own.cells) for own in self.members)])

    @property
    def n_cells(self) -> int:
        """Number of all cells."""
        return int(self.first_cells[-1])

    @property
    def cell_type(self) -> str:
        """The types of the cells."""
        return " and ".join(own.cell.element(own.order).name for own in self.members)

    @property
    def order(self) -> int:
        """Order of the solids' own nodes."""
        return self.members[0].order

    @property
    def midsurface(self) -> None:
        """Nothing: each member has its own."""

    @property
    def quality(self) -> Array:
        """Smallest scaled Jacobian over the corners of each cell, shape (n_cells,)."""
        return np.concatenate([own.quality for own in self.members])

    @property
    def volume(self) -> float:
        """Enclosed volume of all members [m³], what they have in common counted for each."""
        return sum(own.volume for own in self.members)

    @property
    def points(self) -> Array:
        """Positions of all rows, shape (n_rows, 3) [m]."""
        nodes = ([own.points] if own.midsurface is None else [own.points, own.midsurface.nodes] for own in self.members)
        return np.concatenate([each for own in nodes for each in own])

    @cached_property
    def faces(self) -> Mapping[str, IntArray]:
        """Rows of each face's points, or of the corners of its facets (n, 3)."""
        found: dict[str, list[IntArray]] = {}
        for first, own in zip(self.firsts, self.members, strict=False):
            for name, face in own.faces.items():
                found.setdefault(name, []).append(first + face)
        return {
            name: np.concatenate(own)
            if len({each.ndim for each in own}) == 1
            else np.unique(np.concatenate([each.ravel() for each in own]))
            for name, own in found.items()
        }

    @cached_property
    def parts(self) -> Mapping[str, IntArray]:
        """Cell numbers of each part; those of a name are one part."""
        found: dict[str, list[IntArray]] = {}
        for first, own in zip(self.first_cells, self.members, strict=False):
            for name, cells in own.parts.items():
                found.setdefault(name, []).append(first + cells)
        return {name: np.concatenate(own) for name, own in found.items()}

    @property
    def centres(self) -> Mapping[str, Array]:
        """Nothing: no face has a place by its geometry."""
        return {}

    @property
    def layup(self) -> Layup | None:
        """Layers of shells by their deck, among all cells."""
        for k, own in enumerate(self.members):
            if own.midsurface is not None and (layup := own.midsurface.layup) is not None:
                mine = slice(self.first_cells[k], self.first_cells[k + 1])
                numbers, directions = np.full(self.n_cells, -1), np.zeros((self.n_cells, 3))
                numbers[mine], directions[mine] = layup.numbers, layup.directions
                return Layup(layup.stacks, numbers, directions)
        return None


def count_nodes(mesh: SolidMesh) -> int:
    """Return the number of a shell's or beams' nodes; solids have none beside their points."""
    return 0 if mesh.midsurface is None else len(mesh.midsurface.nodes)


AnyMesh = SolidMesh | JoinedMesh


@dataclass(frozen=True)
class JoinedSpace:
    """Nodes and elements of solids, shells and beams that are one body."""

    mesh: JoinedMesh
    order: int  # of the solids' displacement
    formulation: Formulation = "enhanced"

    @cached_property
    def members(self) -> tuple[Member, ...]:
        """The elements of each kind."""
        found, facets = list[Member](), 0
        for k, own in enumerate(self.mesh.members):
            space = Discretisation(own, self.order if own.midsurface is None else own.order, self.formulation)
            found.append(Member(space, int(self.mesh.firsts[k]), int(self.mesh.first_cells[k]), facets, False))
            facets += len(space.boundary_facets[0])
        return tuple(found)

    @cached_property
    def x(self) -> Array:
        """Positions of all rows, shape (n_rows, 3) [m]."""
        return self.mesh.points

    @property
    def volumes(self) -> Array:
        """Volume of each element, shape (n_elements,) [m³]."""
        return np.concatenate([own.space.volumes for own in self.members])

    @cached_property
    def turning(self) -> BoolArray:
        """True for each row that is a node with rotations, shape (n_rows,)."""
        return np.concatenate(
            [np.arange(len(own.points) + count_nodes(own)) >= len(own.points) for own in self.mesh.members]
        )


AnySpace = Discretisation | JoinedSpace
