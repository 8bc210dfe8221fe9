"""Force elements between two places of a mechanism: springs between points, and bushings."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.dynamics.force_laws import ForceLaw
from pipeline.reduction.body import MarkerShapes

SHORTEST = 1e-9
"""Length [m] below which a spring between points has no direction: its length is ``√(d² + SHORTEST²)``."""

_ORTHONORMAL = 1e-12


@dataclass(frozen=True)
class Attachment:
    """A place that a force element holds on to: a marker of a body, or a place on the ground.

    Parameters
    ----------
    body : str
        The link; empty for the ground.
    marker : MarkerShapes
        Where on the body, or in space.
    axes : ndarray, shape (3, 3)
        Rotation from the place's axes into those of the marker's section.
    """

    body: str
    marker: MarkerShapes
    axes: Array = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        if not np.allclose(self.axes.T @ self.axes, np.eye(3), atol=_ORTHONORMAL):
            raise ValueError("the axes of a force element's place are not orthonormal")


@dataclass(frozen=True)
class PointSpring:
    """A spring along the line between two places, by any force law of its elongation.

    Parameters
    ----------
    name : str
        The element's name.
    ends : tuple of Attachment
        The two places.
    law : ForceLaw
        Force [N] by elongation [m] and its rate [m/s].
    rest : float
        Length at which the elongation is 0 [m].
    """

    name: str
    ends: tuple[Attachment, Attachment]
    law: ForceLaw
    rest: float = 0.0


@dataclass(frozen=True)
class Bushing:
    """Six springs and dampers between two places, along the first one's axes and about them.

    With the displacement d of the second place from its rest position, seen along the first one's axes, and the
    rotation vector θ of the second one's axes against the first's, it has the energy ``½ eᵀ K e`` for e = (d, θ), and
    dissipates ``ėᵀ C ė``. Angles stay below half a turn.

    Parameters
    ----------
    name : str
        The element's name.
    ends : tuple of Attachment
        The two places; their axes are parallel where the bushing isn't twisted.
    K, C : ndarray, shape (6, 6)
        Symmetric stiffness and damping, positive semidefinite [N/m, N, N m/rad; the same times s].
    position : ndarray, shape (3,)
        Of the second place against the first at rest, along the first one's axes [m].
    """

    name: str
    ends: tuple[Attachment, Attachment]
    K: Array
    C: Array
    position: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        for which, A in (("stiffness", self.K), ("damping", self.C)):
            if A.shape != (6, 6) or not np.allclose(A, A.T, rtol=1e-9, atol=0.0):
                raise ValueError(f"the {which} of bushing {self.name} isn't a symmetric 6 x 6 matrix")
            if np.linalg.eigvalsh(A)[0] < -1e-9 * np.abs(A).max():
                raise ValueError(f"the {which} of bushing {self.name} has a negative eigenvalue")

    @property
    def twists(self) -> bool:
        """True if rotations count."""
        return bool(self.K[3:].any() or self.C[3:].any())


Element = PointSpring | Bushing


def with_modes(element: Element, kept: dict[str, IntArray]) -> Element:
    """Return a force element whose places move with some modes alone of the bodies named, all of the others'."""
    first, second = (
        replace(end, marker=_columns(end.marker, kept[end.body])) if end.body in kept else end for end in element.ends
    )
    return replace(element, ends=(first, second))


def _columns(marker: MarkerShapes, kept: IntArray) -> MarkerShapes:
    shapes, rotations = (
        values[:, kept] if values.size else values[:, :0] for values in (marker.translation, marker.rotation)
    )
    bow = marker.bow[..., kept[:, None], kept] if marker.bow.size else marker.bow
    return MarkerShapes(marker.position, shapes, rotations, bow)
