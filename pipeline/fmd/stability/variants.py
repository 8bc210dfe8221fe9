"""Operating points of mechanisms that differ in springs, rests and dampers of joints: found for all of them at once.

A mechanism's structure is one for all, so that one system stands for them in each call of a kernel; every state has the
numbers of its own behind it. Of a call with a few states most is spent outside of the kernel.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.stability import OPERATING_POINTS, RESOLVED_STEP, RIGID_STEPS
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.central_difference import CentralDifference
from fmd.stability.operating_points import (
    OperatingPoints,
    find_steady_points,
    find_undeformed_points,
    operating_times,
    resting_rates,
    settle,
    with_joints,
)
from fmd.stability.tangent import OperatingPoint


class VariantStart(NamedTuple):
    """A mechanism as it is marched, the mechanism that starts, and positions and rates of the start."""

    system: CompiledSystem
    mechanism: Mechanism
    q: Array
    v: Array


def differ_in_numbers(system: CompiledSystem) -> bool:
    """Tell whether a system may stand for others with other numbers: neither loops, contacts nor laws remember any."""
    return not (system.is_sampled or system.mechanism.contacts or system.has_loops or system.piecewise_laws)


def find_points_of_variants(variants: Sequence[VariantStart], duration: float) -> list[OperatingPoints]:
    """Find the operating points of variants as `find_operating_points` does those of one.

    Raises
    ------
    StabilityError
        One of the variants can't be integrated with all bodies rigid.
    """
    first = variants[0].system
    settled = settle(first, _find_undeformed_points(variants, duration), resting_rates(first.mechanism))
    points = [OperatingPoint(at.time, at.q, at.v) for at in settled]  # without the numbers, which are its system's
    count = len(points) // len(variants)
    return [
        OperatingPoints(variant.system, tuple(points[k * count : (k + 1) * count]), duration)
        for k, variant in enumerate(variants)
    ]


def _find_undeformed_points(variants: Sequence[VariantStart], duration: float) -> list[OperatingPoint]:
    """Find the states of the variants' motions with all bodies rigid: marched together where one step suits all.

    They have the variants' numbers, those of one variant after the other.
    """
    rigid = share_system(variants[0].mechanism.rigid)
    numbers = np.array([variant.system.compiled.numbers for variant in variants])
    step = duration / RIGID_STEPS
    # Springs and dampers shorten the longest step: those of the stiffest of all, every one.
    stiffest = share_system(rigid.compiled.with_numbers(numbers.max(axis=0))) if rigid.n else rigid
    if not rigid.n or step > RESOLVED_STEP * stiffest.largest_step:
        parts = [find_undeformed_points(each.system, *each[1:], duration) for each in variants]
        return _with_numbers(parts, [each.system for each in variants])
    starts = [
        OperatingPoint(0.0, each.q[: rigid.n_positions], each.v[: rigid.n], own)
        for each, own in zip(variants, numbers, strict=True)
    ]
    fast = np.arange(rigid.n_slow, rigid.n)
    steady = find_steady_points(rigid, starts, fast)
    if steady is None:
        steady = [(find_steady_points(rigid, [at], fast) or [at])[0] for at in starts]
    moved = _march_rigid(rigid, np.array([at.values for at in steady]), step)
    q, v = (each.reshape(-1, each.shape[2]) for each in moved)
    times = np.tile(operating_times(duration), len(variants)).tolist()
    states = with_joints(variants[0].system.mechanism, rigid.mechanism, q, v)  # like all others but for its numbers
    return [*map(OperatingPoint, times, *states, np.repeat(numbers, OPERATING_POINTS, axis=0))]


def _with_numbers(parts: Sequence[Sequence[OperatingPoint]], systems: Sequence[CompiledSystem]) -> list[OperatingPoint]:
    """Return the points of systems, one system's after the other's, with its numbers."""
    return [
        OperatingPoint(at.time, at.q, at.v, system.compiled.numbers)
        for own, system in zip(parts, systems, strict=True)
        for at in own
    ]


def _march_rigid(rigid: CompiledSystem, starts: Array, step: float) -> tuple[Array, Array]:
    """Return positions and rates (n_variants, n_times, …) of marches from states (…, n_positions + n + n_numbers).

    The operating times are whole steps, so that a sample is the positions before a step and the acceleration in it.
    """
    method, count = CentralDifference(step), RIGID_STEPS // OPERATING_POINTS
    n_positions, n = rigid.n_positions, rigid.n
    start = method.start(rigid, *np.split(starts[0, : n_positions + n], [n_positions]))
    values, done = method.starts(rigid, starts), np.zeros(len(starts), dtype=np.int64)
    positions, rates = [], []
    for steps in (count // 2, *(OPERATING_POINTS - 1) * [count]):
        values = method.ends(rigid, start, values, done, steps)
        done += steps
        _, v, a, _ = np.split(method.ends(rigid, start, values, done, 1), np.cumsum([n_positions, n, n]), axis=1)
        positions.append(values[:, :n_positions])
        rates.append(v - 0.5 * step * a)
    return np.stack(positions, axis=1), np.stack(rates, axis=1)


def find_growth_together(variants: Sequence[OperatingPoints], method: Any) -> None:
    """Find the growth by a method of a fixed step, which each variant then knows; nothing if one diverges."""
    systems: list[Any] = [own.system for own in variants]
    points = _with_numbers([own.points for own in variants], systems)
    excess = replace(variants[0], points=tuple(points)).excess_growth(method)
    if np.isfinite(excess).all():
        for own, rates in zip(variants, np.split(excess, len(variants)), strict=True):
            own.keep(method, rates)
