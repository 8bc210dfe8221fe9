"""Sampled controllers of one march: when they measure, what, and the values that they hold until then."""

from collections.abc import Callable, Sequence

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import StabilityError
from fmd.dynamics.compiler.compiled import CompiledMechanism
from fmd.dynamics.controllers import HeldValues, SampledController


class Measurement:
    """Measurements of a mechanism's sampled controllers by a compiled function, into arrays that are made once."""

    def __init__(self, compiled: CompiledMechanism, held: int) -> None:
        controllers = compiled.mechanism.controllers
        counts = [len(controller.measured) for controller in controllers]
        self._ends = np.cumsum([0, *counts])
        self._inputs, self._time = compiled.signal_values(0.0), np.zeros(1)
        self._q, self._v = np.zeros(compiled.mechanism.n_positions), np.zeros(compiled.mechanism.n)
        self._values = np.zeros(int(self._ends[-1]))
        self.held = self._inputs[len(self._inputs) - held :]
        arrays = (self._inputs, self._q, self._v, self._values)
        self._measure = compiled.bound("measured", *arrays)
        self._signals = compiled.bound("signals", self._time, self._inputs) if compiled.signals else _do_nothing

    def set_state(self, t: float, q: Array, v: Array) -> None:
        """Set the time [s], positions (n_positions,) and rates (n,) at which is measured."""
        self._time[0] = t
        self._q[:], self._v[:] = q, v
        self._signals()

    def of(self, number: int) -> Array:
        """Return what a controller measures by its number, with the values that are held now."""
        self._measure()
        return self._values[self._ends[number] : self._ends[number + 1]]


class Sampling:
    """Sampled controllers in one march; of those that sample at one time a later one sees what others have set.

    ``held`` counts the values that are held; those of programs come with those of controllers.
    """

    def __init__(self, compiled: CompiledMechanism, controllers: Sequence[SampledController], held: int) -> None:
        self._controllers, self._measurement = controllers, Measurement(compiled, held)
        self._laws: list[Callable[[float, Array], float]] = [controller.law.begin() for controller in controllers]
        self._counts = [0] * len(controllers)
        self.next, self.record = 0.0, HeldValues()  # time of the next sample [s], and what has been held so far

    @property
    def held(self) -> Array:
        """Values that are held now, (n_held,); those of programs may be set."""
        return self._measurement.held

    def sample(self, t: float, q: Array, v: Array, inputs: Array) -> None:
        """Let the controllers whose time has come measure a state, and set what they hold at the end of ``inputs``.

        Raises
        ------
        StabilityError
            What a controller measures or gives isn't finite.
        """
        held = self._measurement.held
        self._measurement.set_state(t, q, v)
        for k, controller in enumerate(self._controllers):
            if self._counts[k] * controller.period > t:
                continue
            self._counts[k] += 1
            value = self._laws[k](t, self._measurement.of(k))
            if not np.isfinite(value):
                raise StabilityError(f"controller {controller.name} gives {value} at t = {t:.6g} s", t, q)
            held[controller.output.number] = value
        inputs[len(inputs) - len(held) :] = held
        self.record.add(t, held.tolist())
        self.next = min(n * at.period for n, at in zip(self._counts, self._controllers, strict=True))


def _do_nothing() -> None:
    """Evaluate no signals: the mechanism has none that vary."""
