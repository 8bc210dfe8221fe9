"""Measurements of experiments from tables: histories, modes or frequency responses, by the names of their columns."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.fitting.experiments import Experiment, HistoryExperiment
from fmd.fitting.linear_experiments import ModeExperiment, ResponseExperiment
from fmd.fitting.measured_tables import MeasuredTable, read_table
from fmd.fitting.measurements import MeasuredChannel, name_and_unit, read_measurements, unit_factor
from fmd.output.responses import response_unit
from fmd.scene.reading import suggest_name
from fmd.stages.linear_model import linearise_scene
from fmd.stages.pipeline import Pipeline

RELATIVE = ("frequency", "damping")
"""Channels of modes, whose noise is a share of each value."""

_PART = re.compile(r"(.+?) by (.+?) (real|imaginary)")


def read_experiments(runs: Sequence[tuple[Pipeline, str]], sigmas: Mapping[str, float]) -> tuple[Experiment, ...]:
    """Read experiments, each from a file, as `read_table` takes it, with the stages of the scene that it was made on.

    Channels' noise has standard deviations [SI]; those of ``frequency`` and ``damping`` are relative.

    Raises
    ------
    InputError
        A file can't be read or fits no kind of measurement, or a channel of ``sigmas`` isn't in any.
    """
    tables = [(run, read_table(file)) for run, file in runs]
    found = [_reader(table)(run, table, sigmas) for run, table in tables]
    names = [channel.name for each in found for channel in each.channels]
    for name in sigmas:
        if name not in names and f"{name} real" not in names:
            raise InputError("--sigma", name, None, f"no such channel; {suggest_name(name, names, 'measured are')}")
    return tuple(found)


def _reader(table: MeasuredTable) -> Callable[[Pipeline, MeasuredTable, Mapping[str, float]], Experiment]:
    """Return what reads a table, by its first column and the others' names."""
    if not re.match(r"frequency", table.header[0]):
        return _read_histories
    responds = any(_PART.fullmatch(name_and_unit(table.file, text)[0]) for text in table.header[1:])
    return _read_responses if responds else _read_modes


def _read_histories(run: Pipeline, table: MeasuredTable, sigmas: Mapping[str, float]) -> HistoryExperiment:
    return HistoryExperiment(run, read_measurements(run, table, sigmas))


def _read_modes(run: Pipeline, table: MeasuredTable, sigmas: Mapping[str, float]) -> ModeExperiment:
    """Read a table of modes: frequency, damping ratio if there is one, and amplitudes of the scene's outputs."""
    file, columns = table.file, _columns(table)
    data = {"frequency": columns.pop(next(iter(columns)))}
    if "damping" in columns:
        data["damping"] = columns.pop("damping")
    channels = []
    for name, values in data.items():
        if not (values > 0.0).all():
            raise InputError(file, name, None, "must be above 0 for each mode")
        if name not in sigmas:
            mend = f"has no noise that its values show; give it, e.g. --sigma {name}=0.5%"
            raise InputError(file, name, None, mend)
        unit = "Hz" if name == "frequency" else ""
        channels.append(MeasuredChannel(name, unit, values, sigmas[name] * values, given=True))
    outputs = tuple(columns)
    linearise_scene(run, (), outputs)  # refuses names that are no outputs
    shapes = np.column_stack([*columns.values()]) if outputs else None
    return ModeExperiment(run, tuple(channels), (), outputs, shapes=shapes)


def _read_responses(run: Pipeline, table: MeasuredTable, sigmas: Mapping[str, float]) -> ResponseExperiment:
    """Read a table of frequency responses as ``fmd frf`` writes it; magnitudes and phases are left out."""
    file, columns = table.file, _columns(table)
    frequencies = columns.pop(next(iter(columns)))
    found = {match.groups(): values for name, values in columns.items() if (match := _PART.fullmatch(name))}
    pairs = list(dict.fromkeys((output, of) for output, of, _ in found))
    inputs, outputs = (tuple(dict.fromkeys(pair[k] for pair in pairs)) for k in (1, 0))
    linear = linearise_scene(run, inputs, outputs)
    units = {"in": [unit for _, unit in linear.input_names(as_positions=True)]}
    units["out"] = [channel.unit for channel in linear.model.outputs]
    channels = []
    for output, of in pairs:
        name = f"{output} by {of}"
        unit = response_unit(units["out"][outputs.index(output)], units["in"][inputs.index(of)])
        if name not in sigmas:
            mend = f"has no noise that its values show; give it in SI units, e.g. --sigma '{name}=1e-6'"
            raise InputError(file, name, None, mend)
        for part in ("real", "imaginary"):
            if (output, of, part) not in found:
                raise InputError(
                    file, f"{name} {part}", None, "is missing: a response has a real and an imaginary part"
                )
            channels.append(MeasuredChannel(f"{name} {part}", unit, found[output, of, part], sigmas[name], given=True))
    numbers = [(outputs.index(output), inputs.index(of)) for output, of in pairs]
    return ResponseExperiment(run, tuple(channels), inputs, outputs, frequencies_hz=frequencies, pairs=numbers)


def _columns(table: MeasuredTable) -> dict[str, Array]:
    """Return a table's columns by their names; the first is a frequency in Hz, others are taken in their units."""
    file, header, columns = table
    _, unit = name_and_unit(file, header[0])
    frequency = columns[0] * unit_factor(file, header[0], unit or "Hz", "Hz")
    rest = zip(header[1:], columns[1:], strict=True)
    return {"": frequency, **{name_and_unit(file, text)[0]: values for text, values in rest}}
