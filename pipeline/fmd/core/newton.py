"""Newton's method, once: for loops that close, rest, steady states, operating points and steady rotations.

A caller brings what has to vanish, the correction that its slopes ask for, and what is small for it. Kernels iterate
themselves, without allocating anything, and share `settles`.
"""

from collections.abc import Callable
from typing import Any, Generic, Literal, TypeVar

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.newton import MOST_HALVINGS, STALLED
from fmd.core.progress import check_for_interruption

State = TypeVar("State")
Failure = Literal["", "too many corrections", "ran away", "singular", "no better"]


def settles(size: float, before: float, tight: float, loose: float) -> bool:
    """Decide by its size, and the size before, whether an iteration has come as near as round-off lets it.

    It has where the size is at most ``tight``; or at most ``loose``, where it no longer shrinks as corrections should.
    """
    return size <= tight or (size <= loose and size > STALLED * before)


@dataclass(frozen=True)
class Tolerance:
    """Size below which a state counts as found: of the residual by itself, or of the last correction."""

    corrections: int  # largest number of corrections
    relative: float = 0.0  # correction over what is reached
    absolute: float = 0.0  # correction; one so small isn't shortened either
    residual: float = 0.0  # largest entry of the residual
    stalled: float = 0.0  # largest entry of a residual that no longer shrinks; round-off holds it there


@dataclass(frozen=True)
class Trial:
    """A correction on trial: residuals before and after it, the change, and how often it has been halved."""

    before: Array
    after: Array
    change: Array
    halvings: int


@dataclass(frozen=True)
class Solution(Generic[State]):
    """State at which Newton's method ended."""

    state: State
    residual: float  # largest entry of its residual
    size: float  # size of the last whole correction; infinite before the first
    corrections: int
    failure: Failure  # why it hasn't converged; empty if it has

    @property
    def converged(self) -> bool:
        """True if the residual or the last correction is small."""
        return not self.failure


def largest(values: Any) -> float:
    """Return the largest size of some values, 0 of none."""
    return float(np.abs(values).max(initial=0.0))


def _whole(change: Array) -> Array:
    return change


def _always(trial: Trial) -> bool:
    return True


def solve(
    start: State,
    residual: Callable[[State], Array],
    correction: Callable[[State, Array], Array],
    move: Callable[[State, Array], State],
    tolerance: Tolerance,
    *,
    size: Callable[[Array], float] = largest,
    scale: Callable[[State], float] = largest,
    shorten: Callable[[Array], Array] = _whole,
    accepts: Callable[[Trial], bool] = _always,
) -> Solution[State]:
    """Correct a state until its residual vanishes.

    Parameters
    ----------
    start : object
        The first state; of any type that the callables take.
    residual : callable
        What has to vanish at a state, an array.
    correction : callable
        The change that the slopes at a state ask for, from the state and its residual; `LinAlgError` if they have none.
    move : callable
        Return a state changed by a correction.
    tolerance : Tolerance
        What is small.
    size, scale : callable
        The size of a correction, and what it is measured by at a state; their largest entries by default.
    shorten : callable
        Return a correction no longer than the slopes are to be trusted.
    accepts : callable
        False for a correction that has to be halved.
    """
    x, left, before, last, count = start, residual(start), np.inf, np.inf, 0
    while True:
        check_for_interruption()
        rest = largest(left)
        if settles(rest, before, tolerance.residual, tolerance.stalled):
            return Solution(x, rest, last, count, "")
        if not np.isfinite(rest):
            return Solution(x, rest, last, count, "ran away")
        if count and last <= max(tolerance.relative * scale(x), tolerance.absolute):
            return Solution(x, rest, last, count, "")
        if count == tolerance.corrections:
            return Solution(x, rest, last, count, "too many corrections")
        try:
            whole = correction(x, left)
        except np.linalg.LinAlgError:
            return Solution(x, rest, last, count, "singular")
        before, last = rest, size(whole)
        if not np.isfinite(last):
            return Solution(x, rest, last, count, "ran away")
        change = shorten(whole)
        for halvings in range(MOST_HALVINGS):
            moved = move(x, change)
            after = residual(moved)
            if last <= tolerance.absolute or accepts(Trial(left, after, change, halvings)):
                break
            change = 0.5 * change
        else:
            return Solution(x, rest, last, count, "no better")
        x, left, count = moved, after, count + 1
