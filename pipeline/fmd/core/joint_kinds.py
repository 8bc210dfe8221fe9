"""Kinds of joints as data: coordinates, motion and constraints, which scenes, equations and pictures read.

A joint moves a body against its place by displacements along directions of the joint, then by rotations one after the
other, each by a share of one of its coordinates. Directions have names: ``axis`` and ``other axis`` are those of the
joint, ``across 1`` and ``across 2`` complete a right-handed system with its axis, ``x``, ``y``, ``z`` are the joint's;
a ``-`` before its name makes a direction the opposite one.
"""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass

JOINT_CONSTANTS = ("spring", "rest", "damper")
"""Numbers of joints with one coordinate that are inputs of equations: those of one structure may have others."""

AXIS, OTHER, ACROSS, SPACE = "axis", "other axis", ("across 1", "across 2"), ("x", "y", "z")

Row = tuple[tuple[str, str], ...]
"""A constraint on rotations: the products of directions of the parent's side and of the child's sum to zero."""

ALIGNED: tuple[Row, ...] = tuple(((side, AXIS),) for side in ACROSS)
"""Both axes stay parallel."""
LOCKED: tuple[Row, ...] = (((AXIS, ACROSS[0]),), ((ACROSS[0], ACROSS[1]),), ((ACROSS[1], AXIS),))
"""Nothing turns."""


@dataclass(frozen=True, slots=True)
class ElementaryMotion:
    """A displacement along a direction or a rotation about it, by a share of a coordinate."""

    along: str
    coordinate: int = 0
    factor: float = 1.0
    by_lead: bool = False  # true if the joint's lead [m/rad] is a factor, too


@dataclass(frozen=True)
class JointKind:
    """Coordinates, motion and constraints of a kind of joint."""

    name: str
    units: tuple[str, ...] = ()  # unit of each coordinate that is one number, ``m`` before ``rad``
    slides: tuple[ElementaryMotion, ...] = ()  # displacements, along directions of the place
    turns: tuple[ElementaryMotion, ...] = ()  # rotations after them, each in axes that those before it have turned
    # True if a unit quaternion, the last of the coordinates, turns the body; its rates are about the body's axes.
    turns_in_space: bool = False
    # Directions in which a joint of this kind keeps both places together where it closes a loop.
    points: tuple[str, ...] = ()
    squares: tuple[Row, ...] = ()  # what it then keeps of the rotation

    @property
    def n_rates(self) -> int:
        """Number of rates."""
        return len(self.units) + 3 * self.turns_in_space

    @property
    def n_positions(self) -> int:
        """Number of position coordinates."""
        return len(self.units) + 4 * self.turns_in_space

    @property
    def n_slides(self) -> int:
        """Number of coordinates that are displacements; they come first."""
        return self.units.count("m")

    @property
    def unit(self) -> str:
        """Unit of the coordinate of a joint that has one, ``rad`` or ``m``; else empty."""
        return self.units[0] if self.n_rates == 1 else ""

    @property
    def is_hinge(self) -> bool:
        """True if the body turns about one axis and does nothing else."""
        return self.unit == "rad" and not self.slides

    @property
    def is_slide(self) -> bool:
        """True if the body moves along one axis and does nothing else."""
        return self.unit == "m" and not self.turns

    @property
    def is_ball(self) -> bool:
        """True if the body turns in space about a point."""
        return self.turns_in_space and not self.slides

    @property
    def is_free(self) -> bool:
        """True if the joint holds nothing."""
        return self.n_rates == 6

    @property
    def is_weld(self) -> bool:
        """True if the joint holds everything."""
        return len(self.points) + len(self.squares) == 6

    @property
    def keeps_plane_across_axis(self) -> bool:
        """True if a body turns about the joint's axis, and keeps to the plane across it."""
        turning = bool(self.turns) and all(step.along == AXIS for step in self.turns)
        return turning and all(step.along in ACROSS for step in self.slides)

    @property
    def may_keep_plane(self) -> bool:
        """True if there is a plane that a body on this joint keeps to: any, one along its axis or the one across it."""
        return self.is_weld or self.is_slide or self.keeps_plane_across_axis

    @property
    def shifts_along_turns(self) -> bool:
        """True if displacements are along the axis of all rotations, which leave them where they are."""
        along = {step.along for step in (*self.slides, *self.turns)}
        return len(along) == 1 and not self.turns_in_space


def perpendicular_axes(axis: Array) -> Array:
    """Return two unit vectors across an axis, a right-handed system with it, along the axes of space where they fit."""
    start = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, np.cross(start, axis))
    first = first / np.linalg.norm(first)
    return np.array([first, np.cross(axis, first)])


def find_direction(name: str, axis: Array, other: Array | None = None) -> Array:
    """Return a direction of a joint by its name, a unit vector (3,), from its axis and its other axis (3,)."""
    if name.startswith("-"):
        return -find_direction(name[1:], axis, other)
    if name in SPACE:
        return np.asarray(np.eye(3)[SPACE.index(name)])
    given = np.asarray(other if name == OTHER and other is not None else axis, dtype=float)
    unit = given / np.linalg.norm(given)
    return np.asarray(perpendicular_axes(unit)[ACROSS.index(name)] if name in ACROSS else unit)
