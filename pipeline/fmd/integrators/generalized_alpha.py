"""Generalised-α method of Chung & Hulbert, J Appl Mech 60 (1993), as by Arnold & Brüls, Multibody Syst Dyn 18 (2007).

The equations of motion hold at the end of each step; the auxiliary accelerations a follow
``(1 − α_m) a_{n+1} + α_m a_n = (1 − α_f) q̈_{n+1} + α_f q̈_n``. Positions move by
``h (v + h ((½ − β) a_n + β a_{n+1}))``, on a rotation in space along its own group (Brüls & Cardona, J Comput Nonlinear
Dyn 5, 2010). Newton's unknown is q̈_{n+1}; its tangent comes from differences of the accelerations and is kept while it
converges fast.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import ConvergenceError, StabilityError
from fmd.core.limits.newton import (
    CONVERGED,
    DAMPED_ITERATIONS,
    LEAST_MOVED,
    LEAST_PRESSED,
    MOST_HALVED,
    OF_GUESS,
    POSITION_ROUND_OFF,
    STALLED,
    STEP_ITERATIONS,
    VANISHED,
)
from fmd.core.newton import settles
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import System, accelerations, advance, project, remember_contacts
from fmd.integrators.fixed_step import FixedMarch, begin_cycle, end_cycle, runs_away, sample_within, take_steps
from fmd.integrators.march_tables import Samples
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
from fmd.kernels.kernel import inlined, inner
from fmd.kernels.table import Table, aligned

_settles = inlined(settles)


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
        alpha_m = (2 * self.rho - 1) / (self.rho + 1)
        alpha_f = self.rho / (self.rho + 1)
        return np.array([alpha_m, alpha_f, 0.25 * (1 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f])

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
        memory = np.zeros(own.n * own.n + 2)
        alone = replace(start, q=start.q[: own.n_positions], v=start.v[: own.n], a=start.a[: own.n])
        memory[-1] = balanced_accelerations(own, alone).max(initial=0.0)
        return replace(start, a=np.concatenate([start.a, start.a]), memory=memory)  # equal accelerations at first

    def memory_of_motion(self, state: State) -> Array:
        """Return what contacts remember: a tangent of Newton's only helps to find what the rest determines."""
        n = state.v.size
        return state.memory[n * n + 2 :]

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        Raises
        ------
        ConvergenceError
            Newton's iteration did not converge; the message has the time and the step.
        """
        h, own, counts = self.step, system.motion.n, np.array([0.0, np.nan])
        contacts = np.full((times.size, system.n_contact_values), np.nan)
        try:
            make = partial(self.steps, system, counts)
            march = FixedMarch(self.name, make, system, 0, h, own_memory=own * own + 2)
            end, q, v, seconds = march.run(start, times, progress, contacts)
        except StabilityError:
            if np.isnan(counts[1]):
                raise
            raise no_convergence(self.name, counts[1], h) from None
        return Trajectory(self.name, h, 1, times, q, v, int(counts[0]), 0, seconds, end, contacts=contacts)

    def steps(self, system: System, counts: Array, state: State) -> NewmarkSteps:
        """Return the method's table for a state, into whose arrays it writes; ``counts`` (2,) are kept in it."""
        n, own = system.n, system.motion.n
        tangent, marks = state.memory[: own * own].reshape(own, own), state.memory[own * own : own * own + 2]
        alpha_m, alpha_f, beta, gamma = self.weights.tolist()
        begin = (state.q, state.v, state.a, tangent, marks, counts)
        nudges = LEAST_PRESSED if system.motion.n_contact_values else (LEAST_MOVED, LEAST_MOVED)
        return NewmarkSteps(
            self.step, alpha_m, alpha_f, beta, gamma, *nudges, *begin, *aligned(n, n, n, n, n, n, system.n_positions)
        )


def no_convergence(name: str, t: float, h: float) -> ConvergenceError:
    """Make the error of a method whose step h [s] at a time t [s] has no solution, with a step that may have one."""
    return ConvergenceError(
        f"{name}: Newton's iteration did not converge at t = {t:.6g} s with a step of {h:.4g} s; "
        f"take a smaller step, such as {round_down(0.5 * h):g} s"
    )


@dataclass(frozen=True)
class NewmarkSteps(Table):
    """State of a march by the generalised-α method, and room for Newton's iteration."""

    h: float  # [s]
    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    nudge: float  # least move of positions, by which tangents are differences [rad or m]
    finest: float  # the same where one of these hasn't helped
    q: Array
    v: Array
    a: Array  # (2 n,): auxiliary and true accelerations
    tangent: Array  # (n_own, n_own): factors of Newton's tangent, of the motion alone
    marks: Array  # (2,): 1 while the tangent is valid, and the largest acceleration so far
    counts: Array  # (2,): evaluations, and the time at which Newton's iteration failed, or NaN [s]
    new: Array  # (n,): trial accelerations, those that the equations of motion give for them, and room for the tangent
    found: Array
    shifted: Array
    base: Array
    v_new: Array  # rates at the step's end, and those that move the positions there
    mean: Array
    q_new: Array  # positions at the step's end


@inner
def factor_tangent(A: Array) -> None:
    """Factor a matrix into L and U in place, without pivoting: a tangent is the unit matrix and a step's change."""
    n = A.shape[0]
    for k in range(n):
        for i in range(k + 1, n):
            A[i, k] /= A[k, k]
            for j in range(k + 1, n):
                A[i, j] -= A[i, k] * A[k, j]


@inner
def _solve(A: Array, x: Array) -> None:
    """Solve for the motion's entries of x, then for those of its tangents, which are the last ones, in lanes."""
    solve_part(A, x, 0, 1)
    if x.size > A.shape[0]:
        for lane in range(LANES):
            solve_part(A, x, x.size - LANES * A.shape[0] + lane, LANES)


@inner
def solve_part(A: Array, x: Array, first: int, apart: int) -> None:
    """Solve for entries of x from the first on that are so far apart, with factors of a matrix, in place."""
    n = A.shape[0]
    for i in range(n):
        for j in range(i):
            x[first + apart * i] -= A[i, j] * x[first + apart * j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[first + apart * i] -= A[i, j] * x[first + apart * j]
        x[first + apart * i] /= A[i, i]


@inner
def _evaluate_end(m: NewmarkSteps, p: Any, end: float, found: Array) -> None:
    """Evaluate the accelerations at a step's ``end`` [s] for the trial ones."""
    n = m.v.size
    for i in range(n):
        ahead = ((1.0 - m.alpha_f) * m.new[i] + m.alpha_f * m.a[n + i] - m.alpha_m * m.a[i]) / (1.0 - m.alpha_m)
        m.mean[i] = m.v[i] + m.h * ((0.5 - m.beta) * m.a[i] + m.beta * ahead)
        m.v_new[i] = m.v[i] + m.h * ((1.0 - m.gamma) * m.a[i] + m.gamma * ahead)
    for i in range(m.q.size):
        m.q_new[i] = m.q[i]
    advance(p, m.q_new, m.mean, m.h, 0, n)
    accelerations(p, end, m.q_new, m.v_new, found)
    m.counts[0] += 1


@inner
def _find_end(m: NewmarkSteps, p: Any, end: float) -> bool:
    """Find the accelerations at a step's ``end`` [s] by Newton's method; false if it does not converge."""
    n = m.v.size
    for trial in range(3):  # a loop, since calls with constants would be compiled each
        if trial == 1 and m.finest == m.nudge:
            continue
        for i in range(n):
            m.new[i] = m.a[n + i]
            if trial == 2:
                # The last accelerations, frozen over a long step, carry a stiff coordinate far out to where no tangent
                # is of use.
                ahead = -(m.v[i] / m.h + (0.5 - m.beta) * m.a[i]) / m.beta  # so that positions stay
                ahead = (1.0 - m.alpha_m) * ahead + m.alpha_m * m.a[i]
                m.new[i] = (ahead - m.alpha_f * m.a[n + i]) / (1.0 - m.alpha_f)
        if _converges(m, p, end, trial):
            return m.tangent.shape[0] == n or _carry_tangents(m, p, end)
        m.marks[0] = 0.0
    return False


@inner
def _renew_tangent(m: NewmarkSteps, p: Any, end: float, least: float) -> None:
    """Factor the tangent at the trial accelerations, by differences over the least move of positions [rad or m].

    ``found`` are the accelerations there.
    """
    n, size = m.tangent.shape[0], VANISHED
    to_position = m.h * m.h * m.beta * (1.0 - m.alpha_f) / (1.0 - m.alpha_m)
    for i in range(m.v.size):
        m.base[i] = m.found[i]
    for i in range(n):
        size = max(size, abs(m.found[i]), abs(m.new[i]), abs(m.a[i]), OF_GUESS * abs(m.a[m.v.size + i]))
    for j in range(n):
        keep = m.new[j]
        nudge = max(1e-6 * (abs(keep) + 1e-3 * max(size, m.marks[1])), least / to_position)
        m.new[j] = keep + nudge
        _evaluate_end(m, p, end, m.shifted)
        m.new[j] = keep
        for i in range(n):
            m.tangent[i, j] = (1.0 if i == j else 0.0) - (m.shifted[i] - m.base[i]) / nudge
    factor_tangent(m.tangent)
    m.marks[0] = 1.0
    for i in range(m.v.size):
        m.found[i] = m.base[i]


@inner
def _converges(m: NewmarkSteps, p: Any, end: float, trial: int) -> bool:
    """Iterate from the trial accelerations until they converge: at first only while corrections shrink.

    In the second trial corrections are shortened, each with a new tangent: whole ones go to and fro across states of
    points that begin to slip or part.
    Forces that balance leave an acceleration with their own round-off: a correction that no longer shrinks, or shrinks
    to the last, is good enough if it is small beside the largest one so far, or moves positions by their round-off.
    Beside a singular position of a loop it moves them by more, though the equations hold, and with a new tangent, too.
    """
    n, largest_before, peak = m.tangent.shape[0], math.inf, m.marks[1]
    to_position = m.h * m.h * m.beta * (1.0 - m.alpha_f) / (1.0 - m.alpha_m)
    damped = trial == 1
    iterations = DAMPED_ITERATIONS if damped else STEP_ITERATIONS
    for iteration in range(iterations):
        _evaluate_end(m, p, end, m.found)
        size, largest, reached = VANISHED, 0.0, 1.0
        if damped or m.marks[0] == 0.0 or (iteration > 0 and iteration % 4 == 0):
            _renew_tangent(m, p, end, m.nudge if trial == 0 else m.finest)
        left = 0.0
        for i in range(n):
            left = max(left, abs(m.found[i] - m.new[i]))
        _correct(m)
        for i in range(n):
            if not (abs(m.found[i]) <= largest or math.isnan(largest)):  # keeps a NaN, which max would lose
                largest = abs(m.found[i])
            # Auxiliary ones too: their round-off is in what is found, and the guess's in new.
            size = max(size, abs(m.new[i]), abs(m.a[i]), OF_GUESS * abs(m.a[m.v.size + i]))
        for i in range(m.q.size):
            reached = max(reached, abs(m.q_new[i]))
        slow = largest > STALLED * largest_before
        moved = LEAST_MOVED if iteration > 4 and left <= CONVERGED * peak else POSITION_ROUND_OFF
        good_enough = max(CONVERGED * peak, moved * reached / to_position)
        last = iteration == iterations - 1  # beneath round-off it may shrink by a steady factor for long
        if _settles(largest, 0.0 if last else largest_before, CONVERGED * size, good_enough):
            m.marks[1] = max(peak, size)
            _evaluate_end(m, p, end, m.found)
            return True
        if trial == 0 and largest > largest_before:
            return False
        if damped:
            _shorten(m, p, end)
        if slow:
            m.marks[0] = 0.0  # too slow: a fresh tangent
        largest_before = largest
    return False


@inner
def _shorten(m: NewmarkSteps, p: Any, end: float) -> None:
    """Halve the correction that was made, which is in ``found``, until the next one by its tangent is shorter."""
    n, share = m.tangent.shape[0], 1.0
    for _ in range(MOST_HALVED):
        _evaluate_end(m, p, end, m.shifted)
        before, after = 0.0, 0.0
        for i in range(n):
            m.shifted[i] -= m.new[i]
        solve_part(m.tangent, m.shifted, 0, 1)
        for i in range(n):
            before += m.found[i] ** 2
            after += m.shifted[i] ** 2
        if math.sqrt(after) <= (1.0 - 0.25 * share) * math.sqrt(before):
            return
        share *= 0.5
        for i in range(n):
            m.new[i] -= share * m.found[i]


@inner
def _correct(m: NewmarkSteps) -> None:
    """Correct the trial accelerations by those that the equations of motion give for them."""
    for i in range(m.v.size):
        m.found[i] -= m.new[i]
    _solve(m.tangent, m.found)
    for i in range(m.v.size):
        m.new[i] += m.found[i]


@inner
def _carry_tangents(m: NewmarkSteps, p: Any, end: float) -> bool:
    """Find the tangents' accelerations where the motion's have been found, until round-off is left; or return false.

    Where forces balance, these are round-off: corrections that move tangents of positions by theirs are none.
    """
    n, before, size = m.tangent.shape[0], math.inf, VANISHED
    to_position = m.h * m.h * m.beta * (1.0 - m.alpha_f) / (1.0 - m.alpha_m)
    for _ in range(STEP_ITERATIONS):
        for i in range(n):
            m.base[i] = m.new[i]
        _correct(m)
        largest, reached = 0.0, 0.0
        for i in range(n):
            m.new[i] = m.base[i]
        for i in range(m.q.size - LANES * n, m.q.size):
            reached = max(reached, abs(m.q_new[i]))
        for i in range(n, m.v.size):
            largest = max(largest, abs(m.found[i]))
            size = max(size, abs(m.new[i]))
        _evaluate_end(m, p, end, m.found)
        little = max(OF_GUESS * CONVERGED * size, POSITION_ROUND_OFF * reached / to_position)
        if largest <= little or (largest <= CONVERGED * size and largest > STALLED * before):
            return True
        if largest > STALLED * before:
            _renew_tangent(m, p, end, m.nudge)
        before = largest
    return False


@begin_cycle.register(NewmarkSteps)
def _begin_cycle(m: NewmarkSteps, p: Any, frozen: Any, first: int, sampled: bool) -> None:
    if first == 0:
        remember_contacts(p, 0.0, m.q, m.v)


@take_steps.register(NewmarkSteps)
def _take_steps(m: NewmarkSteps, p: Any, frozen: Any, first: int, done: int, count: int, sampled: bool) -> int:
    """Find the step's end; the state moves there when the samples are taken."""
    if _find_end(m, p, first * m.h + m.h):
        return 0 if runs_away(m.v_new) else 1
    m.counts[1] = first * m.h
    return 0


@sample_within.register(NewmarkSteps)
def _sample_within(m: NewmarkSteps, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    """Interpolate the state: cubic in time, along the mean rates."""
    n, x = v.size, s / m.h
    for i in range(n):
        v[i] = m.v[i] + s * (m.a[n + i] + 0.5 * x * (m.new[i] - m.a[n + i]))
        m.mean[i] = m.v[i] + s * (0.5 * m.a[n + i] + x * (m.new[i] - m.a[n + i]) / 6.0)
    for i in range(q.size):
        q[i] = m.q[i]
    advance(p, q, m.mean, s, 0, n)


@end_cycle.register(NewmarkSteps)
def _end_cycle(m: NewmarkSteps, p: Any, frozen: Any, first: int, samples: Samples, first_sample: int) -> None:
    move_to_end(m, p, (first + 1) * m.h)


@inner
def move_to_end(m: NewmarkSteps, p: Any, end: float) -> None:
    """Move the state to a step's ``end`` [s], which has been found."""
    n = m.v.size
    for i in range(n):
        m.a[i] = ((1.0 - m.alpha_f) * m.new[i] + m.alpha_f * m.a[n + i] - m.alpha_m * m.a[i]) / (1.0 - m.alpha_m)
        m.a[n + i] = m.new[i]
        m.v[i] = m.v_new[i]
    for i in range(m.q.size):
        m.q[i] = m.q_new[i]
    project(p, end, m.q, m.v)
    remember_contacts(p, end, m.q, m.v)
