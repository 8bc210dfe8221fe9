"""Rest of a mechanism under all loads at the start: joints, modes and loops in equilibrium."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np

from fmd.core.arrays import Array, BoolArray, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, InertiaError
from fmd.core.limits import newton as limits
from fmd.core.limits.round_off import EXACT
from fmd.core.newton import Tolerance, Trial, largest, solve
from fmd.dynamics.compiled_system.positive_mass import TOO_LIGHT
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.vibration import stiffness_over_mass
from fmd.integrators.protocol import evaluate, evaluate_projection, move_positions, moved_each
from fmd.stability.tangent import differentiate
from fmd.stages.assembly import free_directions

if TYPE_CHECKING:
    from fmd.dynamics.compiled_system.touching import TouchingSystem

_RESTING = Tolerance(limits.REST_CORRECTIONS, relative=limits.AT_REST, absolute=limits.AT_REST)


def find_equilibrium(system: CompiledSystem, q: Array) -> Array:
    """Find positions (n_positions,) at which nothing accelerates at rest, from positions that close all loops.

    Newton's method for the forces f at rest, with the tangent stiffness ``K = −∂f/∂q``. Where the start is stable, its
    forces are let go in steps, each as large as Newton's method can take while the stiffness stays positive: load
    steps. Where that fails, K is shifted by the mass matrix of the start until no motion has negative stiffness, so
    that every correction leads down from the potential energy (Nocedal & Wright, Numerical Optimization, section 3.4).
    So the rest is one that a slowly damped motion would come to. What touches is pressed by its own stiffness, which
    differences don't see: it sinks less than they move.

    Raises
    ------
    AccuracyError
        There is none: something keeps accelerating, the state found isn't stable, as of a buckled part, or round-off
        hides the inertia of massless combinations of modes.
    """
    turns, slides = _marker_turns(system.mechanism)
    forces, resting = _forces(system, q), _RESTING
    start = _Start(system, turns, slides, forces, _positive_mass(system, q))
    if system.mechanism.contacts:
        still = np.zeros(system.n)  # contacts may hold what acts all but at once
        size = max(largest(forces), largest(system.compiled.residual(0.0, q, still, still)))
        from fmd.stages.pressed_points import rounded_push  # a scene without contact loads none of it

        rounded = rounded_push(cast("TouchingSystem", system), q)
        resting = Tolerance(
            limits.REST_CORRECTIONS,
            residual=max(limits.PRESSED * size, rounded),
            stalled=max(limits.ROUNDED_PRESS * size, rounded),
        )
    found = None if system.mechanism.contacts else _follow_loads(start, q)
    if found is None:
        found = _settle(start, q, 0.0, resting, _shift)
    if found is not None:
        return found
    held = (
        "; friction holds a body where it begins, so one that would turn as it is set down has to begin on its "
        "feet, or without friction"
        if any(own.friction for body in system.mechanism.contacts for own in body.contacts)
        else ""
    )
    raise AccuracyError(
        f"no equilibrium after {_RESTING.corrections} corrections; something falls, turns or slides without end "
        f"under the loads of the start, or is about to buckle{held}"
    )


def rest_without_friction(system: CompiledSystem, q: Array) -> Array | None:
    """Return positions of equilibrium without friction, None without friction or where there are none.

    A body that begins aslant turns there as it is set down, until it lies; friction can hold it from then on.
    """
    contacts = system.mechanism.contacts
    if not any(own.friction for body in contacts for own in body.contacts):
        return None
    smooth = [
        replace(
            body,
            planes=tuple(replace(own, friction=0.0) for own in body.planes),
            pairs=tuple(replace(own, friction=0.0) for own in body.pairs),
        )
        for body in contacts
    ]
    with suppress(AccuracyError):
        return find_equilibrium(share_system(replace(system.mechanism, contacts=smooth)), q)
    return None


@dataclass(frozen=True)
class _Start:
    """A mechanism at the start: turns and slides (k, n), which of them slide (k,), forces at rest (n,), mass (n, n)."""

    system: CompiledSystem
    turns: Array
    slides: BoolArray
    forces: Array
    mass: Array


def _follow_loads(start: _Start, q: Array) -> Array | None:
    """Let go the forces at the start step by step; ``None`` where even short steps find no stable rest."""
    done, step = 0.0, 1.0
    while done < 1.0:
        target = min(1.0, done + step)
        found = _settle(start, q, 1.0 - target, replace(_RESTING, corrections=limits.LOAD_STEP_CORRECTIONS), _no_shift)
        if found is not None:
            q, done, step = found, target, 2 * step
        elif step > limits.SHORTEST_LOAD_STEP:
            step /= 2
        else:
            return None
    return q


def _settle(
    start: _Start, q: Array, balanced: float, tolerance: Tolerance, shift: Callable[[Array, Array], float | None]
) -> Array | None:
    """Find the rest where a part of the forces at the start is balanced; ``None`` if it isn't found."""
    system, kept = start.system, balanced * start.forces

    def residual(q: Array) -> Array:
        return _forces(system, q) - kept

    def correction(q: Array, left: Array) -> Array:
        free, M, K = _stiffness(start, q)
        shifted = shift(K, M)
        if shifted is None:
            raise np.linalg.LinAlgError("a motion has no stiffness")
        return np.asarray(free @ np.linalg.solve(K + shifted * M, free.T @ left))

    def move(q: Array, change: Array) -> Array:
        moved, rates = move_positions(system.parameters, q, change), np.zeros(system.n)
        evaluate_projection(system.parameters, 0.0, moved, rates)
        return moved

    reach = _Reach(start)
    found = solve(q, residual, correction, move, tolerance, shorten=reach.shorten, accepts=reach.accepts)
    if not found.converged:
        return None
    if not balanced:
        _, M, K = _stiffness(start, found.state)
        _require_stable(np.asarray(-np.linalg.solve(M, K)))
    return found.state


class _Reach:
    """How far a correction may go: turns up to 0.3 rad, slides twice as far each time that none is halved."""

    def __init__(self, start: _Start) -> None:
        self._start, self._slide = start, limits.FARTHEST

    def shorten(self, change: Array) -> Array:
        """Return a correction within reach."""
        moves = np.abs(self._start.turns @ change)
        farthest = largest(np.where(self._start.slides, moves * (limits.FARTHEST / self._slide), moves))
        self._slide = min(2.0 * self._slide, limits.LONGEST_SLIDE)
        return change * min(1.0, limits.FARTHEST / max(farthest, limits.SHORTEST_NORM))

    def accepts(self, trial: Trial) -> bool:
        """Return false where forces beyond a correction's end push back harder than they drove it."""
        if float(trial.after @ trial.change) >= -limits.OVERSHOT * float(trial.before @ trial.change):
            return True
        self._slide = limits.FARTHEST
        return trial.halvings == limits.MOST_HALVINGS - 1  # forces that jump: the shortest has to do


def _stiffness(start: _Start, q: Array) -> tuple[Array, Array, Array]:
    """Return a basis of the free directions, (n, k), and mass and tangent stiffness along them, (k, k)."""
    system = start.system
    free = free_directions(system, q) if system.mechanism.closures else np.eye(system.n)
    return free, free.T @ start.mass @ free, -free.T @ _slopes(system, q) @ free


def _positive_mass(system: CompiledSystem, q: Array) -> Array:
    """Return the mass matrix, which is positive definite."""
    mass = system.mass_matrix(q)
    try:
        np.linalg.cholesky(mass)
    except np.linalg.LinAlgError:
        raise InertiaError(f"the mass matrix of the start isn't positive definite: {TOO_LIGHT}") from None
    return mass


def _no_shift(K: Array, M: Array) -> float | None:
    """Return 0 for a stiffness that is positive in every motion, else ``None``."""
    return 0.0 if _shift(K, M) == 0.0 else None


def _forces(system: CompiledSystem, q: Array) -> Array:
    """Return the generalised forces at rest, those that keep loops closed among them, shape (n,)."""
    still = np.zeros(system.n)
    if not (system.mechanism.closures or system.mechanism.contacts):
        return -system.compiled.residual(0.0, q, still, still)
    a = np.zeros(system.n)
    evaluate(system.parameters, 0.0, q, still, a)
    if not np.isfinite(a).all():  # contact has no forces: too far, which no correction accepts
        return np.full(system.n, np.nan)
    return np.asarray(system.mass_matrix(q) @ a)


def _slopes(system: CompiledSystem, q: Array) -> Array:
    """Return the derivatives of the forces at rest by changes of the positions, shape (n, n)."""
    nudges, p = _nudges(system), system.parameters
    if system.mechanism.closures and not system.mechanism.contacts:
        return differentiate(lambda by: _forces(system, move_positions(p, q, by)), np.zeros(system.n), nudges)
    found = system.compiled.still_residuals(moved_each(p, q, np.concatenate([np.diag(nudges), np.diag(-nudges)])))
    slopes = ((found[system.n :] - found[: system.n]) / (2 * nudges[:, None])).T
    if not system.mechanism.contacts:
        return slopes
    from fmd.stages.pressed_points import pressed_stiffness  # a scene without contact loads none of it

    return np.asarray(slopes - pressed_stiffness(cast("TouchingSystem", system), q))


def _nudges(system: CompiledSystem) -> Array:
    """Return the changes by which forces are differentiated: small beside what turns a section by 1 rad."""
    nudges = np.full(system.n, limits.NUDGE)
    for k, link in enumerate(system.mechanism.links):
        turn = max((float(np.abs(at.rotation).max(initial=0.0)) for at in link.markers.values()), default=0.0)
        nudges[system.mechanism.modes_of(k)] = limits.NUDGE / max(turn, 1.0)
    return nudges


def _marker_turns(mechanism: Mechanism) -> tuple[Array, BoolArray]:
    """Return the rows that take a change of positions to joints' motions and markers' turns, and which are slides."""
    rows = np.eye(mechanism.n)
    found = []
    for k, link in enumerate(mechanism.links):
        modes = mechanism.modes_of(k)
        rows[modes] = 0.0
        for marker in link.markers.values():
            turns = np.zeros((3, mechanism.n))
            turns[:, modes] = marker.rotation
            found.append(turns)
    slides = np.zeros(mechanism.n + 3 * len(found), dtype=bool)
    slides[: mechanism.n] = mechanism.groups[1] % 3 == 1
    return np.concatenate([rows, *found]), slides


def _shift(K: Array, M: Array) -> float:
    """Return the factor of the mass matrix that, added to a stiffness, leaves no motion without or against it."""
    values = stiffness_over_mass(M, 0.5 * (K + K.T)) if len(K) else np.ones(1)
    least = max(limits.NO_STIFFNESS * largest(values), limits.LEAST_STIFFNESS)
    return 0.0 if values[0] > least else max(-limits.DOWNHILL * float(values[0]), least)


def _require_stable(slopes: Array) -> None:
    """Raise ``AccuracyError`` if a motion grows by itself from where nothing accelerates."""
    growing = np.linalg.eigvals(slopes)
    if growing.real.max(initial=0.0) > limits.UNSTABLE * largest(growing):
        raise AccuracyError(
            "the equilibrium isn't stable: from where nothing accelerates a motion grows by itself, as of a part that "
            "buckles or a body that stands on its head; start nearer to the stable one"
        )


_TOLERANCE = Tolerance(limits.STEADY_CORRECTIONS, relative=limits.LOOPS_STEADY, absolute=EXACT)


def find_closed_steady_state(
    system: CompiledSystem, q: Array, v: Array, groups: Sequence[IntArray]
) -> tuple[Array, Array]:
    """Find where loads and rotation leave the modes at rest, with rates at which the loops stay closed.

    Newton's method for the forces and the residuals that are left where the modes don't accelerate. Accelerations would
    hide them: massless combinations of modes take next to no force. It starts at positions q (n_positions,) and
    rates v (n,) that close the loops; of the groups of joints' rates that move to close them as bodies deform each is
    tried in turn.

    Raises
    ------
    AccuracyError
        There is no such state: something turns too fast for its stiffness.
    """
    for following in groups[:-1]:
        with suppress(AccuracyError, np.linalg.LinAlgError):
            return _find(system, q, v, following)
    return _find(system, q, v, groups[-1])


def _find(system: CompiledSystem, q: Array, v: Array, following: IntArray) -> tuple[Array, Array]:
    """Find the state with some joints that move."""
    mechanism, n = system.mechanism, system.n
    modes = np.concatenate([mechanism.modes_of(k) for k in range(len(mechanism.links))])
    if not len(modes):
        return q, _close_rates(system.compiled.constraint_rates(0.0, q), v, following)
    joints = np.setdiff1d(np.arange(n), modes)
    moving, k = np.concatenate([modes, following]), len(modes) + len(following)
    stiffness = np.concatenate([link.omega for link in mechanism.links]) ** 2
    softest = float(stiffness.min())
    forces_of = np.empty(n)  # what deflects a mode, or moves a joint about as much, by 1
    forces_of[modes] = stiffness
    forces_of[joints] = softest * system.mass_matrix(q).diagonal()[joints]
    pull = 1 / np.maximum(np.abs(system.compiled.constraint_rates(0.0, q)[0] / forces_of).max(axis=1), EXACT)

    State = tuple[Array, Array]  # positions; accelerations of joints and multipliers

    def residual(state: State) -> Array:
        """Return the forces, accelerations of residuals and residuals that are left."""
        (positions, others), a = state, np.zeros(n)
        J, rest_of_rates = system.compiled.constraint_rates(0.0, positions)
        rates = _close_rates((J, rest_of_rates), v, following)
        a[joints] = softest * others[: len(joints)]
        forces = system.compiled.residual(0.0, positions, rates, a) - J.T @ (pull * others[len(joints) :])
        parting = J @ a + _residual_accelerations(system, positions, rates)
        return np.concatenate(
            [forces / forces_of, parting / softest, system.compiled.residuals(0.0, positions, rates)[0]]
        )

    def move(state: State, by: Array) -> State:
        change = np.zeros(n)
        change[moving] = by[:k]
        return move_positions(system.parameters, state[0], change), state[1] + by[k:]

    def correction(state: State, left: Array) -> Array:
        none = np.zeros(k + len(state[1]))
        slopes = differentiate(lambda by: residual(move(state, by)), none, np.full(len(none), limits.NUDGE))
        return np.asarray(-np.linalg.lstsq(slopes, left, rcond=limits.LOOPS_DEPENDENT)[0])

    def reached(state: State) -> float:
        return largest(state[0][modes + mechanism.position_shift])

    start = q, np.zeros(len(joints) + len(pull))
    found = solve(start, residual, correction, move, _TOLERANCE, size=lambda change: largest(change[:k]), scale=reached)
    q = found.state[0]
    if found.converged and found.residual <= limits.LOOPS_AT_REST * reached(found.state) + limits.LOOPS_NO_FORCE:
        return q, _close_rates(system.compiled.constraint_rates(0.0, q), v, following)
    raise AccuracyError(
        f"no steady state: modes and joints still change by {found.size:.1e}, and forces of {found.residual:.1e} of "
        "what would deflect a mode by 1 are left; the scene turns too fast for the bodies' stiffness"
    )


def _close_rates(constraints: tuple[Array, Array], v: Array, following: IntArray) -> Array:
    """Return rates with which the loops stay closed, those of some joints changed."""
    J, rest = constraints
    out = v.copy()
    out[following] -= np.linalg.lstsq(J[:, following], J @ v + rest, rcond=limits.DEPENDENT_DIRECTION)[0]
    return out


def _residual_accelerations(system: CompiledSystem, q: Array, v: Array) -> Array:
    """Return the accelerations of the residuals where no coordinate accelerates, (n_rows,)."""
    h = limits.LOOPS_MOMENT / max(1.0, largest(v))

    def rates(s: float) -> Array:
        return system.compiled.residuals(s, move_positions(system.parameters, q, s * v), v)[1]

    return np.asarray((rates(h) - rates(-h)) / (2 * h))
