"""Functions of a mechanism's state: what loads by the motion itself, such as those of controllers, are made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Self

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.formula import ADD, CONSTANT, MULTIPLY
from fmd.core.state_formula import CURVE, VARIABLE
from fmd.dynamics.closures import GROUND, Place
from fmd.dynamics.signals.signal import Signal


@dataclass(frozen=True)
class SignalValue:
    """Value of a function of time, or its first or second derivative."""

    signal: Signal
    derivative: int = 0


@dataclass(frozen=True)
class JointValue:
    """Position (order 0) or rate (order 1) of the joint with one axis that carries a body.

    Of a hinge on a flexible body it is the angle of the section that the joint grips: what an encoder reads.
    """

    body: str
    order: int = 0


@dataclass(frozen=True)
class PlaceValue:
    """Position (order 0) or velocity (order 1) of a place along an axis of space: 0, 1 or 2."""

    place: Place
    axis: int
    order: int = 0

    @property
    def body(self) -> str:
        """The link that the place is on."""
        return self.place.body


@dataclass(frozen=True)
class HeldValue:
    """A value that a sampled controller holds between its samples, or that a program sets between two steps."""

    number: int  # place among all such values of the mechanism
    initial: float = 0.0  # value before anything has set it


@dataclass(frozen=True)
class StateCurve:
    """A curve of one variable: cubics between knots."""

    knots: tuple[float, ...]  # where each piece begins, ascending; the first value holds before the first one
    # Coefficients of each piece, lowest power first, by the distance from its knot.
    cubics: tuple[tuple[float, float, float, float], ...]
    period: float = 0.0  # distance after which the curve begins anew at the first knot; 0 if it doesn't

    @property
    def slope(self) -> StateCurve:
        """The curve's derivative."""
        return StateCurve(self.knots, tuple((b, 2.0 * c, 3.0 * d, 0.0) for _, b, c, d in self.cubics), self.period)

    def values(self, x: Array) -> Array:
        """Return the values at places, of a curve without a period."""
        piece = np.maximum(np.searchsorted(self.knots, x, side="right") - 1, 0)
        apart = np.maximum(x - np.array(self.knots)[piece], 0.0)
        return np.asarray((np.array(self.cubics)[piece] * apart[:, None] ** np.arange(4)).sum(axis=1))


@dataclass(frozen=True)
class StateFunction:
    """A formula of variables that a mechanism's state and the time give."""

    codes: tuple[int, ...]  # with the constants the program, as of `fmd.core.state_formula.StateFormula`
    constants: tuple[float, ...]
    variables: tuple[Measured, ...]  # what each variable is; one that is a function itself is a controller's output
    curves: tuple[StateCurve, ...] = ()
    factor: float = 1.0  # SI units in one unit of its values

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """All variables, those of the functions among them in their places."""
        return tuple(
            quantity
            for variable in self.variables
            for quantity in (variable.quantities if isinstance(variable, StateFunction) else (variable,))
        )

    @property
    def signals(self) -> dict[Signal, int]:
        """The functions of time that it depends on, each with the highest derivative that counts."""
        found: dict[Signal, int] = {}
        for variable in self.quantities:
            if isinstance(variable, SignalValue):
                found[variable.signal] = max(variable.derivative, found.get(variable.signal, 0))
        return found

    @property
    def held(self) -> tuple[HeldValue, ...]:
        """The values that it takes from sampled controllers and programs."""
        return tuple(variable for variable in self.quantities if isinstance(variable, HeldValue))

    @property
    def bodies(self) -> tuple[str, ...]:
        """The links whose motion it depends on, one for each variable that is measured; the ground is none."""
        measured = (variable for variable in self.quantities if isinstance(variable, JointValue | PlaceValue))
        return tuple(variable.body for variable in measured if variable.body != GROUND)

    def with_variables(self, change: Callable[[Quantity], Quantity]) -> Self:
        """Return the same with its variables changed, those of the functions among them, too."""
        variables = tuple(
            variable.with_variables(change) if isinstance(variable, StateFunction) else change(variable)
            for variable in self.variables
        )
        return replace(self, variables=variables)

    def with_modes(self, kept: Mapping[str, IntArray]) -> Self:
        """Return the same on bodies with some of their modes alone, by the bodies' names."""
        return self.with_variables(
            lambda variable: (
                replace(variable, place=variable.place.with_modes(kept))
                if isinstance(variable, PlaceValue)
                else variable
            )
        )


Quantity = SignalValue | JointValue | PlaceValue | HeldValue
"""What the time, the state or a controller gives."""
Measured = Quantity | StateFunction
"""What a variable of a function may be."""


def add_functions(functions: tuple[StateFunction, ...]) -> StateFunction | None:
    """Return the sum of functions; none of none."""
    if len(functions) < 2:
        return functions[0] if functions else None
    codes, constants = list[int](), list[float]()
    variables, curves = list[Measured](), list[StateCurve]()
    for number, function in enumerate(functions):
        for code in function.codes:
            shift = len(curves) if code >= CURVE else len(variables) if code >= VARIABLE else 0
            codes.append(code + shift)
        codes += [CONSTANT, MULTIPLY, *([ADD] if number else [])]
        constants += [*function.constants, function.factor]
        variables += function.variables
        curves += function.curves
    return StateFunction(tuple(codes), tuple(constants), tuple(variables), tuple(curves))
