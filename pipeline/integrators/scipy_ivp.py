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
_FAR = 1e9  # [s]: no output time cuts a step short
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
        """Integrate from time 0 until the last of ``times`` is passed.

        Raises
        ------
        StabilityError
            The method gave up; the message has the time and its own reason.
        """
        require_start(system, q0, v0)
        return self.resume(system, State(0, q0.astype(float), v0.astype(float), np.zeros(system.n)), times, progress)

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        DOP853 continues bit for bit. Radau and LSODA have more inside than SciPy lets out (the Jacobian and its age, past
        steps): they begin anew, and the continuation is the same to the tolerance only.
        """
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
        y, now, step, end = np.concatenate([start.q, start.v]), start.time, start.next_step, float(times[-1])
        samples[times == now] = y
        n_steps = 0
        stops = [point for point in system.breakpoints if point > now]
        tick = time.perf_counter()
        while now < end:
            stop = stops.pop(0) if stops else _FAR
            if not np.isfinite(rates(now, y)).all():  # SciPy would search for a first step for ever
                raise StabilityError(f"{self.name} stopped at t = {now:.6g} s: the accelerations are not finite")
            solver = _METHODS[self.name](
                rates, now, y, stop, rtol=self.tolerance, atol=1e-6 * self.tolerance, first_step=step or None
            )
            while solver.status == "running" and solver.t < end:
                message = solver.step()
                if solver.status == "failed" or not np.isfinite(solver.y).all():
                    raise StabilityError(f"{self.name} stopped at t = {solver.t:.6g} s: {message or 'not finite'}")
                n_steps += 1
                inside = (times > solver.t_old) & (times <= solver.t)
                if inside.any():
                    samples[inside] = solver.dense_output()(times[inside]).T
                if progress:
                    progress(min(1.0, solver.t / end))
            now, y = solver.t, solver.y
            # Begun anew after a breakpoint, a method finds its first step itself.
            step = solver.h_abs if self.name == "DOP853" and solver.status == "running" else 0.0
        seconds = time.perf_counter() - tick
        rates(now, y)  # the accelerations that the end state documents
        q, v = samples[:, :n_positions], samples[:, n_positions:]
        state = State(start.step + n_steps, y[:n_positions].copy(), y[n_positions:].copy(), a, float(now), step)
        mean_step = (now - start.time) / n_steps if n_steps else 0.0
        return Trajectory(self.name, mean_step, 1, times, q, v, evaluations, 0, seconds, state)
