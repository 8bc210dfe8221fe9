"""Histories of chosen quantities as NetCDF, CSV or charts, and tables of their extremes."""

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fmd.accuracy.details import named_markers
from fmd.accuracy.missed_peaks import UNSOUGHT, MissedPeak, find_missed_peaks
from fmd.accuracy.requested_stress import StressPlace, stress_at_elements, stress_at_nodes
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.files import number_texts, whole_file, write_table
from fmd.core.limits.recovery import MISSED_PEAK
from fmd.core.limits.round_off import SUMMED
from fmd.core.limits.shown import DIGITS, HARDLY_MOVES
from fmd.core.netcdf import write_netcdf
from fmd.dynamics.kinematics import Kinematics
from fmd.output.error_columns import write_errors
from fmd.output.output_kinds import OutputKind
from fmd.output.stress_warnings import say_missed, say_output_step
from fmd.output.variable_errors import VariableErrors
from fmd.recovery.motion import Motion
from fmd.recovery.motion_file import OF_FORMULA, Variable, gather_runs, gear_variables
from fmd.recovery.quantities import coordinate_variables, energy_variables, marker_variables, reaction_variables
from fmd.recovery.stress import stress_measure
from fmd.render.calls import Drawer, draw_here
from fmd.render.chart_data import HistoryFrame
from fmd.scene.histories import ExtremesTable, History, Quantities
from fmd.stages.mechanism import add_observer
from fmd.stages.pipeline import Pipeline


def write_history(run: Pipeline, output: History, folder: Path) -> list[str]:
    """Write the file of a history into a folder, of a table of columns their errors beside it, and return the names."""
    errors = partial(VariableErrors(run).of, in_body=output.axes == "body")
    if output.file.endswith(".nc"):
        runs = {label: history_variables(run, output, motion) for label, motion in run.motions.items()}
        data, coordinates = gather_runs(run.motion.times, runs, errors)
        used = {dim for variable in data for dim in variable.dims}
        with whole_file(folder / output.file) as part:
            write_netcdf(part, [*(axis for axis in coordinates if axis.name in used), *data])
        return [output.file]
    columns = list(number_columns(history_variables(run, output, run.motion)))
    header = ["time [s]", *(f"{name} [{variable.units}]" for variable, name, _ in columns)]
    table = np.column_stack([run.motion.times, *(values for *_, values in columns)])
    write_table(folder / output.file, header, number_texts(table))
    stated = [(name, variable.units, errors(variable)) for variable, name, _ in columns]
    return [output.file, write_errors(stated, folder / output.file)]


def draw_history(run: Pipeline, output: History, folder: Path, draw: Drawer = draw_here) -> None:
    """Draw the quantities of a history over the first run, a frame each, with their stated errors."""
    errors, peaks, frames = VariableErrors(run), missed_peaks(run), []
    for variable in _leave_out_round_off(history_variables(run, output, run.motion)):
        columns = variable.values.reshape(len(variable.values), -1)
        moving = np.ptp(columns, axis=0) > HARDLY_MOVES * np.ptp(columns, axis=0).max()
        chosen = np.flatnonzero(moving) if moving.any() else np.arange(columns.shape[1])
        components = tuple(_names_of(variable, columns.shape[1])[k] for k in chosen.tolist())
        error = errors.of(variable, in_body=output.axes == "body") if errors.has_budget else ""
        stated = error if isinstance(error, float) else None
        missed = peaks[variable.name].part if variable.name in peaks else 0.0
        beyond = f": {say_missed(missed)}" if missed > MISSED_PEAK else ""
        frames.append(HistoryFrame(variable.name + beyond, variable.units, columns[:, chosen], components, stated))
    title = output.title or f"{run.scene.title}: {Path(output.file).stem}"
    draw("charts.draw_histories", run.motion.times, frames, folder / output.file, title=title)


def _leave_out_round_off(variables: Sequence[Variable]) -> list[Variable]:
    """Return the variables that aren't round-off beside others of their joint or marker, as moments of a hinge are.

    A coordinate that stays at zero isn't left out: it says so.
    """
    largest: dict[str, float] = {}
    for variable in variables:
        largest[_owner(variable)] = max(largest.get(_owner(variable), 0.0), float(np.abs(variable.values).max()))
    return [variable for variable in variables if np.abs(variable.values).max() >= SUMMED * largest[_owner(variable)]]


def _owner(variable: Variable) -> str:
    """Return what has a variable beside others: of a formula or a coordinate itself."""
    owner, _, what = variable.name.rpartition(".")
    of_itself = variable.units == OF_FORMULA or (owner and "." not in owner and what not in ("force", "moment"))
    return variable.name if of_itself else owner


def missed_peaks(run: Pipeline) -> dict[str, MissedPeak]:
    """Return what histories and tables of a run miss of their variables between output times, by name."""

    def variables_of(motion: Motion) -> Iterator[Variable]:
        for output in run.scene.output:
            if isinstance(output, Quantities):
                yield from history_variables(run, output, motion)

    return find_missed_peaks(run, variables_of)


def missed_peak_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Return a warning where a history or table misses a peak between output times, of that which misses most."""
    outputs = [output for output in run.scene.output if isinstance(output, Quantities)]
    peaks = missed_peaks(run) if outputs else {}
    if outputs and not peaks:
        return [UNSOUGHT]
    missed = [
        (peaks[each.name].part, each.name, output.file)
        for output in outputs
        for each in _leave_out_round_off(history_variables(run, output, run.motion))
    ]
    part, name, file = max(missed, default=(0.0, "", ""))
    if part <= MISSED_PEAK:
        return []
    text = f"{file}: {name} {say_output_step(run, peaks[name])}"
    return [{"code": "coarse-output-times", "text": text}]


def write_extremes(run: Pipeline, output: ExtremesTable, folder: Path) -> None:
    """Write a table of extremes into a folder."""
    rows = extremes(run, output)
    write_table(folder / output.file, [*rows[0]], ([_text(x) for x in row.values()] for row in rows))


def summarise_extremes(run: Pipeline, output: ExtremesTable) -> dict[str, dict[str, Any]]:
    """Return the rows of a table of extremes."""
    return {"tables": {output.file: extremes(run, output)}}


def extremes(run: Pipeline, output: Quantities) -> list[dict[str, Any]]:
    """Return the smallest and the largest value of each number over the first run's output times, and when, in SI.

    A vector has a row for its size, too. None of the values is off by more than the error, the largest over time.
    """
    rows, times = [], run.motion.times
    errors = partial(VariableErrors(run).of, in_body=output.axes == "body")
    for variable, name, values in number_columns(history_variables(run, output, run.motion), with_sizes=True):
        low, high = int(values.argmin()), int(values.argmax())
        rows.append(
            {
                "quantity": name,
                "unit": variable.units,
                "smallest": float(values[low]),
                "smallest_at_s": float(times[low]),
                "largest": float(values[high]),
                "largest_at_s": float(times[high]),
                "mean": float(values.mean()),
                "rms": float(np.sqrt((values**2).mean())),
                "error": error if isinstance(error := errors(variable), float) else None,
                "why": error if isinstance(error, str) else "",
            }
        )
    return rows


def history_variables(run: Pipeline, output: Quantities, motion: Motion) -> list[Variable]:
    """Return the variables of a history over one motion, in the order of its quantities.

    Raises
    ------
    InputError
        A node's number is beyond those of its body, or no joint has what is wanted.
    """
    found: list[Variable] = []
    in_body = output.axes == "body"
    for quantity in output.quantities:
        if quantity in ("joint_position", "joint_rate"):
            joints = output.joints or tuple(run.scene.joint)
            found += coordinate_variables(motion, joints, rates=quantity == "joint_rate")
        elif quantity == "joint_reaction":
            found += reaction_variables(motion, output.joints or tuple(run.scene.joint), in_body)
        elif quantity == "gear_mesh":
            found += gear_variables(motion)
        elif quantity == "energy":
            found += energy_variables(motion)
        elif quantity == "element_stress":
            found += _stresses(run, output, stress_at_elements(run, output.elements), motion)
        elif quantity == "node_stress":
            found += _stresses(run, output, stress_at_nodes(run, output.nodes), motion)
        else:
            found += marker_variables(motion, quantity, output.markers or named_markers(motion), in_body)
    for name, text in output.formulas.items():
        found.append(Variable(name, formula_history(run, text, motion), (), OF_FORMULA, text))
    if not found:
        problem = "holds nothing: no joint of the scene has a coordinate; 'joint_reaction' works"
        raise InputError(run.scene.file, "output.quantities", list(output.quantities), problem)
    return found


def formula_history(run: Pipeline, text: str, motion: Motion) -> Array:
    """Return a formula of a motion in SI units, shape (n_times,)."""
    mechanism = add_observer(run.divided_scene, run.bodies, motion.mechanism, [text], motion.known)
    observed = Kinematics(mechanism, motion.times, motion.trajectory.q, motion.trajectory.v)
    return observed.effort(mechanism.controllers[-1].measured[0])


def _stresses(run: Pipeline, output: Quantities, places: dict[str, StressPlace], motion: Motion) -> Iterator[Variable]:
    """Yield components of stress over a motion at named places."""
    for name, place in places.items():
        tensors = place.over(run, motion)[None]
        for component in output.components:
            text = f"{component} stress in {name}"
            yield Variable(f"{name}.{component}", stress_measure(component)(tensors)[0], (), "Pa", text)


def _text(value: float | str | None) -> str:
    return "" if value is None else f"{value:.{DIGITS}g}" if isinstance(value, float) else value


def number_columns(variables: Iterable[Variable], with_sizes: bool = False) -> Iterator[tuple[Variable, str, Array]]:
    """Yield variable, name and values (n_times,) of each number, and with them the sizes of vectors."""
    for variable in variables:
        values = variable.values.reshape(len(variable.values), -1)
        if not variable.dims:
            yield variable, variable.name, values[:, 0]
            continue
        for name, column in zip(_names_of(variable, values.shape[1]), values.T, strict=True):
            yield variable, f"{variable.name}.{name}", column
        if with_sizes and variable.dims == ("axis",):
            yield variable, f"{variable.name}.size", np.asarray(np.linalg.norm(values, axis=1))


def _names_of(variable: Variable, count: int) -> tuple[str, ...]:
    """Return the names of a variable's components."""
    known = {"axis": "xyz", "quaternion": "xyzw"}.get(variable.dims[0], "") if variable.dims else ""
    return tuple(known) or tuple(str(k + 1) for k in range(count))


KINDS = {
    "history": OutputKind(draw=draw_history, write=write_history, charted=True),
    "table": OutputKind(write=write_extremes, summarise=summarise_extremes),
}
