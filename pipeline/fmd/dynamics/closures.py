"""Constraints that close loops of a mechanism: joints between bodies that both hang on others, and couplers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import Self

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.joint_kinds import SPACE, JointKind, find_direction
from fmd.reduction.body import MarkerShapes

GROUND = ""
"""Name of the ground where a body's is asked for."""


@dataclass(frozen=True)
class Place:
    """A marker of a body, or a place on the ground."""

    body: str  # the link's name; empty for the ground
    marker: MarkerShapes  # place, and how the body's modes move and turn it, in the body's frame [m]

    def with_modes(self, kept: Mapping[str, IntArray]) -> Self:
        """Return the same on a body with some of its modes alone, by bodies' names."""
        if self.body not in kept:
            return self
        return replace(self, marker=self.marker.with_modes(kept[self.body]))


def fixed_place(position: Array) -> Place:
    """Make a place on the ground, shape (3,) [m]."""
    return Place(GROUND, MarkerShapes(np.asarray(position, dtype=float)))


@dataclass(frozen=True)
class Closure:
    """A joint that closes a loop: what the relative motion of two places has to keep."""

    name: str
    first: Place  # the joint's place on the parent
    second: Place  # the joint's place on the child
    # (k, 3): directions in which the places coincide: in space if they are three, else in the axes of the first's
    # section
    along: Array = field(default_factory=lambda: np.zeros((0, 3)))
    # (k, 2, 3): pairs of directions, one in the axes of the first's and one of the second's section, whose products sum
    # to zero: a single pair stays perpendicular
    square: Sequence[Array] = ()
    distance: float = 0.0  # distance that the places keep [m]; 0 for none
    # Numbers of the scalar constraints that aren't kept, in the order ``along``, ``square``, ``distance``: nothing can
    # move them, so they hold by themselves.
    left_out: Sequence[int] = ()

    @property
    def bodies(self) -> tuple[str, ...]:
        """The links that it constrains; the ground is none."""
        return tuple(place.body for place in (self.first, self.second) if place.body != GROUND)

    def with_modes(self, kept: Mapping[str, IntArray]) -> Closure:
        """Return the same for bodies with some of their modes alone."""
        first, second = (place.with_modes(kept) for place in (self.first, self.second))
        return replace(self, first=first, second=second)

    @property
    def n_rows(self) -> int:
        """Number of its scalar constraints."""
        return len(self.along) + len(self.square) + bool(self.distance)

    def require_valid(self) -> None:
        """Raise ``ValueError`` unless it constrains something between two bodies."""
        if self.first.body == self.second.body:
            raise ValueError(f"joint {self.name} closes a loop from a body to itself")
        if not self.n_rows:
            raise ValueError(f"joint {self.name} constrains nothing")
        if self.distance < 0.0:
            raise ValueError(f"the distance of {self.name} is {self.distance:g} m, expected one above 0")


@dataclass(frozen=True)
class Coupler:
    """A linear relation between joint coordinates, ``Σ factors s = offset``: gears and racks."""

    name: str
    joints: Sequence[str]  # links whose joints, of one coordinate each, take part
    factors: Sequence[float]
    offset: float = 0.0  # value of the sum

    @property
    def bodies(self) -> tuple[str, ...]:
        """The links whose joints it couples."""
        return tuple(self.joints)

    def with_modes(self, kept: Mapping[str, IntArray]) -> Coupler:
        """Return itself."""
        return self

    def require_valid(self) -> None:
        """Raise ``ValueError`` unless there is a factor for each joint."""
        if len(self.joints) != len(self.factors) or not any(self.factors):
            raise ValueError(f"coupler {self.name} has {len(self.joints)} joints and factors {list(self.factors)}")


Constraint = Closure | Coupler


def close_joint(
    kind: JointKind,
    name: str,
    first: Place,
    second: Place,
    axis: Array,
    other: Array | None = None,
    of_first: Array | None = None,
    of_second: Array | None = None,
) -> Closure:
    """Make the closure of a joint by the directions that its kind keeps.

    Its axis (3,) is in the axes of the first place, the other in those of the second, the same numbers by default.
    Rotations (3, 3) are from the axes of each place into those of its body; none by default.

    Raises
    ------
    ValueError
        A joint of this kind can't close a loop, or an axis has no direction.
    """
    if not (kind.points or kind.squares):
        raise ValueError(f"joint {name} is {kind.name}, which can't close a loop")
    if not all(np.linalg.norm(given) > 0.0 for given in (axis, axis if other is None else other)):
        raise ValueError(f"the axis of {name} has no direction")

    def of_parent(along: str) -> Array:
        direction = find_direction(along, axis)
        return direction if of_first is None else np.asarray(of_first @ direction)

    def of_child(along: str) -> Array:
        direction = find_direction(along, axis if other is None else other)
        return direction if of_second is None else np.asarray(of_second @ direction)

    everywhere = kind.points == SPACE
    along = np.eye(3) if everywhere else np.array([of_parent(name) for name in kind.points])
    square = [np.array([[of_parent(one), of_child(two)] for one, two in row]) for row in kind.squares]
    return Closure(name, first, second, along, square)
