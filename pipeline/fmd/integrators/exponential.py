"""Exponential Runge–Kutta method of order 4 (ETDRK4) of Cox & Matthews, J Comput Phys 176 (2002).

Each coordinate is an oscillator ``q̈ = −ω² q + N`` (ω = 0 without a spring), solved exactly but for the rest N, so
the step follows the motion and the loads, not the highest mode. For ``L = [[0, 1], [−ω², 0]]`` and a function f with
real coefficients ``f(L h) = Re f(iθ) + (L h) Im f(iθ)/θ`` with θ = ω h: two numbers for each coordinate stand for the
matrix functions φ₁, φ₂, φ₃ of the method.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import pairwise
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.round_off import SOLVED
from fmd.dynamics.system import System, accelerations, project
from fmd.integrators.fixed_step import FixedMarch, SingleSteps, runs_away, sample_within, take_steps
from fmd.integrators.protocol import (
    Integrator,
    Progress,
    ResumableIntegrator,
    State,
    Trajectory,
    require_start,
    require_step,
    require_times,
    start_state,
)
from fmd.kernels.kernel import inner, kernel
from fmd.kernels.table import aligned


@dataclass(frozen=True)
class Exponential(ResumableIntegrator):
    """Exponential method of order 4 with a constant step [s], for mechanisms without rotations in space."""

    step: float

    name = "exponential"
    marches_tangents = True
    dense_output = True
    takes_contacts = True

    def __post_init__(self) -> None:
        require_step(self.step)

    def carries_tangent(self, system: System, others: Sequence[System]) -> bool:
        """Tell whether a tangent can be marched: not where the oscillators themselves change, or bodies touch."""
        return not system.n_contact_values and all(
            np.array_equal(system.stiffness, other.stiffness) for other in others
        )

    def order(self, system: System) -> int:
        """Return 4; modes that the step does not resolve have about 3 (Hochbruck & Ostermann 2005); in contact 2."""
        return 2 if system.n_contact_values else 4

    def largest_step(self, system: System) -> float:
        """Return 2 over the frequency of what couples the oscillators in the reference state, or infinity [s].

        Steps in contact are exact in the modes of the whole mechanism, and have no limit.

        Coupling is part of the rest N, which the stages take explicitly: ``ρ(M⁻¹ K − diag(K)/diag(M))`` is the square
        of its frequency, where the first K has end stops that are touched. Strong coupling leaves an explicit method's
        limit, weak coupling a far longer step.
        """
        if system.n_contact_values:
            return np.inf
        M, K, _ = system.linear_matrices
        coupling = np.linalg.solve(M, system.stiffest_matrices[1]) - np.diag(K.diagonal() / M.diagonal())
        squared = float(np.abs(np.linalg.eigvals(coupling)).max(initial=0.0))
        return 2.0 / math.sqrt(squared) if squared > SOLVED * system.highest_frequency**2 else np.inf

    @classmethod
    def ladders(cls, explicit: Sequence[float], coarse: Sequence[float]) -> Iterator[Sequence[Integrator]]:
        """Yield the method with every step beyond the stable ones."""
        yield [cls(step) for step in coarse]

    def suits(self, system: System) -> bool:
        """Return true for a system without rotations in space, whose quaternions are no oscillators."""
        return system.n_positions == system.n

    def may_grow(self, system: Any) -> bool:
        """Tell whether the stages' explicit part may couple away from the reference state, or dampers act in a step."""
        if system.coupled:
            return True
        M, _, C = system.stiffest_matrices
        return bool(self.step * np.abs(np.linalg.eigvals(np.linalg.solve(M, C))).max(initial=0.0) > 1.0)

    def lost_phase(self, system: System, duration: float) -> float:
        """Return how much of the fastest vibration's phase round-off hides after a duration [rad]."""
        return float(np.sqrt(system.stiffness.max(initial=0.0))) * duration * float(np.finfo(float).eps)

    def describe_limit(self, system: Any) -> str:
        """Say which coupling limits the step."""
        stops = ", and of end stops" if np.any(system.linear_forces.stop_K) else ""
        return (
            f"2/ω with {1 / (np.pi * self.largest_step(system)):.5g} Hz, the frequency of what couples joints and "
            f"modes through the mass matrix{stops}, which this method doesn't solve exactly"
        )

    def start(self, system: System, q0: Array, v0: Array) -> State:
        """Return the state at time 0."""
        return start_state(self, system, q0, v0, np.zeros(system.n))

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        Raises
        ------
        ValueError
            The mechanism has a rotation in space, whose quaternion is no oscillator.
        """
        _require_oscillators(system)
        if system.n_contact_values:
            exactly = import_module("fmd.integrators.energy_exact").march_exactly
            found: Trajectory = exactly(self.name, self.step, system, start, times, progress)
            return found
        return self._continue(system, system.stiffness, start, times, 0.0, progress)

    def _continue(
        self, system: System, stiffness: Array, start: State, times: Array, origin: float, progress: Progress | None
    ) -> Trajectory:
        """Continue from a state, its steps and the output times counted from an origin [s]."""
        make, h = partial(self.make_steps, stiffness, origin), self.step
        end, q, v, seconds = FixedMarch(self.name, make, system, 0, h, origin=origin).run(start, times, progress)
        return Trajectory(self.name, h, 1, times, q, v, 4 * (end.step - start.step), 0, seconds, end)

    def make_steps(self, stiffness: Array, origin: float, state: State) -> ExponentialSteps:
        """Return what a march from a state takes its steps with, counted from an origin [s]."""
        n, h = stiffness.size, self.step
        full, half = np.empty((n, 8)), np.empty((n, 8))
        for j, squared in enumerate(stiffness):
            fill_functions(squared, h, full[j])
            fill_functions(squared, 0.5 * h, half[j])
        oscillators = (np.ascontiguousarray(stiffness), full, half)
        room = (np.empty((n, 8)), *aligned(*10 * [n]))
        return ExponentialSteps(origin, h, *oscillators, state.q, state.v, state.a, *room)


@dataclass(frozen=True)
class PiecewiseExponential(Integrator):
    """Exponential method that starts anew at each breakpoint of the loads, with a constant step between two of them."""

    step: float  # longest step [s]
    least: int = 1  # smallest number of steps between two breakpoints

    name = "exponential"
    dense_output = True

    def __post_init__(self) -> None:
        require_step(self.step)

    def order(self, system: System) -> int:
        """Return 4; modes that the step does not resolve have about 3."""
        return 4

    def largest_step(self, system: System) -> float:
        """Return the limit of `Exponential` [s]."""
        return Exponential(self.step).largest_step(system)

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 to the last of ``times``."""
        require_start(self, system, q0, v0)
        require_times(times)
        end = float(times[-1])
        stops = [t for t in system.breakpoints if 0.0 < t < end]
        if not stops:
            return Exponential(self.step).march(system, q0, v0, times, progress)
        _require_oscillators(system)
        stiffness = system.stiffness
        q, v = np.full((times.size, q0.size), np.nan), np.full((times.size, v0.size), np.nan)
        state = State(0, q0.astype(float), v0.astype(float), np.zeros(v0.size))
        evaluations, seconds, steps = 0, 0.0, 0
        for begin, finish in pairwise([0.0, *stops, end]):
            # A margin of some units in the last place keeps loads on their side of a jump.
            margin = 4.0 * float(np.spacing(finish))
            origin, last = begin + (margin if begin else 0.0), finish - margin
            if not last > origin:
                continue
            count = max(self.least, math.ceil((last - origin) / self.step))
            method = Exponential((last - origin) / count)
            inside = (times >= begin) & ((times < finish) if finish < end else (times <= end))
            local = np.append(np.clip(times[inside] - origin, 0.0, last - origin), last - origin)
            piece = method._continue(system, stiffness, replace(state, step=0, time=0.0), local, origin, None)
            q[inside], v[inside] = piece.q[:-1], piece.v[:-1]
            state = replace(piece.end, q=piece.q[-1].copy(), v=piece.v[-1].copy())
            evaluations, seconds, steps = evaluations + piece.evaluations, seconds + piece.seconds, steps + count
            if progress:
                progress(finish / end)
        state = replace(state, step=steps, time=end)
        return Trajectory(self.name, end / steps, 1, times, q, v, evaluations, 0, seconds, state)


def _require_oscillators(system: System) -> None:
    """Raise ``ValueError`` if a mechanism has a rotation in space."""
    if system.n_positions != system.n:
        raise ValueError("the exponential method takes no rotations in space; use another integrator")


@kernel
def fill_functions(stiffness: float, h: float, out: Array) -> None:
    """Fill out (8,) with ``(Re φ_k, h Im φ_k/θ)`` for k = 0 … 3, where φ₀ is the exponential.

    These are the entries of φ_k(L h) that take a rate to a rate and to a position.
    """
    theta = math.sqrt(stiffness) * h
    if theta < 1.0:  # series of φ_k(iθ) = Σ (iθ)^m / (m + k)!
        start = 1.0
        for k in range(4):
            real, imaginary, term = 0.0, 0.0, start
            for m in range(0, 22, 2):
                real += term
                term /= m + 1 + k
                imaginary += term
                term *= -theta * theta / (m + 2 + k)
            out[2 * k], out[2 * k + 1] = real, h * imaginary
            start /= k + 1
    else:  # φ_{k+1}(z) = (φ_k(z) − 1/k!)/z with z = iθ
        real, imaginary, inverse = math.cos(theta), math.sin(theta), 1.0
        for k in range(4):
            out[2 * k], out[2 * k + 1] = real, h * imaginary / theta
            real, imaginary = imaginary / theta, (inverse - real) / theta
            inverse /= k + 1


@dataclass(frozen=True)
class ExponentialSteps(SingleSteps):
    """State of a march by the exponential method, and room to work in."""

    origin: float  # time of step number 0, and the step [s]
    h: float
    stiffness: Array  # (n,): of the oscillators [1/s²]
    full: Array  # (n, 8): `fill_functions` of each oscillator over a step, and over half of it
    half: Array
    q: Array
    v: Array
    a: Array
    phi: Array  # (n, 8): `fill_functions` up to a sample
    qa: Array  # positions and rates of the stages
    va: Array
    qb: Array
    vb: Array
    N0: Array  # accelerations without the oscillators' own, at the begin and at the stages
    Na: Array
    Nb: Array
    Nc: Array
    q_now: Array  # the state at the step's begin
    v_now: Array


@inner
def _rest(m: ExponentialSteps, p: Any, t: float, q: Array, v: Array, N: Array) -> None:
    """Evaluate the accelerations without the oscillators' own part ``−ω² q``, into N."""
    accelerations(p, t, q, v, N)
    for i in range(v.size):
        N[i] += m.stiffness[i] * q[i]


@take_steps.register(ExponentialSteps)
def _take_steps(m: ExponentialSteps, p: Any, frozen: Any, first: int, done: int, count: int, sampled: bool) -> int:
    for k in range(count):
        take_step(m, p, m.origin + (first + done + k) * m.h)
        if runs_away(m.v):
            return k
    return count


@inner
def take_step(m: ExponentialSteps, p: Any, t: float) -> None:
    """Take a step from a time t [s]; after it ``qb`` and ``vb`` are its last stage."""
    h, half, full, stiffness = m.h, m.half, m.full, m.stiffness
    N0, Na, Nb, Nc = m.N0, m.Na, m.Nb, m.Nc
    _rest(m, p, t, m.q, m.v, N0)
    for i in range(m.v.size):
        q, v = m.q[i], m.v[i]
        m.q_now[i], m.v_now[i] = q, v
        e, s, f, g = half[i, 0], half[i, 1], 0.5 * h * half[i, 2], 0.5 * h * half[i, 3]
        m.qa[i] = e * q + s * v + g * N0[i]
        m.va[i] = e * v - stiffness[i] * s * q + f * N0[i]
    _rest(m, p, t + 0.5 * h, m.qa, m.va, Na)
    for i in range(m.v.size):
        m.qb[i] = m.qa[i] + 0.5 * h * half[i, 3] * (Na[i] - N0[i])
        m.vb[i] = m.va[i] + 0.5 * h * half[i, 2] * (Na[i] - N0[i])
    _rest(m, p, t + 0.5 * h, m.qb, m.vb, Nb)
    for i in range(m.v.size):
        e, s, f, g = half[i, 0], half[i, 1], 0.5 * h * half[i, 2], 0.5 * h * half[i, 3]
        rest = 2.0 * Nb[i] - N0[i]
        m.qb[i] = e * m.qa[i] + s * m.va[i] + g * rest
        m.vb[i] = e * m.va[i] - stiffness[i] * s * m.qa[i] + f * rest
    _rest(m, p, t + h, m.qb, m.vb, Nc)
    for i in range(m.v.size):
        m.q[i], m.v[i] = move_oscillator(m, i, h, 1.0, full[i])
        m.a[i] = N0[i] - stiffness[i] * m.q_now[i]
    project(p, t + h, m.q, m.v)


@inner
def move_oscillator(m: ExponentialSteps, i: int, s: float, x: float, phi: Array) -> tuple[float, float]:
    """Move an oscillator by a time s, a part x of the step: its own motion exactly, N by the parabola of its stages.

    At x = 1 the weights are ``(φ₁ − 3 φ₂ + 4 φ₃) N₀ + 2 (φ₂ − 2 φ₃)(N_a + N_b) + (4 φ₃ − φ₂) N_c``.
    """
    q, v = m.q_now[i], m.v_now[i]
    c1, middle, end = m.N0[i], m.Na[i] + m.Nb[i], m.Nc[i]
    c2, c3 = x * (2.0 * middle - 3.0 * c1 - end), 4.0 * x * x * (c1 - middle + end)
    return (
        phi[0] * q + phi[1] * v + s * (phi[3] * c1 + phi[5] * c2 + phi[7] * c3),
        phi[0] * v - m.stiffness[i] * phi[1] * q + s * (phi[2] * c1 + phi[4] * c2 + phi[6] * c3),
    )


@sample_within.register(ExponentialSteps)
def _sample_within(m: ExponentialSteps, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    for i in range(v.size):
        fill_functions(m.stiffness[i], s, m.phi[i])
        q[i], v[i] = move_oscillator(m, i, s, s / m.h, m.phi[i])
