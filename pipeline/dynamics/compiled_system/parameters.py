"""Arrays and addresses of a compiled mechanism that the integrators' kernels read and write."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.core.arrays import Array, IntArray
from pipeline.dynamics.jit.table import Table


@dataclass(frozen=True)
class CompiledParameters(Table):
    """A mechanism's accelerations by their address, its signals, and where its positions are."""

    accelerations: int  # addresses of the compiled functions
    signals: int
    inputs: Array  # (3 n_signals,): value, rate and acceleration of each signal
    clock: Array  # (2,): the time that the inputs are of, and one for which others are evaluated [s]
    position: IntArray  # (n,): position that each rate moves, -1 for a rotation in space
    quaternions: IntArray  # (n_rotations, 2): first rate and first position of each rotation in space


@dataclass(frozen=True)
class Leapfrog(Table):
    """A mechanism's leapfrog step, in one function where no rotation in space is a quaternion."""

    leap: int  # address of the compiled function, 0 if there is none
    step: Array  # (1,): length of a step [s]
    v_now: Array  # (n,), room to work in


@dataclass(frozen=True)
class Directions(Table):
    """Directions in eight lanes, and the residual's derivatives along them."""

    tangents: int  # addresses of the compiled functions
    inertia: int
    a: Array  # (n,), accelerations at which tangents are taken
    dinputs: Array  # (3 n_signals, 8)
    dq: Array  # (n_positions, 8)
    dv: Array  # (n, 8)
    da: Array  # (n, 8)
    dr: Array  # (n, 8)


@dataclass(frozen=True)
class HeldCycle(Table):
    """Equation of the fast coordinates over a cycle, ``a_S = constant + slope τ + lever δu − K q_S − C v_S``.

    δu is the change of the loads and motions since the cycle's start. Vectors hold it in the places of the fast rates.
    Where the coordinates don't couple with each other, ``K`` and ``C`` are unused and ``k``, ``c`` hold the diagonals.
    """

    directions: Directions
    solve_fast: int  # address of the compiled function; 0 where the fast mass is constant and diagonal
    n_slow: int
    single: bool  # no fast coordinate couples with another
    damped: bool  # the fast equation has a term with fast rates
    cycle: float  # its duration [s]
    driven: IntArray  # (n_driven,): those inputs that accelerate fast coordinates
    mass: Array  # (n,): of each fast coordinate, where that is constant
    time: Array  # (1,): of the cycle's start [s]
    active: Array  # (1,): 1 if an input changes within the cycle
    breakpoints: Array  # (any,): times at which a load or a motion jumps, has a kink or begins to vary [s]
    before: Array  # (3 n_signals,): inputs at the start
    now: Array  # (3 n_signals,): inputs at a fast step
    lever: Array  # (n_driven, n)
    constant: Array  # (n,)
    slope: Array  # (n,)
    k: Array  # (n,)
    c: Array  # (n,)
    K: Array  # (n_fast, n_fast), a row for each fast position
    C: Array  # (n_fast, n_fast), a row for each fast rate
    moved: Array  # (n_positions,), room to work in
    v_now: Array  # (n,)
    d: Array  # (n,): increment ``h v`` and load of each fast coordinate, from call to call
    load: Array  # (n,)
    f: Array  # (n, 8), room to work in
    x: Array  # (n, 8)


@dataclass(frozen=True)
class MiddleCycle(Table):
    """Equations at a major cycle's middle, in which the slow coordinates react to the fast ones at once."""

    held: HeldCycle  # the fast coordinates', with S̄ in place of the fast mass
    loose: bool  # slow and fast coordinates don't couple through the mass matrix in any state
    L: Array  # (n_slow, n_slow): factor of M_LL
    S: Array  # (n_fast, n_fast): factor of S̄
    M: Array  # (n, n): the mass matrix, a row for each rate whose column it is
    KT: Array  # (n_fast, n): −∂Q̂/∂q T, a row for each fast coordinate
    CT: Array  # (n_fast, n)
    T: Array  # (n_fast, n): how all rates follow each fast one
    Q: Array  # (n,)
    q: Array  # (n_positions,): the state at the middle
    v: Array  # (n,)
    a: Array  # (n,), room to work in
    fresh: Array  # (1,): 1 before a cycle's first fast step
