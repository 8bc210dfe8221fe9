"""Exponential steps of mechanisms in contact whose frames don't turn, which keep the energy at any length.

With a constant mass matrix each mode of the mechanism moves exactly under accelerations C of contact that are constant
over a step, and these change the kinetic energy by their sum over the way Δ of the modes. C is between those at the
step's begin and its end, ``C = (1 − x) C₀ + x C₁``, with x so that this is what the contact's potential V loses,
``C Δ = V₀ − V₁``: as V is convex along the way where gaps are linear in positions, x is in 0 … 1. That is a discrete
gradient (Gonzalez, J Nonlinear Sci 6, 1996), implicit in C alone.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import eigh

from fmd.contact.histories import ENERGY
from fmd.contact.sums import evaluate_contacts
from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import StabilityError
from fmd.core.limits.contact import EVEN_SHARE, EXACT_ROUNDS, EXACTLY_KEPT, FORCES_KNOWN
from fmd.core.limits.newton import STALLED
from fmd.core.limits.round_off import EXACT, SOLVED
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiled_system.touching import find_contacts, find_pressed
from fmd.dynamics.system import accelerations, remember_contacts
from fmd.integrators.exponential import fill_functions
from fmd.integrators.fixed_step import FixedMarch, begin_cycle, end_cycle, runs_away, sample_within, take_steps
from fmd.integrators.generalized_alpha import no_convergence
from fmd.integrators.march_tables import Samples
from fmd.integrators.newmark_steps import factor_tangent, solve_part
from fmd.integrators.protocol import Progress, State, Trajectory, evaluate
from fmd.kernels.kernel import inner
from fmd.kernels.table import Table, aligned
from fmd.kernels.vectors import call_native

_ROOM: tuple[str, ...] = ("rest", "none", "y", "w", "other", "begin", "end", "mean", "residual", "base", "shifted")
_ROOM += ("y_new", "q_new", "room")


@dataclass(frozen=True)
class EnergySteps(Table):
    """State of a march by modes of the whole mechanism, and room for Newton's iteration."""

    h: float  # [s]
    q: Array  # (n,): positions and rates
    v: Array
    a: Array
    rest: Array  # (n,): positions and rates at rest
    none: Array
    modes: Array  # (n, n): a column each, of unit modal mass
    inverse: Array  # (n, n): modal coordinates by positions
    squared: Array  # (n,): squares of their frequencies [1/s²]
    full: Array  # (n, 8): functions of `fill_functions` over a step, and (1, 8) over a part of it
    part: Array
    y: Array  # (n,): modal coordinates and rates
    w: Array
    other: Array  # (n,): accelerations of modes by all but contact and stiffness
    begin: Array  # (n,): by contact at the step's begin, at its end, and over the step
    end: Array
    mean: Array
    residual: Array
    base: Array
    shifted: Array
    tangent: Array  # (n, n)
    y_new: Array
    q_new: Array
    room: Array
    numbers: Array  # (4,): potential at begin and end [J], the end's share x, and where no forces were found [s] or NaN
    counts: Array  # (1,): evaluations


@inner
def _multiply(A: Array, x: Array, out: Array) -> None:
    for i in range(out.size):
        out[i] = 0.0
        for j in range(x.size):
            out[i] += A[i, j] * x[j]


@inner
def _evaluate(m: EnergySteps, p: Any, t: float, q: Array, out: Array) -> float:
    """Evaluate the accelerations of modes by contact at positions q; return the contact's potential [J].

    The mechanism answers to pushes as it does at rest, where no stiffness is in the difference.
    """
    find_pressed(p, t, q, m.v)
    call_native(p.pushed, (p.inputs, m.rest, m.none, p.contact.push, p.contact.modal, m.a))
    _multiply(m.inverse, m.a, out)
    for i in range(out.size):
        out[i] -= m.other[i]
    evaluate_contacts(p.contact, p.contact.clock[0], p.origins, p.rotations)
    m.counts[0] += 1
    energy = 0.0
    for k in range(p.contact.now.shape[0]):
        energy += p.contact.now[k, ENERGY]
    return energy


@inner
def _find_residual(m: EnergySteps, p: Any, t: float, out: Array) -> None:
    """Move by the trial accelerations, and evaluate by how much those that keep the energy differ from them."""
    for i in range(m.y.size):
        phi = m.full[i]
        by = m.other[i] + m.mean[i]
        m.y_new[i] = phi[0] * m.y[i] + phi[1] * m.w[i] + m.h * phi[3] * by
    _multiply(m.modes, m.y_new, m.q_new)
    m.numbers[1] = _evaluate(m, p, t, m.q_new, m.end)
    of_begin, of_end, size = 0.0, 0.0, 0.0
    for i in range(m.y.size):
        way = m.y_new[i] - m.y[i]
        of_begin += m.begin[i] * way
        of_end += m.end[i] * way
        size += (abs(m.begin[i]) + abs(m.end[i])) * abs(way)
    share = 0.5
    if abs(of_end - of_begin) > EVEN_SHARE * size:
        share = min(1.0, max(0.0, (m.numbers[0] - m.numbers[1] - of_begin) / (of_end - of_begin)))
    m.numbers[2] = share
    for i in range(m.y.size):
        out[i] = (1.0 - share) * m.begin[i] + share * m.end[i] - m.mean[i]


@inner
def _renew_tangent(m: EnergySteps, p: Any, t: float, size: float) -> None:
    """Factor how the residual falls with the trial accelerations, by differences."""
    n = m.y.size
    for i in range(n):
        m.base[i] = m.residual[i]
    for j in range(n):
        keep = m.mean[j]
        nudge = 1e-6 * (abs(keep) + 1e-2 * size)
        m.mean[j] = keep + nudge
        _find_residual(m, p, t, m.shifted)
        m.mean[j] = keep
        for i in range(n):
            m.tangent[i, j] = (m.base[i] - m.shifted[i]) / nudge
    factor_tangent(m.tangent)
    for i in range(n):
        m.residual[i] = m.base[i]


@inner
def _converges(m: EnergySteps, p: Any, t: float) -> bool:
    """Find the accelerations over a step by Newton's method; false if it doesn't settle."""
    n, before, fresh = m.y.size, math.inf, False
    for i in range(n):
        m.mean[i] = m.begin[i]
    for _ in range(EXACT_ROUNDS):
        _find_residual(m, p, t, m.residual)
        left, size, made, energy, rounded = 0.0, 0.0, 0.0, m.numbers[0] + m.numbers[1], 0.0
        for g in range(p.contact.n_chosen.size):
            for k in range(p.contact.group[g], p.contact.group[g] + p.contact.n_chosen[g]):
                rounded += p.contact.noise[g] * p.contact.force[p.contact.chosen[k], 0]
        for i in range(n):
            energy += 0.5 * m.w[i] ** 2
            left += abs(m.residual[i])
            made += m.residual[i] * (m.y_new[i] - m.y[i])
            size = max(size, abs(m.begin[i]), abs(m.end[i]), abs(m.mean[i]))
        stalled = left > STALLED * before
        settled = left <= EXACT * size or (stalled and left <= FORCES_KNOWN * size)
        if (settled and abs(made) <= EXACTLY_KEPT * energy + rounded) or (stalled and left <= SOLVED * size):
            return True
        if not math.isfinite(left):
            return False
        if not fresh or left > STALLED * before:
            _renew_tangent(m, p, t, size)
            fresh = True
        before = left
        solve_part(m.tangent, m.residual, 0, 1)
        for i in range(n):
            m.mean[i] += m.residual[i]
    return False


@begin_cycle.register(EnergySteps)
def _begin_cycle(m: EnergySteps, p: Any, plain: Any, first: int, sampled: bool) -> None:
    if first == 0:
        remember_contacts(p, 0.0, m.q, m.v)
    middle = first * m.h + 0.5 * m.h
    accelerations(plain, middle, m.rest, m.none, m.a)
    _multiply(m.inverse, m.a, m.other)
    _multiply(m.inverse, m.q, m.y)
    _multiply(m.inverse, m.v, m.w)
    find_contacts(p, middle, m.q, m.v)  # forces on markers stay as they are felt here over the step
    m.numbers[0] = _evaluate(m, p, middle, m.q, m.begin)


@take_steps.register(EnergySteps)
def _take_steps(m: EnergySteps, p: Any, plain: Any, first: int, done: int, count: int, sampled: bool) -> int:
    """Find the step's end; the state moves there when the samples are taken."""
    if _converges(m, p, first * m.h + 0.5 * m.h):
        return 0 if runs_away(m.mean) else 1
    m.numbers[3] = first * m.h
    return 0


@inner
def _move(m: EnergySteps, s: float, q: Array, v: Array) -> None:
    """Evaluate the state a time s [s] after a step's begin."""
    for i in range(m.y.size):
        fill_functions(m.squared[i], s, m.part[0])
        phi, by = m.part[0], m.other[i] + m.mean[i]
        m.room[i] = phi[0] * m.w[i] - m.squared[i] * phi[1] * m.y[i] + s * phi[2] * by
        m.y_new[i] = phi[0] * m.y[i] + phi[1] * m.w[i] + s * phi[3] * by
    _multiply(m.modes, m.y_new, q)
    _multiply(m.modes, m.room, v)


@sample_within.register(EnergySteps)
def _sample_within(m: EnergySteps, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    _move(m, s, q, v)


@end_cycle.register(EnergySteps)
def _end_cycle(m: EnergySteps, p: Any, plain: Any, first: int, samples: Samples, first_sample: int) -> None:
    _move(m, m.h, m.q, m.v)
    p.contact.end_share[0] = m.numbers[2]
    remember_contacts(p, (first + 1) * m.h, m.q, m.v)


def stiffness_under_loads(plain: CompiledSystem) -> Array:
    """Return the stiffness at rest of a mechanism without contacts, with what its loads at time 0 add to it, (n, n)."""
    n, p = plain.n, plain.parameters
    answers, none = np.zeros((n + 1, n)), np.zeros(n)
    for answer, q in zip(answers, np.eye(n + 1, n, -1), strict=True):
        evaluate(p, 0.0, q, none, answer)
    return np.asarray(plain.linear_matrices[0] @ (answers[0] - answers[1:]).T)


def march_exactly(
    name: str, h: float, system: Any, start: State, times: Array, progress: Progress | None
) -> Trajectory:
    """March a mechanism in contact, linear but for that, with steps h [s] that keep its energy.

    Raises
    ------
    ValueError
        A contact rubs, is damped, or loses energy in a shock.
    ConvergenceError
        Newton's iteration did not converge; the message has the time and the step.
    """
    if lossy := [body.body for body in system.mechanism.contacts if body.is_lossy]:
        raise ValueError(f"{name} takes no friction, damping or restitution in contacts: {', '.join(lossy)} has some")
    plain, n = CompiledSystem(replace(system.mechanism, contacts=())), system.n
    M, _, _ = plain.linear_matrices
    squared, modes = eigh(stiffness_under_loads(plain), M)
    squared = np.where(squared > SOLVED * squared.max(initial=0.0), squared, 0.0)
    counts, numbers = np.zeros(1), np.array([0.0, 0.0, 0.5, np.nan])
    full = np.empty((n, 8))
    for own, row in zip(squared, full, strict=True):
        fill_functions(own, h, row)

    def make(state: State) -> EnergySteps:
        of_modes = {"modes": np.ascontiguousarray(modes), "inverse": modes.T @ M, "squared": squared, "full": full}
        room = dict(zip(_ROOM, aligned(*len(_ROOM) * [n]), strict=True))
        more = {"part": np.empty((1, 8)), "tangent": np.zeros((n, n)), "numbers": numbers, "counts": counts}
        return EnergySteps(h=h, q=state.q, v=state.v, a=state.a, **of_modes, **more, **room)

    contacts = np.full((times.size, system.n_contact_values), np.nan)
    try:
        march = FixedMarch(name, make, system, plain.parameters, h)
        end, q, v, seconds = march.run(start, times, progress, contacts)
    except StabilityError:
        if np.isnan(numbers[3]):
            raise
        other = 4.0 * h if 8.0 * h < system.largest_step else 0.5 * h  # round-off of places is left of short ways
        raise no_convergence(name, numbers[3], h, other) from None
    return Trajectory(name, h, 1, times, q, v, int(counts[0]), 0, seconds, end, contacts=contacts)
