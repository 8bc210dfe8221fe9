"""Forces of loads and force elements on markers that points of contacts feel beside the modes."""

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.algebra import Vector6, add, constants, times, transpose
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.elements import trace_pair
from fmd.dynamics.compiler.forces import load_at_marker
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.graph import Scalar
from fmd.reduction.body import MarkerShapes


def trace_felt_forces(inputs: Coordinates, frames: list[MovingFrame]) -> list[Scalar]:
    """Trace force and moment of loads and force elements at the markers that points of each touching body feel.

    Each body has as many values, six a marker, in its axes, filled up with zeros.
    """
    mechanism, none, rows = inputs.mechanism, constants(inputs.graph, [0.0] * 3), list[list[Scalar]]()
    pairs = [(element, trace_pair(inputs, frames, element)) for element in mechanism.elements]
    for own in mechanism.contacts:
        frame = frames[mechanism.number_of(own.body)]
        at = {name: constants(inputs.graph, [0.0] * 6) for name in own.felt}
        for load in mechanism.loads:
            if load.body == own.body:
                _, acting = load_at_marker(inputs, frames, frame, load)
                _add_at_marker(at, frame, load.marker, none + acting if load.torque else acting + none)
        for element, actions in pairs:
            for end, action in zip(reversed(element.ends), actions, strict=True):
                if end.body == own.body:
                    into = transpose(frame.world[1])
                    _add_at_marker(at, frame, end.marker, times(into, action.force) + times(into, action.moment))
        rows.append([x for wrench in at.values() for x in wrench])
    most = max(map(len, rows))
    return [x for row in rows for x in row + constants(inputs.graph, [0.0] * (most - len(row)))]


def _add_at_marker(at: dict[str, Vector6], frame: MovingFrame, marker: MarkerShapes, wrench: Vector6) -> None:
    """Add a force and a moment to those at the named marker that has the same shapes."""
    for name, others in at.items():
        if all(map(np.array_equal, _parts(frame.link.markers[name]), _parts(marker))):
            at[name] = add(others, wrench)
            return


def _parts(marker: MarkerShapes) -> tuple[Array, Array, Array]:
    return marker.position, marker.translation, marker.rotation
