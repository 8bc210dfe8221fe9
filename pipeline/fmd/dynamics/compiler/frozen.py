"""Equation of the fast coordinates over a major cycle: its coefficients, and a step with it, as parts of a graph.

With the residual ``r = M̂ a − Q̂`` a coefficient is the change of r along a direction. Where fast coordinates don't
couple, all of their positions move at once, and so do all of their rates; elsewhere eight directions go side by side.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from fmd.core.limits.code import COLUMNS_AT_ONCE
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector, combine
from fmd.dynamics.compiler.program import Output
from fmd.dynamics.compiler.recursion import BodyValues

_Seeds = dict[int, Scalar | Vector]


def trace_drift(
    inputs: Coordinates, residual: list[BodyValues], moved: str = "moved", late: Sequence[int] = ()
) -> list[Output]:
    """Trace how the residual's fast rows change with what the slow coordinates do, and along each input.

    Slow positions change by the argument ``moved``, slow rates by the accelerations, but for some ``late`` ones: for
    each of these its unit is a row of the argument ``late``.
    """
    graph, mechanism = inputs.graph, inputs.mechanism
    first = mechanism.n_slow + mechanism.position_shift
    seeds = _slow_directions(graph, "q", moved, first) | _slow_directions(graph, "v", "a", mechanism.n_slow)
    own = {place: graph.scalar_input("v", place).node for place in late}
    seeds |= {node: graph.number(0.0) for node in own.values()}
    outputs = _fast_slopes(inputs, residual, seeds, "drift", 0)
    for k, node in enumerate(own.values()):
        outputs += _fast_slopes(inputs, residual, {node: graph.number(1.0)}, "late", k)
    for k in range(3 * len(inputs.signals)):
        seed: _Seeds = {graph.scalar_input("inputs", k).node: graph.number(1.0)}
        outputs += _fast_slopes(inputs, residual, seed, "by_inputs", k)
    return outputs


def trace_single(
    inputs: Coordinates,
    residual: list[BodyValues],
    moved: str = "moved",
    damped: bool = True,
    late: Sequence[int] = (),
) -> list[Output]:
    """Trace what `trace_drift` does, and the fast rows' change with all fast positions, and with all fast rates."""
    mechanism = inputs.mechanism
    positions = _fast_units(inputs.graph, "q", mechanism.n_slow + mechanism.position_shift)
    rates = _fast_units(inputs.graph, "v", mechanism.n_slow)
    return [
        *trace_drift(inputs, residual, moved, late),
        *_fast_slopes(inputs, residual, positions, "by_positions", 0),
        *(_fast_slopes(inputs, residual, rates, "by_rates", 0) if damped else ()),
    ]


def trace_fast_step(inputs: Coordinates, damped: bool) -> list[Output]:
    """Trace ``a_S = constant + slope τ + load − K q_S − C v_S`` with the rates half a step later, and a leapfrog step.

    ``clock`` holds τ and the step; K and C are in rows for each fast position and rate. C is absent without damping.
    """
    graph, mechanism = inputs.graph, inputs.mechanism
    n_fast, n_slow = mechanism.n - mechanism.n_slow, mechanism.n_slow
    rates = np.arange(n_slow, mechanism.n)
    positions = rates + mechanism.position_shift
    tau, h = (graph.scalar_input("clock", k) for k in range(2))
    q, v, a = (graph.vector_input(*at) for at in (("q", positions), ("v", rates), ("a", rates)))
    constant, slope, load = (graph.vector_input(name, rates) for name in ("constant", "slope", "load"))
    middle = combine([(1.0, v), (h * 0.5, a)])
    factors = [("K", q), ("C", middle)] if damped else [("K", q)]
    sums = [(1.0, combine([(1.0, constant), (tau, slope), (1.0, load)]))]
    for name, x in factors:
        for first in range(0, n_fast, COLUMNS_AT_ONCE):
            columns = range(first, min(first + COLUMNS_AT_ONCE, n_fast))
            rows = [graph.vector_input(name, np.arange(n_fast * j, n_fast * (j + 1))) for j in columns]
            sums.append((-1.0, combine([(x.entry(j), row) for j, row in zip(columns, rows, strict=True)])))
    new = combine(sums)
    rate = combine([(1.0, v), (h, new)])
    position = combine([(1.0, q), (h, rate)])
    places = [("a", rates, new), ("v", rates, rate), ("q", positions, position)]
    return [Output(value, (name, tuple(int(k) for k in at))) for name, at, value in places]


def _fast_slopes(
    inputs: Coordinates, residual: list[BodyValues], seeds: _Seeds, argument: str, row: int
) -> list[Output]:
    """Derivatives of the residual's fast rows along a direction, into a row of an argument."""
    mechanism, n, n_slow = inputs.mechanism, inputs.mechanism.n, inputs.mechanism.n_slow
    values: list[Scalar | Vector] = []
    places: list[list[int]] = []
    for number, body in enumerate(residual):
        first = int(mechanism.layout.rate[number])
        values += body.joint
        places += [[first + k] for k in range(len(body.joint))]
        if body.modes.size:
            values.append(body.modes)
            places.append([int(k) for k in mechanism.modes_of(number)])
    wanted = [k for k, at in enumerate(places) if max(at) >= n_slow]
    slopes = differentiate(inputs.graph, [values[k] for k in wanted], seeds)
    at_rows = [tuple(n * row + place for place in places[k]) for k in wanted]
    return [Output(slope, (argument, at)) for slope, at in zip(slopes, at_rows, strict=True)]


def _inputs_of(graph: Graph, argument: str) -> Iterable[tuple[int, tuple[int, ...], bool]]:
    """Number and places of each input of an argument, and whether it is a vector."""
    for number, node in enumerate(list(graph.nodes)):
        if node.operation in ("input", "vector input"):
            name, places = node.data  # type: ignore[misc]
            if name == argument:
                yield number, places, node.operation == "vector input"


def _slow_directions(graph: Graph, argument: str, direction: str, first_fast: int) -> _Seeds:
    """Let the direction of an argument be the like entries of another argument, and 0 from an entry on."""
    seeds: _Seeds = {}
    for number, places, is_vector in _inputs_of(graph, argument):
        if is_vector:
            slow = np.array([float(k < first_fast) for k in places])
            seeds[number] = graph.vector_input(direction, places).multiplied_by(np.diag(slow))
        else:
            slow_one = places[0] < first_fast
            seeds[number] = graph.scalar_input(direction, places[0]) if slow_one else graph.number(0.0)
    return seeds


def _fast_units(graph: Graph, argument: str, first: int) -> _Seeds:
    """Let the direction of an argument be 1 from an entry on, and 0 before."""
    return {
        number: graph.array(np.array([float(k >= first) for k in places]))
        if is_vector
        else graph.number(float(places[0] >= first))
        for number, places, is_vector in _inputs_of(graph, argument)
    }
