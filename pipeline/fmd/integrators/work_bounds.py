"""Check of marches by fixed steps: the work of force laws that sampling at the steps' ends misses.

An elongation that goes from a to b takes the energy ``U(b) − U(a)`` of a law, whatever lies between; a method that
knows the force at the ends of its steps alone takes the trapezoids between them. What differs over one pass, from one
turn of the elongation to the next, is missed.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import StabilityError
from fmd.core.limits import stepping as limits
from fmd.dynamics.law_pieces import PiecewiseLaw
from fmd.dynamics.step_bounds import StepBounds, no_bounds, record_step_start, record_step_start_of
from fmd.kernels.kernel import inlined
from fmd.kernels.table import Table


@dataclass(frozen=True)
class ElongationLog(Table):
    """Elongations at the ends of some cycles of a march."""

    bounds: StepBounds
    origin: float  # time of step number 0, and the step [s]
    h: float
    x: Array  # (n_cycles, n_laws): elongations [m or rad]
    cursor: IntArray  # (1,): how many cycles are known


@inlined
def note_elongations(log: ElongationLog, step: int, q: Array, v: Array) -> None:
    """Note the elongations where a cycle ends, before a step of a number."""
    if log.bounds.elongations != 0:
        record_step_start(log.bounds, log.origin + step * log.h, q, v)
        for k in range(log.x.shape[1]):
            log.x[log.cursor[0], k] = log.bounds.x[k]
        log.cursor[0] += 1


def _log(bounds: StepBounds, origin: float, step: float, cycles: int) -> ElongationLog:
    return ElongationLog(bounds, origin, step, np.zeros((cycles, bounds.n_laws)), np.zeros(1, dtype=np.int64))


@cache
def _no_log() -> ElongationLog:
    """Return the log of nothing, in which no march writes."""
    return _log(no_bounds(), 0.0, 1.0, 0)


class WorkCheck:
    """Sums up the work that a march's fixed steps miss, by the system's force laws with short pieces, if it has any.

    ``origin`` is the time of step number 0 [s], and ``cycle`` the number of steps that belong together.
    """

    def __init__(self, system: Any, origin: float, step: float, cycle: int) -> None:
        bounds = system.step_bounds
        self._step, self._cycle = step, cycle
        self.most_steps = limits.CYCLES_BETWEEN_CHECKS * cycle if bounds.n_laws else np.iinfo(np.int64).max
        self.log = _log(bounds, origin, step, limits.CYCLES_BETWEEN_CHECKS) if bounds.n_laws else _no_log()
        self._passes = [_Passes(law) for law in system.piecewise_laws]

    @property
    def follows_laws(self) -> bool:
        """True if there is anything to check."""
        return bool(self._passes)

    def begin(self, number: int, q: Array, v: Array) -> None:
        """Note the elongations where a march begins, before a step of a number."""
        if self._passes:
            record_step_start_of(self.log.bounds, self.log.origin + number * self._step, q, v)
            self._last = self.log.bounds.x.copy()

    def add(self) -> None:
        """Take in the cycles that have been noted."""
        if self._passes:
            path = np.concatenate([self._last[None], self.log.x[: self.log.cursor[0]]])
            self._last, self.log.cursor[0] = path[-1].copy(), 0
            for passes, x in zip(self._passes, path.T, strict=True):
                passes.add(np.ascontiguousarray(x))

    def require_little_missed(self, name: str) -> None:
        """Check that the march missed little of each law's work.

        Raises
        ------
        StabilityError
            It missed too much; the message has a step that works.
        """
        for passes in self._passes:
            if (shorter := passes.times_as_many()) > 1:
                frozen = f", which freeze forces over {self._cycle} steps," if self._cycle > 1 else ""
                raise StabilityError(
                    f"{name}: steps of {self._step:.4g} s{frozen} miss {passes.share:.0%} of the work of "
                    f"{passes.name}, whose force changes too fast at {passes.place:.4g} {passes.unit}; a step of "
                    f"{round_down(self._step / shorter):g} s works, and methods that choose their steps find theirs"
                )


def round_down(step: float) -> float:
    """Return a step with two digits, no longer than the step itself [s]."""
    unit = 10.0 ** (math.floor(math.log10(step)) - 1)
    return math.floor(step / unit * (1 + 1e-9)) * unit


class _Passes:
    """Passes of one elongation, and the worst of them."""

    def __init__(self, law: PiecewiseLaw) -> None:
        self.name, self.unit = law.name, law.unit
        self._law, self._edges = law.law, law.pieces.edges
        self._low, self._high, self._worst, self._about = math.inf, -math.inf, 0.0, np.zeros(0)

    def add(self, x: Array) -> None:
        """Take in elongations at the ends of successive steps."""
        self._low, self._high = min(self._low, float(x.min())), max(self._high, float(x.max()))
        missed, worst = self._missed(x)
        if worst > self._worst:
            at = int(np.argmax(np.abs(missed)))
            self._worst, self._about = worst, x[max(at - limits.WORST_STEPS, 0) : at + limits.WORST_STEPS].copy()

    def _missed(self, x: Array) -> tuple[Array, float]:
        """Return the work that each step misses, and the most in a pass [J]."""
        moves = np.diff(x)
        if not moves.any():
            return np.zeros(len(moves)), 0.0
        forces = self._law.forces(x, np.zeros_like(x))
        missed = np.diff(self._law.energies(x)) - 0.5 * (forces[1:] + forces[:-1]) * moves
        way = np.sign(moves)
        starts = np.r_[0, np.flatnonzero(way[1:] * way[:-1] < 0.0) + 1]
        total = np.cumsum(missed)
        before = np.r_[0.0, total][starts]
        most = np.maximum(np.maximum.reduceat(total, starts), before)
        least = np.minimum(np.minimum.reduceat(total, starts), before)
        return missed, float((most - least).max())

    @property
    def _energy(self) -> float:
        """How much the law's energy differs over the elongations of the march [J]."""
        inside = self._edges[(self._edges > self._low) & (self._edges < self._high)]
        places = np.concatenate([np.linspace(self._low, self._high, limits.ELONGATIONS), inside])
        return float(np.ptp(self._law.energies(places)))

    @property
    def share(self) -> float:
        """Part of the law's work that was missed."""
        return self._worst / max(self._energy, 1e-300)

    @property
    def place(self) -> float:
        """Elongation about which most was missed [m or rad]."""
        missed, _ = self._missed(self._about)
        at = int(np.argmax(np.abs(missed)))
        return float(0.5 * (self._about[at] + self._about[at + 1]))

    def times_as_many(self) -> int:
        """Return how many times as many steps miss little; 1 if these do."""
        allowed, doublings = limits.MISSED_WORK * self._energy, 0
        if not self._worst > allowed:
            return 1
        numbers = np.arange(len(self._about))
        for doublings in range(1, limits.FINER_DOUBLINGS + 1):
            finer = np.interp(
                np.linspace(0.0, numbers[-1], (len(numbers) - 1) * 2**doublings + 1), numbers, self._about
            )
            if self._missed(finer)[1] <= limits.SURE_WORK * allowed:
                break
        return int(2**doublings)
