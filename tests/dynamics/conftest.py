"""Random chains of bodies made of mass points, and their kinematics by plain matrix products.

Nothing here shares code with the kernels: frames come from matrix exponentials, velocities from complex steps, inertia
from sums over points.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.core.joint_kinds import JointKind
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import constant
from fmd.reduction.body import MarkerShapes
from fmd.reduction.inertia import inertia_integrals
from fmd.scene.joints.fixed import FIXED
from fmd.scene.joints.free import FREE
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from fmd.scene.joints.spherical import SPHERICAL
from tests.dynamics.compiler.kane import rotation, tilde

Orders = tuple[tuple[JointKind, ...], tuple[int, ...], tuple[int, ...]]

# Joints, parents and numbers of modes. Together they have every joint on the ground, on a rigid and on a flexible body,
# under a rigid and a flexible body, and bodies that carry none, one and several others.
CHAINS: dict[str, Orders] = {
    "free-rigid": ((FREE, REVOLUTE, SPHERICAL, PRISMATIC, FIXED), (-1, 0, 1, 1, 2), (0, 0, 0, 0, 0)),
    "free-flexible": ((FREE, REVOLUTE, SPHERICAL, PRISMATIC, REVOLUTE, FIXED), (-1, 0, 1, 1, 3, 0), (2, 3, 0, 2, 2, 1)),
    "revolute-flexible": ((REVOLUTE, PRISMATIC, SPHERICAL, FREE), (-1, 0, 0, 1), (3, 0, 2, 1)),
    "spherical-mixed": ((SPHERICAL, FIXED, REVOLUTE, PRISMATIC), (-1, 0, 1, 0), (0, 2, 2, 1)),
    "many-roots": ((FIXED, REVOLUTE, PRISMATIC, PRISMATIC, REVOLUTE), (-1, 0, -1, -1, 3), (2, 2, 1, 0, 0)),
}
WITHOUT_SUPPORT = ("free-rigid", "free-flexible")


def turned_by(e: Array) -> Array:
    """Rotation of a unit quaternion, scalar last."""
    u, w = e[:3], e[3]
    return (w * w - u @ u) * np.eye(3) + 2 * np.outer(u, u) + 2 * w * tilde(u)


def product(e: Array, f: Array) -> Array:
    """Hamilton's product of quaternions, scalar last: the rotation f, then e."""
    return np.r_[e[3] * f[:3] + f[3] * e[:3] + np.cross(e[:3], f[:3]), e[3] * f[3] - e[:3] @ f[:3]]


@dataclass(frozen=True)
class PointChain:
    """A chain whose bodies are mass points.

    Attributes
    ----------
    tree : Mechanism
        The mechanism under test.
    x : tuple of ndarray, shapes (n_points, 3)
        Each body's points in its frame.
    m : tuple of ndarray, shapes (n_points,)
        Their masses.
    Phi : tuple of ndarray, shapes (n_points, 3, n_modes)
        Their mode shapes, of unit modal mass.
    """

    tree: Mechanism
    x: tuple[Array, ...]
    m: tuple[Array, ...]
    Phi: tuple[Array, ...]

    @cached_property
    def system(self) -> CompiledSystem:
        """The mechanism as integrators march it."""
        return CompiledSystem(self.tree)

    @property
    def masses(self) -> Array:
        return np.concatenate(self.m)

    def split(self, values: Array, sizes: Mapping[JointKind, int]) -> tuple[list[Array], list[Array]]:
        """Share positions or rates out to joints and to modes: slow joints come first, then fast ones, then modes."""
        links = self.tree.links
        joints: list[Array] = [np.zeros(0)] * len(links)
        modes: list[Array] = []
        start = 0
        for fast in (False, True):
            for k, link in enumerate(links):
                if (link.name in self.tree.fast_joints) is fast:
                    joints[k] = values[start : start + sizes[link.joint]]
                    start += sizes[link.joint]
        for link in links:
            modes.append(values[start : start + len(link.omega)])
            start += len(link.omega)
        assert start == len(values)
        return joints, modes

    def positions_of(self, q: Array) -> tuple[list[Array], list[Array]]:
        return self.split(q, {FIXED: 0, REVOLUTE: 1, PRISMATIC: 1, SPHERICAL: 4, FREE: 7})

    def rates_of(self, v: Array) -> tuple[list[Array], list[Array]]:
        return self.split(v, {FIXED: 0, REVOLUTE: 1, PRISMATIC: 1, SPHERICAL: 3, FREE: 6})

    def frames(self, q: Array) -> list[tuple[Array, Array]]:
        """Origin and rotation of each body's frame: an analytic function of q, complex where q is."""
        joints, modes = self.positions_of(q)
        found: list[tuple[Array, Array]] = []
        for link, s in zip(self.tree.links, joints, strict=True):
            origin, R, inner = np.zeros(3), np.eye(3), np.zeros(0)
            if link.parent >= 0:
                (origin, R), inner = found[link.parent], modes[link.parent]
            shapes, rotations = link.place.translation, link.place.rotation
            origin = origin + R @ (link.place.position + (shapes @ inner if shapes.size else 0.0))
            R = R @ rotation(rotations @ inner) if rotations.size else R
            axis = link.axis / np.linalg.norm(link.axis)
            if link.joint == REVOLUTE:
                R = R @ rotation(s[0] * axis)
            elif link.joint == PRISMATIC:
                origin = origin + R @ (s[0] * axis)
            elif link.joint == SPHERICAL:
                R = R @ turned_by(s)
            elif link.joint == FREE:
                origin, R = origin + R @ s[:3], R @ turned_by(s[3:])
            found.append((origin, R))
        return found

    def points(self, q: Array) -> Array:
        """All points in space, shape (n_points, 3)."""
        _, modes = self.positions_of(q)
        bodies = zip(self.frames(q), self.x, self.Phi, modes, strict=True)
        return np.concatenate([origin + (x + Phi @ inner) @ R.T for (origin, R), x, Phi, inner in bodies])

    def derivative(self, q: Array, v: Array) -> Array:
        """q̇ for rates v: a quaternion's is ½ e ∘ (ω, 0) with ω along the body's own axes."""
        pieces, modal = self.positions_of(np.arange(len(q)))[0], self.positions_of(np.arange(len(q)))[1]
        joints, modes = self.rates_of(v)
        dq = np.zeros(len(q))
        for link, at, rate in zip(self.tree.links, pieces, joints, strict=True):
            if link.joint in (SPHERICAL, FREE):
                dq[at[:-4]] = rate[:-3]
                dq[at[-4:]] = 0.5 * product(q[at[-4:]], np.r_[rate[-3:], 0.0])
            else:
                dq[at] = rate
        for at, rate in zip(modal, modes, strict=True):
            dq[at] = rate
        return dq

    def moved(self, q: Array, v: Array, t: float) -> Array:
        """Positions after a time t at constant rates."""
        pieces = self.positions_of(np.arange(len(q)))[0]
        joints = self.rates_of(v)[0]
        to = q + t * self.derivative(q, v)
        for link, at, rate in zip(self.tree.links, pieces, joints, strict=True):
            if link.joint in (SPHERICAL, FREE):
                turn = 0.5 * t * rate[-3:]
                size = np.linalg.norm(turn)
                to[at[-4:]] = product(q[at[-4:]], np.r_[np.sinc(size / np.pi) * turn, np.cos(size)])
        return to

    def velocities(self, q: Array, v: Array) -> Array:
        """Velocities of all points, shape (n_points, 3), by a complex step: exact to round-off."""
        return self.points(q + 1e-30j * self.derivative(q, v)).imag / 1e-30

    def jacobian(self, q: Array) -> Array:
        """Velocities of all points for unit rates, shape (n_points, 3, n)."""
        return np.stack([self.velocities(q, unit) for unit in np.eye(self.tree.n)], axis=-1)

    def bias(self, q: Array, v: Array, step: float = 0.01) -> Array:
        """Accelerations of all points at constant rates, by central differences of order 8, shape (n_points, 3)."""
        total = 0.0
        for k, weight in enumerate((4 / 5, -1 / 5, 4 / 105, -1 / 280), start=1):
            ahead, behind = (self.velocities(self.moved(q, v, t), v) for t in (k * step, -k * step))
            total = total + weight * (ahead - behind) / step
        return np.asarray(total)

    def loads(self, q: Array, v: Array) -> Array:
        """Generalised forces of springs, dampers, loads and modes, shape (n,).

        What acts along a revolute joint works on the section that it grips, which turns with the body's modes.
        """
        joints, modes = self.positions_of(q)
        joint_rates, modal_rates = self.rates_of(v)
        places, modal_places = self.rates_of(np.arange(len(v)))
        Q = np.zeros(len(v))
        for k, link in enumerate(self.tree.links):
            s, inner, ds, d_inner = joints[k], modes[k], joint_rates[k], modal_rates[k]
            Q[modal_places[k]] -= link.omega**2 * inner
            Q[modal_places[k]] -= 2 * link.damping * link.omega * d_inner if len(link.damping) else 0.0
            if link.joint in (REVOLUTE, PRISMATIC):
                section = link.joint_rotation if len(link.joint_rotation) else np.zeros(len(inner))
                along = link.load.value(0.0)[0] - link.spring * (s[0] + section @ inner - link.rest)
                along -= link.damper * (ds[0] + section @ d_inner)
                Q[places[k]] += along
                Q[modal_places[k]] += section * along
        return Q

    def stiffness(self) -> Array:
        """Minus the slope of the loads by joints and modes, shape (n, n): they are linear, so a difference is exact."""
        n_positions, still = self.tree.n_positions, np.zeros(self.tree.n)
        places, modal_places = self.positions_of(np.arange(n_positions))
        rates, modal_rates = self.rates_of(np.arange(self.tree.n))
        K = np.zeros((self.tree.n, self.tree.n))
        at_rest = self.loads(np.zeros(n_positions), still)
        for place, rate in zip([*places, *modal_places], [*rates, *modal_rates], strict=True):
            for i, j in zip(place, rate, strict=True) if len(place) == len(rate) else ():
                K[:, j] = at_rest - self.loads(np.eye(n_positions)[i], still)
        return K

    def potential(self, q: Array) -> float:
        """Energy of springs, modes and weight."""
        joints, modes = self.positions_of(q)
        total = -float(self.masses @ self.points(q) @ self.tree.gravity)
        for link, s, inner in zip(self.tree.links, joints, modes, strict=True):
            total += 0.5 * float(np.sum((link.omega * inner) ** 2))
            if link.spring:
                section = link.joint_rotation @ inner if len(link.joint_rotation) else 0.0
                total += 0.5 * link.spring * float(s[0] + section - link.rest) ** 2
        return total

    def kinetic(self, q: Array, v: Array) -> float:
        return 0.5 * float(self.masses @ np.sum(self.velocities(q, v) ** 2, axis=1))

    def momenta(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Linear momentum and angular momentum about the origin."""
        p = self.masses[:, None] * self.velocities(q, v)
        return p.sum(axis=0), np.cross(self.points(q), p).sum(axis=0)

    def state(self, seed: int, amplitude: float = 0.5) -> tuple[Array, Array]:
        """Random positions and rates; rotations in space are any, modal coordinates small."""
        rng = np.random.default_rng(seed)
        q, v = amplitude * rng.normal(size=self.tree.n_positions), amplitude * rng.normal(size=self.tree.n)
        for link, at in zip(self.tree.links, self.positions_of(np.arange(len(q)))[0], strict=True):
            if link.joint in (SPHERICAL, FREE):
                e = rng.normal(size=4)
                q[at[-4:]] = e / np.linalg.norm(e)
        return q, v

    def turned(self, R: Array, shift: Array) -> "PointChain":
        """Describe the same chain in axes turned by R, for each body, about a ground moved by ``shift``."""
        links, x = [], tuple(points @ R.T for points in self.x)
        Phi = tuple(np.einsum("ab,ibk->iak", R, shapes) for shapes in self.Phi)
        for link, points, masses, shapes in zip(self.tree.links, x, self.m, Phi, strict=True):
            at, integrals = link.place, inertia_integrals(points, np.diag(masses), shapes)
            moved = R @ at.position + (shift if link.parent < 0 else 0.0)
            place = MarkerShapes(moved, R @ at.translation, R @ at.rotation)
            links.append(replace(link, integrals=integrals, place=place, axis=R @ link.axis))
        return PointChain(Mechanism(links, self.tree.fast_joints, R @ self.tree.gravity), x, self.m, Phi)

    def turned_state(self, R: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """State of the chain that `turned` gives, in the same motion."""
        q, v = q.copy(), v.copy()
        places, rates = (split(np.arange(len(of)))[0] for split, of in ((self.positions_of, q), (self.rates_of, v)))
        for link, place, rate in zip(self.tree.links, places, rates, strict=True):
            if link.joint in (SPHERICAL, FREE):
                q[place[-4:-1]] = R @ q[place[-4:-1]]
                q[place[:-4]], v[rate[:-3]] = (
                    R @ part if part.size else part for part in (q[place[:-4]], v[rate[:-3]])
                )
                v[rate[-3:]] = R @ v[rate[-3:]]
        return q, v

    def with_links(self, **changes: object) -> "PointChain":
        """Change the same fields of every link that has them: none of springs, dampers, loads …"""
        links = [replace(link, **changes) for link in self.tree.links]  # type: ignore[arg-type]
        return replace(self, tree=replace(self.tree, links=links))

    def with_sections(self, scale: float) -> "PointChain":
        """Scale how far the sections at revolute joints turn with the modes."""
        links = [replace(link, joint_rotation=scale * link.joint_rotation) for link in self.tree.links]
        return replace(self, tree=replace(self.tree, links=links))


def random_points(n_modes: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Twelve points, their masses and shapes of unit modal mass."""
    x, m = rng.normal(size=(12, 3)), rng.uniform(0.1, 0.5, 12)
    Phi = rng.normal(size=(36, n_modes))
    L = np.linalg.cholesky(Phi.T @ (np.repeat(m, 3)[:, None] * Phi))
    return x, m, np.linalg.solve(L, Phi.T).T.reshape(12, 3, n_modes)


@cache
def random_chain(name: str, seed: int = 0, gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> PointChain:
    """One of `CHAINS` with everything a link may have: springs, dampers, loads, modal damping, moving sections."""
    kinds, parents, sizes = CHAINS[name]
    rng = np.random.default_rng([seed, *name.encode()])
    bodies = [random_points(n, rng) for n in sizes]
    links = []
    for k, (joint, parent, n) in enumerate(zip(kinds, parents, sizes, strict=True)):
        x, m, Phi = bodies[k]
        if n:
            integrals = inertia_integrals(x, np.diag(m), Phi)
        else:  # the way of rigid bodies: mass, centre and inertia about it
            centre = m @ x / m.sum()
            arms = x - centre
            integrals = rigid_integrals(
                float(m.sum()), centre, np.sum(arms**2 * m[:, None]) * np.eye(3) - (arms.T * m) @ arms
            )
        of_parent = sizes[parent] if parent >= 0 else 0
        scalar = joint in (REVOLUTE, PRISMATIC)
        place, axis = rng.normal(size=3), rng.normal(size=3)  # of any length
        omega, damping = rng.uniform(3.0, 9.0, n), rng.uniform(0.02, 0.1, n)
        inner = 0.3 * rng.normal(size=(3, of_parent)), 0.5 * rng.normal(size=(3, of_parent))
        links.append(
            Link(
                f"body {k}",
                integrals,
                joint,
                parent,
                place=MarkerShapes(place, *inner),
                axis=axis,
                omega=omega,
                damping=damping,
                joint_rotation=0.3 * rng.normal(size=n if joint == REVOLUTE else 0),
                spring=rng.uniform(2.0, 4.0) if scalar else 0.0,
                rest=rng.uniform(0.1, 0.3) if scalar else 0.0,
                damper=rng.uniform(0.1, 0.3) if scalar else 0.0,
                load=constant(rng.uniform(0.5, 1.0) if scalar else 0.0),
            )
        )
    fast = [link.name for link in links if link.joint == PRISMATIC]
    x, m, Phi = (tuple(body[i] for body in bodies) for i in range(3))
    return PointChain(Mechanism(links, fast, np.array(gravity)), x, m, Phi)


# The flexible one on a free joint takes no way that the rigid one on it and the others don't; for long it is there.
NAMES = [pytest.param(name, marks=[pytest.mark.long] * (name == "free-flexible")) for name in CHAINS]


@pytest.fixture(scope="session", params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    """Each kind of chain in turn."""
    return str(request.param)


@pytest.fixture(scope="session", params=WITHOUT_SUPPORT)
def free_name(request: pytest.FixtureRequest) -> str:
    """Each kind of chain that nothing holds."""
    return str(request.param)


@pytest.fixture(scope="session")
def chain() -> Callable[..., PointChain]:
    return random_chain
