"""Automatic choice of a method for a wanted error, with steps refined until two marches agree."""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import cast

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, StabilityError
from fmd.core.limits import stepping as limits
from fmd.dynamics.system import System
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.exponential import PiecewiseExponential
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.march_pairs import Gain, Pairs, compared_times, pairs_of
from fmd.integrators.method_costs import (
    explicit_cost,
    explicit_frequency,
    explicit_pair_cost,
    exponential_cost,
    implicit_cost,
    leapfrog_cost,
    rosenbrock_cost,
    stable_steps,
)
from fmd.integrators.protocol import Integrator, Progress, ResumableIntegrator, State, Trajectory, require_start
from fmd.integrators.rosenbrock import ExponentialRosenbrock
from fmd.integrators.runge_kutta import DAMPED, RungeKutta
from fmd.integrators.side_by_side import March, march_at_once, march_in_turn

_FINER: dict[type, float] = {
    RungeKutta: 0.01,
    ExponentialRosenbrock: 0.1,
}  # tolerance over the one before
_GAINS = {
    PiecewiseExponential.name: Gain(4.0, 0.0, math.inf),
    RungeKutta.name: Gain(9.0, 3.0, 60.0),  # steps that the tolerance bounds fall by more than their mean
    ExponentialRosenbrock.name: Gain(3.0, 1.0, 6.0),
    CentralDifference.name: Gain(1.8, 0.0, 1.0, 0.7),
    GeneralizedAlpha.name: Gain(1.8, 0.0, 1.0, 0.7),
}
"""What is believed of each method where not all vibrations are resolved.

A method of second order whose fastest vibrations are out of step has the same error with half the step.
"""


@dataclass(frozen=True)
class _Marches:
    """One or two marches, the last of which is the finest."""

    methods: tuple[Integrator, ...]  # methods to march by
    cost: float  # operations of the last one
    start: State | None = None  # where an adaptive method starts from

    def functions(self, system: System, q0: Array, v0: Array, some: Array, times: Array) -> list[March]:
        """Return the marches; all but the last one give some of the output times, at which they are compared."""
        asked = [*[some] * (len(self.methods) - 1), times]
        if self.start is None:
            return [
                partial(method.march, system, q0, v0, each) for method, each in zip(self.methods, asked, strict=True)
            ]
        resumable = cast("tuple[ResumableIntegrator, ...]", self.methods)
        return [partial(method.resume, system, self.start, each) for method, each in zip(resumable, asked, strict=True)]


@dataclass(frozen=True)
class Automatic(Integrator):
    """Method that marches with finer and finer steps until two marches tell an error below ``error``.

    Where modes and joints don't couple through the mass matrix, or few of the longest stable steps cover the duration,
    that is the exponential method, unless two marches by the Runge–Kutta method cost less. Else, but for few steps,
    generalised-α marches by shorter and shorter steps, as long as those that the error still asks for cost less than
    stable ones of central difference; then that method, as long as its steps cost less than the Runge–Kutta method's;
    then this one. Where stable steps are many, a trial over the first part of the motion may find the exponential
    Rosenbrock method cheaper than these last two, which take over if its march costs more after all. Costs are counted,
    not timed, so that the choice hardly depends on the machine.
    """

    # Wanted error, relative to the largest value of each kind of coordinate over the march; rates may have twice as
    # much.
    error: float
    duration: float  # of the motion that the method is chosen for [s]

    name = "auto"
    step = 0.0
    chooses_method = True

    def __post_init__(self) -> None:
        if not 0.0 < self.error < 1.0:
            raise ValueError(f"error is {self.error}, expected 0 … 1")

    def order(self, system: System) -> int:
        """Return the order of the chosen method where it counts."""
        return 4

    def largest_step(self, system: System) -> float:
        """Return infinity: a march that diverges is refined."""
        return np.inf

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 to the last of ``times``; run time and evaluations are those of all marches together.

        Raises
        ------
        AccuracyError
            The wanted error was not reached; the message has the last difference, or says why every march failed.
        """
        require_start(self, system, q0, v0)
        report = pairs_of(system, self.error)
        # Vibrations have short peaks.
        some = times if self._stiff(system) else compared_times(times, limits.COMPARED_TIMES)
        for marches in self._methods(system, q0, v0, some, times, report, progress):
            march = march_at_once if marches.cost > limits.WORTH_A_CORE else march_in_turn
            found, seconds = march(marches.functions(system, q0, v0, some, times), progress)
            report.seconds += seconds
            agreed = False
            if len(found) > 1:  # a pair is compared with itself
                report.before = None
            for outcome in found:
                if isinstance(outcome, Trajectory):
                    agreed = report.agrees(outcome, _gain(report.before or outcome, system))
                    continue
                if isinstance(outcome, StabilityError):
                    system.explain_failure(outcome)
                report.add_failure(outcome)
            last, method = found[-1], marches.methods[-1]
            if not (agreed and isinstance(last, Trajectory)):
                continue
            if isinstance(method, RungeKutta) and last.evaluations <= limits.FEW_EVALUATIONS:  # which gain by chance
                tolerance = max(limits.THIRD_TOLERANCE * method.tolerance, limits.FINEST_TOLERANCE)
                third = replace(marches, methods=(RungeKutta(tolerance, method.reach / limits.NEARLY),))
                (closer,), _ = march_in_turn(third.functions(system, q0, v0, some, some), progress)
                if isinstance(closer, Trajectory) and not report.holds_beside(closer, last, method.tolerance):
                    continue
            return self._own(last, method, report)
        if report.failure and (report.failures > 1 or np.isinf(report.difference)):
            raise report.failure
        raise AccuracyError(f"{self.name}: {self._say_what_differs(system, report)}")

    def _own(self, march: Trajectory, chosen: Integrator, report: Pairs) -> Trajectory:
        """Return a march that agrees with the one before as this method's own."""
        return replace(
            march,
            integrator=f"{self.name} ({march.integrator})",
            seconds=report.seconds,
            evaluations=report.evaluations,
            chosen=chosen,
            error=report.difference,
        )

    def judge(self, march: Trajectory, method: CentralDifference, system: System, report: Pairs) -> Trajectory | None:
        """Return a march of a system as this method's own if it agrees with the one before, which a report has."""
        report.seconds += march.seconds
        return self._own(march, method, report) if report.agrees(march, _gain(march, system)) else None

    def _say_what_differs(self, system: System, report: Pairs) -> str:
        """Return by how much the last two marches differ, where, since when, and what would be met."""
        said = f"the last two marches differ by {report.difference:.1e}, above {self.error:.0e}"
        if not report.parting:
            return said
        found, met = report.parting, limits.MET * report.difference
        said += f", most in {system.describe_coordinate(found.number, found.is_rate)}; they agree up to t = "
        ways = ["a duration up to there"] * (found.until > 0.0) + [f"an error of {met:.1g}"] * (
            met < limits.LARGEST_MET
        )
        said += f"{found.until:.4g} s" + (f", so that {' or '.join(ways)} can be met" if ways else "")
        laws = ", ".join(dict.fromkeys(law.name for law in system.piecewise_laws))
        return f"{said}; shocks by {laws} are sensitive, and more damping makes them less so" if laws else said

    def _methods(
        self,
        system: System,
        q0: Array,
        v0: Array,
        some: Array,
        times: Array,
        report: Pairs,
        progress: Progress | None,
    ) -> Iterator[_Marches]:
        """Yield one or two methods, each finer than that before, with the operations of the last one."""
        stiff, sampled = self._stiff(system), system.is_sampled
        # The exponential method has no quaternions, and steps that couplings of stiff systems bound.
        if (
            not sampled
            and system.n_positions == system.n
            and len(system.breakpoints) <= limits.MANY_BREAKPOINTS
            and not (stiff and system.coupled)
        ):
            yield from self._exponential_methods(system, some.size, times.size, report)
        adaptive: type[RungeKutta | ExponentialRosenbrock] = RungeKutta
        if self.duration > limits.MOST_EXPLICIT * system.largest_step:  # by dampers
            adaptive = ExponentialRosenbrock
        elif stiff and not sampled:
            leapfrog_steps = max(
                explicit_frequency(system) * self.duration / limits.LEAP,
                limits.IMPLICIT_STEPS_IN_ACTION * self.duration / system.shortest_action,
            )
            leapfrog_steps = self.duration / system.resolving_step(self.duration / leapfrog_steps)[0]
            cost = 3 * leapfrog_steps * leapfrog_cost(system)  # of two marches, of so many steps and twice as many
            yield from self._implicit_methods(system, q0, v0, limits.IMPLICIT_SHARE * cost, report)
            if cost > limits.WORTH_A_TRIAL * rosenbrock_cost(system, 1.0):
                end = min(limits.TRIAL * self.duration, float(times[-1]))
                explicit = min(cost, explicit_pair_cost(system, self.duration))
                most = self._steps_worth_taking(system, q0, v0, explicit, end, progress)
                if most:
                    yield from self._adaptive_marches(ExponentialRosenbrock, system, q0, v0, report, most)
            allowed = limits.WORTHWHILE * stable_steps(system, self.duration) * explicit_cost(system)
            yield from self._leapfrog_methods(system, leapfrog_steps, allowed, report)
        yield from self._adaptive_marches(adaptive, system, q0, v0, report)

    def _adaptive_marches(
        self,
        method: type[RungeKutta | ExponentialRosenbrock],
        system: System,
        q0: Array,
        v0: Array,
        report: Pairs,
        most_steps: float = math.inf,
    ) -> Iterator[_Marches]:
        """Yield a method by finer and finer tolerances, until marches fail or take more steps than are worth it."""
        report.start_anew()
        cost = explicit_pair_cost(system, self.duration) / 2 if method is RungeKutta else np.inf
        start = method().start(system, q0, v0)
        methods = tuple(self._adaptive_methods(method, most_steps))
        yield _Marches(methods[:2], cost, start)
        for each in methods[2:]:
            if report.failures > 1:  # it isn't the tolerance
                return
            yield _Marches((each,), cost, start)

    def _stiff(self, system: System) -> bool:
        return stable_steps(system, self.duration) > limits.FEW_STEPS

    def _adaptive_methods(
        self, method: type[RungeKutta | ExponentialRosenbrock], most_steps: float
    ) -> Iterator[RungeKutta | ExponentialRosenbrock]:
        """Yield a method by finer and finer tolerances; where these don't bound its steps, the highest frequency does.

        Else two marches by the longest stable steps would agree that both lose the fastest vibrations.
        """
        tolerances = [max(self.error * limits.FIRST_TOLERANCE, limits.FINEST_TOLERANCE)]
        while tolerances[-1] > 2 * limits.FINEST_TOLERANCE:  # which comes once: twice it would agree with itself
            tolerances.append(max(_FINER[method] * tolerances[-1], limits.FINEST_TOLERANCE))
        for k, tolerance in enumerate(tolerances):
            if method is RungeKutta:
                yield RungeKutta(tolerance, DAMPED / limits.NEARLY**k)
            else:
                yield ExponentialRosenbrock(tolerance, most_steps)

    def _exponential_methods(
        self, system: System, n_compared: int, n_outputs: int, report: Pairs
    ) -> Iterator[_Marches]:
        """Yield the exponential method with more and more steps, while two marches by Runge–Kutta would cost more."""
        allowed = explicit_pair_cost(system, self.duration)

        def march(k: int) -> PiecewiseExponential:
            # Odd numbers, lest two marches agree that see a vibration at the same points of its periods.
            steps = limits.FIRST_STEPS * 2**k + (limits.ODD * (2 * k - 1) if k else 0)
            # What happens between two breakpoints takes finer steps too, lest two marches agree that miss it alike.
            return PiecewiseExponential(self.duration / steps, 2 ** (k + 2))

        first = exponential_cost(system, limits.FIRST_STEPS, n_compared)
        cost, k = exponential_cost(system, 2 * limits.FIRST_STEPS, n_outputs), 1
        if not first + cost < allowed:
            return
        yield _Marches((march(0), march(1)), cost)
        while not report.failures:
            more = report.difference / self.error if np.isfinite(report.difference) else 1.0
            k += max(1, math.ceil(math.log(more, limits.DOUBLED_OFTEN)))
            cost = exponential_cost(system, limits.FIRST_STEPS * 2**k, n_outputs)
            if k > limits.MOST_DOUBLINGS or not cost < allowed:
                return
            yield _Marches((march(k),), cost)

    def _implicit_methods(
        self, system: System, q0: Array, v0: Array, allowed: float, report: Pairs
    ) -> Iterator[_Marches]:
        """Yield generalised-α with more and more steps, as long as these cost less than what is allowed.

        A piece of the motion tells how many evaluations a step takes, two marches how many steps the error asks for.
        """
        report.start_anew()
        steps = float(
            max(
                limits.FIRST_IMPLICIT_STEPS,
                np.ceil(limits.IMPLICIT_STEPS_IN_ACTION * self.duration / system.shortest_action),
            )
        )
        cost = implicit_cost(system)
        if 3 * steps * limits.FEWEST_EVALUATIONS * cost <= allowed:
            steps = self.duration / system.resolving_step(self.duration / steps)[0]
        if 3 * steps * limits.FEWEST_EVALUATIONS * cost > allowed:
            return
        try:
            piece = np.array([limits.COUNTED_STEPS * self.duration / steps])
            per_step = (
                GeneralizedAlpha(self.duration / steps).march(system, q0, v0, piece).evaluations / limits.COUNTED_STEPS
            )
        except AccuracyError:  # a step has no solution
            per_step = float(system.n)
        if 3 * steps * per_step * cost > allowed:
            return
        steps *= limits.NEARLY
        while steps * per_step * cost <= allowed:
            yield self._nearly_alike(GeneralizedAlpha, steps, steps * per_step * cost)
            if report.before is not None:
                per_step = report.before.evaluations * report.before.step / report.before.times[-1]
            steps *= report.more_steps()

    def _leapfrog_methods(self, system: System, steps: float, allowed: float, report: Pairs) -> Iterator[_Marches]:
        """Yield central difference with more and more steps, as long as these cost less than what is allowed.

        Where it diverges, away from the reference state, shorter steps are tried once. Where vibrations are out of
        step, the difference hardly falls, and other methods take over.
        """
        report.start_anew()
        steps *= limits.NEARLY
        while steps * leapfrog_cost(system) <= allowed:
            yield self._nearly_alike(CentralDifference, steps, steps * leapfrog_cost(system))
            if report.failures > 2 or report.stays:
                return
            steps *= report.more_steps() if np.isfinite(report.difference) else limits.SHORTER_STEPS

    def _nearly_alike(self, method: type[CentralDifference | GeneralizedAlpha], steps: float, cost: float) -> _Marches:
        """Return marches by a method of second order, the last one with so many steps.

        Far fewer steps in the first don't resolve all vibrations, and tell less than the order promises.
        """
        return _Marches((method(limits.NEARLY * self.duration / steps), method(self.duration / steps)), cost)

    def _steps_worth_taking(
        self, system: System, q0: Array, v0: Array, explicit: float, end: float, progress: Progress | None
    ) -> float:
        """Return the steps of the Rosenbrock method that cost what explicit methods do; 0 if its march takes more.

        The steps that it takes to ``end`` tell. What begins to act later may make them shorter, and then their number
        ends its march.
        """
        method = ExponentialRosenbrock(self.error * limits.FIRST_TOLERANCE)
        try:
            # Its progress is that of a march to the end, which may be ended where that would take too long.
            watch = None if progress is None else lambda done: progress(end / self.duration * done)
            trial = method.march(system, q0, v0, np.array([end]), watch)
        except StabilityError:
            return 0.0
        step = max(trial.step, 1e-300)
        most = explicit / rosenbrock_cost(system, step)
        return most if 2 * self.duration / step < most else 0.0


def _gain(coarse: Trajectory, system: System) -> Gain:
    follows = coarse.integrator in (RungeKutta.name, PiecewiseExponential.name)
    if follows and system.highest_frequency * coarse.step > limits.RESOLVED:
        return Gain(limits.UNRESOLVED_ORDER, limits.UNRESOLVED_LEAST, limits.UNRESOLVED_MOST)
    return _GAINS[coarse.integrator]
