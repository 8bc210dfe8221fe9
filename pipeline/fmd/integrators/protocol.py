"""Protocol of the integrators: they march a mechanism from a start and give its states at requested times."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import field, replace
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray, require_finite, require_shape, short_repr
from fmd.core.data_classes import dataclass
from fmd.core.limits.newton import BALANCING_PART
from fmd.core.limits.round_off import SUMMED
from fmd.core.limits.stability import DAMPED
from fmd.dynamics.controllers import HeldValues
from fmd.dynamics.system import (
    System,
    accelerations,
    advance,
    project,
    velocities,
)
from fmd.kernels.kernel import kernel
from fmd.kernels.table import aligned

Progress = Callable[[float], None]
"""Called with the part of the march that is done, 0…1."""


@dataclass(frozen=True)
class State:
    """State of a march, from which it continues bit for bit, from a pickled copy too."""

    step: int  # number of fast steps done
    q: Array  # (n,): coordinates at the present time
    v: Array  # (n,): rates; explicit methods keep them half a step behind ``q``
    a: Array  # (n,): accelerations of the last step
    time: float = 0.0  # present time [s]
    next_step: float = 0.0  # step that a method which chooses its steps would try next [s]
    # All else that a method needs to continue: generalised-α Newton's tangent, reversible sub-cycling mean rates of
    # its last cycles, adaptive methods the largest value so far of each group of coordinates.
    memory: Array = field(default_factory=lambda: np.zeros(0))

    def copy(self) -> State:
        """Return the same state in new arrays, for a march to write into."""
        q, v, a, memory = aligned(*(own.size for own in self.arrays))
        q[:], v[:], a[:], memory[:] = self.arrays
        return replace(self, q=q, v=v, a=a, memory=memory)

    @property
    def arrays(self) -> tuple[Array, Array, Array, Array]:
        """Coordinates, rates, accelerations and memory."""
        return self.q, self.v, self.a, self.memory

    @property
    def values(self) -> Array:
        """Entries of `arrays`, one after the other, in an array of their own."""
        return np.concatenate(self.arrays)

    def with_values(self, values: Array) -> State:
        """Return the same state with other `values`."""
        q, v, a, memory = np.split(values, np.cumsum([x.size for x in self.arrays[:-1]]))
        return replace(self, q=q, v=v, a=a, memory=memory)


@dataclass(frozen=True)
class Trajectory:
    """States of a mechanism at output times, and the work and run time that they took."""

    integrator: str  # the method's name
    step: float  # fast step [s]
    substeps: int  # fast steps to one slow step
    times: Array  # (n_times,): output times [s]
    q: Array  # (n_times, n_positions): positions at the output times
    v: Array  # (n_times, n): rates at the output times
    evaluations: int  # solutions of the whole system
    fast_evaluations: int  # solutions of the fast part alone
    seconds: float  # run time of the compiled march, the least if it was repeated
    end: State  # state after the last step
    # The method that an automatic choice ended with: it alone gives the same motion again.
    chosen: Integrator | None = None
    # Error that an automatic choice's last two marches tell, relative to the largest value of each kind of coordinate.
    error: float | None = None
    spread: float = 0.0  # how far the median of repeated marches' run times is above the least, relative to that
    held: HeldValues | None = None  # what sampled controllers have held
    # (n_times, n_values): values of the mechanism's contacts at the output times; none without contacts
    contacts: Array = field(default_factory=lambda: np.zeros((0, 0)))

    __repr__ = short_repr


class Integrator(ABC):
    """Method of time integration with its settings; most methods share the answers that stand here."""

    name: str
    step: float  # fast step [s]; 0 if the method chooses its steps
    substeps: int = 1  # fast steps to one slow step
    # True if it chooses another method as it marches, so that what it calls can't be compiled beforehand.
    chooses_method: bool = False
    # True if its steps are made of accelerations and of sums of what it has, so that tangents of a motion can be
    # marched beside it as more coordinates.
    marches_tangents: bool = False
    marches_touching_tangents: bool = False  # also of mechanisms with contacts
    dense_output: bool = False  # True if states within a step are as good as those at its ends
    takes_contacts: bool = False  # True if contacts remember what they have to in its steps

    @abstractmethod
    def order(self, system: System) -> int:
        """Declared order of convergence for a system."""

    @abstractmethod
    def largest_step(self, system: System) -> float:
        """Largest stable fast step for a system [s]; infinity if there is none."""

    @abstractmethod
    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from ``q0``, ``v0`` at time 0 to the last of ``times``, with output at each of them."""

    def suits(self, system: System) -> bool:
        """Tell whether the method integrates a system's kinds of coordinates."""
        return True

    def carries_tangent(self, system: System, others: Sequence[System]) -> bool:
        """Tell whether a tangent of a system's motion towards others can be marched beside it, exactly as steps go."""
        return self.marches_tangents and (self.marches_touching_tangents or not system.motion.n_contact_values)

    @property
    def differentiable(self) -> Integrator:
        """The method for a motion of which derivatives are taken with its steps as they are."""
        return self

    @property
    def refinement(self) -> str:
        """Advice of messages that makes a method's steps shorter."""
        return f"take a step below {self.step:.4g} s" if self.step else "take a smaller tolerance"

    def load_cycle(self, system: System) -> int:
        """Return the number of steps between two samples of the loads."""
        return 1

    def may_grow(self, system: Any) -> bool:
        """Tell whether vibrations may grow by the method though no step is too long."""
        return False

    def lost_phase(self, system: System, duration: float) -> float:
        """Return how much of the fastest vibration's phase round-off hides after a duration, if no step is too long."""
        return 0.0

    def fast_frequency(self, system: System) -> float:
        """Return the highest angular frequency that a fast step has to resolve [rad/s]."""
        return system.highest_frequency

    def describe_limit(self, system: Any) -> str:
        """Say which frequency limits the step, and what dampers take of that."""
        limit, m, omega = self.largest_step(system), self.substeps, self.fast_frequency(system)
        undamped, which = 2.0 / omega, "2/ω of its highest frequency"
        if m > 1 and system.largest_slow_step <= limit * m * (1.0 + SUMMED):
            omega, which = system.highest_slow_frequency, "2/(m ω) of its slow coordinates"
            undamped = 2.0 / (m * omega)
        text = f"{which}, {omega / (2 * np.pi):.5g} Hz"
        return text if undamped <= DAMPED * limit else f"{text}; without dampers it would be {undamped:.4g} s"

    @classmethod
    def ladders(cls, explicit: Sequence[float], coarse: Sequence[float]) -> Iterator[Sequence[Integrator]]:
        """Yield families of this method, coarse to fine, for a comparison of run time and error.

        Steps [s] are those that central difference is stable with, and longer ones up to the shortest of those.
        """
        yield from ()


class ResumableIntegrator(Integrator):
    """Integrator that continues from the end of a march: all of ours but the automatic choice and SciPy's."""

    start_evaluations = 1  # solutions of the whole system that its start takes

    @abstractmethod
    def start(self, system: System, q0: Array, v0: Array) -> State:
        """Return the state at time 0 from which a march continues."""

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 until the step or major cycle that holds the last of ``times`` is complete."""
        trajectory = self.resume(system, self.start(system, q0, v0), times, progress)
        return replace(trajectory, evaluations=trajectory.evaluations + self.start_evaluations)

    def memory_of_motion(self, state: State) -> Array:
        """Return what the method remembers of a motion beside positions, rates and accelerations."""
        return state.memory

    def history_size(self, state: State) -> int:
        """Return how many of the first values of a state's memory the next cycles follow smoothly; none by default."""
        return 0

    @abstractmethod
    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        The numbers are bit for bit those of one march without a break.
        """

    def starts(self, system: System, states: Array) -> Array:
        """Return the `State.values` at time 0 of many states of positions and rates, a row each."""
        pairs = (np.split(own, [system.n_positions]) for own in states)
        return np.array([self.start(system, q, v).values for q, v in pairs])

    def maps_slopes(self, system: System) -> bool:
        """Return true if how a disturbed state of a system changes in a step follows from `map_slopes`."""
        return False

    def map_slopes(self, slopes: Array) -> Array:
        """Return maps (n_points, n_values, n_values) of disturbed states over a step of linearised equations of motion.

        Slopes (n_points, 2 n, 2 n) are of the time derivatives of positions and rates, by both; states have
        accelerations, too.
        """
        raise NotImplementedError

    def ends(self, system: System, start: State, values: Array, first: IntArray, n_cycles: int) -> Array:
        """Return the `State.values` in which marches over ``n_cycles`` major cycles end, by a method with a fixed step.

        The start is as `start` gives it, or as a march of this method has ended; ``values`` (n_marches, n_values) are
        in the place of its own, a row for each march, whose first step has the number ``first`` (n_marches,).
        """
        found = np.empty(values.shape)
        for row, own, step in zip(found, values, first.tolist(), strict=True):
            last = np.array([(step + n_cycles * self.substeps - 1) * self.step])
            row[:] = self.resume(system, replace(start.with_values(own), step=step), last).end.values
        return found


def require_step(step: float) -> None:
    """Raise ``ValueError`` unless a step is a finite time above 0."""
    if not 0.0 < step < np.inf:
        raise ValueError(f"step is {step}, expected a time above 0")


def require_ratio(step: float, substeps: int) -> None:
    """Raise ``ValueError`` unless a fast step is a finite time above 0 and a slow step has at least one."""
    require_step(step)
    if substeps < 1:
        raise ValueError(f"substeps is {substeps}, expected at least 1")


def require_tolerance(tolerance: float) -> None:
    """Raise ``ValueError`` unless a relative tolerance is within the reach of double precision."""
    if not 3e-14 <= tolerance < 1.0:
        raise ValueError(f"tolerance is {tolerance}, expected 3e-14 … 1")


def require_times(times: Array) -> None:
    """Raise ``ValueError`` unless output times are finite, from 0 on and ascending."""
    if not (times.size and times[0] >= 0.0 and (np.diff(times) >= 0.0).all() and np.isfinite(times[-1])):
        raise ValueError("times must be finite, from 0 on, in ascending order, and one at least")


def require_start(method: Integrator, system: System, q0: Array, v0: Array) -> None:
    """Raise ``ValueError`` unless positions and rates at the start are finite and fit a system that a method takes."""
    if system.n_contact_values and not method.takes_contacts:
        raise ValueError(f"{method.name} takes no contacts; central-difference, generalized-alpha and runge-kutta do")
    require_shape("q0", q0, (system.n_positions,))
    require_shape("v0", v0, (system.n,))
    require_finite("q0", q0)
    require_finite("v0", v0)


def start_state(method: Integrator, system: System, q0: Array, v0: Array, lag: Array) -> State:
    """Return a method's state at time 0, its rates a time ``lag`` (n,) [s] before it, by the accelerations."""
    require_start(method, system, q0, v0)
    a = np.zeros(system.n)
    evaluate(system.parameters, 0.0, q0, v0, a)
    return State(0, q0.astype(float), v0 - lag * a, a)


@kernel
def evaluate(p: Any, t: float, q: Array, v: Array, a: Array) -> None:
    """Evaluate the accelerations of a mechanism into a."""
    accelerations(p, t, q, v, a)


def balanced_accelerations(system: System, start: State) -> Array:
    """Return sizes of the accelerations by positions that loads, or others of these, balance at the start, (n,).

    Where a motion starts at rest under large loads, its accelerations are but the round-off of these. Each position
    that isn't zero is changed by `BALANCING_PART` of itself; what accelerations change by, over that part, is summed.
    Joints count as deformations do: an angle by its spring, or by gravity, as far as it is turned from zero, and by
    next to nothing where forces don't depend on it. A quaternion's numbers are changed one by one and not made unit
    again. A loop's positions leave its constraints by as much; where that gives no finite acceleration, nothing counts.
    """
    q, moved, found = start.q.copy(), np.zeros(system.n), np.zeros(system.n)
    for k in np.flatnonzero(q):
        q[k] *= 1.0 + BALANCING_PART
        evaluate(system.parameters, 0.0, q, start.v, moved)
        found += np.abs(moved - start.a[: system.n]) / BALANCING_PART
        q[k] = start.q[k]
    return np.where(np.isfinite(found), found, 0.0)


def move_positions(p: Any, q: Array, change: Array) -> Array:
    """Return positions moved by a change (n,) in the order of rates; unit quaternions stay unit."""
    return np.asarray(moved_each(p, q, change[None])[0])


def moved_each(p: Any, q: Array, changes: Array) -> Array:
    """Return positions moved by each of many changes (n_changes, n), as `move_positions` moves them by one."""
    moved = np.tile(np.asarray(q, dtype=float), (len(changes), 1))
    _move(p, moved, np.ascontiguousarray(changes))
    return moved


@kernel
def _move(p: Any, moved: Array, changes: Array) -> None:
    for k in range(changes.shape[0]):
        advance(p, moved[k], changes[k], 1.0, 0, changes.shape[1])


@kernel
def evaluate_projection(p: Any, t: float, q: Array, v: Array) -> None:
    """Bring a state at a time t [s] back onto the constraints of loops."""
    project(p, t, q, v)


@kernel
def evaluate_velocities(p: Any, q: Array, v: Array, dq: Array) -> None:
    """Evaluate the time derivatives of a mechanism's position coordinates into dq."""
    velocities(p, q, v, dq)


@kernel
def evaluate_state(p: Any, y: Array, slope: Array, n_positions: int, t: float) -> None:
    """Evaluate the time derivatives of a mechanism's state, positions and then rates, into slope."""
    q, v = y[:n_positions], y[n_positions:]
    accelerations(p, t, q, v, slope[n_positions:])
    velocities(p, q, v, slope[:n_positions])
