"""Errors estimated from two computations of different fineness.

Richardson's extrapolation (Phil Trans R Soc A 210, 1911): if the error falls by ``R`` from the coarser to the finer
computation, the error of the finer one is their difference over ``R − 1``.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.errors import LEAST_SHOWN, MOST_OF_EIGENVALUE, NEAR_PEAK, SAFETY

NO_PART = "no part in it"
NO_VIBRATION = "not estimated: no vibration of the mesh is alike; more modes help"
"""Of a frequency of few fixed-interface modes and static responses: they make up none of the mesh's own."""
OTHER_LOOPS = "not estimated: more shapes also move a loop in directions in which the run's shapes don't"
"""Of reactions there: forces between the two models differ by more than an error."""
MORE_OF_MODEL = "model, left out"
"""Part of a row for causes of the model's error that were not estimated: what is stated is a lower bound then."""
MORE_OF_MESH = "discretisation, left out"
"""The same for the mesh's error, where another mesh that gives a part of it was left out."""
NO_LIMIT = "no limit"
"""The same for stress that grows with each finer mesh."""
NUMERICAL = ("discretisation", "truncation", "time", "recovery")  # sources that finer computations lower
SOURCES = (*NUMERICAL, "model")


@dataclass(frozen=True)
class Quantity:
    """A result of a run, over time or once, with its unit and its order of convergence."""

    name: str
    unit: str
    values: Array  # (n_times,) or (n_times, 3): values at the output times; one if it doesn't depend on time
    largest: bool = False  # the largest size over time is reported, and not the whole history
    # Convergence as the mesh is refined: that of ``"displacement"``, ``"stress"``, ``"spot stress"`` in the middle of
    # an element, or ``"geometry"``.
    kind: Literal["displacement", "stress", "spot stress", "geometry"] = "displacement"

    @property
    def sizes(self) -> Array:
        """Absolute values over time, (n_times,)."""
        return np.abs(self.values) if self.values.ndim == 1 else np.asarray(np.linalg.norm(self.values, axis=1))

    @property
    def scale(self) -> float:
        """Largest absolute value, to which errors are relative."""
        return float(self.sizes.max())

    def error(self, other: Quantity) -> float:
        """Return the error relative to another computation: of the largest value, or the largest over time."""
        return _over(self._apart(other), other.scale)

    def change(self, other: Quantity) -> float:
        """Return the size of a difference from ``other``, relative to the larger of the two.

        A largest value may by chance be the same in both: half of the difference of any peak near it counts at
        least. Peaks are compared, not values, since a peak that comes a little later is as large.
        """
        apart = self._apart(other)
        if self.largest:
            near = self.sizes >= NEAR_PEAK * self.scale
            starts = np.flatnonzero(near & ~np.r_[False, near[:-1]])
            apart = max(apart, 0.5 * float(np.abs(self._peaks(near, starts) - other._peaks(near, starts)).max()))
        return _over(apart, max(self.scale, other.scale))

    def _peaks(self, near: NDArray[np.bool_], starts: IntArray) -> Array:
        """Return the largest size in each stretch of times that are ``near`` a peak, by where these start."""
        return np.asarray(np.maximum.reduceat(np.where(near, self.sizes, 0.0), starts))

    def _apart(self, other: Quantity) -> float:
        if self.largest:
            return abs(self.scale - other.scale)
        return Quantity("", "", self.values - other.values).scale


class OrientationQuantity(Quantity):
    """Orientation over time by unit quaternions (n_times, 4); its size is the angle turned since the start [rad].

    That is half a turn at most. The error is the angle between two orientations.
    """

    @property
    def sizes(self) -> Array:
        """Angles turned since the start [rad], (n_times,)."""
        return angles_between(self.values[:1], self.values)

    def _apart(self, other: Quantity) -> float:
        return float(angles_between(self.values, other.values).max())


def percent(error: float) -> str:
    """Write a relative error in percent, to two digits; whole ones from a hundred on."""
    if error >= 0.995:
        return f"{100 * error:.0f}"
    return f"{100 * error:.2g}" if error >= LEAST_SHOWN else "<.001"


def angles_between(e: Array, f: Array) -> Array:
    """Return the angles between orientations by unit quaternions (n, 4) of either sign [rad], (n,)."""
    chord = np.minimum(np.linalg.norm(e - f, axis=1), np.linalg.norm(e + f, axis=1))
    return np.asarray(4 * np.arcsin(np.minimum(chord / 2, 1.0)))


@dataclass(frozen=True)
class Row:
    """Error budget of one quantity."""

    name: str
    unit: str
    value: float  # largest value of the quantity, or the only one
    over_time: bool  # the error is the largest of a history's
    # Relative error by each source, or in words why there is no estimate: `NO_PART`, or what it would take.
    parts: dict[str, float | str]
    correction: float = 0.0  # what finer computations add to the value
    between: float = 0.0  # what many more times than the outputs add to it

    @property
    def better(self) -> float:
        """Value with all corrections by finer computations, also between output times."""
        return max(self.value + self.between + self.correction, 0.0)

    @property
    def interval(self) -> tuple[float, float] | None:
        """Interval that holds the value, the better one and the truth; ``None`` where an estimate is missing.

        The value is stated within its total. Half of a total that one source makes up is a known correction, and the
        truth then lies about the better value, no farther from it than the value does.
        """
        if self.why:
            return None
        largest = self.value + self.between
        size, moved = max(largest, self.better), abs(self.better - largest)
        half = max(self.total * size - moved, moved)
        return float(max(min(self.value, self.better - half), 0.0)), float(self.better + half)

    @property
    def size(self) -> float:
        """Stated error at output times in the quantity's unit: a share of its larger value, the run's or the better."""
        return self.total * max(self.value, self.value + self.correction)

    def summary(self) -> dict[str, Any]:
        """Return the row as plain numbers and texts."""
        named = {"quantity": self.name, "value": self.value, "unit": self.unit, "over_time": self.over_time}
        stated = {"total": None if self.why else self.total, "better": self.better, "between": self.between}
        interval = {"interval": self.interval and [*self.interval]}
        return named | self.parts | stated | interval | ({"why": self.why} if self.why else {})

    @property
    def why(self) -> str:
        """Why there is no interval: the estimates that are missing; empty if there is one."""
        texts = (part for part in self.parts.values() if isinstance(part, str) and part != NO_PART)
        return "; ".join(dict.fromkeys(texts))

    @property
    def total(self) -> float:
        """Stated relative error: `SAFETY` times the root of the sum of the estimates' squares.

        Sources are independent of one another, so that they rarely add up at the same instant (JCGM 100, Guide to the
        expression of uncertainty in measurement, 2008, section 5.1).
        """
        return self._stated(SOURCES)

    @property
    def numerical(self) -> float:
        """Stated relative error without the model's: the distance to the exact solution of the model as it is."""
        return self._stated(NUMERICAL)

    @property
    def dominant(self) -> str:
        """Source with the largest estimate, of those that finer computations lower."""
        return max(NUMERICAL, key=self._estimate)

    def _stated(self, sources: tuple[str, ...]) -> float:
        return SAFETY * math.hypot(*(self._estimate(source) for source in sources))

    def _estimate(self, source: str) -> float:
        part = self.parts.get(source, NO_PART)
        return part if isinstance(part, float) else 0.0


def refinement_gain(ratio: float, order: int, edges: int, kind: str) -> float:
    """Return the factor by which the error falls with elements ``ratio`` times smaller, less one.

    Displacements, energies and eigenvalues converge as ``h^2p`` with elements of order p, stress at least as ``h^p``,
    and in the middle of an element, where it is most accurate, as ``h^(p+1)`` (Barlow, Int J Num Meth Eng 10, 1976).
    The volume in facets whose ``edges`` are of order k converges as ``h^2k``: as ``h²`` in plane ones, and as ``h⁴`` in
    curved ones with nodes on the surface, since Simpson's rule is exact for cubics (Strang & Fix, An Analysis of the
    Finite Element Method, 1973).
    """
    power = {"displacement": 2 * order, "stress": order, "spot stress": order + 1, "geometry": 2 * edges}[kind]
    return float(ratio**power) - 1


def shifted_frequencies(omega: Array, excess: Array, part: float) -> Array:
    """Return frequencies (n,) with ``part`` of the relative excess (n,) of their squares taken off.

    At most three quarters of a square are taken off.
    """
    return np.asarray(omega * np.sqrt(1 - np.clip(part * excess, -MOST_OF_EIGENVALUE, MOST_OF_EIGENVALUE)))


def _over(size: float, scale: float) -> float:
    return size / scale if scale else 0.0
