"""Rainflow counting of a history and the damage of its cycles (ASTM E1049-85, section 5.4.4).

A range is counted as a cycle when the next one is at least as large; one that holds the history's start, and each that
is left at the end, is half a cycle.
"""

from __future__ import annotations

import math

from fmd.core.arrays import Array
from fmd.dynamics.jit.compiled import inner, kernel

NO_MEAN, GOODMAN, FKM = range(3)
"""Corrections for mean stress, as numbers for kernels."""


@inner
def keep_reversals(history: Array, reversals: Array) -> int:
    """Fill an array of the same length with a history's turning points, its first and its last value; return how many.

    Values that repeat count once.
    """
    n = history.size
    if n == 0:
        return 0
    reversals[0] = history[0]
    count, last, way = 1, history[0], 0.0
    for k in range(1, n):
        step = history[k] - last
        if step == 0.0:
            continue
        if step * way < 0.0:
            reversals[count] = last
            count += 1
        way, last = step, history[k]
    if way != 0.0:
        reversals[count] = last
        count += 1
    return count


@kernel
def count_rainflow(history: Array, stack: Array, ranges: Array, means: Array, counts: Array) -> int:
    """Count the cycles of a history and return how many ranges there are.

    Parameters
    ----------
    history : ndarray, shape (n,)
    stack : ndarray, shape (2, n)
        Room to work in.
    ranges, means, counts : ndarray, shape (n,)
        Filled: range, mean, and 1 for a cycle or 0.5 for half of one.
    """
    return rainflow(history, stack, ranges, means, counts)


@inner
def rainflow(history: Array, stack: Array, ranges: Array, means: Array, counts: Array) -> int:
    """Count the cycles of a history, for other kernels; see `count_rainflow`."""
    reversals, open_ends = stack[0], stack[1]
    n_reversals = keep_reversals(history, reversals)
    depth, n = 0, 0
    for k in range(n_reversals):
        open_ends[depth] = reversals[k]
        depth += 1
        while depth >= 3:
            newest = abs(open_ends[depth - 1] - open_ends[depth - 2])
            before = abs(open_ends[depth - 2] - open_ends[depth - 3])
            if newest < before:
                break
            ranges[n], means[n] = before, 0.5 * (open_ends[depth - 2] + open_ends[depth - 3])
            if depth == 3:
                counts[n] = 0.5
                open_ends[0], open_ends[1] = open_ends[1], open_ends[2]
                depth = 2
            else:
                counts[n] = 1.0
                open_ends[depth - 3] = open_ends[depth - 1]
                depth -= 2
            n += 1
    for k in range(depth - 1):
        ranges[n] = abs(open_ends[k + 1] - open_ends[k])
        means[n], counts[n] = 0.5 * (open_ends[k] + open_ends[k + 1]), 0.5
        n += 1
    return n


@inner
def equivalent_amplitude(amplitude: float, mean: float, correction: int, constant: float) -> float:
    """Return the amplitude about zero that does the same damage as one about a mean stress.

    Parameters
    ----------
    correction : int
        ``NO_MEAN``, ``GOODMAN`` or ``FKM``.
    constant : float
        Tensile strength [Pa] for Goodman's line, which lets pressure do no good; sensitivity to mean stress M for the
        four straight lines of the FKM guideline (section 4.4.2).
    """
    if correction == GOODMAN and mean > 0.0:
        return amplitude / (1.0 - mean / constant) if mean < constant else math.inf
    if correction == FKM and amplitude > 0.0:
        if mean < -amplitude:  # R > 1
            return amplitude * (1.0 - constant)
        if mean <= amplitude:  # R up to 0
            return amplitude + constant * mean
        lower = (1.0 + constant) / (1.0 + constant / 3.0)
        if mean < 3.0 * amplitude:  # R up to 0.5
            return lower * (amplitude + constant / 3.0 * mean)
        return amplitude * lower * (1.0 + constant)
    return amplitude


@inner
def cycle_damage(amplitude: float, law: Array) -> float:
    """Return Miner's damage of a cycle about zero: ``(σ/σ_k)^slope / N_k``; ``law`` is that of `history_damage`.

    It is 1 at most: a cycle can do no more than break a part.
    """
    ratio = amplitude / law[2]
    slope = law[4] if ratio >= 1.0 else law[5]
    if ratio == 0.0 or slope == math.inf:
        return 0.0
    damage: float = ratio**slope / law[3]
    return min(1.0, damage)


@kernel
def bound_damage(stresses: Array, points: Array, law: Array, damage: Array) -> None:
    """Fill a bound of the damage (n_nodes,) of any history that stays below given stresses.

    A turning point ends one whole cycle, or two halves. Amplitude and mean of a cycle add up to the larger of its two
    points by size; by any correction it does no more damage than the cycle about zero that reaches this, unless it
    reaches Goodman's tensile strength. So the sum over all points is a bound.

    Parameters
    ----------
    stresses : ndarray, shape (n_nodes, n_stretches)
        Bound of the stress by size in each stretch of time [Pa].
    points : ndarray, shape (n_stretches,)
        Number of output times in each.
    law : ndarray, shape (6,)
        See `history_damage`.
    damage : ndarray, shape (n_nodes,)
    """
    for node in range(stresses.shape[0]):
        damage[node] = 0.0
        for k in range(points.size):
            stress = stresses[node, k]
            broken = law[0] == GOODMAN and stress >= law[1]
            damage[node] += points[k] * (1.0 if broken else cycle_damage(stress, law))


@inner
def history_damage(history: Array, law: Array, room: Array) -> float:
    """Return Miner's sum over a history.

    Parameters
    ----------
    history : ndarray, shape (n,)
        Stress [Pa].
    law : ndarray, shape (6,)
        Correction for mean stress and its constant; amplitude [Pa] and cycles at the knee; slope above and below it.
    room : ndarray, shape (5, n)
        To work in.
    """
    ranges, means, counts = room[2], room[3], room[4]
    n, total, correction = rainflow(history, room[:2], ranges, means, counts), 0.0, int(law[0])
    for k in range(n):
        total += counts[k] * cycle_damage(equivalent_amplitude(0.5 * ranges[k], means[k], correction, law[1]), law)
    return total
