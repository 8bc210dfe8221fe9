"""Poses of a mechanism: undeformed, each joint moved through its range, prescribed motions over time; or as it ran."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.shown import MOST_BENT, POSES_OF_A_JOINT
from fmd.integrators.protocol import State, Trajectory
from fmd.recovery.motion import Motion
from fmd.recovery.stress import choose_frames
from fmd.stages.loop_closing import close_pose
from fmd.stages.other_motions import with_motions

if TYPE_CHECKING:
    from fmd.stages.pipeline import Pipeline


@dataclass(frozen=True)
class Clip:
    """Poses of a mechanism along one coordinate, its other joints at the start or as loops make them follow."""

    name: str  # the joint's, ``time`` for all prescribed motions, or ``run``
    unit: str  # ``rad``, ``m`` or ``s``
    values: Array  # (n_poses,): of the coordinate, ascending
    times: Array  # (n_poses,): at which prescribed motions are taken [s]
    q: Array  # (n_poses, n_positions): positions
    start: int  # number of the pose at the start


def undeformed_start(run: Pipeline) -> Array:
    """Return the positions at the start with every body as it was meshed, shape (n_positions,)."""
    mechanism, q0 = run.mechanism, run.start[0].copy()
    for k in range(len(mechanism.links)):
        q0[mechanism.modal_positions_of(k)] = 0.0
    closed = close_pose(run.system, 0.0, q0)
    return run.start[0] if closed is None else closed


def find_clips(run: Pipeline, q0: Array, reach: float) -> tuple[Clip, ...]:
    """Find the poses along each coordinate that a hand could move, as far as loops stay closed.

    They begin with positions q0 (n_positions,) as `undeformed_start` gives them; slides without stops move by a reach
    to both sides [m], hinges without stops make a whole turn. There is a clip of the prescribed motions, if there are
    any, and one for each joint with a single free coordinate.
    """
    poses, found = _Poses(run, q0, reach), []
    if any(link.motion is not None for link in run.mechanism.links):
        found.append(poses.over_time())
    for number, link in enumerate(run.mechanism.links):
        if link.unit and link.n_rates and link.motion is None:
            found.append(poses.along_joint(number))
    return tuple(clip for clip in found if len(clip.values) > 1)


class _Poses:
    """Poses of a run's mechanism, each found from the one before."""

    def __init__(self, run: Pipeline, q0: Array, reach: float) -> None:
        self.run, self.q0, self.reach = run, q0, reach

    def over_time(self) -> Clip:
        """Find the poses over the prescribed motions."""
        times = np.linspace(0.0, self.run.scene.simulation.duration, POSES_OF_A_JOINT)
        poses = self._follow([(float(t), None) for t in times], None)
        times = times[: len(poses)]
        return Clip("time", "s", times, times, np.reshape(poses, (len(poses), -1)), 0)

    def along_joint(self, number: int) -> Clip:
        """Find the poses along the joint that carries a body, to both sides of its start."""
        link, layout = self.run.mechanism.links[number], self.run.mechanism.layout
        at, rate = int(layout.position[number]), int(layout.rate[number])
        own = self.q0[at]
        stop = self.run.divided_scene.joint[link.joint_name].along[0].stop
        far = np.pi if link.unit == "rad" else self.reach
        low, high = (getattr(stop, side, None) for side in ("low", "high"))
        low, high = (own - far if low is None else min(low, own)), (own + far if high is None else max(high, own))
        below, above = (
            self._follow([(0.0, (at, value)) for value in np.linspace(own, end, POSES_OF_A_JOINT // 2 + 1)[1:]], rate)
            for end in (low, high)
        )
        q = np.array([*below[::-1], self.q0, *above])
        return Clip(link.joint_name, link.unit, q[:, at], np.zeros(len(q)), q, len(below))

    def _follow(self, places: Sequence[tuple[float, tuple[int, float] | None]], kept: int | None) -> list[Array]:
        """Return the poses at times and values of a position, up to where loops open.

        Where a joint is moved by hand, its rate's number ``kept``, poses also end where bodies would have to bend.
        """
        poses, q = [], self.q0
        for t, moved in places:
            trial = q.copy()
            if moved is not None:
                trial[moved[0]] = moved[1]
            closed = close_pose(self.run.system, t, trial, kept)
            if closed is None or (kept is not None and self._deflection(closed) > MOST_BENT * self.reach):
                break
            poses.append(closed)
            q = closed
        return poses

    def _deflection(self, q: Array) -> float:
        """Return the largest displacement by deformation [m]."""
        mechanism, largest = self.run.mechanism, 0.0
        for k, link in enumerate(mechanism.links):
            modal = q[mechanism.modal_positions_of(k)]
            if modal.any():
                largest = max(largest, float(np.abs(self.run.bodies[link.name].shapes @ modal).max()))
        return largest


def pose_as_marched(motion: Motion) -> Clip:
    """Return the poses at output times of a march, some if there are many."""
    chosen = choose_frames(len(motion.times), POSES_OF_A_JOINT)
    times = motion.times[chosen]
    return Clip("run", "s", times, times, motion.trajectory.q[chosen], 0)


def run_at_poses(run: Pipeline, times: Array, q: Array) -> Pipeline:
    """Return the stages of a run whose motion is a row of poses at rest, of positions q (n_poses, n_positions).

    Prescribed motions are taken at times (n_poses,) [s], which need not ascend. Contacts dent nothing beside the modes.
    """
    v = np.zeros((len(q), run.mechanism.n))
    end = State(0, q[-1], v[-1], v[-1])
    motion = Motion(
        run.mechanism, Trajectory("pose", 0.0, 1, times, q, v, 0, 0, 0.0, end), run.divided_scene.simulation.tip
    )
    posed = with_motions(run, {"pose": motion})
    posed.results[type(run).contact_stress.name] = {"pose": {}}
    return posed
