"""A mechanism as a system that integrators march, by its compiled functions."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

import fmd.dynamics.compiled_system.closed
import fmd.dynamics.compiled_system.closed_cycle
import fmd.dynamics.compiled_system.cycle
import fmd.dynamics.compiled_system.frozen
import fmd.dynamics.compiled_system.kernels
import fmd.dynamics.compiled_system.responses  # noqa: F401 - all give the functions of `system` their meaning here
from fmd.core.arrays import Array, IntArray
from fmd.core.errors import StabilityError
from fmd.core.limits.code import BYTES_OF_OPERATION, MOST_IN_LEAP, MOST_TOGETHER, MOST_UNROLLED
from fmd.core.limits.stepping import MOST_TRIALS, SHARE_AHEAD, STEPS_AHEAD, STEPS_IN_ACTION
from fmd.dynamics.compiled_system.couplings import Couplings, find_couplings, find_inertial_coupling
from fmd.dynamics.compiled_system.parameters import (
    CarriedCycle,
    ClosedCycle,
    ClosedParameters,
    CompiledParameters,
    FrozenCycle,
    Leapfrog,
    MiddleCycle,
    Multipliers,
    Responses,
    TreeParameters,
    WholeCycle,
)
from fmd.dynamics.compiled_system.positive_mass import explain_failure
from fmd.dynamics.compiled_system.reference_state import ReferenceState
from fmd.dynamics.compiled_system.sampling import Sampling
from fmd.dynamics.compiler.closures import scale_rows
from fmd.dynamics.compiler.middle import find_pattern
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.compiler.signal_code import are_smooth
from fmd.dynamics.compiler.turns import make_turns
from fmd.dynamics.elements import PointSpring
from fmd.dynamics.law_pieces import PiecewiseLaw, find_piecewise_laws
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.resolution import shortest_missed
from fmd.dynamics.signals.signal import quiet_times
from fmd.dynamics.step_bounds import StepBounds, make_step_bounds, no_bounds
from fmd.kernels.table import aligned


class CompiledSystem(ReferenceState):
    """A mechanism ready to be integrated; its functions are compiled when they are first wanted."""

    def __reduce__(self) -> tuple[type[CompiledSystem], tuple[Mechanism]]:
        """Make copies anew: addresses are this process's own."""
        return type(self), (self.mechanism,)

    @property
    def evaluation_cost(self) -> float:
        """Operations of an evaluation of the accelerations, by the size of their machine code."""
        return self.compiled.n_bytes() / BYTES_OF_OPERATION

    def explain_failure(self, failure: StabilityError) -> None:
        """Raise ``AccuracyError`` if a march failed because a motion of the system lost its inertia."""
        explain_failure(self, failure)

    @property
    def groups(self) -> tuple[IntArray, IntArray]:
        """Group of like coordinates that each position and each rate belongs to."""
        return self.mechanism.groups

    def describe_coordinate(self, number: int, is_rate: bool) -> str:
        """Return the joint or the body that a position, or a rate, belongs to."""
        return self.mechanism.describe_coordinate(number, is_rate)

    @property
    def settles(self) -> bool:
        """True if the end of a step is changed after it: loops close, or quaternions become unit ones."""
        return bool(self.compiled.rows) or self.n_positions != self.n

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times at which a load or a motion jumps, has a kink or begins to vary much faster [s], ascending."""
        return self.mechanism.breakpoints

    @property
    def shortest_action(self) -> float:
        """Shortest time for which a load acts between two times without it [s]; infinity if none does."""
        return min((activity.shortest_action for activity in self.mechanism.activities), default=np.inf)

    def resolving_step(self, step: float) -> tuple[float, float]:
        """Return the longest step up to a given one that steps over no load, and how long the shortest one acts [s].

        That is infinity if the given step resolves all loads.
        """
        acting, end, lasts = self.mechanism.acting, self.mechanism.horizon, np.inf
        for _ in range(MOST_TRIALS):
            missed = self.shortest_action
            if step * STEPS_IN_ACTION <= missed:
                missed = min((shortest_missed(signal, end, step, order) for signal, order in acting), default=np.inf)
            if missed == np.inf:
                break
            lasts, step = missed, missed / STEPS_IN_ACTION
        return step, lasts

    @cached_property
    def coupled(self) -> bool:
        """True if coordinates couple through the mass matrix in some state."""
        return find_inertial_coupling(self.compiled)

    @property
    def parameters(self) -> CompiledParameters:
        """Addresses and arrays for the kernels, with room to work in that is the caller's own."""
        return self._parameters.renewed()

    @cached_property
    def _parameters(self) -> CompiledParameters:
        layout, quaternions = self.mechanism.layout, []
        for link, rate, first in zip(self.mechanism.links, layout.rate, layout.position, strict=True):
            if link.joint.turns_in_space:
                quaternions.append((int(rate) + link.n_scalars, int(first) + link.n_scalars))
        address, rows = self.compiled.address, self.compiled.rows
        own: dict[str, Any] = {
            "accelerations": 0 if rows else address("accelerations"),
            "signals": address("signals") if self.compiled.signals else 0,
            "inputs": np.concatenate([np.zeros(3 * len(self.compiled.signals)), self.compiled.numbers]),
            "clock": np.full(2, np.nan),
            "position": self.mechanism.position_of_rates,
            "quaternions": (places := np.array(quaternions, dtype=np.int64).reshape(-1, 2)),
            "turns": make_turns(places, ""),
        }
        if not rows:
            return TreeParameters(**own)
        n_rows, n_blocks = len(rows), -(-len(rows) // LANES)
        units = np.zeros((n_blocks, n_rows, LANES))
        for k in range(n_rows):
            units[k // LANES, k, k % LANES] = 1.0
        g, rates, w = aligned(*3 * [n_rows])
        return ClosedParameters(
            **own,
            closed=address("closed"),
            multipliers=address("multipliers"),
            residuals=address("residuals"),
            units=units,
            J=np.zeros((n_blocks, self.n, LANES)),
            whole=self._multipliers(),
            slow=self._multipliers(),
            g=g,
            rates=rates,
            w=w,
        )

    def _multipliers(self) -> Multipliers:
        """Room for how the constraints push the mechanism."""
        n_rows = len(self.compiled.rows)
        n_blocks = -(-n_rows // LANES)
        multiplier, total, room = aligned(n_rows, n_rows, n_rows)
        (push,) = aligned(self.n)
        return Multipliers(
            x=np.zeros((n_blocks, self.n, LANES)),
            s=np.zeros((n_blocks, n_rows, LANES)),
            S=np.zeros((n_rows, n_rows)),
            scale=1.0 / np.sqrt(self.constraint_scales),
            order=np.arange(n_rows),
            rank=np.zeros(1, dtype=np.int64),
            fresh=np.ones(1),
            anew=np.zeros(1, dtype=np.int64),
            multiplier=multiplier,
            total=total,
            push=push,
            room=room,
        )

    @cached_property
    def constraint_scales(self) -> Array:
        """How fast unit multipliers would accelerate the residuals of free rigid bodies, shape (n_rows,)."""
        return scale_rows(self.mechanism, self.compiled.rows)

    @property
    def step_bounds(self) -> StepBounds:
        """Bounds of a step by force laws with short pieces, with room of their own."""
        laws, n_signals = self.piecewise_laws, len(self.compiled.signals)
        if not laws:
            return no_bounds()
        rests = [law.holder.rest if isinstance(law.holder, PointSpring) else np.nan for law in laws]
        return make_step_bounds(
            self.compiled.address("elongations"),
            self.compiled.address("signals") if n_signals else 0,
            n_signals,
            [law.pieces.edges for law in laws],
            np.array([law.pieces.beyond for law in laws]),
            np.array(rests),
        )

    @property
    def is_sampled(self) -> bool:
        """True if controllers measure now and then: steps have to end there."""
        return bool(self.mechanism.controllers)

    def sampling(self) -> Sampling | None:
        """Return the sampled controllers for one march, with nothing in their memory; none if there are none."""
        mechanism = self.mechanism
        return Sampling(self.compiled, mechanism.controllers, len(mechanism.held)) if mechanism.controllers else None

    @cached_property
    def piecewise_laws(self) -> tuple[PiecewiseLaw, ...]:
        """Force laws with pieces so short that a step may miss them."""
        return find_piecewise_laws(self.mechanism)

    @cached_property
    def couplings(self) -> Couplings:
        """Structure of the fast coordinates' equations."""
        return find_couplings(self.compiled)

    @cached_property
    def _whole_cycles(self) -> dict[int, WholeCycle]:
        return {}

    def leapfrog(self) -> Leapfrog:
        """Fresh storage for leapfrog steps."""
        return self._leapfrog.renewed()

    @property
    def leap_in_lanes(self) -> int:
        """Address of a leapfrog step of eight states at once, each with numbers of its own; 0 if there is none."""
        return 0 if self.settles or self.mechanism.contacts else self.compiled.address("leap_in_lanes")

    @cached_property
    def _leapfrog(self) -> Leapfrog:
        step, v_now = aligned(1, self.n)
        plain = not (len(self._parameters.quaternions) or self.compiled.rows)
        own = plain and self.compiled.n_bytes("accelerations") < MOST_IN_LEAP
        return Leapfrog(self.compiled.address("leap") if own else 0, step, v_now)

    def frozen(self, cycle: float) -> FrozenCycle | ClosedCycle:
        """Fresh storage for the fast coordinates' equation over a major cycle of a duration [s]."""
        if self.compiled.rows:
            q, v, a = aligned(self.n_positions, self.n, self.n)
            D = np.zeros((self.n, self.n_slow))
            return ClosedCycle(self._middle(cycle), D, np.array([SHARE_AHEAD * cycle]), q, v, a)
        frozen = self._frozen_cycle.renewed()
        frozen.cycle[0] = cycle
        return frozen

    def cycle(self, h: float, count: int) -> WholeCycle | None:
        """Fresh storage for a major cycle of so many fast steps h [s]; none if fast coordinates couple, or loops do."""
        if not self.takes_whole_cycles or count < 2:
            return None
        if count not in self._whole_cycles:
            self._whole_cycles[count] = self._new_cycle(count)
        cycle = self._whole_cycles[count].renewed()
        cycle.steps[:2] = (h, count * h)
        return cycle

    def carried_cycle(self) -> CarriedCycle | None:
        """Fresh storage for a major cycle by carried forces; none where a leapfrog step is no function of its own."""
        if not self._leapfrog.leap:
            return None
        return CarriedCycle(self.compiled.address("carried_cycle"), np.zeros(1))

    def _new_cycle(self, count: int) -> WholeCycle:
        signals, address, mass = self.compiled.signals, self.compiled.address, self.couplings.mass
        assert mass is not None
        n_blocks, n_inputs = -(-max(count, STEPS_AHEAD) // LANES), 3 * len(signals)
        return WholeCycle(
            cross=address("damped_cycle" if self.couplings.damped else f"cycle{count}"),
            signals_ahead=address("signals_ahead") if signals and are_smooth(signals) else 0,
            count=count,
            varying=np.zeros(1, dtype=np.int64),
            steps=np.zeros(6),
            inverse_mass=_inverses(mass),
            quiet=np.array(quiet_times(signals)).reshape(-1, 2),
            start=np.zeros(2),
            numbers=np.arange(LANES, dtype=float),
            now=np.zeros(n_inputs),
            ahead=np.zeros((n_blocks, n_inputs, LANES)),
            known=np.zeros(2, dtype=np.int64),
        )

    @cached_property
    def _frozen_cycle(self) -> FrozenCycle:
        return self._new_frozen(self._is_single, self.couplings.damped)

    @property
    def has_loops(self) -> bool:
        """True if constraints close loops."""
        return bool(self.compiled.rows)

    @property
    def has_tangents(self) -> bool:
        """True if tangents of a motion can be marched beside it: nothing samples."""
        return not self.is_sampled

    def contact_numbers(self, signs: Array) -> tuple[Array, ...]:
        """Return arrays of what contacts depend on, whose modes' shapes have signs (n,): none where nothing touches."""
        return ()

    @property
    def takes_whole_cycles(self) -> bool:
        """True if a major cycle of sub-cycling is one function: no fast coordinates couple, and nothing settles."""
        return self._is_single and not self.settles

    @property
    def _is_single(self) -> bool:
        """True if the fast coordinates couple neither by their constant mass nor by their forces."""
        return self.couplings.mass is not None and not self.couplings.elastic

    def _new_frozen(self, single: bool, damped: bool) -> FrozenCycle:
        couplings, n, n_fast = self.couplings, self.n, self.n - self.n_slow
        vectors = ("constant", "slope", "load", "k", "c", "drift", "by_positions", "by_rates", "v_now")
        n_inputs, address = 3 * len(self.compiled.signals), self.compiled.address
        step = "fast_step" if damped else "undamped_fast_step"
        return FrozenCycle(
            freeze_single=address("freeze_single") if single else 0,
            find_drift=0 if single else address("drift"),
            stiffness=0 if single else address("stiffness"),
            damping=address("damping") if damped and not single else 0,
            solve_fast=0 if single else address("solve_fast"),
            unrolled=0 if single or n_fast > MOST_UNROLLED else address(step),
            n_slow=self.n_slow,
            single=single,
            damped=damped,
            cycle=np.zeros(1),
            driven=couplings.driven,
            inverse_mass=np.zeros(n) if couplings.mass is None else _inverses(couplings.mass),
            time=np.zeros(1),
            active=np.zeros(1),
            breakpoints=np.array(self.breakpoints, dtype=float),
            before=np.zeros(n_inputs),
            now=np.zeros(n_inputs),
            changes=np.zeros((STEPS_AHEAD, len(couplings.driven))),
            lever=np.zeros((len(couplings.driven), n)),
            K=np.zeros((n_fast, n_fast)),
            C=np.zeros((n_fast, n_fast)),
            clock=np.zeros(2),
            unit_positions=self._units(self.n_positions),
            unit_rates=self._units(n),
            moved=np.zeros(self.n_positions),
            by_inputs=np.zeros((n_inputs, n)),
            f=np.zeros((n, LANES)),
            x=np.zeros((n, LANES)),
            **dict(zip(vectors, aligned(*[n] * len(vectors)), strict=True)),
        )

    def _units(self, size: int, count: int = 0) -> Array:
        """Directions of the last of so many coordinates, the fast ones, in blocks of eight (n_blocks, size, 8)."""
        count = count or self.n - self.n_slow
        units = np.zeros((-(-count // LANES), size, LANES))
        for j in range(count):
            units[j // LANES, size - count + j, j % LANES] = 1.0
        return units

    def responses(self) -> Responses:
        """Fresh storage for the accelerations of unit forces."""
        return self._responses.renewed()

    @cached_property
    def _responses(self) -> Responses:
        address, units = self.compiled.address, self._units(self.n, self.n)
        together, short = 0 if self.compiled.rows else address("responses"), self.n <= MOST_TOGETHER
        pattern = find_pattern(*self.linear_matrices[1:])
        middle, step = (address(f"{name}{pattern}") if short else 0 for name in ("middle", "middle_step"))
        return Responses(together, address("solve"), middle, step, units)

    def _middle(self, cycle: float) -> MiddleCycle:
        """Fresh storage for the fast equation of a mechanism with loops over a major cycle of a duration [s]."""
        address, (rest, row) = self.compiled.address, np.zeros((2, self.n))
        frozen = self._new_frozen(False, self.couplings.dragging)
        frozen.cycle[0] = cycle
        return MiddleCycle(
            frozen=frozen,
            inertia=address("inertia"),
            solve=address("solve"),
            solve_slow=address("solve_slow"),
            along_positions=self._units(self.n_positions),
            along_rates=self._units(self.n),
            y=np.zeros(self.n_slow),
            rest=rest,
            row=row,
        )


def _inverses(mass: Array) -> Array:
    """Return 1 over each mass, and 0 for none."""
    return np.divide(1.0, mass, out=np.zeros(len(mass)), where=mass != 0.0)
