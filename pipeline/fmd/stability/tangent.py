"""Growth rates of small vibrations about an operating point, by a scheme and by the equations of motion.

The tangent map of a scheme over some major cycles is the scheme itself, differentiated. It holds all that the kernels
freeze over a cycle, take at a predicted rate or leave out: inertial coupling, centrifugal and Coriolis terms, dampers.
Its eigenvalues μ over a span τ grow at the rates ``ln|μ|/τ``, those of the linearised equations of motion at ``Re λ``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import StabilityError
from fmd.core.limits.newton import NUDGE
from fmd.core.limits.stability import ACCELERATION_NUDGE, RATE_NUDGE
from fmd.dynamics.system import System
from fmd.integrators.protocol import (
    ResumableIntegrator,
    State,
    evaluate,
    evaluate_projection,
    evaluate_velocities,
)


@dataclass(frozen=True)
class OperatingPoint:
    """State of a mechanism about which small vibrations are studied.

    Attributes
    ----------
    time : float
        [s]
    q, v : ndarray, shapes (n_positions,) and (n,)
        Positions and rates.
    """

    time: float
    q: Array
    v: Array


def system_growth_rates(system: System, at: OperatingPoint) -> Array:
    """Return the growth rates of small vibrations by the linearised equations of motion.

    Returns
    -------
    ndarray, shape (n_positions + n,)
        Real parts of the eigenvalues [1/s], descending.
    """
    n_positions, n, parameters = system.n_positions, system.n, system.parameters

    def slope(state: Array) -> Array:
        q, v, dq, a = state[:n_positions].copy(), state[n_positions:].copy(), np.zeros(n_positions), np.zeros(n)
        evaluate_velocities(parameters, q, v, dq)
        evaluate(parameters, at.time, q, v, a)
        return np.concatenate([dq, a])

    nudges = np.repeat([NUDGE, RATE_NUDGE], [n_positions, n])
    J = differentiate(slope, np.concatenate([at.q, at.v]), nudges)
    return np.sort(np.linalg.eigvals(J).real)[::-1]


def scheme_growth_rates(method: ResumableIntegrator, system: System, at: OperatingPoint, span: float) -> Array:
    """Return the growth rates of small vibrations in a march with a fixed step.

    Parameters
    ----------
    span : float
        Time that the tangent map is taken over, rounded to whole major cycles [s].

    Returns
    -------
    ndarray
        ``ln|μ|/τ`` for each eigenvalue μ of `scheme_tangent` [1/s], descending.

    Raises
    ------
    StabilityError
        The march diverges within the span.
    """
    A, duration = scheme_tangent(method, system, at, span)
    if not np.isfinite(A).all():  # a disturbed march diverged
        raise StabilityError(f"{method.name} diverges within {duration:.3g} s of t = {at.time:.3g} s")
    moduli = np.maximum(np.abs(np.linalg.eigvals(A)), 1e-300)
    return np.sort(np.log(moduli))[::-1] / duration


def scheme_tangent(method: ResumableIntegrator, system: System, at: OperatingPoint, span: float) -> tuple[Array, float]:
    """Differentiate a march over some major cycles by its state at their start.

    Returns
    -------
    ndarray
        Map of disturbances of ``State.q``, ``State.v`` and ``State.a``, a square matrix; and of the forces that a
        method carries on from the cycles before, if it does (the companion form of a map with a history).
    float
        Duration of the cycles [s]: ``span``, rounded to whole ones.
    """
    h = method.step
    driven = _has_driven_loops(system)
    base = method.march(system, *(_rest(system) if driven else (at.q, at.v)), np.zeros(1)).end
    m = base.step
    cycles = cycles_within(span, m * h)
    first = max(1, round(at.time / (m * h))) * m
    # The first cycle had the loads of time 0; one more has those of the operating point.
    base = replace(base, step=first - m)
    if driven:
        base = _moved(system, base, at, (first - m) * h)
    base = method.resume(system, base, np.array([(first - 1) * h])).end
    history = base.memory[:-1] if getattr(method, "remembered", False) else base.memory[:0]
    parts, end = np.cumsum([base.q.size, base.v.size, base.a.size]), (first + cycles * m - 1) * h

    sizes = [base.q.size, base.v.size, base.a.size + history.size]  # some methods keep two accelerations
    nudges = np.repeat([NUDGE, RATE_NUDGE, ACCELERATION_NUDGE], sizes)
    centre, starts = np.concatenate([base.q, base.v, base.a, history]), []
    for values in (centre + sign * nudge for nudge in np.diag(nudges) for sign in (1.0, -1.0)):
        q, v, a, earlier = np.split(values, parts)
        starts.append(replace(base, q=q, v=v, a=a, memory=np.concatenate([earlier, base.memory[history.size :]])))
    ends = method.ends(system, starts, end)
    values = np.array([np.concatenate([x.q, x.v, x.a, x.memory[: history.size]]) for x in ends])
    return (values[::2] - values[1::2]).T / (2 * nudges), cycles * m * h


def _has_driven_loops(system: System) -> bool:
    """Return True if prescribed motions move loops, which close at their own time alone."""
    mechanism = getattr(system, "mechanism", None)
    return bool(mechanism and mechanism.closures and any(link.motion is not None for link in mechanism.links))


def _rest(system: Any) -> tuple[Array, Array]:
    """Return positions and rates of the undeformed mechanism at time 0 that its loops allow."""
    q, v = system.mechanism.rest_positions, np.zeros(system.n)
    evaluate_projection(system.parameters, 0.0, q, v)
    return q, v


def _moved(system: System, state: State, at: OperatingPoint, time: float) -> State:
    """Return a state with positions and rates of an operating point as the loops allow them at a time [s]."""
    q, v, a = at.q.copy(), at.v.copy(), np.zeros(system.n)
    evaluate_projection(system.parameters, time, q, v)
    evaluate(system.parameters, time, q, v, a)
    return replace(state, q=q, v=v, a=np.resize(a, state.a.size))


def cycles_within(span: float, cycle: float) -> int:
    """Return the number of whole major cycles [s] nearest to a span [s], at least 1."""
    return max(1, round(span / cycle))


def differentiate(function: Callable[[Array], Array], centre: Array, nudges: Array) -> Array:
    """Return the Jacobian of a function of vectors by central differences, each argument moved by its nudge."""
    columns = [(function(centre + d) - function(centre - d)) / (2 * d.max()) for d in np.diag(nudges)]
    return np.stack(columns, axis=1)
