"""A whole major cycle of sub-cycling as one program: accelerations, the fast equation's tangents, and all steps.

Solution and tangents share nearly all products, so they are traced apart as functions of positions, rates and
accelerations, and what a cycle puts in place of rates and accelerations is substituted in both: equal expressions
become one. For fast coordinates that don't couple, of mechanisms without loops and without quaternions.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from fmd.core.limits.code import MOST_LATE
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.forces import ActingForces
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.frozen import trace_single
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector, combine, total
from fmd.dynamics.compiler.nodes import Place
from fmd.dynamics.compiler.oscillators import Oscillators, as_vector
from fmd.dynamics.compiler.program import Output
from fmd.dynamics.compiler.recursion import BodyValues, trace_accelerations
from fmd.dynamics.compiler.residual import trace_residual
from fmd.dynamics.compiler.substitute import substitute
from fmd.dynamics.mechanism import Mechanism

_Values = dict[tuple[int, ...], Scalar | Vector]
"""Scalars and vectors by the places of the coordinates that they are of."""


class _Cycle(NamedTuple):
    """Graph, numbers of coordinates, steps and inputs, tangents by their places, and late accelerations."""

    graph: Graph
    n: int
    n_steps: int
    n_inputs: int
    tangents: Mapping[Place, Scalar | Vector]
    late: Mapping[int, Scalar | Vector]


def trace_cycle(inputs: Coordinates, frames: list[MovingFrame], damped: bool, count: int) -> list[Output]:
    """Trace a cycle, usually of ``count`` steps, and the sum of the squares of its rates into the last of ``steps``."""
    graph, mechanism = inputs.graph, inputs.mechanism
    found = in_places(mechanism, trace_accelerations(frames, ActingForces(inputs, frames)))
    residual = trace_residual(inputs, frames)
    slow = [places[0] for places, value in found.items() if isinstance(value, Scalar) and places[0] < mechanism.n_slow]
    late = slow if len(slow) <= MOST_LATE else []
    tangents = trace_single(inputs, residual, "v", damped, late)
    middle = {places: _half_a_step_later(graph, places, mechanism.n_slow, value) for places, value in found.items()}
    rates = _replaced_inputs(graph, "v", middle)
    values = iter(substitute(graph, [*found.values()], rates))
    a = {places: next(values) for places in found}
    frozen = rates | _replaced_inputs(graph, "a", a)
    values = iter(substitute(graph, [output.value for output in tangents], frozen))
    at_places = {output.place: next(values) for output in tangents}
    late_values = {place: a[(place,)] for place in late}
    cycle = _Cycle(graph, mechanism.n, count, 3 * len(inputs.signals), at_places, late_values)
    H, outputs = graph.scalar_input("steps", 1), [Output(value, ("begin", places)) for places, value in a.items()]
    for places, value in a.items():
        slow = [k for k, place in enumerate(places) if place < mechanism.n_slow]
        fast = [k for k, place in enumerate(places) if place >= mechanism.n_slow]
        if slow:
            outputs += _take_slow_step(graph, H, tuple(places[k] for k in slow), _part(value, slow))
        if fast:
            outputs += _take_fast_steps(cycle, places, fast, value, middle[places])
    new = [as_vector(output.value) for output in outputs if output.place[0] == "v"]
    return [*outputs, Output(total(v.dot(v) for v in new), ("steps", (5,)))]


def _take_slow_step(graph: Graph, H: Scalar, places: tuple[int, ...], a: Vector) -> list[Output]:
    v = combine([(1.0, graph.vector_input("v", places)), (H, a)])
    q = combine([(1.0, graph.vector_input("q", places)), (H, v)])
    return [Output(value, (name, places)) for name, value in (("a", a), ("v", v), ("q", q))]


def _take_fast_steps(
    cycle: _Cycle, places: tuple[int, ...], part: list[int], a: Scalar | Vector, middle: Scalar | Vector
) -> list[Output]:
    """Trace the fast steps of a part of the coordinates whose places, accelerations and rates are given."""
    at, graph, zeros = tuple(places[k] for k in part), cycle.graph, cycle.graph.zeros(len(part))

    def tangent(argument: str, row: int = 0) -> Vector:
        value = cycle.tangents.get((argument, tuple(cycle.n * row + place for place in places)))
        return zeros if value is None else _part(value, part)

    x, v, inverse_mass = (graph.vector_input(name, at) for name in ("q", "v", "inverse_mass"))
    by_rates = tangent("by_rates")
    damping = () if by_rates.is_zero else (by_rates, _part(middle, part))
    levers = [(k, tangent("by_inputs", k)) for k in range(cycle.n_inputs)]
    moved = tuple((k, lever) for k, lever in levers if not lever.is_zero)
    found = [(factor, tangent("late", k)) for k, factor in enumerate(cycle.late.values())]
    late = tuple((factor, slope) for factor, slope in found if isinstance(factor, Scalar) and not slope.is_zero)
    oscillators = Oscillators(
        x, v, _part(a, part), inverse_mass, tangent("by_positions"), tangent("drift"), late, damping, moved
    )
    taken = oscillators.take_steps(cycle.n_inputs, cycle.n_steps)
    return [Output(value, (name, at)) for name, value in zip(("q", "v", "a"), taken, strict=True)]


def _part(value: Scalar | Vector, entries: list[int]) -> Vector:
    """Return some entries of a vector, or a scalar, as a vector."""
    vector = as_vector(value)
    if len(entries) == vector.size:
        return vector
    return vector.multiplied_by(np.eye(vector.size)[entries])


def _half_a_step_later(graph: Graph, places: tuple[int, ...], n_slow: int, like: Scalar | Vector) -> Scalar | Vector:
    """Return rates half a step after those that are kept, the slow ones half a cycle; a scalar or a vector like one."""
    h, H = (graph.scalar_input("steps", k) for k in range(2))
    if isinstance(like, Scalar):
        step = H if places[0] < n_slow else h
        return graph.scalar_input("v", places[0]) + graph.scalar_input("a", places[0]) * (step * 0.5)
    slow, a = np.array([float(place < n_slow) for place in places]), graph.vector_input("a", places)
    terms = [(h, a.multiplied_by(np.diag(1.0 - slow))), (H, a.multiplied_by(np.diag(slow)))]
    return combine([(1.0, graph.vector_input("v", places)), *((step * 0.5, part) for step, part in terms)])


def in_places(mechanism: Mechanism, values: list[BodyValues]) -> _Values:
    """Return scalars of joints and vectors of modes by the places of their rates."""
    out: _Values = {}
    for number, body in enumerate(values):
        first = int(mechanism.layout.rate[number])
        out |= {(first + k,): value for k, value in enumerate(body.joint)}
        if body.modes.size:
            out[tuple(int(k) for k in mechanism.modes_of(number))] = body.modes
    return out


def _replaced_inputs(graph: Graph, argument: str, values: _Values) -> dict[int, Scalar | Vector]:
    """Return values by the nodes of an argument's inputs that they replace."""
    out: dict[int, Scalar | Vector] = {}
    for number, node in enumerate(list(graph.nodes)):
        if node.operation in ("input", "vector input"):
            name, places = node.data  # type: ignore[misc]
            if name == argument and places in values:  # not parts of vectors, which cycles themselves take
                out[number] = values[places]
    return out
