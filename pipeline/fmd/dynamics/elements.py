"""Force elements between two places of a mechanism: springs between points, and bushings."""

from collections.abc import Mapping
from dataclasses import field, replace
from typing import ClassVar, Self

import numpy as np

from fmd.core.arrays import Array, BoolArray, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.contact import HARDLY_PRESSED
from fmd.core.limits.mechanism import NO_LENGTH
from fmd.core.limits.round_off import SUMMED
from fmd.dynamics.closures import Place
from fmd.dynamics.force_laws import ForceLaw
from fmd.dynamics.state_functions import StateCurve


@dataclass(frozen=True)
class Attachment(Place):
    """A place that a force element acts on, with axes of its own."""

    # (3, 3): rotation from the place's axes into those of the marker's section, or of space
    axes: Array = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        if not np.allclose(self.axes.T @ self.axes, np.eye(3), atol=SUMMED):
            raise ValueError("the axes of a force element's place are not orthonormal")


Matrices = tuple[Array, Array, Array, Array]
"""Stiffness and damping of an element, and those that its end stops add where they touch, shape (n, n) each."""


@dataclass(frozen=True)
class _Pair:
    """An element between two places, whose forces stiffen the bodies there unless ``stiffens`` is false."""

    stiffens: ClassVar[bool] = True

    name: str
    ends: tuple[Attachment, Attachment]  # the two places; the axes of a bushing's are parallel where it isn't twisted

    def with_modes(self, kept: Mapping[str, IntArray]) -> Self:
        """Return the same on bodies with some of their modes alone, by the bodies' names."""
        first, second = (end.with_modes(kept) for end in self.ends)
        return replace(self, ends=(first, second))


@dataclass(frozen=True)
class PointSpring(_Pair):
    """A spring along the line between two places, by any force law of its elongation."""

    law: ForceLaw  # force [N] by elongation [m] and its rate [m/s]
    rest: float = 0.0  # length at which the elongation is 0 [m]
    title: ClassVar[str] = "spring"

    def linearise(self, J: Array, swing: Array, strain: Array) -> Matrices:
        """Return the spring's matrices for its elongation; in tension with what that adds across its line.

        J (1, n) and swing (3, n) are the rates of the elongation and of the vector between the places for unit rates.
        """
        law, along = self.law, J.T @ J
        tension, slope = law.curve.tangent(float(strain[0]))
        K, length = max(slope, 0.0) * along, float(strain[0] + self.rest)
        if tension > 0.0 and length > NO_LENGTH:
            K = K + tension / length * (swing.T @ swing - along)
        return K, law.resting_damping * along, law.stop_stiffness * along, law.stop_damping * along

    def unit_loads(self, apart: Array, axes: Array) -> list[tuple[Array, float]]:
        """Return a pull along the line, or along each axis where the places coincide; its compliance isn't constant.

        The line is ``apart`` (3,) in space [m]; ``axes`` (3, 3) turns the first place's axes into space.
        """
        directions = [apart] if apart.any() else list(np.eye(3))
        return [(np.concatenate([direction, np.zeros(3)]), np.inf) for direction in directions]


@dataclass(frozen=True)
class SixAxisSpring(_Pair):
    """Six springs and dampers between two places, along the first one's axes and about them.

    With the displacement d of the second place from its rest position, seen along the first one's axes, and the
    rotation vector θ of the second one's axes against the first's, it has the energy ``½ eᵀ K e`` for e = (d, θ), and
    dissipates ``ėᵀ C ė``. Angles stay below half a turn.
    """

    K: Array  # (6, 6): symmetric stiffness, positive semidefinite [N/m, N, N m/rad]
    C: Array  # (6, 6): symmetric damping, positive semidefinite [N s/m, N s, N m s/rad]
    # (3,): of the second place against the first at rest, along the first one's axes [m]
    position: Array = field(default_factory=lambda: np.zeros(3))
    title: ClassVar[str] = "bushing or bearing"

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

    def linearise(self, J: Array, swing: Array, strain: Array) -> Matrices:
        """Return the bushing's matrices for rates J of its strain, shape (3, n) or (6, n), for unit rates."""
        some, none = slice(len(J)), np.zeros((J.shape[1], J.shape[1]))
        return J.T @ self.K[some, some] @ J, J.T @ self.C[some, some] @ J, none, none

    def unit_loads(self, apart: Array, axes: Array) -> list[tuple[Array, float]]:
        """Return unit forces and moments (6,) along each axis that has stiffness, in space, with their compliances."""
        stiff, sizes = np.linalg.norm(self.K, axis=1) > 0.0, self.K.diagonal()
        return [(np.kron(np.eye(2)[k // 3], axes[:, k % 3]), 1 / sizes[k]) for k in np.flatnonzero(stiff)]


@dataclass(frozen=True)
class SpeedDependentBearing(SixAxisSpring):
    """Six springs and dampers whose first two follow the rate of rotation of the second place about their z axis.

    K and C have their largest values. Forces are ``-k(|ω_z|) d - c(|ω_z|) ḋ`` along x and y.
    """

    radial: StateCurve = field(kw_only=True)  # stiffness [N/m] by the size of the rate [rad/s]
    damper: StateCurve = field(kw_only=True)  # damping [N s/m] by the size of the rate [rad/s]


@dataclass(frozen=True)
class MeshEnergy:
    """Elastic energy of the teeth of two gears, ``V = Σ A_r(x) b_r(s)`` by their approach x and place s of a pair."""

    of_approach: tuple[StateCurve, ...]  # each A_r, 0 with its first two derivatives for no approach [N m]
    of_place: tuple[StateCurve, ...]  # each b_r, over a base pitch
    stiffest: float  # largest stiffness [N/m]
    mean: float  # that under the load for which the curves were made, on the average [N/m]
    reach: float  # largest approach of the curves' nodes, beyond which forces rise straight [m]
    error: float  # largest error of the force between nodes up to that load, over the load


@dataclass(frozen=True)
class GearTeeth(_Pair):
    """Teeth of two gears on hinges of the ground, which push one another along their two lines of action.

    With the angles θ of both about the axis, ``x = r₁ θ₁ + r₂ θ₂ − rest`` is how far the flanks of one side are
    pressed, ``−x − backlash`` those of the other; each has the energy ``V(x, s)`` and the force
    ``max(∂V/∂x + τ ∂²V/∂x² ẋ, 0)``. As V depends on the place s, too, the pinion has a torque ``−r₁ ∂V/∂s`` beside
    that of the force.
    """

    radii: tuple[float, float]  # of the base circles of pinion and wheel, which the ends are on [m]
    alpha: float  # working pressure angle [rad]
    axis: Array  # (3,): unit vector in space about which angles count
    centres: Array  # (3,): unit vector in space from the pinion's centre to the wheel's
    senses: tuple[float, float]  # 1 for each gear whose hinge turns about that axis, −1 about the opposite one
    middles: tuple[float, float]  # of the gears' widths, along the axis from their hinges' markers [m]
    rest: float  # value of ``r₁ θ₁ + r₂ θ₂`` where flanks touch [m]
    places: tuple[float, float]  # of the flanks of both sides for ``θ₁ = 0`` [m]
    backlash: float  # gap of the flanks of one side where the others touch [m]
    energy: MeshEnergy  # the teeth's
    damping: float  # time τ [s]
    title: ClassVar[str] = "gear mesh"
    stiffens: ClassVar[bool] = False  # it pushes teeth, which aren't those places

    def is_apart(self, pressed: Array) -> BoolArray:
        """Return where no flank presses another, by how far those of one side are pressed [m]."""
        hardly = HARDLY_PRESSED * self.energy.reach
        return np.asarray((pressed <= hardly) & (pressed >= -self.backlash - hardly))

    def linearise(self, J: Array, swing: Array, strain: Array) -> Matrices:
        """Return the matrices of teeth in touch: their mean stiffness, and what the stiffest add."""
        along, stiffer = J[:1].T @ J[:1], self.energy.stiffest - self.energy.mean
        K, more = self.energy.mean * along, stiffer * along
        return K, self.damping * K, more, self.damping * more

    def unit_loads(self, apart: Array, axes: Array) -> list[tuple[Array, float]]:
        """Return none: hinges that turn leave no load between teeth open."""
        return []


Element = PointSpring | SixAxisSpring | GearTeeth
