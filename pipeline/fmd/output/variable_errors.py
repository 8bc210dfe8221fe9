"""Errors of variables over time, as files state them: the first run's largest over time, or why it is not stated."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fmd.accuracy.details import NO_MEANING, row_name
from fmd.accuracy.error_budget import ERROR_BUDGET, Budget
from fmd.accuracy.error_estimates import Row
from fmd.core.files import write_table
from fmd.core.limits.shown import DIGITS
from fmd.recovery.motion_file import Variable
from fmd.stages.pipeline import Pipeline

NOT_STATED = "not stated: "
_NO_BUDGET = "the run has no error budget; without --no-budget it has one"
_NO_MESH = "a body without a mesh tells nothing of its own error"
_NOT_COMPARED = "the error budget doesn't compare it"
_ROUND_OFF = "it is nothing but round-off"
_OF_JOINTS = ("force", "moment", "position", "rate", "orientation", "angular_velocity", "displacement", "velocity")
_COMPARED = (*_OF_JOINTS, "origin", "deflection", "acceleration")
_WHOLE = ("centre_of_mass", "momentum", "angular_momentum", "kinetic_energy", "potential_energy")


class VariableErrors:
    """Errors of a run's variables, by the budget that it has so far.

    Parameters
    ----------
    run : Pipeline
        The run; nothing is computed.
    """

    def __init__(self, run: Pipeline) -> None:
        self._run = run
        self._budget: Budget | None = run.results.get(ERROR_BUDGET.name)
        rows: tuple[Row, ...] = () if self._budget is None else (*self._budget.rows, *self._budget.details)
        self._rows = {row.name: row for row in rows}

    def of(self, variable: Variable, in_body: bool = False) -> float | str:
        """Return a variable's largest error over time in its unit, or a text that begins with ``not stated``.

        Parameters
        ----------
        in_body : bool
            A vector is in the axes of its body, whose own turn has an error, too.
        """
        if self._budget is None:
            return NOT_STATED + (_NO_BUDGET if ERROR_BUDGET.applies(self._run) else _NO_MESH)
        name, owner, kind = variable.name, *variable.name.rpartition(".")[::2]
        if f"joint.{name}" in self._rows and f"joint {owner}" in variable.long_name:  # a body has this name, too
            name = f"joint.{name}"
        if kind in NO_MEANING:
            return NOT_STATED + f"it {NO_MEANING[kind]}"
        if kind == "displacement" and "." in owner:
            if in_body:
                return NOT_STATED + f"{owner}.deflection of motion.nc has an error"
            size = self._size(f"{owner}.position")
            return size if isinstance(size, str) else 2.0 * size  # of the place now, and of that at the start
        size = self._size(name if kind != "von Mises" else f"{owner}, von Mises stress")
        if isinstance(size, str):
            return size
        if variable.dims == ("quaternion",):
            return 0.5 * size  # of the angle
        of_marker = kind in ("velocity", "acceleration") and "." in owner
        return self._with_turn(name, size) if in_body and (of_marker or kind in ("force", "moment")) else size

    def _size(self, name: str) -> float | str:
        row = self._rows.get(row_name(name))
        if row is None:
            known = name.rpartition(".")[2] in _COMPARED or name in _WHOLE
            return NOT_STATED + (_ROUND_OFF if known else _NOT_COMPARED)
        return NOT_STATED + row.why.removeprefix("not estimated: ") if row.why else row.size

    def _with_turn(self, name: str, size: float) -> float | str:
        """Add what the error of a body's orientation makes of a vector in its axes; a frame that rests has none."""
        owner = name.rpartition(".")[0]
        children = {link.joint_name: link.name for link in self._run.motion.mechanism.links}
        children |= {joint.name: joint.second.body for joint in self._run.motion.mechanism.closing_joints}
        body = children.get(owner, owner.partition(".")[0])
        turn = self._rows.get(f"{body}.orientation")
        if turn is None:
            return size
        if turn.why:
            return NOT_STATED + turn.why.removeprefix("not estimated: ")
        row = self._rows[name]
        return size + turn.size * max(row.value, row.better)


def write_errors(errors: Sequence[tuple[str, str, float | str]], path: Path) -> None:
    """Write names, units and errors of a table's columns as a table beside it."""
    rows = ([name, unit, *error_cells(error)] for name, unit, error in errors)
    write_table(path, ["column", "unit", "error", "why not"], rows)


def error_cells(error: float | str) -> list[str]:
    """Return an error and an empty text, or an empty text and why it is not stated."""
    return ["", error] if isinstance(error, str) else [f"{error:.{DIGITS}g}", ""]
