"""Constraints of a mechanism with loops, as parts of its graph: residuals with their derivatives, and forces.

Each scalar constraint g = 0 has a rate that is linear in the motions of the places that it constrains,

    ġ = Σ f · v + m · ω + Σ c ṡ

with v, ω of a place and of its section and s of a joint. By virtual power a multiplier λ acts on these places with the
force λ f and the moment λ m, and along the joint with λ c; the same coefficients take accelerations:

    g̈ = Σ f · a + m · α + Σ c s̈ + bias

The accelerations of the tree alone give g̈₀, unit multipliers on the tree at rest give the rows of ``X = M̂⁻¹ Jᵀ`` and
``S = J M̂⁻¹ Jᵀ``; with ``S λ = −g̈₀`` the mechanism accelerates by ``a + X λ`` (index 1).
"""

from dataclasses import field

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.mechanism import CLOSED_SHARE
from fmd.core.limits.round_off import SOLVED
from fmd.dynamics.closures import Closure, Coupler
from fmd.dynamics.compiler.algebra import Vector3, Vector6, add, constants, cross, dot, scale, subtract
from fmd.dynamics.compiler.bodies import Inertia
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.forces import PushedForces
from fmd.dynamics.compiler.frames import MovingFrame, trace_frames
from fmd.dynamics.compiler.graph import Graph, Scalar, Terms, total
from fmd.dynamics.compiler.joint_motion import joint_grip, section_angle
from fmd.dynamics.compiler.places import PlaceMotion, trace_place
from fmd.dynamics.compiler.recursion import BodyValues
from fmd.dynamics.mechanism import Mechanism


@dataclass
class ConstraintRow:
    """A scalar constraint; see this module's equations."""

    name: str
    residual: Scalar
    wrenches: list[tuple[PlaceMotion, Vector3, Vector3]]  # place, f and m of each
    bias: Scalar  # part of g̈ that velocities bring about beside the places' own
    rotational: bool  # true for an angle
    # c of each joint, by its body's number; s is that of the body's own section where it has one.
    joints: dict[int, float] = field(default_factory=dict)
    number: int = 0  # its own among the joint's
    frames: list[MovingFrame] = field(default_factory=list)  # the bodies', of a constraint on joints

    def rate(self, inputs: Coordinates) -> Scalar:
        """Return ġ."""
        zero = inputs.graph.number(0.0)
        terms = [zero]
        for place, f, m in self.wrenches:
            terms += [dot(f, place.v), dot(m, place.w)]
        for number, factor in self.joints.items():
            link = inputs.mechanism.links[number]
            ds = inputs.signal(link.motion, 2)[1] if link.motion is not None else inputs.joint_rates(number)[0]
            frame = self.frames[number]
            terms.append((ds + joint_grip(inputs.graph, frame).dot(frame.v)) * factor)
        return total(terms)

    def acceleration(self, inputs: Coordinates, ground: Vector6, motion: list[BodyValues]) -> Scalar:
        """Return g̈ without the bias for accelerations of the bodies."""
        terms = [inputs.graph.number(0.0)]
        for place, f, m in self.wrenches:
            a, alpha = ground[:3], ground[3:]
            if place.frame is not None:
                body = motion[place.frame.number]
                a, alpha = place.acceleration(body.x, body.modes)
            terms += [dot(f, a), dot(m, alpha)]
        for number, factor in self.joints.items():
            link = inputs.mechanism.links[number]
            dds = inputs.signal(link.motion, 2)[2] if link.motion is not None else motion[number].joint[0]
            of_section = joint_grip(inputs.graph, self.frames[number]).dot(motion[number].modes)
            terms.append((dds + of_section) * factor)
        return total(terms)


class MultiplierForces:
    """Forces of the constraints' multipliers alone, read from the argument ``f``: neither weight nor velocities act."""

    def __init__(self, inputs: Coordinates, rows: list[ConstraintRow]) -> None:
        self.graph = inputs.graph
        self.ground: Vector6 = constants(inputs.graph, [0.0] * 6)
        self._rows = [(inputs.graph.scalar_input("f", k), row) for k, row in enumerate(rows)]

    def on_body(self, frame: MovingFrame, inertia: Inertia) -> tuple[Vector6, Terms]:
        """Return p of a body, and the terms of −e; see `bodies`."""
        p: Vector6 = constants(self.graph, [0.0] * 6)
        terms: Terms = []
        for size, row in self._rows:
            for place, f, m in row.wrenches:
                if place.frame is not None and place.frame.number == frame.number:
                    force, on_modes = place.on_body(scale(size, f), scale(size, m))
                    p, terms = subtract(p, force), terms + on_modes
            if frame.number in row.joints:
                terms.append((size * row.joints[frame.number], joint_grip(self.graph, frame)))
        return p, terms or [(0.0, self.graph.zeros(len(frame.link.omega)))]

    def on_joint(self, frame: MovingFrame) -> list[Scalar]:
        """Return what couplers do along each of a joint's directions."""
        acting = [size * row.joints[frame.number] for size, row in self._rows if frame.number in row.joints]
        return [total([self.graph.number(0.0), *acting])] * len(frame.directions)

    def free_directions(self, frame: MovingFrame) -> list[Vector6]:
        """Return all directions of a joint."""
        return frame.directions

    def free_modes(self, frame: MovingFrame) -> Array:
        """Return 1 for each mode."""
        return np.ones(len(frame.link.omega))


class ConstrainedForces(PushedForces):
    """All that acts on a mechanism, contacts too, and forces of its constraints, whose multipliers are ``f``."""

    def __init__(self, inputs: Coordinates, frames: list[MovingFrame], rows: list[ConstraintRow]) -> None:
        super().__init__(inputs, frames)
        self._multipliers = MultiplierForces(inputs, rows)

    def on_body(self, frame: MovingFrame, inertia: Inertia) -> tuple[Vector6, Terms]:
        """Return p of a body, and the terms of −e; see `bodies`."""
        p, terms = super().on_body(frame, inertia)
        more, more_terms = self._multipliers.on_body(frame, inertia)
        return add(p, more), terms + more_terms

    def on_joint(self, frame: MovingFrame) -> list[Scalar]:
        """Return what acts along each of a joint's directions."""
        return add(super().on_joint(frame), self._multipliers.on_joint(frame))


class OpenConstraintError(ValueError):
    """A scalar constraint that can't hold in any state; has the joint's name and the constraint's number in it."""

    def __init__(self, row: ConstraintRow, residual: float) -> None:
        size = (
            f"{np.degrees(np.arcsin(np.clip(abs(residual), 0.0, 1.0))):.4g} degrees"
            if row.rotational
            else f"{abs(residual):.4g} m"
        )
        super().__init__(f"can't close its loop: a residual of {size} stays however the mechanism moves")
        self.joint, self.number = row.name, row.number


def trace_rows(inputs: Coordinates, frames: list[MovingFrame]) -> list[ConstraintRow]:
    """Trace a mechanism's scalar constraints; those that hold in every state are left out.

    Raises
    ------
    OpenConstraintError
        One can't hold in any state.
    """
    closable = _closable_distance(inputs.mechanism)
    return [row for row in trace_all_rows(inputs, frames) if not _holds_always(row, closable)]


def closed_distances(mechanism: Mechanism) -> dict[str, float]:
    """Distances that no motion of a mechanism closes and that are taken as closed, by the joint's name [m].

    Places that a mesh gives by averages are off by a share of its elements' size: a bore's centre lies some nanometres
    beside its mid-plane.
    """
    inputs = Coordinates(Graph(), mechanism)
    rows = trace_all_rows(inputs, trace_frames(inputs))
    apart = {row.name: 0.0 for row in rows}
    for row in rows:
        if row.residual.constant is not None and not row.rotational:
            apart[row.name] = float(np.hypot(apart[row.name], row.residual.constant))
    return {name: distance for name, distance in apart.items() if distance > SOLVED}


def trace_all_rows(inputs: Coordinates, frames: list[MovingFrame]) -> list[ConstraintRow]:
    """Trace a mechanism's scalar constraints, those that hold in every state among them."""
    rows: list[ConstraintRow] = []
    for constraint in inputs.mechanism.closures:
        if isinstance(constraint, Coupler):
            rows.append(_trace_coupler(inputs, frames, constraint))
        else:
            rows += _trace_closure(inputs, frames, constraint)
    return rows


def _closable_distance(mechanism: Mechanism) -> float:
    """Return the largest distance that counts as closed where nothing can close it [m]."""
    joined = [constraint for constraint in mechanism.closures if isinstance(constraint, Closure)]
    places = [place.marker.position for closure in joined for place in (closure.first, closure.second)]
    return max(SOLVED, CLOSED_SHARE * max((float(np.linalg.norm(x)) for x in places), default=0.0))


def _holds_always(row: ConstraintRow, closable: float) -> bool:
    residual = row.residual.constant
    if residual is None:
        return False
    if abs(residual) <= (SOLVED if row.rotational else closable):
        return True
    raise OpenConstraintError(row, residual)


def _trace_closure(inputs: Coordinates, frames: list[MovingFrame], closure: Closure) -> list[ConstraintRow]:
    graph = inputs.graph
    first, second = (trace_place(inputs, frames, place) for place in (closure.first, closure.second))
    zero, zero3 = graph.number(0.0), constants(graph, [0.0] * 3)
    apart = subtract(second.x, first.x)
    drifting = subtract(second.v, first.v)
    rows = []
    for k, direction in enumerate(closure.along):
        if len(closure.along) == 3:  # no motion is left in which the axes of space and of a section would differ
            d = constants(graph, np.eye(3)[k])
            rows.append(ConstraintRow(closure.name, dot(d, apart), _opposed(first, second, d, zero3), zero, False))
            continue
        d = first.turned(direction)
        turning = cross(first.w, d)
        bias = dot(turning, drifting) * 2.0 + dot(cross(first.w, turning), apart)
        rows.append(
            ConstraintRow(closure.name, dot(d, apart), _opposed(first, second, d, cross(d, apart)), bias, False)
        )
    for pairs in closure.square:
        turned = [(first.turned(one), second.turned(other)) for one, other in pairs]
        c = add(*(cross(a, b) for a, b in turned))
        changing = add(
            *(part for a, b in turned for part in (cross(cross(first.w, a), b), cross(a, cross(second.w, b))))
        )
        bias = dot(subtract(first.w, second.w), changing)
        residual, minus = total([dot(a, b) for a, b in turned]), scale(-1.0, c)
        rows.append(ConstraintRow(closure.name, residual, [(first, zero3, c), (second, zero3, minus)], bias, True))
    if closure.distance:
        d = scale(1.0 / closure.distance, apart)
        residual = (dot(apart, d) - closure.distance) * 0.5
        bias = dot(drifting, drifting) * (1.0 / closure.distance)
        rows.append(ConstraintRow(closure.name, residual, _opposed(first, second, d, zero3), bias, False))
    for number, row in enumerate(rows):
        row.number = number
    return [row for row in rows if row.number not in closure.left_out]


def _opposed(
    first: PlaceMotion, second: PlaceMotion, force: Vector3, moment: Vector3
) -> list[tuple[PlaceMotion, Vector3, Vector3]]:
    """Return a force on the second place, its opposite on the first, and a moment on the first."""
    zero3 = constants(force[0].graph, [0.0] * 3)
    return [(first, scale(-1.0, force), moment), (second, force, zero3)]


def _trace_coupler(inputs: Coordinates, frames: list[MovingFrame], coupler: Coupler) -> ConstraintRow:
    graph, mechanism = inputs.graph, inputs.mechanism
    residual, joints, bias = [graph.number(-coupler.offset)], dict[int, float](), [graph.number(0.0)]
    for name, factor in zip(coupler.joints, coupler.factors, strict=True):
        number = mechanism.number_of(name)
        link = mechanism.links[number]
        s = inputs.signal(link.motion, 2)[0] if link.motion is not None else inputs.joint_positions(number)[0]
        frame = frames[number]
        residual.append((s + section_angle(graph, frame)) * float(factor))
        if link.joint_displacement2.size and not joint_grip(graph, frame).is_zero:
            bias.append(frame.v.multiplied_by(link.joint_displacement2).dot(frame.v) * float(factor))
        joints[number] = joints.get(number, 0.0) + float(factor)
    turning = all(mechanism.links[number].unit == "rad" for number in joints)
    return ConstraintRow(coupler.name, total(residual), [], total(bias), turning, joints, frames=frames)


def trace_reactions(inputs: Coordinates, frames: list[MovingFrame], argument: str) -> list[list[Vector6]]:
    """Trace force and moment in space on the two places of each joint that closes a loop, for given multipliers."""
    zero = constants(inputs.graph, [0.0] * 6)
    found = {joint.name: [zero, zero] for joint in inputs.mechanism.closing_joints}
    for k, row in enumerate(trace_rows(inputs, frames)):
        size = inputs.graph.scalar_input(argument, k)
        for side, (_, f, m) in enumerate(row.wrenches):
            found[row.name][side] = add(found[row.name][side], scale(size, f + m))
    return list(found.values())


def scale_rows(mechanism: Mechanism, rows: list[ConstraintRow]) -> Array:
    """Return for each constraint how fast a unit multiplier would accelerate its residual on free rigid bodies.

    What a mechanism's ``S`` has on its diagonal is compared with it: a row of round-off alone is no constraint.
    """
    out = np.ones(len(rows))
    for k, row in enumerate(rows):
        numbers = [place.frame.number for place, _, _ in row.wrenches if place.frame is not None] + list(row.joints)
        masses, turns = [], []
        for number in numbers:
            integrals = mechanism.links[number].integrals
            masses.append(integrals.mass)
            turns.append(float(np.trace(integrals.inertia(np.eye(1, integrals.G.shape[-1])[0]))) / 3.0)
        inertia = turns if row.rotational else masses
        smallest = min((x for x in inertia if x > 0.0), default=0.0)
        out[k] = 1.0 / smallest if smallest else 1.0
    return out
