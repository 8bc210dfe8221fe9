"""What histories miss between output times: peaks of forces and accelerations, which last shorter than positions do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.limits.recovery import NEAR_LARGEST_STRESS
from fmd.recovery.motion_file import Variable

if TYPE_CHECKING:
    from fmd.stages.pipeline import Pipeline

_BY_ACCELERATION = ("force", "moment", "acceleration")


def missed_part(run: Pipeline, variable: Variable) -> float:
    """Estimate by how much a variable's largest value is larger between output times, as a part of it.

    Through an output time with a peak and its neighbours goes a parabola, whose top is at most an eighth of their
    second difference higher. What doesn't last from one output time to the next bends nothing; but it changes rates by
    more than the accelerations at both do, which forces of joints and accelerations of markers follow.
    """
    values = variable.values.reshape(len(variable.values), -1)
    sizes = np.linalg.norm(values, axis=1)
    largest = float(sizes.max(initial=0.0))
    if len(sizes) < 3 or not largest > 0.0:
        return 0.0
    bent = np.linalg.norm(np.diff(values, 2, axis=0), axis=1) / 8.0
    top = (sizes[1:-1] >= np.maximum(sizes[:-2], sizes[2:])) & (sizes[1:-1] >= NEAR_LARGEST_STRESS * largest)
    follows = variable.name.rpartition(".")[2] in _BY_ACCELERATION
    return max(float(bent[top].max(initial=0.0)) / largest, _missed_acceleration(run) if follows else 0.0)


def _missed_acceleration(run: Pipeline) -> float:
    """Return by how much mean accelerations between output times differ from those there, over what is largest there.

    Sizes are those of Gauss's constraint, the root of the sum of masses times squared accelerations, with the masses
    of the start. Times the root of the whole mass they bound the forces of joints, beside whose largest one they count.
    """
    motion = run.motion
    a, v = motion.joint_loads.accelerations, motion.trajectory.v[:, : motion.mechanism.n]
    mass = run.system.mass_matrix(run.start[0]).diagonal()[: motion.mechanism.n]
    mean = np.diff(v, axis=0) / np.diff(motion.times)[:, None]
    largest, apart = (
        float(np.sqrt((mass * x**2).sum(axis=1)).max(initial=0.0)) for x in (a, mean - (a[1:] + a[:-1]) / 2)
    )
    forces = max((float(np.abs(own[..., :3]).max()) for own in motion.joint_loads.reactions.values()), default=0.0)
    size = max(largest, forces / np.sqrt(motion.mechanism.mass))
    return float(apart / size) if size else 0.0
