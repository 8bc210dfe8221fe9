"""Counted operations of the methods, by which the automatic choice weighs them: hardly a machine's matter."""

import numpy as np

from fmd.core.limits import stepping as limits
from fmd.dynamics.system import System
from fmd.integrators.runge_kutta import DAMPED


def explicit_cost(system: System) -> float:
    """Cost of a step of the Runge–Kutta method: 12 evaluations, and sums of 12 slopes for each."""
    return 12 * (system.evaluation_cost + 12 * system.n)


def leapfrog_cost(system: System) -> float:
    """Cost of a step of central difference."""
    return system.evaluation_cost + 6 * system.n


def rosenbrock_cost(system: System, step: float) -> float:
    """Cost of a step [s] of the Rosenbrock method: as many evaluations as coordinates, and products of matrices."""
    n = system.n + system.n_positions
    doublings = max(0.0, np.log2(system.highest_frequency * step))
    return float(n * system.evaluation_cost + 2 * (14 + 15 * doublings) * n**3)


def implicit_cost(system: System) -> float:
    """Cost of an evaluation of generalised-α, with a solution by a kept factor or its share of a new one."""
    return system.evaluation_cost + 4 * system.n**2 + limits.OVERHEAD


def exponential_cost(system: System, steps: int, n_outputs: int) -> float:
    """Cost of a march of the exponential method by so many steps; each breakpoint begins a march of its own."""
    of_steps = 4 * steps * (system.evaluation_cost + 20 * system.n)
    return of_steps + limits.COST_OF_SAMPLE * n_outputs * system.n + limits.COST_OF_PIECE * len(system.breakpoints)


def stable_steps(system: System, duration: float) -> float:
    """Return how many steps of the Runge–Kutta method at least are stable over a duration [s]."""
    return explicit_frequency(system) * duration / DAMPED


def explicit_frequency(system: System) -> float:
    """Return what bounds explicit steps [rad/s]: the highest frequency, or the rate at which a strong damper acts."""
    return max(system.highest_frequency, 2.0 / system.largest_step)


def explicit_pair_cost(system: System, duration: float) -> float:
    """Cost of two marches of the Runge–Kutta method over a duration [s], of which the second mostly does."""
    return (
        (limits.ACCURATE_EVALUATIONS + limits.ACCURATE_STABLE_STEP * stable_steps(system, duration))
        * explicit_cost(system)
        / 12
    )
