"""How Exudyn's twins of our scenes are marched and timed: coarse to fine, one thread, nothing written.

It needs ``pip install exudyn==1.13.6``. ρ∞ is 0.95; seconds are those of Exudyn's own timer around the solver.
"""

import contextlib
import io
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from fmd.output.work_precision import WorkPrecisionRow

INTERVALS = 100  # between output times; every number of steps is a multiple
STAGES = {"VelocityVerlet": 1, "RK44": 4, "RK67": 7}  # of explicit solvers, which know no constraints
IMPLICIT = ("GeneralizedAlpha", "TrapezoidalIndex2")
REPEATS = 5


@dataclass
class Twin:
    """An assembled system of Exudyn's, ready for many marches.

    ``figures(samples)`` are what is compared, shape (INTERVALS + 1, any), from the samples of each sensor, each
    (INTERVALS + 1, any); ``keep`` is what has to live as long.
    """

    mbs: Any
    sensors: list[Any]
    figures: Callable[[list[Any]], Any]
    keep: list[Any]
    relative_tolerance: float = 1e-8  # of Newton's method
    jacobian_each_step: bool = False
    dense: bool = False  # the dense solver, which ignores a singular Jacobian


def sample_times(duration):
    return np.linspace(0.0, duration, INTERVALS + 1)


def import_exudyn() -> Any:
    sys.exudynFast = True
    with contextlib.redirect_stdout(io.StringIO()):  # it announces itself
        try:
            import exudyn
            import exudyn.advancedUtilities
            import exudyn.FEM
            import exudyn.itemInterface
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError("the peer needs Exudyn: pip install exudyn==1.13.6") from error
    return exudyn


def add_sensor(mbs, node, kind):
    exu = import_exudyn()
    kind = getattr(exu.OutputVariableType, kind)
    return mbs.AddSensor(exu.itemInterface.SensorNode(nodeNumber=node, storeInternal=True, outputVariableType=kind))


def march(twin: Twin, duration: float, solver: str, n_steps: int, output: bool) -> tuple[float, int]:
    """Integrate; return seconds and Newton's iterations, or how often an explicit solver evaluated the equations."""
    exu = import_exudyn()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.active = output
    settings.solution.sensors.writePeriod = duration / INTERVALS
    time = settings.timeIntegration
    time.endTime, time.numberOfSteps = duration, n_steps
    time.automaticStepSize = time.adaptiveStep = False
    time.generalizedAlpha.spectralRadius = 0.95
    time.newton.useModifiedNewton = True
    time.newton.modifiedNewtonJacUpdatePerStep = twin.jacobian_each_step
    time.newton.relativeTolerance, time.newton.absoluteTolerance = twin.relative_tolerance, 1e-10
    if twin.dense:
        settings.linearSolver.solverType = exu.LinearSolverType.EigenDense
        settings.linearSolver.ignoreSingularJacobian = True
    settings.parallel.numberOfThreads = 1
    with contextlib.redirect_stdout(io.StringIO()):  # a failed march says so there, and raises
        twin.mbs.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, solver), showHints=False)
    done = twin.mbs.sys["dynamicSolver"]
    return done.timer.total, STAGES.get(solver, 0) * n_steps or done.it.newtonStepsCount


def samples_of(twin: Twin) -> list[Any]:
    """Return what the sensors sampled in the last march, each of shape (n_times, any), without the times."""
    return [np.array(twin.mbs.GetSensorStoredData(sensor))[:, 1:] for sensor in twin.sensors]


def marches(
    twin: Twin, duration: float, solver: str, counts: Iterable[int], error: Callable[[Any], float]
) -> Iterator[tuple[int, int, float, Callable[[], float]]]:
    """March a twin by a solver with ever more steps.

    Yields steps, evaluations and the error of each march, and what marches so once more and returns its seconds.
    """
    exu = import_exudyn()
    for n_steps in counts:
        try:
            _, evaluations = march(twin, duration, solver, n_steps, output=True)
        except exu.ExudynError:  # diverged: nothing to compare at this step
            continue
        found = error(twin.figures(samples_of(twin)))
        if found < 1.0:
            yield n_steps, evaluations, found, partial(_seconds, twin, duration, solver, n_steps)


def _seconds(twin: Twin, duration: float, solver: str, n_steps: int) -> float:
    return march(twin, duration, solver, n_steps, output=False)[0]


def refine(
    twin: Twin,
    duration: float,
    solver: str,
    counts: Iterable[int],
    error: Callable[[Any], float],
    finest: float,
    most_seconds: float,
) -> Iterator[WorkPrecisionRow]:
    """March a twin by a solver with ever more steps, until a march takes too long or is as exact as wanted."""
    for n_steps, evaluations, found, again in marches(twin, duration, solver, counts, error):
        seconds = [again()]
        while len(seconds) < REPEATS and sum(seconds) < most_seconds:
            seconds.append(again())
        yield WorkPrecisionRow(f"Exudyn {solver}", duration / n_steps, 1, min(seconds), found, evaluations)
        if min(seconds) > most_seconds or found < finest:
            break


def relative_error(wanted: Any) -> Callable[[Any], float]:
    """Return what gives the largest difference from some figures over their largest value."""
    return lambda found: float(np.abs(found - wanted).max() / np.abs(wanted).max())
