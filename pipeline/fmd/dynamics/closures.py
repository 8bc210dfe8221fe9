"""Constraints that close loops of a mechanism: joints between bodies that both hang on others, and couplers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.reduction.body import MarkerShapes

GROUND = ""
"""Name of the ground where a body's is asked for."""


@dataclass(frozen=True)
class Place:
    """A marker of a body, or a place on the ground.

    Parameters
    ----------
    body : str
        The link's name; empty for the ground.
    marker : MarkerShapes
        Place, and how the body's modes move and turn it, in the body's frame [m].
    """

    body: str
    marker: MarkerShapes

    def with_modes(self, kept: Mapping[str, IntArray]) -> Self:
        """Return the same on a body with some of its modes alone, by bodies' names."""
        if self.body not in kept:
            return self
        own, at = kept[self.body], self.marker
        bow = at.bow[:, own[:, None], own] if at.bow.size else at.bow
        moved, turned = (parts[:, own] if parts.size else parts for parts in (at.translation, at.rotation))
        return replace(self, marker=MarkerShapes(at.position, moved, turned, bow))


def fixed_place(position: Array) -> Place:
    """Make a place on the ground, shape (3,) [m]."""
    nothing = np.zeros((3, 0))
    return Place(GROUND, MarkerShapes(np.asarray(position, dtype=float), nothing, nothing))


@dataclass(frozen=True)
class Closure:
    """A joint that closes a loop: what the relative motion of two places has to keep.

    Parameters
    ----------
    name : str
        The joint's.
    first, second : Place
        The joint's places on the parent and on the child.
    along : ndarray, shape (k, 3)
        Directions in which the places coincide: in space if they are three, else in the axes of the first's section.
    square : ndarray, shape (m, 2, 3)
        Pairs of directions that stay perpendicular, each one in the axes of the first's and of the second's section.
    distance : float
        Distance that the places keep [m]; 0 for none.
    left_out : sequence of int
        Numbers of the scalar constraints that aren't kept, in the order ``along``, ``square``, ``distance``: nothing
        can move them, so they hold by themselves.
    """

    name: str
    first: Place
    second: Place
    along: Array = field(default_factory=lambda: np.zeros((0, 3)))
    square: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    distance: float = 0.0
    left_out: Sequence[int] = ()

    @property
    def bodies(self) -> tuple[str, ...]:
        """The links that it holds together; the ground is none."""
        return tuple(place.body for place in (self.first, self.second) if place.body != GROUND)

    @property
    def rigid(self) -> Closure:
        """A joint of equal kind between bodies that don't deform."""
        return self.with_modes({body: np.zeros(0, dtype=np.int64) for body in self.bodies})

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
            raise ValueError(f"joint {self.name} holds nothing")
        if self.distance < 0.0:
            raise ValueError(f"the distance of {self.name} is {self.distance:g} m, expected one above 0")


@dataclass(frozen=True)
class Coupler:
    """A linear relation between joint coordinates, ``Σ factors s = offset``: gears, racks and screws.

    Parameters
    ----------
    name : str
        Its own.
    joints : sequence of str
        Links whose revolute or prismatic joints take part.
    factors : sequence of float
        One for each joint.
    offset : float
        Value of the sum.
    """

    name: str
    joints: Sequence[str]
    factors: Sequence[float]
    offset: float = 0.0

    @property
    def bodies(self) -> tuple[str, ...]:
        """The links whose joints it couples."""
        return tuple(self.joints)

    @property
    def rigid(self) -> Coupler:
        """Itself: it knows nothing of modes."""
        return self

    def with_modes(self, kept: Mapping[str, IntArray]) -> Coupler:
        """Return itself."""
        return self

    def require_valid(self) -> None:
        """Raise ``ValueError`` unless there is a factor for each joint."""
        if len(self.joints) != len(self.factors) or not any(self.factors):
            raise ValueError(f"coupler {self.name} has {len(self.joints)} joints and factors {list(self.factors)}")


Constraint = Closure | Coupler


def close_joint(
    kind: str,
    name: str,
    first: Place,
    second: Place,
    axis: Array,
    other: Array | None = None,
    of_first: Array | None = None,
    of_second: Array | None = None,
) -> Closure:
    """Make the closure of a joint.

    Parameters
    ----------
    kind : str
        ``fixed``, ``revolute``, ``prismatic``, ``cylindrical``, ``spherical``, ``universal``, ``planar`` or
        ``point-on-line``.
    axis, other : ndarray, shape (3,)
        Its axis in the axes of the first place and of the second; the same numbers by default. Of a universal joint
        they are perpendicular, of a planar joint the plane's normal.
    of_first, of_second : ndarray, shape (3, 3), optional
        Rotations from the axes of each place into those of its body; none by default.

    Raises
    ------
    ValueError
        The kind is none of these, or an axis has no direction.
    """
    axis = _unit(name, axis)
    other = axis if other is None else _unit(name, other)
    across, everywhere = perpendicular_axes(axis), np.eye(3)
    aligned = np.array([[u, other] for u in across])
    own = perpendicular_axes(other)
    locked = np.array([[axis, own[0]], [across[0], own[1]], [across[1], other]])
    if of_first is not None:
        axis, across = of_first @ axis, across @ of_first.T
        aligned[:, 0], locked[:, 0] = aligned[:, 0] @ of_first.T, locked[:, 0] @ of_first.T
    if of_second is not None:
        other = of_second @ other
        aligned[:, 1], locked[:, 1] = aligned[:, 1] @ of_second.T, locked[:, 1] @ of_second.T
    match kind:
        case "fixed":
            return Closure(name, first, second, everywhere, locked)
        case "revolute":
            return Closure(name, first, second, everywhere, aligned)
        case "prismatic":
            return Closure(name, first, second, across, locked)
        case "cylindrical":
            return Closure(name, first, second, across, aligned)
        case "spherical":
            return Closure(name, first, second, everywhere)
        case "universal":
            return Closure(name, first, second, everywhere, np.array([[axis, other]]))
        case "planar":
            return Closure(name, first, second, axis[None], aligned)
        case "point-on-line":
            return Closure(name, first, second, across)
        case _:
            raise ValueError(f"joint {name} is {kind}, which can't close a loop")


def _unit(name: str, axis: Array) -> Array:
    axis = np.asarray(axis, dtype=float)
    if not (length := float(np.linalg.norm(axis))) > 0.0:
        raise ValueError(f"the axis of {name} has no direction")
    return axis / length


def perpendicular_axes(axis: Array) -> Array:
    """Return two unit vectors across an axis, a right-handed system with it, along the axes of space where they fit."""
    start = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, np.cross(start, axis))
    first = first / np.linalg.norm(first)
    return np.array([first, np.cross(axis, first)])
