"""Force laws along one direction: springs by a number, a table or a formula, dampers, end stops and friction.

Each law is an expression graph, which mechanisms compile and which NumPy evaluates.
"""

from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.formula import Formula
from fmd.core.splines import spline_pieces
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.formulas import raise_to, trace_formula
from fmd.dynamics.compiler.graph import Graph, Scalar
from fmd.dynamics.compiler.interpret import Evaluation, evaluation_of
from fmd.dynamics.formula_pieces import integrate_formula


@dataclass(frozen=True)
class Bend:
    """A place from which a curve leaves its polynomial, by ``weight max(0, x − at)^power``."""

    weight: float
    at: float
    power: int


@dataclass(frozen=True)
class ForceCurve:
    """A function of one variable: a polynomial with bends, or a formula of its own."""

    polynomial: tuple[float, ...] = (0.0,)  # coefficients, lowest power first
    bends: tuple[Bend, ...] = ()  # what is added from some places on
    formula: Formula | None = None  # a formula of the variable, which is its ``t``; it stands alone
    factor: float = 1.0  # factor of the formula's values

    def trace(self, x: Scalar) -> Scalar:
        """Trace the value."""
        if self.formula is not None:
            return trace_formula(self.formula.codes, self.formula.constants, x) * self.factor
        value = _polynomial(self.polynomial, x)
        for bend in self.bends:
            value = value + raise_to((x - bend.at).apply("positive"), bend.power) * bend.weight
        return value

    def trace_integral(self, x: Scalar) -> Scalar:
        """Trace the integral, from the same place for all x; of a formula from 0."""
        if self.formula is not None:
            return integrate_formula(self.formula).trace(x) * self.factor
        value = _polynomial(np.polynomial.polynomial.polyint(self.polynomial), x)
        for bend in self.bends:
            raised = raise_to((x - bend.at).apply("positive"), bend.power + 1)
            value = value + raised * (bend.weight / (bend.power + 1))
        return value

    def tangent(self, x: float) -> tuple[float, float]:
        """Return value and slope at a place."""
        value, slope = _tangent_of(self).at({"x": np.array([x])})
        return float(value), float(slope)


def straight_curve(x: Sequence[float], y: Sequence[float]) -> ForceCurve:
    """Make straight lines through points, which go on beyond the first and the last."""
    slopes = np.diff(y) / np.diff(x)
    bends = tuple(Bend(float(turn), float(at), 1) for turn, at in zip(np.diff(slopes), x[1:-1], strict=True))
    return ForceCurve((float(y[0] - slopes[0] * x[0]), float(slopes[0])), bends)


def smooth_curve(x: Sequence[float], y: Sequence[float]) -> ForceCurve:
    """Make the natural cubic spline through points, which goes on straight beyond the first and the last."""
    pieces = spline_pieces(x, y, "natural")
    slope, thirds = float(pieces[0, 1]), pieces[:, 3]
    jumps = np.diff(np.concatenate([[0.0], thirds, [0.0]]))
    bends = tuple(Bend(float(jump), float(at), 3) for jump, at in zip(jumps, x, strict=True))
    return ForceCurve((float(y[0] - slope * x[0]), slope), bends)


@dataclass(frozen=True)
class Stop:
    """An end stop: a spring and a damper on one side of a place, which come in over a short distance.

    Beyond its place by p it pushes back with ``stiffness ψ(p) + damping ψ'(p) ṗ`` where the slope of ψ grows from 0 to
    1 over the width: ``ψ = (max(0, p)² − max(0, p − width)²)/(2 width)``.
    """

    at: float  # its place [m or rad]
    side: float  # 1 if it acts beyond its place, -1 below it
    stiffness: float  # of full contact [N/m or N m/rad]
    damping: float  # of full contact [N s/m or N m s/rad]
    width: float  # distance over which they come in [m or rad]

    def depths(self, x: Scalar) -> tuple[Scalar, Scalar]:
        """Trace how far an elongation is beyond the place, and beyond the end of the width; 0 before."""
        p = (x - self.at) * self.side
        return p.apply("positive"), (p - self.width).apply("positive")


@dataclass(frozen=True)
class ForceLaw:
    """Force that resists an elongation x and its rate: a curve, a damper, end stops and friction.

    ``F = curve(x) + damping ẋ + stops + friction ẋ/√(ẋ² + friction_rate²)``, positive in tension.
    """

    curve: ForceCurve = ForceCurve()  # elastic force by the elongation
    damping: float = 0.0  # coefficient of a linear damper
    stops: tuple[Stop, ...] = ()
    friction: float = 0.0  # largest friction [N or N m]
    friction_rate: float = 1.0  # rate at which friction has reached 71 % of that [m/s or rad/s]

    def __post_init__(self) -> None:
        if not self.friction_rate > 0.0:
            raise ValueError("a friction's rate must be greater than zero")
        if not all(stop.width > 0.0 for stop in self.stops):
            raise ValueError("a stop's width must be greater than zero")

    def trace(self, x: Scalar, rate: Scalar) -> Scalar:
        """Trace the force, positive in tension."""
        force = self.curve.trace(x) + rate * self.damping
        if self.friction:
            root = (rate * rate + self.friction_rate**2).apply("sqrt")
            force = force + self.friction * (rate * root.inverse())
        for stop in self.stops:
            near, far = stop.depths(x)
            force = force + (near * near - far * far) * (stop.side * stop.stiffness / (2.0 * stop.width))
            force = force + (near - far) * rate * (stop.damping / stop.width)
        return force

    def trace_energy(self, x: Scalar) -> Scalar:
        """Trace the elastic energy."""
        energy = self.curve.trace_integral(x)
        for stop in self.stops:
            near, far = stop.depths(x)
            energy = energy + (near * near * near - far * far * far) * (stop.stiffness / (6.0 * stop.width))
        return energy

    def forces(self, x: Array, rate: Array) -> Array:
        """Forces at elongations and rates, (n,) each."""
        return _force_of(self).over({"x": np.stack([x, rate])}, len(x))[:, 0]

    def energies(self, x: Array) -> Array:
        """Elastic energies at elongations (n,) [J]."""
        return _energy_of(self).over({"x": x[None]}, len(x))[:, 0]

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


@lru_cache(maxsize=64)
def _tangent_of(curve: ForceCurve) -> Evaluation:
    x = Graph().scalar_input("x", 0)
    value = curve.trace(x)
    return evaluation_of([value, *differentiate(x.graph, [value], {x.node: x.graph.number(1.0)})])


@lru_cache(maxsize=64)
def _force_of(law: ForceLaw) -> Evaluation:
    graph = Graph()
    return evaluation_of([law.trace(graph.scalar_input("x", 0), graph.scalar_input("x", 1))])


@lru_cache(maxsize=64)
def _energy_of(law: ForceLaw) -> Evaluation:
    return evaluation_of([law.trace_energy(Graph().scalar_input("x", 0))])


def _polynomial(lowest_first: Iterable[float], x: Scalar) -> Scalar:
    value = x.graph.number(0.0)
    for coefficient in reversed(list(lowest_first)):
        value = value * x + float(coefficient)
    return value
