"""Run times that a table compares, measured by turns once on a machine."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from fmd.core.cache import stage_key
from fmd.integrators.protocol import Trajectory
from fmd.integrators.side_by_side import time_by_turns

if TYPE_CHECKING:
    from fmd.stages.pipeline import Pipeline
    from fmd.stages.plan import Plan


def with_compared_times(
    run: Pipeline, plans: Mapping[str, Plan], found: Mapping[str, Trajectory]
) -> dict[str, Trajectory]:
    """Return trajectories with run times by turns, which are kept on this machine: warm runs only march once more."""

    def measure() -> dict[str, tuple[float, float]]:
        timed = time_by_turns(found, {label: partial(plan.march, run.output_times) for label, plan in plans.items()})
        return {label: (each.seconds, each.spread) for label, each in timed.items()}

    key = type(run).growths.key(run)  # has all that marches depend on
    own = stage_key("run-times", [key, platform.node(), os.environ.get("FMD_KERNELS")], ())
    times = run.store.read_or_keep(own, measure, "dict[str, tuple]") if key else measure()
    return {
        label: replace(each, seconds=min(each.seconds, times[label][0]), spread=times[label][1])
        for label, each in found.items()
    }
