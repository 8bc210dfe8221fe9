"""A body with the points of its faces that may touch, and the planes and faces that they may touch."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor
from scipy.linalg.lapack import dpotri

from fmd.contact.columns import Columns, stiffness_of_all
from fmd.contact.curved_grid import CurvedGrid
from fmd.contact.primitives import Primitive
from fmd.contact.recorded import ContactRecord
from fmd.contact.round_laws import RoundLaw
from fmd.contact.surface_fit import is_flat
from fmd.core.arrays import Array, BoolArray, IntArray, require_shape
from fmd.core.data_classes import dataclass
from fmd.core.limits.contact import CARRYING


@dataclass(frozen=True)
class ContactPoints:
    """Points of a body's faces, and how they move.

    A force ``f_d`` on point d moves point c by ``shapes_c q`` through the modes and by ``G_cd f_d`` beside them; what
    the modes leave out is static and has no mass (massless-boundary reduction; Monjaraz-Tec, Gross & Krack, J Sound
    Vib 534, 2022).
    """

    x: Array  # (n, 3): undeformed positions in the body's frame [m]
    areas: Mapping[str, Array]  # force on each of a face's points by a pressure of 1 on it [m²]
    shapes: Array  # (n, 3, n_modes): displacements for unit modal coordinates [kg^-1/2]
    # (n, 3, n, 3): residual flexibility [m/N], symmetric and positive definite; (0, 3, 0, 3) of more than `MOST_POINTS`
    G: Array
    faces: Mapping[str, IntArray]  # numbers of the points that carry pressure on each face, by its marker's name
    raised: float = 0.0  # share of its directions in which modes left too little, and G has been raised
    # (n_triangles, 3): points at the corners of the triangles of each face that may touch one of another body,
    # counter-clockwise seen from outside
    surfaces: Mapping[str, IntArray] = field(default_factory=dict)
    # (n,): points at the border of a grid that is smaller than its face: a contact that presses them is larger
    border: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    # Young's modulus [Pa] and Poisson's ratio; ``None`` of several materials.
    elastic: tuple[float, float] | None = None
    # (n_nodes,): nodes of the body's mesh that the points are at, or that a grid's are between
    nodes: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    # (n, n_nodes): by which forces on a grid's points act on these nodes; without, each point is at its own
    weights: Array | None = None
    grids: Mapping[str, CurvedGrid] = field(default_factory=dict)
    # (n,): of points that are centres of balls or of pieces of pins [m]; 0 of nodes
    radii: Array = field(default_factory=lambda: np.zeros(0))
    shares: Array = field(default_factory=lambda: np.zeros(0))  # (n,): part of a law's force that each of those has
    # Surfaces of a rigid body that points of others may touch.
    primitives: Mapping[str, Primitive] = field(default_factory=dict)
    # (n, 3, 6) each: by which unit forces [m/N] and moments [m/(N m)] on markers move points beside the modes
    yields: Mapping[str, Array] = field(default_factory=dict)
    # Of more than `MOST_POINTS`.
    soft: Array = field(default_factory=lambda: np.zeros(0))  # (n,): each one's own flexibility, bounded [m/N]
    held: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (6 + n_modes,) * 2: stiffness of all held
    left_to_modes: Array = field(default_factory=lambda: np.zeros((0, 3, 0)))  # (n, 3, n_modes): W, by G = K⁺ - W Wᵀ
    columns: Columns | None = None  # what finds G

    def __post_init__(self) -> None:
        n = len(self.x)
        if not len(self.border):
            object.__setattr__(self, "border", np.zeros(n, dtype=bool))
        if not len(self.radii):
            object.__setattr__(self, "radii", np.zeros(n))
            object.__setattr__(self, "shares", np.ones(n))
        require_shape("x", self.x, (None, 3))
        for name in ("border", "radii", "shares"):
            require_shape(name, getattr(self, name), (n,))
        for name, numbers in self.faces.items():
            require_shape(f"areas of {name}", self.areas[name], (len(numbers),))
        require_shape("shapes", self.shapes, (n, 3, None))
        require_shape("G", self.G, (n, 3, n, 3) if not len(self.soft) else (0, 3, 0, 3))

    def on_nodes(self, forces: Array, places: Array) -> Array:
        """Return the forces on `nodes` of forces on points, (n_times, n, 3) and (n_times, n_nodes, 3).

        Points of a grid that travels have places (n_times, n, 3).
        """
        if self.weights is None or not places.shape[1]:
            return forces if self.weights is None else np.einsum("np,tna->tpa", self.weights, forces)
        found = np.zeros((len(forces), len(self.nodes), 3))
        for t in np.flatnonzero(forces.any(axis=(1, 2))):
            pressed = forces[t].any(axis=1)
            found[t] = self._weights_at(places[t, pressed]).T @ forces[t, pressed]
        return found

    def _weights_at(self, x: Array) -> Array:
        (grid,) = self.grids.values()
        return grid.weights(x)

    def moved_to(self, places: Array) -> ContactPoints:
        """Return points with a grid that has travelled to places (n, 3), without the flexibility there."""
        if not len(places):
            return self
        (grid,), weights = self.grids.values(), self._weights_at(places)
        shapes = np.einsum("ip,pam->iam", weights, grid.points.shapes)
        yields = {name: np.einsum("ip,pak->iak", weights, own) for name, own in grid.points.yields.items()}
        return replace(self, x=places, weights=weights, shapes=shapes, yields=yields)

    @property
    def has_primitives(self) -> bool:
        """True of a rigid body's balls, boxes, pins and bores; false of its triangles, which touch as meshes do."""
        return bool((self.radii > 0.0).any() or self.primitives)

    @property
    def extent(self) -> float:
        """Largest extent of the points along an axis [m]; 0 without points."""
        return float(np.ptp(self.x, axis=0).max() + 2.0 * self.radii.max()) if len(self.x) else 0.0

    def is_flat(self, face: str) -> bool:
        """Return true if the points of a face are all but in a plane."""
        return is_flat(self.x[self.faces[face]])

    def under_grids(self, places: Array) -> IntArray:
        """Return nodes of the mesh that carry grids, at places (n_times, n, 3) of those that travel.

        Elements are too large for the stress there.
        """
        if self.weights is None:
            return np.zeros(0, dtype=np.int64)
        rows, under = np.concatenate([self.faces[name] for name in self.grids]), np.zeros(len(self.nodes), dtype=bool)
        for x in np.unique(places, axis=0) if places.shape[1] else [places]:
            weights = self._weights_at(x) if len(x) and places.shape[1] else self.weights[rows]
            under |= (np.abs(weights) > CARRYING).any(axis=0)
        return np.asarray(self.nodes[under])

    @cached_property
    def held_stiffness(self) -> Array:
        """Inverse of G [N/m], shape (3 n, 3 n)."""
        n = 3 * len(self.x)
        factor, _ = cho_factor(self.G.reshape(n, n), lower=True)
        half = np.tril(dpotri(factor, lower=True)[0])
        return np.asarray(half + np.tril(half, -1).T)

    @property
    def softness(self) -> Array:
        """Bound of each point's own residual flexibility in any direction [m/N], shape (n,)."""
        return self.soft if len(self.soft) else np.asarray(np.einsum("iaia->i", self.G))

    def between(self, numbers: IntArray) -> Array:
        """Return the flexibility between some points, (k, 3, k, 3)."""
        return self.G[numbers][:, :, numbers] if self.columns is None else self.columns.between(numbers)


@dataclass(frozen=True)
class ContactPlane:
    """A plane of the ground that some of a body's points may touch."""

    name: str
    position: Array  # (3,): a point of the plane in space [m]
    normal: Array  # (3,): unit vector out of the ground
    friction: float  # coefficient of Coulomb's friction
    face: str  # name of the marker on the body's face
    clearance: float = 0.0  # what is added to gaps [m]
    damping: float = 0.0  # time β of the damping of the points' flexibility [s]
    near_field: str = "mesh"  # what gives the flexibility near a contact
    law: RoundLaw | None = None  # force of each point of a rigid body by its depth
    slide: float = 1.0  # how much softer it is aside
    wear: float = 0.0  # depth by pressure and slip [1/Pa]

    @property
    def axes(self) -> Array:
        """Normal and two tangents, a row each, shape (3, 3)."""
        other = np.eye(3)[int(np.abs(self.normal).argmin())]
        first = np.cross(self.normal, other)
        first /= np.linalg.norm(first)
        return np.stack([self.normal, first, np.cross(self.normal, first)])


@dataclass(frozen=True)
class ContactPair:
    """A face of a body whose points may touch the triangles of a face of another.

    Corners and edges of the other's face are looked for on this one's triangles, since they may come between points.
    """

    name: str
    face: str  # name of the marker on its face
    other: str  # the other body's name
    other_face: str  # name of the marker on the other's face
    friction: float = 0.0  # coefficient of Coulomb's friction
    clearance: float = 0.0  # what is added to gaps [m]
    damping: float = 0.0  # time β of the damping of the points' flexibility [s]
    reported_on_other: bool = False  # true if the contact's force is to be that on the other body
    near_field: str = "mesh"  # what gives the flexibility near a contact
    law: RoundLaw | None = None  # force of each point of a rigid body by its depth, before another one
    slide: float = 1.0  # how much softer it is aside
    wear: float = 0.0  # depth by pressure and slip [1/Pa], of both faces
    edges: str = ""  # this body's surface, a box, if its edges are meant, before those of the other's
    # What belongs to the same contact: of two boxes the other's corners before this one, and edges before edges.
    others: tuple[ContactPair, ...] = ()


@dataclass(frozen=True)
class TouchingBody:
    """A body of a mechanism that touches planes or other bodies."""

    body: str  # the link's name
    points: ContactPoints
    planes: tuple[ContactPlane, ...] = ()
    # Contacts of its faces with those of other bodies, each in the list of one of the two.
    pairs: tuple[ContactPair, ...] = ()
    # (3,) and (3, 3): Origin and axes of its frame at the start; slip before planes counts from where points are then,
    # undeformed. By default from where each is as it comes near.
    anchor: tuple[Array, Array] | None = None
    felt: tuple[str, ...] = ()  # markers whose loads and force elements move its points beside its modes

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of its points and of its modes."""
        n, _, modes = self.points.shapes.shape
        return n, modes

    @property
    def felt_yields(self) -> Array:
        """Displacements of its points by unit forces and moments on the markers that they feel, (n, 3, 6 n_felt)."""
        return np.concatenate(
            [np.zeros((len(self.points.x), 3, 0)), *(self.points.yields[own] for own in self.felt)], 2
        )

    @property
    def contacts(self) -> tuple[ContactPlane | ContactPair, ...]:
        """Contacts of the body, in the order of their values."""
        return (*self.planes, *self.pairs)

    @property
    def damping(self) -> float:
        """Largest time of damping of its contacts [s]."""
        return max((own.damping for own in self.contacts), default=0.0)

    @property
    def wears(self) -> bool:
        """True if a contact in its list wears faces."""
        return any(own.wear > 0.0 for own in self.contacts)

    @property
    def travels(self) -> bool:
        """True if a grid follows a contact along its face."""
        return any(any(own.travels) for own in self.points.grids.values())

    @property
    def is_lossy(self) -> bool:
        """True if its contacts rub, are damped, or lose energy in a shock."""
        return self.damping > 0.0 or any(own.friction > 0.0 or (own.law and own.law.loss) for own in self.contacts)

    @property
    def digest(self) -> str:
        """Digest of all numbers."""
        arrays = ("x", "shapes", "G", "radii", "shares", "soft", "held", "left_to_modes")
        own = [*(getattr(self.points, name) for name in arrays), *self.points.areas.values()]
        own += [x for plane in self.planes for x in (plane.position, plane.normal)]
        own += self.anchor or ()
        own += [*self.points.faces.values(), *self.points.surfaces.values(), *self.points.yields.values()]
        content = b"".join(np.ascontiguousarray(x).tobytes() for x in own)
        laws = (
            (at.name, at.face, at.friction, at.clearance, at.damping, at.law, at.slide, at.wear) for at in self.planes
        )
        names = repr(
            [self.travels, self.body, self.pairs, self.points.primitives, self.felt, [*self.points.yields], *laws]
        )
        return hashlib.blake2b(content + names.encode(), digest_size=16).hexdigest()

    def stiffness(self, J: Array) -> Array:
        """Return the stiffness of all points held, ``Jᵀ G⁻¹ J``, (n, n), of velocities J (n_points, 3, n).

        Velocities are in the body's axes. Any fewer points, and any of their directions alone, are less stiff.
        """
        if len(self.points.soft):
            return stiffness_of_all(self.points.x, self.points.shapes, self.points.held, J)
        n = 3 * len(self.points.x)
        rows = J.reshape(n, J.shape[2])
        return np.asarray(rows.T @ np.linalg.solve(self.points.G.reshape(n, n), rows))

    @staticmethod
    def record(bodies: Sequence[TouchingBody], rows: Array) -> ContactRecord:
        """Return what a march has noted of a mechanism's bodies that touch, rows (n_times, n_values)."""
        return ContactRecord(bodies, rows)

    @staticmethod
    def signs(bodies: Sequence[TouchingBody], modes: Sequence[Array]) -> Array:
        """Return the signs of what a march notes of bodies whose modal coordinates have some, (n_modes,) each."""
        return ContactRecord.signs(bodies, modes)

    def face_of(self, contact: str) -> str:
        """Return the face whose points one of its contacts takes."""
        return {own.name: own.face for own in self.contacts}[contact]

    def faces_of(self, contact: str) -> list[tuple[str, str]]:
        """Return bodies and faces of one of its contacts, first its own, whose points the contact takes."""
        own = next(own for own in self.contacts if own.name == contact)
        return [(self.body, own.face)] + ([(own.other, own.other_face)] if isinstance(own, ContactPair) else [])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its contacts, in the order of their values."""
        return tuple(own.name for own in self.contacts)
