"""Flat arrays of a mechanism, which the kernels of `kernels` and `solve` read and write."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.dynamics.jit.table import Table
from pipeline.dynamics.links import FIXED, FREE, PRISMATIC, REVOLUTE, Link, PointLoad
from pipeline.dynamics.signals.signal import Signal, SignalTable, constant, pack

# The six symmetric products of two axes; the three antisymmetric ones are counted by the axis across both.
SYMMETRIC = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
_ROUND_OFF = 1e-12
_PLANE = 1e-9


@dataclass(frozen=True)
class TreeParameters(Table):
    """Flat arrays for the kernels; those from ``origin`` on are room to work in."""

    # Addresses of kernels, so that each is compiled once and only where it is needed: see `solve.with_kernels`.
    place_joint: int
    move_through_joint: int
    add_body: int
    add_point_load: int
    mass_and_force: int
    solve_accelerations: int
    parent: IntArray
    joint: IntArray
    rate: IntArray  # first rate of each joint
    position: IntArray  # first position of each joint
    motion: IntArray  # the joint's signal, -1 if it is not prescribed
    mode: IntArray  # (n_bodies, most modes): rate of each modal coordinate
    n_modes: IntArray
    shift: int  # position = rate + shift for modes and fast joints
    place: Array  # (n_bodies, 3)
    axis: Array  # (n_bodies, 3)
    place_shapes: Array  # (n_bodies, 3, most modes): of the parent
    place_rotations: Array
    joint_rotation: Array  # (n_bodies, most modes)
    G: Array  # (n_bodies, 6, 1 + most, 1 + most): ½ (G[a, b] + G[b, a]), symmetric
    A: Array  # (n_bodies, 3, 1 + most, 1 + most): G[b, c] − G[c, b] by the axis a across b and c, antisymmetric
    active: IntArray  # (n_bodies, 9): which of the six and the three the motion can excite
    S: Array  # (n_bodies, 3, 1 + most)
    bow: Array  # (n_bodies, 3, most, most): second-order first moment, if bowed
    bowed: IntArray
    mass: Array
    stiffness: Array  # (n,) by rate: spring or ω²
    K: Array  # (n, n): the same, with springs that grip a section which turns with its body's modes
    C: Array  # (n, n): damping likewise
    gripped: bool  # K or C is not diagonal
    rest: Array  # (n,)
    damping: Array  # (n,)
    load: IntArray  # (n,): the signal of each joint's load, -1 for none
    at_body: IntArray  # point loads
    at_torque: IntArray
    at_following: IntArray
    at_signal: IntArray
    at_direction: Array  # (n_loads, 3)
    at_place: Array
    at_shapes: Array  # (n_loads, 3, most modes)
    at_rotations: Array
    signals: SignalTable
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
    small: Array  # (9, 12)
    modal: Array  # (18, 1 + most)


@dataclass(frozen=True)
class FrozenTree(Table):
    """The fast coordinates over a major cycle: ``M_SS a_S = constant − K q_S − C v_S``."""

    march: int  # address of `fast_march`
    n_slow: int
    constant: Array  # (n,), the slow ones unused
    single: Array  # (1,): 1 if no fast coordinate couples with another
    v_now: Array  # (n,), room to work in
    K: Array  # (n, n)
    C: Array  # (n, n)
    L: Array  # (n, n), factor of M_SS


@dataclass(frozen=True)
class MiddleTree(Table):
    """The equations at a major cycle's middle, the slow ones reacting: ``Q̂ = Q − K (q_S − q*_S) − C (v_S − v*_S)``."""

    fast: FrozenTree  # the fast coordinates', with S̄ = Tᵀ M T for M_SS
    L: Array  # (n, n): factor of M_LL
    Q: Array  # (n,)
    T: Array  # (n, n): in the fast rows, how all rates follow each fast one
    K: Array  # (n, n): likewise −∂Q̂/∂q T and −∂Q̂/∂v T
    C: Array
    carried: Array  # (n_bodies, n, 9), room to work in
    room: Array  # (9, 12)
    q: Array  # (n,): q*_S, v*
    v: Array


class Layout(NamedTuple):
    """Where the coordinates are: slow joints, slow modes, fast joints, fast modes."""

    rate: IntArray  # first rate of each joint
    position: IntArray  # first position of each joint
    mode: IntArray  # (n_bodies, most modes): rate of each modal coordinate
    n_slow: int
    n: int
    n_positions: int


def layout_of(links: Sequence[Link], fast_joints: Sequence[str], slow_modes: Sequence[int]) -> Layout:
    """Number the coordinates; rotations in space are slow, so every rate after them has the same shift to its position.

    Parameters
    ----------
    fast_joints : sequence of str
        Links whose joint coordinate is fast.
    slow_modes : sequence of int
        How many of each link's modes, the lowest, are slow.
    """
    rate, position = np.zeros(len(links), dtype=np.int64), np.zeros(len(links), dtype=np.int64)
    mode = np.zeros((len(links), max(len(link.omega) for link in links)), dtype=np.int64)
    at = at_position = n_slow = 0
    for fast in (False, True):
        for k, link in enumerate(links):
            if (link.name in fast_joints) is fast:
                rate[k], position[k] = at, at_position
                at += link.n_rates
                at_position += link.n_positions
        for k, link in enumerate(links):
            first, last = (slow_modes[k], len(link.omega)) if fast else (0, slow_modes[k])
            mode[k, first:last] = np.arange(at, at + last - first)
            at += last - first
            at_position += last - first
        n_slow = n_slow if fast else at
    return Layout(rate, position, mode, n_slow, at, at_position)


def packed(
    links: Sequence[Link], loads: Sequence[PointLoad], layout: Layout, gravity: Array
) -> tuple[TreeParameters, tuple[Signal, ...]]:
    """Gather a chain in flat arrays, without room to work in; and its signals."""
    n, most, n_bodies = layout.n, layout.mode.shape[1], len(links)
    signals: list[Signal] = []

    def number(signal: Signal | None) -> int:
        if signal is None:
            return -1
        signals.append(signal)
        return len(signals) - 1

    by_body = {
        "place_shapes": np.zeros((n_bodies, 3, most)),
        "place_rotations": np.zeros((n_bodies, 3, most)),
        "joint_rotation": np.zeros((n_bodies, most)),
        "G": np.zeros((n_bodies, 6, 1 + most, 1 + most)),
        "A": np.zeros((n_bodies, 3, 1 + most, 1 + most)),
        "S": np.zeros((n_bodies, 3, 1 + most)),
        "bow": np.zeros((n_bodies, 3, most, most)),
    }
    by_rate = {name: np.zeros(n) for name in ("stiffness", "rest", "damping")}
    load, scalar_position = np.full(n, -1, dtype=np.int64), np.full(n, -1, dtype=np.int64)
    active, bowed = np.zeros((n_bodies, 9), dtype=np.int64), np.zeros(n_bodies, dtype=np.int64)
    motion = np.array([number(link.motion) for link in links], dtype=np.int64)
    K, C = np.zeros((n, n)), np.zeros((n, n))
    plane = plane_normal(links)
    for k, link in enumerate(links):
        own, others = len(link.omega), link.place_shapes.shape[1]
        by_body["place_shapes"][k, :, :others] = link.place_shapes
        by_body["place_rotations"][k, :, : link.place_rotations.shape[1]] = link.place_rotations
        by_body["joint_rotation"][k, : len(link.joint_rotation)] = link.joint_rotation
        by_body["S"][k, :, : 1 + own] = link.gram.S
        if link.gram.bow.size:
            by_body["bow"][k, :, :own, :own] = link.gram.bow
            bowed[k] = 1
        G = link.gram.G
        for i, (a, b) in enumerate(SYMMETRIC):
            by_body["G"][k, i, : 1 + own, : 1 + own] = 0.5 * (G[a, b] + G[b, a])
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            by_body["A"][k, a, : 1 + own, : 1 + own] = G[b, c] - G[c, b]
        active[k] = _active(by_body["G"][k], by_body["A"][k], plane)
        modes = layout.mode[k, :own]
        scalar_position[modes] = modes + layout.n_positions - n
        by_rate["stiffness"][modes] = link.omega**2
        K[modes, modes] += link.omega**2
        if len(link.damping):
            by_rate["damping"][modes] = 2.0 * link.damping * link.omega
            C[modes, modes] += 2.0 * link.damping * link.omega
        if link.joint == FREE:
            scalar_position[layout.rate[k] : layout.rate[k] + 3] = np.arange(3) + layout.position[k]
        if link.n_rates == 1:
            i = layout.rate[k]
            scalar_position[i] = layout.position[k]
            by_rate["stiffness"][i], by_rate["rest"][i] = link.spring, link.rest
            by_rate["damping"][i] = link.damper
            load[i] = -1 if link.load == constant(0.0) else number(link.load)
            grip = np.zeros(n)  # what stretches the spring: the joint, and the section's turning with the modes
            grip[i] = 1.0
            if link.joint == REVOLUTE and len(link.joint_rotation):
                grip[modes] = link.joint_rotation
            K += link.spring * np.outer(grip, grip)
            C += link.damper * np.outer(grip, grip)
    names = [link.name for link in links]
    at_shapes, at_rotations = np.zeros((len(loads), 3, most)), np.zeros((len(loads), 3, most))
    for k, at in enumerate(loads):
        at_shapes[k, :, : at.shapes.shape[1]] = at.shapes
        at_rotations[k, :, : at.rotations.shape[1]] = at.rotations
    at_signal = np.array([number(at.size) for at in loads], dtype=np.int64)
    nothing = np.zeros(0)
    parameters = TreeParameters(
        place_joint=0,
        move_through_joint=0,
        add_body=0,
        add_point_load=0,
        mass_and_force=0,
        solve_accelerations=0,
        parent=np.array([link.parent for link in links], dtype=np.int64),
        joint=np.array([link.joint for link in links], dtype=np.int64),
        rate=layout.rate,
        position=layout.position,
        motion=motion,
        mode=layout.mode,
        n_modes=np.array([len(link.omega) for link in links], dtype=np.int64),
        shift=layout.n_positions - n,
        place=np.array([link.place for link in links], dtype=float),
        axis=np.array([link.axis / np.linalg.norm(link.axis) for link in links]),
        active=active,
        bowed=bowed,
        mass=np.array([link.gram.mass for link in links]),
        K=K,
        C=C,
        gripped=bool((K - np.diag(K.diagonal())).any() or (C - np.diag(C.diagonal())).any()),
        load=load,
        at_body=np.array([names.index(at.body) for at in loads], dtype=np.int64),
        at_torque=np.array([at.torque for at in loads], dtype=np.int64),
        at_following=np.array([at.following for at in loads], dtype=np.int64),
        at_signal=at_signal,
        at_direction=np.array([at.direction / np.linalg.norm(at.direction) for at in loads]).reshape(-1, 3),
        at_place=np.array([at.place for at in loads], dtype=float).reshape(-1, 3),
        at_shapes=at_shapes,
        at_rotations=at_rotations,
        signals=pack(signals),
        gravity=np.asarray(gravity, dtype=float),
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
        small=nothing,
        modal=nothing,
        **by_body,
        **by_rate,
    )
    return parameters, tuple(signals)


def with_room(parameters: TreeParameters) -> TreeParameters:
    """Give parameters room to work in that is the caller's own."""
    n, n_bodies, most = len(parameters.load), len(parameters.parent), parameters.mode.shape[1]
    return replace(
        parameters,
        signals=parameters.signals.with_room(),
        origin=np.zeros((n_bodies, 3)),
        R=np.zeros((n_bodies, 3, 3)),
        spin=np.zeros((n_bodies, 3)),
        bias=np.zeros((n_bodies, 6)),
        J=np.zeros((n_bodies, 6, n)),
        R0=np.zeros((3, 3)),
        M=np.zeros((n, n)),
        L=np.zeros((n, n)),
        Q=np.zeros(n),
        small=np.zeros((9, 12)),
        modal=np.zeros((18, 1 + most)),
    )


def plane_normal(links: Sequence[Link]) -> int:
    """Number of the coordinate axis that every rotation of the chain is about, -1 if there is none."""
    axes = []
    for link in links:
        if link.joint not in (FIXED, REVOLUTE, PRISMATIC):
            return -1
        if link.joint == REVOLUTE:
            axes.append(np.abs(link.axis) / np.linalg.norm(link.axis))
        if link.place_rotations.size:
            axes += list(np.abs(link.place_rotations.T))
    if not axes:
        return -1
    along = np.sum(axes, axis=0)
    normal = int(along.argmax())
    return normal if np.delete(along, normal).max() < _PLANE * along[normal] else -1


def _active(G: Array, A: Array, normal: int) -> Array:
    """Mark those of the nine inertia integrals that a body's motion can excite, shape (9,)."""
    scale = np.full(G.shape[-1], 1.0)
    scale[0] = np.sqrt(max(G[0, 0, 0] + G[1, 0, 0] + G[2, 0, 0], 1e-300))
    significant = np.abs(np.concatenate([G, A]) / np.outer(scale, scale)).max(axis=(1, 2)) > _ROUND_OFF
    if normal < 0:
        return np.asarray(significant)
    across = [normal not in pair and pair[0] == pair[1] for pair in SYMMETRIC] + [a == normal for a in range(3)]
    return np.asarray(significant & across)
