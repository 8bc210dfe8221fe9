"""Control of a step by its error, which counts relative to what each group of coordinates has moved so far."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.stepping import RATE_ROUND_OFF, STEP_SAFETY, STILL_GROUP
from fmd.dynamics.system import System, note_held
from fmd.kernels.kernel import inner, kernel


def groups_of(system: System) -> IntArray:
    """Return the group of each position and then of each rate, -1 for what doesn't count.

    Each coordinate is one if the system has no groups.
    """
    positions, rates = system.groups or (np.arange(system.n_positions), np.arange(system.n))
    if not positions.size:
        return rates
    return np.concatenate((positions, np.where(rates < 0, -1, rates + (positions.max() + 1))))


def kinds_of(system: System) -> tuple[IntArray, int]:
    """Return the kind of each group of `groups_of`, (n_groups,), and their number; 0 if none has two groups."""
    in_positions, in_rates = (set(groups[groups >= 0].tolist()) for groups in system.groups or 2 * [np.zeros(0, int)])
    if all(len({group % 3 for group in used}) == len(used) for used in (in_positions, in_rates)):
        return np.zeros(0, dtype=np.int64), 0
    numbers = [range(max(used, default=-1) + 1) for used in (in_positions, in_rates)]
    return np.array([k % 3 for k in numbers[0]] + [3 + k % 3 for k in numbers[1]], dtype=np.int64), 6


@inner
def just_after(t: float) -> float:
    """Return the time at which a step that begins at t evaluates loads: after a jump at t, not before it."""
    return float(np.nextafter(t, math.inf))


@inner
def just_before(t: float) -> float:
    """Return the time at which a step that ends at t evaluates loads: before a jump at t, not after it."""
    return float(np.nextafter(t, -math.inf))


@kernel
def step_within(h: float, left: float) -> float:
    """Return a step h, what is left to the next breakpoint, or half of that if a short rest would remain."""
    if h >= left * (1.0 - 1e-9):
        return left
    return 0.5 * left if h > 0.5 * left else h


def balance_of_groups(groups: IntArray, n_positions: int, sizes: Array) -> Array:
    """Return the largest of the balanced accelerations of each group's rates, (n_groups,), sizes being those of all.

    Groups of positions have those of the rates that move them.
    """
    found = np.zeros(int(groups.max(initial=-1)) + 1)
    rates, n_moved = groups[n_positions:], int(groups[:n_positions].max(initial=-1)) + 1
    np.maximum.at(found, rates[rates >= 0], sizes[rates >= 0])
    both = min(n_moved, len(found) - n_moved)
    found[:both] = found[n_moved : n_moved + both]
    return found


@inner
def note_balance(p: Any, groups: IntArray, n_positions: int, largest: Array, balance: Array) -> None:
    """Raise the balance of groups that rest to what constraints held of the accelerations that were evaluated last."""
    note_held(p, groups[n_positions:], largest, balance)
    share_balance(groups, n_positions, balance)


@inner
def share_balance(groups: IntArray, n_positions: int, balance: Array) -> None:
    """Raise the balance of groups of positions to those of the rates that move them."""
    n_moved = 0
    for i in range(n_positions):
        n_moved = max(n_moved, groups[i] + 1)
    for k in range(min(n_moved, balance.size - n_moved)):
        balance[k] = max(balance[k], balance[n_moved + k])


@kernel
def raise_balance(p: Any, groups: IntArray, n_positions: int, largest: Array, balance: Array) -> None:
    """Raise the balance of groups as `note_balance` does."""
    note_balance(p, groups, n_positions, largest, balance)


@inner
def scaled_error(groups: IntArray, largest: Array, balance: Array, error: Array, n_positions: int, h: float) -> float:
    """Return the largest error (n,) over its group's largest value; NaN if an error or a value isn't finite.

    The round-off of accelerations that ``balance_of_groups`` tells is taken off: where all rests it is as large as what
    has moved. A group of -1 doesn't count; the largest values (n_groups,) include the end of the trial step of length h
    [s]; the first ``n_positions`` errors are of positions, the others of rates.
    """
    worst = 0.0
    for i in range(groups.size):
        if groups[i] < 0:
            continue
        noise = RATE_ROUND_OFF * h * balance[groups[i]] * (h if i < n_positions else 1.0)
        ratio = (abs(error[i]) - noise) / max(largest[groups[i]], STILL_GROUP)
        if not (math.isfinite(error[i]) and math.isfinite(largest[groups[i]])):
            return math.nan
        worst = max(worst, ratio)
    return worst


@kernel
def keep_largest(groups: IntArray, largest: Array, new: Array) -> None:
    """Raise each group's largest value to that of a state; a NaN stays, so that it is noticed."""
    for i in range(groups.size):
        size = abs(new[i])
        if groups[i] >= 0 and not size <= largest[groups[i]]:
            largest[groups[i]] = size


@inner
def step_factor(error: float, tolerance: float, order: int) -> float:
    """Return the factor that takes a step with an error of this order to the tolerance, within 0.2 … 4."""
    if error == 0.0:
        return 4.0
    if not math.isfinite(error):
        return 0.2
    wanted: float = STEP_SAFETY * (tolerance / error) ** (1.0 / order)
    return min(4.0, max(0.2, wanted))
