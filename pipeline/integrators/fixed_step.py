"""Loop of the methods with a fixed step, and its test for divergence."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pipeline.core.arrays import Array
from pipeline.core.errors import StabilityError
from pipeline.dynamics.jit.compiled import inner
from pipeline.integrators.protocol import Progress, State, require_times

# Rates that add up to more are taken as divergence: no mechanism in SI units comes near it.
_RUNAWAY = 1e30
_FIRST_CHUNK = 1024  # steps: short marches are one call
_CHUNK_SECONDS = 0.2


def march_fixed_steps(
    run: Callable[..., int],
    start: State,
    step: float,
    stride: int,
    times: Array,
    progress: Progress | None,
) -> tuple[State, Array, Array, float]:
    """Call a compiled march with a fixed step until it has passed the last output time.

    It is called for some steps at a time, so that progress shows and divergence is noticed early; neither that nor
    ``times`` changes the steps.

    Parameters
    ----------
    run : callable
        ``run(state, n_steps, sample_step, sample_offset, sample_q, sample_v, cursor) -> steps done``; it writes
        into the state's arrays.
    step : float
        Fast step [s].
    stride : int
        Fast steps to a major cycle, which is never divided.

    Raises
    ------
    StabilityError
        A rate is beyond bounds; the message gives the time and the coordinate that moves fastest then.
    """
    require_times(times)
    state = start.copy()
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


@inner
def runs_away(v: Array) -> bool:
    """Return true if the rates are beyond bounds or not finite."""
    total = 0.0
    for i in range(v.size):
        total += abs(v[i])
    return not total < _RUNAWAY
