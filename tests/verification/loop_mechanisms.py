"""Published mechanisms with loops, built from links and closures by hand: no mesh, no scene."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from fmd.core.arrays import Array
from fmd.core.formula import parse_formula
from fmd.dynamics.closures import Place, close_joint, fixed_place
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.elements import Attachment, PointSpring
from fmd.dynamics.force_laws import ForceCurve, ForceLaw
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import Signal, constant, formula
from fmd.reduction.body import MarkerShapes
from fmd.reduction.inertia import InertiaIntegrals
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE

X, Y, Z = np.eye(3)


class Case(NamedTuple):
    """A mechanism's system with positions and rates at the start, and shapes whose multiples its modes are, if any."""

    system: CompiledSystem
    q: Array
    v: Array
    shapes: Array = np.zeros((0, 0))

    def energy(self, t: float, q: Array, v: Array) -> float:
        """Return the kinetic and potential energy [J]."""
        return sum(self.system.compiled.energies(t, q, v))


def place_on(body: str, position: Array) -> Place:
    """Return a place on a rigid body."""
    nothing = np.zeros((3, 0))
    return Place(body, MarkerShapes(np.asarray(position, dtype=float), nothing, nothing))


def rod(name: str, parent: int, place: Array, axis: Array, along: Array) -> Link:
    """Return a thin rod of 1 kg from its hinge along a vector."""
    length = float(np.linalg.norm(along))
    inertia = length**2 / 12 * (np.eye(3) - np.outer(along, along) / length**2)
    return Link(name, rigid_integrals(1.0, 0.5 * along, inertia), REVOLUTE, parent, MarkerShapes(place), axis)


def double_four_bar() -> Case:
    """Three cranks and two couplers of 1 m and 1 kg, upright, falling at 1 m/s (IFToMM benchmark A02).

    Whenever all bars are in one line, three more ways are open to it.
    """
    links = [
        rod("crank0", -1, 0 * X, Z, X),
        rod("coupler0", 0, X, Z, X),
        rod("coupler1", 1, X, Z, X),
        rod("crank1", -1, X, Z, X),
        rod("crank2", -1, 2 * X, Z, X),
    ]
    closures = [
        close_joint(REVOLUTE, f"end{k}", place_on(f"coupler{k}", X), place_on(f"crank{k + 1}", X), Z) for k in range(2)
    ]
    mechanism = Mechanism(links, gravity=-9.81 * Y, closures=closures)
    up = np.pi / 2
    return Case(CompiledSystem(mechanism), np.array([up, -up, 0.0, up, up]), np.array([-1.0, 1.0, 0.0, -1.0, -1.0]))


def bricard() -> Case:
    """Bricard's six hinges between five rods of 1 m and 1 kg: a redundant loop that moves (IFToMM benchmark A04)."""
    rods = [(Y, X), (Z, -Y), (X, Z), (Y, -X), (Z, Y)]
    links, place = [], 0 * X
    for k, (axis, along) in enumerate(rods):
        links.append(rod(f"rod{k}", k - 1, place, axis, along))
        place = along
    closure = close_joint(REVOLUTE, "end", place_on("rod4", Y), fixed_place(Z), X)
    mechanism = Mechanism(links, gravity=-9.81 * Y, closures=[closure])
    return Case(CompiledSystem(mechanism), np.zeros(5), np.zeros(5))


SQUEEZER_START = (
    -0.0617138900142764496358948458001,
    0.0,
    0.455279819163070380255912382449,
    0.222668390165885884674473185609,
    0.487364979543842550225598953530,
    -0.222668390165885884674473185609,
    1.23054744454982119249735015568,
)


def andrews_squeezer() -> Case:
    """Andrews' squeezing mechanism: seven bodies in the plane, three loops, a motor of 0.033 N m and a spring.

    Numbers are those of Mazzia & Magherini, Test Set for Initial Value Problem Solvers 2.4 (2008), in its order of
    coordinates: the angles β, Θ, γ, Φ, δ, Ω and ε.
    """
    A, B, C = np.array([[-0.06934, -0.00227, 0.0], [-0.03635, 0.03273, 0.0], [0.014, 0.072, 0.0]])
    d, e, rr, ss, u, zf, zt = 0.028, 0.02, 0.007, 0.035, 0.04, 0.02, 0.04
    bodies = [  # parent, place, mass, centre of mass, moment of inertia about it
        ("K1", -1, 0 * X, 0.04325, [0.00092, 0.0], 2.194e-6),
        ("K2", 0, rr * X, 0.00365, [-0.0115, 0.0], 4.410e-7),
        ("K3", -1, B, 0.02373, [0.01043, -0.01874], 5.255e-6),
        ("K5", -1, A, 0.07050, [0.02308, 0.00916], 1.169e-5),
        ("K4", 3, zt * X, 0.00706, [0.0, 0.01421 - e], 5.667e-7),
        ("K7", -1, A, 0.05498, [0.00449, -0.01228], 1.912e-5),
        ("K6", 5, -u * Y, 0.00706, [zf - 0.01421, 0.0], 5.667e-7),
    ]
    links = [
        Link(
            name,
            rigid_integrals(mass, np.array([*centre, 0.0]), np.diag([0.0, 0.0, moment])),
            REVOLUTE,
            parent,
            MarkerShapes(place),
            load=constant(0.033 if name == "K1" else 0.0),
        )
        for name, parent, place, mass, centre, moment in bodies
    ]
    ends = [("K3", -ss * Y), ("K4", -e * Y), ("K6", zf * X)]
    closures = [close_joint(REVOLUTE, body, place_on("K2", -d * X), place_on(body, at), Z) for body, at in ends]
    hook, wall = (
        Attachment(body, place_on(body, at).marker) for body, at in (("K3", np.array([0.02, -0.018, 0.0])), ("", C))
    )
    spring = PointSpring("spring", (wall, hook), ForceLaw(ForceCurve((0.0, 4530.0))), 0.07785)
    system = CompiledSystem(Mechanism(links, closures=closures, elements=[spring]))
    return Case(system, np.array(SQUEEZER_START)[[0, 1, 2, 4, 3, 6, 5]], np.zeros(7))


def flexible_slider_crank() -> Case:
    """The IVP test set's slider-crank, whose rod has two bending and two axial shapes, crank at 150 rad/s.

    Shapes across the rod are sin πξ and sin 2πξ, along it those of a quadratic rod element at its middle and its end.
    Numbers and start are those of ``crank.f`` (Simeon, Mathematical Modelling of Systems 2, 1996; Mazzia & Magherini,
    Test Set for Initial Value Problem Solvers 2.4, 2008), its value of π and its modal masses 8, 1 and 2, which want a
    fifteenth, too.
    """
    pi, length, side, E, rho = 3.1415927, 0.30, 0.008, 0.2e12, 7870.0
    area = side * side
    mass, volume, spring = rho * area * length, area * length, E * area / length
    M, K = np.diag([0.5, 0.5, 8.0, 2.0]) * mass, np.zeros((4, 4))
    M[2, 3] = M[3, 2] = mass
    K[0, 0], K[1, 1] = pi**4 / 24 * (side / length) ** 2, pi**4 * 2 / 3 * (side / length) ** 2
    K[2:, 2:] = [[16 / 3, -8 / 3], [-8 / 3, 7 / 3]]
    G = np.zeros((3, 3, 5, 5))  # of shapes along x (2, 3) and y (0, 1), as `InertiaIntegrals` has them
    G[0, 0, 0, 0], G[0, 0, 0, 3:] = 0.0045339259, rho * length * volume * np.array([1 / 3, 1 / 6])
    G[0, 0, 3:, 0] = G[0, 0, 0, 3:]
    G[0, 0, 3:, 3:], G[1, 1, 1:3, 1:3] = M[2:, 2:], M[:2, :2]
    G[0, 1, 0, 1:3] = rho * length * volume * np.array([1 / pi, -0.5 / pi])
    G[0, 1, 3:, 1:3] = rho * volume * np.array([[16 / pi**3, 0.0], [1 / pi - 8 / pi**3, -0.5 / pi]])
    G[1, 0] = G[0, 1].T
    S = np.zeros((3, 5))
    S[0], S[1, 1] = [0.5 * mass * length, 0.0, 0.0, rho * volume * 2 / 3, rho * volume / 6], rho * volume * 2 / pi
    omega2, turn = eigh(spring * K, M)
    whole = np.eye(5)
    whole[1:, 1:] = turn
    integrals = InertiaIntegrals(np.einsum("ik,abij,jl->abkl", whole, G, whole), S @ whole, mass)
    end = MarkerShapes(length * X, np.outer(X, turn[3]), np.zeros((3, 4)))
    links = [
        Link("crank", rigid_integrals(0.36, 0 * X, np.diag([0.0, 0.0, 0.002727])), REVOLUTE, motion=_steady(150.0)),
        Link("rod", integrals, REVOLUTE, 0, MarkerShapes(0.15 * X), omega=np.sqrt(omega2), damping=np.zeros(4)),
        Link("slider", rigid_integrals(0.075552, 0 * X, np.zeros((3, 3))), PRISMATIC, axis=X),
    ]
    closure = close_joint(REVOLUTE, "pin", Place("rod", end), place_on("slider", 0 * X), Z)
    mechanism = Mechanism(links, closures=[closure])
    shapes = [
        [0.0, 0.0, 0.103339863e-4, 0.169327969e-4],
        [0.444896105, 0.463434311e-2, -0.178591076e-5, -0.268938672e-5],
    ]
    case = Case(CompiledSystem(mechanism), np.zeros(6), np.zeros(6), turn)
    case.q[:] = slider_crank_state(case, 0.0, 0.450016933, shapes[0])
    case.v[:] = slider_crank_state(case, -74.9957670 - 150.0, -0.268938672e-5, shapes[1])
    return case


def slider_crank_state(case: Case, turned: float, slid: float, shapes: Sequence[float]) -> Array:
    """Return positions, or rates, from the rod's angle to the crank, the slider's place and sizes of the shapes."""
    mechanism, state = case.system.mechanism, np.zeros(6)
    state[mechanism.layout.rate[1:]] = turned, slid
    state[mechanism.modes_of(1)] = np.linalg.solve(case.shapes, shapes)
    return state


def _steady(rate: float) -> Signal:
    return formula(parse_formula(f"{rate} * t"))


def point_of(case: Case, body: str, place: Array, t: float, q: Array) -> Array:
    """Return where a place of a body is in space, shape (3,) [m]."""
    mechanism = case.system.mechanism
    origins, rotations, _ = case.system.compiled.frames(t, q, np.zeros(mechanism.n))
    k = mechanism.number_of(body)
    return np.asarray(origins[k] + rotations[k] @ place)
