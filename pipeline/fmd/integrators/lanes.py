"""Leapfrog marches from many states at once: eight in the lanes of each step, each with numbers of its own."""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.stepping import FEWEST_LANES, RUNAWAY
from fmd.dynamics.compiler.program import LANES
from fmd.integrators.march_tables import Samples, Starts
from fmd.kernels.kernel import kernel
from fmd.kernels.table import Table
from fmd.kernels.vectors import call_native


@dataclass(frozen=True)
class LaneSteps(Table):
    """Eight leapfrog marches under way, a lane each."""

    leap: int  # addresses of a step in lanes, and of the loads and motions; 0 if none varies
    signals: int
    h: float  # step [s]
    values: Array  # (3 n_signals + n_numbers,): value, rate and acceleration of the loads and motions
    inputs: Array  # (3 n_signals + n_numbers, 8): those, and behind them each lane's numbers
    clock: Array  # (1,): time of the loads, and length of a step [s]
    step: Array
    # (n_positions, 8), (n, 8), (n, 8) and (n_positions, 8): positions, rates half a step behind, accelerations, and
    # positions at a sample's step
    q: Array
    v: Array
    a: Array
    q_now: Array
    total: Array  # (8,): sum of the sizes of each lane's rates


def make_lanes(leap: int, p: object, h: float, n: int) -> LaneSteps:
    """Make room for marches by a system's step in lanes, with its parameters, for n coordinates."""
    values, signals = p.inputs, p.signals  # type: ignore[attr-defined]
    q, v, a, q_now = np.zeros((4, n, LANES))
    inputs, clock, step, total = np.zeros((values.size, LANES)), np.zeros(1), np.zeros(1), np.zeros(LANES)
    return LaneSteps(leap, signals, h, values.copy(), inputs, clock, step, q, v, a, q_now, total)


def arrange_lanes(first: IntArray) -> tuple[IntArray, IntArray]:
    """Return which marches go side by side, (n_groups, 8), those of one first step, and which go alone.

    The last of a group fills lanes left over. Those that would fill too few go alone.
    """
    groups, alone = [np.zeros((0, LANES), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for step in np.unique(first):
        own = np.flatnonzero(first == step)
        over = len(own) % LANES
        own, few = np.split(own, [len(own) - over]) if over < FEWEST_LANES else (own, own[:0])
        groups.append(np.concatenate([own, np.repeat(own[-1:], -len(own) % LANES)]).reshape(-1, LANES))
        alone.append(few)
    return np.concatenate(groups), np.concatenate(alone)


@kernel
def march_lanes(m: LaneSteps, samples: Samples, starts: Starts, groups: IntArray, n_steps: int) -> None:
    """March groups of eight starts by so many steps, to their ends and samples, and note the steps that each takes."""
    n, h, n_numbers = m.q.shape[0], m.h, starts.numbers.size
    n_signals, n_samples = m.inputs.shape[0] - n_numbers, samples.step.size
    for group in range(groups.shape[0]):
        for lane in range(LANES):
            row = groups[group, lane]
            for i in range(n):
                m.q[i, lane] = starts.values[row, i]
                m.v[i, lane] = starts.values[row, n + i]
                m.a[i, lane] = starts.values[row, 2 * n + i]
            for i in range(n_numbers):
                m.inputs[n_signals + i, lane] = starts.values[row, 3 * n + i]
            starts.done[row] = n_steps
        first, cursor = starts.first[groups[group, 0]], 0
        m.step[0] = h
        for k in range(n_steps):
            sampled = cursor < n_samples and samples.step[cursor] == first + k
            if sampled:
                for i in range(n):
                    for lane in range(LANES):
                        m.q_now[i, lane] = m.q[i, lane]
            if m.signals != 0:
                m.clock[0] = (first + k) * h
                call_native(m.signals, (m.clock, m.values))
                for i in range(n_signals):
                    for lane in range(LANES):
                        m.inputs[i, lane] = m.values[i]
            call_native(m.leap, (m.inputs, m.step, m.q, m.v, m.a))
            for lane in range(LANES):
                m.total[lane] = 0.0
            for i in range(n):
                for lane in range(LANES):
                    m.total[lane] += abs(m.v[i, lane])
            for lane in range(LANES):
                if not m.total[lane] < RUNAWAY:
                    starts.done[groups[group, lane]] = min(starts.done[groups[group, lane]], k)
            while sampled and cursor < n_samples and samples.step[cursor] == first + k:
                s = samples.offset[cursor]
                for lane in range(LANES):
                    row = groups[group, lane]
                    for i in range(n):  # Taylor's polynomial, as of a march alone
                        rate = m.v[i, lane] - 0.5 * h * m.a[i, lane] + 0.5 * s * m.a[i, lane]
                        starts.sampled_v[row, cursor, i] = rate + 0.5 * s * m.a[i, lane]
                        starts.sampled_q[row, cursor, i] = m.q_now[i, lane] + s * rate
                cursor += 1
        for lane in range(LANES):
            row = groups[group, lane]
            for i in range(n):
                starts.values[row, i] = m.q[i, lane]
                starts.values[row, n + i] = m.v[i, lane]
                starts.values[row, 2 * n + i] = m.a[i, lane]
