"""Rest of a mechanism under all loads at the start: joints, modes and loops in equilibrium."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, InertiaError
from fmd.core.limits import newton as limits
from fmd.core.newton import Tolerance, Trial, largest, solve
from fmd.dynamics.compiled_system.positive_mass import TOO_LIGHT
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.bounds import Bools
from fmd.integrators.protocol import evaluate, evaluate_projection, move_positions
from fmd.stability.tangent import differentiate
from fmd.stages.assembly import free_directions

_RESTING = Tolerance(limits.REST_CORRECTIONS, relative=limits.AT_REST, absolute=limits.AT_REST)
_LOAD_STEP = replace(_RESTING, corrections=limits.LOAD_STEP_CORRECTIONS)


def find_equilibrium(system: CompiledSystem, q: Array, t: float = 0.0) -> Array:
    """Find positions (n_positions,) at which nothing accelerates at rest, from positions that close all loops.

    Newton's method for the forces f at rest, with the tangent stiffness ``K = −∂f/∂q``. Where the start is stable, its
    forces are let go in steps, each as large as Newton's method can take while the stiffness stays positive: load
    steps. Where that fails, K is shifted by the mass matrix of the start until no motion has negative stiffness, so
    that every correction leads down from the potential energy (Nocedal & Wright, Numerical Optimization, section 3.4).
    So the rest is one that a slowly damped motion would come to.

    Raises
    ------
    AccuracyError
        There is none: something keeps accelerating, the state found isn't stable, as of a buckled part, or round-off
        hides the inertia of light combinations of modes.
    """
    turns, slides = _marker_turns(system.mechanism)
    start = _Start(system, t, turns, slides, _forces(system, q, t), _positive_mass(system, q, t))
    found = _follow_loads(start, q)
    if found is None:
        found = _settle(start, q, 0.0, _RESTING, _shift)
    if found is not None:
        return found
    raise AccuracyError(
        f"no equilibrium after {_RESTING.corrections} corrections; something falls, turns or slides without end "
        "under the loads of the start, or is about to buckle"
    )


@dataclass(frozen=True)
class _Start:
    """A mechanism at the start: turns and slides (k, n), which of them slide (k,), forces at rest (n,), mass (n, n)."""

    system: CompiledSystem
    time: float
    turns: Array
    slides: Bools
    forces: Array
    mass: Array


def _follow_loads(start: _Start, q: Array) -> Array | None:
    """Let go the forces at the start step by step; ``None`` where even short steps find no stable rest."""
    done, step = 0.0, 1.0
    while done < 1.0:
        target = min(1.0, done + step)
        found = _settle(start, q, 1.0 - target, _LOAD_STEP, _no_shift)
        if found is not None:
            q, done, step = found, target, 2 * step
        elif step > limits.SHORTEST_LOAD_STEP:
            step /= 2
        else:
            return None
    return q


def _settle(
    start: _Start, q: Array, held: float, tolerance: Tolerance, shift: Callable[[Array, Array], float | None]
) -> Array | None:
    """Find the rest where a part of the forces at the start is held; ``None`` if it isn't found."""
    system, t, holding = start.system, start.time, held * start.forces

    def residual(q: Array) -> Array:
        return _forces(system, q, t) - holding

    def correction(q: Array, left: Array) -> Array:
        free, M, K = _stiffness(start, q)
        shifted = shift(K, M)
        if shifted is None:
            raise np.linalg.LinAlgError("a motion has no stiffness")
        return np.asarray(free @ np.linalg.solve(K + shifted * M, free.T @ left))

    def move(q: Array, change: Array) -> Array:
        moved, rates = move_positions(system.parameters, q, change), np.zeros(system.n)
        evaluate_projection(system.parameters, t, moved, rates)
        return moved

    reach = _Reach(start)
    found = solve(q, residual, correction, move, tolerance, shorten=reach.shorten, accepts=reach.accepts)
    if not found.converged:
        return None
    if not held:
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
    return free, free.T @ start.mass @ free, -free.T @ _slopes(system, q, start.time) @ free


def _mass(system: CompiledSystem, q: Array, t: float) -> Array:
    return system.compiled.mass_matrix(system.compiled.signal_values(t), q)


def _positive_mass(system: CompiledSystem, q: Array, t: float) -> Array:
    """Return the mass matrix, which is positive definite."""
    mass = _mass(system, q, t)
    try:
        np.linalg.cholesky(mass)
    except np.linalg.LinAlgError:
        raise InertiaError(f"the mass matrix of the start isn't positive definite: {TOO_LIGHT}") from None
    return mass


def _no_shift(K: Array, M: Array) -> float | None:
    """Return 0 for a stiffness that is positive in every motion, else ``None``."""
    return 0.0 if _shift(K, M) == 0.0 else None


def _forces(system: CompiledSystem, q: Array, t: float) -> Array:
    """Return the generalised forces at rest, those that keep loops closed among them, shape (n,)."""
    still = np.zeros(system.n)
    if not system.mechanism.closures:
        return -system.compiled.residual(t, q, still, still)
    a = np.zeros(system.n)
    evaluate(system.parameters, t, q, still, a)
    return np.asarray(_mass(system, q, t) @ a)


def _slopes(system: CompiledSystem, q: Array, t: float) -> Array:
    """Return the derivatives of the forces at rest by changes of the positions, shape (n, n)."""

    def forces(change: Array) -> Array:
        return _forces(system, move_positions(system.parameters, q, change), t)

    return differentiate(forces, np.zeros(system.n), _nudges(system))


def _nudges(system: CompiledSystem) -> Array:
    """Return the changes by which forces are differentiated: small beside what turns a section by 1 rad."""
    nudges = np.full(system.n, limits.NUDGE)
    for k, link in enumerate(system.mechanism.links):
        turn = max((float(np.abs(at.rotation).max(initial=0.0)) for at in link.markers.values()), default=0.0)
        nudges[system.mechanism.modes_of(k)] = limits.NUDGE / max(turn, 1.0)
    return nudges


def _marker_turns(mechanism: Mechanism) -> tuple[Array, Bools]:
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
    from scipy.linalg import eigh

    values = eigh(0.5 * (K + K.T), M, eigvals_only=True) if len(K) else np.ones(1)
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
