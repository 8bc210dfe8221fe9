"""Run time against error: every integrator over a range of steps or tolerances, against a checked reference."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import nan
from statistics import median
from typing import NamedTuple

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.dynamics.system import System
from fmd.integrators.exponential import Exponential
from fmd.integrators.protocol import Integrator, Trajectory
from fmd.integrators.rosenbrock import ExponentialRosenbrock
from fmd.integrators.runge_kutta import RungeKutta
from fmd.scene.runs import RUNS


class Errors(NamedTuple):
    """Errors of a trajectory, each relative to the largest value over the motion; NaN for what the system lacks."""

    tip: float
    modal: float
    joint: float


ErrorsOf = Callable[[Trajectory, Trajectory], Errors]
"""A function that returns the errors of one trajectory against another."""

_MOST_SECONDS = 2.0  # a march longer than this ends its method's range
_STABLE = 0.9  # of the largest stable step


@dataclass(frozen=True)
class WorkPrecisionRow:
    """Run time and errors of one march.

    Attributes
    ----------
    integrator : str
        Name of the method, with its ratio if it sub-cycles.
    step_s : float
        Step, of adaptive methods the mean one [s].
    substeps : int
        Fast steps to one slow step.
    seconds : float
        Median run time.
    error : float
        Error of the tip against the reference.
    evaluations : int
        Solutions of the whole system; those of the fast part alone come on top.
    modal_error, joint_error : float
        Errors of the modal coordinates, from which stress is recovered, and of the joints' coordinates.
    """

    integrator: str
    step_s: float
    substeps: int
    seconds: float
    error: float
    evaluations: int
    modal_error: float = nan
    joint_error: float = nan


@dataclass(frozen=True)
class WorkPrecision:
    """Run time against error of all methods on one system.

    Attributes
    ----------
    rows : tuple of WorkPrecisionRow
        All marches that came to their end, method by method, coarse to fine.
    reference_error : float
        Difference of two independent references at the tip.
    """

    rows: tuple[WorkPrecisionRow, ...]
    reference_error: float


def compare(
    system: System, q0: Array, v0: Array, times: Array, errors_of: ErrorsOf, repeats: int = 5, limit: float = 1e-8
) -> WorkPrecision:
    """March a system by every method, and measure run times and errors.

    Parameters
    ----------
    times : ndarray, shape (n_times,)
        Times at which the errors are taken [s].
    repeats : int
        Number of marches whose median run time counts, each with output at the end alone.
    limit : float
        Largest difference of the two references.

    Raises
    ------
    AccuracyError
        The references, a Runge–Kutta method of order 8 and an exponential one, differ by more.
    """
    duration = float(times[-1])
    reference = RungeKutta(1e-13).march(system, q0, v0, times)
    other: Integrator = ExponentialRosenbrock(1e-12) if system.coupled else Exponential(duration / 20480)
    reference_error = errors_of(other.march(system, q0, v0, times), reference).tip
    if not reference_error < limit:
        raise AccuracyError(f"two references differ by {reference_error:.1e}, above {limit:.0e}")
    rows: list[WorkPrecisionRow] = []
    for methods in _families(system, duration):
        for label, method in methods:
            try:
                motion = method.march(system, q0, v0, times)
            except AccuracyError:  # it diverged at this step
                continue
            ends = times[[0, -1]]
            seconds = [method.march(system, q0, v0, ends).seconds]
            while len(seconds) < repeats and sum(seconds) < _MOST_SECONDS:
                seconds.append(method.march(system, q0, v0, ends).seconds)
            errors, substeps = errors_of(motion, reference), motion.substeps
            figures = (median(seconds), errors.tip, motion.evaluations, errors.modal, errors.joint)
            rows.append(WorkPrecisionRow(label, float(motion.step), substeps, *figures))
            if median(seconds) > _MOST_SECONDS:
                break
    return WorkPrecision(tuple(rows), reference_error)


def _families(system: System, duration: float) -> Iterator[Iterator[tuple[str, Integrator]]]:
    """Yield each method's range, coarse to fine; steps divide a fifth of the duration, where a drive may end."""
    steps = [duration / (5 * 2**k) for k in range(3, 20)]
    explicit = [step for step in steps if step < _STABLE * system.largest_step][:7]
    coarse = [step for step in steps if step >= explicit[-1]]
    for run in RUNS:
        for family in run.ladders(explicit, coarse):
            yield (
                (f"{method.name} {method.substeps}:1" if method.substeps > 1 else method.name, method)
                for method in family
                if method.suits(system) and method.step < _STABLE * method.largest_step(system)
            )
