"""SciPy's adaptive methods on a mechanism, as references and as a fall-back where no other method fits."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal

import numpy as np
from scipy.integrate import DOP853, LSODA, Radau

from fmd.core.arrays import Array
from fmd.core.clock import read_clocks, seconds_since
from fmd.core.data_classes import dataclass
from fmd.core.errors import StabilityError
from fmd.core.limits.stepping import FAR_OFF, MOST_SCIPY_STEPS, SCIPY_WINDOW, SHORTEST_STEP
from fmd.dynamics.step_bounds import StepBounds, allowed_part_of, record_step_start_of
from fmd.dynamics.system import System
from fmd.integrators.endless import StepsLeft
from fmd.integrators.protocol import (
    Integrator,
    Progress,
    State,
    Trajectory,
    evaluate_state,
    require_start,
    require_times,
    require_tolerance,
)

_METHODS = {"DOP853": DOP853, "Radau": Radau, "LSODA": LSODA}
IN_SCENES: tuple[Literal["Radau", "LSODA"], ...] = ("Radau", "LSODA")


@dataclass(frozen=True)
class ScipyIvp(Integrator):
    """One of SciPy's methods; it chooses its steps by a relative tolerance, and starts anew where a load jumps."""

    name: Literal["DOP853", "Radau", "LSODA"]  # ``DOP853``, ``Radau`` or ``LSODA``
    tolerance: float = 1e-9  # relative local error; the absolute one is a millionth of it

    step = 0.0

    def __post_init__(self) -> None:
        if self.name not in _METHODS:
            raise ValueError(f"name is {self.name!r}, expected one of {', '.join(_METHODS)}")
        require_tolerance(self.tolerance)

    def order(self, system: System) -> int:
        """Return the order of the formula, for LSODA the largest."""
        return {"DOP853": 8, "Radau": 5, "LSODA": 12}[self.name]

    def largest_step(self, system: System) -> float:
        """Return infinity: the method keeps to stable steps by itself."""
        return np.inf

    @classmethod
    def ladders(cls, explicit: Sequence[float], coarse: Sequence[float]) -> Iterator[Sequence[Integrator]]:
        """Yield the implicit and the switching method, each with five tolerances."""
        yield from ([cls(name, 10.0**-k) for k in range(3, 12, 2)] for name in IN_SCENES)

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 until the last of ``times`` is passed.

        Raises
        ------
        StabilityError
            The method gave up, or its steps never come to an end; the message has the time and the reason.
        """
        require_start(self, system, q0, v0)
        require_times(times)
        n_positions = system.n_positions
        y, now, end, n_steps = np.concatenate([q0, v0]).astype(float), 0.0, float(times[-1]), 0
        state, rates_there = y.copy(), np.zeros(y.size)
        # Bound: of a small mechanism a call of a kernel by its arguments takes several times as long as what it does.
        evaluate = evaluate_state.bind((system.parameters, state, rates_there), n_positions, now)  # type: ignore[attr-defined]
        slope, evaluations = rates_there.copy(), 1  # SciPy's own count leaves out Jacobians

        def rates(t: float, y: Array) -> Array:
            nonlocal evaluations
            evaluations += 1
            state[:] = y
            evaluate(n_positions, t)
            return rates_there.copy()

        samples = np.full((len(times), y.size), np.nan)
        samples[times == now] = y
        bounds = system.step_bounds
        stops = [point for point in system.breakpoints if point > now]
        left = StepsLeft(self.name, end, MOST_SCIPY_STEPS, SCIPY_WINDOW)
        tick = read_clocks()
        while now < end:
            stop = stops.pop(0) if stops else FAR_OFF
            if not np.isfinite(slope).all():  # SciPy would search for a first step for ever
                raise StabilityError(f"{self.name} stopped at t = {now:.6g} s: the accelerations are not finite")
            solver = self._solver(rates, now, y, stop)
            while solver.status == "running" and solver.t < end:
                before = solver.t, solver.y.copy()
                message = solver.step()
                if solver.status == "failed" or not np.isfinite(solver.y).all():
                    raise StabilityError(f"{self.name} stopped at t = {solver.t:.6g} s: {message or 'not finite'}")
                if (part := self._allowed_part(bounds, n_positions, before, solver)) < 1.0:
                    solver = self._solver(rates, *before, stop, part * (solver.t - before[0]))
                    continue
                n_steps += 1
                _sample(solver, times, samples)
                left.require_end(n_steps, float(solver.t))
                if progress:
                    progress(min(1.0, solver.t / end))
            now, y = solver.t, solver.y
            slope = rates(now, y)  # the last time for the accelerations of the end state
        seconds = seconds_since(tick)
        last = State(n_steps, y[:n_positions].copy(), y[n_positions:].copy(), slope[n_positions:], float(now))
        q, v = samples[:, :n_positions], samples[:, n_positions:]
        mean_step = now / n_steps if n_steps else 0.0
        return Trajectory(self.name, mean_step, 1, times, q, v, evaluations, 0, seconds, last)

    def _solver(
        self, rates: Callable[[float, Array], Array], now: float, y: Array, stop: float, first_step: float | None = None
    ) -> Any:
        """Make SciPy's solver from a state to a breakpoint; it finds its first step [s] unless that is given."""
        settings = {"rtol": self.tolerance, "atol": 1e-6 * self.tolerance}
        if first_step is None and self.name == "LSODA":  # it would take its first step from how far it is to the end
            first_step = min(DOP853(rates, now, y, stop, **settings).h_abs, stop - now)
        return _METHODS[self.name](rates, now, y, stop, first_step=first_step, **settings)

    @staticmethod
    def _allowed_part(bounds: StepBounds, n_positions: int, before: tuple[float, Array], solver: Any) -> float:
        """Return the part of the solver's last step to be tried instead, 1 if it missed no force."""
        (begin, old), new, h = before, solver.y, solver.t - before[0]
        if not bounds.n_laws or h <= SHORTEST_STEP * solver.t:
            return 1.0
        record_step_start_of(bounds, begin, old[:n_positions].copy(), old[n_positions:].copy())
        return allowed_part_of(bounds, solver.t, h, new[:n_positions].copy(), new[n_positions:].copy())


def _sample(solver: Any, times: Array, samples: Array) -> None:
    """Fill in the states at the output times that the solver's last step has passed."""
    inside = (times > solver.t_old) & (times <= solver.t)
    if inside.any():
        polynomial = solver.dense_output()
        for k in np.flatnonzero(inside):  # one by one: a product's round-off depends on its shape
            samples[k] = polynomial(times[k])
        samples[times == solver.t] = solver.y  # which the polynomial meets but for round-off
