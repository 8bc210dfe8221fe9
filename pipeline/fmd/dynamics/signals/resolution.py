"""Resolution of a signal by steps of a fixed length: peaks and dips whose impulse the steps would miss."""

import math
from functools import lru_cache

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits import loads as limits
from fmd.dynamics.signals.activity import find_activity
from fmd.dynamics.signals.signal import Signal

_WITHIN = np.r_[1e-6, np.arange(1, 8) / 8, 1.0 - 1e-6]  # of a piece that is close to a parabola: where it is sampled


def shortest_missed(signal: Signal, end: float, step: float, derivative: int = 0) -> float:
    """Return the width of the narrowest peak or dip whose impulse steps don't carry [s]; infinity if they carry all.

    A peak counts from a tenth of the signal's range on. It is carried if it is as wide as some steps, or, from about
    one step on, if samples at the steps' ends and at their middles have its impulse, as those of a table at its knots.
    The derivative is 0 for a load, and 2 for a prescribed motion, whose acceleration acts.
    """
    if signal.is_constant:
        return math.inf
    resolved, height = _sample_resolved(signal, end, derivative)
    among = _sample_among_fast(signal, end, step, derivative)
    height = max([height, *(float(np.ptp(values)) for _, values in among)])
    if not math.isfinite(height):
        return math.inf
    stretches = (*resolved, *among)
    return min((_missed_in(signal, *stretch, height, step, end, derivative) for stretch in stretches), default=math.inf)


def _sample_among_fast(signal: Signal, end: float, step: float, derivative: int) -> list[tuple[Array, Array]]:
    """Sample a signal in windows among vibrations that are too fast to be followed all along."""
    activity, windows = find_activity(signal, end, derivative), []
    among = np.flatnonzero(activity.unresolved)
    for k in among[np.linspace(0, len(among) - 1, min(limits.WINDOWS, len(among))).astype(int)]:
        begin, length = activity.times[k], activity.times[k + 1] - activity.times[k]
        span = min(limits.WINDOW_STEPS * step, end - begin)
        n = int(min(limits.MOST_SAMPLES, max(limits.WINDOW_SAMPLES, 64.0 * span / length)))
        jitter = np.arange(n) * 0.6180339887498949 % 1.0  # lest samples keep pace with the vibration
        times = begin + span * (np.arange(n) + 0.5 * jitter) / n
        windows.append((times, signal.values(times)[:, derivative]))
    return windows


@lru_cache(maxsize=64)
def _sample_resolved(signal: Signal, end: float, derivative: int) -> tuple[tuple[tuple[Array, Array], ...], float]:
    """Sample a signal in each stretch of resolved pieces in which it varies by enough; return these, and its range."""
    activity = find_activity(signal, end, derivative)
    begin, length, fast = activity.times[:-1], np.diff(activity.times), activity.unresolved
    times = begin[:, None] + length[:, None] * _WITHIN
    values = signal.values(times.ravel())[:, derivative].reshape(times.shape)
    height = float(np.ptp(values))
    borders = np.flatnonzero(np.diff(fast)) + 1
    firsts = np.r_[0, borders]
    varies = np.maximum.reduceat(values.max(axis=1), firsts) - np.minimum.reduceat(values.min(axis=1), firsts)
    kept = np.flatnonzero(~fast[firsts] & ~(varies <= limits.LEAST_PEAK * height))
    kept = kept[np.argsort(-varies[kept], kind="stable")][: limits.MOST_STRETCHES]
    lasts = np.r_[borders, len(fast)]
    return tuple(
        (times[i:j].ravel(), values[i:j].ravel()) for i, j in zip(firsts[kept], lasts[kept], strict=True)
    ), height


def _missed_in(
    signal: Signal, times: Array, values: Array, height: float, step: float, end: float, derivative: int
) -> float:
    """Return the width of the narrowest peak or dip of a stretch that steps miss [s]."""
    steepest = float(np.abs(np.diff(values) / np.diff(times)).max(initial=0.0))
    if steepest * limits.NARROW * step < limits.DEPTH * limits.LEAST_PEAK * height:
        return math.inf  # no peak that counts is narrow
    narrow = sorted(
        peak for peak in _find_peaks(times, values, height, limits.AROUND * step) if peak[0] < limits.NARROW * step
    )
    impulse = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(times))])
    for width, left, right, level in narrow[:: max(1, len(narrow) // limits.MOST_PEAKS)]:
        if width < limits.NARROWEST_PEAK * step:
            return width
        low, high = max(0.0, math.floor(left / step) - 1.0), math.ceil(right / step) + 1.0
        if (times[0] > low * step and low) or (times[-1] < high * step < end):
            continue  # the stretch ends too near
        ends = np.clip(step * np.arange(low, high + 1.0), times[0], times[-1])
        lengths = np.diff(ends)
        at_ends = signal.values(ends)[:, derivative]
        at_middles = signal.values(0.5 * (ends[1:] + ends[:-1]))[:, derivative]
        whole = np.diff(np.interp([ends[0], ends[-1]], times, impulse))[0]
        own = np.diff(np.interp([left, right], times, impulse))[0] - level * (right - left)
        sampled = lengths @ (0.5 * (at_ends[1:] + at_ends[:-1])), lengths @ at_middles
        if max(abs(found - whole) for found in sampled) > limits.CARRIED * abs(own):
            return width
    return math.inf


def _find_peaks(times: Array, values: Array, height: float, around: float) -> list[tuple[float, float, float, float]]:
    """Find peaks and dips with their widths, where they begin and end [s], and the levels at which that is measured.

    How high a peak is counts from the higher one of the lowest values before and after it, not further away than
    ``around`` [s]: a blow on the top of a slow wave is as high as it is above that.
    """
    turns, peaks = _turning_points(values, limits.LEAST_PEAK * height), []
    for k, turn in enumerate(turns[:-1]):
        sign = 1.0 if values[turn] > values[turns[k + 1]] else -1.0
        first, last = np.searchsorted(times, [times[turn] - around, times[turn] + around])
        last = min(turns[k + 1], max(last - 1, turn + 1))
        first = max(turns[k - 1], min(first, turn - 1)) if k else turn
        depth = float(np.ptp(values[turn : last + 1]))
        if k:
            depth = min(depth, float(np.ptp(values[first : turn + 1])))
        elif times[0] > 0.1 * around or depth < limits.LEAST_AT_START * height:
            continue
        if depth < limits.LEAST_PEAK * height:
            continue
        level = values[turn] - sign * limits.DEPTH * depth
        right = _crossing(times, values, level, range(turn, last + 1))
        left = _crossing(times, values, level, range(turn, first - 1, -1)) if k else times[0]
        width = right - left if k else 2.0 * (right - left)  # at the start it is one half of a peak
        peaks.append((float(width), float(left), float(right), float(level)))
    return peaks


def _turning_points(values: Array, least: float) -> list[int]:
    """Return where values turn, each time by more than a least change; the first and the last turn are ends."""
    high = low = 0
    turns: list[int] = []
    rises: bool | None = None
    for k, value in enumerate(values.tolist()):
        if value > values[high]:
            high = k
        if value < values[low]:
            low = k
        if rises is not False and values[high] - value > least:
            turns.append(high)
            rises, low = False, k
        elif rises is not True and value - values[low] > least:
            turns.append(low)
            rises, high = True, k
    return [*turns, high if rises else low] if turns else []


def _crossing(times: Array, values: Array, level: float, way: range) -> float:
    """Return the time at which values first pass a level on the way from one turn to the next one [s]."""
    path = np.array(way)
    passed = (values[path] <= level) if values[path[0]] > level else (values[path] >= level)
    first = max(1, int(np.argmax(passed)))
    ends = path[first - 1 : first + 1]
    share = (values[ends[0]] - level) / np.subtract(*values[ends]) if np.ptp(values[ends]) > 0.0 else 0.0
    return float(times[ends[0]] + share * np.diff(times[ends])[0])
