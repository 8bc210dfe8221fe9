"""March by an adaptive method that a program takes on from time to time, setting values in between."""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.stepping import CHUNK
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.adaptive import AdaptiveIntegrator, begin_sampling, begin_steps, march_steps, require_steps


class OpenMarch:
    """A march that goes on when it is told to, from a state at time 0 up to an end [s].

    Positions q (n_positions,) and rates v (n,) change as it goes on. Values ``held`` (n_held,), which the mechanism's
    functions take, see `HeldValue`, are set by `hold`.
    """

    def __init__(self, method: AdaptiveIntegrator, system: CompiledSystem, q0: Array, v0: Array, end: float) -> None:
        state = method.start(system, q0, v0).copy()
        self._system, self._name, self._parameters = system, method.name, system.parameters
        self._march, self._end = method.begin(system, state, np.array([end])), end
        self._steps = march_steps.bind((method.room(system), self._parameters, self._march), np.inf, 0)  # type: ignore[attr-defined]
        self._sampling, self._jumped = begin_sampling(system, state), False
        inputs = self._parameters.inputs
        self.held = inputs[inputs.size - len(system.mechanism.held) :]
        self.q, self.v = state.q, state.v

    @property
    def time(self) -> float:
        """Present time [s]."""
        return float(self._march.clock[0])

    def hold(self, number: int, value: float) -> None:
        """Set a value that is held from now on, by its number."""
        self.held[number] = value
        if self._sampling is not None:
            self._sampling.held[number] = value
        self._jumped = True

    def advance(self, until: float) -> None:
        """March to a time [s], or to the end.

        Raises
        ------
        StabilityError
            The step became too small, or the state isn't finite.
        """
        march, clock, until = self._march, self._march.clock, min(until, self._end)
        while clock[0] < until:
            stop = begin_steps(self._system, self._parameters, march, self._sampling)
            if self._jumped:
                march.fresh[0], self._jumped = 1.0, False
            require_steps(self._name, march, self._steps(min(stop, until), CHUNK))
