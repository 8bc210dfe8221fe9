"""Rainflow counting of a history and the damage of its cycles (ASTM E1049-85, section 5.4.4).

A range is counted as a cycle when the next one is at least as large; one that holds the history's start, and each that
is left at the end, is half a cycle.
"""

from __future__ import annotations

import math

from fmd.core.arrays import Array
from fmd.kernels.kernel import inner, kernel

NO_MEAN, GOODMAN, FKM = range(3)
"""Corrections for mean stress, as numbers for kernels."""


@inner
def keep_reversals(history: Array, reversals: Array) -> int:
    """Fill an array of the same length with where a history turns, begins and ends; return how many places there are.

    Values that repeat count once.
    """
    n = history.size
    if n == 0:
        return 0
    reversals[0] = 0.0
    count, last, rise = 1, 0, 0.0
    for k in range(1, n):
        step = history[k] - history[last]
        if step == 0.0:
            continue
        if step * rise < 0.0:
            reversals[count] = last
            count += 1
        rise, last = step, k
    if rise != 0.0:
        reversals[count] = last
        count += 1
    return count


@kernel
def count_rainflow(history: Array, stack: Array, cycles: Array) -> int:
    """Count the cycles of a history (n,) and return how many ranges there are.

    Filled are cycles (3, n): where each range begins and ends, and 1 for a cycle or 0.5 for half of one. The stack (2,
    n) is room to work in.
    """
    return rainflow(history, stack, cycles)


@inner
def rainflow(history: Array, stack: Array, cycles: Array) -> int:
    """Count the cycles of a history, for other kernels; see `count_rainflow`."""
    reversals, open_ends = stack[0], stack[1]
    starts, ends, counts = cycles[0], cycles[1], cycles[2]
    n_reversals = keep_reversals(history, reversals)
    depth, n = 0, 0
    for k in range(n_reversals):
        open_ends[depth] = reversals[k]
        depth += 1
        while depth >= 3:
            first, middle = history[int(open_ends[depth - 3])], history[int(open_ends[depth - 2])]
            if abs(history[int(open_ends[depth - 1])] - middle) < abs(middle - first):
                break
            starts[n], ends[n] = open_ends[depth - 3], open_ends[depth - 2]
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
        starts[n], ends[n], counts[n] = open_ends[k], open_ends[k + 1], 0.5
        n += 1
    return n


@inner
def largest_within(history: Array, values: Array, start: int, end: int) -> float:
    """Return the largest of some values while a history goes through a cycle: there, and back to where it began."""
    level, rises = history[start], history[end] > history[start]
    largest: float = values[start]
    for k in range(start, history.size):
        if k > end:
            if rises and history[k] <= level:
                break
            if not rises and history[k] >= level:
                break
        largest = max(largest, values[k])
    return largest


@inner
def equivalent_amplitude(amplitude: float, mean: float, correction: int, constant: float) -> float:
    """Return the amplitude about zero that does the same damage as one about a mean stress.

    The correction is ``NO_MEAN``, ``GOODMAN`` or ``FKM``. Its constant is the tensile strength [Pa] for Goodman's line,
    which lets pressure do no good, or the sensitivity to mean stress M for the four straight lines of the FKM guideline
    (section 4.4.2).
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
    reaches Goodman's tensile strength. So the sum over all points is a bound. Stresses (n_nodes, n_stretches) bound
    those by size in each stretch of time [Pa], of which points (n_stretches,) are output times; for the law see
    `history_damage`.
    """
    for node in range(stresses.shape[0]):
        damage[node] = 0.0
        for k in range(points.size):
            stress = stresses[node, k]
            broken = law[0] == GOODMAN and stress >= law[1]
            damage[node] += points[k] * (1.0 if broken else cycle_damage(stress, law))


@inner
def history_damage(history: Array, law: Array, room: Array) -> float:
    """Return Miner's sum over a history of stress (n,) [Pa].

    The law (7,) has the correction for mean stress and its constant; amplitude [Pa] and cycles at the knee; slope above
    and below it; Findley's coefficient. Room (5, n) is to work in.
    """
    cycles, total, correction = room[2:], 0.0, int(law[0])
    n = rainflow(history, room[:2], cycles)
    for k in range(n):
        a, b = history[int(cycles[0, k])], history[int(cycles[1, k])]
        amplitude = equivalent_amplitude(0.5 * abs(b - a), 0.5 * (a + b), correction, law[1])
        total += cycles[2, k] * cycle_damage(amplitude, law)
    return total


@inner
def findley_damage(shear: Array, normal: Array, law: Array, room: Array) -> float:
    """Return Miner's sum of a plane by the cycles of its shear stress, each with its largest normal stress.

    The amplitude of a cycle is that of uniaxial stress about zero with the same ``τ_a + k σ_n``, which on its worst
    plane is ``σ (k + √(1 + k²))/2`` (Findley, J Eng Ind 81, 1959). Pressure on a plane does good, but no more than to
    take all damage away. Shear (n,) is along one direction of the plane [Pa]; law and room are those of
    `history_damage`.
    """
    cycles, total, k_normal = room[2:], 0.0, law[6]
    uniaxial = 0.5 * (k_normal + math.sqrt(1.0 + k_normal * k_normal))
    n = rainflow(shear, room[:2], cycles)
    for k in range(n):
        start, end = int(cycles[0, k]), int(cycles[1, k])
        across = largest_within(shear, normal, start, end)
        amplitude = (0.5 * abs(shear[end] - shear[start]) + k_normal * across) / uniaxial
        total += cycles[2, k] * cycle_damage(max(0.0, amplitude), law)
    return total
