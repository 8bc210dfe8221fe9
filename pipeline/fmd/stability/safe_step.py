"""Longest step at which a scheme by itself makes small vibrations grow no more than is allowed over a duration."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fmd.core.limits.stability import ALLOWED_GROWTH, SMALLEST_SHARE, SUMMIT

_SCAN = 0.5 ** np.arange(6.0, -0.5, -0.5)  # shares of the upper step


def longest_safe_step(e_folds: Callable[[float], float], upper: float, bisections: int = 8) -> float:
    """Return the longest step [s], up to ``upper``, by which small vibrations grow by `ALLOWED_GROWTH` at most.

    That is ``upper`` if nothing below it grows; 0 if everything down to a millionth of it does. Where growth falls
    again before it is too much, but after half of the e-folds allowed, it is the step at which it is largest.
    ``e_folds`` gives those of growth over the duration with a step [s]; the interval of the limit, which begins as a
    factor of √2, is halved ``bisections`` times.
    """
    allowed = np.log(ALLOWED_GROWTH)
    low = high = before = 0.0
    for share in _SCAN:
        folds = e_folds(share * upper)
        if folds > allowed:
            high = share * upper
            break
        if before > max(folds, SUMMIT * allowed):
            steps = np.geomspace(low * _SCAN[0] / _SCAN[1], share * upper, 9)[:-1]
            near = np.array([0.0, *(e_folds(step) for step in steps[1:])])
            beyond = np.flatnonzero(near > allowed)
            if not beyond.size:
                return float(steps[np.argmax(near)])
            low, high = float(steps[beyond[0] - 1]), float(steps[beyond[0]])
            break
        low, before = share * upper, folds
    if not high:
        return upper
    while not low:
        lower = 0.25 * high
        if lower < SMALLEST_SHARE * upper:
            return 0.0
        if e_folds(lower) > allowed:
            high = lower
        else:
            low = lower
    for _ in range(bisections):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if e_folds(middle) <= allowed else (low, middle)
    return low
