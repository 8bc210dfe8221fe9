"""An open chain of rigid and flexible bodies: what the kernels of `tree_kernels` read.

Bodies form a tree of joints. The coordinates are those of the joints and of the modes alone, the independent
coordinates of eq. (4) of Miao et al. (2008): nothing else appears, so no constraint can drift.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from pipeline.checks import Array, IntArray
from pipeline.reduction.gram import InertiaGram

FIXED, REVOLUTE, PRISMATIC, SPHERICAL, FREE = range(5)
N_RATES = (0, 1, 1, 3, 6)
N_POSITIONS = (0, 1, 1, 4, 7)


@dataclass(frozen=True)
class Link:
    """A body with the joint that carries it; rigid if it has no modes.

    Parameters
    ----------
    name : str
        The body's name.
    gram : InertiaGram
        Inertia integrals about the joint, in the body's frame, for unit modal masses.
    joint : int
        ``FIXED``, ``REVOLUTE``, ``PRISMATIC``, ``SPHERICAL`` or ``FREE``.
    parent : int
        Number of the body that carries it, -1 for the ground; smaller than its own.
    place : ndarray, shape (3,)
        The joint in the parent's frame [m].
    axis : ndarray, shape (3,)
        Unit vector of a revolute or prismatic joint, in both bodies' frames at angle 0.
    omega : ndarray, shape (n,)
        Modal angular frequencies [rad/s].
    damping : ndarray, shape (n,)
        Modal damping ratios.
    place_shapes, place_rotations : ndarray, shape (3, n_parent)
        Displacement and rotation of the joint's place for unit modal coordinates of the parent.
    joint_rotation : ndarray, shape (n,)
        Rotation of the body's own section at a revolute joint about its axis, for unit modal coordinates.
    spring, rest, damper : float
        Of a revolute or prismatic joint [N m/rad or N/m; rad or m; N m s/rad or N s/m].
    load : float
        Constant torque or force along the joint [N m or N].
    """

    name: str
    gram: InertiaGram
    joint: int
    parent: int = -1
    place: Array = field(default_factory=lambda: np.zeros(3))
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    omega: Array = field(default_factory=lambda: np.zeros(0))
    damping: Array = field(default_factory=lambda: np.zeros(0))
    place_shapes: Array = field(default_factory=lambda: np.zeros((3, 0)))
    place_rotations: Array = field(default_factory=lambda: np.zeros((3, 0)))
    joint_rotation: Array = field(default_factory=lambda: np.zeros(0))
    spring: float = 0.0
    rest: float = 0.0
    damper: float = 0.0
    load: float = 0.0


def rigid_gram(mass: float, centre: Array, inertia: Array) -> InertiaGram:
    """Inertia integrals of a rigid body.

    Parameters
    ----------
    mass : float
        [kg]
    centre : ndarray, shape (3,)
        Centre of mass in the body's frame [m].
    inertia : ndarray, shape (3, 3)
        Inertia tensor about the centre of mass [kg m²].
    """
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia + mass * np.outer(centre, centre)
    return InertiaGram(second[:, :, None, None].copy(), mass * np.reshape(centre, (3, 1)), mass)


class TreeParameters(NamedTuple):
    """Flat arrays for the kernels; the last ones are room to work in."""

    parent: IntArray
    joint: IntArray
    rate: IntArray  # first rate of each joint
    position: IntArray  # first position of each joint
    mode: IntArray  # first modal rate of each body
    n_modes: IntArray
    shift: int  # modal position = modal rate + shift
    place: Array  # (n_bodies, 3)
    axis: Array  # (n_bodies, 3)
    place_shapes: Array  # (n_bodies, 3, most modes): of the parent
    place_rotations: Array
    joint_rotation: Array  # (n_bodies, most modes)
    G: Array  # (n_bodies, 3, 3, 1 + most modes, 1 + most modes)
    S: Array  # (n_bodies, 3, 1 + most modes)
    mass: Array
    stiffness: Array  # (n,) by rate: spring or ω²
    K: Array  # (n, n): the same, with springs that grip a section which turns with its body's modes
    C: Array  # (n, n): damping likewise
    damped: bool
    rest: Array  # (n,)
    damping: Array  # (n,)
    load: Array  # (n,)
    gravity: Array
    scalar_position: IntArray  # (n,) position of each scalar coordinate, -1 for a rate of a rotation in space
    origin: Array  # (n_bodies, 3)
    R: Array  # (n_bodies, 3, 3)
    spin: Array  # (n_bodies, 3)
    bias: Array  # (n_bodies, 6): acceleration of frame and rotation with no rate accelerating
    J: Array  # (n_bodies, 6, n)
    R0: Array  # (3, 3)
    M: Array  # (n, n)
    L: Array  # (n, n)
    Q: Array  # (n,)
    body: Array  # (8, most modes + 13)


class FrozenTree(NamedTuple):
    """The fast coordinates over a major cycle: ``a_S = constant − B q_S − D v_S``."""

    constant: Array  # (n,), the slow ones unused
    B: Array  # (n_fast, n_fast)
    D: Array  # (n_fast, n_fast)
    column: Array  # (n,), room to work in


@dataclass(frozen=True)
class Tree:
    """A mechanism of links, as the integrators see it.

    Rates are ordered by what is slow: first those named slow, then the rest, in the order joint by joint, then mode
    by mode.

    Parameters
    ----------
    links : sequence of Link
        Each after its parent.
    fast_joints : sequence of str
        Bodies whose scalar joint coordinate is fast; modal coordinates always are.
    gravity : ndarray, shape (3,)
        [m/s²]

    Raises
    ------
    ValueError
        Names are missing or not unique, a link comes before its parent, an axis has no direction, or a fast joint is
        not a revolute or prismatic one.
    """

    links: Sequence[Link]
    fast_joints: Sequence[str] = ()
    gravity: Array = field(default_factory=lambda: np.zeros(3))

    coupled = True
    breakpoints = ()

    def __post_init__(self) -> None:
        names = [link.name for link in self.links]
        if not names or len(set(names)) < len(names):
            raise ValueError(f"links need names of their own, and one link at least: {names}")
        if unknown := set(self.fast_joints) - set(names):
            raise ValueError(f"fast_joints names no link: {', '.join(sorted(unknown))}")
        for k, link in enumerate(self.links):
            if not -1 <= link.parent < k:
                raise ValueError(f"link {link.name} comes before its parent")
            if not np.linalg.norm(link.axis) > 0.0:
                raise ValueError(f"the axis of {link.name} has no direction")
            if link.name in self.fast_joints and N_RATES[link.joint] != 1:
                raise ValueError(f"the joint of {link.name} can't be fast: it is not revolute or prismatic")

    @cached_property
    def layout(self) -> tuple[IntArray, IntArray, IntArray, int]:
        """First rate and first position of each joint, first rate of each body's modes, number of slow rates."""
        rate, position, mode = (np.zeros(len(self.links), dtype=np.int64) for _ in range(3))
        next_rate = next_position = n_slow = 0
        for fast in (False, True):
            for k, link in enumerate(self.links):
                if (link.name in self.fast_joints) is fast:
                    rate[k], position[k] = next_rate, next_position
                    next_rate += N_RATES[link.joint]
                    next_position += N_POSITIONS[link.joint]
            if not fast:
                n_slow = next_rate
        for k, link in enumerate(self.links):
            mode[k] = next_rate
            next_rate += len(link.omega)
        return rate, position, mode, n_slow

    @property
    def n_slow(self) -> int:
        """Number of slow rates."""
        return self.layout[3]

    @property
    def n(self) -> int:
        """Number of rates."""
        return sum(N_RATES[link.joint] + len(link.omega) for link in self.links)

    @property
    def n_positions(self) -> int:
        """Number of position coordinates."""
        return sum(N_POSITIONS[link.joint] + len(link.omega) for link in self.links)

    @property
    def rest_positions(self) -> Array:
        """Positions of the undeformed mechanism with all joints at 0, shape (n_positions,)."""
        q = np.zeros(self.n_positions)
        for link, first in zip(self.links, self.layout[1], strict=True):
            if link.joint in (SPHERICAL, FREE):
                q[first + N_POSITIONS[link.joint] - 1] = 1.0  # a unit quaternion, its scalar part last
        return q

    @property
    def parameters(self) -> TreeParameters:
        """Flat arrays for the kernels, with room to work in that is the caller's own."""
        import pipeline.dynamics.tree_solve  # noqa: F401 - gives the functions of `system` their meaning for trees

        n, n_bodies = self.n, len(self.links)
        most = max(len(link.omega) for link in self.links)
        return self._parameters._replace(
            origin=np.zeros((n_bodies, 3)),
            R=np.zeros((n_bodies, 3, 3)),
            spin=np.zeros((n_bodies, 3)),
            bias=np.zeros((n_bodies, 6)),
            J=np.zeros((n_bodies, 6, n)),
            R0=np.zeros((3, 3)),
            M=np.zeros((n, n)),
            L=np.zeros((n, n)),
            Q=np.zeros(n),
            body=np.zeros((8, most + 13)),
        )

    @cached_property
    def _parameters(self) -> TreeParameters:
        links, n = self.links, self.n
        rate, position, mode, _ = self.layout
        most = max(len(link.omega) for link in links)
        n_bodies = len(links)
        shift = self.n_positions - n
        padded = {
            "place_shapes": np.zeros((n_bodies, 3, most)),
            "place_rotations": np.zeros((n_bodies, 3, most)),
            "joint_rotation": np.zeros((n_bodies, most)),
            "G": np.zeros((n_bodies, 3, 3, 1 + most, 1 + most)),
            "S": np.zeros((n_bodies, 3, 1 + most)),
        }
        by_rate = {name: np.zeros(n) for name in ("stiffness", "rest", "damping", "load")}
        scalar_position = np.full(n, -1, dtype=np.int64)
        K, C = np.zeros((n, n)), np.zeros((n, n))
        for k, link in enumerate(links):
            own, others = len(link.omega), link.place_shapes.shape[1]
            padded["place_shapes"][k, :, :others] = link.place_shapes
            padded["place_rotations"][k, :, :others] = link.place_rotations
            padded["joint_rotation"][k, : len(link.joint_rotation)] = link.joint_rotation
            padded["G"][k, :, :, : 1 + own, : 1 + own] = link.gram.G
            padded["S"][k, :, : 1 + own] = link.gram.S
            if N_RATES[link.joint] == 1:
                i = rate[k]
                scalar_position[i] = position[k]
                by_rate["stiffness"][i], by_rate["rest"][i] = link.spring, link.rest
                by_rate["damping"][i], by_rate["load"][i] = link.damper, link.load
            if link.joint == FREE:
                scalar_position[rate[k] : rate[k] + 3] = np.arange(position[k], position[k] + 3)
            modes = slice(mode[k], mode[k] + own)
            scalar_position[modes] = np.arange(mode[k], mode[k] + own) + shift
            by_rate["stiffness"][modes] = link.omega**2
            K[modes, modes] += np.diag(link.omega**2)
            if N_RATES[link.joint] == 1:
                grip = np.zeros(n)  # what stretches the spring: the joint, and the section's turning with the modes
                grip[rate[k]] = 1.0
                if link.joint == REVOLUTE:
                    grip[mode[k] : mode[k] + len(link.joint_rotation)] = link.joint_rotation
                K += link.spring * np.outer(grip, grip)
                C += link.damper * np.outer(grip, grip)
            if len(link.damping):
                by_rate["damping"][modes] = 2.0 * link.damping * link.omega
                C[modes, modes] += np.diag(2.0 * link.damping * link.omega)
        nothing = np.zeros(0)
        return TreeParameters(
            parent=np.array([link.parent for link in links], dtype=np.int64),
            joint=np.array([link.joint for link in links], dtype=np.int64),
            rate=rate,
            position=position,
            mode=mode,
            n_modes=np.array([len(link.omega) for link in links], dtype=np.int64),
            shift=shift,
            place=np.array([link.place for link in links], dtype=float),
            axis=np.array([link.axis / np.linalg.norm(link.axis) for link in links]),
            mass=np.array([link.gram.mass for link in links]),
            K=K,
            C=C,
            damped=bool(C.any()),
            gravity=np.asarray(self.gravity, dtype=float),
            scalar_position=scalar_position,
            origin=nothing,
            R=nothing,
            spin=nothing,
            bias=nothing,
            J=nothing,
            R0=nothing,
            M=nothing,
            L=nothing,
            Q=nothing,
            body=nothing,
            **padded,
            **by_rate,
        )

    def frozen(self) -> FrozenTree:
        """Fresh storage for the frozen coefficients of a major cycle."""
        n = self.n - self.n_slow
        return FrozenTree(np.zeros(self.n), np.zeros((n, n)), np.zeros((n, n)), np.zeros(self.n))

    @property
    def stiffness(self) -> Array:
        """Squared modal frequencies, and springs over what they move in the undeformed mechanism [1/s²]."""
        return self._parameters.stiffness / self.mass_matrix(self.rest_positions).diagonal()

    def mass_matrix(self, q: Array) -> Array:
        """M̂ at positions q, shape (n, n)."""
        from pipeline.dynamics.tree_kernels import mass_and_force

        parameters = self.parameters
        mass_and_force(parameters, 0.0, q, np.zeros(self.n))
        return parameters.M.copy()

    @property
    def highest_frequency(self) -> float:
        """Highest coupled angular frequency in the reference state [rad/s]."""
        return self._highest(slice(0, None))

    @property
    def highest_fast_frequency(self) -> float:
        """Highest angular frequency of the fast coordinates with the slow ones held [rad/s]."""
        return self._highest(slice(self.n_slow, None))

    @property
    def highest_slow_frequency(self) -> float:
        """Highest angular frequency of the slow coordinates with the fast ones held [rad/s]."""
        return self._highest(slice(0, self.n_slow))

    def _highest(self, part: slice) -> float:
        M = self.mass_matrix(self.rest_positions)[part, part]
        K = self._parameters.K[part, part]
        return float(np.sqrt(max(eigh(K, M, eigvals_only=True)[-1], 1e-300))) if len(M) else 1e-150

    def energies(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Kinetic and potential energy (strain, springs, gravity) [J] of states q (n_times, …), v (n_times, n)."""
        parameters = self.parameters
        from pipeline.dynamics.tree_kernels import mass_and_force

        kinetic, potential = np.empty(len(q)), np.empty(len(q))
        for i in range(len(q)):
            mass_and_force(parameters, 0.0, q[i], v[i])
            kinetic[i] = 0.5 * v[i] @ parameters.M @ v[i]
            potential[i] = 0.0
            for b, link in enumerate(self.links):
                modal = q[i, parameters.mode[b] + parameters.shift + np.arange(len(link.omega))]
                potential[i] += 0.5 * link.omega**2 @ modal**2
                if link.spring:
                    stretch = q[i, parameters.position[b]] - link.rest
                    stretch += (
                        link.joint_rotation @ modal if link.joint == REVOLUTE and len(link.joint_rotation) else 0.0
                    )
                    potential[i] += 0.5 * link.spring * stretch**2
                first_moment = link.gram.S @ np.r_[1.0, modal]
                moment = link.gram.mass * parameters.origin[b] + parameters.R[b] @ first_moment
                potential[i] -= parameters.gravity @ moment
        return kinetic, potential

    def frames(self, q: Array) -> Mapping[str, tuple[Array, Array]]:
        """Origin (3,) and rotation (3, 3) of each body's frame in space at positions q."""
        from pipeline.dynamics.tree_kernels import mass_and_force

        parameters = self.parameters
        mass_and_force(parameters, 0.0, q, np.zeros(self.n))
        pairs = zip(parameters.origin.copy(), parameters.R.copy(), strict=True)
        return {link.name: pair for link, pair in zip(self.links, pairs, strict=True)}
