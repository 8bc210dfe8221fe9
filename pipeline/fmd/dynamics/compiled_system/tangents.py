"""A mechanism with eight tangents of its motion as one system, which explicit methods march as they do any other.

A tangent is how a motion changes with a number. A step that is made of accelerations and of sums of what it has takes
the tangents of states to those of the next ones, exactly: its own derivative, whatever the step's error.

Positions, rates and accelerations are the motion's own, filled up with zeros to whole lines of eight, and after them
those of the tangents, eight to each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.dynamics.compiled_system.kernels import quaternion_rate, take_leap
from fmd.dynamics.compiled_system.parameters import Leapfrog
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.compiler.signal_code import load_signals
from fmd.dynamics.signals.signal import Signal
from fmd.dynamics.step_bounds import StepBounds
from fmd.dynamics.system import accelerations, advance, leapfrog_step, velocities
from fmd.kernels.kernel import inlined
from fmd.kernels.library import call_native
from fmd.kernels.table import Table, aligned


@dataclass(frozen=True)
class Direction:
    """How a mechanism's equations and its start change with a number.

    Attributes
    ----------
    numbers : ndarray, shape (n_numbers,)
        Derivatives of what is a number in the equations, `CompiledMechanism.numbers`.
    signals : sequence of tuple
        Signals beside the mechanism's own, in their order, with weights: the weighted sums of their values are the
        derivatives of the mechanism's. Four sets at most; none where these stay as they are.
    q, v : ndarray, shapes (n_positions,) and (n,)
        Derivatives of positions and rates at the start.
    """

    numbers: Array
    signals: Sequence[tuple[tuple[Signal, ...], float]]
    q: Array
    v: Array


@dataclass(frozen=True)
class TangentParameters(Table):
    """A mechanism's accelerations and their tangents by their address, its signals and how these change."""

    accelerations: int  # addresses of the compiled functions
    signals: int
    n: int  # the motion's own rates
    n_lines: int  # as many and zeros, before the tangents
    n_position_lines: int
    inputs: Array  # (3 n_signals + n_numbers,)
    directions: Array  # (3 n_signals + n_numbers, 8): their tangents
    beside: IntArray  # (8, 4): addresses of signals beside the mechanism's own
    weights: Array  # (8, 4): of these in each tangent
    room: Array  # (3 n_signals + n_numbers,)
    n_inputs: int  # 3 n_signals
    clock: Array  # (2,): the time that the inputs are of, and one for which others are evaluated [s]
    position: IntArray  # (n,): position that each rate moves, -1 for a rotation in space
    quaternions: IntArray  # (n_rotations, 2): first rate and first position of each rotation in space


class TangentSystem:
    """A mechanism with up to eight tangents of its motion.

    Parameters
    ----------
    system : CompiledSystem
        The mechanism's own, one that `has_tangents`.
    directions : sequence of Direction
        Up to eight.
    """

    def __init__(self, system: CompiledSystem, directions: Sequence[Direction]) -> None:
        self._system, self._directions = system, directions
        self.breakpoints, self.settles = system.breakpoints, system.settles
        self.piecewise_laws, self.highest_frequency = system.piecewise_laws, system.highest_frequency
        self.n, self.n_positions = (_lines(n) + n * LANES for n in (system.n, system.n_positions))

    @property
    def step_bounds(self) -> StepBounds | None:
        """Bounds of a step by the motion's force laws with short pieces: what a step's begin has of it comes first."""
        return self._system.step_bounds

    @property
    def groups(self) -> tuple[IntArray, IntArray]:
        """Groups of the motion's own coordinates, and -1 for its tangents: their errors choose no steps."""
        sizes = (self.n_positions, self.n)
        both = [np.full(size, -1, dtype=np.int64) for size in sizes]
        for whole, own in zip(both, self._system.groups, strict=True):
            whole[: own.size] = own
        return both[0], both[1]

    @property
    def start(self) -> tuple[Array, Array]:
        """Tangents of positions and rates at the start, (n_positions, 8) and (n, 8)."""
        q, v = np.zeros((self._system.n_positions, LANES)), np.zeros((self._system.n, LANES))
        for lane, direction in enumerate(self._directions):
            q[:, lane], v[:, lane] = direction.q, direction.v
        return q, v

    def join(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return positions and rates of the motion at its start with those of its tangents."""
        pairs = zip((q, v), self.start, strict=True)
        both = [np.concatenate([x, np.zeros(_lines(x.size) - x.size), along.ravel()]) for x, along in pairs]
        return both[0], both[1]

    def part(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the tangents of a march, (n_times, n_positions, 8) and (n_times, n, 8)."""
        sizes = (self._system.n_positions, self._system.n)
        both = [x[:, _lines(n) :].reshape(len(x), n, LANES) for x, n in zip((q, v), sizes, strict=True)]
        return both[0], both[1]

    def leapfrog(self) -> Leapfrog:
        """Fresh storage for leapfrog steps."""
        return Leapfrog(0, *aligned(1, self.n))

    @cached_property
    def parameters(self) -> TangentParameters:
        """Addresses and arrays for the kernels."""
        compiled, own = self._system.compiled, self._system.parameters
        n_inputs = 3 * len(compiled.signals)
        beside, weights = np.zeros((LANES, 4), dtype=np.int64), np.zeros((LANES, 4))
        directions = np.zeros((own.inputs.size, LANES))
        self._codes = []  # which stay loaded as long as this is
        for lane, direction in enumerate(self._directions):
            directions[n_inputs:, lane] = direction.numbers
            for k, (signals, weight) in enumerate(direction.signals):
                self._codes.append(load_signals(signals))
                beside[lane, k], weights[lane, k] = self._codes[-1].address("signals"), weight
        return TangentParameters(
            accelerations=compiled.address("acceleration_tangents"),
            signals=own.signals,
            n=self._system.n,
            n_lines=_lines(self._system.n),
            n_position_lines=_lines(self._system.n_positions),
            inputs=own.inputs.copy(),
            directions=directions,
            beside=beside,
            weights=weights,
            room=np.zeros(own.inputs.size),
            n_inputs=n_inputs,
            clock=np.full(2, np.nan),
            position=own.position.copy(),
            quaternions=own.quaternions.copy(),
        )


def _lines(n: int) -> int:
    return -(-n // LANES) * LANES


@accelerations.register(TangentParameters)
def _accelerations(p: TangentParameters, t: float, q: Array, v: Array, a: Array) -> None:
    if p.signals != 0 and p.clock[0] != t:
        _set_inputs(p, float(t))
    along = (p.directions, q[p.n_position_lines :], v[p.n_lines :])
    call_native(p.accelerations, (p.inputs, q, v, along[0], along[1], along[2], a, a[p.n_lines :]))


@inlined
def _set_inputs(p: TangentParameters, t: float) -> None:
    """Evaluate the signals at a time t [s], and how they change."""
    p.clock[0], p.clock[1] = t, t
    call_native(p.signals, (p.clock[1:], p.inputs))
    for lane in range(LANES):
        for i in range(p.n_inputs if p.weights[lane, 0] != 0.0 else 0):
            p.directions[i, lane] = 0.0
        for k in range(4):
            if p.weights[lane, k] != 0.0:
                call_native(p.beside[lane, k], (p.clock[1:], p.room))
                for i in range(p.n_inputs):
                    p.directions[i, lane] += p.weights[lane, k] * p.room[i]


@leapfrog_step.register(TangentParameters)
def _leapfrog_step(p: TangentParameters, leapfrog: Leapfrog, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    take_leap(p, leapfrog, t, h, q, v, a)


@advance.register(TangentParameters)
def _advance(p: TangentParameters, q: Array, v: Array, h: float, first: int, last: int) -> None:
    """Move all coordinates: nothing marches a part of them alone."""
    if p.quaternions.shape[0] == 0:
        for i in range(v.size):
            q[i] += h * v[i]
        return
    for i in range(p.n):
        if p.position[i] >= 0:
            q[p.position[i]] += h * v[i]
            to, at = p.n_position_lines + LANES * p.position[i], p.n_lines + LANES * i
            for lane in range(LANES):
                q[to + lane] += h * v[at + lane]
    for k in range(p.quaternions.shape[0]):
        _advance_quaternion(p, q, p.quaternions[k, 1], v, p.quaternions[k, 0], h)


@velocities.register(TangentParameters)
def _velocities(p: TangentParameters, q: Array, v: Array, dq: Array) -> None:
    if p.quaternions.shape[0] == 0:
        for i in range(v.size):
            dq[i] = v[i]
        return
    for i in range(p.n):
        if p.position[i] >= 0:
            dq[p.position[i]] = v[i]
            to, at = p.n_position_lines + LANES * p.position[i], p.n_lines + LANES * i
            for lane in range(LANES):
                dq[to + lane] = v[at + lane]
    for k in range(p.quaternions.shape[0]):
        at, turn = p.quaternions[k, 1], p.quaternions[k, 0]
        quaternion_rate(q, at, v, turn, dq)
        for lane in range(LANES):
            _quaternion_rate_along(p, q, at, v, turn, dq, lane)


@inlined
def _quaternion_rate_along(p: TangentParameters, q: Array, at: int, v: Array, turn: int, dq: Array, lane: int) -> None:
    """``½ (δe ∘ (ω, 0) + e ∘ (δω, 0))``."""
    to, of = p.n_position_lines + LANES * at + lane, p.n_lines + LANES * turn + lane
    wx, wy, wz = 0.5 * v[turn], 0.5 * v[turn + 1], 0.5 * v[turn + 2]
    ux, uy, uz = 0.5 * v[of], 0.5 * v[of + LANES], 0.5 * v[of + 2 * LANES]
    x, y, z, w = q[at], q[at + 1], q[at + 2], q[at + 3]
    dx, dy, dz, dw = q[to], q[to + LANES], q[to + 2 * LANES], q[to + 3 * LANES]
    dq[to] = dw * wx + dy * wz - dz * wy + w * ux + y * uz - z * uy
    dq[to + LANES] = dw * wy - dx * wz + dz * wx + w * uy - x * uz + z * ux
    dq[to + 2 * LANES] = dw * wz + dx * wy - dy * wx + w * uz + x * uy - y * ux
    dq[to + 3 * LANES] = -dx * wx - dy * wy - dz * wz - x * ux - y * uy - z * uz


@inlined
def _advance_quaternion(p: TangentParameters, q: Array, at: int, v: Array, turn: int, h: float) -> None:
    """Turn the unit quaternion at ``q[at]`` by h times the body's own rates, and its tangents with it."""
    wx, wy, wz = 0.5 * h * v[turn], 0.5 * h * v[turn + 1], 0.5 * h * v[turn + 2]
    size = math.sqrt(wx * wx + wy * wy + wz * wz)
    s, c = (math.sin(size) / size, math.cos(size)) if size > 1e-12 else (1.0, 1.0)
    bend = (c - s) / (size * size) if size > 1e-3 else -1.0 / 3.0 + size * size / 30.0  # of s, by half the size squared
    x, y, z, w = q[at], q[at + 1], q[at + 2], q[at + 3]
    e0 = s * (w * wx + y * wz - z * wy) + x * c
    e1 = s * (w * wy - x * wz + z * wx) + y * c
    e2 = s * (w * wz + x * wy - y * wx) + z * c
    e3 = w * c - s * (x * wx + y * wy + z * wz)
    norm = 1.0 / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
    e0, e1, e2, e3 = norm * e0, norm * e1, norm * e2, norm * e3
    for lane in range(LANES):
        to, of = p.n_position_lines + LANES * at + lane, p.n_lines + LANES * turn + lane
        ux, uy, uz = 0.5 * h * v[of], 0.5 * h * v[of + LANES], 0.5 * h * v[of + 2 * LANES]
        along = wx * ux + wy * uy + wz * uz
        tx, ty, tz, tc = s * ux + bend * along * wx, s * uy + bend * along * wy, s * uz + bend * along * wz, -s * along
        dx, dy, dz, dw = q[to], q[to + LANES], q[to + 2 * LANES], q[to + 3 * LANES]
        d0 = w * tx + y * tz - z * ty + x * tc + s * (dw * wx + dy * wz - dz * wy) + dx * c
        d1 = w * ty - x * tz + z * tx + y * tc + s * (dw * wy - dx * wz + dz * wx) + dy * c
        d2 = w * tz + x * ty - y * tx + z * tc + s * (dw * wz + dx * wy - dy * wx) + dz * c
        d3 = w * tc - x * tx - y * ty - z * tz - s * (dx * wx + dy * wy + dz * wz) + dw * c
        d0, d1, d2, d3 = norm * d0, norm * d1, norm * d2, norm * d3
        out = e0 * d0 + e1 * d1 + e2 * d2 + e3 * d3
        q[to], q[to + LANES] = d0 - out * e0, d1 - out * e1
        q[to + 2 * LANES], q[to + 3 * LANES] = d2 - out * e2, d3 - out * e3
    q[at], q[at + 1], q[at + 2], q[at + 3] = e0, e1, e2, e3
