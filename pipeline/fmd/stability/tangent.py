"""Growth rates of small vibrations about an operating point, by a scheme and by the equations of motion.

The tangent map of a scheme over some major cycles is the scheme itself, differentiated. It holds all that the kernels
freeze over a cycle, take at a predicted rate or leave out: inertial coupling, centrifugal and Coriolis terms, dampers.
Its eigenvalues μ over a span τ grow at the rates ``ln|μ|/τ``, those of the linearised equations of motion at ``Re λ``.
"""

from collections.abc import Callable, Sequence
from dataclasses import field, replace
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import StabilityError
from fmd.core.limits.memory import VALUES_AT_ONCE
from fmd.core.limits.newton import NUDGE
from fmd.core.limits.stability import ACCELERATION_NUDGE, RATE_NUDGE
from fmd.dynamics.system import System
from fmd.integrators.march_tables import state_slopes
from fmd.integrators.protocol import ResumableIntegrator, State, evaluate, evaluate_projection


@dataclass(frozen=True)
class OperatingPoint:
    """State of a mechanism about which small vibrations are studied."""

    time: float  # [s]
    q: Array  # (n_positions,): positions
    v: Array  # (n,): rates
    # (n_numbers,): numbers of the mechanism that it is a state of, where another one of that structure stands for it;
    # see `fmd.integrators.march_tables.numbers_in`
    numbers: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def values(self) -> Array:
        """Positions, rates and numbers, as `state_slopes` takes them."""
        return np.concatenate([self.q, self.v, self.numbers])


def system_slopes(system: System, points: Sequence[OperatingPoint]) -> Array:
    """Return the equations of motion linearised at points, shape (n_points, n_positions + n, n_positions + n)."""
    nudges = np.repeat([NUDGE, RATE_NUDGE], [system.n_positions, system.n])
    times = np.array([at.time for at in points])
    states = np.array([at.values for at in points])
    return differentiate_states(system, times, states, np.arange(nudges.size), nudges)


def slope_growth_rates(slopes: Array) -> Array:
    """Return the real parts of the eigenvalues of linearised equations of motion [1/s], descending, a row each."""
    return np.sort(np.linalg.eigvals(slopes).real)[:, ::-1]


def differentiate_states(system: System, times: Array, states: Array, places: IntArray, nudges: Array) -> Array:
    """Return the derivatives of `state_slopes` by some values of each state, (n_states, n_positions + n, n_places)."""
    disturbed = _disturb(states, places, nudges)
    return _find_slopes(state_slopes(system, np.repeat(times, 2 * nudges.size), disturbed), nudges)


def _disturb(centres: Array, places: IntArray, nudges: Array) -> Array:
    """Return vectors (n, n_values) with the values at some places moved up and down, (2 n n_places, n_values)."""
    disturbed, rows = np.repeat(centres[:, None], 2 * nudges.size, axis=1), np.arange(nudges.size)
    disturbed[:, 2 * rows, places] += nudges
    disturbed[:, 2 * rows + 1, places] -= nudges
    return disturbed.reshape(-1, centres.shape[1])


def _find_slopes(values: Array, nudges: Array) -> Array:
    """Return the Jacobians (n, n_results, n_places) of a function by its values (2 n n_places, n_results) there."""
    pairs = values.reshape(-1, nudges.size, 2, values.shape[1])
    return np.asarray(((pairs[:, :, 0] - pairs[:, :, 1]) / (2 * nudges[:, None])).swapaxes(1, 2))


def scheme_growth_rates(
    method: ResumableIntegrator, system: System, points: Sequence[OperatingPoint], span: float
) -> Array:
    """Return the growth rates (n_points, n_values) of small vibrations in marches with a fixed step [1/s], descending.

    They are ``ln|μ|/τ`` for each eigenvalue μ of `scheme_tangents` over a span, rounded to whole major cycles [s].

    Raises
    ------
    StabilityError
        A march diverges within the span.
    """
    A, duration = scheme_tangents(method, system, points, span)
    finite = np.isfinite(A).all(axis=(1, 2))
    if not finite.all():  # a disturbed march diverged
        at = points[int(np.argmin(finite))]
        raise StabilityError(f"{method.name} diverges within {duration:.3g} s of t = {at.time:.3g} s")
    return map_growth_rates(A, duration)


def map_growth_rates(maps: Array, duration: float) -> Array:
    """Return ``ln|μ|/τ`` for each eigenvalue μ of maps over a duration τ [1/s], descending, a row each."""
    moduli = np.maximum(np.abs(np.linalg.eigvals(maps)), 1e-300)
    return np.asarray(np.sort(np.log(moduli))[:, ::-1] / duration)


def scheme_tangents(
    method: ResumableIntegrator, system: System, points: Sequence[OperatingPoint], span: float
) -> tuple[Array, float]:
    """Differentiate marches over some major cycles by the states at their start, (n_points, n_values, n_values).

    These are maps of disturbances of ``State.q``, ``State.v`` and ``State.a``; and of what a method has of the cycles
    before, forces that it carries on or mean rates (the companion form of a map with a history). With them comes the
    duration of the cycles [s]: ``span``, rounded to whole ones.
    """
    h, m, driven = method.step, method.substeps, _has_driven_loops(system)
    rest = _rest(system) if driven else (points[0].q, points[0].v)
    start, cycles = method.start(system, *rest), cycles_within(span, m * h)
    first = np.array([max(1, round(at.time / (m * h))) * m for at in points])
    # The first cycle has the loads of time 0; one more has those of the operating point.
    values = np.tile(start.values, (len(points), 1))
    if not driven:
        values = method.starts(system, np.array([at.values for at in points]))
    values = method.ends(system, start, values, np.zeros_like(first), 1)
    if driven:
        moved = zip(values, points, first.tolist(), strict=True)
        states = [_moved(system, start.with_values(own), at, (step - m) * h) for own, at, step in moved]
        values = np.array([state.values for state in states])
    centres = method.ends(system, start, values, first - m, 1)
    # Some methods keep two accelerations, some what is left of the cycles before.
    sizes = [start.q.size, start.v.size, start.a.size + method.history_size(start)]
    nudges = np.repeat([NUDGE, RATE_NUDGE, ACCELERATION_NUDGE], sizes)
    count, found = nudges.size, []
    at_once = max(1, VALUES_AT_ONCE // (2 * count * centres.shape[1]))
    for some in range(0, len(points), at_once):
        disturbed = _disturb(centres[some : some + at_once], np.arange(count), nudges)
        steps = np.repeat(first[some : some + at_once], 2 * count)
        ends = method.ends(system, start, disturbed, steps, cycles)
        found.append(_find_slopes(ends[:, :count], nudges))
    return np.concatenate(found), cycles * m * h


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
