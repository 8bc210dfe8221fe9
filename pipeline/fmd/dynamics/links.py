"""The parts of a mechanism: bodies with the joints that carry them, and loads at points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.joint_kinds import AXIS, ElementaryMotion, JointKind, find_direction
from fmd.core.limits.round_off import SUMMED
from fmd.dynamics.force_laws import ForceLaw
from fmd.dynamics.signals.signal import Signal, constant
from fmd.dynamics.state_functions import StateFunction
from fmd.reduction.body import MarkerShapes
from fmd.reduction.inertia import InertiaIntegrals

_FLYWHEEL = JointKind("controller", ("rad",), turns=(ElementaryMotion(AXIS),))


@dataclass(frozen=True)
class Link:
    """A body with the joint that carries it on another body or on the ground; rigid if it has no modes."""

    name: str
    integrals: InertiaIntegrals  # inertia integrals about the joint, in the body's frame, for unit modal masses
    joint: JointKind  # its coordinates and motion
    parent: int = -1  # number of the body that carries it, -1 for the ground; smaller than its own
    # The joint's place on the parent: in its frame, and its motion by the parent's modes.
    place: MarkerShapes = field(default_factory=lambda: MarkerShapes(np.zeros(3)))
    # (3,): direction of the joint's axis, in the joint's axes
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    omega: Array = field(default_factory=lambda: np.zeros(0))  # (n,): modal angular frequencies [rad/s], ascending
    damping: Array = field(default_factory=lambda: np.zeros(0))  # (n,): modal damping ratios
    # (n,): rotation of the body's own section at a hinge about its axis, for unit modal coordinates
    joint_rotation: Array = field(default_factory=lambda: np.zeros(0))
    # (n, n): its second order, ``½ qᵀ joint_displacement2 q``; empty if it is left out
    joint_displacement2: Array = field(default_factory=lambda: np.zeros((0, 0)))
    spring: float = 0.0  # stiffness along a joint with one coordinate [N m/rad or N/m]
    rest: float = 0.0  # coordinate at which that spring has no force [rad or m]
    damper: float = 0.0  # damping along a joint with one coordinate [N m s/rad or N s/m]
    # Torque or force along a joint with one coordinate [N m or N].
    load: Signal = field(default_factory=lambda: constant(0.0))
    # Prescribed angle or displacement of a joint with one coordinate [rad or m], which has none then.
    motion: Signal | None = None
    joint_name: str = ""
    markers: Mapping[str, MarkerShapes] = field(default_factory=dict)  # named places of the body, in its frame
    # The marker on the section at the joint, from which deflections are seen; empty where they are seen from the body's
    # frame itself.
    section: str = ""
    # (3,): second axis of a joint that has two, in the body's axes
    other_axis: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    lead: float = 0.0  # displacement for an angle, where one coordinate is for both [m/rad]
    # Forces along each of a joint's coordinates, beside its spring and damper; none, or one for each.
    laws: tuple[ForceLaw, ...] = ()
    # (3, 3): rotation from the joint's axes, those of the body at angle 0, into the parent's
    place_axes: Array = field(default_factory=lambda: np.eye(3))
    part: str = ""  # name of the part that the body is a piece of; empty if it is whole
    effort: StateFunction | None = None  # force or torque along the joint by the mechanism's state, beside ``load``
    # Of a controller's state, what it is at the start; none of a body. Such a link is a flywheel with unit inertia on
    # the ground: its rate is the state, whose slope is the torque ``effort``.
    state: StateFunction | float | None = None

    @property
    def unit(self) -> str:
        """Unit of the joint's position where that is one number, ``rad`` or ``m``; else empty."""
        return self.joint.unit

    @property
    def n_rates(self) -> int:
        """Number of the joint's rates."""
        return 0 if self.motion else self.joint.n_rates

    @property
    def n_positions(self) -> int:
        """Number of the joint's position coordinates."""
        return 0 if self.motion else self.joint.n_positions

    @property
    def n_slides(self) -> int:
        """Number of the joint's displacements, which come before its angles."""
        return self.joint.n_slides

    @property
    def n_scalars(self) -> int:
        """Number of the joint's coordinates that are one number each; its quaternion comes after them."""
        return 0 if self.motion else len(self.joint.units)

    @property
    def grips_section(self) -> bool:
        """True if the joint's own angle is that of a section which turns with the body's modes."""
        return len(self.joint_rotation) > 0 and self.motion is None

    def direction(self, step: ElementaryMotion) -> Array:
        """Return the unit vector of a joint's displacement or rotation, shape (3,)."""
        return find_direction(step.along, self.axis, self.other_axis)

    def share(self, step: ElementaryMotion) -> float:
        """Return how much of its coordinate a displacement or rotation takes."""
        return step.factor * (self.lead if step.by_lead else 1.0)

    def with_modes(self, kept: IntArray, of_parent: IntArray) -> Link:
        """Return the link with some of its modes alone on a parent with some, by their numbers; without markers."""
        integrals, at = self.integrals, np.r_[0, 1 + kept]

        def pairs(forms: Array) -> Array:
            return forms[..., kept[:, None], kept] if forms.size else forms

        return replace(
            self,
            integrals=replace(
                integrals,
                G=integrals.G[:, :, at[:, None], at],
                S=integrals.S[:, at],
                stiffening=pairs(integrals.stiffening),
                displacement2=pairs(integrals.displacement2),
                rotation2=pairs(integrals.rotation2),
            ),
            omega=self.omega[kept],
            damping=self.damping[kept] if len(self.damping) else self.damping,
            joint_rotation=self.joint_rotation[kept] if len(self.joint_rotation) else self.joint_rotation,
            joint_displacement2=pairs(self.joint_displacement2),
            place=self.place.with_modes(of_parent),
            markers={},
            section="",
        )

    def require_valid(self, number: int, parent_modes: int) -> None:
        """Raise ``ValueError`` unless the link can be the one of this number on a parent with so many modes."""
        if not -1 <= self.parent < number:
            raise ValueError(f"link {self.name} comes before its parent")
        if not np.linalg.norm(self.axis) > 0.0:
            raise ValueError(f"the axis of {self.name} has no direction")
        if not np.abs(self.place_axes.T @ self.place_axes - np.eye(3)).max() <= SUMMED:
            raise ValueError(f"the axes of the place that carries {self.name} are not orthonormal")
        if self.integrals.G.shape[-1] != 1 + len(self.omega):
            raise ValueError(
                f"{self.name} has {len(self.omega)} frequencies and {self.integrals.G.shape[-1] - 1} shapes"
            )
        for name in ("translation", "rotation", "displacement2"):
            if (found := getattr(self.place, name).shape[1]) not in (0, parent_modes):
                raise ValueError(f"{name} of {self.name}'s place has {found} columns, its parent {parent_modes} modes")
        along = self.spring or self.damper or self.motion or self.effort or self.load != constant(0.0)
        if along and not self.unit:
            raise ValueError(f"the joint of {self.name} takes no spring, damper, load or motion: it has no axis")
        if len(self.laws) not in (0, self.n_rates):
            raise ValueError(f"the joint of {self.name} has {self.n_rates} rates and {len(self.laws)} force laws")
        if self.motion and len(self.joint_rotation) and np.abs(self.joint_rotation).max() > 1e-9:
            raise ValueError(f"the motion of {self.name} needs a basis whose section at the joint is frozen")
        if self.motion:
            _require_smooth(self.name, self.motion, self.unit)


def _require_smooth(name: str, motion: Signal, unit: str) -> None:
    """Raise ``ValueError`` if a motion's position or rate jumps: no impulse would pass to the other coordinates."""
    for time, before, after in motion.jumps:
        raise ValueError(
            f"the motion of {name} jumps at {time:g} s, from {before[0]:.6g} {unit} at {before[1]:.6g} {unit}/s to "
            f"{after[0]:.6g} {unit} at {after[1]:.6g} {unit}/s; position and rate must go on as they are"
        )


@dataclass(frozen=True)
class PointLoad:
    """A force or a torque at a point of a body, fixed in space or turning with the body."""

    body: str  # the link that it acts on
    direction: Array  # (3,): unit vector: in space, or in the axes of the point's section if the load follows it
    size: Signal  # along the direction [N or N m]
    torque: bool = False
    following: bool = False  # whether its direction turns with the section
    marker: MarkerShapes = field(default_factory=lambda: MarkerShapes(np.zeros(3)))  # the point in the body's frame
    effort: StateFunction | None = None  # size by the mechanism's state, beside ``size``

    def with_modes(self, kept: IntArray) -> PointLoad:
        """Return the load on its body with some of its modes alone, by their numbers."""
        return replace(self, marker=self.marker.with_modes(kept))


def controller_state(name: str, start: StateFunction | float, slope: StateFunction) -> Link:
    """Make the state of a controller, whose slope is a function of the mechanism's state."""
    flywheel = rigid_integrals(0.0, np.zeros(3), np.eye(3))
    return Link(name, flywheel, _FLYWHEEL, joint_name=name, effort=slope, state=start)


def rigid_integrals(mass: float, centre: Array, inertia: Array) -> InertiaIntegrals:
    """Form the inertia integrals of a rigid body about the origin of its frame.

    Its mass is in kg, its centre of mass (3,) in the frame [m], its inertia tensor (3, 3) about that [kg m²].
    """
    second = 0.5 * inertia.trace() * np.eye(3) - inertia + mass * (centre[:, None] * centre)
    return InertiaIntegrals(second[:, :, None, None], mass * centre[:, None], mass)
