"""A mechanism with eight tangents of its motion as one system, which explicit methods march as they do any other.

A tangent is how a motion changes with a number. A step that is made of accelerations and of sums of what it has takes
the tangents of states to those of the next ones, exactly: its own derivative, whatever the step's error.

Positions, rates and accelerations are the motion's own, filled up with zeros to whole lines of eight, and after them
those of the tangents, eight to each.
"""

from collections.abc import Sequence
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiled_system.closed_cycle_tangents import ClosedCycleTangents
from fmd.dynamics.compiled_system.closed_tangents import ClosedTangentParameters
from fmd.dynamics.compiled_system.cycle_tangents import CycleTangents
from fmd.dynamics.compiled_system.parameters import ClosedCycle, ClosedParameters, Leapfrog
from fmd.dynamics.compiled_system.shared import lift_system
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiled_system.tangent_kernels import MechanismVariants, TangentParameters
from fmd.dynamics.compiler.compiled import CompiledMechanism
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.compiler.signal_code import load_signals
from fmd.dynamics.compiler.turns import make_turns
from fmd.dynamics.law_pieces import PiecewiseLaw
from fmd.dynamics.signals.signal import Signal
from fmd.dynamics.step_bounds import StepBounds
from fmd.dynamics.system import PlainSystem
from fmd.kernels.table import aligned


@dataclass(frozen=True)
class Variant:
    """A mechanism a little beside another one, with coordinates of the same kind."""

    compiled: CompiledMechanism
    weight: float  # of its residual in a derivative
    signs_q: Array  # (n_positions,): 1, or -1 for a modal coordinate of which the other's has the opposite sign
    signs_v: Array  # (n,): the same of rates


@dataclass(frozen=True)
class Direction:
    """How a mechanism's equations and its start change with a number."""

    numbers: Array  # (n_numbers,): derivatives of what is a number in the equations, `CompiledMechanism.numbers`
    # Signals beside the mechanism's own, in their order, with weights: the weighted sums of their values are the
    # derivatives of the mechanism's. Four sets at most; none where these stay as they are.
    signals: Sequence[tuple[tuple[Signal, ...], float]]
    q: Array  # (n_positions,): derivatives of positions at the start
    v: Array  # (n,): derivatives of rates at the start
    # Mechanisms whose weighted residuals are the derivative of the mechanism's own, where more than inputs of its
    # equations change: four at most, and then neither numbers nor signals.
    variants: Sequence[Variant] = ()
    # Derivatives of what contacts depend on, as `CompiledSystem.contact_numbers` has it; none where nothing touches.
    contact: tuple[Array, ...] = ()
    lifted: bool = False  # true if these, or the variants, are those of the mechanism where it is lifted


def system_along(system: CompiledSystem, directions: Sequence[Direction]) -> CompiledSystem:
    """Return what is marched along some directions: the lifted system if one of them is that one's."""
    return lift_system(system) if any(each.lifted for each in directions) else system


class TangentSystem(PlainSystem):
    """A mechanism that `has_tangents` with up to eight tangents of its motion."""

    def __init__(self, system: CompiledSystem, directions: Sequence[Direction]) -> None:
        self._system, self._directions = system_along(system, directions), directions
        self.breakpoints, self.highest_frequency = system.breakpoints, system.highest_frequency
        self.n, self.n_positions = (_lines(n) + n * LANES for n in (system.n, system.n_positions))

    @property
    def n_contact_values(self) -> int:
        """How many values of the motion's contacts are noted, and of their tangents."""
        return (1 + LANES) * self._system.n_contact_values

    @property
    def settles(self) -> bool:
        """True if the motion does."""
        return self._system.settles

    @property
    def piecewise_laws(self) -> tuple[PiecewiseLaw, ...]:
        """The motion's force laws with short pieces."""
        return self._system.piecewise_laws

    @property
    def step_bounds(self) -> StepBounds:
        """Bounds of a step by the motion's force laws with short pieces: what a step's begin has of it comes first."""
        return self._system.step_bounds

    @property
    def motion(self) -> CompiledSystem:
        """The mechanism's own, beside which the tangents are marched."""
        return self._system

    @property
    def stiffness(self) -> Array:
        """Linear part of each acceleration, of the tangents as of the motion [1/s²], shape (n,)."""
        return self.spread(self._system.stiffness)

    def spread(self, own: Array) -> Array:
        """Return what belongs to each of the motion's own rates, (n,), for its tangents, too."""
        return np.concatenate([own, np.zeros(_lines(own.size) - own.size), np.repeat(own, LANES)])

    @property
    def fast_places(self) -> IntArray:
        """Position that each fast rate moves, of the tangents as of the motion, shape (n,); -1 for slow rates."""
        own, places = self._system.fast_places, np.full(self.n, -1, dtype=np.int64)
        fast, places[: own.size] = np.flatnonzero(own >= 0), own
        for lane in range(LANES):
            places[_lines(own.size) + LANES * fast + lane] = _lines(self._system.n_positions) + LANES * own[fast] + lane
        return places

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

    def part_rows(self, rows: Array) -> Array:
        """Return the tangents of what contacts do, (n_times, 8, n_values)."""
        width = self._system.n_contact_values
        return rows[:, width:].reshape(len(rows), LANES, width)

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
            directions[n_inputs : n_inputs + direction.numbers.size, lane] = direction.numbers
            for k, (signals, weight) in enumerate(direction.signals):
                self._codes.append(load_signals(signals))
                beside[lane, k], weights[lane, k] = self._codes[-1].address("signals"), weight
        changed = any(direction.variants for direction in self._directions)
        program = "changed_tangents" if changed else "acceleration_tangents"
        if self._system.mechanism.contacts:
            program = "pushed_tangents"
        common: dict[str, Any] = {
            "accelerations": compiled.address(program),
            "alone": own.accelerations,
            "signals": own.signals,
            "n": self._system.n,
            "n_lines": _lines(self._system.n),
            "n_position_lines": _lines(self._system.n_positions),
            "inputs": own.inputs.copy(),
            "directions": directions,
            "beside": beside,
            "weights": weights,
            "room": np.zeros(own.inputs.size),
            "n_inputs": n_inputs,
            "clock": np.full(2, np.nan),
            "position": own.position.copy(),
            "quaternions": own.quaternions.copy(),
            "turns": make_turns(own.quaternions, "_tangents"),
            "multiplier": np.zeros(max(len(compiled.rows), 1)),
            "dr": np.zeros((self._system.n, LANES)),
            "variants": tabulate_variants(self._system, self._directions),
        }
        trees: Any = TangentParameters
        loops: Any = ClosedTangentParameters
        if self._system.mechanism.contacts:
            touching = import_module("fmd.dynamics.compiled_system.touching_tangents")
            trees, loops = touching.TouchingTangentParameters, touching.TouchingClosedTangentParameters
            beside = touching.states_beside(self._system, self._directions)
            common |= {"own": own, "contact": own.contact, "by": beside}
        found: TangentParameters
        if not isinstance(own, ClosedParameters):
            found = trees(**common)
            return found
        n_rows = own.w.size
        room: dict[str, Any] = {name: np.zeros(self.n_positions) for name in ("q_now", "moved")}
        room |= {name: np.zeros(self.n) for name in ("v_now", "rates", "a_free", "a_pulled")}
        room |= {name: np.zeros((n_rows, LANES)) for name in ("dg", "drates")}
        found = loops(
            **common | {"own": own},
            **room,
            n_positions=self._system.n_positions,
            q_ahead=np.zeros(self._system.n_positions),
            residuals=compiled.address("residual_tangents"),
            closing=compiled.address("closing_tangents"),
            other=np.zeros(n_rows),
            none=np.zeros(n_rows),
            w=np.zeros(n_rows),
        )
        return found

    def cycle_tangents(self, h: float, count: int) -> CycleTangents:
        """Fresh storage for a major cycle of so many fast steps h [s]."""
        system, own = self._system, self._system.parameters
        cycle = system.frozen(count * h)
        frozen = cycle.middle.frozen if isinstance(cycle, ClosedCycle) else cycle
        n, n_positions, n_inputs = system.n, system.n_positions, own.inputs.size
        fast = np.arange(system.n_slow, n)
        rows = 2 + frozen.driven.size + int(frozen.damped) if frozen.single else count - 1
        sizes = {"inputs": n_inputs, "q": n_positions, "v": n, "a": n}
        along = {name: np.zeros((rows, size)) for name, size in sizes.items()}
        share = h * np.arange(1.0, count)
        if frozen.single:
            share = np.eye(1, rows, 1)[0]
            along["q"][0, fast + n_positions - n] = 1.0
            along["inputs"][2 + np.arange(frozen.driven.size), frozen.driven] = 1.0
            if frozen.damped:
                along["v"][-1, fast] = 1.0
        beside = np.zeros(4 * LANES, dtype=np.int64)
        for lane, each in enumerate(self._directions):
            for k, one in enumerate(each.variants):
                beside[4 * lane + k] = one.compiled.address("tangents")
        room: dict[str, Any] = {f"along_{name}": x for name, x in along.items()}
        room |= {name: np.zeros(self.n) for name in ("behind", "v", "a", "middle")}
        room |= {name: np.zeros(self.n_positions) for name in ("moved", "q")}
        room |= {name: np.zeros((size, LANES)) for name, size in (("dq", n_positions), ("dv", n), ("f", n), ("x", n))}
        room |= {f"lanes_{name}": np.zeros((size, LANES)) for name, size in sizes.items()}
        kind: Any = CycleTangents
        if isinstance(own, ClosedParameters):
            kind, n_rows = ClosedCycleTangents, own.w.size
            room |= {name: np.zeros(n_rows) for name in ("still", "along_f", "w")}
            room |= {name: np.zeros(size) for name, size in (("z", n), ("none", n), ("none_q", n_positions))}
            room |= {name: np.zeros((size, LANES)) for name, size in (("at_rest", n_rows), ("of_z", n), ("du", n))}
            room |= {name: np.zeros((n_positions, LANES)) for name in ("of_moved", "dw")}
            room |= {"moved_z": np.zeros(n_positions), "rate": np.zeros(self.n), "a_later": np.zeros(self.n)}
        found: CycleTangents = kind(
            **room,
            own=own,
            cycle=cycle,
            frozen=frozen,
            h=h,
            slopes=system.compiled.address("closed_slopes" if kind is ClosedCycleTangents else "second_slopes"),
            beside=beside,
            share=share,
            columns=np.zeros((rows, n, LANES)),
            inputs=np.zeros(n_inputs),
            directions=np.zeros((n_inputs, LANES)),
            q_ahead=np.zeros(n_positions),
            v_ahead=np.zeros(n),
            a_ahead=np.zeros(n),
        )
        return found


def tabulate_variants(system: CompiledSystem, directions: Sequence[Direction]) -> MechanismVariants:
    """Return the mechanisms beside a system's own, of up to eight directions; tables without any hold no room."""
    chosen = {4 * lane + k: one for lane, each in enumerate(directions) for k, one in enumerate(each.variants)}
    count, n, n_rows = 4 * LANES if chosen else 0, system.n, len(system.compiled.rows)
    names = ("residual", "residuals", "closing", "signals")
    addresses: dict[str, Any] = {name: np.zeros(count, dtype=np.int64) for name in names}
    n_inputs = system.parameters.inputs.size
    sizes = {"weights": (), "inputs": (n_inputs,), "signs_q": (system.n_positions,), "signs_v": (n,)}
    arrays: dict[str, Any] = {name: np.zeros((count, *size)) for name, size in sizes.items()}
    for k, one in chosen.items():
        programs = {"residual": "pushed_residual" if system.mechanism.contacts else "pulled_residual"}
        programs |= {"signals": "signals"} if one.compiled.signals else {}
        programs |= {"residuals": "residuals", "closing": "closing"} if n_rows else {}
        for name, program in programs.items():
            addresses[name][k] = one.compiled.address(program)
        arrays["weights"][k], arrays["signs_q"][k], arrays["signs_v"][k] = one.weight, one.signs_q, one.signs_v
        first, numbers = 3 * len(one.compiled.signals), one.compiled.numbers
        arrays["inputs"][k, first : first + numbers.size] = numbers
    room = {"q": system.n_positions, "v": n, "a": n, "r": n, "g": n_rows, "rates": n_rows}
    zeros: dict[str, Any] = {name: np.zeros(size) for name, size in room.items()}
    return MechanismVariants(int(bool(chosen)), **addresses, **arrays, **zeros)


def _lines(n: int) -> int:
    return -(-n // LANES) * LANES
