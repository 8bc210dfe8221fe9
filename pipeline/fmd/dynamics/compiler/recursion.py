"""Accelerations of a mechanism by articulated bodies whose modes are eliminated body by body.

Featherstone's algorithm (Rigid Body Dynamics Algorithms, Springer, 2008, chapter 7) walks outwards for velocities,
inwards for articulated inertias ``IA`` and bias forces ``pA``, and outwards for accelerations. A flexible body brings
its modes' equations along (see `bodies`); with c its children, all seen at their markers,

    (1 + Σ T_cᵀ IA_c T_c) η + (Wᵀ + Σ T_cᵀ IA_c B_c) x + e + Σ T_cᵀ pA_c = 0

The modal mass of a body that carries none is the identity, and the others' differs from it by low rank: the rows of all
T_c lie in the span of a few orthogonal rows Q (``T_c = L_c Q``, Q Qᵀ = P diagonal): those of the markers' shapes and
rotations, constant but for what displacements of second order add to them (see `span`).
Across that span the modes are eliminated as if the body carried none. Along it, ``η = … + Qᵀ P⁻¹ ζ`` with the small
system

    F ζ = −(Y x + f)    F = P⁻¹ + Σ L_cᵀ IA_c L_c    Y = P⁻¹ Q W + Σ L_cᵀ IA_c B_c    f = P⁻¹ Q e + Σ L_cᵀ pA_c

so that n modes cost of the order of n, and a cube only of Q's few rows. The modal mass of displacements of second order
has rows in this span too, and is a part of F as what a child carries.
"""

from dataclasses import field

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiler.algebra import (
    Matrix,
    SymmetricFactor,
    Vector6,
    add,
    add_matrices,
    congruence,
    diagonal,
    dot,
    factor_symmetric,
    multiply,
    product,
    rotate,
    rotate_inertia,
    scale,
    shift_matrix,
    subtract,
    subtract_matrices,
    symmetric_product,
    times,
    transpose,
)
from fmd.dynamics.compiler.bodies import AddedMass, trace_inertia
from fmd.dynamics.compiler.forces import Forces
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.graph import Scalar, Vector, combine
from fmd.dynamics.compiler.span import ModalRows, Span, rows_of_marker, span_rows


@dataclass
class Carried:
    """An articulated body as its parent feels it at the marker, in the parent's axes."""

    IA: Matrix  # its inertia there
    pA: Vector6  # force for a marker that doesn't accelerate


@dataclass
class CarrierModes:
    """A carrier's modes along the span Q of its markers; see this module's equations."""

    span: Span
    PQW: Matrix  # ``P⁻¹ Q`` times the coupling of frame and modes
    PQe: list[Scalar]  # ``P⁻¹ Q`` times the modes' bias
    F: SymmetricFactor
    Y: Matrix  # ``L⁻¹ Y`` with the factor L of F
    f: list[Scalar]  # ``L⁻¹ f``
    T: dict[int, Matrix]  # each child's T by the rows of Q, ``T_c = T Q``, by its number


@dataclass
class ArticulatedBody:
    """A body with all that it carries."""

    frame: MovingFrame
    free: Array  # (n,): 1 for each mode that isn't frozen
    W: list[Vector]  # coupling of frame and free modes
    e: Vector  # bias of the free modes
    IA: Matrix  # articulated inertia at the body's origin
    pA: Vector6  # bias force at the body's origin
    directions: list[Vector6]  # columns of S, none if the joint is frozen
    modes: CarrierModes | None = None  # of a flexible body that carries others
    U: list[Vector6] = field(default_factory=list)  # ``IA S`` column by column
    D: SymmetricFactor | None = None  # factors of ``Sᵀ IA S``; of IA itself for a free joint
    u: list[Scalar] = field(default_factory=list)  # the joint's load less ``Sᵀ pA``; the load itself for a free joint
    carried: Carried | None = None  # what its parent feels
    x: Vector6 = field(default_factory=list)  # acceleration of its frame, which the walk outwards fills
    zeta: list[Scalar] = field(default_factory=list)  # accelerations of its modes along Q, likewise

    def __post_init__(self) -> None:
        self.eta = self.e.graph.zeros(0)


@dataclass
class BodyValues:
    """A body's share of what has the order of rates: entries of its joint and of its modes; and what its frame has."""

    joint: list[Scalar]
    modes: Vector
    x: Vector6 = field(default_factory=list)


def trace_accelerations(frames: list[MovingFrame], forces: Forces) -> list[BodyValues]:
    """Trace the accelerations of a mechanism's joints and modes, body by body; frozen ones are 0."""
    bodies: dict[int, ArticulatedBody] = {}
    for frame in reversed(frames):
        forces.graph.mark()
        children = [bodies[child.number] for child in frame.children]
        bodies[frame.number] = _articulate(forces, frame, children)
    values = []
    for frame in frames:
        forces.graph.mark()
        values.append(_accelerate(forces, bodies[frame.number], bodies))
    return values


def _articulate(forces: Forces, frame: MovingFrame, children: list[ArticulatedBody]) -> ArticulatedBody:
    """Gather a body and what it carries; the walk inwards."""
    inertia = trace_inertia(forces.graph, frame)
    p, terms = forces.on_body(frame, inertia)
    free = forces.free_modes(frame)
    e = combine([(-1.0 * factor, vector) for factor, vector in terms])
    W = [row.multiplied_by(np.diag(free)) for row in inertia.W]
    body = ArticulatedBody(frame, free, W, e, inertia.M, p, forces.free_directions(frame))
    carried = {child.frame.number: child.carried for child in children if child.carried is not None}
    frozen = [child for child in frame.children if child.number in carried]
    for child in frozen:
        across = transpose(child.B)
        body.IA = add_matrices(body.IA, congruence(across, carried[child.number].IA))
        body.pA = add(body.pA, times(across, carried[child.number].pA))
    if free.any():
        _eliminate_modes(body, frozen, carried, inertia.more)
    _eliminate_joint(body, forces.on_joint(frame))
    return body


def _eliminate_modes(
    body: ArticulatedBody, frozen: list[MovingFrame], carried: dict[int, Carried], more: AddedMass | None
) -> None:
    """Eliminate a body's modes: across the span of its markers as a leaf's, along it by the small system."""
    groups = [rows_of_marker(child.marker) for child in frozen]
    groups += [] if more is None else [ModalRows(*more.shapes, more.rows)]
    span = span_rows(body.e.graph, groups, body.free)
    Q, inverses, n_free = span.Q, span.inverse_squares, np.count_nonzero(body.free)
    if len(Q) < n_free:
        body.IA = subtract_matrices(body.IA, [[a.dot(b) for b in body.W] for a in body.W])
        body.pA = subtract(body.pA, [row.dot(body.e) for row in body.W])
    if not Q:
        return
    QW, Qe = [[row.dot(w) for w in body.W] for row in Q], [row.dot(body.e) for row in Q]
    PQW, PQe = [scale(p, row) for p, row in zip(inverses, QW, strict=True)], multiply(inverses, Qe)
    if len(Q) < n_free:  # give back what a leaf's elimination took along Q
        columns = transpose(QW)
        body.IA = add_matrices(body.IA, symmetric_product(transpose(PQW), columns))
        body.pA = add(body.pA, times(columns, PQe))
    F, Y, f, T = diagonal(inverses), PQW, PQe, dict[int, Matrix]()
    if more is not None:
        F = add_matrices(F, congruence(transpose(span.L[-1]), more.C))
    for child, by_rows in zip(frozen, span.L, strict=False):
        T[child.number] = by_rows[:3] + product(child.marker.A, by_rows[3:])
        across = transpose(T[child.number])
        pushed = product(across, carried[child.number].IA)
        F = add_matrices(F, symmetric_product(pushed, across))
        Y = add_matrices(Y, product(pushed, child.B))
        f = add(f, times(across, carried[child.number].pA))
    factor = factor_symmetric(F)
    Y_columns = [factor.forward(column) for column in transpose(Y)]
    f = factor.forward(f)
    divided = [factor.divide(column) for column in Y_columns]
    body.IA = subtract_matrices(body.IA, symmetric_product(divided, Y_columns))
    body.pA = subtract(body.pA, times(divided, f))
    body.modes = CarrierModes(span, PQW, PQe, factor, transpose(Y_columns), f, T)


def _eliminate_joint(body: ArticulatedBody, load: list[Scalar]) -> None:
    """Eliminate a joint's accelerations, and carry the rest to the marker on the parent."""
    frame, IA, pA = body.frame, body.IA, body.pA
    if len(body.directions) == len(pA):  # a free joint carries no more than what acts along it
        body.D = factor_symmetric(IA)
        body.u = load
        if all(x.is_zero for x in load):
            return
        zero = load[0].graph.number(0.0)
        IA, pA = [[zero] * 6 for _ in pA], times(transpose(body.directions), load)
    elif body.directions:
        body.U = [times(IA, direction) for direction in body.directions]
        body.D = factor_symmetric([[dot(a, b) for b in body.directions] for a in body.U])
        body.u = [tau - dot(direction, pA) for tau, direction in zip(load, body.directions, strict=True)]
    if frame.parent is None:
        return
    if body.U and body.D is not None:
        reduced = [body.D.forward(row) for row in transpose(body.U)]
        divided = [body.D.divide(row) for row in reduced]
        IA = subtract_matrices(IA, symmetric_product(divided, reduced))
        pA = add(pA, times(divided, body.D.forward(body.u)))
    pA = add(pA, times(IA, frame.gamma))
    if any(not x.is_zero for x in frame.shift):
        B = shift_matrix(frame.shift)
        IA, pA = congruence(transpose(B), IA), times(transpose(B), pA)
    IA = rotate_inertia(frame.R, IA)
    body.carried = Carried(IA, add(rotate(frame.R, pA), times(IA, frame.beta)))


def _accelerate(forces: Forces, body: ArticulatedBody, bodies: dict[int, ArticulatedBody]) -> BodyValues:
    """Accelerate a body's joint, frame and modes; the walk outwards."""
    frame, zero = body.frame, forces.graph.number(0.0)
    if frame.parent is None:
        x = frame.carry(forces.ground)
    else:
        parent = bodies[frame.parent.number]
        x = frame.carry(parent.x, _marker_motion(parent, body))
    joint = [zero] * len(frame.directions)
    body.x = x
    if body.U and body.D is not None:
        joint = body.D.solve(subtract(body.u, [dot(column, x) for column in body.U]))
        body.x = add(x, frame.move(joint))
    elif body.D is not None:
        body.x = body.D.solve(subtract(times(transpose(body.directions), body.u), body.pA))
        joint = [dot(direction, subtract(body.x, x)) for direction in body.directions]
    body.eta = forces.graph.zeros(len(frame.link.omega))
    if body.free.any():
        body.eta = _accelerate_modes(body)
    return BodyValues(joint, body.eta, body.x)


def _marker_motion(parent: ArticulatedBody, child: ArticulatedBody) -> Vector6 | None:
    """Acceleration of a child's marker by its carrier's modes, ``T η``; ``Q η`` is ζ."""
    frame = child.frame
    if not parent.free.any():
        return None
    if parent.modes is not None and frame.number in parent.modes.T:
        return times(parent.modes.T[frame.number], parent.zeta)
    return frame.marker_motion(parent.eta)


def _accelerate_modes(body: ArticulatedBody) -> Vector:
    """Accelerations of a body's modes for those of its frame."""
    x, modes = body.x, body.modes
    terms: list[tuple[Scalar | float, Vector]] = [(-1.0, body.e)]
    terms += [(-a, w) for a, w in zip(x, body.W, strict=True)]
    if modes is not None:
        body.zeta = scale(-1.0, modes.F.backward(modes.F.divide(add(modes.f, times(modes.Y, x)))))
        Q = modes.span.Q
        if len(Q) == np.count_nonzero(body.free):
            return combine(list(zip(body.zeta, Q, strict=True)))
        along = add(multiply(modes.span.inverse_squares, body.zeta), modes.PQe, times(modes.PQW, x))
        terms += zip(along, Q, strict=True)
    return combine(terms)
