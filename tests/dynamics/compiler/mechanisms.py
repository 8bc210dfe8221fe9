"""Random mechanisms with everything that one may have, made of mass points whose places are known."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import expm

from fmd.core.arrays import EPSILON, Array
from fmd.core.formula import parse_formula
from fmd.core.joint_kinds import JointKind
from fmd.dynamics.compiler.compiled import CompiledMechanism, compile_mechanism
from fmd.dynamics.force_laws import ForceCurve, ForceLaw
from fmd.dynamics.links import Link, PointLoad, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import Signal, constant, formula, half_sine
from fmd.reduction.body import MarkerShapes
from fmd.reduction.inertia import InertiaIntegrals, inertia_integrals
from fmd.scene.joints.constant_velocity import CONSTANT_VELOCITY
from fmd.scene.joints.cylindrical import CYLINDRICAL
from fmd.scene.joints.fixed import FIXED
from fmd.scene.joints.free import FREE
from fmd.scene.joints.planar import PLANAR
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from fmd.scene.joints.screw import SCREW
from fmd.scene.joints.spherical import SPHERICAL
from fmd.scene.joints.universal import UNIVERSAL

JOINTS = (FIXED, REVOLUTE, PRISMATIC, SPHERICAL, FREE)
MORE_JOINTS = (UNIVERSAL, CYLINDRICAL, PLANAR, SCREW, CONSTANT_VELOCITY)


class Points(NamedTuple):
    """Mass points: places (n, 3), masses (n,), mode shapes (n, 3, n_modes), shapes of second order (n, 3, …)."""

    x: Array
    m: Array
    Phi: Array
    Gamma: Array

    def moved(self, z: Array) -> Array:
        """Places for modal coordinates, shape (n, 3)."""
        return np.asarray(self.x + self.Phi @ z + 0.5 * (self.Gamma @ z) @ z)


WithFields = Callable[[Points, InertiaIntegrals, np.random.Generator, bool], tuple[Points, InertiaIntegrals]]


@dataclass(frozen=True)
class PointMechanism:
    """A mechanism, and the mass points that each body is made of."""

    mechanism: Mechanism
    points: tuple[Points, ...]

    @cached_property
    def compiled(self) -> CompiledMechanism:
        """Its equations, traced and compiled once for all tests that ask for them."""
        return compile_mechanism(self.mechanism)

    def state(self, seed: int) -> tuple[Array, Array]:
        """Random positions and rates; quaternions have unit length, modal coordinates are small."""
        rng = np.random.default_rng(seed)
        mechanism = self.mechanism
        q, v = 0.4 * rng.normal(size=mechanism.n_positions), 0.6 * rng.normal(size=mechanism.n)
        for link, first in zip(mechanism.links, mechanism.layout.position, strict=True):
            if link.joint in (SPHERICAL, FREE):
                e = q[first + link.n_positions - 4 : first + link.n_positions]
                e[:] = rng.normal(size=4)
                e /= np.linalg.norm(e)
        return q, v


# Between them they have all that a hundred have, `test_mechanisms.py` says: each joint, of rigid and flexible bodies,
# on the ground and on either, prescribed or free; every kind of load; slow modes and fast joints; plane and in space.
SEEDS = (0, 1, 8, 13, 16, 37, 44, 45)
EACH = pytest.mark.parametrize(
    "seed", [*SEEDS[:2], *(pytest.param(seed, marks=pytest.mark.slow) for seed in SEEDS[2:])]
)


@cache
def random_mechanism(
    seed: int, second_order: bool = False, joints: tuple[JointKind, ...] = JOINTS, whole: bool = False
) -> PointMechanism:
    """Make one of one to four bodies, any of them rigid or flexible, on random joints, markers and under random loads.

    Every fifth is plane. ``second_order`` adds displacements of second order, of which the ``whole`` kinetic energy may
    count. One without coordinates is made anew.
    """
    made = _any_mechanism(seed, np.random.default_rng([seed, 7]), second_order, joints, whole)
    return made if made.mechanism.n else random_mechanism(seed + 1000, second_order, joints, whole)


def _any_mechanism(
    seed: int, rng: np.random.Generator, second_order: bool, joints: tuple[JointKind, ...], whole: bool
) -> PointMechanism:
    plane = seed % 5 == 4
    sizes = [int(n) for n in rng.integers(0, 4, size=rng.integers(1, 5))]
    bodies = [_random_points(n, rng, plane) for n in sizes]
    links: list[Link] = []
    for k, n in enumerate(sizes):
        kinds = JOINTS[:3] if plane else joints
        kind = kinds[int(rng.integers(len(kinds)))]
        kind = REVOLUTE if k == 0 and kind == FIXED else kind
        parent = int(rng.integers(-1, k)) if k else -1
        links.append(_random_link(k, kind, parent, n, sizes[parent] if parent >= 0 else 0, bodies[k], rng, plane))
    fast = [link.name for link in links if link.n_rates == 1 and rng.random() < 0.3]
    slow = {link.name: int(rng.integers(0, len(link.omega) + 1)) for link in links if rng.random() < 0.3}
    gravity = np.array([1.0, -9.8, 0.0 if plane else 2.0]) * (rng.random() < 0.7)
    loads = [_random_load(link, rng, plane) for link in links for _ in range(rng.integers(0, 3))]
    made = PointMechanism(Mechanism(links, fast, gravity, loads, slow), tuple(bodies))
    return _with_second_order(made, rng, plane, _with_affine if whole else _with_pairs) if second_order else made


def _random_points(n_modes: int, rng: np.random.Generator, plane: bool) -> Points:
    """Twelve points and shapes of unit modal mass."""
    x, m, Phi = rng.normal(size=(12, 3)), rng.uniform(0.1, 0.5, 12), rng.normal(size=(12, 3, n_modes))
    if plane:
        x[:, 2] = 0.0
        Phi[:, 2] = 0.0
    flat = Phi.reshape(36, n_modes)
    L = np.linalg.cholesky(flat.T @ (np.repeat(m, 3)[:, None] * flat))
    return Points(x, m, np.linalg.solve(L, flat.T).T.reshape(12, 3, n_modes), np.zeros((12, 3, n_modes, n_modes)))


def _random_link(
    number: int,
    kind: JointKind,
    parent: int,
    n: int,
    n_parent: int,
    points: Points,
    rng: np.random.Generator,
    plane: bool,
) -> Link:
    x, m, Phi, _ = points
    if n:
        integrals = inertia_integrals(x, np.diag(m), Phi)
    else:
        centre = m @ x / m.sum()
        arms = x - centre
        integrals = rigid_integrals(
            float(m.sum()), centre, np.sum(arms**2 * m[:, None]) * np.eye(3) - (arms.T * m) @ arms
        )
    axis = rng.normal(size=3)
    if plane:
        axis = np.array([0.0, 0.0, 1.0 if rng.random() < 0.5 else -2.0]) if kind == REVOLUTE else [*axis[:2], 0.0]
    elif rng.random() < 0.3:
        axis = np.eye(3)[rng.integers(3)]
    along = kind in (REVOLUTE, PRISMATIC)
    turn = rng.normal(size=3) * ([0, 0, 1] if plane else [1, 1, 1]) * (rng.random() < 0.4)
    place, omega = rng.normal(size=3) * [1, 1, not plane], np.sort(rng.uniform(3.0, 9.0, n))
    damping = rng.uniform(0.02, 0.1, n) if rng.random() < 0.7 else np.zeros(0)
    moved = 0.3 * rng.normal(size=(3, n_parent)) * np.array([[1], [1], [not plane]])
    link = Link(
        f"body {number}",
        integrals,
        kind,
        parent,
        place=MarkerShapes(place, moved, _random_rotations(n_parent, np.asarray(axis), rng, plane)),
        place_axes=expm(np.cross(np.eye(3), turn)),
        axis=np.asarray(axis),
        omega=omega,
        damping=damping,
        joint_rotation=0.3 * rng.normal(size=n if kind == REVOLUTE and rng.random() < 0.6 else 0),
        spring=rng.uniform(2.0, 4.0) if along and rng.random() < 0.6 else 0.0,
        rest=rng.uniform(0.1, 0.3) if along else 0.0,
        damper=rng.uniform(0.1, 0.3) if along and rng.random() < 0.6 else 0.0,
        load=_random_signal(rng) if along else constant(0.0),
    )
    if kind in MORE_JOINTS:
        laws = [
            ForceLaw(ForceCurve((0.1, *rng.uniform(1.0, 2.0, 2))), rng.uniform(0.1, 0.3)) for _ in range(link.n_rates)
        ]
        return replace(link, laws=tuple(laws), other_axis=rng.normal(size=3), lead=rng.uniform(-0.4, 0.4))
    if along and rng.random() < 0.25:  # prescribed
        return replace(link, motion=_smooth_signal(rng), joint_rotation=np.zeros(0))
    return link


def _random_rotations(n: int, axis: Array, rng: np.random.Generator, plane: bool) -> Array:
    """Rotations of a marker: none, about the next hinge, about another axis, about all three."""
    along = axis / np.linalg.norm(axis) if rng.random() < 0.5 else np.eye(3)[rng.integers(3)]
    about = np.array([0.0, 0.0, 1.0]) if plane else along
    choice = rng.integers(4)
    if choice == 0:
        return np.zeros((3, n))
    if choice < 3 or plane:
        return np.outer(about, 0.5 * rng.normal(size=n))
    return 0.5 * rng.normal(size=(3, n))


def _random_signal(rng: np.random.Generator) -> Signal:
    choices = (constant(0.0), constant(rng.uniform(0.5, 1.0)), _smooth_signal(rng), half_sine(0.1, 0.9, 1.5))
    return choices[rng.integers(len(choices))]


def _smooth_signal(rng: np.random.Generator) -> Signal:
    return formula(parse_formula(f"{rng.uniform(0.3, 0.8):.3f}*sin({rng.uniform(1, 3):.3f}*t) + 0.2*t"))


def _random_load(link: Link, rng: np.random.Generator, plane: bool) -> PointLoad:
    n = len(link.omega)
    torque = bool(rng.random() < 0.5)
    direction = rng.normal(size=3)
    if plane:
        direction[[2] if not torque else [0, 1]] = 0.0
    return PointLoad(
        link.name,
        direction,
        _random_signal(rng),
        torque,
        bool(rng.random() < 0.5),
        MarkerShapes(
            rng.normal(size=3) * [1, 1, not plane],
            0.3 * rng.normal(size=(3, n)) * np.array([[1], [1], [not plane]]),
            _random_rotations(n, np.array([0.0, 0.0, 1.0]), rng, plane),
        ),
    )


def _with_second_order(
    made: PointMechanism, rng: np.random.Generator, plane: bool, with_fields: WithFields
) -> PointMechanism:
    """Give flexible bodies and their markers displacements of second order."""
    mechanism, bodies, links = made.mechanism, list(made.points), list(made.mechanism.links)
    for k, link in enumerate(links):
        n = len(link.omega)
        if n and rng.random() < 0.7:
            bodies[k], integrals = with_fields(bodies[k], link.integrals, rng, plane)
            displacement2 = (
                _random_displacement2(1, n, rng)[0]
                if len(link.joint_rotation) and rng.random() < 0.5
                else np.zeros((0, 0))
            )
            markers = {
                "tip": MarkerShapes(rng.normal(size=3), *rng.normal(size=(2, 3, n)), _random_displacement2(6, n, rng))
            }
            links[k] = replace(link, integrals=integrals, joint_displacement2=displacement2, markers=markers)
    for k, link in enumerate(links):
        if not link.markers:  # of a rigid body, or without terms of second order
            own, n = np.random.default_rng(k), len(link.omega)
            tip = MarkerShapes(own.normal(size=3), *own.normal(size=(2, 3, n)), np.zeros((6, n, n)))
            links[k] = replace(link, markers={"tip": tip})
    for k, link in enumerate(links):
        n = len(links[link.parent].omega) if link.parent >= 0 else 0
        if n and rng.random() < 0.7:
            forms = _random_displacement2(6, n, rng) * (_IN_PLANE if plane else 1.0)
            links[k] = replace(link, place=replace(link.place, displacement2=forms))
    counts = {link.name: len(link.omega) for link in links}
    loads = []
    for load in mechanism.loads:
        marker = load.marker
        if counts[load.body] and rng.random() < 0.7:
            displacement2 = _random_displacement2(6, counts[load.body], rng) * (_IN_PLANE if plane else 1.0)
            marker = replace(marker, displacement2=displacement2)
        loads.append(replace(load, marker=marker))
    return PointMechanism(replace(mechanism, links=links, loads=loads), tuple(bodies))


def _with_pairs(
    points: Points, integrals: InertiaIntegrals, rng: np.random.Generator, plane: bool
) -> tuple[Points, InertiaIntegrals]:
    """Add pairs of points with masses ±m that displacements of second order move by ±Γ.

    A pair has the inertia of what is linear in Γ alone: all that the equations keep of it.
    """
    n = points.Phi.shape[2]
    x, m, Gamma = (
        rng.normal(size=(4, 3)),
        rng.uniform(0.1, 0.5, 4),
        _random_displacement2(12, n, rng).reshape(4, 3, n, n),
    )
    if plane:
        x[:, 2] = 0.0
        Gamma[:, 2] = 0.0
    G = integrals.G.copy()
    first = np.einsum("i,ia,ibjk->abjk", m, x, Gamma)
    G[:, :, 1:, 1:] += first + first.swapaxes(0, 1)
    rotation2 = 2.0 * np.einsum("abc,bcjk->ajk", EPSILON, first)
    integrals = replace(integrals, G=G, displacement2=2.0 * np.einsum("i,iajk->ajk", m, Gamma), rotation2=rotation2)
    still = np.zeros((8, 3, n))
    pairs = Points(np.r_[x, x], np.r_[m, -m], still, np.r_[Gamma, -Gamma])
    return Points(*(np.concatenate(both) for both in zip(points, pairs, strict=True))), integrals


def _with_affine(
    points: Points, integrals: InertiaIntegrals, rng: np.random.Generator, plane: bool
) -> tuple[Points, InertiaIntegrals]:
    """Move points by affine fields of second order, of which the whole kinetic energy counts."""
    n = points.Phi.shape[2]
    A = _random_displacement2(12, n, rng).reshape(3, 4, n, n)
    if plane:
        A[2] = A[:, 3] = 0.0
    Gamma = np.einsum("ic,acjk->iajk", np.c_[np.ones(len(points.x)), points.x], A)
    first = np.einsum("i,ia,ibjk->abjk", points.m, points.x, Gamma)
    stiffening, G = -0.5 * (first + first.swapaxes(0, 1)), integrals.G.copy()
    G[:, :, 1:, 1:] -= stiffening
    rotation2, displacement2 = np.einsum("abc,bcjk->ajk", EPSILON, first), np.einsum("i,iajk->ajk", points.m, Gamma)
    return points._replace(Gamma=Gamma), replace(
        integrals, G=G, stiffening=stiffening, displacement2=displacement2, rotation2=rotation2, whole=True
    )


def _random_displacement2(count: int, n: int, rng: np.random.Generator) -> Array:
    displacement2 = 0.1 * rng.normal(size=(count, n, n))
    return displacement2 + displacement2.transpose(0, 2, 1)


_IN_PLANE = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0])[:, None, None]
