"""SciPy's adaptive methods on a mechanism: references, and a fall-back where nothing else fits."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import FunctionType
from typing import Any, Literal

import numpy as np
from scipy.integrate import DOP853, LSODA, Radau

from pipeline.core.arrays import Array
from pipeline.core.errors import StabilityError
from pipeline.dynamics.system import System
from pipeline.integrators.protocol import (
    Progress,
    State,
    Trajectory,
    evaluate,
    evaluate_velocities,
    require_start,
    require_times,
    require_tolerance,
)

_METHODS = {"DOP853": DOP853, "Radau": Radau, "LSODA": LSODA}
_FAR = 1e9  # [s]: no output time cuts a step short, nor bears on the first one
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
        require_tolerance(self.tolerance)

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

        The continuation is bit for bit that of one march. LSODA needs SciPy 1.17 for that; before, its state is out of
        reach.

        Raises
        ------
        ValueError
            SciPy didn't let LSODA's state out.
        """
        if start.inner is not None and not start.inner:
            raise ValueError("this LSODA march can't be continued: SciPy 1.17 is the first to let its state out")
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
        y, now, inner, end = np.concatenate([start.q, start.v]), start.time, start.inner, float(times[-1])
        samples[times == now] = y
        n_steps = 0
        stops = [point for point in system.breakpoints if point > now]
        tick = time.perf_counter()
        while now < end:
            stop = stops.pop(0) if stops else _FAR
            if not np.isfinite(rates(now, y)).all():  # SciPy would search for a first step for ever
                raise StabilityError(f"{self.name} stopped at t = {now:.6g} s: the accelerations are not finite")
            solver = self._solver(rates, now, y, stop, inner)
            while solver.status == "running" and solver.t < end:
                message = solver.step()
                if solver.status == "failed" or not np.isfinite(solver.y).all():
                    raise StabilityError(f"{self.name} stopped at t = {solver.t:.6g} s: {message or 'not finite'}")
                n_steps += 1
                inside = (times > solver.t_old) & (times <= solver.t)
                if inside.any():
                    polynomial = solver.dense_output()
                    for k in np.flatnonzero(inside):  # one by one: a product's round-off depends on its shape
                        samples[k] = polynomial(times[k])
                    samples[times == solver.t] = solver.y  # which the polynomial meets but for round-off
                if progress:
                    progress(min(1.0, solver.t / end))
            now, y = solver.t, solver.y
            inner = _state_of(solver) if solver.status == "running" else None  # begun anew after a breakpoint
        seconds = time.perf_counter() - tick
        rates(now, y)  # the accelerations that the end state documents
        q, v = samples[:, :n_positions], samples[:, n_positions:]
        position, rate, step = y[:n_positions].copy(), y[n_positions:].copy(), (inner or {}).get("h_abs", 0.0)
        state = State(start.step + n_steps, position, rate, a, float(now), float(step), inner=inner)
        mean_step = (now - start.time) / n_steps if n_steps else 0.0
        return Trajectory(self.name, mean_step, 1, times, q, v, evaluations, 0, seconds, state)

    def _solver(
        self, rates: Callable[[float, Array], Array], now: float, y: Array, stop: float, inner: dict[str, Any] | None
    ) -> Any:
        """SciPy's solver, new or with the state of a former one."""
        kind, settings = _METHODS[self.name], {"rtol": self.tolerance, "atol": 1e-6 * self.tolerance}
        if inner is None and self.name != "LSODA":
            return kind(rates, now, y, stop, **settings)
        if inner is None:  # LSODA would take its first step from how far it is to the end
            inner = {}
            settings["first_step"] = DOP853(rates, now, y, stop, **settings).h_abs
        else:
            settings["first_step"] = 0.5 * (stop - now)  # replaced below; it saves the search for one
        solver, inner = kind(rates, now, y, stop, **settings), copy.deepcopy(inner)
        ode, integrator = inner.pop("ode", {}), inner.pop("integrator", {})
        vars(solver).update(inner)
        if ode:
            vars(solver._lsoda_solver).update(ode)
            vars(solver._lsoda_solver._integrator).update(integrator)
        return solver


def _state_of(solver: Any) -> dict[str, Any]:
    """What a solver needs to continue as if it had not stopped; empty if it can't be had."""
    if isinstance(solver, DOP853):
        return {"h_abs": float(solver.h_abs)}
    inner = {name: value for name, value in vars(solver).items() if not isinstance(value, FunctionType)}
    if isinstance(solver, LSODA):
        ode = inner.pop("_lsoda_solver")
        if not hasattr(ode._integrator, "state_doubles"):
            return {}
        inner["ode"], inner["integrator"] = {"_y": ode._y, "t": ode.t}, vars(ode._integrator)
    return inner
