"""Sampled controllers: what they measure, what they hold between two samples, and their law."""

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from typing import Self

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.dynamics.fmu_law import FmuLaw
from fmd.dynamics.signals.signal import TABLE, Signal, Term
from fmd.dynamics.state_functions import HeldValue, Quantity, SignalValue, StateFunction


@dataclass(frozen=True)
class LinearLaw:
    """Linear law in discrete time whose output has limits: ``x⁺ = A x + B e + L (u − ū)``, ``ū = C x + D e``.

    The output u is ū within the limits; L winds the memory back by what they cut off.
    """

    A: tuple[tuple[float, ...], ...]  # (n, n), by rows
    B: tuple[tuple[float, ...], ...]  # (n, m), by rows
    C: tuple[float, ...]  # (n,)
    D: tuple[float, ...]  # (m,)
    L: tuple[float, ...]  # (n,)
    # Rows of a matrix (n, m): the memory before the first sample by what is measured then.
    S: tuple[tuple[float, ...], ...]
    lowest: float = -np.inf
    highest: float = np.inf

    def begin(self) -> Callable[[float, Array], float]:
        """Return a function that takes the time [s] and what is measured (m,), and remembers from call to call."""
        A, B, C, D, L = self.matrices
        memory, S = np.zeros(len(C)), np.array(self.S).reshape(B.shape)
        begun = False

        def act(_time: float, measured: Array) -> float:
            nonlocal memory, begun
            if not begun:
                memory, begun = S @ measured, True
            wanted = float(C @ memory + D @ measured)
            output = min(max(wanted, self.lowest), self.highest)
            memory = A @ memory + B @ measured + L * (output - wanted)
            return output

        return act

    @property
    def matrices(self) -> tuple[Array, Array, Array, Array, Array]:
        """A, B, C, D and L as arrays."""
        n, m = len(self.C), len(self.D)
        A, B = np.array(self.A).reshape(n, n), np.array(self.B).reshape(n, m)
        return A, B, np.array(self.C), np.array(self.D), np.array(self.L)


@dataclass(frozen=True)
class SampledController:
    """A controller that measures at times 0, T, 2 T … and holds its output in between."""

    name: str
    period: float  # sample time T [s]
    measured: tuple[StateFunction, ...]  # what its law takes
    output: HeldValue  # the value that functions of the state take
    law: LinearLaw | FmuLaw  # from what is measured to the output

    def with_modes(self, kept: Mapping[str, IntArray]) -> Self:
        """Return the same for bodies with some of their modes alone, by the bodies' names."""
        return replace(self, measured=tuple(function.with_modes(kept) for function in self.measured))


@dataclass
class HeldValues:
    """Values that were held over a march, from each of their times on."""

    times: list[float] = field(default_factory=list)  # times at which a value changed [s], ascending
    # All held values from then on, in the order of their numbers.
    values: list[tuple[float, ...]] = field(default_factory=list)

    def add(self, time: float, values: Sequence[float]) -> None:
        """Note what is held from a time [s] on."""
        held = tuple(values)
        if not self.values or held != self.values[-1]:
            self.times.append(time)
            self.values.append(held)

    def at(self, time: float) -> tuple[float, ...]:
        """Return all values that are held from a time [s] on."""
        return self.values[max(bisect_right(self.times, time) - 1, 0)]

    def signal(self, number: int) -> Signal:
        """Return a value as a function of time: stairs."""
        cubics = tuple((values[number], 0.0, 0.0, 0.0) for values in self.values)
        return Signal((Term(TABLE, knots=tuple(self.times), cubics=cubics),))

    def know(self, quantity: Quantity) -> Quantity:
        """Return the function of time of a value that is held, and any other quantity as it is."""
        return SignalValue(self.signal(quantity.number)) if isinstance(quantity, HeldValue) else quantity
