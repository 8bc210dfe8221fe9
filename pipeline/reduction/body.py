"""The reduced flexible body: a modal basis referenced to the joint that carries it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

from pipeline.checks import Array
from pipeline.reduction.gram import InertiaGram, inertia_gram

if TYPE_CHECKING:
    from pipeline.fem.marker import Marker
    from pipeline.fem.model import FEModel


@dataclass(frozen=True)
class MarkerShapes:
    """How a marker of the reduced body moves.

    Attributes
    ----------
    position : ndarray, shape (3,)
        Undeformed position relative to the joint [m].
    translation : ndarray, shape (3, n)
        Displacement for a unit of each modal coordinate [kg^-1/2].
    rotation : ndarray, shape (3, n)
        Rotation for a unit of each modal coordinate [rad m^-1 kg^-1/2].
    """

    position: Array
    translation: Array
    rotation: Array


@dataclass(frozen=True)
class FlexibleBody:
    """A body in the floating frame of its inboard joint, ``r = R(θ) (x + Σ_j q_j φ_j(x))``.

    Attributes
    ----------
    x : ndarray, shape (n_nodes, 3)
        Undeformed node positions relative to the joint [m].
    shapes : ndarray, shape (n_nodes, 3, n)
        Basis with zero mean displacement at the joint, unit modal mass and diagonal stiffness [kg^-1/2].
    omega : ndarray, shape (n,)
        Angular frequencies of the basis [rad/s]: those of the body pinned at the joint if the basis is
        joint-conforming.
    axis : ndarray, shape (3,)
        Unit vector of the joint's axis.
    joint : str
        Name of the marker at the joint.
    markers : mapping of str to MarkerShapes
        All markers.
    gram : InertiaGram
        Inertia integrals about the joint.
    coupling : float
        ``|M_θq| / √J`` in the reference state: 0 for a joint-conforming basis, below 1 always.
    """

    x: Array
    shapes: Array
    omega: Array
    axis: Array
    joint: str
    markers: Mapping[str, MarkerShapes]
    gram: InertiaGram
    coupling: float

    @property
    def frequencies_hz(self) -> Array:
        """Frequencies of the basis [Hz], shape (n,)."""
        return np.asarray(self.omega / (2 * np.pi))

    @property
    def joint_rotation(self) -> Array:
        """Rotation of the joint's section about the axis for a unit of each modal coordinate, shape (n,)."""
        return np.asarray(self.axis @ self.markers[self.joint].rotation)

    @property
    def inertia_about_joint(self) -> float:
        """Moment of inertia about the joint's axis in the reference state [kg m²]."""
        return float(self.axis @ self.gram.inertia(np.eye(1, 1 + len(self.omega))[0]) @ self.axis)


def joint_conforming_body(
    fe: FEModel, omega: Array, shapes: Array, markers: Mapping[str, Marker], joint: str, axis: Array
) -> FlexibleBody:
    """Let the frame float about the joint's axis so that rotation and modes don't couple in the reference state.

    The new shapes φ satisfy ``∫ρ e·(x × φ) = 0`` (a mean-axis frame about the joint axis; Canavin & Likins, Journal
    of Spacecraft 14, 1977): the elastic eigenvectors of the pinned body within the given basis.

    Parameters
    ----------
    omega, shapes : ndarray, shapes (n,) and (n_nodes, 3, n)
        Free-body basis with unit modal mass and diagonal stiffness.
    markers : mapping of str to Marker
        All markers of the body.
    joint : str
        The one at the joint.
    axis : ndarray, shape (3,)
        The joint's axis.
    """
    e, spin, pinned = _pinned(fe, shapes, markers[joint], axis)
    J, H = _rotation_coupling(fe, spin, pinned)
    return _body(fe, omega, pinned - spin[:, :, None] * (H / J), markers, joint, e)


def free_frame_body(
    fe: FEModel, omega: Array, shapes: Array, markers: Mapping[str, Marker], joint: str, axis: Array
) -> FlexibleBody:
    """Keep the free modes' own mean axes as the frame: rotation and modes stay coupled, up to ``coupling`` 1.

    The arguments are those of `joint_conforming_body`.
    """
    e, _, pinned = _pinned(fe, shapes, markers[joint], axis)
    return _body(fe, omega, pinned, markers, joint, e)


def _pinned(fe: FEModel, shapes: Array, marker: Marker, axis: Array) -> tuple[Array, Array, Array]:
    """Unit axis, unit spin about it through the marker, and the shapes with the marker held."""
    e = axis / np.linalg.norm(axis)
    return e, np.cross(e, fe.x - marker.position), shapes - marker.translation(shapes)[None]


def _rotation_coupling(fe: FEModel, spin: Array, shapes: Array) -> tuple[float, Array]:
    """Inertia about the axis, and its coupling with each shape."""
    mspin = fe.m @ spin
    return float(np.einsum("ia,ia->", spin, mspin)), np.einsum("ia,iak->k", mspin, shapes)


def _body(
    fe: FEModel, omega: Array, shapes: Array, markers: Mapping[str, Marker], joint: str, e: Array
) -> FlexibleBody:
    """Diagonalise: rigid motions added to the shapes changed their mass and left ``diag(ω²)`` as it was."""
    mass = np.tensordot(shapes, (fe.m @ shapes.reshape(len(fe.x), -1)).reshape(shapes.shape), ((0, 1), (0, 1)))
    omega2, turn = eigh(np.diag(omega**2), mass)
    shapes = shapes @ (turn * np.sign(turn[np.abs(turn).argmax(axis=0), range(len(omega))]))
    origin = markers[joint].position
    x = fe.x - origin
    J, H = _rotation_coupling(fe, np.cross(e, x), shapes)
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
        gram=inertia_gram(x, fe.m, shapes),
        coupling=float(np.linalg.norm(H) / np.sqrt(J)),
    )
