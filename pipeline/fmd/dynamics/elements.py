"""Force elements between two places of a mechanism: springs between points, and bushings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.round_off import SUMMED
from fmd.dynamics.closures import GROUND, Place
from fmd.dynamics.force_laws import ForceLaw


@dataclass(frozen=True)
class Attachment(Place):
    """A place that a force element holds on to, with axes of its own.

    Parameters
    ----------
    axes : ndarray, shape (3, 3)
        Rotation from the place's axes into those of the marker's section, or of space.
    """

    axes: Array = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        if not np.allclose(self.axes.T @ self.axes, np.eye(3), atol=SUMMED):
            raise ValueError("the axes of a force element's place are not orthonormal")


@dataclass(frozen=True)
class _Pair:
    """An element between two places.

    Parameters
    ----------
    name : str
        The element's name.
    ends : tuple of Attachment
        The two places; the axes of a bushing's are parallel where it isn't twisted.
    """

    name: str
    ends: tuple[Attachment, Attachment]

    def with_modes(self, kept: Mapping[str, IntArray]) -> Self:
        """Return the same on bodies with some of their modes alone, by the bodies' names."""
        first, second = (end.with_modes(kept) for end in self.ends)
        return replace(self, ends=(first, second))

    @property
    def rigid(self) -> Self:
        """An equal element between bodies that don't deform."""
        return self.with_modes({end.body: np.zeros(0, dtype=np.int64) for end in self.ends if end.body != GROUND})


@dataclass(frozen=True)
class PointSpring(_Pair):
    """A spring along the line between two places, by any force law of its elongation.

    Parameters
    ----------
    law : ForceLaw
        Force [N] by elongation [m] and its rate [m/s].
    rest : float
        Length at which the elongation is 0 [m].
    """

    law: ForceLaw
    rest: float = 0.0


@dataclass(frozen=True)
class SixAxisSpring(_Pair):
    """Six springs and dampers between two places, along the first one's axes and about them.

    With the displacement d of the second place from its rest position, seen along the first one's axes, and the
    rotation vector θ of the second one's axes against the first's, it has the energy ``½ eᵀ K e`` for e = (d, θ), and
    dissipates ``ėᵀ C ė``. Angles stay below half a turn.

    Parameters
    ----------
    K, C : ndarray, shape (6, 6)
        Symmetric stiffness and damping, positive semidefinite [N/m, N, N m/rad; the same times s].
    position : ndarray, shape (3,)
        Of the second place against the first at rest, along the first one's axes [m].
    """

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


Element = PointSpring | SixAxisSpring
