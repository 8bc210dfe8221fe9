"""Counted operations of the methods, by which the automatic choice weighs them: hardly a machine's matter."""

from __future__ import annotations

import numpy as np

from fmd.dynamics.system import System
from fmd.integrators.runge_kutta import DAMPED

LEAP = 1.8  # radians of the highest frequency in a step of central difference, of the 2 that are stable
_COST = 60.0  # operations of an evaluation for each coordinate, of a system that doesn't tell
_OVERHEAD = 3000.0  # operations of an iteration of generalised-α beside its evaluation
_A_PIECE = 1e6  # operations of a march of the exponential method between two breakpoints, before its first step
_A_SAMPLE = 350.0  # operations of an output of that method, for each coordinate
_ACCURATE, _ACCURATE_STABLE = 1000.0, 60.0  # evaluations of two marches by the Runge-Kutta method: and a stable step's


def evaluation_cost(system: System) -> float:
    """Operations of an evaluation of the accelerations."""
    return float(getattr(system, "evaluation_cost", _COST * system.n))


def explicit_cost(system: System) -> float:
    """Cost of a step of the Runge–Kutta method: 12 evaluations, and sums of 12 slopes for each."""
    return 12 * (evaluation_cost(system) + 12 * system.n)


def leapfrog_cost(system: System) -> float:
    """Cost of a step of central difference."""
    return evaluation_cost(system) + 6 * system.n


def rosenbrock_cost(system: System, step: float) -> float:
    """Cost of a step [s] of the Rosenbrock method: as many evaluations as coordinates, and products of matrices."""
    n = system.n + system.n_positions
    doublings = max(0.0, np.log2(system.highest_frequency * step))
    return float(n * evaluation_cost(system) + 2 * (14 + 15 * doublings) * n**3)


def implicit_cost(system: System) -> float:
    """Cost of an evaluation of generalised-α, with a solution by a kept factor or its share of a new one."""
    return evaluation_cost(system) + 4 * system.n**2 + _OVERHEAD


def exponential_cost(system: System, steps: int, n_outputs: int) -> float:
    """Cost of a march of the exponential method by so many steps; each breakpoint begins a march of its own."""
    of_steps = 4 * steps * (evaluation_cost(system) + 20 * system.n)
    return of_steps + _A_SAMPLE * n_outputs * system.n + _A_PIECE * len(system.breakpoints)


def stable_steps(system: System, duration: float) -> float:
    """Return how many steps of the Runge–Kutta method at least are stable over a duration [s]."""
    return system.highest_frequency * duration / DAMPED


def explicit_pair_cost(system: System, duration: float) -> float:
    """Cost of two marches of the Runge–Kutta method over a duration [s], of which the second mostly does."""
    return (_ACCURATE + _ACCURATE_STABLE * stable_steps(system, duration)) * explicit_cost(system) / 12
