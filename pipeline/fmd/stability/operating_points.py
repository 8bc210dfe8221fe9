"""Operating points of a motion, and the growth of small vibrations that a scheme adds along them.

Before anything is integrated, the motion is known by that of the mechanism with all bodies rigid. At some of its times
modes and fast joints rest where the loads leave them. About each of these states a scheme's k-th growth rate exceeds
the k-th one of the equations of motion, or zero if that one decays, by what is the scheme's own; over the duration
this excess adds up to e-folds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import StabilityError
from fmd.core.limits import newton as limits
from fmd.core.limits.stability import (
    FIRST_SPAN,
    NO_GROWTH,
    OPERATING_POINTS,
    RESOLVED_STEP,
    RIGID_STEPS,
    RIGID_TOLERANCE,
    SPAN,
)
from fmd.core.newton import Tolerance, solve
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.system import System
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.march_tables import state_slopes
from fmd.integrators.protocol import ResumableIntegrator, evaluate_projection
from fmd.integrators.runge_kutta import RungeKutta
from fmd.stability.tangent import (
    OperatingPoint,
    cycles_within,
    differentiate_states,
    map_growth_rates,
    scheme_growth_rates,
    slope_growth_rates,
    system_slopes,
)

_SETTLING = Tolerance(limits.SETTLING_CORRECTIONS, relative=limits.SETTLED, absolute=limits.SETTLED)


@dataclass(frozen=True)
class OperatingPoints:
    """States of a mechanism that stand for its motion over a duration."""

    system: System
    points: tuple[OperatingPoint, ...]  # in the middles of equal parts of the duration
    duration: float  # [s]

    @cached_property
    def slopes(self) -> Array:
        """Equations of motion linearised at the points, shape (n_points, n_positions + n, n_positions + n)."""
        return system_slopes(self.system, self.points)

    @cached_property
    def growth_rates(self) -> Array:
        """Growth rates by the equations of motion [1/s], descending, shape (n_points, n_positions + n)."""
        return slope_growth_rates(self.slopes)

    def excess_growth(self, method: ResumableIntegrator) -> Array:
        """Return the growth rates that are a scheme's own, (n_points, n_positions + n), beyond the equations' [1/s].

        Where nothing grows by the scheme, its rates are returned as they are: below zero, as the excess would be. They
        are infinite if a march from one of the points diverges at once.
        """
        shape = (len(self.points), self.system.n_positions + self.system.n)
        try:
            if method.maps_slopes(self.system):
                by_scheme = map_growth_rates(method.map_slopes(self.slopes), method.step)[:, : shape[1]]
            else:
                for span in (FIRST_SPAN * self.duration, SPAN * self.duration):
                    by_scheme = scheme_growth_rates(method, self.system, self.points, span)[:, : shape[1]]
                    if by_scheme.max(initial=0.0) * self.duration < NO_GROWTH:
                        break
        except StabilityError:
            return np.full(shape, np.inf)
        return by_scheme - np.maximum(self.growth_rates, 0.0) if by_scheme.max(initial=0.0) > 0.0 else by_scheme

    def worst(self, method: ResumableIntegrator) -> OperatingPoints:
        """Return the point alone at which vibrations grow the most by a scheme, as if it lasted all the time."""
        worst = int(self.excess_growth(method).max(axis=1).argmax())
        return replace(self, points=(self.points[worst],))

    def e_folds(self, method: ResumableIntegrator) -> float:
        """Return the e-folds by which a scheme alone makes vibrations grow over the duration; infinite if it diverges.

        Each point counts for the time that its major cycles were taken at: two cycles after the point where a scheme is
        marched from it.
        """
        if method not in self._known:
            self.keep(method, self.excess_growth(method))
        return self._known[method]

    @cached_property
    def _known(self) -> dict[ResumableIntegrator, float]:
        """E-folds by methods, as far as they have been found."""
        return {}

    def keep(self, method: ResumableIntegrator, excess: Array) -> None:
        """Keep the e-folds by a method for whoever asks for them, from its `excess_growth`."""
        self._known[method] = self._add_up(method, excess) if np.isfinite(excess).all() else np.inf

    def _add_up(self, method: ResumableIntegrator, excess: Array) -> float:
        cycle, part = method.substeps * method.step, self.duration / len(self.points)
        marched = not method.maps_slopes(self.system)
        late = min((1.5 + 0.5 * cycles_within(SPAN * self.duration, cycle)) * cycle, part) if marched else 0.0
        weights = np.full(len(self.points), part)
        weights[0] += late
        weights[-1] -= late
        return float((weights @ excess).max(initial=0.0))


def find_operating_points(
    system: CompiledSystem, mechanism: Mechanism, q0: Array, v0: Array, duration: float
) -> OperatingPoints:
    """Find operating points of a mechanism's motion from its start, by the motion with all bodies rigid.

    States are those of the system as it is marched, which may have another choice of slow coordinates than the
    mechanism that starts at q0 and v0; the duration is in s.

    Raises
    ------
    StabilityError
        The mechanism with all bodies rigid can't be integrated.
    """
    undeformed = find_undeformed_points(system, mechanism, q0, v0, duration)
    if system.mechanism.closures:
        return OperatingPoints(system, tuple(_close(system, at) for at in undeformed), duration)
    return OperatingPoints(system, settle(system, undeformed, resting_rates(system.mechanism)), duration)


def operating_times(duration: float) -> Array:
    """Return the middles of equal parts of a duration [s]."""
    return (np.arange(OPERATING_POINTS) + 0.5) * duration / OPERATING_POINTS


def find_undeformed_points(
    system: CompiledSystem, mechanism: Mechanism, q0: Array, v0: Array, duration: float
) -> list[OperatingPoint]:
    """Find the states of a mechanism's motion with all bodies rigid; parameters are as of `find_operating_points`."""
    times = operating_times(duration)
    q, v = _rigid_motion(mechanism.rigid, q0, v0, times, duration / RIGID_STEPS)
    return [*map(OperatingPoint, times.tolist(), *with_joints(system.mechanism, mechanism.rigid, q, v))]


def resting_rates(mechanism: Mechanism) -> IntArray:
    """Return which rates are at rest at operating points: those of modes and of fast joints."""
    modes = (mechanism.modes_of(k).tolist() for k in range(len(mechanism.links)))
    return np.array(sorted({*range(mechanism.n_slow, mechanism.n)}.union(*modes)), dtype=np.int64)


def _close(system: System, at: OperatingPoint) -> OperatingPoint:
    """Bring a state onto the constraints of loops; modes are left undeformed, for joints would have to follow them."""
    q, v = at.q.copy(), at.v.copy()
    evaluate_projection(system.parameters, at.time, q, v)
    return replace(at, q=q, v=v)


def settle(system: System, points: Sequence[OperatingPoint], rates: IntArray) -> tuple[OperatingPoint, ...]:
    """Bring the scalar coordinates of some ``rates`` to rest where nothing accelerates them, about each point.

    Where that has no solution near by, they rest where they are.
    """
    found = find_steady_points(system, points, rates)
    if found is None:  # about one point, or more
        found = [(find_steady_points(system, [at], rates) or [_stop(at, rates)])[0] for at in points]
    return tuple(found)


def _stop(at: OperatingPoint, rates: IntArray) -> OperatingPoint:
    v = at.v.copy()
    v[rates] = 0.0
    return replace(at, v=v)


def find_steady_points(
    system: System, points: Sequence[OperatingPoint], rates: IntArray
) -> Sequence[OperatingPoint] | None:
    """Find the states near by in which some ``rates`` are at rest and nothing accelerates them, by Newton's method.

    There are none if the corrections of one of the points do not converge.
    """
    if not rates.size:
        return points
    places = getattr(system.parameters, "position", np.arange(system.n))[rates]
    times = np.array([at.time for at in points])
    states, accelerated = np.array([at.values for at in points]), system.n_positions + rates
    states[:, accelerated] = 0.0

    def accelerations_at(values: Array) -> Array:
        states[:, places] = values
        return state_slopes(system, times, states)[:, accelerated]

    def correction(values: Array, left: Array) -> Array:
        states[:, places] = values
        slopes = differentiate_states(system, times, states, places, np.full(places.size, limits.NUDGE))
        return np.asarray(-(_inverses(slopes[:, accelerated]) @ left[:, :, None])[:, :, 0])

    def least(values: Array) -> float:
        return float(np.abs(values).max(axis=1).min())  # the largest size at the point where that is least

    found = solve(states[:, places], accelerations_at, correction, np.add, _SETTLING, scale=least)
    states[:, places] = found.state
    q, v, _ = np.split(states, [system.n_positions, system.n_positions + system.n], axis=1)
    return [OperatingPoint(p.time, q[k], v[k], p.numbers) for k, p in enumerate(points)] if found.converged else None


def _inverses(slopes: Array) -> Array:
    """Return the inverses of matrices (n_points, n, n), pseudoinverses if one of them is nearly singular."""
    try:
        found = np.linalg.inv(slopes)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(slopes))
    conditions = np.linalg.norm(slopes, 1, axis=(1, 2)) * np.linalg.norm(found, 1, axis=(1, 2))
    return np.asarray(found if conditions.max() < limits.WORST_CONDITION else np.linalg.pinv(slopes))


def _rigid_motion(rigid: Mechanism, q0: Array, v0: Array, times: Array, longest_step: float) -> tuple[Array, Array]:
    """Integrate a mechanism of rigid bodies from the joints' part of a start, (n_times, …) each.

    Fast joints start from rest: their own vibration would make the points depend on when they are taken.
    """
    if not rigid.n:
        return np.zeros((len(times), rigid.n_positions)), np.zeros((len(times), 0))
    system = share_system(rigid)
    step = min(longest_step, RESOLVED_STEP * system.largest_step)
    start = OperatingPoint(0.0, q0[: rigid.n_positions], v0[: rigid.n])
    (start,) = find_steady_points(system, [start], np.arange(rigid.n_slow, rigid.n)) or (start,)
    try:
        motion = CentralDifference(step).march(system, start.q, start.v, times)
    except StabilityError:
        if not system.piecewise_laws:
            raise
        motion = RungeKutta(RIGID_TOLERANCE).march(system, start.q, start.v, times)  # its steps pass no force unseen
    return motion.q, motion.v


def with_joints(mechanism: Mechanism, rigid: Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    """Return positions and rates, a row a state, of an undeformed mechanism whose joints are those of the rigid one."""
    positions, rates = np.tile(mechanism.rest_positions, (len(q), 1)), np.zeros((len(v), mechanism.n))
    for k, link in enumerate(mechanism.links):
        to, of = mechanism.layout.position[k], rigid.layout.position[k]
        positions[:, to : to + link.n_positions] = q[:, of : of + link.n_positions]
        to, of = mechanism.layout.rate[k], rigid.layout.rate[k]
        rates[:, to : to + link.n_rates] = v[:, of : of + link.n_rates]
    return positions, rates
