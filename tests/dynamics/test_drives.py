"""Loads and prescribed motions of a chain: their work, their generalised forces, the reactions; slow and fast modes.

The chain is made of mass points; its kinematics, rotation matrices and complex steps, share nothing with the kernels.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.spatial.transform import Rotation

from fmd.core.arrays import Array
from fmd.core.formula import parse_formula
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.links import Link, PointLoad
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import Signal, constant, formula, half_sine, linear_table
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import evaluate
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.integrators.subcycling import Subcycling
from fmd.reduction.body import MarkerShapes
from fmd.reduction.inertia import inertia_integrals
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from tests.dynamics.compiler.kane import rotation
from tests.dynamics.drives import Drives

CLOSELY = ScipyIvp("DOP853", 1e-11)
WEIGHT = np.array([1.0, -2.0, -9.81])  # aslant, so that no axis of the ground is special
TIMES = np.linspace(0.0, 1.0, 401)  # breakpoints below fall on even numbers: Simpson's rule keeps its order
NAMES = ("upper", "lower", "slider")
MODES = (3, 4)  # where the lower body's modal coordinates are in z, after the three joints
STEP = 1e-30  # of complex differences


@dataclass(frozen=True)
class Arm:
    """A rigid body on a hinge, on it a flexible one on a hinge, on it a rigid one on a slide.

    Its configuration z is (angle, angle, displacement, two modal coordinates), whatever the tree's own order.

    Attributes
    ----------
    tree : Mechanism
        The mechanism under test.
    points : tuple of (ndarray, ndarray, ndarray)
        Places (n, 3), masses (n,) and shapes (n, 3, n_modes) of each body's points.
    """

    tree: Mechanism
    points: tuple[tuple[Array, Array, Array], ...]

    @cached_property
    def system(self) -> CompiledSystem:
        """The mechanism as integrators march it."""
        return CompiledSystem(self.tree)

    @cached_property
    def drives(self) -> Drives:
        """Loads of the prescribed joints."""
        return Drives(self.tree)

    @property
    def order(self) -> list[int]:
        """Number in z of each rate: slow joints, slow modes, fast joints, fast modes."""
        order: list[int] = []
        for fast in (False, True):
            joints = [k for k, link in enumerate(self.tree.links) if (link.name in self.tree.fast_joints) is fast]
            order += [k for k in joints if self.tree.links[k].motion is None]
            n_slow = self.tree.slow_modes.get("lower", 0)
            order += MODES[n_slow:] if fast else MODES[:n_slow]
        return order

    def with_links(self, **changes: dict[str, Any]) -> "Arm":
        """Change some links, by name."""
        links = [replace(link, **changes.get(link.name, {})) for link in self.tree.links]
        return replace(self, tree=replace(self.tree, links=links))

    def with_tree(self, **changes: Any) -> "Arm":
        return replace(self, tree=replace(self.tree, **changes))

    def frames(self, z: Array) -> list[tuple[Array, Array]]:
        """Origin and rotation of each body's frame: an analytic function of z."""
        origin, R, inner, found = np.zeros(3), np.eye(3), np.zeros(0), []
        for link, s in zip(self.tree.links, z[:3], strict=True):
            axis = link.axis / np.linalg.norm(link.axis)
            origin = origin + R @ (link.place.position + (link.place.translation @ inner if len(inner) else 0.0))
            R = R @ rotation(link.place.rotation @ inner) if len(inner) else R
            if link.joint == PRISMATIC:
                origin = origin + R @ (s * axis)
            else:
                R = R @ rotation(s * axis)
            inner = z[3:] if len(link.omega) else z[:0]
            found.append((origin, R))
        return found

    def section(self, load: PointLoad, z: Array) -> tuple[Array, Array]:
        """Where a load's point is, and how its section is turned."""
        origin, R = self.frames(z)[NAMES.index(load.body)]
        at = load.marker
        if not at.translation.size:
            return origin + R @ at.position, R
        return origin + R @ (at.position + at.translation @ z[3:]), R @ rotation(at.rotation @ z[3:])

    def places(self, z: Array) -> Array:
        """All points in space, shape (n_points, 3)."""
        inner = (z[:0], z[3:], z[:0])
        bodies = zip(self.frames(z), self.points, inner, strict=True)
        return np.concatenate([origin + (x + Phi @ own) @ R.T for (origin, R), (x, _, Phi), own in bodies])

    @property
    def masses(self) -> Array:
        return np.concatenate([m for _, m, _ in self.points])

    def velocities(self, z: Array, dz: Array) -> Array:
        return self.places(z + 1j * STEP * dz).imag / STEP

    def power(self, load: PointLoad, size: float, z: Array, dz: Array) -> float:
        """Force times its point's velocity, or torque times its section's rate of rotation."""
        r, R = self.section(load, z + 1j * STEP * dz)
        d = load.direction / np.linalg.norm(load.direction)
        acting = size * (R.real @ d if load.following else d)
        spin = R.imag / STEP @ R.real.T
        moves = np.array([spin[2, 1], spin[0, 2], spin[1, 0]]) if load.torque else r.imag / STEP
        return float(acting @ moves)

    def energy(self, z: Array, dz: Array) -> tuple[float, float]:
        """Kinetic and potential energy from the points."""
        kinetic = 0.5 * self.masses @ np.sum(self.velocities(z, dz) ** 2, axis=1)
        potential = -self.masses @ self.places(z) @ self.tree.gravity
        for link, s in zip(self.tree.links, z[:3], strict=True):
            stretch = s - link.rest + (link.joint_rotation @ z[3:] if link.joint_rotation.size else 0.0)
            potential += 0.5 * link.spring * stretch**2 + 0.5 * np.sum(
                (link.omega * z[3:]) ** 2 if len(link.omega) else 0.0
            )
        return float(kinetic), float(potential)

    def turned(self, R: Array, shift: Array) -> "Arm":
        """Turn and move everything in space: bodies, joints, loads and weight."""
        links, points = [], []
        for link, (x, m, Phi) in zip(self.tree.links, self.points, strict=True):
            points.append((x @ R.T, m, np.einsum("ab,ibk->iak", R, Phi)))
            integrals = inertia_integrals(points[-1][0], np.diag(m), points[-1][2])
            at = link.place
            moved = R @ at.position + (shift if link.parent < 0 else 0.0)
            place = MarkerShapes(moved, R @ at.translation, R @ at.rotation)
            links.append(replace(link, integrals=integrals, place=place, axis=R @ link.axis))
        loads = []
        for load in self.tree.loads:
            at = load.marker
            marker = MarkerShapes(R @ at.position, R @ at.translation, R @ at.rotation)
            loads.append(replace(load, direction=R @ load.direction, marker=marker))
        tree = replace(self.tree, links=links, loads=loads, gravity=R @ self.tree.gravity)
        return Arm(tree, tuple(points))


def make_arm() -> Arm:
    """Random bodies, joints and places; springs, but no drive, no damper and no weight."""
    rng = np.random.default_rng(7)
    links, points = [], []
    for k, (name, joint, n) in enumerate(zip(NAMES, (REVOLUTE, REVOLUTE, PRISMATIC), (0, 2, 0), strict=True)):
        x, m, Phi = rng.normal(size=(8, 3)), rng.uniform(0.1, 0.5, 8), rng.normal(size=(24, n))
        L = np.linalg.cholesky(Phi.T @ (np.repeat(m, 3)[:, None] * Phi))  # unit modal masses
        Phi = np.linalg.solve(L, Phi.T).T.reshape(8, 3, n)
        on = 0.3 * rng.normal(size=(3, 2)), 0.5 * rng.normal(size=(3, 2))
        integrals, place, axis = inertia_integrals(x, np.diag(m), Phi), rng.normal(size=3), rng.normal(size=3)
        place = MarkerShapes(place, *on) if k == 2 else MarkerShapes(place)
        omega, turning = np.array([4.0, 7.0])[:n], 0.3 * rng.normal(size=n)
        spring, rest = rng.uniform(2.0, 4.0), rng.uniform(0.1, 0.3)
        settings = {"spring": spring, "rest": rest, "joint_rotation": turning if k < 2 else np.zeros(0)}
        links.append(Link(name, integrals, joint, k - 1, place, axis, omega, **settings))
        points.append((x, m, Phi))
    return Arm(Mechanism(links, gravity=WEIGHT), tuple(points))


ARM = make_arm()


def at(body: str, size: Signal, seed: int = 0, **kind: bool) -> PointLoad:
    """A load at a random point of a body."""
    rng = np.random.default_rng(seed)
    shapes, rotations = (0.5 * rng.normal(size=(2, 3, 2))) if body == "lower" else np.zeros((2, 3, 0))
    direction, place = rng.normal(size=3), rng.normal(size=3)
    return PointLoad(body, direction, size, marker=MarkerShapes(place, shapes, rotations), **kind)


class Case(NamedTuple):
    """A chain and the power of its drives by hand: at time t, configuration z, its rate ż and the tree's own q, v."""

    arm: Arm
    power: Callable[[float, Array, Array, Array, Array], float]
    motions: dict[int, Callable[[float], tuple[float, float, float]]] = {}  # noqa: RUF012 - read only


def table(t: float) -> float:
    return float(np.interp(t, [0.1, 0.4, 0.7], [1.0, -2.0, 3.0]))


SIGNALS: dict[str, tuple[Signal, Callable[[float], float]]] = {
    "constant": (constant(1.2), lambda t: 1.2),
    "formula": (formula(parse_formula("2*sin(5*t) + t**2"), 1.5), lambda t: 1.5 * (2 * np.sin(5 * t) + t**2)),
    "table": (linear_table(np.array([0.1, 0.4, 0.7]), np.array([1.0, -2.0, 3.0])), table),
    "half sine": (half_sine(0.2, 0.5, 4.0), lambda t: 4 * np.sin(np.pi * (t - 0.2) / 0.5) if 0.2 < t < 0.7 else 0.0),
}
MOVES: dict[str, tuple[str, Callable[[float], tuple[float, float, float]]]] = {
    name: (f"{a}*sin(4*t) + {b}*t**2", lambda t, a=a, b=b: (  # type: ignore[misc]
        a * np.sin(4 * t) + b * t**2, 4 * a * np.cos(4 * t) + 2 * b * t, -16 * a * np.sin(4 * t) + 2 * b
    ))
    for name, a, b in (("upper", 0.3, 0.5), ("lower", -0.4, 0.2), ("slider", 0.2, -0.3))
}  # fmt: skip


def frozen(name: str) -> dict[str, Any]:
    """Fields of a link whose joint moves as prescribed: a frozen section, and no spring."""
    return {"motion": formula(parse_formula(MOVES[name][0])), "joint_rotation": np.zeros(0), "spring": 0.0}


def along_joint(name: str, signal: str) -> Case:
    size, by_hand = SIGNALS[signal]
    k = NAMES.index(name)

    def power(t: float, z: Array, dz: Array, q: Array, v: Array) -> float:
        section = ARM.tree.links[k].joint_rotation
        return by_hand(t) * float(dz[k] + (section @ dz[3:] if section.size else 0.0))

    return Case(ARM.with_links(**{name: {"load": size}}), power)


def at_point(body: str, **kind: bool) -> Case:
    size, by_hand = SIGNALS["formula"]
    load = at(body, size, **kind)
    return Case(ARM.with_tree(loads=[load]), lambda t, z, dz, q, v: ARM.power(load, by_hand(t), z, dz))


def prescribed(*names: str) -> Case:
    arm = ARM.with_links(**{name: frozen(name) for name in names})
    motions = {NAMES.index(name): MOVES[name][1] for name in names}

    def power(t: float, z: Array, dz: Array, q: Array, v: Array) -> float:
        return sum(load * MOVES[name][1](t)[1] for name, load in arm.drives.loads(t, q, v).items())

    return Case(arm, power, motions)


def damped() -> Case:
    c, zeta, section = 0.8, np.array([0.05, 0.1]), ARM.tree.links[1].joint_rotation
    arm = ARM.with_links(upper={"damper": c}, lower={"damper": c, "damping": zeta}, slider={"damper": c})

    def power(t: float, z: Array, dz: Array, q: Array, v: Array) -> float:
        joints = dz[0] ** 2 + (dz[1] + section @ dz[3:]) ** 2 + dz[2] ** 2
        return -float(c * joints + 2 * zeta * ARM.tree.links[1].omega @ dz[3:] ** 2)

    return Case(arm, power)


CASES = {
    "weight alone": lambda: Case(ARM, lambda *_: 0.0),
    **{f"torque, {signal}": lambda signal=signal: along_joint("lower", signal) for signal in ("table", "half sine")},
    "force on a slide": lambda: along_joint("slider", "formula"),
    # The other kinds and bodies have the same generalised forces, see below.
    "fixed torque on upper": lambda: at_point("upper", torque=True),
    "following torque on lower": lambda: at_point("lower", torque=True, following=True),
    "following force on slider": lambda: at_point("slider", following=True),
    **{f"motion of {name}": lambda name=name: prescribed(name) for name in NAMES},
    "all joints move as prescribed": lambda: prescribed(*NAMES),
    "dampers": damped,
}


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]()  # type: ignore[no-untyped-call,no-any-return]


def whole(case: Case, t: float, q: Array, v: Array) -> tuple[Array, Array]:
    """z and ż of the tree's coordinates and the prescribed ones."""
    z, dz = np.zeros(5), np.zeros(5)
    z[case.arm.order], dz[case.arm.order] = q, v
    for k, motion in case.motions.items():
        z[k], dz[k], _ = motion(t)
    return z, dz


def start(arm: Arm, seed: int = 0) -> tuple[Array, Array]:
    q, v = 0.4 * np.random.default_rng(seed).normal(size=(2, 5))
    return q[arm.order], v[arm.order]


def compiled(arm: Arm, t: float, q: Array, v: Array) -> Array:
    a = np.full(arm.tree.n, np.nan)
    evaluate(arm.system.parameters, t, q, v, a)
    return a


# Work ------------------------------------------------------------------------------------------------------------


def test_the_energy_gained_is_the_work_done(case: Case) -> None:
    march = CLOSELY.march(case.arm.system, *start(case.arm), TIMES)
    energy = np.sum(Kinematics(case.arm.tree, TIMES, march.q, march.v).energies, axis=0)
    power = np.empty(len(TIMES))
    for i, t in enumerate(TIMES):
        q, v = march.q[i], march.v[i]
        power[i] = case.power(t, *whole(case, t, q, v), q, v)
    work = np.array([simpson(power[: k + 1], x=TIMES[: k + 1]) if k else 0.0 for k in range(0, len(TIMES), 50)])
    assert np.abs(power).max() > 0.1 or case.arm is ARM
    scale = np.abs(energy).max() + np.abs(work).max()
    assert energy[::50] - energy[0] == pytest.approx(work, abs=1e-8 * scale)


def test_energies_are_those_of_the_points_whatever_drives_them(case: Case) -> None:
    q, v = start(case.arm, 1)
    for t in (0.0, 0.37):
        kinetic, potential = Kinematics(case.arm.tree, np.array([t]), q[None], v[None]).energies
        want = case.arm.energy(*whole(case, t, q, v))
        assert (kinetic[0], potential[0]) == pytest.approx(want, rel=1e-12)


# Generalised forces ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("body", NAMES)
@pytest.mark.parametrize("torque", [False, True], ids=["force", "torque"])
@pytest.mark.parametrize("following", [False, True], ids=["fixed", "following"])
@pytest.mark.parametrize("size", [1e-9, 2.0], ids=str)
def test_a_point_load_does_its_virtual_work_on_every_rate(
    body: str, torque: bool, following: bool, size: float
) -> None:
    # Q_j is the power for the unit rate j; M̂ (a − a₀) is what the load adds. Sections turned a little and a lot.
    load = at(body, formula(parse_formula("2 + t")), 3, torque=torque, following=following)
    q, v = start(ARM, 2)
    q[3:] *= size / np.linalg.norm(q[3:])
    t = 0.5
    arm = ARM.with_tree(loads=[load])
    found = arm.system.mass_matrix(q, t) @ (compiled(arm, t, q, v) - compiled(ARM, t, q, v))
    want = np.array([ARM.power(load, 2.5, q, unit) for unit in np.eye(5)])
    assert np.abs(want).max() > 0.1
    assert found == pytest.approx(want, abs=1e-12 * (1 + np.abs(compiled(arm, t, q, v)).max()))


# Prescribed motion -----------------------------------------------------------------------------------------------

FROZEN = [("upper",), ("lower",), ("slider",), ("upper", "slider"), NAMES]


def equations(arm: Arm, z: Array, dz: Array) -> tuple[Array, Array]:
    """M and Q of all five coordinates by d'Alembert's principle on the points."""
    J = np.stack([arm.velocities(z, unit) for unit in np.eye(5)], axis=-1)
    bias, h = np.zeros_like(J[:, :, 0]), 0.01
    for k, weight in enumerate((4 / 5, -1 / 5, 4 / 105, -1 / 280), start=1):  # of order 8; z moves straight on
        bias += weight * (arm.velocities(z + k * h * dz, dz) - arm.velocities(z - k * h * dz, dz)) / h
    Q = np.einsum("i,iaj,ia->j", arm.masses, J, arm.tree.gravity - bias)
    for k, link in enumerate(arm.tree.links):
        grip = np.eye(5)[k]
        if link.joint_rotation.size:
            grip[3:] = link.joint_rotation
        Q -= link.spring * (grip @ z - link.rest) * grip
    Q[3:] -= arm.tree.links[1].omega ** 2 * z[3:]
    return np.einsum("i,iaj,iak->jk", arm.masses, J, J), Q


@pytest.mark.parametrize("names", FROZEN, ids=" ".join)
@pytest.mark.parametrize("t", [0.0, 0.37])
def test_prescribed_motion_obeys_the_constrained_equations_with_multipliers(names: tuple[str, ...], t: float) -> None:
    # M z̈ = Q + Gᵀ λ, G z̈ = f̈(t): λ are the loads that the drives need.
    case = prescribed(*names)
    q, v = start(case.arm, 3)
    z, dz = whole(case, t, q, v)
    M, Q = equations(case.arm, z, dz)
    frozen_at = list(case.motions)
    G, wanted = np.eye(5)[frozen_at], [motion(t)[2] for motion in case.motions.values()]
    n = len(frozen_at)
    solution = np.linalg.solve(np.block([[M, -G.T], [G, np.zeros((n, n))]]), np.r_[Q, wanted])
    scale = np.abs(solution).max()
    assert compiled(case.arm, t, q, v) == pytest.approx(solution[case.arm.order], abs=1e-10 * scale)
    loads = case.arm.drives.loads(t, q, v)
    assert [loads[NAMES[k]] for k in frozen_at] == pytest.approx(solution[5:], abs=1e-10 * scale)


@pytest.mark.parametrize("names", FROZEN, ids=" ".join)
def test_the_drive_load_moves_the_released_mechanism_as_prescribed(names: tuple[str, ...]) -> None:
    case, t = prescribed(*names), 0.37
    q, v = start(case.arm, 4)
    loads = case.arm.drives.loads(t, q, v)
    driven = {name: {"motion": None, "load": constant(loads[name])} for name in names}
    z, dz = whole(case, t, q, v)
    found = compiled(case.arm.with_links(**driven), t, z, dz)
    want = np.zeros(5)
    want[case.arm.order] = compiled(case.arm, t, q, v)
    for k, motion in case.motions.items():
        want[k] = motion(t)[2]
    assert found == pytest.approx(want, abs=1e-11 * np.abs(want).max())


def test_a_chain_in_which_all_joints_move_as_prescribed_keeps_its_modes_alone() -> None:
    arm = prescribed(*NAMES).arm
    assert (arm.tree.n, arm.tree.n_positions, arm.tree.n_slow) == (2, 2, 0)


# The same scene elsewhere -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("names", [(), ("upper",), ("lower", "slider")], ids=["released", "upper", "lower slider"])
def test_turning_and_moving_everything_in_space_changes_nothing(names: tuple[str, ...]) -> None:
    size = SIGNALS["formula"][0]
    kinds = [(torque, following) for torque in (False, True) for following in (False, True)]
    loads = [at("lower", size, seed, torque=a, following=b) for seed, (a, b) in enumerate(kinds)]
    arm = prescribed(*names).arm.with_tree(loads=[*loads, at("upper", size, 9), at("slider", size, 10, torque=True)])
    R, shift = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([3.0, -2.0, 1.0])
    other, times = arm.turned(R, shift), np.linspace(0.0, 1.0, 11)
    here, there = (CLOSELY.march(one.system, *start(arm, 5), times) for one in (arm, other))
    assert there.q == pytest.approx(here.q, abs=1e-9)
    assert there.v == pytest.approx(here.v, abs=1e-8)
    frames, others = (Kinematics(one.tree, times, m.q, m.v).frames for one, m in ((arm, here), (other, there)))
    for frame, moved in zip(frames, others, strict=True):
        assert moved.origin == pytest.approx(frame.origin @ R.T + shift, abs=1e-8)
        assert moved.rotation == pytest.approx(R @ frame.rotation @ R.T, abs=1e-8)


# Slow and fast modes ---------------------------------------------------------------------------------------------

SPLITS = [(0, ()), (0, NAMES), (1, ("slider",)), (1, ("upper", "slider")), (2, ("upper", "slider")), (2, NAMES)]


def split_arms(n_slow: int, fast: tuple[str, ...]) -> tuple[Arm, Arm]:
    """An arm with every drive, whole and split."""
    load = at("lower", SIGNALS["formula"][0], torque=True, following=True)
    arm = damped().arm.with_tree(loads=[load]).with_links(upper={"load": SIGNALS["half sine"][0]})
    return arm, arm.with_tree(slow_modes={"lower": n_slow}, fast_joints=fast)


@pytest.mark.parametrize(("n_slow", "fast"), SPLITS)
def test_accelerations_do_not_depend_on_the_split(n_slow: int, fast: tuple[str, ...]) -> None:
    arm, split = split_arms(n_slow, fast)
    assert split.tree.n_slow == n_slow + 3 - len(fast)
    q, v = start(arm, 6)
    order = split.order
    found = compiled(split, 0.3, q[order], v[order])
    assert found == pytest.approx(compiled(arm, 0.3, q, v)[order], rel=1e-12)
    assert list(split.tree.modes_of(1)) == [order.index(3), order.index(4)]


@pytest.mark.parametrize(("n_slow", "fast"), SPLITS)
def test_one_to_one_sub_cycling_is_central_difference_for_any_split(n_slow: int, fast: tuple[str, ...]) -> None:
    _, split = split_arms(n_slow, fast)
    times = np.linspace(0.0, 1.0, 37)
    methods = (CentralDifference(0.002), Subcycling(0.002, 1))
    plain, one = (method.march(split.system, *start(split, 7), times) for method in methods)
    assert np.array_equal(plain.q, one.q)
    assert np.array_equal(plain.v, one.v)


@pytest.mark.parametrize(("n_slow", "fast"), [(1, ("slider",)), (2, ("upper", "slider"))])
def test_sub_cycling_of_any_split_comes_to_the_same_motion(n_slow: int, fast: tuple[str, ...]) -> None:
    # The reference has a split of its own; sub-cycling is of first order at least.
    arm, split = split_arms(n_slow, fast)
    times = np.linspace(0.0, 1.0, 11)
    want = CLOSELY.march(arm.system, *start(arm, 8), times).q[:, split.order]
    coarse, fine = (
        np.abs(Subcycling(h, 4).march(split.system, *start(split, 8), times).q - want).max() for h in (2e-3, 5e-4)
    )
    assert fine < 0.3 * coarse  # steps are a quarter
