"""How fast a march makes small vibrations about a motion grow, beyond what they do in truth.

A scheme's tangent over some major cycles about a state of the motion holds everything that its kernels hold, treat late
or leave out: inertial coupling, centrifugal and Coriolis terms, dampers. Its eigenvalues μ grow by ``ln|μ|`` over that
span τ; those of the equations of motion, linearised about the same state, by ``Re λ τ``. With both sets in order, what
the scheme's k-th grows by beyond the k-th true one, or beyond nothing if that one decays, is the scheme's own; over the
states of a motion it adds up to e-folds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.core.errors import StabilityError
from pipeline.dynamics.system import System
from pipeline.integrators.protocol import Integrator, evaluate, evaluate_velocities

GROWN = 10.0  # a march that by itself makes small vibrations grow by more over its duration is called unstable
_SPAN = 1e-3  # of the duration: over so long a span the tangent's round-off tells for nothing
_SIZES = (1e-6, 1e-4, 1e-2)  # of what positions, rates and accelerations are disturbed by
_STEADY_STEPS = 20
_STEADY = 1e-8
_SCAN = 0.5 ** np.arange(6.0, -0.5, -0.5)
_SMALLEST = 1e-6
_SUMMIT = 0.5  # of the e-folds allowed: growth that has come so high and falls again with longer steps is not trusted


@dataclass(frozen=True)
class Instant:
    """A state of a motion.

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


def steadied(system: System, at: Instant, rates: IntArray) -> Instant:
    """The same with the scalar coordinates of some ``rates`` at rest where nothing accelerates them.

    Where there is no such state near by, they rest where they were.
    """
    found = steady_near(system, at, rates)
    if found is None:
        found = replace(at, v=at.v.copy())
        found.v[rates] = 0.0
    return found


def steady_near(system: System, at: Instant, rates: IntArray) -> Instant | None:
    """`steadied`, or nothing if there is no such state near by."""
    if not rates.size:
        return at
    parameters = system.parameters
    places = getattr(parameters, "scalar_position", np.arange(system.n))[rates]
    q, v = at.q.copy(), at.v.copy()
    v[rates] = 0.0

    def left(values: Array) -> Array:
        a = np.zeros(system.n)
        q[places] = values
        evaluate(parameters, at.time, q, v, a)
        return a[rates]

    found = q[places]
    for _ in range(_STEADY_STEPS):
        lack = left(found)
        slopes = [(left(found + d) - left(found - d)) / (2 * d.max()) for d in _SIZES[0] * np.eye(len(found))]
        change, *_ = np.linalg.lstsq(np.stack(slopes, axis=1), lack, rcond=None)
        found = found - change
        if np.linalg.norm(change) <= _STEADY * (1.0 + np.linalg.norm(found)):
            q[places] = found
            return replace(at, q=q, v=v)
    return None


def true_rates(system: System, at: Instant) -> Array:
    """Rates [1/s] at which small disturbances grow by the equations of motion linearised about a state, descending."""
    n_positions, n, parameters = system.n_positions, system.n, system.parameters

    def slope(u: Array) -> Array:
        q, v, dq, a = u[:n_positions].copy(), u[n_positions:].copy(), np.zeros(n_positions), np.zeros(n)
        evaluate_velocities(parameters, q, v, dq)
        evaluate(parameters, at.time, q, v, a)
        return np.concatenate([dq, a])

    J = _tangent(slope, np.concatenate([at.q, at.v]), np.repeat(_SIZES[:2], [n_positions, n]))
    return np.sort(np.linalg.eigvals(J).real)[::-1]


def march_rates(method: Integrator, system: System, at: Instant, span: float) -> Array:
    """Rates [1/s] at which small disturbances grow in a march from a state on, over cycles of ``span`` [s], descending.

    Raises
    ------
    StabilityError
        The march diverges within the span.
    """
    A, over = march_tangent(method, system, at, span)
    moduli = np.maximum(np.abs(np.linalg.eigvals(A)), 1e-300)
    return np.sort(np.log(moduli))[::-1] / over


def march_tangent(method: Integrator, system: System, at: Instant, span: float) -> tuple[Array, float]:
    """Map of disturbances of positions, rates and accelerations over about ``span`` [s], and what it is exactly."""
    h = method.step
    base = method.march(system, at.q, at.v, np.zeros(1)).end
    m = base.step
    cycles = _cycles(span, m * h)
    first = max(1, round(at.time / (m * h))) * m
    # The first cycle had the loads of time 0; one more has those of the instant.
    base = method.resume(system, replace(base, step=first - m), np.array([(first - 1) * h])).end
    parts, end = np.cumsum([base.q.size, base.v.size]), np.array([(first + cycles * m - 1) * h])

    def marched(values: Array) -> Array:
        q, v, a = np.split(values, parts)
        found = method.resume(system, replace(base, q=q, v=v, a=a), end).end
        return np.concatenate([found.q, found.v, found.a])

    rest = base.a.size - base.v.size  # some methods keep two accelerations
    sizes = np.repeat([*_SIZES, _SIZES[2]], [base.q.size, base.v.size, base.v.size, rest])
    return _tangent(marched, np.concatenate([base.q, base.v, base.a]), sizes), cycles * m * h


def _cycles(span: float, cycle: float) -> int:
    return max(1, round(span / cycle))


def _tangent(function: Callable[[Array], Array], centre: Array, sizes: Array) -> Array:
    """Derivatives of a function of vectors, by central differences of given sizes."""
    columns = [(function(centre + d) - function(centre - d)) / (2 * d.max()) for d in np.diag(sizes)]
    return np.stack(columns, axis=1)


@dataclass(frozen=True)
class Course:
    """A mechanism's motion by a few of its states.

    Attributes
    ----------
    system : System
        The mechanism.
    states : tuple of Instant
        In the middles of equal parts of the duration.
    duration : float
        [s]
    """

    system: System
    states: tuple[Instant, ...]
    duration: float

    @cached_property
    def true(self) -> Array:
        """Growth of disturbances in truth [1/s], descending for each state, shape (n_states, n_positions + n)."""
        return np.stack([true_rates(self.system, at) for at in self.states])

    def excess(self, method: Integrator) -> Array:
        """Growth by the scheme alone [1/s], of the same shape; infinite if the march diverges from a state."""
        rates = np.full(self.true.shape, np.inf)
        for row, true, at in zip(rates, self.true, self.states, strict=True):
            try:
                found = march_rates(method, self.system, at, _SPAN * self.duration)
            except StabilityError:
                return rates
            row[:] = found[: row.size] - np.maximum(true, 0.0)
        return rates

    def e_folds(self, method: Integrator) -> float:
        """E-folds of small vibrations over the duration that are the scheme's own; infinite if it diverges at once."""
        excess = self.excess(method)
        if not np.isfinite(excess).all():
            return np.inf
        # Two cycles come before those of the tangent: what is found belongs to a time that much later.
        cycle, part = getattr(method, "substeps", 1) * method.step, self.duration / len(self.states)
        late = min((1.5 + 0.5 * _cycles(_SPAN * self.duration, cycle)) * cycle, part)
        weights = np.full(len(self.states), part)
        weights[0] += late
        weights[-1] -= late
        return float((weights @ excess).max(initial=0.0))


def longest_safe_step(folds: Callable[[float], float], upper: float, bisections: int = 8) -> float:
    """Step [s] up to which small vibrations grow by no more than `GROWN`.

    Parameters
    ----------
    folds : callable
        E-folds with a step.
    upper : float
        Step that is not asked beyond [s].
    bisections : int
        Halvings of the place of the limit, at first known to a factor of √2.

    Returns
    -------
    float
        ``upper`` if nothing below it grows; 0 if everything down to a millionth of it does. Where growth falls again
        without having been too much, at `_SUMMIT` of that at least, the step at which it is largest.
    """
    allowed = np.log(GROWN)
    low = high = before = 0.0
    for share in _SCAN:
        found = folds(share * upper)
        if found > allowed:
            high = share * upper
            break
        if before > max(found, _SUMMIT * allowed):
            steps = np.geomspace(low * _SCAN[0] / _SCAN[1], share * upper, 9)[:-1]
            near = np.array([0.0, *(folds(step) for step in steps[1:])])
            beyond = np.flatnonzero(near > allowed)
            if not beyond.size:
                return float(steps[np.argmax(near)])
            low, high = float(steps[beyond[0] - 1]), float(steps[beyond[0]])
            break
        low, before = share * upper, found
    if not high:
        return upper
    while not low:
        lower = 0.25 * high
        if lower < _SMALLEST * upper:
            return 0.0
        if folds(lower) > allowed:
            high = lower
        else:
            low = lower
    for _ in range(bisections):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if folds(middle) <= allowed else (low, middle)
    return low
