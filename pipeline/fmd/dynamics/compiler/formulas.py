"""Formulas and tables of one variable as parts of a graph."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from fmd.core import formula as codes
from fmd.core.limits.code import MOST_FACTORS
from fmd.core.state_formula import CHOOSE, CURVE, VARIABLE
from fmd.dynamics.compiler.graph import Graph, Scalar

_FUNCTIONS = {codes.SIN: "far_sin", codes.COS: "far_cos", codes.EXP: "exp", codes.TANH: "tanh"}


def trace_formula(program: Sequence[int], constants: Sequence[float], x: Scalar) -> Scalar:
    """Trace the value of a postfix program of `fmd.core.formula` whose variable is a scalar.

    On a kink, abs has the slope after it for a rising argument, and min and max have that of their first argument.
    """
    return trace_program(x.graph, program, constants, lambda code: x)


def trace_program(
    graph: Graph,
    program: Sequence[int],
    constants: Sequence[float],
    variable: Callable[[int], Scalar],
    curves: Sequence[Callable[[Scalar], Scalar]] = (),
) -> Scalar:
    """Trace the value of a postfix program whose variables are found by their codes."""
    stack, numbers = list[Scalar](), iter(constants)
    for code in program:
        if code == codes.CONSTANT:
            stack.append(graph.number(next(numbers)))
        elif code >= CURVE:
            stack.append(curves[code - CURVE](stack.pop()))
        elif code == codes.TIME or code >= VARIABLE:
            stack.append(variable(code))
        elif code == CHOOSE:
            weight, first, second = stack.pop(), stack.pop(), stack.pop()
            stack.append(weight.select(first, second))
        elif code in (codes.BEFORE, codes.UNTIL):
            switch, first, second = stack.pop(), stack.pop(), stack.pop()
            x = variable(codes.TIME)
            until = (x - switch).select(second, first)
            stack.append((switch - x).select(first, second) if code == codes.BEFORE else until)
        elif code == codes.NEGATE or codes.SIN <= code <= codes.ABS:
            stack.append(_of_one(code, stack.pop()))
        else:
            b, a = stack.pop(), stack.pop()
            stack.append(_of_two(code, a, b))
    return stack[0]


def _of_one(code: int, a: Scalar) -> Scalar:
    if code in _FUNCTIONS:
        return a.apply(_FUNCTIONS[code])
    match code:
        case codes.NEGATE:
            return -a
        case codes.TAN:
            return a.apply("far_sin") * a.apply("far_cos").inverse()
        case codes.LOG:
            return a.select(a.apply("log"), a.graph.number(math.nan))
        case codes.SQRT:
            return a.power(0.5)
    return (-a).select(-a, a)


def _of_two(code: int, a: Scalar, b: Scalar) -> Scalar:
    match code:
        case codes.ADD:
            return a + b
        case codes.SUBTRACT:
            return a - b
        case codes.MULTIPLY:
            return a * b
        case codes.DIVIDE:
            return a * b.inverse()
        case codes.MINIMUM:
            return b.below(a).select(b, a)
        case codes.MAXIMUM:
            return (-b).below(-a).select(b, a)
    exponent = b.constant
    if exponent is not None and exponent == round(exponent) and abs(exponent) <= MOST_FACTORS:
        raised = raise_to(a, int(abs(exponent)))
        return raised if exponent >= 0.0 else raised.inverse()
    return a.power(b)


def raise_to(x: Scalar, power: int) -> Scalar:
    """Return a whole power as a product."""
    value = x.graph.number(1.0)
    for _ in range(power):
        value = value * x
    return value


def trace_table(knots: Sequence[float], cubics: Sequence[Sequence[float]], x: Scalar) -> Scalar:
    """Trace pieces of cubics, lowest power first, from each knot on; the first value holds before the first knot."""
    first = cubics[0][0]
    columns = np.array([(first, 0.0, 0.0, 0.0), *cubics]).T
    starts = np.array([knots[0], *knots])
    piece = x.piece(starts)
    beyond = x - piece.pick(starts)
    value, *coefficients = (piece.pick(column) for column in columns[::-1])
    for coefficient in coefficients:
        value = value * beyond + coefficient
    return value


def trace_periodic_table(knots: Sequence[float], cubics: Sequence[Sequence[float]], period: float, x: Scalar) -> Scalar:
    """Trace such pieces, which begin anew at the first knot after each period; 0 stands for none."""
    if period:
        x = x - ((x - knots[0]) * (1.0 / period)).apply("floor") * period
    return trace_table(knots, cubics, x)
