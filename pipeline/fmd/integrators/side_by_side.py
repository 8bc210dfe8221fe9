"""Several marches of one motion, in turn or at the same time."""

import os
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from fmd.core.errors import AccuracyError
from fmd.core.limits.stepping import LEAST_REPEATS, MOST_REPEATS, REPEATED_SECONDS, THRICE_SECONDS
from fmd.integrators.protocol import Progress, Trajectory

March = Callable[[Progress | None], Trajectory]
"""Marches, and tells how far it is."""
Outcome = Trajectory | AccuracyError
"""What a march found, or why it failed."""


class _GivenUpError(Exception):
    """The march beside this one has been ended."""


def march_in_turn(marches: Sequence[March], progress: Progress | None = None) -> tuple[list[Outcome], float]:
    """March one after the other, and return what each found and their run time together [s]."""
    found = [_outcome(march, progress) for march in marches]
    return found, sum(_seconds(each) for each in found)


def threads_at_once() -> int:
    """Return how many threads may run at the same time: what ``OMP_NUM_THREADS`` allows, else one a core."""
    allowed = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0]
    return int(allowed) if allowed.isdigit() else os.cpu_count() or 1


def march_at_once(marches: Sequence[March], progress: Progress | None = None) -> tuple[list[Outcome], float]:
    """March at the same time, the last of which should take longest, and return what `march_in_turn` does.

    Kernels hold no lock of Python's, so that each march runs on a core of its own. Where there are fewer cores, or
    ``OMP_NUM_THREADS`` allows fewer threads, they run in turn, and find the same. The last march tells its progress,
    and what that raises ends all.
    """
    if len(marches) < 2 or len(marches) > threads_at_once():
        return march_in_turn(marches, progress)
    given_up = threading.Event()

    def watch(done: float) -> None:
        if given_up.is_set():
            raise _GivenUpError

    *others, last = marches
    with ThreadPoolExecutor(len(others)) as pool:
        aside = [pool.submit(_outcome, march, watch) for march in others]
        try:
            slowest = _outcome(last, progress)
        except BaseException:
            given_up.set()
            raise
    found = [*(each.result() for each in aside), slowest]
    return found, max(_seconds(each) for each in found)


def time_by_turns(
    found: Mapping[str, Trajectory], marches: Mapping[str, Callable[[], Trajectory]]
) -> dict[str, Trajectory]:
    """Return trajectories with the least of several run times, and their spread.

    Short marches are repeated, one after the other by turns, three times and until each has filled a while: a march of
    a millisecond by itself tells more of what else the machine does.
    """
    seconds = {label: [trajectory.seconds] for label, trajectory in found.items()}
    for _ in range(MOST_REPEATS):
        short = [label for label, times in seconds.items() if _is_short(times)]
        if not short:
            break
        for label in short:
            seconds[label].append(marches[label]().seconds)
    least = {label: min(times) for label, times in seconds.items()}
    return {
        label: replace(
            trajectory, seconds=least[label], spread=float(np.median(seconds[label])) / max(least[label], 1e-9) - 1.0
        )
        for label, trajectory in found.items()
    }


def _is_short(times: Sequence[float]) -> bool:
    return sum(times) < REPEATED_SECONDS or (len(times) < LEAST_REPEATS and min(times) < THRICE_SECONDS)


def _outcome(march: March, progress: Progress | None) -> Outcome:
    try:
        return march(progress)
    except AccuracyError as error:  # it diverged, or an implicit step has no solution
        return error


def _seconds(outcome: Outcome) -> float:
    return outcome.seconds if isinstance(outcome, Trajectory) else 0.0
