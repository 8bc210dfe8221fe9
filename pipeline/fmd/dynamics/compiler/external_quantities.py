"""Quantities that a mechanism's functions give to another program: of joints, markers and named elements."""

from typing import NamedTuple

from fmd.core.arrays import Array
from fmd.core.limits.code import TINY_SQUARE
from fmd.dynamics.closures import Place
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.graph import Scalar, total
from fmd.dynamics.compiler.joint_motion import joint_elongation
from fmd.dynamics.compiler.places import trace_place
from fmd.dynamics.compiler.residual import trace_joint_loads


class ElementStress(NamedTuple):
    """Stress of a named element by its body's modal coordinates."""

    body: int
    name: str
    modal: Array  # (6, n_modes): xx, yy, zz, yz, xz, xy [Pa] for unit modal coordinates


class ExternalQuantity(NamedTuple):
    """A quantity that the functions give: of a joint, a marker or an element."""

    body: int  # number of the body, or of the one that the joint carries
    place: str  # name of the marker or element, empty for a joint
    # ``position``, ``rate``, ``reaction_force``, ``reaction_moment``, ``velocity``, ``rotation``, ``angular_velocity``,
    # ``displacement``, ``stress`` or ``von_mises``.
    kind: str
    indices: tuple[int, ...]  # which of its numbers, from 1
    value: Scalar  # how it is computed


def joint_quantities(inputs: Coordinates, frames: list[MovingFrame]) -> list[ExternalQuantity]:
    """Trace positions and rates of the joints with one axis."""
    motions = [(frame.number, joint_elongation(inputs, frame)) for frame in frames if frame.link.unit]
    kinds = enumerate(("position", "rate"))
    return [ExternalQuantity(body, "", kind, (), motion[k]) for k, kind in kinds for body, motion in motions]


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
    indices = [(i, j) for i in range(1, 4) for j in range(1, 4)]
    for frame in frames:
        body = frame.number
        for name, at in frame.link.markers.items():
            place = trace_place(inputs, frames, Place(frame.link.name, at))
            assert place.marker is not None
            found += [*_vector(body, name, "position", place.x), *_vector(body, name, "velocity", place.v)]
            entries = zip(indices, (x for row in place.A for x in row), strict=True)
            found += [ExternalQuantity(body, name, "rotation", index, x) for index, x in entries]
            found += _vector(body, name, "angular_velocity", place.w)
            if len(frame.link.omega):
                moved = [x - float(x0) for x, x0 in zip(place.marker.arm, at.position, strict=True)]
                found += _vector(body, name, "displacement", moved)
    return found


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
