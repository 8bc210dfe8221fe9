"""Central difference method for variants of a mechanism: eight in the lanes of each step, groups of these in threads.

Each variant's motion is that of `CentralDifference` but for round-off.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import StabilityError
from fmd.core.limits.stepping import RUNAWAY
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.compiler.variants import CompiledVariants
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.fixed_step import locate_samples
from fmd.integrators.protocol import require_step
from fmd.kernels.kernel import inner, kernel
from fmd.kernels.library import call_native
from fmd.kernels.table import Table


@dataclass(frozen=True)
class VariantMarch:
    """Motions of variants of a mechanism.

    Attributes
    ----------
    times : ndarray, shape (n_times,)
        Output times [s].
    q, v : ndarray, shape (n_variants, n_times, n)
        Coordinates and rates.
    seconds : float
        Run time of the compiled march.
    """

    times: Array
    q: Array
    v: Array
    seconds: float


def march_variants(
    mechanisms: Sequence[Mechanism], step: float, q0: Array, v0: Array, times: Array, workers: int | None = None
) -> VariantMarch:
    """March mechanisms that differ in constants and loads by central difference with one step.

    Parameters
    ----------
    mechanisms : sequence of Mechanism
        Of one structure; `CompiledVariants` says what may differ.
    step : float
        [s]
    q0, v0 : ndarray, shape (n_variants, n) or (n,)
        Coordinates and rates at time 0, each variant's or all variants'.
    times : ndarray, shape (n_times,)
        Output times [s], ascending.
    workers : int, optional
        Number of threads; all cores by default.

    Raises
    ------
    ValueError
        The mechanisms are not variants of one.
    StabilityError
        The march of a variant diverged; the message names the first such variant.
    """
    require_step(step)
    variants = CompiledVariants(mechanisms)
    n, count = mechanisms[0].n, len(mechanisms)
    q0, v0 = (np.broadcast_to(np.asarray(x, dtype=float), (count, n)) for x in (q0, v0))
    q, v = np.empty((2, count, times.size, n))
    groups = [np.minimum(np.arange(first, first + LANES), count - 1) for first in range(0, count, LANES)]
    sample_step, sample_offset = locate_samples(times, step)
    leap, signals = variants.leap(), np.array([code.address("signals") for code in variants.signals])
    tick = time.perf_counter()

    def march(group: IntArray) -> None:
        steps = _make_steps(variants, group, leap, signals, step, q0[group], v0[group])
        out_q, out_v = np.empty((2, times.size, n, LANES))
        _march(steps, sample_step, sample_offset, out_q, out_v)
        q[group], v[group] = np.moveaxis(out_q, 2, 0), np.moveaxis(out_v, 2, 0)

    with ThreadPoolExecutor(workers or os.cpu_count()) as threads:
        list(threads.map(march, groups))
    seconds = time.perf_counter() - tick
    failed = np.flatnonzero(~(np.abs(v[:, -1]).sum(axis=1) < RUNAWAY))
    if failed.size:
        raise StabilityError(f"the march of variant {failed[0]} diverged; take a smaller step than {step:.6g} s")
    return VariantMarch(times, q, v, seconds)


@dataclass(frozen=True)
class VariantSteps(Table):
    """Eight variants under way, a lane each.

    Attributes
    ----------
    leap : int
        Address of their common leapfrog step.
    signals : ndarray of int, shape (8,)
        Addresses of their loads.
    same : bool
        They all have the same loads.
    h : float
        Step [s].
    constants : ndarray, shape (n_constants, 8)
        Those in which they differ.
    inputs : ndarray, shape (n_inputs, 8)
        Values, rates and accelerations of the loads.
    own : ndarray, shape (n_inputs,)
        Those of one variant.
    clock, step : ndarray, shape (1,)
        Time of the loads, and length of a step [s].
    q, v, a, q_now : ndarray, shape (n, 8)
        Coordinates, rates half a step behind, accelerations, and coordinates at a sample's step.
    """

    leap: int
    signals: IntArray
    same: bool
    h: float
    constants: Array
    inputs: Array
    own: Array
    clock: Array
    step: Array
    q: Array
    v: Array
    a: Array
    q_now: Array


def _make_steps(
    variants: CompiledVariants, group: IntArray, leap: int, signals: IntArray, h: float, q0: Array, v0: Array
) -> VariantSteps:
    q, v = np.ascontiguousarray(q0.T), np.ascontiguousarray(v0.T)
    n_inputs, codes = variants.n_inputs, signals[group]
    return VariantSteps(
        leap=leap,
        signals=codes,
        same=bool((codes == codes[0]).all()),
        h=h,
        constants=np.ascontiguousarray(variants.constants[:, group]),
        inputs=np.zeros((n_inputs, LANES)),
        own=np.zeros(n_inputs),
        clock=np.zeros(1),
        step=np.zeros(1),
        q=q,
        v=v,
        a=np.zeros(q.shape),
        q_now=np.zeros(q.shape),
    )


@inner
def _leap(m: VariantSteps, t: float, h: float) -> None:
    """Take a step of all lanes; with ``h = 0`` it gives the accelerations alone."""
    m.clock[0], m.step[0] = t, h
    for lane in range(LANES if m.own.size else 0):
        if lane == 0 or not m.same:
            call_native(m.signals[lane], (m.clock, m.own))
        for k in range(m.own.size):
            m.inputs[k, lane] = m.own[k]
    call_native(m.leap, (m.constants, m.inputs, m.step, m.q, m.v, m.a))


@kernel
def _march(m: VariantSteps, sample_step: IntArray, sample_offset: Array, sample_q: Array, sample_v: Array) -> None:
    n, h, cursor = m.q.shape[0], m.h, 0
    _leap(m, 0.0, 0.0)
    for i in range(n):
        for lane in range(LANES):
            m.v[i, lane] -= 0.5 * h * m.a[i, lane]
    for k in range(sample_step[sample_step.size - 1] + 1):
        if k == sample_step[cursor]:
            for i in range(n):
                for lane in range(LANES):
                    m.q_now[i, lane] = m.q[i, lane]
        _leap(m, k * h, h)
        while cursor < sample_step.size and k == sample_step[cursor]:
            s = sample_offset[cursor]
            for i in range(n):
                for lane in range(LANES):
                    rate, a = m.v[i, lane] - 0.5 * h * m.a[i, lane], m.a[i, lane]
                    sample_v[cursor, i, lane] = rate + s * a
                    sample_q[cursor, i, lane] = m.q_now[i, lane] + s * (rate + 0.5 * s * a)
            cursor += 1
