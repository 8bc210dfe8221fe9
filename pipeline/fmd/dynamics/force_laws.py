"""Force laws along one direction: springs by a number, a table or a formula, dampers, end stops and friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fmd.core.arrays import Array
from fmd.core.formula import Formula
from fmd.dynamics.formula_pieces import integrate_formula
from fmd.dynamics.signals.signal import Signal, formula


@dataclass(frozen=True)
class Bend:
    """A place from which a curve leaves its polynomial, by ``weight max(0, x − at)^power``."""

    weight: float
    at: float
    power: int


@dataclass(frozen=True)
class ForceCurve:
    """A function of one variable: a polynomial with bends, or a formula of its own.

    Parameters
    ----------
    polynomial : tuple of float
        Coefficients, lowest power first.
    bends : tuple of Bend
        What is added from some places on.
    formula : Formula, optional
        A formula of the variable, which is its ``t``; it stands alone.
    factor : float
        Factor of the formula's values.
    """

    polynomial: tuple[float, ...] = (0.0,)
    bends: tuple[Bend, ...] = ()
    formula: Formula | None = None
    factor: float = 1.0

    @cached_property
    def _signal(self) -> Signal:
        assert self.formula is not None
        return formula(self.formula, self.factor)

    def values(self, x: Array) -> Array:
        """Values at x (n,)."""
        if self.formula is not None:
            return np.asarray(self._signal.values(x)[:, 0])
        bent = (bend.weight * np.maximum(x - bend.at, 0.0) ** bend.power for bend in self.bends)
        return np.asarray(np.polynomial.polynomial.polyval(x, self.polynomial) + sum(bent))

    def slopes(self, x: Array) -> Array:
        """Slopes at x (n,)."""
        if self.formula is not None:
            return np.asarray(self._signal.values(x)[:, 1])
        powers = ((x > bend.at) * np.maximum(x - bend.at, 0.0) ** (bend.power - 1) for bend in self.bends)
        bent = (bend.weight * bend.power * power for bend, power in zip(self.bends, powers, strict=True))
        own = np.polynomial.polynomial.polyder(self.polynomial)
        return np.asarray(np.polynomial.polynomial.polyval(x, own) + sum(bent))

    def integrals(self, x: Array) -> Array:
        """Integrals up to x (n,), from the same place for all of them; of a formula from 0."""
        if self.formula is not None:
            return np.asarray(self.factor * integrate_formula(self.formula).values(x))
        bent = (
            bend.weight * np.maximum(x - bend.at, 0.0) ** (bend.power + 1) / (bend.power + 1) for bend in self.bends
        )
        own = np.polynomial.polynomial.polyint(self.polynomial)
        return np.asarray(np.polynomial.polynomial.polyval(x, own) + sum(bent))


def straight_curve(x: Sequence[float], y: Sequence[float]) -> ForceCurve:
    """Make straight lines through points, which go on beyond the first and the last."""
    slopes = np.diff(y) / np.diff(x)
    bends = tuple(Bend(float(turn), float(at), 1) for turn, at in zip(np.diff(slopes), x[1:-1], strict=True))
    return ForceCurve((float(y[0] - slopes[0] * x[0]), float(slopes[0])), bends)


def smooth_curve(x: Sequence[float], y: Sequence[float]) -> ForceCurve:
    """Make the natural cubic spline through points, which goes on straight beyond the first and the last."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(x, y, bc_type="natural")
    slope, thirds = float(spline(x[0], 1)), spline.c[0]
    jumps = np.diff(np.concatenate([[0.0], thirds, [0.0]]))
    bends = tuple(Bend(float(jump), float(at), 3) for jump, at in zip(jumps, x, strict=True))
    return ForceCurve((float(y[0] - slope * x[0]), slope), bends)


@dataclass(frozen=True)
class Stop:
    """An end stop: a spring and a damper on one side of a place, which come in over a short distance.

    Beyond its place by p it pushes back with ``stiffness ψ(p) + damping ψ'(p) ṗ`` where the slope of ψ grows from 0 to
    1 over the width: ``ψ = (max(0, p)² − max(0, p − width)²)/(2 width)``.

    Parameters
    ----------
    at : float
        Its place [m or rad].
    side : float
        1 if it acts beyond its place, -1 below it.
    stiffness, damping : float
        Of full contact [N/m and N s/m, or N m/rad and N m s/rad].
    width : float
        Distance over which they come in [m or rad].
    """

    at: float
    side: float
    stiffness: float
    damping: float
    width: float


@dataclass(frozen=True)
class ForceLaw:
    """Force that resists an elongation x and its rate: a curve, a damper, end stops and friction.

    ``F = curve(x) + damping ẋ + stops + friction ẋ/√(ẋ² + friction_rate²)``, positive in tension.

    Parameters
    ----------
    curve : ForceCurve
        Elastic force by the elongation.
    damping : float
        Coefficient of a linear damper.
    stops : tuple of Stop
        End stops.
    friction : float
        Largest friction [N or N m].
    friction_rate : float
        Rate at which friction has reached 71 % of that [m/s or rad/s].
    """

    curve: ForceCurve = ForceCurve()
    damping: float = 0.0
    stops: tuple[Stop, ...] = ()
    friction: float = 0.0
    friction_rate: float = 1.0

    def __post_init__(self) -> None:
        if not self.friction_rate > 0.0:
            raise ValueError("a friction's rate must be greater than zero")
        if not all(stop.width > 0.0 for stop in self.stops):
            raise ValueError("a stop's width must be greater than zero")

    def forces(self, x: Array, rate: Array) -> Array:
        """Forces at elongations and rates, (n,) each."""
        total = self.curve.values(x) + self.damping * rate
        total = total + self.friction * rate / np.sqrt(rate**2 + self.friction_rate**2)
        for stop in self.stops:
            p = stop.side * (x - stop.at)
            near, far = np.maximum(p, 0.0), np.maximum(p - stop.width, 0.0)
            total = total + stop.side * stop.stiffness * (near**2 - far**2) / (2.0 * stop.width)
            total = total + stop.damping * (near - far) / stop.width * rate
        return np.asarray(total)

    def energies(self, x: Array) -> Array:
        """Elastic energies at elongations (n,) [J]."""
        total = self.curve.integrals(x)
        for stop in self.stops:
            p = stop.side * (x - stop.at)
            cubes = np.maximum(p, 0.0) ** 3 - np.maximum(p - stop.width, 0.0) ** 3
            total = total + stop.stiffness * cubes / (6.0 * stop.width)
        return np.asarray(total)

    @property
    def resting_damping(self) -> float:
        """Damping at rest: that of the damper and the slope of friction."""
        return self.damping + self.friction / self.friction_rate

    @property
    def stop_stiffness(self) -> float:
        """Largest stiffness that an end stop adds."""
        return max((stop.stiffness for stop in self.stops), default=0.0)

    @property
    def stop_damping(self) -> float:
        """Largest damping that an end stop adds."""
        return max((stop.damping for stop in self.stops), default=0.0)
