"""Time limit of an error budget: estimates that would go beyond it are left out and named."""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import field

import numpy as np

from fmd.core.clock import read_clocks, seconds_since
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.patience import JUDGED_AFTER
from fmd.core.progress import interrupted_by

FAULTS = (AccuracyError, InputError, np.linalg.LinAlgError)
"""Errors of a variant of a run that leave an estimate out; the run itself has its results."""
TIME_IS_SHORT = "it would take longer than the time limit of"
"""Words of an estimate that the time limit left out; without figures of its own, so that a reason is said once."""


class LeftOutError(Exception):
    """An estimate would take more time than is left."""


@dataclass
class TimeLimit:
    """Clock of an error budget, which knows how much time is left."""

    seconds: float = math.inf  # time for all estimates together [s]; infinite by default
    started: tuple[float, float] = field(default_factory=read_clocks)  # when the clocks were started [s]

    @property
    def spent(self) -> float:
        """Time since the start [s], as `seconds_since` counts it."""
        return seconds_since(self.started)

    def require(self, seconds: float) -> None:
        """Raise ``LeftOutError`` if a computation would take more seconds than are left."""
        left = self.seconds - self.spent
        if seconds > left or left <= 0:
            raise LeftOutError(f"not estimated: {TIME_IS_SHORT} {self.seconds:.2g} s")

    def ends_searches(self) -> AbstractContextManager[None]:
        """Return a context in which searches end with ``LeftOutError`` once no time is left."""
        return interrupted_by(lambda: self.require(0.0))

    def watch(self) -> Callable[[float], None]:
        """Return a march's progress, which raises ``LeftOutError`` as soon as it won't end in time.

        What comes before its first call, such as compiling, says nothing of the rest.
        """
        first: list[tuple[float, float]] = []

        def advance(done: float) -> None:
            now = self.spent
            if not first or done < first[0][1]:  # another march of the same method
                first[:] = [(now, done)]
            taken, part = now - first[0][0], done - first[0][1]
            if done < 1:
                self.require(taken * (1 - done) / part if taken > JUDGED_AFTER and part > 0 else 0.0)

        return advance
