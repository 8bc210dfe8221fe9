"""From a scene's formulas of the motion to functions of a mechanism's state."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.core.formula import Formula
from fmd.core.splines import spline_pieces
from fmd.core.state_formula import StateFormula, parse_state_formula
from fmd.dynamics.closures import Place
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import Signal, constant, formula, linear_table, smooth_table
from fmd.dynamics.state_functions import (
    JointValue,
    Measured,
    PlaceValue,
    SignalValue,
    StateCurve,
    StateFunction,
    add_functions,
)
from fmd.scene.result_names import read_observed
from fmd.scene.scene import Scene
from fmd.scene.state_loads import OWN, FormulaVariable, FormulaVariables, LoadOverTime

Locate = Callable[[str], tuple[Place, Array]]
"""Returns a marker by its name, and its axes in those of its body."""


@dataclass(frozen=True)
class FunctionBuilder:
    """Makes functions of a mechanism's state from the formulas of a scene."""

    scene: Scene
    locate: Locate  # returns a marker by its name
    outputs: dict[str, Measured] = field(default_factory=dict)  # what the controllers' names stand for

    def of_joint(self, joint: str) -> StateFunction | None:
        """Return the force or torque along a joint by the motion; none if no drive has such a formula."""
        drives = [drive for drive in self.scene.drive.values() if getattr(drive, "joint", None) == joint]
        found = (self.of_drive(drive) for drive in drives)
        return add_functions(tuple(effort for effort in found if effort is not None))

    def of_drive(self, drive: Any) -> StateFunction | None:
        """Return the size of a drive's force or torque by the motion; none if it has no such formula."""
        given = next((value for _, value in drive if isinstance(value, LoadOverTime)), None)
        if given is None or given.state is None:
            return None
        return self.of_formula(given, given.state, getattr(drive, "joint", None), given.factor)

    def of_formula(
        self, table: FormulaVariables, parsed: StateFormula, own: str | None = None, factor: float = 1.0
    ) -> StateFunction:
        """Return a formula's function; ``own`` is the joint whose position and rate are ``q`` and ``rate``."""
        variables = [self._variable(table, name, own) for name in parsed.variables]
        curves = [make_curve(table.variables[name]) for name in parsed.curves]
        return StateFunction(parsed.codes, parsed.constants, tuple(variables), tuple(curves), factor)

    def of_text(self, text: str) -> StateFunction:
        """Return the function of a formula that stands in no scene.

        Raises
        ------
        InputError
            It isn't one, or names what the scene doesn't have.
        """
        table, parsed = read_observed(self.scene, text)
        return self.of_formula(table, parsed)

    def _variable(self, table: FormulaVariables, name: str | Formula, own: str | None) -> Measured:
        if isinstance(name, Formula):
            return SignalValue(formula(name))
        if (value := table.find_constant(name)) is not None:
            return SignalValue(constant(value))
        if (found := table.find_derivative(name)) is not None:
            curve, order = found
            return SignalValue(_signal(curve, self.scene.simulation.duration), order)
        if name in OWN and own is not None:
            return JointValue(_carried_by(self.scene, own), OWN[name])
        measured = table.find_measured(name)
        if measured is None:
            return self.outputs[name]
        if measured.axis < 0:
            return JointValue(_carried_by(self.scene, measured.place), measured.order)
        return PlaceValue(self.locate(measured.place)[0], measured.axis, measured.order)


def combine_functions(text: str, variables: Mapping[str, Measured | float]) -> StateFunction:
    """Return a formula of other functions and of numbers by the names that it has for them."""
    parsed = parse_state_formula(text)
    found = [variables[name] for name in parsed.names]
    measured = (SignalValue(constant(x)) if isinstance(x, float) else x for x in found)
    return StateFunction(parsed.codes, parsed.constants, tuple(measured))


def require_values_at_start(scene: Scene, mechanism: Mechanism, q: Array) -> None:
    """Raise ``InputError`` if a formula of the motion has no finite value at the start (n_positions,), at rest."""
    motion = Kinematics(mechanism, np.zeros(1), q[None], np.zeros((1, mechanism.n)))
    for function in mechanism.functions:
        if not np.isfinite(motion.effort(function)).all():
            names = [
                f"drive.{name}"
                for name, drive in scene.drive.items()
                if any(getattr(x, "state", None) for _, x in drive)
            ]
            names += [f"controller.{name}" for name in scene.controller]
            key = names[0] if len(names) == 1 else "drive"
            what = "a formula of the motion has no finite value at the start"
            raise InputError(scene.file, key, None, f"{what} (a division by zero, or a root of a negative number)")


def _carried_by(scene: Scene, joint: str) -> str:
    return scene.joint[joint].child.partition(".")[0]


def _signal(curve: FormulaVariable, until: float) -> Signal:
    times, values = (np.array(row) for row in curve.rows)
    return (smooth_table if curve.between == "smooth" else linear_table)(times, values, curve.beyond, until)


def make_curve(given: FormulaVariable) -> StateCurve:
    """Return the curve of a table."""
    x, y = given.rows
    repeats = given.beyond == "repeat"
    pieces = _smooth_pieces(x, y, repeats) if given.between == "smooth" else _straight_pieces(x, y)
    if repeats:
        return StateCurve(tuple(x[:-1]), pieces, x[-1] - x[0])
    return StateCurve(tuple(x), (*pieces, (y[-1], 0.0, 0.0, 0.0)))


def _straight_pieces(x: Sequence[float], y: Sequence[float]) -> tuple[tuple[float, float, float, float], ...]:
    slopes = np.diff(y) / np.diff(x)
    return tuple((float(value), float(slope), 0.0, 0.0) for value, slope in zip(y, slopes, strict=False))


def _smooth_pieces(
    x: Sequence[float], y: Sequence[float], repeats: bool
) -> tuple[tuple[float, float, float, float], ...]:
    pieces = spline_pieces(x, [*y[:-1], y[0]] if repeats else y, "periodic" if repeats else "natural")
    return tuple((a, b, c, d) for a, b, c, d in pieces.tolist())
