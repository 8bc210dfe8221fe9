"""Check of the sample times of a scene's controllers, along the motion of its first run or at its start."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.stability import BISECTIONS, COARSE_EXCHANGE, FINELY_SAMPLED, GROWING, SAMPLED_STATES
from fmd.dynamics.fmu_law import FmuLaw
from fmd.scene.controllers import FmuController, PidController
from fmd.stability.sampled_loops import SampledLoops, linearise_loops
from fmd.stability.tangent import OperatingPoint
from fmd.stages.controllers import sampled_law

if TYPE_CHECKING:
    from fmd.stages.pipeline import Pipeline


def states_of_motion(run: Pipeline) -> list[tuple[OperatingPoint, Array]]:
    """Return some states of the first run's motion with the values that controllers hold there, (n_held,) each."""
    trajectory = run.motion.trajectory
    assert trajectory.held is not None
    return [
        (
            OperatingPoint(float(trajectory.times[k]), trajectory.q[k], trajectory.v[k]),
            np.array(trajectory.held.at(float(trajectory.times[k]))),
        )
        for k in np.linspace(0, len(trajectory.times) - 1, SAMPLED_STATES).astype(int)
    ]


def state_of_start(run: Pipeline) -> list[tuple[OperatingPoint, Array]]:
    """Return the state at the start, for a motion that can't be found; controllers hold nothing there."""
    q, v = run.start
    return [(OperatingPoint(0.0, q, v), np.zeros(len(run.system.mechanism.controllers)))]


def find_unstable_sampling(run: Pipeline, states: Sequence[tuple[OperatingPoint, Array]]) -> str:
    """Say if sampling makes small vibrations grow that fine sampling would not, and which sample times would do.

    Loops are linearised, without limits, about states with the values that controllers hold. Nothing is said if they
    are sound there.
    """
    scene, system = run.scene, run.system
    controllers = system.mechanism.controllers
    given = [scene.controller[one.name] for one in controllers]
    if any(isinstance(one, FmuController) for one in given):
        return ""  # what is in an FMU isn't known; `find_coarse_exchanges` sees what comes of it
    duration, worst = scene.simulation.duration, ""
    most = GROWING
    for at, held in states:
        loops = linearise_loops(system, at, held)

        def rate(share: float, loops: SampledLoops = loops) -> float:
            periods = [share * one.period for one in controllers]
            laws = [
                sampled_law(one, T) for one, T in zip(given, periods, strict=True) if isinstance(one, PidController)
            ]
            found = loops.growth_rate(periods, laws)
            return math.nan if found is None else found

        own, fine = rate(1.0), max(rate(FINELY_SAMPLED), 0.0)
        if math.isnan(own):
            return "whether the loops are stable isn't known: the sample times are no multiples of the shortest one"
        if (own - fine) * duration <= most:
            continue
        low, high = FINELY_SAMPLED, 1.0
        for _ in range(BISECTIONS):
            middle = math.sqrt(low * high)
            low, high = (middle, high) if (rate(middle) - fine) * duration <= GROWING else (low, middle)
        most = (own - fine) * duration
        names = " and ".join(one.name for one in controllers)
        times = ", ".join(f"{_round_down(low * one.period):.2g} s" for one in controllers)
        worst = (
            f"{names}: the sample time makes the closed loop unstable, small vibrations grow as exp({own:.3g} t) "
            f"about t = {at.time:.4g} s; {times} would do, or lower gains"
        )
    return worst


def find_coarse_exchanges(run: Pipeline) -> list[str]:
    """Say which FMUs' outputs change so much within a sample time of the first run that its length matters."""
    held, found = run.motion.trajectory.held, []
    for one in run.system.mechanism.controllers:
        if held is None or not isinstance(one.law, FmuLaw):
            continue
        values = np.array(held.values)[:, one.output.number]
        largest = float(np.abs(values).max())
        jump = float(np.abs(np.diff(values)).max(initial=0.0)) / largest if largest else 0.0
        if jump > COARSE_EXCHANGE:
            found.append(
                f"{one.name}: the FMU's output changes by up to {100 * jump:.2g} % of its largest value from sample "
                f"to sample; unless it samples by itself, a sample_time below {one.period:g} s, or order = 2, makes "
                "results better"
            )
    return found


def _round_down(time: float) -> float:
    """Return a time [s] with two digits, not above it."""
    unit = 10.0 ** (math.floor(math.log10(time)) - 1)
    return math.floor(time / unit) * unit
