"""Start of a scene on the motion that repeats: the method that it is sought by, and what has to repeat for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.stability import CLOSES, JUST_BEFORE, NOT_PERIODIC, SEARCH_TOLERANCE
from fmd.core.limits.stepping import FINEST_TOLERANCE
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.adaptive import AdaptiveIntegrator
from fmd.integrators.protocol import evaluate
from fmd.integrators.runge_kutta import RungeKutta
from fmd.scene.run_table import TolerantRun
from fmd.stability.periodic_motion import PeriodicMotion, find_periodic_motion
from fmd.stages.mechanism import place_joints

if TYPE_CHECKING:
    from fmd.scene.scene import Scene


def find_periodic_start(scene: Scene, system: CompiledSystem) -> PeriodicMotion:
    """Find the motion of a scene that repeats after ``simulation.period``.

    It is marched by the method of the scene's first run if that keeps a tolerance, else by ``runge-kutta``.

    Raises
    ------
    AccuracyError
        There is no such motion near the start.
    InputError
        Loads or prescribed motions don't repeat after the period.
    """
    simulation, run = scene.simulation, scene.simulation.run[0]
    assert simulation.period is not None
    tolerance = max(SEARCH_TOLERANCE * simulation.error, FINEST_TOLERANCE)
    method: AdaptiveIntegrator = RungeKutta(tolerance)
    if isinstance(run, TolerantRun):
        own = run.model_copy(update={"tolerance": tolerance}).make(0.0, simulation.error, simulation.duration)
        method = own if isinstance(own, AdaptiveIntegrator) else method
    start = place_joints(scene, system.mechanism)
    found = find_periodic_motion(system, method, start, simulation.period, CLOSES * simulation.error)
    _require_repeating(scene, system, found)
    return found


def _require_repeating(scene: Scene, system: CompiledSystem, motion: PeriodicMotion) -> None:
    """Raise ``InputError`` if accelerations at states of the motion are others a period later, as far as loads go."""
    period, n_positions = motion.period, system.n_positions
    known = motion.times + period <= scene.simulation.duration
    pairs = [
        (time, time + period, state) for time, state in zip(motion.times[known], motion.states[known], strict=True)
    ]
    pairs += [(0.0, JUST_BEFORE * period, state) for state in motion.states]
    p, most, apart = system.parameters, np.zeros(system.n), np.zeros(system.n)
    for time, later, state in pairs:
        now, then = np.zeros(system.n), np.zeros(system.n)
        q, v = np.split(state.copy(), [n_positions])
        evaluate(p, float(time), q, v, now)
        evaluate(p, float(later), q, v, then)
        most, apart = np.maximum(most, np.abs(now)), np.maximum(apart, np.abs(then - now))
    over: Array = apart / np.maximum(most, NOT_PERIODIC * most.max(initial=0.0) + np.finfo(float).tiny)
    if over.max(initial=0.0) > NOT_PERIODIC:
        name, _ = system.mechanism.coordinates[int(np.argmax(over))]
        text = f"isn't a period of the scene's loads and motions: that much later {name} would accelerate otherwise"
        raise InputError(scene.file, "simulation.period", f"{period:.6g} s", text)
