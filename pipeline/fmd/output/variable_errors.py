"""Errors of variables over time, as files state them: the first run's largest over time, or why it is not stated."""

from fmd.accuracy.details import NO_MEANING, row_name
from fmd.accuracy.error_budget import ERROR_BUDGET, Budget
from fmd.accuracy.error_estimates import Row
from fmd.accuracy.ply_stress import PLY_ROWS
from fmd.output.error_columns import NO_BUDGET, NOT_COMPARED, NOT_STATED
from fmd.recovery.motion_file import OF_FORMULA, Variable
from fmd.recovery.stress import STRESS_COMPONENTS
from fmd.stages.pipeline import Pipeline

_CONTACT = "after a contact two runs part, whatever their error; figures of contacts have theirs"
_OF_MESH = "contact has no part in it; the budget of the scene without its contacts states it"
_OF_JOINTS = ("force", "moment", "position", "rate", "orientation", "angular_velocity", "displacement", "velocity")
_COMPARED = (*_OF_JOINTS, "origin", "deflection", "acceleration", *STRESS_COMPONENTS, *PLY_ROWS)
_WHOLE = ("centre_of_mass", "momentum", "angular_momentum", "kinetic_energy", "potential_energy")


class VariableErrors:
    """Errors of a run's variables, by the budget that it has so far."""

    def __init__(self, run: Pipeline) -> None:
        self._run = run
        self._budget: Budget | None = run.results.get(ERROR_BUDGET.name)
        rows: tuple[Row, ...] = () if self._budget is None else (*self._budget.rows, *self._budget.details)
        self._rows = {row.name: row for row in rows}

    @property
    def has_budget(self) -> bool:
        """True if the run has its error budget."""
        return self._budget is not None

    def of(self, variable: Variable, in_body: bool = False) -> float | str:
        """Return a variable's largest error over time in its unit, or a text that begins with ``not stated``.

        A vector in the axes of its body has the error of that body's own turn, too.
        """
        if variable.units == OF_FORMULA:
            return NOT_COMPARED
        if self._budget is None:
            return self.of_quantity(variable.name)
        name, owner, kind = variable.name, *variable.name.rpartition(".")[::2]
        if f"joint.{name}" in self._rows and f"joint {owner}" in variable.long_name:  # a body has this name, too
            name = f"joint.{name}"
        if kind in NO_MEANING:
            return NOT_STATED + f"it {NO_MEANING[kind]}"
        if kind == "displacement" and "." in owner:
            if in_body:
                return NOT_STATED + f"{owner}.deflection of motion.nc has an error"
            size = self.of_quantity(f"{owner}.position")
            return size if isinstance(size, str) else 2.0 * size  # of the place now, and of that at the start
        of_element = f"{owner}, von Mises stress"
        size = self.of_quantity(of_element if kind == "von Mises" and of_element in self._rows else name)
        if isinstance(size, str):
            return size
        if variable.dims == ("quaternion",):
            return 0.5 * size  # of the angle
        of_marker = kind in ("velocity", "acceleration") and "." in owner
        return self._with_turn(name, size) if in_body and (of_marker or kind in ("force", "moment")) else size

    def of_quantity(self, name: str) -> float | str:
        """Return the error of one of the budget's quantities in its unit, or why it is not stated."""
        row = self._row(name)
        return row if isinstance(row, str) else row.size

    def share_of_quantity(self, name: str) -> float | str:
        """Return the error of one of the budget's quantities over its value, or why it is not stated."""
        row = self._row(name)
        return row if isinstance(row, str) else row.total

    def _row(self, name: str) -> Row | str:
        if self._budget is None:
            of_mesh = self._run.scene.contact and (", frequency " in name or name.endswith(", mass"))
            return NOT_STATED + (_OF_MESH if of_mesh else why_no_budget(self._run))
        row = self._rows.get(row_name(name))
        if row is None:
            known = name.rpartition(".")[2] in _COMPARED or name in _WHOLE
            return NOT_STATED + "it is nothing but round-off" if known else NOT_COMPARED
        return NOT_STATED + row.why.removeprefix("not estimated: ") if row.why else row

    def _with_turn(self, name: str, size: float) -> float | str:
        """Add what the error of a body's orientation makes of a vector in its axes; a frame that rests has none."""
        owner = name.rpartition(".")[0]
        body = self._run.motion.mechanism.joint_children.get(owner, owner.partition(".")[0])
        turn = self._rows.get(f"{body}.orientation")
        if turn is None:
            return size
        if turn.why:
            return NOT_STATED + turn.why.removeprefix("not estimated: ")
        row = self._rows[name]
        return size + turn.size * max(row.value, row.better)


def why_no_budget(run: Pipeline) -> str:
    """Return why a run has no error budget: it can't have one, or none was asked for."""
    if ERROR_BUDGET.applies(run):
        return NO_BUDGET
    return _CONTACT if run.scene.contact else "a body without a mesh tells nothing of its own error"
