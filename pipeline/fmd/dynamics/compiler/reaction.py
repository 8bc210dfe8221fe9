"""All that reversible sub-cycling freezes at a major cycle's middle, as one part of a graph.

For each of eight directions ``T = (−D, 1)`` in which a fast coordinate moves and the slow ones react: D = M_LL⁻¹ M_LS
itself, what the tangents of Q̂ along T do to the fast accelerations, and what they do to that of ``y = q_L + D q_S``.
Each solution alone would factor the same articulated inertias again, and trace the same motion.
"""

from __future__ import annotations

from fmd.dynamics.compiler.coordinates import Coordinates, RestingCoordinates
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.forces import ActingForces, GivenForces
from fmd.dynamics.compiler.frames import MovingFrame, trace_frames
from fmd.dynamics.compiler.graph import Scalar, Vector, combine
from fmd.dynamics.compiler.recursion import BodyValues, trace_accelerations
from fmd.dynamics.compiler.residual import trace_residual
from fmd.dynamics.compiler.tangents import flatten, trace_tangents, unflatten

Reaction = dict[str, list[BodyValues]]
"""Values by the argument that they fill: ``a``, ``D``, ``K`` and ``Ky``, and with damping ``C`` and ``Cy``."""


class UnacceleratedCoordinates(Coordinates):
    """Inputs of a mechanism whose accelerations are zero."""

    def inputs_of_joint(self, body: int, argument: str) -> list[Scalar]:
        """Return zeros for accelerations."""
        if argument != "a":
            return super().inputs_of_joint(body, argument)
        return [self.graph.number(0.0)] * self.mechanism.links[body].n_rates

    def inputs_of_modes(self, body: int, argument: str) -> Vector:
        """Return zeros for accelerations."""
        if argument != "a":
            return super().inputs_of_modes(body, argument)
        return self.graph.zeros(len(self.mechanism.links[body].omega))


class TracedForces(GivenForces):
    """Generalised forces that are values of the graph, body by body, on a mechanism at rest without weight."""

    def __init__(self, inputs: RestingCoordinates, values: list[BodyValues], free: range) -> None:
        super().__init__(inputs, "", free)
        self._values = values

    def on_joint(self, frame: MovingFrame) -> list[Scalar]:
        """Return what acts along each direction that isn't frozen."""
        return self._values[frame.number].joint[: len(self.free_directions(frame))]

    def on_modes(self, frame: MovingFrame) -> Vector:
        """Return the forces on a body's modes."""
        return self._values[frame.number].modes


def trace_reaction(inputs: Coordinates, frames: list[MovingFrame], damped: bool) -> Reaction:
    """Trace accelerations, D and the tangents along T; ``da`` (n, 8) holds eight fast directions."""
    mechanism, graph = inputs.mechanism, inputs.graph
    resting = RestingCoordinates(graph, mechanism)
    still = trace_frames(resting)
    everything, slow = range(mechanism.n), range(mechanism.n_slow)

    def solve(values: list[BodyValues], free: range) -> list[BodyValues]:
        return trace_accelerations(still, TracedForces(resting, values, free))

    pulled = trace_tangents(inputs, trace_residual(inputs, frames), ("a",))
    D = solve(pulled, slow)
    along = []
    for number, reaction in enumerate(D):
        joint = zip(inputs.inputs_of_joint(number, "da"), reaction.joint, strict=True)
        modes = combine([(1.0, inputs.inputs_of_modes(number, "da")), (-1.0, reaction.modes)])
        along.append(BodyValues([unit - x for unit, x in joint], modes))
    found = {"a": trace_accelerations(frames, ActingForces(inputs, frames)), "D": D}
    forces = trace_residual(UnacceleratedCoordinates(graph, mechanism), frames)
    for name, positions in (("K", True), ("C", False)) if damped else (("K", True),):
        response = _differentiate_along(inputs, forces, along, positions)
        found |= {name: solve(response, everything), f"{name}y": solve(response, slow)}
    return found


def _differentiate_along(
    inputs: Coordinates, values: list[BodyValues], along: list[BodyValues], positions: bool
) -> list[BodyValues]:
    """Differentiate by positions, or by rates, that move as rates do along a direction."""
    seeds: dict[int, Scalar | Vector] = {}
    for number, direction in enumerate(along):
        joint = inputs.joint_positions(number) if positions else inputs.joint_rates(number)
        modes = inputs.modal_positions(number) if positions else inputs.modal_rates(number)
        seeds |= {x.node: dx for x, dx in zip(joint, direction.joint, strict=True)}
        if modes.size:
            seeds[modes.node] = direction.modes
    return unflatten(differentiate(inputs.graph, flatten(values), seeds), values)
