"""A mechanism of rigid and flexible bodies: the one description from which its kernels and results are made.

Bodies form a tree of joints. The coordinates are those of the joints and of the modes alone, the independent
coordinates of eq. (4) of Miao et al. (2008): nothing else appears, so no constraint can drift.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.core.errors import AccuracyError
from pipeline.dynamics.links import FREE, SPHERICAL, Link, PointLoad
from pipeline.dynamics.signals.activity import Activity, find_activity
from pipeline.dynamics.signals.signal import Signal
from pipeline.dynamics.tree.arrays import FrozenTree, Layout, MiddleTree, TreeParameters, layout_of, packed, with_room
from pipeline.dynamics.vibration import highest_frequency
from pipeline.reduction.inertia import InertiaGram

_STEADY = 1e-10
_STEADY_STEPS = 30


@dataclass(frozen=True)
class Mechanism:
    """Bodies with the joints that carry them, as a system that the integrators march.

    Rates are ordered by what is slow: slow joints, slow modes, fast joints, fast modes.

    Parameters
    ----------
    links : sequence of Link
        Each after its parent.
    fast_joints : sequence of str
        Bodies whose scalar joint coordinate is fast.
    gravity : ndarray, shape (3,)
        [m/s²]
    loads : sequence of PointLoad
        Forces and torques at points.
    slow_modes : mapping of str to int
        How many modes of a body, the lowest, are slow; none by default.
    horizon : float
        Time [s] up to which loads are searched for short actions that adaptive steps must not miss; 0 searches none.

    Raises
    ------
    ValueError
        Names are missing or not unique, a link doesn't fit its parent, or a fast joint is not a revolute or prismatic
        one with a coordinate.
    """

    links: Sequence[Link]
    fast_joints: Sequence[str] = ()
    gravity: Array = field(default_factory=lambda: np.zeros(3))
    loads: Sequence[PointLoad] = ()
    slow_modes: Mapping[str, int] = field(default_factory=dict)
    horizon: float = 0.0

    holds_forces = True

    def __post_init__(self) -> None:
        links = {link.name: link for link in self.links}
        if not links or len(links) < len(self.links):
            raise ValueError(f"links need names of their own, and one link at least: {list(links)}")
        named = {*self.fast_joints, *self.slow_modes, *(at.body for at in self.loads)}
        if unknown := named - set(links):
            raise ValueError(f"no link is named {', '.join(sorted(unknown))}")
        for k, link in enumerate(self.links):
            link.require_valid(k, len(self.links[link.parent].omega) if 0 <= link.parent < k else 0)
            if link.name in self.fast_joints and link.n_rates != 1:
                raise ValueError(f"the joint of {link.name} can't be fast: it has no one coordinate")
            if not 0 <= self.slow_modes.get(link.name, 0) <= len(link.omega):
                raise ValueError(f"{link.name} has {len(link.omega)} modes, fewer than are to be slow")

    @cached_property
    def layout(self) -> Layout:
        """Where each joint's and each body's coordinates are."""
        return layout_of(self.links, self.fast_joints, [self.slow_modes.get(link.name, 0) for link in self.links])

    @property
    def n_slow(self) -> int:
        """Number of slow rates."""
        return self.layout.n_slow

    @property
    def n(self) -> int:
        """Number of rates."""
        return self.layout.n

    @property
    def n_positions(self) -> int:
        """Number of position coordinates."""
        return self.layout.n_positions

    @property
    def rest_positions(self) -> Array:
        """Positions of the undeformed mechanism with all joints at 0, shape (n_positions,)."""
        q = np.zeros(self.n_positions)
        for link, first in zip(self.links, self.layout.position, strict=True):
            if link.joint in (SPHERICAL, FREE):
                q[first + link.n_positions - 1] = 1.0  # a unit quaternion, its scalar part last
        return q

    @cached_property
    def coupled(self) -> bool:
        """True if coordinates couple through M̂; modes of bodies that carry nothing that moves don't."""
        joints = any(link.n_rates for link in self.links)
        return joints or any(link.parent >= 0 and len(self.links[link.parent].omega) for link in self.links)

    @cached_property
    def groups(self) -> tuple[IntArray, IntArray]:
        """Group of like coordinates that each position and each rate belongs to: one for each joint and each body."""
        positions, rates = np.zeros(self.n_positions, dtype=np.int64), np.zeros(self.n, dtype=np.int64)
        for k, link in enumerate(self.links):
            at, first = self.layout.rate[k], self.layout.position[k]
            moves = 3 if link.joint == FREE else 0  # translation and rotation of a free joint are not alike
            rates[at : at + link.n_rates], positions[first : first + link.n_positions] = 3 * k, 3 * k
            rates[at : at + moves], positions[first : first + moves] = 3 * k + 1, 3 * k + 1
            modes = self.modes_of(k)
            rates[modes], positions[modes + self.n_positions - self.n] = 3 * k + 2, 3 * k + 2
        return positions, rates

    @property
    def mass(self) -> float:
        """Mass of all bodies [kg]."""
        return float(sum(link.gram.mass for link in self.links))

    def number_of(self, body: str) -> int:
        """Number of the body of a name."""
        return next(k for k, link in enumerate(self.links) if link.name == body)

    def modes_of(self, body: int) -> IntArray:
        """Rates of a body's modal coordinates, lowest mode first."""
        return np.asarray(self.layout.mode[body, : len(self.links[body].omega)])

    @property
    def parameters(self) -> TreeParameters:
        """Flat arrays for the kernels, with room to work in that is the caller's own."""
        return with_room(self._ready)

    @cached_property
    def _ready(self) -> TreeParameters:
        """Parameters that know their kernels; looking those up takes longer than many a march."""
        from pipeline.dynamics.tree.solve import with_kernels

        return with_kernels(with_room(self._packed[0]))

    @cached_property
    def _packed(self) -> tuple[TreeParameters, tuple[Signal, ...]]:
        return packed(self.links, self.loads, self.layout, self.gravity)

    @cached_property
    def breakpoints(self) -> tuple[float, ...]:
        """Times at which a load or a motion jumps, has a kink or begins to vary much faster [s], ascending."""
        known = {time for signal in self._packed[1] for time in signal.breakpoints}
        return tuple(sorted(known.union(*(activity.events for activity in self.activities))))

    @cached_property
    def activities(self) -> tuple[Activity, ...]:
        """When each load and each motion that isn't constant acts, up to the horizon."""
        if not self.horizon > 0.0:
            return ()
        loads = [*(link.load for link in self.links), *(load.size for load in self.loads)]
        motions = [link.motion for link in self.links if link.motion is not None]
        varying = [(signal, 0) for signal in loads] + [(signal, 2) for signal in motions]
        return tuple(
            find_activity(signal, self.horizon, derivative) for signal, derivative in varying if not signal.is_constant
        )

    def frozen(self) -> FrozenTree:
        """Fresh storage for the frozen coefficients of a major cycle."""
        constant, v_now = np.zeros((2, self.n))
        return replace(self._frozen, constant=constant, single=np.zeros(1), v_now=v_now, L=np.zeros((self.n, self.n)))

    @cached_property
    def _frozen(self) -> FrozenTree:
        from pipeline.dynamics.tree.solve import frozen_with_kernels

        p, v, L = self._packed[0], np.zeros(self.n), np.zeros((self.n, self.n))
        return frozen_with_kernels(FrozenTree(0, self.n_slow, v, np.zeros(1), v, p.K, p.C, L))

    def middle(self) -> MiddleTree:
        """Fresh storage for what a major cycle's middle holds."""
        import pipeline.dynamics.tree.middle  # noqa: F401 - gives the functions of `system` their meaning for trees

        Q, q, v = np.zeros((3, self.n))
        L, T, K, C, fast_K, fast_C = np.zeros((6, self.n, self.n))
        carried, room = np.zeros((len(self.links), self.n, 9)), np.zeros((9, 12))
        return MiddleTree(replace(self.frozen(), K=fast_K, C=fast_C), L, Q, T, K, C, carried, room, q, v)

    @property
    def stiffness(self) -> Array:
        """Squared modal frequencies, and springs over what they move in the undeformed mechanism [1/s²]."""
        return self._packed[0].stiffness / self.mass_matrix(self.rest_positions).diagonal()

    @property
    def frequencies_hz(self) -> Array:
        """Of each mode and of each joint by itself, undeformed [Hz], shape (n,); 0 where nothing holds it."""
        own = np.sqrt(self.linear_stiffness.diagonal() / self.mass_matrix(self.rest_positions).diagonal())
        for k, link in enumerate(self.links):
            own[self.modes_of(k)] = link.omega
        return np.asarray(own / (2 * np.pi))

    @property
    def linear_stiffness(self) -> Array:
        """Stiffness of modes and springs, shape (n, n)."""
        return self._packed[0].K

    @property
    def linear_damping(self) -> Array:
        """Damping of modes and joints, shape (n, n)."""
        return self._packed[0].C

    @property
    def linear_matrices(self) -> tuple[Array, Array, Array]:
        """Mass, stiffness and damping of the undeformed mechanism, (n, n) each."""
        return self.mass_matrix(self.rest_positions), self.linear_stiffness, self.linear_damping

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """M̂ at positions q, shape (n, n)."""
        return _symmetric(self._evaluated(t, q, np.zeros(self.n)).M)

    def _evaluated(self, t: float, q: Array, v: Array) -> TreeParameters:
        from pipeline.dynamics.tree.kernels import mass_and_force

        parameters = self.parameters
        mass_and_force(parameters, t, q, v)
        return parameters

    @property
    def highest_frequency(self) -> float:
        """Highest coupled angular frequency in the reference state [rad/s]."""
        return self._highest(slice(0, None))

    @property
    def highest_fast_frequency(self) -> float:
        """Highest angular frequency of the fast coordinates with the slow ones held [rad/s]."""
        return self._highest(slice(self.n_slow, None))

    @property
    def highest_reacting_frequency(self) -> float:
        """Highest angular frequency of the fast coordinates with ``q_L + M_LL⁻¹ M_LS q_S`` held [rad/s]."""
        slow, fast = slice(0, self.n_slow), slice(self.n_slow, None)
        M = self.mass_matrix(self.rest_positions)
        T = np.concatenate([-np.linalg.solve(M[slow, slow], M[slow, fast]), np.eye(self.n - self.n_slow)])
        return highest_frequency(T.T @ M @ T, T.T @ self.linear_stiffness @ T)

    @property
    def highest_slow_frequency(self) -> float:
        """Highest angular frequency of the slow coordinates with the fast ones held [rad/s]."""
        return self._highest(slice(0, self.n_slow))

    def _highest(self, part: slice) -> float:
        return highest_frequency(self.mass_matrix(self.rest_positions)[part, part], self.linear_stiffness[part, part])

    @cached_property
    def released(self) -> Mechanism:
        """Mechanism whose prescribed joints are free to move, from which their reactions are found."""
        return replace(self, links=[replace(link, motion=None) for link in self.links])

    def in_released(self, times: Array, q: Array, v: Array, a: Array | None = None) -> tuple[Array, Array, Array]:
        """Positions, rates and accelerations of `released`, (n_times, …) each, at states of this mechanism."""
        free, n_times = self.released, len(q)
        positions, rates, accelerations = (np.zeros((n_times, n)) for n in (free.n_positions, free.n, free.n))
        pairs = [(v, rates), (np.zeros_like(v) if a is None else a, accelerations)]
        for k, (link, other) in enumerate(zip(self.links, free.links, strict=True)):
            at, to = self.layout.position[k], free.layout.position[k]
            i, j = self.layout.rate[k], free.layout.rate[k]
            if link.motion is not None:
                motion = link.motion.values(times)
                positions[:, to], rates[:, j], accelerations[:, j] = motion.T
            else:
                positions[:, to : to + other.n_positions] = q[:, at : at + link.n_positions]
                for given, out in pairs:
                    out[:, j : j + other.n_rates] = given[:, i : i + link.n_rates]
            modes, new = self.modes_of(k), free.modes_of(k)
            positions[:, new + free.n_positions - free.n] = q[:, modes + self.n_positions - self.n]
            for given, out in pairs:
                out[:, new] = given[:, modes]
        return positions, rates, accelerations

    def steady(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Positions (n_positions,) with the modes where rates v and loads at t [s] leave them at rest in their frames.

        Raises
        ------
        AccuracyError
            There is no such state: something turns too fast for its stiffness.
        """
        from pipeline.dynamics.tree.solve import solve_accelerations

        modes = np.concatenate([self.modes_of(k) for k in range(len(self.links))])
        at = modes + self.n_positions - self.n
        q, parameters = q.copy(), self.parameters

        def left(values: Array) -> Array:
            q[at], a = values, np.zeros(self.n)
            solve_accelerations(parameters, t, q, v, a)
            return np.asarray(a[modes])

        found, size = q[at].copy(), 0.0
        for _ in range(_STEADY_STEPS):
            lack = left(found)
            # The equations are almost linear in the modes: a difference of their own size has no error to speak of.
            step = 1e-3 * max(np.abs(found).max(initial=0.0), 1e-6)
            slopes = np.stack([left(found + step * unit) - lack for unit in np.eye(len(found))], axis=1) / step
            change = np.linalg.solve(slopes, lack)
            found, size = found - change, float(np.linalg.norm(change))
            if size <= _STEADY * np.linalg.norm(found):
                break
        stable = np.linalg.eigvals(slopes).real.max(initial=-1.0) < 0
        if not (stable and size <= _STEADY * np.linalg.norm(found)):
            raise AccuracyError(
                f"no steady state: the modes still change by {size:.1e} after {_STEADY_STEPS} corrections, or a "
                "deflection grows by itself; the scene turns too fast for the bodies' stiffness"
            )
        q[at] = found
        return q

    def drive_loads(self, t: float, q: Array, v: Array) -> Mapping[str, float]:
        """Torque [N m] or force [N] that each prescribed joint needs at a state, by the name of the body it carries."""
        from pipeline.dynamics.tree.solve import solve_accelerations

        a = np.zeros(self.n)
        solve_accelerations(self.parameters, t, q, v, a)
        free = self.released
        (position,), (rate,), (acceleration,) = self.in_released(np.array([t]), q[None], v[None], a[None])
        found = free._evaluated(t, position, rate)
        lack = _symmetric(found.M) @ acceleration - found.Q
        return {
            link.name: float(lack[free.layout.rate[k]]) for k, link in enumerate(self.links) if link.motion is not None
        }

    @cached_property
    def rigid(self) -> Mechanism:
        """Mechanism in which no body deforms; its coordinates are those of the joints alone."""
        nothing, none = np.zeros(0), np.zeros((3, 0))
        links = [
            replace(
                link,
                gram=InertiaGram(link.gram.G[:, :, :1, :1], link.gram.S[:, :1], link.gram.mass),
                omega=nothing,
                damping=nothing,
                joint_rotation=nothing,
                place_shapes=none,
                place_rotations=none,
                markers={},
                section="",
            )
            for link in self.links
        ]
        loads = [replace(at, shapes=none, rotations=none) for at in self.loads]
        return Mechanism(links, self.fast_joints, self.gravity, loads, horizon=self.horizon)


def _symmetric(lower: Array) -> Array:
    """The whole of a symmetric matrix of which the lower triangle is there."""
    return np.tril(lower) + np.tril(lower, -1).T
