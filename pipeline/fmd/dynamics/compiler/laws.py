"""Force laws as parts of a graph: the force by an elongation and its rate, and the energy."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fmd.core.formula import Formula
from fmd.core.limits.loads import GAUSS_POINTS
from fmd.dynamics.compiler.formulas import raise_to, trace_formula
from fmd.dynamics.compiler.graph import Scalar, total
from fmd.dynamics.force_laws import ForceCurve, ForceLaw
from fmd.dynamics.formula_pieces import integrate_formula


def trace_law(law: ForceLaw, x: Scalar, rate: Scalar) -> Scalar:
    """Trace the force of a law, positive in tension."""
    force = trace_curve(law.curve, x) + rate * law.damping
    if law.friction:
        root = (rate * rate + law.friction_rate**2).apply("sqrt")
        force = force + law.friction * (rate * root.inverse())
    for stop in law.stops:
        near, far = _contact(x, stop.at, stop.side, stop.width)
        force = force + (near * near - far * far) * (stop.side * stop.stiffness / (2.0 * stop.width))
        force = force + (near - far) * rate * (stop.damping / stop.width)
    return force


def trace_law_energy(law: ForceLaw, x: Scalar) -> Scalar:
    """Trace the elastic energy of a law."""
    energy = _trace_integral(law.curve, x)
    for stop in law.stops:
        near, far = _contact(x, stop.at, stop.side, stop.width)
        energy = energy + (near * near * near - far * far * far) * (stop.stiffness / (6.0 * stop.width))
    return energy


def trace_curve(curve: ForceCurve, x: Scalar) -> Scalar:
    """Trace the value of a curve."""
    if curve.formula is not None:
        return trace_formula(curve.formula.codes, curve.formula.constants, x) * curve.factor
    value = _polynomial(curve.polynomial, x)
    for bend in curve.bends:
        value = value + raise_to((x - bend.at).apply("positive"), bend.power) * bend.weight
    return value


def _trace_integral(curve: ForceCurve, x: Scalar) -> Scalar:
    if curve.formula is not None:
        return _trace_formula_integral(curve.formula, x) * curve.factor
    value = _polynomial(np.polynomial.polynomial.polyint(curve.polynomial), x)
    for bend in curve.bends:
        raised = raise_to((x - bend.at).apply("positive"), bend.power + 1)
        value = value + raised * (bend.weight / (bend.power + 1))
    return value


def _trace_formula_integral(formula: Formula, x: Scalar) -> Scalar:
    """Trace a formula's integral from 0: up to the last edge of a piece before x, and by quadrature from there."""
    integral = integrate_formula(formula)
    edges, sums, middle = integral.edges, integral.sums, integral.middle
    begin, value = x.graph.number(float(edges[middle])), x.graph.number(float(sums[middle]))
    for k in range(len(edges)):
        if k != middle:
            before = k - 1 if k > middle else k + 1
            passed = ((x - float(edges[k])) * (k - before)).apply("step")
            begin = begin + passed * float(edges[k] - edges[before])
            value = value + passed * float(sums[k] - sums[before])
    points, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    length = x - begin
    places = (begin + length * float(0.5 * (point + 1.0)) for point in points)
    inside = (trace_formula(formula.codes, formula.constants, place) for place in places)
    return value + total(f * float(w) for f, w in zip(inside, weights, strict=True)) * length * 0.5


def _contact(x: Scalar, at: float, side: float, width: float) -> tuple[Scalar, Scalar]:
    p = (x - at) * side
    return p.apply("positive"), (p - width).apply("positive")


def _polynomial(lowest_first: Iterable[float], x: Scalar) -> Scalar:
    value = x.graph.number(0.0)
    for coefficient in reversed(list(lowest_first)):
        value = value * x + float(coefficient)
    return value
