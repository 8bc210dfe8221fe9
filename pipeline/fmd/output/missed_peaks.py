"""Peaks of forces and accelerations between output times, which last shorter than those of positions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.errors import NOTHING
from fmd.core.limits.recovery import NEAR_LARGEST_STRESS, OF_OUTPUT_STEP
from fmd.core.rotations import turned
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.kinematics import Kinematics
from fmd.integrators.protocol import move_positions
from fmd.recovery.motion import Motion
from fmd.recovery.motion_file import OF_FORMULA, Variable


@dataclass(frozen=True)
class MissedPeaks:
    """How much larger quantities of a motion may be between output times than at them."""

    motion: Motion

    def part_of(self, variable: Variable) -> float:
        """Estimate by how much a variable's largest value is larger between output times, as a part of it.

        Through an output time with a peak and its neighbours goes a parabola, whose top is at most an eighth of their
        second difference higher; of a step, beyond which nothing bends, the next parabola tells so. What doesn't last
        from one output time to the next bends nothing; but it changes velocities and momenta by more than their
        derivatives at both times do, which accelerations of markers and forces of joints follow.
        """
        values = variable.values.reshape(len(variable.values), -1)
        sizes = np.linalg.norm(values, axis=1)
        largest = float(sizes.max(initial=0.0))
        if len(sizes) < 3 or not largest > 0.0:
            return 0.0
        missed, (owner, _, kind) = _missed_by_parabolas(values, sizes), variable.name.rpartition(".")
        if variable.units == OF_FORMULA:
            return missed / largest
        if kind == "acceleration":
            passed, nothing = self._passed_by_marker(owner)
        elif kind in ("force", "moment") and owner in self.motion.joint_loads.reactions:
            passed, nothing = self._passed_by_joint(owner, kind)
        else:
            passed, nothing = 0.0, 0.0
        return max(missed, passed) / largest if largest > nothing else 0.0

    def _passed_by_marker(self, name: str) -> tuple[float, float]:
        """Return what output times miss of a marker's acceleration, and what is round-off in it [m/s²]."""
        (body, _, marker), whole = name.partition("."), self.motion.kinematics
        number = self.motion.mechanism.number_of(body)
        v = whole.marker_velocity(number, marker)
        a = whole.marker_acceleration(number, marker, self.motion.joint_loads.accelerations)
        passed, abrupt = (float(own) for own in self._beyond(v, a))
        return passed, NOTHING * max(abrupt, self._largest_reaction("force") / self.motion.mechanism.mass)

    def _passed_by_joint(self, joint: str, kind: str) -> tuple[float, float]:
        """Return what output times miss of a joint's force [N] or moment [N m], and what is round-off in it."""
        mechanism = self.motion.mechanism
        closing = {own.name: own.second.body or own.first.body for own in mechanism.closing_joints}
        body = mechanism.number_of(closing.get(joint) or mechanism.joint_children[joint])
        passed, abrupt = (own[:, body] for own in self._passed_by_bodies)
        if kind == "force":
            return float(passed[0]), NOTHING * max(float(abrupt[0]), self._largest_reaction(kind))
        markers = mechanism.links[body].markers.values()
        reach = max((float(np.linalg.norm(own.position)) for own in markers), default=0.0)
        return float(passed[1]), NOTHING * max(float(abrupt[1] + reach * abrupt[0]), self._largest_reaction(kind))

    def _largest_reaction(self, kind: str) -> float:
        """Return the largest force [N] or moment [N m] of a joint."""
        part = slice(None, 3) if kind == "force" else slice(3, None)
        reactions = self.motion.joint_loads.reactions.values()
        return max((float(np.abs(own[..., part]).max()) for own in reactions), default=0.0)

    @cached_property
    def _passed_by_bodies(self) -> tuple[Array, Array]:
        """Passed and abrupt forces and moments on each body and what it carries, shapes (2, n_bodies): `_beyond`."""
        shifts = np.full(len(self.motion.times), OF_OUTPUT_STEP * float(np.diff(self.motion.times).min()))
        shifts[-1] *= -1.0  # prescribed motions are known up to the end
        at, later = self._momenta(0.0 * shifts), self._momenta(shifts)
        return self._beyond(at, (later - at) / shifts[:, None])

    def _momenta(self, shifts: Array) -> Array:
        """Return momentum, and angular momentum about their centre, of each body with all that it carries.

        Shape (2, n_bodies, n_times, 3), of states by times ``shifts`` (n_times,) [s] later along the motion's tangents.
        """
        motion, mechanism = self.motion, self.motion.mechanism
        q, v, parameters = motion.trajectory.q, motion.trajectory.v, share_system(mechanism).parameters
        changes, a = shifts[:, None] * v, motion.joint_loads.accelerations
        moved = np.array([move_positions(parameters, x, change) for x, change in zip(q, changes, strict=True)])
        later = Kinematics(mechanism, motion.times + shifts, moved, v + shifts[:, None] * a)
        masses = np.array([link.integrals.mass for link in mechanism.links])
        sums = np.empty((3, len(masses), *v.shape[:1], 3))
        for k, (frame, own) in enumerate(zip(later.frames, later.momenta, strict=True)):
            first, linear, angular = (turned(frame.rotation, np.nan_to_num(x)) for x in own)
            sums[:, k] = linear, angular + np.cross(frame.origin, linear), masses[k] * frame.origin + first
        for k in reversed(range(len(masses))):
            if (parent := mechanism.links[k].parent) >= 0:
                masses[parent] += masses[k]
                sums[:, parent] += sums[:, k]
        linear, angular, first = sums
        centres = first / np.where(masses, masses, 1.0)[:, None, None]
        return np.array([linear, angular - np.cross(centres, linear)])

    def _beyond(self, values: Array, rates: Array) -> tuple[Array, Array]:
        """Return by how much mean rates of values (…, n_times, 3) are larger than at both output times, at most.

        The second are rates of the largest values if they came and went from one output time to the next.
        """
        steps, sizes = np.diff(self.motion.times), np.linalg.norm(rates, axis=-1)
        mean = np.linalg.norm(np.diff(values, axis=-2), axis=-1) / steps
        beyond = (mean - np.maximum(sizes[..., :-1], sizes[..., 1:])).max(axis=-1).clip(0.0)
        return beyond, np.linalg.norm(values, axis=-1).max(axis=-1) / steps.min()


def _missed_by_parabolas(values: Array, sizes: Array) -> float:
    """Return by how much parabolas through three output times are higher than the largest values (n_times, n)."""
    bent = np.linalg.norm(np.diff(values, 2, axis=0), axis=1) / 8.0
    rising = sizes[2:] > sizes[:-2]  # the parabola's top lies after its middle
    beside = np.where(rising, np.append(bent[1:], np.inf), np.insert(bent[:-1], 0, np.inf))
    top = (sizes[1:-1] >= np.maximum(sizes[:-2], sizes[2:])) & (sizes[1:-1] >= NEAR_LARGEST_STRESS * sizes.max())
    return float(np.minimum(bent, beside)[top].max(initial=0.0))
