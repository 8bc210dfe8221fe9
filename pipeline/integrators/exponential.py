"""Exponential Runge–Kutta method of order 4 (ETDRK4) of Cox & Matthews, J Comput Phys 176 (2002).

Each coordinate is an oscillator ``q̈ = −ω² q + N`` (ω = 0 without a spring), solved exactly but for the rest N, so
the step follows the motion and the loads, not the highest mode. For ``L = [[0, 1], [−ω², 0]]`` and a function f with
real coefficients ``f(L h) = Re f(iθ) + (L h) Im f(iθ)/θ`` with θ = ω h: two numbers for each coordinate stand for the
matrix functions φ₁, φ₂, φ₃ of the method.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.dynamics.jit.compiled import inner, kernel
from pipeline.dynamics.system import System, accelerations
from pipeline.integrators.fixed_step import march_fixed_steps, runs_away
from pipeline.integrators.protocol import (
    Progress,
    State,
    Trajectory,
    march_from,
    require_start,
    require_step,
    require_times,
    start_state,
)

_ROUND_OFF = 1e-9  # of the highest squared frequency: less doesn't couple


@dataclass(frozen=True)
class Exponential:
    """Exponential method of order 4 with a constant step [s], for mechanisms without rotations in space."""

    step: float

    name = "exponential"

    def __post_init__(self) -> None:
        require_step(self.step)

    def order(self, system: System) -> int:
        """Return 4; modes that the step does not resolve have about 3 (Hochbruck & Ostermann 2005)."""
        return 4

    def largest_step(self, system: System) -> float:
        """Return 2 over the frequency of what couples the oscillators in the reference state, or infinity [s].

        Coupling is part of the rest N, which the stages take explicitly: ``ρ(M⁻¹ K − diag(K)/diag(M))`` is the square
        of its frequency. Strong coupling leaves an explicit method's limit, weak coupling a far longer step.
        """
        M, K, _ = system.linear_matrices
        coupling = np.linalg.solve(M, K) - np.diag(K.diagonal() / M.diagonal())
        squared = float(np.abs(np.linalg.eigvals(coupling)).max(initial=0.0))
        return 2.0 / math.sqrt(squared) if squared > _ROUND_OFF * system.highest_frequency**2 else np.inf

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 to the last of ``times``."""
        return march_from(self, system, start_state(system, q0, v0, np.zeros(system.n)), times, progress)

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        Raises
        ------
        ValueError
            The mechanism has a rotation in space, whose quaternion is no oscillator.
        """
        _require_oscillators(system)
        return self._continue(system, system.stiffness, start, times, 0.0, progress)

    def _continue(
        self, system: System, stiffness: Array, start: State, times: Array, origin: float, progress: Progress | None
    ) -> Trajectory:
        """Continue from a state, its steps and the output times counted from an origin [s]."""
        parameters, h = system.parameters, self.step
        full, half = np.empty((system.n, 8)), np.empty((system.n, 8))
        for j, squared in enumerate(stiffness):
            _functions(squared, h, full[j])
            _functions(squared, 0.5 * h, half[j])
        work, phi = np.empty((10, system.n)), np.empty(8)

        def run(state: State, n_steps: int, *samples: Any) -> int:
            march = (origin, h, state.step, n_steps, state.q, state.v, state.a)
            return int(_march(parameters, stiffness, full, half, work, phi, *march, *samples))

        end, q, v, seconds = march_fixed_steps(run, start, h, 1, times, progress)
        return Trajectory(self.name, h, 1, times, q, v, 4 * (end.step - start.step), 0, seconds, end)


@dataclass(frozen=True)
class PiecewiseExponential:
    """Exponential method that starts anew at each breakpoint of the loads, with a constant step between two of them.

    Parameters
    ----------
    step : float
        Longest step [s].
    least : int
        Smallest number of steps between two breakpoints.
    """

    step: float
    least: int = 1

    name = "exponential"

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
        require_times(times)
        end = float(times[-1])
        stops = [t for t in system.breakpoints if 0.0 < t < end]
        if not stops:
            return Exponential(self.step).march(system, q0, v0, times, progress)
        require_start(system, q0, v0)
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
    """Raise ``ValueError`` if a mechanism has a rotation in space, whose quaternion is no oscillator."""
    if system.n_positions != system.n:
        raise ValueError("the exponential method takes no rotations in space; use another integrator")


@kernel
def _functions(stiffness: float, h: float, out: Array) -> None:
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


@inner
def _rest(p: Any, stiffness: Array, t: float, q: Array, v: Array, N: Array) -> None:
    """Evaluate the accelerations without the oscillators' own part ``−ω² q``, into N."""
    accelerations(p, t, q, v, N)
    for i in range(v.size):
        N[i] += stiffness[i] * q[i]


@kernel
def _march(
    p: Any, stiffness: Array, full: Array, half: Array, work: Array, phi: Array,
    origin: float, h: float, first: int, n_steps: int, q: Array, v: Array, a: Array,
    sample_step: IntArray, sample_offset: Array, sample_q: Array, sample_v: Array, cursor: IntArray,
) -> int:  # fmt: skip
    n = v.size
    qa, va, qb, vb, N0, Na, Nb, Nc = work[0], work[1], work[2], work[3], work[4], work[5], work[6], work[7]
    q_now, v_now = work[8], work[9]
    next_sample = sample_step[cursor[0]] if cursor[0] < sample_step.size else -1
    for step in range(first, first + n_steps):
        t = origin + step * h
        _rest(p, stiffness, t, q, v, N0)
        for i in range(n):
            q_now[i], v_now[i] = q[i], v[i]
            e, s, f, g = half[i, 0], half[i, 1], 0.5 * h * half[i, 2], 0.5 * h * half[i, 3]
            qa[i] = e * q[i] + s * v[i] + g * N0[i]
            va[i] = e * v[i] - stiffness[i] * s * q[i] + f * N0[i]
        _rest(p, stiffness, t + 0.5 * h, qa, va, Na)
        for i in range(n):
            qb[i] = qa[i] + 0.5 * h * half[i, 3] * (Na[i] - N0[i])
            vb[i] = va[i] + 0.5 * h * half[i, 2] * (Na[i] - N0[i])
        _rest(p, stiffness, t + 0.5 * h, qb, vb, Nb)
        for i in range(n):
            e, s, f, g = half[i, 0], half[i, 1], 0.5 * h * half[i, 2], 0.5 * h * half[i, 3]
            rest = 2.0 * Nb[i] - N0[i]
            qb[i] = e * qa[i] + s * va[i] + g * rest
            vb[i] = e * va[i] - stiffness[i] * s * qa[i] + f * rest
        _rest(p, stiffness, t + h, qb, vb, Nc)
        for i in range(n):
            w0, w1, w2 = N0[i], Na[i] + Nb[i], Nc[i]
            # (φ₁ − 3 φ₂ + 4 φ₃) N₀ + 2 (φ₂ − 2 φ₃)(N_a + N_b) + (4 φ₃ − φ₂) N_c
            c1, c2, c3 = w0, 2.0 * w1 - 3.0 * w0 - w2, 4.0 * (w0 - w1 + w2)
            e, s = full[i, 0], full[i, 1]
            q[i] = e * q_now[i] + s * v_now[i] + h * (full[i, 3] * c1 + full[i, 5] * c2 + full[i, 7] * c3)
            v[i] = (
                e * v_now[i] - stiffness[i] * s * q_now[i] + h * (full[i, 2] * c1 + full[i, 4] * c2 + full[i, 6] * c3)
            )
            a[i] = N0[i] - stiffness[i] * q_now[i]
        while step == next_sample:  # the oscillators exactly, N by the parabola through its stages
            s = sample_offset[cursor[0]]
            x = s / h
            for i in range(n):
                _functions(stiffness[i], s, phi)
                w0, w1, w2 = N0[i], Na[i] + Nb[i], Nc[i]
                c1, c2, c3 = w0, x * (2.0 * w1 - 3.0 * w0 - w2), 4.0 * x * x * (w0 - w1 + w2)
                sample_q[cursor[0], i] = (
                    phi[0] * q_now[i] + phi[1] * v_now[i] + s * (phi[3] * c1 + phi[5] * c2 + phi[7] * c3)
                )
                sample_v[cursor[0], i] = (
                    phi[0] * v_now[i] - stiffness[i] * phi[1] * q_now[i] + s * (phi[2] * c1 + phi[4] * c2 + phi[6] * c3)
                )
            cursor[0] += 1
            next_sample = sample_step[cursor[0]] if cursor[0] < sample_step.size else -1
        if runs_away(v):
            return step - first
    return n_steps
