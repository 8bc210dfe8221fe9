"""Plans of a scene's runs: an integrator, a mechanism and a start each."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import ConvergenceError, StabilityError
from fmd.core.limits.recovery import (
    FINER_TIMES,
    LEAST_FINER,
    LONG_AGAIN,
    MOST_FINE_TIMES,
    MOST_TIMES_BETWEEN,
    NEAR_LARGEST_DEFLECTION,
)
from fmd.core.limits.round_off import SOLVED
from fmd.dynamics.compiled_system.positive_mass import require_positive_over
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.excited_modes import Excited
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.protocol import Integrator, Progress, Trajectory
from fmd.stages.run_checks import describe_fastest

if TYPE_CHECKING:
    from fmd.recovery.motion import Motion


@dataclass(frozen=True)
class Plan:
    """A run of a scene, ready to be integrated: an integrator, a mechanism and a start."""

    key: str  # the scene's key of its step
    integrator: Integrator
    mechanism: Mechanism  # with the run's own split into slow and fast coordinates
    system: CompiledSystem  # the mechanism as it is marched, whose steps are limited
    start: tuple[Array, Array]  # (n_positions,) and (n,): positions and rates
    excited: Excited | None = None  # the part of the mechanism that is integrated, if some modes can be left at rest
    excited_system: CompiledSystem | None = None  # that part as it is marched
    growth: float = 1.0  # factor by which an explicit method itself makes small vibrations grow over the scene
    # Run time of sub-cycling by tangents over that of plain central differences, where it might be above 1.
    over_plain: float | None = None

    def require_positive_mass(self, trajectory: Trajectory) -> None:
        """Raise ``AccuracyError`` if the mass matrix isn't positive definite along a march of this plan."""
        require_positive_over(self.system, trajectory.times, trajectory.q)

    def compile(self) -> None:
        """Compile all functions that a march calls, or read them where they are kept; not of a method yet to choose."""
        if not self.integrator.chooses_method:
            self.march(np.zeros(1))

    @property
    def marched(self) -> tuple[CompiledSystem, Array, Array]:
        """System, positions and rates that are integrated: those of the modes that don't stay at rest."""
        (q0, v0), part = self.start, self.excited
        if part is None or self.excited_system is None:
            return self.system, q0, v0
        return self.excited_system, q0[part.positions], v0[part.rates]

    def spread_out(self, march: Trajectory) -> Trajectory:
        """Return what was integrated with all coordinates; those of modes that stay at rest are 0."""
        (q0, v0), part = self.start, self.excited
        if part is None or self.excited_system is None:
            return march
        q, v = np.tile(q0, (len(march.times), 1)), np.zeros((len(march.times), len(v0)))
        q[:, part.positions], v[:, part.rates] = march.q, march.v
        return replace(march, q=q, v=v)

    def march(self, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate; coordinates of modes that stay at rest are 0. The end is that of what was integrated."""
        return self.spread_out(self._march(*self.marched, times, progress))

    def _march(
        self, system: CompiledSystem, q0: Array, v0: Array, times: Array, progress: Progress | None
    ) -> Trajectory:
        """Integrate a system; an error says if a motion has lost its inertia, or which part is too fast to follow.

        That of a step which is too long for Newton's iteration names the step's key.
        """
        try:
            return self.integrator.march(system, q0, v0, times, progress)
        except ConvergenceError as failure:
            raise ConvergenceError(f"{self.key}: {failure}") from failure
        except StabilityError as failure:
            system.explain_failure(failure)
            duration = max(float(times[-1]), self.mechanism.horizon)
            raise StabilityError(
                f"{failure}{describe_fastest(system, duration)}", failure.time, failure.positions
            ) from failure


def repeat_choice(plan: Plan, trajectory: Trajectory) -> Plan:
    """Return a run's plan by the method and the step that an automatic choice ended with, which it made by marching."""
    return replace(plan, integrator=trajectory.chosen or plan.integrator)


def is_long_again(motion: Motion) -> bool:
    """Return true for a motion with contacts that takes long to march again."""
    return bool(motion.mechanism.contacts) and motion.trajectory.seconds > LONG_AGAIN


def find_fine_times(plan: Plan, motion: Motion) -> tuple[Array, IntArray]:
    """Return the output times of a plan's motion with many more between them [s], and which of all are output times.

    There are as many in each interval as `MOST_FINE_TIMES` allow, or one, and more about the tip's largest deflections;
    none where `is_long_again` is true and nothing flexible is at the tip. Where a method only interpolates within a
    step, they are steps' ends.
    """
    method, outputs, tip = repeat_choice(plan, motion.trajectory).integrator, motion.times, motion.tip_size
    n_intervals = len(outputs) - 1
    if not n_intervals or (is_long_again(motion) and not tip.any()):
        return outputs, np.arange(len(outputs))
    finer = max(LEAST_FINER, MOST_FINE_TIMES // n_intervals)
    every = -(-n_intervals * finer // MOST_TIMES_BETWEEN)
    near = (tip > 0) & (tip >= NEAR_LARGEST_DEFLECTION * tip.max())
    counts = np.where(np.arange(n_intervals) % every == 0, finer, 1)
    counts = np.maximum(counts, np.where(near[:-1] | near[1:], FINER_TIMES, 1))
    numbers = np.r_[0, np.cumsum(counts)]
    times = np.interp(np.arange(numbers[-1] + 1), numbers, outputs)
    if not method.step or method.dense_output:
        return times, numbers
    steps = outputs / method.step
    of_outputs = np.round(steps[np.abs(steps - np.round(steps)) < SOLVED])
    between = np.round(times / method.step)
    between = between[of_outputs[np.searchsorted(of_outputs[1:], between, "right")] != between]
    # `np.unique` alone would load NumPy's masked arrays, unless it returns indices, too.
    times, _ = np.unique(np.r_[outputs, method.step * between], return_index=True)
    times = times[times <= outputs[-1]]
    return times, np.searchsorted(times, outputs)


@dataclass(frozen=True)
class Growth:
    """Step of a run that is safe to take, and the growth of small vibrations by the method itself."""

    step: float | None = None  # step in place of the plan's, which is too long [s]
    factor: float = 1.0  # factor by which small vibrations grow over the scene
    carried: bool = False  # sub-cycling carries forces on from cycle to cycle, for that is cheapest
    # Run time of a part of the motion over that of plain central differences, if sub-cycling takes tangents instead.
    over_plain: float | None = None
