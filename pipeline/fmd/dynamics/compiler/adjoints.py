"""Derivatives of weighted sums of accelerations, and of constraints, by all that they depend on at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fmd.dynamics.compiler.coordinates import Coordinates, RestingCoordinates
from fmd.dynamics.compiler.forces import ActingForces, GivenForces
from fmd.dynamics.compiler.frames import MovingFrame, trace_frames
from fmd.dynamics.compiler.graph import Scalar, Vector
from fmd.dynamics.compiler.program import Output
from fmd.dynamics.compiler.recursion import BodyValues, trace_accelerations
from fmd.dynamics.compiler.residual import trace_residual
from fmd.dynamics.compiler.reverse import differentiate_sum
from fmd.dynamics.compiler.tangents import flatten


def trace_acceleration_adjoint(
    inputs: Coordinates, frames: list[MovingFrame], acting: ActingForces
) -> tuple[list[BodyValues], list[Output]]:
    """Trace derivatives of ``weights · a`` of the accelerations, and ``x = M̂⁻¹ weights``.

    They are those of ``−x · r`` of the residual at fixed accelerations.
    """
    resting = RestingCoordinates(inputs.graph, inputs.mechanism)
    forces = GivenForces(resting, "weights", range(inputs.mechanism.n))
    x = trace_accelerations(trace_frames(resting), forces)
    residual = flatten(trace_residual(inputs, frames, acting))
    return x, _trace_adjoint(inputs, residual, [-weight for weight in flatten(x)], ("inputs", "q", "v"))


def trace_rows_adjoint(inputs: Coordinates, values: Mapping[str, Sequence[Scalar]], of: Sequence[str]) -> list[Output]:
    """Trace derivatives of sums of constraints' values, whose weights are arguments of their names."""
    pairs = [(value, inputs.graph.scalar_input(name, k)) for name, own in values.items() for k, value in enumerate(own)]
    return _trace_adjoint(inputs, [value for value, _ in pairs], [weight for _, weight in pairs], of)


def _trace_adjoint(
    inputs: Coordinates, values: Sequence[Scalar | Vector], weights: Sequence[Scalar | Vector], of: Sequence[str]
) -> list[Output]:
    """Trace derivatives of a weighted sum by all inputs of some arguments, 0 by those that it hasn't."""
    graph, mechanism, outputs = inputs.graph, inputs.mechanism, list[Output]()
    sizes = {"inputs": 3 * len(inputs.signals) + len(inputs.numbers), "q": mechanism.n_positions}
    left = {name: dict.fromkeys(range(sizes.get(name, mechanism.n))) for name in of}
    for number, value in differentiate_sum(graph, values, weights).items():
        name, places = graph.nodes[number].data  # type: ignore[misc]
        if name in of:
            outputs.append(Output(value, (f"{name}_adjoint", places)))
            for place in places:
                del left[name][place]
    zero = graph.number(0.0)
    return outputs + [Output(zero, (f"{name}_adjoint", (place,))) for name in of for place in left[name]]
