"""Activity of a signal before a march: the times at which it acts, and those at which it begins to vary fast."""

import math
from functools import lru_cache

import numpy as np

from fmd.core.arrays import Array, BoolArray
from fmd.core.data_classes import dataclass
from fmd.core.limits import loads as limits
from fmd.dynamics.signals.bounds import PieceBounds, Series
from fmd.dynamics.signals.signal import Signal


@dataclass(frozen=True)
class Activity:
    """Pieces of time on each of which a signal is close to a parabola or next to nothing."""

    times: Array  # (n_pieces + 1,): ends of the pieces [s]
    quiet: BoolArray  # (n_pieces,): pieces on which the signal stays below 1e-9 of its largest value
    unresolved: BoolArray  # (n_pieces,): pieces with fast vibrations all along that were not divided further
    kinks: tuple[float, ...]  # times at which abs, min or max change their branch [s]

    @property
    def events(self) -> tuple[float, ...]:
        """Times at which a much faster variation begins, the pieces' ends that follow, and kinks [s]."""
        lengths = np.diff(self.times)
        if self.unresolved.any() and not self.unresolved.all():
            lengths[self.unresolved] = np.median(lengths[~self.unresolved])
        found, longest, left = [], lengths[0], 0
        for begin, length in zip(self.times[1:-1], lengths[1:], strict=True):
            if length * limits.SHORTER <= longest:
                longest, left = length, limits.STOPS
            longest = max(longest, length)
            if left:
                found.append(float(begin))
                left -= 1
        return tuple(sorted({*found, *self.kinks}))

    @property
    def shortest_action(self) -> float:
        """Shortest time for which the signal acts between two quiet pieces [s]; infinity if there is none."""
        ends = np.flatnonzero(np.diff(self.quiet.astype(int)))  # the last piece before each change
        begin = np.r_[self.times[0], self.times[ends + 1]]
        end = np.r_[self.times[ends + 1], self.times[-1]]
        acts = ~self.quiet[np.r_[ends, len(self.quiet) - 1]]
        beside = np.r_[False, np.ones(len(ends), dtype=bool)] | np.r_[np.ones(len(ends), dtype=bool), False]
        return float(np.min((end - begin)[acts & beside], initial=math.inf))


@lru_cache(maxsize=64)
def find_activity(signal: Signal, end: float, derivative: int = 0) -> Activity:
    """Divide the time up to an end [s] into pieces by halving, until each is quiet or close to a parabola.

    The derivative is 0 for a load, and 2 for a prescribed motion, whose acceleration acts.
    """
    knots = {float(t) for term in signal.terms for t in (*term.knots, *term.support) if 0.0 < t < end}
    fixed = np.array(sorted({0.0, end, *knots, *(t for t in signal.breakpoints if 0.0 < t < end)}))
    kinks = _find_kinks(signal, fixed, derivative)
    fixed = np.array(sorted({*fixed.tolist(), *kinks}))
    begin, finish, largest, inset = fixed[:-1], fixed[1:], 0.0, (limits.KINK_PART * end if kinks else 0.0)
    kept: list[tuple[Array, Array, Array, BoolArray]] = []
    with np.errstate(all="ignore"):
        for level in range(limits.HALVINGS + 1):
            margin = np.minimum(inset, 0.25 * (finish - begin))
            bound, rest, size, kinked, largest = _measure(signal, begin + margin, finish - margin, derivative, largest)
            least = np.where(kinked, limits.SMALL_KINK, limits.SMALL_REST) * largest
            rough = (bound > limits.QUIET * largest) & (rest > np.maximum(limits.SMOOTH_REST * size, least))
            rough &= level < limits.HALVINGS  # at a singularity pieces get ever shorter
            wanted = rough.copy()
            if wanted.sum() > limits.PIECES_AT_ONCE:  # the roughest first: a short pulse among fast vibrations
                wanted[np.argpartition(np.where(rough, -rest, 1.0), limits.PIECES_AT_ONCE)[limits.PIECES_AT_ONCE :]] = (
                    False
                )
            kept.append((begin[~wanted], finish[~wanted], bound[~wanted], rough[~wanted]))
            if not wanted.any():
                break
            begin, finish = _divide(begin[wanted], finish[wanted])
    starts, ends, bounds, unresolved = (np.concatenate(column) for column in zip(*kept, strict=True))
    order = np.argsort(starts)
    quiet = bounds[order] <= limits.QUIET * largest
    first = np.r_[True, ~(quiet[1:] & quiet[:-1])]  # quiet pieces side by side are one
    times = np.r_[starts[order][first], ends[order][-1]]
    return Activity(times, quiet[first], unresolved[order][first], kinks)


def _find_kinks(signal: Signal, fixed: Array, derivative: int) -> tuple[float, ...]:
    """Find the times just before abs, min or max change their branch; none if there are more than can be followed."""
    begin, finish = fixed[:-1], fixed[1:]
    with np.errstate(all="ignore"):
        for _ in range(limits.KINK_HALVINGS):
            _, rest, _, kinked, _ = _measure(signal, begin, finish, derivative, 0.0)
            followed = kinked & (rest > 0.0)
            if followed.sum() > limits.MOST_KINKS or not followed.any():
                return ()
            begin, finish = _divide(begin[followed], finish[followed])
        _, rest, _, kinked, _ = _measure(signal, begin, finish, derivative, 0.0)
    times = np.sort(begin[kinked & (rest > 0.0)])
    apart = np.diff(times, prepend=-math.inf) > limits.KINK_PART * fixed[-1]
    return tuple(times[apart & (times > 0.0)].tolist())


def _divide(begin: Array, end: Array) -> tuple[Array, Array]:
    """Divide pieces in two."""
    middle = begin + limits.FIRST_PART * (end - begin)
    return np.concatenate([begin, middle]), np.concatenate([middle, end])


def _measure(
    signal: Signal, begin: Array, end: Array, derivative: int, largest: float
) -> tuple[Array, Array, Array, BoolArray, float]:
    """Return each piece's bound, rest beyond a parabola, size and possible kinks, and the largest value so far."""
    h, middle = end - begin, 0.5 * (begin + end)
    (f, _, curvature), rough = _derivatives(signal, begin, end, derivative)
    (f0, f1, f2), _ = _derivatives(signal, middle, middle, derivative)
    at_middle = [np.abs(x[0]) for x in (f0, f1, f2)]
    size = np.nan_to_num(at_middle[0] + 0.5 * h * at_middle[1] + 0.125 * h**2 * at_middle[2], posinf=0.0)
    values = at_middle[0][np.isfinite(at_middle[0])]
    largest = max(largest, float(values.max(initial=0.0)))
    rest = np.where(rough, f[1] - f[0], 0.125 * h**2 * (curvature[1] - curvature[0]))
    bound = np.abs(f).max(axis=0)
    return bound, np.where(np.isnan(rest), math.inf, rest), np.where(rough, 0.0, size), rough, largest


def _derivatives(signal: Signal, begin: Array, end: Array, derivative: int) -> tuple[Series, BoolArray]:
    """Return bounds of a derivative of a signal and of its next two over pieces, and which pieces may have kinks."""
    pieces = PieceBounds(begin, end, derivative + 3)
    total = pieces.constant(0.0)
    for term in signal.terms:
        if term.codes:
            series = pieces.run_program(term.codes, term.numbers)
        elif term.knots:
            middle = 0.5 * (begin + end)
            at = np.clip(np.searchsorted(term.knots, middle, side="right") - 1, 0, None)
            cubics, knots = np.array(term.cubics)[at], np.array(term.knots)[at]
            cubics[middle < term.knots[0], 1:] = 0.0
            series = pieces.cubic(cubics, knots)
        else:
            series = pieces.constant(term.numbers[0])
        outside = (begin >= term.support[1]) | (end <= term.support[0])
        total = [x + np.where(outside, 0.0, y) for x, y in zip(total, series, strict=True)]
    found = [math.factorial(derivative + k) * total[derivative + k] for k in range(3)]
    return [np.where(np.isnan(x), np.array([[-math.inf], [math.inf]]), x) for x in found], pieces.rough
