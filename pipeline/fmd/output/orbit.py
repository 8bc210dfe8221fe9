"""Orbit of a marker: its path in a plane of space, as a picture or as a table."""

from pathlib import Path

import numpy as np

from fmd.core.arrays import Array, BoolArray
from fmd.core.errors import InputError
from fmd.core.files import number_texts, write_table
from fmd.output.error_columns import write_errors
from fmd.output.output_kinds import OutputKind, key_of
from fmd.output.variable_errors import VariableErrors
from fmd.recovery.motion import Motion
from fmd.render.calls import Drawer, draw_here
from fmd.scene.outputs import Orbit
from fmd.stages.pipeline import Pipeline


def draw_orbit(run: Pipeline, output: Orbit, folder: Path, draw: Drawer = draw_here) -> None:
    """Draw the path of a marker by each run."""
    shown = _shown_times(run, output)
    draw(
        "plane_charts.draw_orbits",
        {label: _path(run, output, motion)[shown] for label, motion in run.motions.items()},
        folder / output.file,
        title=output.title or f"{run.scene.title}: path of {output.marker}",
        axes=output.plane,
    )


def write_orbit(run: Pipeline, output: Orbit, folder: Path) -> list[str]:
    """Write the path of a marker by the first run as a table over time, and its error beside it."""
    shown = _shown_times(run, output)
    table = np.column_stack([run.motion.times, _path(run, output, run.motion)])[shown]
    write_table(folder / output.file, ["time [s]", *(f"{axis} [m]" for axis in output.plane)], number_texts(table))
    error = VariableErrors(run).of_quantity(f"{output.marker}.position")
    return [output.file, write_errors([(axis, "m", error) for axis in output.plane], folder / output.file)]


def _shown_times(run: Pipeline, output: Orbit) -> BoolArray:
    """Return which output times an orbit shows; raise ``InputError`` if they are fewer than two."""
    shown = run.motion.times >= output.start
    if shown.sum() < 2:
        message = f"leaves no path: the last output times are {', '.join(f'{t:g} s' for t in run.motion.times[-2:])}"
        raise InputError(run.scene.file, key_of(run, output, "start"), output.start, message)
    return shown


def _path(run: Pipeline, output: Orbit, motion: Motion) -> Array:
    """Return the places of an orbit's marker in its plane, shape (n_times, 2) [m]."""
    body, _, marker = run.division.find_place(output.marker).partition(".")
    places = motion.kinematics.marker_position(run.mechanism.number_of(body), marker)
    return places[:, ["xyz".index(axis) for axis in output.plane]]


KINDS = {"orbit": OutputKind(draw_orbit, write_orbit)}
