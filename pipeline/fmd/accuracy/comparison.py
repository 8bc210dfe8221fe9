"""Comparison of a run with variants of it: their marches, within a time limit, and the changes of its quantities."""

import math
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from fmd.accuracy.coarse_mesh import Pair
from fmd.accuracy.details import detail_quantities, leave_out_nothing
from fmd.accuracy.quantities import Quantities, mesh_quantities, motion_quantities, stress_quantities
from fmd.accuracy.requested_stress import RequestedStress
from fmd.accuracy.time_limit import TIME_IS_SHORT, LeftOutError, TimeLimit
from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError, StabilityError
from fmd.core.limits import errors as limits
from fmd.core.limits.stepping import FINEST_TOLERANCE, IMPLICIT_STEPS_IN_ACTION
from fmd.integrators.automatic import Automatic
from fmd.integrators.exponential import PiecewiseExponential
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.protocol import Integrator, Trajectory
from fmd.integrators.runge_kutta import RungeKutta
from fmd.recovery.motion import Motion
from fmd.recovery.stress import choose_frames
from fmd.stages.pipeline import Pipeline
from fmd.stages.plan import Plan, repeat_choice
from fmd.stages.runs import plan_like


class Comparison:
    """Comparison of a run's quantities with those of its variants: ``quantities``, ``of_mesh`` or ``of_motion``."""

    def __init__(self, run: Pipeline, limit: TimeLimit) -> None:
        self.run, self.limit = run, limit
        self.motion = run.motion
        self._first = next(iter(run.plans.values()))
        self.plan = repeat_choice(self._first, self.motion.trajectory)  # by the method that a choice ended with
        # Of the first march by each kind of method: the method, and the seconds that it took.
        self._marched: dict[type, tuple[Integrator, float]] = {
            type(self.plan.integrator): (self.plan.integrator, run.fine_motion.trajectory.seconds)
        }
        self.frames: IntArray = np.arange(0)
        self.corrections: dict[str, float] = {}  # what finer computations add to values so far
        self.of_mesh = mesh_quantities(run)
        self.of_motion = motion_quantities(self.motion, run.fine_motion)
        self.pair: Pair | str = "not made"  # the run and its scene on a coarser mesh, or why there is none
        self.damped: dict[str, float] = {}  # part of each that the variants' steps damp; empty by the run's own
        self.hot: dict[str, IntArray] = {}
        if run.parts:
            self._choose_stress_samples()
            self.of_motion |= stress_quantities(run, self.motion, self.frames)
        self.requested = RequestedStress(run)  # stress that files of the run hold
        requested = self.requested.quantities(run, self.motion, self.frames)
        self.details = leave_out_nothing(detail_quantities(run.scene, self.motion) | requested, run.mechanism)
        self.of_motion |= self.details
        self.quantities = self.of_mesh | self.of_motion

    @cached_property
    def beside(self) -> tuple[Plan, Quantities]:
        """The plan that variants are marched by, and those of the run's own quantities by it that they are compared in.

        Where a dozen marches like the run's take half of the time limit, generalised-α steps over vibrations that
        an explicit method follows. A quantity of which these are a large part isn't compared then: errors of their
        frequencies add up over all of the run, but hardly in steps that damp them. More steps follow more of them.
        """
        own, best = self.run.fine_motion.trajectory.seconds, (self.plan, self.quantities)
        method = self.implicit_method
        if own <= limits.MARCH_OF_LIMIT * self.limit.seconds or type(method) is type(self.plan.integrator):
            return best
        for step in (method.step, method.step / limits.MORE_IMPLICIT_STEPS):
            plan = replace(self.plan, integrator=replace(method, step=step))
            try:
                motion = self.march(self.run, plan)
            except (LeftOutError, AccuracyError):
                continue
            if not motion.trajectory.seconds < limits.WORTH_OTHER_METHOD * own:
                break
            ours = self.quantities_of(self.run, motion, self.hot)
            damped = self.changes(ours)
            followed = {name: ours[name] for name, part in damped.items() if part < limits.MOST_OF_METHOD}
            if best[0] is self.plan or len(followed) > len(best[1]):
                self.damped, best = damped, (plan, followed)
            if len(followed) == len(ours):
                break
        return best

    @property
    def too_fast(self) -> str:
        """Why no estimates are made of the quantities that variants' marches don't follow."""
        return f"not estimated: by steps that follow its vibrations {TIME_IS_SHORT} {self.limit.seconds:.2g} s"

    @property
    def implicit_method(self) -> GeneralizedAlpha:
        """Generalised-α with a step that follows the motion and the loads, not the fastest vibration."""
        duration, system = float(self.run.output_times[-1]), self.plan.system
        steps = max(
            limits.COMPARED_IMPLICIT_STEPS, math.ceil(IMPLICIT_STEPS_IN_ACTION * duration / system.shortest_action)
        )
        return GeneralizedAlpha(system.resolving_step(duration / steps)[0], limits.COMPARED_RHO)

    def march_beside(self, other: Pipeline) -> Motion:
        """Integrate a variant by the plan that variants are marched by; raises as `march`."""
        return self.march(other, plan_like(self.beside[0], other))

    def require_modes(self, share: float) -> None:
        """Raise ``LeftOutError`` if a part of the time that the run's mesh and modes took isn't left."""
        stages = ("mesh", "assembly", "modes", "body")
        taken = sum(self.run.log.seconds.get(stage, 0.0) for stage in stages)
        self.limit.require(share * taken)

    def changes(self, theirs: Quantities, ours: Quantities | None = None) -> dict[str, float]:
        """Return the difference of each quantity of the motion from a variant's."""
        ours = ours or self.quantities
        return {name: ours[name].change(quantity) for name, quantity in theirs.items() if name in ours}

    def correct(self, name: str, by: float) -> None:
        """Add to what makes the value of a quantity better."""
        self.corrections[name] = self.corrections.get(name, 0.0) + by

    def correct_by(self, theirs: Quantities, share: float, ours: Quantities | None = None) -> None:
        """Add a share of the differences of a variant's values from the run's to what makes these better."""
        for name, own in (ours or self.quantities).items():
            if name in theirs:
                self.correct(name, share * (theirs[name].scale - own.scale))

    def quantities_of(
        self,
        run: Pipeline,
        fine: Motion,
        nodes: dict[str, IntArray] | None = None,
        places: dict[str, Array] | None = None,
        as_if: dict[str, Array] | None = None,
    ) -> Quantities:
        """Return the quantities of a motion at the run's fine times; stress only at the chosen output times."""
        motion = replace(fine, trajectory=self.at_outputs(fine.trajectory))
        quantities = motion_quantities(motion, fine)
        if run.parts:
            quantities |= stress_quantities(run, motion, self.frames, nodes, places, as_if)
        details = detail_quantities(run.scene, motion)
        details |= self.requested.quantities(run, motion, self.frames, as_if)
        return quantities | {name: details[name] for name in self.details}

    def at_outputs(self, fine: Trajectory) -> Trajectory:
        """Return a trajectory at the run's fine times at its output times alone; itself if these are the same."""
        chosen = self.run.fine_times[1]
        if len(chosen) == len(fine.times):
            return fine
        return replace(fine, times=fine.times[chosen], q=fine.q[chosen], v=fine.v[chosen])

    def _choose_stress_samples(self) -> None:
        frames = [choose_frames(len(self.motion.times), limits.COMPARED_FRAMES)]
        for name, part in self.run.parts.items():
            if not part.has_stress:
                continue
            values = self.run.stress_of(name).limited_von_mises(np.arange(len(self.motion.times)))
            frames.append(np.argsort(values.max(axis=1))[-limits.HOTTEST_FRAMES :])
            self.hot[name] = np.flatnonzero(values.max(axis=0) >= limits.HOT * values.max())
        self.frames = np.unique(np.concatenate(frames))

    def _forecast(self, method: Any) -> float:
        before: Any
        before, seconds = self._marched.get(type(method), (method, 0.0))
        if method.step:
            return float(seconds * before.step / method.step)
        return float(limits.FINER_WORK * seconds if method.tolerance < before.tolerance else seconds)

    def march(self, other: Pipeline, plan: Plan) -> Motion:
        """Integrate a plan of a variant at the run's fine times.

        Raises
        ------
        LeftOutError
            It would take longer than the time limit leaves.
        """
        self.limit.require(self._forecast(plan.integrator))
        times = self.run.fine_times[0]
        try:
            trajectory = plan.march(times, self.limit.watch())
        except StabilityError:  # the variant is unlike the run: one that chooses anew may find a way
            same = type(plan.integrator) is type(self.plan.integrator)
            if not (same and isinstance(self._first.integrator, Automatic)):
                raise
            plan = replace(plan, integrator=self._first.integrator)
            trajectory = plan.march(times, self.limit.watch())
        self._marched.setdefault(type(plan.integrator), (plan.integrator, trajectory.seconds))
        return other.motion_by(plan, trajectory)


def change_fineness(plan: Plan, seconds: float) -> tuple[Integrator, float]:
    """Return the method with another step or tolerance, and the difference of the results over the plan's error."""
    method: Any = plan.integrator
    if isinstance(method, PiecewiseExponential):  # its errors fall by the third power where they are worst
        return replace(method, step=method.step / 2, least=2 * method.least), 1 - 0.5**3
    if not method.step:
        method = replace(method, tolerance=max(limits.FINER_TOLERANCE * method.tolerance, FINEST_TOLERANCE))
        if isinstance(method, RungeKutta):  # where its reach bounds the steps, the fastest vibrations die away in them
            method = replace(method, reach=method.reach / 2)
        return method, 1 - limits.FINER_TOLERANCE
    order = method.order(plan.system)
    if seconds < limits.SHORT_SECONDS or not 8 * method.step < method.largest_step(plan.system):
        return replace(method, step=method.step / 2), 1 - 0.5**order
    # Where a load jumps, marches of order two differ by half of a step's impulse, and one alone may be off by as much.
    jumps = order == 2 and bool(plan.system.breakpoints)
    return replace(method, step=2 * method.step), (2.0**order - 1) / (1 + jumps)
