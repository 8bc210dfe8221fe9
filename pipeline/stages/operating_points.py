"""The course of a scene before anything is integrated: all bodies rigid, what is fast at rest where loads leave it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.fast_path import rigid_hinge_motion
from pipeline.integrators.central_difference import CentralDifference
from pipeline.stability.growth import Course, Instant, steadied, steady_near
from pipeline.stages.mechanism import place_joints

if TYPE_CHECKING:
    from pipeline.dynamics.mechanism import Mechanism
    from pipeline.dynamics.system import System
    from pipeline.stages.pipeline import Pipeline

_STATES = 8
_STEPS = 20_000  # of the rigid motion, at least
_RESOLVED = 0.1  # of its largest step, at most


def course_of(pipeline: Pipeline, mechanism: Mechanism, system: System) -> Course:
    """Course of a scene's mechanism with the split of one of its runs, which marches it as ``system``.

    Raises
    ------
    StabilityError
        The scene with all bodies rigid can't be integrated.
    """
    duration = pipeline.scene.simulation.duration
    times = (np.arange(_STATES) + 0.5) * duration / _STATES
    rigid, tree = pipeline.mechanism.rigid, mechanism
    q0, v0 = place_joints(pipeline.scene, rigid)
    q, v = np.zeros((len(times), rigid.n_positions)), np.zeros((len(times), rigid.n))
    if closed := rigid_hinge_motion(pipeline.mechanism, q0, v0, times):
        q, v = closed
    elif rigid.n:
        step = min(duration / _STEPS, _RESOLVED * 2.0 / rigid.highest_frequency)
        start = Instant(0.0, q0, v0)
        # What is fast follows from rest: its own vibration would make the states hang on when they are taken.
        start = steady_near(rigid, start, np.arange(rigid.n_slow, rigid.n)) or start
        motion = CentralDifference(step).march(rigid, start.q, start.v, times)
        q, v = motion.q, motion.v
    still = {*range(tree.n_slow, tree.n)}.union(*(tree.modes_of(k).tolist() for k in range(len(tree.links))))
    rates = np.array(sorted(still), dtype=np.int64)
    states = [Instant(float(t), *_with_joints(tree, rigid, q[k], v[k])) for k, t in enumerate(times)]
    return Course(system, tuple(steadied(system, at, rates) for at in states), duration)


def _with_joints(tree: Mechanism, rigid: Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    """Positions and rates of a tree, undeformed, whose joints are as those of the rigid one."""
    positions, rates = tree.rest_positions, np.zeros(tree.n)
    for k, link in enumerate(tree.links):
        to, of = tree.layout.position[k], rigid.layout.position[k]
        positions[to : to + link.n_positions] = q[of : of + link.n_positions]
        to, of = tree.layout.rate[k], rigid.layout.rate[k]
        rates[to : to + link.n_rates] = v[of : of + link.n_rates]
    return positions, rates
