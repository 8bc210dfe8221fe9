"""Expression graphs: simplification, the interpreter, differentiation, Stumpff functions."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import expm

from fmd.core.arrays import Array
from fmd.dynamics.compiler.adjoints import differentiate_sum
from fmd.dynamics.compiler.algebra import constants, factor_symmetric, times
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.functions import SERIES_LIMITS, evaluate_function
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector, combine
from tests.dynamics.compiler.comparison import interpret

RNG = np.random.default_rng(3)
MATRIX = RNG.normal(size=(3, 3))


def stumpff(k: int, x: float) -> float:
    return float(evaluate_function(f"stumpff{k}", x))


def arc(k: int, y: float) -> float:
    return float(evaluate_function(f"arc{k}", y))


def inputs(graph: Graph) -> tuple[Scalar, Scalar, Vector, Vector]:
    x, y = graph.scalar_input("s", 0), graph.scalar_input("s", 1)
    return x, y, graph.vector_input("u", range(3)), graph.vector_input("u", range(3, 6))


def test_zeros_and_ones_are_no_operations() -> None:
    graph = Graph()
    x, y, u, _ = inputs(graph)
    size = len(graph.nodes)
    assert (x + 0.0).node == x.node
    assert (1.0 * x).node == x.node
    assert (x - x).is_zero
    assert (0.0 * x).is_zero
    assert (x * x.inverse()).constant == 1.0
    assert (0.0 * u).is_zero
    assert u.dot(graph.zeros(3)).is_zero
    assert u.multiplied_by(np.eye(3)).node == u.node
    used = {graph.nodes[k].operation for k in range(size, len(graph.nodes))}
    assert used <= {"number", "array", "invert"}
    assert (x - (-y)).node == (x + y).node


def test_equal_expressions_are_one_node() -> None:
    graph = Graph()
    x, y, u, w = inputs(graph)
    assert (x * y).node == (y * x).node
    assert u.dot(w).node == w.dot(u).node
    assert (-x * -y).node == (x * y).node
    assert (u + w).node == (w + u).node
    assert ((u * x) * y).node == (u * (x * y)).node


def test_constants_fold() -> None:
    graph = Graph()
    two = graph.number(2.0)
    assert (two * 3.0 + 1.0).constant == 7.0
    assert two.apply("sin").constant == math.sin(2.0)
    a = graph.array([1.0, 2.0, 3.0])
    assert a.dot(a).constant == 14.0
    assert combine([(2.0, a), (-2.0, a)]).is_zero
    values = a.multiplied_by(MATRIX).constant
    assert values is not None
    assert np.array_equal(values, MATRIX @ [1.0, 2.0, 3.0])


def test_a_product_with_a_unit_vector_is_an_entry() -> None:
    graph = Graph()
    *_, u, _ = inputs(graph)
    assert u.dot(graph.array([0.0, 2.0, 0.0])).node == (2.0 * u.entry(1)).node


def test_the_inverse_of_zero_is_not_a_number() -> None:
    assert math.isnan(Graph().number(0.0).inverse().constant or 0.0)


def expressions(graph: Graph) -> list[Scalar | Vector]:
    """One of every operation, each within its neighbours."""
    x, y, u, w = inputs(graph)
    s = (x * y - y.apply("sin")) * (x + 2.0).inverse() + u.dot(w) * (-y).apply("cos")
    t = (x * x + y * y).apply("stumpff4") - (u.dot(u)).apply("stumpff5") + u.entry(2) * s
    vector = combine([(s, u), (t, w.multiplied_by(MATRIX)), (1.0, u.multiplied_by(np.diag([1.0, 2.0, 3.0])))])
    return [s, t, vector, vector.multiplied_by(MATRIX[:2]) * x, vector.dot(w) * s]


def test_derivatives_are_those_of_differences() -> None:
    # Differences of order 4 over 1e-3 leave some 1e-11.
    graph = Graph()
    values = expressions(graph)
    s, u, ds, du = (RNG.normal(size=n) for n in (2, 6, 2, 6))
    x, y, a, b = inputs(graph)
    seeds = {x.node: graph.scalar_input("ds", 0), y.node: graph.scalar_input("ds", 1)}
    seeds |= {a.node: graph.vector_input("du", range(3)), b.node: graph.vector_input("du", range(3, 6))}
    slopes = differentiate(graph, values, seeds)
    found = interpret(graph, [slope.node for slope in slopes], {"s": s, "u": u, "ds": ds, "du": du})
    nodes, h = [value.node for value in values], 1e-3
    at = [interpret(graph, nodes, {"s": s + k * h * ds, "u": u + k * h * du}) for k in (-2, -1, 1, 2)]
    for number, slope in enumerate(found):
        far, near, ahead, beyond = (values[number] for values in at)
        assert np.allclose(slope, (far - 8 * near + 8 * ahead - beyond) / (12 * h), rtol=1e-8, atol=1e-8)
    weights = [RNG.normal(size=np.shape(value)) for value in found]
    sums = [graph.array(weight) if weight.ndim else graph.number(float(weight)) for weight in weights]
    backwards = differentiate_sum(graph, values, sums)
    whole = interpret(graph, [backwards[each.node].node for each in (x, y, a, b)], {"s": s, "u": u})
    expected = sum(np.sum(weight * value) for weight, value in zip(weights, found, strict=True))
    assert np.isclose(np.hstack(whole) @ np.r_[ds, du], expected, rtol=1e-12)


def test_what_a_direction_leaves_out_folds_away() -> None:
    graph = Graph()
    x, y, u, _ = inputs(graph)
    (slope,) = differentiate(graph, [x * y + u.dot(u)], {x.node: graph.number(1.0)})
    assert slope.node == y.node


def test_the_last_stumpff_function_has_no_derivative() -> None:
    graph = Graph()
    x = graph.scalar_input("s", 0)
    with pytest.raises(ValueError, match="stumpff9 has no derivative among"):
        differentiate(graph, [x.apply("stumpff9")], {x.node: graph.number(1.0)})


@pytest.mark.parametrize("length", [0.0, 1e-4, 0.3, 1.9, 2.1, 5.0, 20.0])
def test_stumpff_functions_make_rotations(length: float) -> None:
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    t, x = axis * length, length * length
    c2, c3 = 0.5 - x * stumpff(4, x), 1.0 / 6.0 - x * stumpff(5, x)
    T = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    assert np.allclose(np.eye(3) + (1.0 - x * c3) * T + c2 * T @ T, expm(T), rtol=0, atol=1e-13)


@pytest.mark.parametrize("k", range(4, 10))
def test_stumpff_functions_go_on_smoothly_from_series_to_sines(k: int) -> None:
    below, above = (
        stumpff(k, SERIES_LIMITS["stumpff"] * (1 - 1e-15)),
        stumpff(k, SERIES_LIMITS["stumpff"] * (1 + 1e-15)),
    )
    assert math.isclose(below, above, rel_tol=1e-11)


@pytest.mark.parametrize("angle", [0.0, 1e-7, 0.02, 0.9, 0.95, 2.0, 3.1])
def test_arcs_take_a_rotation_s_vector_from_its_matrix(angle: float) -> None:
    n = np.array([2.0, -1.0, 2.0]) / 3.0
    R = expm(angle * tilde(n))
    y, s = (3.0 - np.trace(R)) / 4.0, 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    assert np.allclose(arc(0, y) * s, angle * n, rtol=0, atol=1e-13 / (1.0 - y))
    h = 0.5 * arc(1, y) - 0.25 * arc(0, y) / (1.0 - y)
    inverse = np.eye(3) - 0.5 * angle * tilde(n) + h * tilde(s) @ tilde(s)
    x = angle**2  # A of the rotation vector, by Stumpff functions
    c2, c3 = 0.5 - x * stumpff(4, x), 1.0 / 6.0 - x * stumpff(5, x)
    A = np.eye(3) + c2 * angle * tilde(n) + c3 * angle**2 * tilde(n) @ tilde(n)
    assert np.allclose(inverse @ A, np.eye(3), rtol=0, atol=1e-12 / (1.0 - y))


@pytest.mark.parametrize("k", range(4))
def test_arcs_go_on_smoothly_from_series_to_closed_form(k: int) -> None:
    below, above = arc(k, SERIES_LIMITS["arc"] * (1 - 1e-15)), arc(k, SERIES_LIMITS["arc"] * (1 + 1e-15))
    assert math.isclose(below, above, rel_tol=1e-11)
    assert np.isnan(arc(k, 1.0))


@pytest.mark.parametrize(("function", "at"), [
    ("sqrt", 0.7), ("exp", -0.4), ("log", 1.3), ("tanh", 0.6), ("positive", 0.5), ("positive", -0.5), ("step", 0.5),
    ("arc0", 0.1), ("arc1", 0.6), ("arc2", 0.3),
])  # fmt: skip
def test_functions_have_the_slopes_of_differences(function: str, at: float) -> None:
    graph = Graph()
    x = graph.scalar_input("s", 0)
    (slope,) = differentiate(graph, [x.apply(function)], {x.node: graph.number(1.0)})
    ahead, behind = (evaluate_function(function, at + h) for h in (1e-6, -1e-6))
    (value,) = interpret(graph, [slope.node], {"s": np.array([at])})
    assert value == pytest.approx((ahead - behind) / 2e-6, rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("make", [
    lambda x, y: x.power(2.5), lambda x, y: x.power(y), lambda x, y: (x - y).select(x * y, x.apply("exp")),
    lambda x, y: (y - x).select(x * y, x.apply("exp")), lambda x, y: x.below(y), lambda x, y: y.moving(x * x),
    lambda x, y: x.piece(np.array([0.0, 0.5, 0.9])).pick(np.array([1.0, 3.0, 2.0])) * x,
])  # fmt: skip
def test_choices_have_the_slopes_of_differences(make: Callable[[Scalar, Scalar], Scalar]) -> None:
    graph = Graph()
    x, y = (graph.scalar_input("s", k) for k in range(2))
    value, at, way = make(x, y), np.array([0.7, 0.4]), np.array([1.0, -0.5])
    (slope,) = differentiate(graph, [value], {x.node: graph.number(way[0]), y.node: graph.number(way[1])})
    ahead, behind = (interpret(graph, [value.node], {"s": at + h * way})[0] for h in (1e-6, -1e-6))
    (found,) = interpret(graph, [slope.node], {"s": at})
    assert found == pytest.approx((ahead - behind) / 2e-6, rel=1e-8, abs=1e-9)
    backwards = differentiate_sum(graph, [value], [graph.number(1.0)])
    by = [backwards[each.node].node if each.node in backwards else graph.number(0.0).node for each in (x, y)]
    assert np.array(interpret(graph, by, {"s": at})) @ way == pytest.approx(found, rel=1e-12, abs=1e-15)


def test_what_stands_still_has_no_rate_where_a_slope_is_infinite() -> None:
    graph = Graph()
    x = graph.scalar_input("s", 0)
    (slope,) = differentiate(graph, [x.power(0.5)], {x.node: graph.scalar_input("ds", 0)})
    still, moving = (interpret(graph, [slope.node], {"s": np.zeros(1), "ds": np.array([ds])})[0] for ds in (0.0, 1.0))
    assert still == 0.0
    assert moving == np.inf


def test_functions_have_no_value_where_mathematics_has_none() -> None:
    assert np.isnan([evaluate_function(name, -1.0) for name in ("sqrt", "log")]).all()
    assert evaluate_function("exp", 1e3) == np.inf


def tilde(a: Array) -> Array:
    return np.cross(np.eye(3), a)


def test_symmetric_factors_solve() -> None:
    A = MATRIX @ MATRIX.T + np.eye(3)
    graph = Graph()
    factor = factor_symmetric([constants(graph, row) for row in A])
    x = factor.solve(constants(graph, [1.0, -2.0, 0.5]))
    back = times([constants(graph, row) for row in A], x)
    assert np.allclose([value.constant for value in back], [1.0, -2.0, 0.5], rtol=1e-13)
