"""Start of a scene on the motion that repeats: the method that it is sought by, and what has to repeat for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.stability import ADDED_UP, CLOSES, JUST_BEFORE, NOT_PERIODIC, OF_SOLUTIONS, SEARCH_TOLERANCE
from fmd.core.limits.stepping import FINEST_TOLERANCE
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.adaptive import AdaptiveIntegrator
from fmd.integrators.protocol import Integrator, evaluate
from fmd.integrators.runge_kutta import RungeKutta
from fmd.scene.run_table import TolerantRun
from fmd.stability.periodic_motion import FloquetMultipliers, PeriodicMotion, find_multipliers, find_periodic_motion
from fmd.stages.mechanism import place_joints

if TYPE_CHECKING:
    from fmd.scene.scene import Scene
    from fmd.stages.pipeline import Pipeline


def find_periodic_start(scene: Scene, system: CompiledSystem, method: Integrator | None = None) -> PeriodicMotion:
    """Find the motion of a scene that repeats after ``simulation.period`` by a method, that of its search by default.

    Raises
    ------
    AccuracyError
        There is no such motion near the start.
    InputError
        Loads or prescribed motions don't repeat after the period.
    """
    simulation, method = scene.simulation, method or _method_of_search(scene)
    assert simulation.period is not None
    start, closes = place_joints(scene, system.mechanism), CLOSES * simulation.error
    found = find_periodic_motion(system, method, start, simulation.period, closes, _error_of(method))
    _require_repeating(scene, system, found)
    return found


def find_own_start(run: Pipeline) -> PeriodicMotion:
    """Find the motion of a run's scene that repeats; raises as `find_periodic_start`."""
    return find_periodic_start(run.divided_scene, run.system)


def find_own_multipliers(run: Pipeline) -> FloquetMultipliers:
    """Return the Floquet multipliers of the motion that a run begins on, by the method that it is sought by."""
    method = _method_of_search(run.divided_scene)
    return find_multipliers(run.system, method, run.periodic, _error_of(method))


def _method_of_search(scene: Scene) -> AdaptiveIntegrator:
    """Return the method of the scene's first run if that keeps a tolerance, else ``runge-kutta``, with a finer one."""
    simulation, run = scene.simulation, scene.simulation.run[0]
    tolerance = max(SEARCH_TOLERANCE * simulation.error, FINEST_TOLERANCE)
    if isinstance(run, TolerantRun):
        own = run.model_copy(update={"tolerance": tolerance}).make(0.0, simulation.error, simulation.duration)
        if isinstance(own, AdaptiveIntegrator):
            return own
    return RungeKutta(tolerance)


def _error_of(method: Integrator) -> float:
    """Return the relative error of differences of a method's marches: of its steps' choice, or of their solutions."""
    return ADDED_UP * (method.tolerance if isinstance(method, AdaptiveIntegrator) else OF_SOLUTIONS)


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
