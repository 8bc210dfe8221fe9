"""Generalised-α method of Chung & Hulbert, J Appl Mech 60 (1993), as by Arnold & Brüls, Multibody Syst Dyn 18 (2007).

The equations of motion hold at the end of each step; the auxiliary accelerations a follow
``(1 − α_m) a_{n+1} + α_m a_n = (1 − α_f) q̈_{n+1} + α_f q̈_n``. Positions move by
``h (v + h ((½ − β) a_n + β a_{n+1}))``, on a rotation in space along its own group (Brüls & Cardona, J Comput Nonlinear
Dyn 5, 2010). Newton's unknown is q̈_{n+1}.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import ConvergenceError, StabilityError
from fmd.core.limits.newton import LEAST_MOVED, LEAST_PRESSED
from fmd.dynamics.system import System, advance, remember_contacts
from fmd.integrators.fixed_step import FixedMarch, begin_cycle, end_cycle, runs_away, sample_within, take_steps
from fmd.integrators.march_tables import Samples
from fmd.integrators.newmark_steps import NewmarkSteps, find_end, move_to_end, split_contacts
from fmd.integrators.protocol import (
    Integrator,
    Progress,
    ResumableIntegrator,
    State,
    Trajectory,
    balanced_accelerations,
    require_step,
    start_state,
)
from fmd.integrators.work_bounds import round_down
from fmd.kernels.arrays import copy
from fmd.kernels.table import aligned


@dataclass(frozen=True)
class GeneralizedAlpha(ResumableIntegrator):
    """Generalised-α method with a constant step: implicit, of order 2."""

    step: float  # time step [s]
    # Spectral radius at infinite frequency, 0 (strongest damping of what the step can't resolve) … 1 (none).
    rho: float = 0.8

    name = "generalized-alpha"
    marches_tangents = True
    marches_touching_tangents = True
    takes_contacts = True

    def __post_init__(self) -> None:
        require_step(self.step)
        if not 0.0 <= self.rho <= 1.0:
            raise ValueError(f"rho is {self.rho}, expected 0 … 1")

    @cached_property
    def weights(self) -> Array:
        """Weights α_m, α_f, β and γ that make the method of second order for this ρ∞, shape (4,)."""
        return weights_of(self.rho)

    def order(self, system: System) -> int:
        """Return 2."""
        return 2

    def largest_step(self, system: System) -> float:
        """Return infinity: the method is stable for linear systems at any step."""
        return np.inf

    @classmethod
    def ladders(cls, explicit: Sequence[float], coarse: Sequence[float]) -> Iterator[Sequence[Integrator]]:
        """Yield the method with every step beyond the stable ones."""
        yield [cls(step) for step in coarse]

    def start(self, system: System, q0: Array, v0: Array) -> State:
        """Return the state at time 0 with both accelerations, and memory for a tangent."""
        start, own = start_state(self, system, q0, v0, np.zeros(system.n)), system.motion
        memory = np.zeros(own.n * own.n + 2 + 2 * system.n)
        alone = replace(start, q=start.q[: own.n_positions], v=start.v[: own.n], a=start.a[: own.n])
        memory[own.n * own.n + 1] = balanced_accelerations(own, alone).max(initial=0.0)
        return replace(start, a=np.concatenate([start.a, start.a]), memory=memory)  # equal accelerations at first

    def memory_of_motion(self, state: State) -> Array:
        """Return what contacts remember: a tangent of Newton's only helps to find what the rest determines."""
        n = state.v.size
        return state.memory[n * n + 2 + 2 * n :]

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        Raises
        ------
        ConvergenceError
            Newton's iteration did not converge; the message has the time and the step.
        """
        h, own, counts = self.step, system.motion.n, np.array([0.0, np.nan])
        own_memory = own * own + 2 + 2 * system.n
        contacts = np.full((times.size, system.n_contact_values), np.nan)
        try:
            p = system.parameters
            make = partial(self.steps, system, p, counts)
            march = FixedMarch(self.name, make, system, 0, h, own_memory=own_memory, parameters=p)
            end, q, v, seconds = march.run(start, times, progress, contacts)
        except StabilityError:
            if np.isnan(counts[1]):
                raise
            raise no_convergence(self.name, counts[1], h, 0.5 * h) from None
        return Trajectory(self.name, h, 1, times, q, v, int(counts[0]), 0, seconds, end, contacts=contacts)

    def steps(self, system: System, p: Any, counts: Array, state: State) -> NewmarkSteps:
        """Return the method's table for a state, into whose arrays it writes; ``counts`` (2,) are kept in it.

        Forces of contacts with losses have the weights of ρ∞ = 0. One that stops a mass of speed v within a step moves
        it by h²β(1 − α_f)/(1 − α_m) = h²/((1 + ρ)²(2 − ρ)) of its acceleration, and changes its speed by h of it in
        all: the mass leaves with up to ((1 + ρ)²(2 − ρ) − 1) v, no more than it came with by ρ∞ = 0, and 2.9 v by 0.8.
        Those without are as the march of their tangents has them.
        """
        n, own = system.n, system.motion.n
        tangent, marks, contact = np.split(state.memory[: own * own + 2 + 2 * n], [own * own, own * own + 2])
        by_contacts = weights_of(0.0 if system.motion.has_lossy_contacts else self.rho)
        ahead: Any = 0
        if system.motion is system:
            alpha_m, alpha_f, beta, gamma = by_contacts.tolist()
            part = self.step * (1.0 - alpha_f) / (1.0 - alpha_m)
            ahead = system.contacts_ahead(p, self.step, self.step * beta * part, gamma * part)
        begin: tuple[Any, ...] = (state.q, state.v, state.a, contact, tangent.reshape(own, own), marks, counts, ahead)
        newton = (*LEAST_PRESSED, 3) if system.motion.n_contact_values else (LEAST_MOVED, LEAST_MOVED, 2)
        numbers: tuple[Any, ...] = (self.step, *self.weights.tolist(), *by_contacts.tolist(), *newton)
        return NewmarkSteps(*numbers, *begin, *aligned(*[n] * 8, system.n_positions))


def weights_of(rho: float) -> Array:
    """Return the weights α_m, α_f, β and γ that make the method of second order for a ρ∞, shape (4,)."""
    alpha_m = (2 * rho - 1) / (rho + 1)
    alpha_f = rho / (rho + 1)
    return np.array([alpha_m, alpha_f, 0.25 * (1 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f])


def no_convergence(name: str, t: float, h: float, other: float) -> ConvergenceError:
    """Make the error of a method whose step h [s] at a time t [s] has no solution, with another one that may have."""
    return ConvergenceError(
        f"{name}: Newton's iteration did not converge at t = {t:.6g} s with a step of {h:.4g} s; "
        f"take a {'longer' if other > h else 'smaller'} step, such as {round_down(other):g} s"
    )


@begin_cycle.register(NewmarkSteps)
def _begin_cycle(m: NewmarkSteps, p: Any, frozen: Any, first: int, sampled: bool) -> None:
    if first == 0:
        remember_contacts(p, 0.0, m.q, m.v)
        split_contacts(m, p)


@take_steps.register(NewmarkSteps)
def _take_steps(m: NewmarkSteps, p: Any, frozen: Any, first: int, done: int, count: int, sampled: bool) -> int:
    """Find the step's end; the state moves there when the samples are taken."""
    if find_end(m, p, first * m.h + m.h):
        return 0 if runs_away(m.v_new) else 1
    m.counts[1] = first * m.h
    return 0


@sample_within.register(NewmarkSteps)
def _sample_within(m: NewmarkSteps, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    """Interpolate the state: cubic in time, along the mean rates."""
    n, x = v.size, s / m.h
    for i in range(n):
        change = m.new[i] + m.answer[i] - m.a[n + i]
        v[i] = m.v[i] + s * (m.a[n + i] + 0.5 * x * change)
        m.mean[i] = m.v[i] + s * (0.5 * m.a[n + i] + x * change / 6.0)
    copy(m.q, q)
    advance(p, q, m.mean, s, 0, n)


@end_cycle.register(NewmarkSteps)
def _end_cycle(m: NewmarkSteps, p: Any, frozen: Any, first: int, samples: Samples, first_sample: int) -> None:
    move_to_end(m, p, (first + 1) * m.h)
