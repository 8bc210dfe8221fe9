"""Inertia and forces of one body: the part of a mechanism's equations that knows nothing of its neighbours.

For accelerations x = (a, α) of a body's frame and η of its modes, with unit modal masses, the body's equations are

    M x + W η + p = forces on the frame        Wᵀ x + η + e = forces on the modes

M is the rigid inertia of the deformed shape, W couples frame and modes, p and e are what velocities, springs and loads
bring about. With the inertia forms I_ab and A_a, and p = (1, q):

    J_ab = pᵀ I_ab p        y_ab = I_ab p        N_ab = q̇ · y_ab        z_a = A_a p        h_a = z_a · q̇
    moments   ω × J ω + 2 N ω − ω × h        modes   −Σ ω_a ω_b y_ab − 2 Σ ω_a A_a q̇

Displacements of second order add ``½ qᵀ displacement2_a q`` to the first moments and ``qᵀ rotation2_a q̇`` to the
angular momentum. So S_a has displacement2_a q beside it, z_a has −rotation2_a q, and ``q̇ᵀ displacement2_a q̇`` and
``q̇ᵀ rotation2_a q̇`` act on the frame. The modal mass is then no longer the identity: see
`fmd.reduction.second_order`. Where their whole energy counts, they are further modal coordinates s that follow
from q, ``ṡ = f q̇``: all of the above holds for (q, s), and its terms of s act on the modes by fᵀ (see
`fmd.reduction.second_order`).
"""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.round_off import SUMMED
from fmd.dynamics.compiler.algebra import (
    Matrix,
    Vector3,
    Vector6,
    add,
    constants,
    cross,
    dot,
    identity,
    scale,
    spatial,
    subtract,
    tilde,
    times,
    transpose,
)
from fmd.dynamics.compiler.cleaning import WholeForms
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.graph import Graph, Scalar, Terms, Vector, combine
from fmd.reduction.second_order import SecondOrderMass

AXES = range(3)


@dataclass(frozen=True)
class AddedMass:
    """Modal mass of a body's displacements of second order: ``Rᵀ C R`` of low rank, with the rows R = (g, F q)."""

    g: Array  # (k, n): as in `SecondOrderMass`, without round-off
    F: Array  # (k, n, n): as in `SecondOrderMass`, without round-off
    rows: list[Vector]  # R: those of g, then those of f
    C: Matrix

    @property
    def shapes(self) -> tuple[Array, Array]:
        """Constant part of R (2 k, n), and the forms by which it changes with the modal coordinates (2 k, n, n)."""
        none = np.zeros_like(self.F)
        return np.concatenate([self.g, np.zeros_like(self.g)]), np.concatenate([none, self.F])

    def times(self, eta: Vector) -> Terms:
        """Return the terms of this mass times modal accelerations."""
        return list(zip(times(self.C, [row.dot(eta) for row in self.rows]), self.rows, strict=True))

    def velocity_forces(self, v: Vector) -> Terms:
        """Return the terms of the forces on the modes that modal rates bring about."""
        zero, k = v.graph.number(0.0), len(self.F)
        changes = [zero] * k + [v.multiplied_by(form).dot(v) for form in self.F]
        return [(-1.0 * factor, row) for factor, row in zip(times(self.C, changes), self.rows, strict=True)]

    def twice_energy(self, v: Vector) -> Scalar:
        """Return twice the kinetic energy of this mass."""
        momenta = [row.dot(v) for row in self.rows]
        pairs = zip(momenta, times(self.C, momenta), strict=True)
        return sum((a * b for a, b in pairs), v.graph.number(0.0))


def trace_added_mass(graph: Graph, mass: SecondOrderMass | None, q: Vector) -> AddedMass | None:
    """Trace a body's added mass for its modal coordinates; ``None`` if there is none."""
    if mass is None:
        return None
    k, scale = len(mass.F), np.sqrt(np.abs(mass.N.diagonal()))
    N = np.where(np.abs(mass.N) <= SUMMED * np.outer(scale, scale), 0.0, mass.N)
    g = np.where(np.abs(mass.g) <= SUMMED * scale[:, None], 0.0, mass.g)  # modal masses are 1
    C = np.block([[np.zeros((k, k)), np.eye(k)], [np.eye(k), N]])
    rows = [graph.array(row) for row in g] + [q.multiplied_by(form) for form in mass.F]
    return AddedMass(g, mass.F, rows, [constants(graph, row) for row in C])


@dataclass
class Inertia:
    """A body's inertia at its state, in its own axes."""

    mass: Scalar  # [kg]
    c: Vector3  # first moment about the origin
    c_rate: Vector3  # its rate
    J: Matrix  # inertia tensor
    N: Matrix  # half its rate's symmetric part: ``N_ab = q̇ · I_ab p``
    h: Vector3  # angular momentum of the deforming alone
    y: list[list[Vector]]  # modal parts of ``I_ab p``
    S: list[Vector]  # first moments of the modes
    z: list[Vector]  # modal parts of ``A_a p``
    z_rate: list[Vector]  # modal parts of ``A_a q̇``
    bending: Vector6  # force and moment that displacements of second order take at constant modal rates
    more: AddedMass | None  # what displacements of second order add to the modal mass

    @property
    def M(self) -> Matrix:
        """Inertia of the frame, 6 × 6."""
        graph = self.c[0].graph
        mass = [[x * self.mass for x in row] for row in identity(graph, 3)]
        return spatial(mass, transpose(tilde(self.c)), self.J)

    @property
    def W(self) -> list[Vector]:
        """Coupling of the frame's six accelerations with the modes."""
        return self.S + [-z for z in self.z]


def trace_inertia(graph: Graph, frame: MovingFrame) -> Inertia:
    """Trace a body's inertia for its modal coordinates and rates."""
    forms, q, v = frame.forms, frame.q, frame.v
    if isinstance(forms, WholeForms):
        return _trace_whole(graph, frame, forms)
    S, c, z, z_rate = list[Vector](), list[Scalar](), list[Vector](), list[Vector]()
    for a in AXES:
        row = graph.array(forms.S[a, 1:])
        bent = row + q.multiplied_by(forms.displacement2[a]) if forms.displacement2.size else row
        S.append(bent)
        c.append(combine([(0.5, row), (0.5, bent)]).dot(q) + frame.rigid.S[a])
        antisymmetric = forms.A_a[a, 1:, 1:] - forms.rotation2[a] if forms.rotation2.size else forms.A_a[a, 1:, 1:]
        z.append(graph.array(forms.A_a[a, 1:, 0]) + q.multiplied_by(antisymmetric))
        z_rate.append(v.multiplied_by(forms.A_a[a, 1:, 1:]))
    y: list[list[Vector]] = [[], [], []]
    J: Matrix = [[], [], []]
    N: Matrix = [[], [], []]
    for a in AXES:
        for b in range(a + 1):
            form = forms.I_ab[a, b]
            linear = graph.array(form[1:, 0])
            both = linear + q.multiplied_by(form[1:, 1:])
            y[a].append(both)
            J[a].append((linear + both).dot(q) + frame.rigid.J[a][b])
            N[a].append(both.dot(v))
    rates = [row.dot(v) for row in S]
    bending = [_square(graph, form, v) for forms_of in (forms.displacement2, forms.rotation2) for form in forms_of]
    more = trace_added_mass(graph, forms.second_order, q)
    return Inertia(
        frame.rigid.mass, c, rates, _full(J), _full(N), [row.dot(v) for row in z], y, S, z, z_rate, bending, more
    )


def _trace_whole(graph: Graph, frame: MovingFrame, forms: WholeForms) -> Inertia:
    """Trace the inertia of a body whose displacements of second order have coordinates s beside its modes."""
    q, v, n = frame.q, frame.v, frame.q.size
    slopes = [q.multiplied_by(form) for form in forms.F]
    s, ds = [0.5 * row.dot(q) for row in slopes], [row.dot(v) for row in slopes]
    bend = [v.multiplied_by(form).dot(v) for form in forms.F]  # of s̈, at constant modal rates

    def on_modes(own: Vector, of_fields: list[Scalar]) -> Vector:
        """Entries of the modes, with what the fields' entries bring along them."""
        return combine([(1.0, own), *zip(of_fields, slopes, strict=True)])

    S, z, z_rate = list[Vector](), list[Vector](), list[Vector]()
    c, bending, turning = list[Scalar](), list[Scalar](), list[Scalar]()
    for a in AXES:
        linear, of_fields = graph.array(forms.S[a, 1 : 1 + n]), constants(graph, forms.S[a, 1 + n :])
        S.append(on_modes(linear, of_fields))
        c.append(combine([(0.5, linear), (0.5, S[a])]).dot(q) + frame.rigid.S[a])
        bending.append(dot(of_fields, bend))
        own, of_fields = _multiply(forms.A_a[a], 1.0, q, s)
        z.append(on_modes(own, of_fields))
        turning.append(-dot(of_fields, bend))
        z_rate.append(on_modes(*_multiply(forms.A_a[a], 0.0, v, ds)))
    y: list[list[Vector]] = [[], [], []]
    J: Matrix = [[], [], []]
    N: Matrix = [[], [], []]
    for a in AXES:
        for b in range(a + 1):
            form = forms.I_ab[a, b]
            own, of_fields = _multiply(form, 1.0, q, s)
            along = (graph.array(form[1 : 1 + n, 0]) + own).dot(q) + dot(constants(graph, form[1 + n :, 0]), s)
            y[a].append(on_modes(own, of_fields))
            J[a].append(along + dot(of_fields, s) + frame.rigid.J[a][b])
            N[a].append(y[a][-1].dot(v))
    rates, h = [row.dot(v) for row in S], [row.dot(v) for row in z]
    more = trace_added_mass(graph, forms.second_order, q)
    return Inertia(frame.rigid.mass, c, rates, _full(J), _full(N), h, y, S, z, z_rate, bending + turning, more)


def _multiply(form: Array, first: float, x: Vector, s: list[Scalar]) -> tuple[Vector, list[Scalar]]:
    """Return a form of (1, modes, fields) times (first, x, s): its entries of the modes, and those of the fields."""
    graph, n = x.graph, x.size
    constant, by_modes, by_fields = form[1:, 0], form[1:, 1 : 1 + n], form[1:, 1 + n :]
    terms: Terms = [(first, graph.array(constant[:n])), (1.0, x.multiplied_by(by_modes[:n]))]
    own = combine([*terms, *((at, graph.array(by_fields[:n, k])) for k, at in enumerate(s))])
    of_fields = [
        graph.number(first * constant[row])
        + graph.array(by_modes[row]).dot(x)
        + dot(s, constants(graph, by_fields[row]))
        for row in range(n, n + len(s))
    ]
    return own, of_fields


def _square(graph: Graph, form: Array, v: Vector) -> Scalar:
    """Return ``vᵀ form v``, 0 for an empty form."""
    return v.multiplied_by(form).dot(v) if form.size else graph.number(0.0)


def _full(lower: Matrix) -> Matrix:
    return [[lower[max(a, b)][min(a, b)] for b in AXES] for a in AXES]


def velocity_forces(inertia: Inertia, w: Vector3, v: Vector) -> tuple[Vector6, Terms]:
    """Return p of a body that spins at ω and deforms at v, and the terms of −e, without loads and springs."""
    swept = add(cross(w, inertia.c), scale(2.0, inertia.c_rate))
    moment = add(cross(w, times(inertia.J, w)), scale(2.0, times(inertia.N, w)))
    p = add(cross(w, swept) + subtract(moment, cross(w, inertia.h)), inertia.bending)
    terms: Terms = [] if inertia.more is None else inertia.more.velocity_forces(v)
    for a in AXES:
        terms += [(w[a] * w[a], inertia.y[a][a]), (w[a] * 2.0, inertia.z_rate[a])]
        terms += [(w[a] * w[b] * 2.0, inertia.y[a][b]) for b in range(a)]
    return p, terms
