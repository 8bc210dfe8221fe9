"""The reduced flexible body: a modal basis in the floating frame of the joint that carries it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fmd.core.arrays import Array, IntArray, short_repr
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits.modes import ELASTIC_PART, NO_STIFFNESS, ROUNDED_PAIR
from fmd.core.limits.rank import INDEPENDENT_MASS
from fmd.reduction.inertia import InertiaIntegrals, inertia_integrals

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel


@dataclass(frozen=True)
class MarkerShapes:
    """Displacement and rotation of a marker for each modal coordinate of a reduced body."""

    position: Array  # (3,): undeformed position relative to the joint [m]
    # (3, n): displacement for a unit of each modal coordinate [kg^-1/2]
    translation: Array = field(default_factory=lambda: np.zeros((3, 0)))
    # (3, n): rotation for a unit of each modal coordinate [rad m^-1 kg^-1/2]
    rotation: Array = field(default_factory=lambda: np.zeros((3, 0)))
    # (6, n, n): displacement (3, …) and rotation vector (3, …) of second order, ``½ qᵀ displacement2 q``, symmetric
    # each; empty if left out
    displacement2: Array = field(default_factory=lambda: np.zeros((6, 0, 0)))

    def with_modes(self, kept: IntArray) -> MarkerShapes:
        """Return the marker on a body with some of its modes alone, by their numbers; what is empty stays so."""
        moved, turned = (parts[:, kept] if parts.size else parts for parts in (self.translation, self.rotation))
        forms = self.displacement2
        return MarkerShapes(self.position, moved, turned, forms[:, kept[:, None], kept] if forms.size else forms)


class SecondOrder(NamedTuple):
    """Inertia and markers of a stiffened body."""

    integrals: InertiaIntegrals
    markers: Mapping[str, MarkerShapes]


@dataclass(frozen=True)
class FlexibleBody:
    """A reduced body in the floating frame of its parent joint, ``r = R(θ) (x + Σ_j q_j φ_j(x))``."""

    x: Array  # (n_nodes, 3): undeformed node positions relative to the joint [m]
    # (n_nodes, 3, n): basis with zero mean displacement at the joint, unit modal mass and diagonal stiffness [kg^-1/2]
    shapes: Array
    # (n,): angular frequencies of the basis [rad/s]: those of the body pinned at the joint if the basis is
    # joint-conforming
    omega: Array
    axis: Array  # (3,): unit vector of the joint's axis
    joint: str  # name of the marker at the joint
    markers: Mapping[str, MarkerShapes]  # motion of each marker, by name
    integrals: InertiaIntegrals  # inertia integrals about the joint
    coupling: float  # ``|M_θq| / √J`` in the reference state: 0 for a joint-conforming basis, below 1 always
    # (3,): position of the joint in the part's own coordinates, those of its mesh or CAD file [m]
    origin: Array = field(default_factory=lambda: np.zeros(3), kw_only=True)
    # (n,) or (0,): damping ratio of each modal coordinate, of a body whose file tells it; empty else
    damping: Array = field(default_factory=lambda: np.zeros(0), kw_only=True)

    __repr__ = short_repr

    @property
    def frequencies_hz(self) -> Array:
        """Frequencies of the basis [Hz], shape (n,)."""
        return np.asarray(self.omega / (2 * np.pi))

    @property
    def joint_rotation(self) -> Array:
        """Rotation of the joint's section about the axis for a unit of each modal coordinate, shape (n,)."""
        return np.asarray(self.axis @ self.markers[self.joint].rotation)

    @property
    def joint_displacement2(self) -> Array:
        """Rotation of second order of the joint's section about the axis, shape (n, n); empty if it is left out."""
        return np.tensordot(self.axis, self.markers[self.joint].displacement2[3:], axes=1)

    @property
    def inertia_about_joint(self) -> float:
        """Moment of inertia about the joint's axis in the reference state [kg m²]."""
        return float(self.axis @ self.integrals.inertia(np.eye(1, 1 + len(self.omega))[0]) @ self.axis)


def reduced_body(
    fe: FEModel, omega: Array, shapes: Array, markers: Mapping[str, Marker], joint: str, free: Array, normal: int = -1
) -> FlexibleBody:
    """Refer a basis to a joint, whose marker moves with the frame but for the rotations that the joint leaves free.

    About those the frame floats so that rotation and modes don't couple in the reference state, ``∫ρ e·(x × φ) = 0``
    (mean axes about the joint; Canavin & Likins, Journal of Spacecraft 14, 1977). The basis (n,) and (n_nodes, 3, n)
    has unit modal mass and diagonal stiffness, of the free body or of the body fixed at the joint. Directions ``free``
    (k, 3) are orthonormal: none at a fixed, prismatic or angle-driven joint, the axis of a torque-driven hinge, three
    at a spherical joint. ``normal`` is the number of the only axis that the body turns about in space, for which fewer
    inertia integrals do; -1 if it may move anyhow.

    Raises
    ------
    AccuracyError
        With the marker fixed, the shapes depend on one another, or a combination of them is a rigid motion.
    """
    return supported_body(fe, omega, _pinned(fe, shapes, markers[joint], free), markers, joint, free, normal)


def supported_body(
    fe: FEModel, omega: Array, shapes: Array, markers: Mapping[str, Marker], joint: str, free: Array, normal: int = -1
) -> FlexibleBody:
    """Refer the basis of a supported body to the frame of its supports, which the joint turns as a whole.

    Shapes are not pinned at the marker; the frame floats about the rotations that the joint leaves free, as in
    `reduced_body`, whose arguments these are.
    """
    spins = np.cross(free, (fe.x - markers[joint].position)[:, None]).swapaxes(1, 2)
    J, H = _rotation_coupling(fe, spins, shapes)
    axis = free[0] if len(free) else np.array([0.0, 0.0, 1.0])
    return _body(fe, omega, shapes - spins @ np.linalg.solve(J, H), markers, joint, axis, normal)


def free_frame_body(
    fe: FEModel, omega: Array, shapes: Array, markers: Mapping[str, Marker], joint: str, axis: Array, normal: int = -1
) -> FlexibleBody:
    """Refer free modes to a hinge without mean axes about it, so that rotation and modes stay coupled, up to 1.

    ``axis`` (3,) is the hinge's; the other arguments are those of `reduced_body`.
    """
    e = axis / np.linalg.norm(axis)
    return _body(fe, omega, _pinned(fe, shapes, markers[joint], e[None]), markers, joint, e, normal)


def floating_body(fe: FEModel, omega: Array, shapes: Array, markers: Mapping[str, Marker], joint: str) -> FlexibleBody:
    """Refer free modes to a free joint: they stay in their mean axes (Tisserand), with the origin at the marker."""
    _require_elastic(fe, shapes)
    return _body(fe, omega, shapes, markers, joint, np.array([0.0, 0.0, 1.0]))


def _pinned(fe: FEModel, shapes: Array, marker: Marker, free: Array) -> Array:
    """Move shapes rigidly until the marker keeps its place, and all rotations but those about ``free`` directions."""
    removed = (np.eye(3) - free.T @ free) @ marker.rotation(shapes)
    r = fe.x - marker.position
    turned = np.cross(removed, r[:, :, None], axisa=0, axisb=1, axisc=1)
    return np.asarray(shapes - marker.translation(shapes)[None] - turned)


def _require_elastic(fe: FEModel, shapes: Array) -> None:
    """Raise ``AccuracyError`` if shapes hold rigid motions, which would move the body twice, once with the frame."""
    R = fe.rigid_modes
    H = R.T @ (fe.M @ shapes.reshape(len(R), -1))
    part = float(np.sqrt(np.einsum("ij,ij->j", H, np.linalg.solve(R.T @ (fe.M @ R), H)).max()))
    if not part < ELASTIC_PART:
        raise AccuracyError(f"a shape is a rigid motion in part, {part:.1e} of 1; take modes of the free body")


def _rotation_coupling(fe: FEModel, spins: Array, shapes: Array) -> tuple[Array, Array]:
    """Inertia (k, k) of unit spins (n_nodes, 3, k), and their inertial coupling (k, n) with each shape."""
    mspins = (fe.m @ spins.reshape(len(spins), -1)).reshape(spins.shape)
    return np.einsum("iak,ial->kl", spins, mspins), np.einsum("iak,ian->kn", mspins, shapes)


def _body(
    fe: FEModel, omega: Array, shapes: Array, markers: Mapping[str, Marker], joint: str, e: Array, normal: int = -1
) -> FlexibleBody:
    """Orthonormalise shapes and make the body: rigid motions added to them changed mass, but not ``diag(ω²)``."""
    from scipy.linalg import eigh

    n = len(omega)
    mass = np.tensordot(shapes, (fe.m @ shapes.reshape(len(fe.x), -1)).reshape(shapes.shape), ((0, 1), (0, 1)))
    weakest = float(np.linalg.eigvalsh(mass)[0])
    if not weakest > INDEPENDENT_MASS:
        raise AccuracyError(
            f"fixed at '{joint}', the {n} shapes depend on one another: a combination of them keeps {weakest:.1e} of "
            "its mass; take fewer modes or modes of the body fixed there"
        )
    omega2, turn = eigh(np.diag(omega**2), mass)
    if not omega2[0] > NO_STIFFNESS * omega2[-1]:
        raise AccuracyError(
            f"fixed at '{joint}', a combination of the {n} shapes is a rigid motion: ω² = {omega2[0]:.1e} rad²/s² "
            f"beside {omega2[-1]:.1e}"
        )
    origin = markers[joint].position
    x = fe.x - origin
    turn, omega2 = _part_equals(fe, x, shapes @ turn, omega2, turn)
    shapes = shapes @ (turn * np.sign(turn[np.abs(turn).argmax(axis=0), range(n)]))
    J, H = _rotation_coupling(fe, np.cross(e, x)[:, :, None], shapes)
    return FlexibleBody(
        x=x,
        shapes=shapes,
        omega=np.sqrt(omega2),
        axis=e,
        joint=joint,
        markers={
            name: MarkerShapes(marker.position - origin, marker.translation(shapes), marker.rotation(shapes))
            for name, marker in markers.items()
        },
        integrals=inertia_integrals(x, fe.m, shapes, normal),
        coupling=float(np.linalg.norm(H) / np.sqrt(J[0, 0])),
        origin=origin,
    )


def _part_equals(fe: FEModel, x: Array, shapes: Array, omega2: Array, turn: Array) -> tuple[Array, Array]:
    """Turn shapes of one frequency into those that move along one axis, or far out on one, and give each their mean.

    Any of their combinations are modes, too. Without this round-off chooses, and does otherwise for each modulus.
    Returned are the turn to the shapes (n, n) and ω² (n,).
    """
    turn, omega2 = turn.copy(), omega2.copy()
    weights = np.arange(3.0) * (1.0 + (x / np.abs(x).max()) ** 2)
    parted = 1 + np.flatnonzero(np.diff(omega2) > ROUNDED_PAIR * omega2[1:])
    for group in np.split(np.arange(len(omega2)), parted):
        if len(group) > 1:
            own = shapes[:, :, group].reshape(-1, len(group))
            moved = (fe.m @ shapes[:, :, group].reshape(len(x), -1)).reshape(own.shape)
            mixed = moved.T @ (weights.reshape(-1, 1) * own)
            turn[:, group] = turn[:, group] @ np.linalg.eigh(mixed + mixed.T)[1]
            omega2[group] = omega2[group].mean()
    return turn, omega2
