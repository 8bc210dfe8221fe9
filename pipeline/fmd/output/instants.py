"""Choice of the instants of a motion to show: some output times, and that of the largest stress also between these."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import IntArray
from fmd.recovery.stress import choose_frames

if TYPE_CHECKING:
    from fmd.stages.pipeline import Pipeline


def find_worst(run: Pipeline, bodies: Collection[str]) -> tuple[str, int, float]:
    """Return which of some bodies has the largest stress, the number of its instant, and the stress [Pa].

    Instants are those of `Pipeline.at_instants`.
    """
    worst = {name: run.stress_of(name).worst() for name in bodies}
    body = max(worst, key=lambda name: worst[name][2])
    time, _, value = worst[body]
    return body, int(np.searchsorted(run.at_instants.motion.times, time)), value


def choose_instants(run: Pipeline, count: int, bodies: Collection[str]) -> IntArray:
    """Return the numbers of at most ``count`` output times, evenly, among the instants of `Pipeline.at_instants`.

    Where contacts press between output times, that of the largest stress of some bodies is among them, too.
    """
    outputs = run.motion.times
    chosen = choose_frames(len(outputs), count)
    if run.at_instants is run or not bodies:
        return chosen
    return np.union1d(np.searchsorted(run.at_instants.motion.times, outputs[chosen]), find_worst(run, bodies)[1])
