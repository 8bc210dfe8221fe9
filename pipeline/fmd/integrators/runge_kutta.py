"""Explicit Runge–Kutta method of order 8 by Dormand and Prince, compiled.

The tableau, the error estimate (of orders 5 and 3 together) and the dense output of order 7 are those of Hairer,
Nørsett & Wanner, Solving Ordinary Differential Equations I (1993), section II.10.

Weighted sums of slopes go in pieces of eight, four, two and one entries. LLVM makes of plain loops ones that read and
write the sum for every few rows, and that first look whether arrays overlap: with four entries to a row that takes
longer than the sum. One row more, which may have been written just before, is read entry by entry and added last: a
processor can't yet read a vector where it has just written single numbers, and waits for longer than the sum takes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.code import ROWS_AT_ONCE
from fmd.core.limits.contact import CHOSEN_STEP
from fmd.core.limits.stepping import DERIVED, LEAST_DERIVED
from fmd.dynamics.system import System, accelerations, contact_forces, velocities
from fmd.integrators import dop853
from fmd.integrators.adaptive import AdaptiveIntegrator
from fmd.integrators.adaptive_march import (
    AdaptiveMarch,
    begin_step,
    end_step,
    prepare_samples,
    sample_step,
    set_trial,
    try_step,
)
from fmd.integrators.protocol import Integrator
from fmd.integrators.step_control import just_after, just_before, scaled_error
from fmd.kernels.kernel import contracted, inlined, inner
from fmd.kernels.table import Table
from fmd.kernels.vectors import read_entries, read_vector, write_vector

DAMPED = 5.5  # radians in a step at which an undamped vibration shrinks most, by 0.70
_E3, _E5, _D = 16, 17, 18  # rows of the weights after those of the stages


@dataclass(frozen=True)
class _RungeKuttaSteps(Table):
    """Coefficients, a row for each stage, two errors and four of the dense output; and room for a step."""

    C: Array  # (16,): times of the stages in a step
    slope: IntArray  # (22, 16): numbers of the slopes that are summed, but for the one just before; filled up with 0
    weight: Array  # (22, 16): their weights, and 0
    length: IntArray  # (22,): how many they are, rounded up to four
    latest: Array  # (22,): weight of the slope just before
    K: Array  # (16, n_positions + n + 3 n_contacts): slopes at the stages
    dense: Array  # (7, n_positions + n)
    error: Array  # (n_positions + n,): room for an error, and zeros
    none: Array


def _coefficients() -> tuple[Array, IntArray, Array, IntArray, Array]:
    """Return the members C, slope, weight, length and latest of `_RungeKuttaSteps`."""
    slope, weight, length = np.zeros((22, 16), dtype=np.int64), np.zeros((22, 16)), np.zeros(22, dtype=np.int64)
    latest = np.zeros(22)
    for k, row in enumerate(dop853.ROWS):
        others = {number: size for number, size in row.items() if number != k - 1}
        latest[k] = row.get(k - 1, 0.0)
        slope[k, : len(others)], weight[k, : len(others)] = [*others], [*others.values()]
        length[k] = max(1, -(-len(others) // 4)) * 4
    return np.array(dop853.C), slope, weight, length, latest


@lru_cache(maxsize=16)
def _steps(n_all: int) -> _RungeKuttaSteps:
    """Return a table for so many positions, rates and impulses, to be renewed for each march."""
    return _RungeKuttaSteps(*_coefficients(), np.zeros((16, n_all)), np.zeros((7, n_all)), *np.zeros((2, n_all)))


@dataclass(frozen=True)
class RungeKutta(AdaptiveIntegrator):
    """Runge–Kutta method of order 8 that chooses its steps by a relative ``tolerance`` of each.

    A step has at most so many radians of the highest frequency of the reference state as ``reach`` says. It can't have
    more than 5.9 in the long run, where the fastest vibration begins to grow; at 5.5 it loses three tenths in a step.
    Without this bound steps grow until the error of that vibration stops them, again and again, and what it leaves is
    a thousand times the error of the rest.
    """

    tolerance: float = 1e-9
    reach: float = DAMPED
    looks: float = CHOSEN_STEP

    name = "runge-kutta"
    marches_tangents = True
    takes_contacts = True

    @property
    def differentiable(self) -> RungeKutta:
        """The method with a tolerance by which errors stay small as numbers change, though its steps don't follow."""
        return replace(self, tolerance=min(self.tolerance, max(DERIVED * self.tolerance, LEAST_DERIVED)))

    def order(self, system: System) -> int:
        """Return 8."""
        return 8

    @classmethod
    def ladders(cls, explicit: Sequence[float], coarse: Sequence[float]) -> Iterator[Sequence[Integrator]]:
        """Yield the method with six tolerances."""
        yield [cls(10.0**-k) for k in range(2, 13, 2)]

    def longest_step(self, system: System) -> float:
        """Return the step with so many radians of the highest frequency as ``reach`` says [s]."""
        if system.n_contact_values:
            return 0.5 * self.reach * system.largest_step  # with all points closed
        return self.reach / max(system.highest_frequency, 1e-150) if system.n else math.inf

    def room(self, system: System) -> _RungeKuttaSteps:
        """Return the coefficients and room for a step of a system."""
        return _steps(system.n_positions + system.n + 3 * system.n_contacts).renewed()


@inner
def _add_slopes(m: _RungeKuttaSteps, row: int, h: float, base: Array, out: Array) -> None:
    """Add a row's weighted sum of the slopes times h to a state, into ``out``."""
    before = row - 1 if 0 < row < m.K.shape[0] else 0  # only stages have a slope just before
    add_weighted_rows(base, m.K, m.slope[row], m.weight[row], m.length[row], before, m.latest[row], h, out)


@inlined
def _slope(m: _RungeKuttaSteps, p: Any, k: int, t: float, u: Array, n_positions: int, both: int) -> None:
    """Evaluate slope number k at a time t and ``both`` positions and rates u, and those of contacts' impulses."""
    velocities(p, u[:n_positions], u[n_positions:both], m.K[k, :n_positions])
    accelerations(p, t, u[:n_positions], u[n_positions:both], m.K[k, n_positions:both])
    contact_forces(p, m.K[k, both:])


@inner
def _stage(m: _RungeKuttaSteps, p: Any, k: int, t: float, h: float, s: AdaptiveMarch, u: Array) -> None:
    """Evaluate slope number k of a step, at ``t + C_k h``; u is the stage's state."""
    _add_slopes(m, k, h, s.begin, u)
    _slope(m, p, k, just_before(t + h) if m.C[k] == 1.0 else t + m.C[k] * h, u, s.q.size, s.q.size + s.v.size)


@begin_step.register(_RungeKuttaSteps)
def _begin_step(m: _RungeKuttaSteps, p: Any, s: AdaptiveMarch, t: float, h: float) -> None:
    """Evaluate the first slope; unless loads jump here, the last one of the step before has its accelerations."""
    if s.fresh[0] != 0.0:
        _slope(m, p, 0, just_after(t), s.begin, s.q.size, s.q.size + s.v.size)
        s.evaluations[0] += 1
        return
    velocities(p, s.q, s.v, m.K[0, : s.q.size])
    for i in range(s.a.size):
        m.K[0, s.q.size + i] = s.a[i]


@try_step.register(_RungeKuttaSteps)
def _try_step(m: _RungeKuttaSteps, p: Any, s: AdaptiveMarch, t: float, h: float, reached: float) -> float:
    """Take all stages; their error is that of orders 5 and 3 together: ``|e₅|² / √(|e₅|² + 0.01 |e₃|²)``.

    In contact it is that of order 5: forces that begin as a power of the depth aren't smooth, by which the other one
    is too low.
    """
    for k in range(1, 13):
        _stage(m, p, k, t, h, s, s.new)  # the last one is at the step's end, and new with it
    s.evaluations[0] += 12
    set_trial(s)
    third, fifth = _error(m, _E3, h, s), _error(m, _E5, h, s)
    if s.pressed[0] != 0.0:
        return fifth
    size = math.sqrt(fifth * fifth + 0.01 * third * third)
    return fifth * fifth / size if size > 0.0 else size


@inner
def _error(m: _RungeKuttaSteps, row: int, h: float, s: AdaptiveMarch) -> float:
    _add_slopes(m, row, h, m.none, m.error)
    return scaled_error(s.groups, s.trial, s.balance, m.error, s.q.size, h)


@prepare_samples.register(_RungeKuttaSteps)
def _prepare_samples(m: _RungeKuttaSteps, p: Any, s: AdaptiveMarch, t: float, h: float) -> None:
    """Compute the coefficients of the dense output, with three more stages."""
    for k in range(13, 16):
        _stage(m, p, k, t, h, s, s.out)
    s.evaluations[0] += 3
    for i in range(s.new.size):
        rise = s.new[i] - s.begin[i]
        m.dense[0, i] = rise
        m.dense[1, i] = h * m.K[0, i] - rise
        m.dense[2, i] = 2.0 * rise - h * (m.K[12, i] + m.K[0, i])
    for row in range(4):
        _add_slopes(m, _D + row, h, m.none, m.dense[3 + row])


@sample_step.register(_RungeKuttaSteps)
def _sample_step(m: _RungeKuttaSteps, p: Any, s: AdaptiveMarch, ahead: float, h: float) -> None:
    """Evaluate ``u + x (f₁ + (1 − x)(f₂ + x (f₃ + …)))`` with seven coefficients at a part x of the step."""
    x = ahead / h
    for i in range(s.out.size):
        total = m.dense[6, i] * x
        for row in range(5, -1, -1):
            total = (total + m.dense[row, i]) * (1.0 - x if row % 2 else x)
        s.out[i] = s.begin[i] + total


@end_step.register(_RungeKuttaSteps)
def _end_step(m: _RungeKuttaSteps, p: Any, s: AdaptiveMarch) -> None:
    for i in range(s.a.size):
        s.a[i] = m.K[12, s.q.size + i]


def _adder(width: int) -> Any:
    """Make the sum of `add_weighted_rows` for so many entries, from one on."""

    @contracted
    def add(
        base: Array,
        K: Array,
        row: IntArray,
        weight: Array,
        count: int,
        latest: int,
        latest_weight: float,
        h: float,
        out: Array,
        at: int,
    ) -> None:
        n = K.shape[1]
        one = weight[0] * read_vector(K, row[0] * n + at, width)  # two sums, which don't wait for each other
        other = weight[1] * read_vector(K, row[1] * n + at, width)
        one = one + weight[2] * read_vector(K, row[2] * n + at, width)
        other = other + weight[3] * read_vector(K, row[3] * n + at, width)
        for k in range(ROWS_AT_ONCE, count, ROWS_AT_ONCE):
            one = one + weight[k] * read_vector(K, row[k] * n + at, width)
            other = other + weight[k + 1] * read_vector(K, row[k + 1] * n + at, width)
            one = one + weight[k + 2] * read_vector(K, row[k + 2] * n + at, width)
            other = other + weight[k + 3] * read_vector(K, row[k + 3] * n + at, width)
        last = read_entries(K, latest * n + at, width)
        total = read_vector(base, at, width) + h * (one + other)
        write_vector(out, at, total + (h * latest_weight) * last)

    return add


_add_eight, _add_four, _add_two, _add_one = (_adder(width) for width in (8, 4, 2, 1))


@inlined
def add_weighted_rows(
    base: Array,
    K: Array,
    row: IntArray,
    weight: Array,
    count: int,
    latest: int,
    latest_weight: float,
    h: float,
    out: Array,
) -> None:
    """Compute ``out = base + h (Σ weight_k K[row_k] + latest_weight K[latest])`` over ``count`` rows k.

    Base and out (n,) may be the same, and overlap no row of K (any, n), of which number ``latest`` was written last.
    The count is four or a multiple of it; ``row`` and ``weight`` may be longer.
    """
    n, at = out.size, 0
    while at + 8 <= n:
        _add_eight(base, K, row, weight, count, latest, latest_weight, h, out, at)
        at += 8
    if at + 4 <= n:
        _add_four(base, K, row, weight, count, latest, latest_weight, h, out, at)
        at += 4
    if at + 2 <= n:
        _add_two(base, K, row, weight, count, latest, latest_weight, h, out, at)
        at += 2
    if at < n:
        _add_one(base, K, row, weight, count, latest, latest_weight, h, out, at)
