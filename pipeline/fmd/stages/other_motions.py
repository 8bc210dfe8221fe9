"""A run with other motions in the place of its own: at more instants, or a row of poses."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fmd.recovery.motion import Motion
    from fmd.stages.pipeline import Pipeline


def with_motions(run: Pipeline, motions: Mapping[str, Motion]) -> Pipeline:
    """Return a run with other motions in the place of its own, all of whose times count."""
    other, stages, times = copy(run), type(run), next(iter(motions.values())).times
    vars(other).pop("stress", None)
    other.at_instants, other.at_vibrations, other._envelopes = other, other, {}
    other.fine_times = times, np.arange(len(times))
    other.results = run.results | {stages.motions.name: motions}
    for stage in (stages.contact_stress, stages.fine_motion):  # of the run's own
        other.results.pop(stage.name, None)
    return other
