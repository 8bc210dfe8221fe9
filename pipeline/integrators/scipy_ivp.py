"""SciPy's adaptive methods on a mechanism: references, and a fall-back where nothing else fits."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.integrate import DOP853, LSODA, Radau

from pipeline.checks import Array, StabilityError
from pipeline.dynamics.system import System
from pipeline.integrators.protocol import (
    Progress,
    State,
    Trajectory,
    evaluate,
    evaluate_velocities,
    require_start,
    require_times,
)

_METHODS = {"DOP853": DOP853, "Radau": Radau, "LSODA": LSODA}
_ORDERS = {"DOP853": 8, "Radau": 5, "LSODA": 12}


@dataclass(frozen=True)
class ScipyIvp:
    """One of SciPy's methods; it chooses its steps by a relative tolerance, and starts anew where a load jumps.

    Parameters
    ----------
    name : str
        ``DOP853``, ``Radau`` or ``LSODA``.
    tolerance : float
        Relative local error; the absolute one is a millionth of it.
    """

    name: Literal["DOP853", "Radau", "LSODA"]
    tolerance: float = 1e-9

    step = 0.0

    def __post_init__(self) -> None:
        if self.name not in _METHODS:
            raise ValueError(f"name is {self.name!r}, expected one of {', '.join(_METHODS)}")
        if not 3e-14 <= self.tolerance < 1.0:
            raise ValueError(f"tolerance is {self.tolerance}, expected 3e-14 … 1")

    def order(self, system: System) -> int:
        """Order of the formula; LSODA's largest."""
        return _ORDERS[self.name]

    def largest_step(self, system: System) -> float:
        """No limit: the method keeps to what is stable by itself."""
        return np.inf

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 to the last of ``times``.

        Raises
        ------
        StabilityError
            The method gave up; the message has the time and its own reason.
        """
        require_start(system, q0, v0)
        require_times(times)
        p, n, n_positions = system.parameters, system.n, system.n_positions
        a, dq = np.zeros(n), np.zeros(n_positions)
        evaluations = 0  # counted here: SciPy's own count leaves out Jacobians

        def rates(t: float, y: Array) -> Array:
            nonlocal evaluations
            evaluations += 1
            q, v = y[:n_positions].copy(), y[n_positions:].copy()
            evaluate(p, t, q, v, a)
            evaluate_velocities(p, q, v, dq)
            return np.concatenate([dq, a])

        samples = np.full((len(times), n_positions + n), np.nan)
        y, now, end = np.concatenate([q0, v0]).astype(float), 0.0, float(times[-1])
        samples[times == 0.0] = y
        n_steps = 0
        tick = time.perf_counter()
        for stop in [*(point for point in system.breakpoints if 0.0 < point < end), end]:
            if stop <= now:
                continue
            if not np.isfinite(rates(now, y)).all():  # SciPy would search for a first step for ever
                raise StabilityError(f"{self.name} stopped at t = {now:.6g} s: the accelerations are not finite")
            solver = _METHODS[self.name](rates, now, y, stop, rtol=self.tolerance, atol=1e-6 * self.tolerance)
            while solver.status == "running":
                message = solver.step()
                if solver.status == "failed" or not np.isfinite(solver.y).all():
                    raise StabilityError(f"{self.name} stopped at t = {solver.t:.6g} s: {message or 'not finite'}")
                n_steps += 1
                inside = (times > solver.t_old) & (times <= solver.t)
                if inside.any():
                    samples[inside] = solver.dense_output()(times[inside]).T
                if progress:
                    progress(solver.t / end)
            now, y = stop, solver.y
        seconds = time.perf_counter() - tick
        rates(now, y)  # the accelerations that the end state documents
        q, v = samples[:, :n_positions], samples[:, n_positions:]
        state = State(n_steps, y[:n_positions].copy(), y[n_positions:].copy(), a)
        mean_step = end / n_steps if n_steps else 0.0
        return Trajectory(self.name, mean_step, 1, times, q, v, evaluations, 0, seconds, state)
