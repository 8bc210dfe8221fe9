"""Quantities that a mechanism's functions give to another program: of joints, markers and named elements."""

from __future__ import annotations

from typing import NamedTuple

from fmd.core.arrays import Array
from fmd.core.limits.code import TINY_SQUARE
from fmd.dynamics.compiler.algebra import Matrix, Vector3, add, product, times, transpose
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.forces import section_angle
from fmd.dynamics.compiler.frames import MovingFrame, trace_place_on_body
from fmd.dynamics.compiler.graph import Scalar, Vector, total
from fmd.dynamics.compiler.joint_loads import trace_joint_loads


class ElementStress(NamedTuple):
    """Stress of a named element by its body's modal coordinates."""

    body: int
    name: str
    modal: Array  # (6, n_modes): xx, yy, zz, yz, xz, xy [Pa] for unit modal coordinates


class ExternalQuantity(NamedTuple):
    """A quantity that the functions give: of a joint, a marker or an element.

    Attributes
    ----------
    body : int
        Number of the body, or of the one that the joint carries.
    place : str
        Name of the marker or element, empty for a joint.
    kind : str
        ``position``, ``rate``, ``reaction_force``, ``reaction_moment``, ``velocity``, ``rotation``,
        ``angular_velocity``, ``displacement``, ``stress`` or ``von_mises``.
    indices : tuple of int
        Which of its numbers, from 1.
    value : Scalar
        How it is computed.
    """

    body: int
    place: str
    kind: str
    indices: tuple[int, ...]
    value: Scalar


def _rates(inputs: Coordinates, values: list[Scalar]) -> list[Scalar]:
    """Return the time derivatives of values that depend on positions and on the values of signals."""
    graph, mechanism = inputs.graph, inputs.mechanism
    rates = _position_rates(inputs)
    shift = mechanism.n_positions - mechanism.n
    seeds: dict[int, Scalar | Vector] = {}
    for number, node in enumerate(list(graph.nodes)):
        if node.operation not in ("input", "vector input"):
            continue
        argument, places = node.data  # type: ignore[misc]
        if argument == "q" and node.operation == "input":
            seeds[number] = rates[places[0]]
        elif argument == "q":
            seeds[number] = graph.vector_input("v", [place - shift for place in places])
        elif argument == "inputs" and places[0] % 3 < 2:
            seeds[number] = graph.scalar_input("inputs", places[0] + 1)
    return [_scalar(slope) for slope in differentiate(graph, list(values), seeds)]


def _position_rates(inputs: Coordinates) -> dict[int, Scalar]:
    """Return how each position of a joint changes: as its rate, or as a quaternion with the rates of a rotation."""
    mechanism, rates = inputs.mechanism, dict[int, Scalar]()
    for body, link in enumerate(mechanism.links):
        first = int(mechanism.layout.position[body])
        q, v = inputs.joint_positions(body), inputs.joint_rates(body)
        scalars = link.n_scalars
        rates |= {first + k: v[k] for k in range(scalars)}
        if link.joint.turns_in_space:
            (x, y, z, w), (a, b, c) = q[scalars:], (rate * 0.5 for rate in v[scalars:])
            turns = (
                w * a + y * c - z * b,
                w * b - x * c + z * a,
                w * c + x * b - y * a,
                -(x * a) - y * b - z * c,
            )
            rates |= {first + scalars + k: turn for k, turn in enumerate(turns)}
    return rates


def joint_quantities(inputs: Coordinates, frames: list[MovingFrame]) -> list[ExternalQuantity]:
    """Trace positions and rates of the joints with one axis."""
    found = []
    for frame in frames:
        link = frame.link
        if not link.unit:
            continue
        (own,) = inputs.joint_positions(frame.number) if link.motion is None else inputs.signal(link.motion)
        found.append(ExternalQuantity(frame.number, "", "position", (), own + section_angle(inputs.graph, frame)))
    rates = _rates(inputs, [own.value for own in found])
    return [*found, *(own._replace(kind="rate", value=rate) for own, rate in zip(found, rates, strict=True))]


def reaction_quantities(inputs: Coordinates, frames: list[MovingFrame]) -> list[ExternalQuantity]:
    """Trace force and moment of each joint on its child, in space, about the joint's place on it."""
    found = []
    for number, (_, _, on_body) in enumerate(trace_joint_loads(inputs, frames)):
        found += _vector(number, "", "reaction_force", on_body[:3])
        found += _vector(number, "", "reaction_moment", on_body[3:])
    return found


def marker_quantities(inputs: Coordinates, frames: list[MovingFrame]) -> list[ExternalQuantity]:
    """Trace place, velocity, rotation, angular velocity and displacement of each marker."""
    found = []
    for frame in frames:
        origin, R = frame.world
        for name, at in frame.link.markers.items():
            marker = trace_place_on_body(inputs, frame, at)
            position = add(origin, times(R, marker.arm))
            turned = product(R, marker.R)
            found += _motion_of_marker(inputs, frame.number, name, position, turned)
            if len(frame.link.omega):
                moved = [x - float(x0) for x, x0 in zip(marker.arm, at.position, strict=True)]
                found += _vector(frame.number, name, "displacement", moved)
    return found


def _motion_of_marker(
    inputs: Coordinates, body: int, name: str, position: Vector3, rotation: Matrix
) -> list[ExternalQuantity]:
    entries = [x for row in rotation for x in row]
    rates = _rates(inputs, [*position, *entries])
    velocity, turning = rates[:3], [rates[3 + 3 * k : 6 + 3 * k] for k in range(3)]
    spin = product(turning, transpose(rotation))
    indices = [(i, j) for i in range(1, 4) for j in range(1, 4)]
    return [
        *_vector(body, name, "position", position),
        *_vector(body, name, "velocity", velocity),
        *(ExternalQuantity(body, name, "rotation", at, x) for at, x in zip(indices, entries, strict=True)),
        *_vector(body, name, "angular_velocity", [spin[2][1], spin[0][2], spin[1][0]]),
    ]


def stress_quantities(frames: list[MovingFrame], stresses: tuple[ElementStress, ...]) -> list[ExternalQuantity]:
    """Trace stress and von Mises stress of named elements."""
    found = []
    for own in stresses:
        q = frames[own.body].q
        parts = [q.dot(q.graph.array(row)) for row in own.modal]
        xx, yy, zz, yz, xz, xy = parts
        normal = total([(xx - yy) * (xx - yy), (yy - zz) * (yy - zz), (zz - xx) * (zz - xx)])
        shear = total([yz * yz, xz * xz, xy * xy])
        square = normal * 0.5 + shear * 3.0
        found += _vector(own.body, own.name, "stress", parts)
        found.append(ExternalQuantity(own.body, own.name, "von_mises", (), (square + TINY_SQUARE).apply("sqrt")))
    return found


def _vector(body: int, place: str, kind: str, values: list[Scalar]) -> list[ExternalQuantity]:
    return [ExternalQuantity(body, place, kind, (k + 1,), value) for k, value in enumerate(values)]


def _scalar(value: Scalar | Vector) -> Scalar:
    assert isinstance(value, Scalar)
    return value
