"""What every integrator takes and gives."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from pipeline.core.arrays import Array, require_finite, require_shape
from pipeline.core.errors import StabilityError
from pipeline.dynamics.jit.compiled import aligned, inner, kernel
from pipeline.dynamics.system import System, accelerations, velocities

Progress = Callable[[float], None]
"""Called with the part of the march that is done, 0…1."""

# A rate beyond this is taken as divergence: no mechanism in SI units comes near it.
_RUNAWAY = 1e30
_FIRST_CHUNK = 1024  # steps: short marches are one call
_CHUNK_SECONDS = 0.2


@dataclass(frozen=True)
class State:
    """Where a march stands; a march that starts from it continues bit for bit, from a pickled copy too.

    Attributes
    ----------
    step : int
        Number of fast steps done.
    q : ndarray, shape (n,)
        Coordinates at the present time.
    v : ndarray, shape (n,)
        Rates; explicit methods keep them half a step behind ``q``.
    a : ndarray, shape (n,)
        Accelerations of the last step.
    time, next_step : float
        Where it stands, and the step that a method which chooses its steps would try next [s].
    memory : ndarray
        What else a method needs to go on as if it had not stopped: generalised-α Newton's tangent, adaptive methods the
        largest value so far of each group of coordinates.
    inner : dict, optional
        The same of SciPy's solvers, by the names of their attributes.
    """

    step: int
    q: Array
    v: Array
    a: Array
    time: float = 0.0
    next_step: float = 0.0
    memory: Array = field(default_factory=lambda: np.zeros(0))
    inner: dict[str, Any] | None = None

    def copied(self) -> State:
        """Itself with arrays of its own, for a march to write into."""
        q, v, a = aligned(self.q.size, self.v.size, self.a.size)
        q[:], v[:], a[:] = self.q, self.v, self.a
        return replace(self, q=q, v=v, a=a, memory=self.memory.copy())


@dataclass(frozen=True)
class Trajectory:
    """What a march gives.

    Attributes
    ----------
    integrator : str
        The method's name.
    step : float
        Fast step [s].
    substeps : int
        Fast steps to one slow step.
    times : ndarray, shape (n_times,)
        Output times [s].
    q, v : ndarray, shape (n_times, n)
        Coordinates and rates at the output times.
    evaluations, fast_evaluations : int
        Solutions of the whole system and of the fast part alone.
    seconds : float
        Run time of the compiled march.
    end : State
        Where it stopped.
    """

    integrator: str
    step: float
    substeps: int
    times: Array
    q: Array
    v: Array
    evaluations: int
    fast_evaluations: int
    seconds: float
    end: State


class Integrator(Protocol):
    """A method with its settings."""

    @property
    def name(self) -> str:
        """Its name in a scene."""

    @property
    def step(self) -> float:
        """Fast step [s]; 0 if the method chooses its steps."""

    def order(self, system: System) -> int:
        """Declared order of convergence for a system."""

    def largest_step(self, system: System) -> float:
        """Largest stable fast step for a system [s]; infinity if there is none."""

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from ``q0``, ``v0`` at time 0 to the last of ``times``, with output at each of them."""

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        The numbers are bit for bit those of one march without a break.
        """


def march_from(
    method: Integrator,
    system: System,
    start: State,
    times: Array,
    progress: Progress | None,
    evaluations: int = 1,
) -> Trajectory:
    """Resume from a start state and count the evaluations that it took to make it, too."""
    trajectory = method.resume(system, start, times, progress)
    return replace(trajectory, evaluations=trajectory.evaluations + evaluations)


def march_in_chunks(
    run: Callable[..., int],
    start: State,
    step: float,
    stride: int,
    times: Array,
    progress: Progress | None,
) -> tuple[State, Array, Array, float]:
    """Call a compiled march repeatedly until it has passed the last output time.

    Chunks only let progress be shown and a runaway be seen early; the steps don't depend on them, nor on ``times``.

    Parameters
    ----------
    run : callable
        ``run(state, n_steps, sample_step, sample_offset, sample_q, sample_v, cursor) -> steps done``; it writes
        into the state's arrays.
    step : float
        Fast step [s].
    stride : int
        Fast steps that must stay together.

    Raises
    ------
    StabilityError
        A rate ran away; the message gives the time and the coordinate that moves fastest then.
    """
    require_times(times)
    state = start.copied()
    sample_step = np.floor(times / step * (1 + 1e-14) + 1e-9).astype(np.int64)
    sample_offset = np.maximum(times - sample_step * step, 0.0)
    sample_offset[sample_offset < 1e-9 * step] = 0.0
    q, v = np.full((times.size, start.q.size), np.nan), np.full((times.size, start.v.size), np.nan)
    cursor = np.array([np.searchsorted(sample_step, state.step)])
    last = -(-(int(sample_step[-1]) + 1 - state.step) // stride) * stride + state.step
    seconds, chunk = 0.0, stride * max(1, _FIRST_CHUNK // stride)
    while state.step < last:
        wanted = min(chunk, last - state.step)
        tick = time.perf_counter()
        done = run(state, wanted, sample_step, sample_offset, q, v, cursor)
        spent = time.perf_counter() - tick
        seconds += spent
        state = replace(state, step=state.step + done, time=(state.step + done) * step)
        if done < wanted or not np.isfinite(state.q).all():
            culprit = int(np.argmax(np.where(np.isfinite(state.v), np.abs(state.v), np.inf)))
            raise StabilityError(
                f"the march diverged at t = {state.step * step:.6g} s, most in coordinate {culprit} "
                f"(rate {state.v[culprit]:.3g}); take a smaller step"
            )
        chunk = stride * max(64, min(4 * chunk // stride, int(chunk // stride * _CHUNK_SECONDS / max(spent, 1e-9))))
        if progress:
            progress(state.step / last)
    return state, q, v, seconds


def require_step(step: float) -> None:
    """Raise ``ValueError`` unless a step is a finite time above 0."""
    if not 0.0 < step < np.inf:
        raise ValueError(f"step is {step}, expected a time above 0")


def require_ratio(step: float, substeps: int) -> None:
    """Raise ``ValueError`` unless a fast step is a finite time above 0 and there is one in a slow step at least."""
    require_step(step)
    if substeps < 1:
        raise ValueError(f"substeps is {substeps}, expected at least 1")


def require_tolerance(tolerance: float) -> None:
    """Raise ``ValueError`` unless a relative tolerance is one that double precision can keep."""
    if not 3e-14 <= tolerance < 1.0:
        raise ValueError(f"tolerance is {tolerance}, expected 3e-14 … 1")


def require_times(times: Array) -> None:
    """Raise ``ValueError`` unless output times are finite, from 0 on and ascending."""
    if not (times.size and times[0] >= 0.0 and (np.diff(times) >= 0.0).all() and np.isfinite(times[-1])):
        raise ValueError("times must be finite, from 0 on, in ascending order, and one at least")


def require_start(system: System, q0: Array, v0: Array) -> None:
    """Raise unless positions and rates at the start fit the system and are finite."""
    require_shape("q0", q0, (system.n_positions,))
    require_shape("v0", v0, (system.n,))
    require_finite("q0", q0)
    require_finite("v0", v0)


def start_state(system: System, q0: Array, v0: Array, lag: Array) -> State:
    """State at time 0 with the rates moved back by half of each coordinate's step, ``lag`` (n,) [s]."""
    require_start(system, q0, v0)
    a = np.zeros(system.n)
    evaluate(system.parameters, 0.0, q0, v0, a)
    return State(0, q0.astype(float), v0 - lag * a, a)


@kernel
def evaluate(p: Any, t: float, q: Array, v: Array, a: Array) -> None:
    """Call `accelerations` from Python."""
    accelerations(p, t, q, v, a)


@kernel
def evaluate_velocities(p: Any, q: Array, v: Array, dq: Array) -> None:
    """Call `velocities` from Python."""
    velocities(p, q, v, dq)


@inner
def runs_away(v: Array) -> bool:
    """Whether any rate is beyond reason or not a number."""
    total = 0.0
    for i in range(v.size):
        total += abs(v[i])
    return not total < _RUNAWAY
