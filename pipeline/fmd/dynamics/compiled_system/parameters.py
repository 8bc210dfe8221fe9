"""Arrays and addresses of a compiled mechanism that the integrators' kernels read and write."""

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiler.turns import Turns
from fmd.kernels.table import Table


@dataclass(frozen=True)
class CompiledParameters(Table):
    """A mechanism's accelerations by their address, its signals, and where its positions are."""

    accelerations: int  # addresses of the compiled functions
    signals: int
    inputs: Array  # (3 n_signals + n_numbers,): each signal, with its derivatives, and joints' springs, rests, dampers
    clock: Array  # (2,): the time that the inputs are of, and one for which others are evaluated [s]
    position: IntArray  # (n,): position that each rate moves, -1 for a rotation in space
    quaternions: IntArray  # (n_rotations, 2): first rate and first position of each rotation in space
    turns: Turns


@dataclass(frozen=True)
class TreeParameters(CompiledParameters):
    """Parameters of a mechanism without loops."""


@dataclass(frozen=True)
class Multipliers(Table):
    """How n_rows constraints push a mechanism of which some coordinates are free: ``X = M̂⁻¹ Jᵀ`` and ``S = J X``."""

    x: Array  # (n_blocks, n, 8): X, eight constraints to a block
    s: Array  # (n_blocks, n_rows, 8): S
    S: Array  # (n_rows, n_rows): factors of the same, scaled
    scale: Array  # (n_rows,): of each constraint in it
    order: IntArray  # (n_rows,): constraints in the order in which they are factored, redundant ones last
    rank: IntArray  # (1,): how many are independent
    fresh: Array  # (1,): 1 if order and rank are to be found at the next state
    anew: IntArray  # (1,): how many projections have linearised the constraints more than once
    multiplier: Array  # (n_rows,)
    total: Array  # (n_rows,): what multipliers have added up to since it was set to 0
    push: Array  # (n,): change of accelerations, rates or positions by the multipliers
    room: Array  # (n_rows,)


@dataclass(frozen=True)
class ClosedParameters(CompiledParameters):
    """Parameters of a mechanism with n_rows constraints of loops; see `fmd.dynamics.compiler.closures`."""

    closed: int  # addresses of the compiled functions
    multipliers: int
    residuals: int
    units: Array  # (n_blocks, n_rows, 8): unit multipliers, eight to a block
    J: Array  # (n_blocks, n, 8): Jᵀ, where sub-cycling needs it
    whole: Multipliers  # with all coordinates free
    slow: Multipliers  # with the fast ones frozen
    g: Array  # (n_rows,): residuals, their rates and accelerations
    rates: Array
    w: Array


@dataclass(frozen=True)
class Leapfrog(Table):
    """A mechanism's leapfrog step, in one function where it is short and no rotation in space is a quaternion."""

    leap: int  # address of the compiled function, 0 if there is none
    step: Array  # (1,): length of a step [s]
    v_now: Array  # (n,), room to work in


@dataclass(frozen=True)
class FrozenCycle(Table):
    """Equation of the fast coordinates over a cycle, ``a_S = constant + slope τ + lever δu − K q_S − C v_S``.

    δu is the change of the loads and motions since the cycle's start. Vectors hold it in the places of the fast
    rates. Where the coordinates don't couple with each other, ``K`` and ``C`` are unused and ``k``, ``c`` are the
    diagonals. Functions are addresses of compiled ones, 0 for one that isn't needed; `fmd.dynamics.compiler.programs`
    has their arguments.
    """

    freeze_single: int
    find_drift: int
    stiffness: int
    damping: int
    solve_fast: int
    unrolled: int  # a fast step of coupled coordinates without loops; 0 where these are too many
    n_slow: int
    single: bool  # no fast coordinate couples with another
    damped: bool  # the fast equation has a term with fast rates
    cycle: Array  # (1,): its duration [s]
    driven: IntArray  # (n_driven,): those inputs that accelerate fast coordinates
    inverse_mass: Array  # (n,): of each fast coordinate, where that is constant
    time: Array  # (1,): of the cycle's start [s]
    active: Array  # (1,): 1 if an input changes within the cycle
    breakpoints: Array  # (any,): times at which a load or a motion jumps, has a kink or begins to vary [s]
    before: Array  # (3 n_signals,): inputs at the start
    now: Array  # (3 n_signals,): inputs at a fast step
    changes: Array  # (any, n_driven): δu of some fast steps
    lever: Array  # (n_driven, n)
    constant: Array  # (n,)
    slope: Array  # (n,)
    load: Array  # (n,): lever δu
    k: Array  # (n,)
    c: Array  # (n,)
    K: Array  # (n_fast, n_fast), a row for each fast position
    C: Array  # (n_fast, n_fast), a row for each fast rate
    clock: Array  # (2,): τ and the step [s]
    unit_positions: Array  # (n_blocks, n_positions, 8): directions of the fast positions, eight to a block
    unit_rates: Array  # (n_blocks, n, 8)
    moved: Array  # (n_positions,): how positions change
    drift: Array  # (n,): how the residual changes with slow motion, with inputs, with all fast positions and rates
    by_inputs: Array  # (3 n_signals, n)
    by_positions: Array  # (n,)
    by_rates: Array  # (n,)
    v_now: Array  # (n,), room to work in
    f: Array  # (n, 8), room to work in
    x: Array  # (n, 8)


@dataclass(frozen=True)
class WholeCycle(Table):
    """A major cycle by one compiled function."""

    cross: int  # addresses of the compiled functions; `fmd.dynamics.compiler.programs` has their arguments
    signals_ahead: int  # 0 if loads and motions are evaluated one time after the other
    count: int  # fast steps
    varying: IntArray  # (1,): 0 if no load or motion changes in the cycle
    # (6,): fast step and cycle [s], number of fast steps, through how many loads vary, the first one's place, and the
    # sum of the squares of the rates at the end
    steps: Array
    inverse_mass: Array  # (n,): of each fast coordinate
    quiet: Array  # (any, 2): begin and end of times in which no load or motion changes [s]
    start: Array  # (2,): number of a step, and its length [s]
    numbers: Array  # (8,): 0 … 7
    now: Array  # (3 n_signals,): inputs at one time
    ahead: Array  # (n_blocks, 3 n_signals, 8): inputs at fast steps, eight to a block
    known: IntArray  # (2,): number of the first of these steps, and of the first one after them, -1 while none varies


@dataclass(frozen=True)
class CarriedCycle(Table):
    """A major cycle by carried forces by one compiled function."""

    cross: int  # address
    square: Array  # (1,): the sum of the squares of the rates at the end


@dataclass(frozen=True)
class Responses(Table):
    """Compiled functions that find accelerations, and those of unit forces."""

    together: int  # address of a function of the accelerations and the first block, 0 where loops close
    solve: int  # address
    middle: int  # of what a cycle freezes by them, and of a step with it; 0 where code without loops is too long
    step: int
    units: Array  # (n_blocks, n, 8): unit forces, eight to a block


@dataclass(frozen=True)
class MiddleCycle(Table):
    """Equations of a mechanism with loops in which the slow coordinates react to the fast ones at once."""

    frozen: FrozenCycle  # the fast coordinates'
    inertia: int  # addresses of the compiled functions
    solve: int
    solve_slow: int
    along_positions: Array  # (n_blocks, n_positions, 8): how all coordinates follow each fast one
    along_rates: Array  # (n_blocks, n, 8)
    y: Array  # (n_slow,): acceleration of ``y = q_L + D q_S``
    rest: Array  # (n,): zeros
    row: Array  # (n,), room to work in


@dataclass(frozen=True)
class ClosedCycle(Table):
    """Equation of the fast coordinates of a mechanism with loops, frozen from a major cycle's begin on."""

    middle: MiddleCycle  # the equation, in which slow coordinates and multipliers react
    D: Array  # (n, n_slow): how the slow coordinates follow the fast ones
    ahead: Array  # (1,): how far the slow motion is followed to see what it changes [s]
    q: Array  # (n_positions,): the state there
    v: Array  # (n,)
    a: Array  # (n,)
