"""Connections of a deck's solid elements: rigid and average links, equations, springs and lumped masses.

Points are those of the solid's mesh, and behind them others, which have displacement and rotation. `fem.deck_links`
turns this into links of the finite element model.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import field, replace
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass


@dataclass(frozen=True)
class Connection:
    """Something between points."""

    label: str  # what it is and its number in the deck, e.g. ``RBE2 17``
    points: IntArray  # (n,): numbers of its points


@dataclass(frozen=True)
class RigidConnection(Connection):
    """Points that move as one rigid piece with the first of them (RBE2, RBAR, ``*RIGID BODY``)."""

    turning: bool = True  # true if points with rotations of their own turn with the first


@dataclass(frozen=True)
class MeanConnection(Connection):
    """A first point that moves as the others do in the mean (RBE3, ``*DISTRIBUTING``)."""

    weights: Array  # (n - 1,): weights of the others, if they are given
    # (m, 3 or 4): corners of the facets whose areas weight the others, if weights aren't given
    facets: tuple[IntArray, ...] = ()
    turning: bool = True  # true if the first point turns as the others do


@dataclass(frozen=True)
class Equation(Connection):
    """A sum of displacements and rotations that is zero (MPC, ``*EQUATION``)."""

    directions: IntArray  # (n,): direction at each point: 0, 1, 2 for displacement along x, y, z, 3, 4, 5 for rotation
    coefficients: Array  # (n,): for displacements without unit, for rotations in the file's unit of length


@dataclass(frozen=True)
class SpringBetween(Equation):
    """A sum of displacements or of rotations that a spring resists (CELAS, ``*SPRING``)."""

    stiffness: float  # force over displacement, or torque over angle


@dataclass(frozen=True)
class MassOnPoint(Connection):
    """A rigid body on a point (CONM2, ``*MASS``, ``*ROTARY INERTIA``)."""

    mass: float
    offset: Array  # (3,): centre of mass from the point
    inertia: Array  # (3, 3): tensor about the centre of mass


@dataclass(frozen=True)
class TiedFaces(Connection):
    """Faces of solids without common nodes, of which the first follows the second (``*TIE``)."""

    face: IntArray  # (n,) or (n_facets, 3 or 4): points of the face that follows, or the corners of its facets
    onto: IntArray  # (n,) or (n_facets, 3 or 4): the like of the face that it follows
    within: float | None = None  # how far apart both may be, in the file's unit; a share of the facets' size by default


@dataclass(frozen=True)
class Connections:
    """All connections of a deck."""

    rigid: tuple[RigidConnection, ...] = ()
    mean: tuple[MeanConnection, ...] = ()
    equations: tuple[Equation, ...] = ()
    springs: tuple[SpringBetween, ...] = ()
    masses: tuple[MassOnPoint, ...] = ()
    ties: tuple[TiedFaces, ...] = ()
    # (n, 3): positions of the points that aren't the solid's [m]; empty while the deck's points are still together
    places: Array = field(default_factory=lambda: np.zeros((0, 3)))
    # Points by their number in the deck, and by the names of sets that hold one point.
    names: Mapping[str, int] = field(default_factory=dict)

    @property
    def all(self) -> tuple[Connection, ...]:
        """Connections of every kind."""
        return (*self.rigid, *self.mean, *self.equations, *self.springs, *self.masses, *self.ties)

    @property
    def points(self) -> IntArray:
        """Numbers of the points that are connected, ascending."""
        return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(each.points for each in self.all)]))

    @property
    def point_groups(self) -> list[IntArray]:
        """Points of each connection that joins some."""
        return [each.points for each in self.all if len(each.points) > 1]

    @property
    def mass(self) -> float:
        """Sum of the lumped masses."""
        return sum(each.mass for each in self.masses)

    def only(self, kept: Collection[Connection]) -> Connections:
        """Return some of the connections, which are objects of this one, with all its points."""
        ids = {id(each) for each in kept}
        kinds: dict[str, Any] = {
            kind: tuple(each for each in getattr(self, kind) if id(each) in ids)
            for kind in ("rigid", "mean", "equations", "springs", "masses", "ties")
        }
        return replace(self, **kinds)

    def named(self, names: Mapping[str, int]) -> Connections:
        """Return the connections with those names whose points are connected."""
        used = set(self.points.tolist())
        return replace(self, names={name: point for name, point in names.items() if point in used})

    def count(self) -> dict[str, int]:
        """Count the connections by the first word of their labels."""
        found: dict[str, int] = {}
        for each in self.all:
            name = each.label.rpartition(" ")[0]
            found[name] = found.get(name, 0) + 1
        return found

    def numbered(self, number: Mapping[int, int], places: Array | None = None) -> Connections:
        """Return the connections of points with other numbers, those behind the mesh's at ``places``.

        Raises
        ------
        ValueError
            A point has no number; the message names it and what is connected to it.
        """
        for each in self.all:
            for point in each.points.tolist():
                if point not in number:
                    raise ValueError(f"{each.label} names point {point}, which isn't there")

        def new(points: IntArray) -> IntArray:
            return np.array([number[point] for point in points.ravel().tolist()], dtype=np.int64).reshape(points.shape)

        return Connections(
            tuple(replace(each, points=new(each.points)) for each in self.rigid),
            tuple(replace(each, points=new(each.points), facets=tuple(map(new, each.facets))) for each in self.mean),
            tuple(replace(each, points=new(each.points)) for each in self.equations),
            tuple(replace(each, points=new(each.points)) for each in self.springs),
            tuple(replace(each, points=new(each.points)) for each in self.masses),
            tuple(
                replace(each, points=new(each.points), face=new(each.face), onto=new(each.onto)) for each in self.ties
            ),
            self.places if places is None else places,
            {name: number[point] for name, point in self.names.items() if point in number},
        )

    def in_si(self, length: float, mass: float, force: float) -> Connections:
        """Return the connections in SI units, given the file's units of length [m], mass [kg] and force [N]."""
        masses = [
            replace(each, mass=each.mass * mass, offset=each.offset * length, inertia=each.inertia * (mass * length**2))
            for each in self.masses
        ]
        springs = []
        for each in self.springs:
            turns = int((each.directions >= 3).all()), int((each.directions >= 3).any())
            springs.append(replace(each, stiffness=each.stiffness * force * length ** (sum(turns) - 1)))
        equations = [
            replace(each, coefficients=np.where(each.directions < 3, 1.0, length) * each.coefficients)
            for each in self.equations
        ]
        ties = [each if each.within is None else replace(each, within=each.within * length) for each in self.ties]
        return replace(self, masses=tuple(masses), springs=tuple(springs), equations=tuple(equations), ties=tuple(ties))
