"""Measurements of experiments from tables: histories, modes or frequency responses, by the names of their columns."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.fitting import DIFFERENCE
from fmd.fitting.experiments import Experiment, HistoryExperiment
from fmd.fitting.frozen_run import require_like_meshes
from fmd.fitting.measured_tables import MeasuredTable, read_table
from fmd.fitting.measurements import MeasuredChannel, name_and_unit, read_measurements, unit_factor
from fmd.fitting.parameters import Parameter, change_parameters
from fmd.fitting.varied import VariedNumber
from fmd.output.responses import response_unit
from fmd.scene.reading import suggest_name
from fmd.stages.linear_model import LinearModel, linearise_scene
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


@dataclass
class _LinearExperiment:
    """Measurements that a linear model of a scene about its start shows in their place."""

    run: Pipeline  # stages of the scene as it is computed
    channels: tuple[MeasuredChannel, ...]
    inputs: tuple[str, ...]  # inputs of the linear model, as `linearise_scene` takes them
    outputs: tuple[str, ...]  # outputs of the linear model, likewise
    solved: int = 0
    _known: dict[tuple[float, ...], LinearModel] = field(default_factory=dict)

    in_time = has_modes = has_responses = False

    def predict(self, values: Mapping[Parameter, float]) -> list[Array]:
        """Return what each channel would measure without noise at some numbers [SI]."""
        key = tuple(values.values())
        if key not in self._known:
            self._known = {key: self._linearise(values)}
        return self._read(self._known[key])

    def slopes(self, values: Mapping[Parameter, float], parameter: Parameter) -> list[Array]:
        """Return the derivatives of that by a number, from a central difference; by a shift of a clock 0."""
        if parameter.clock:
            return [np.zeros(channel.values.shape) for channel in self.channels]
        middle = values.get(parameter, parameter.value)
        step = DIFFERENCE * abs(middle)
        low, high = (self._read(self._linearise({**values, parameter: middle + side * step})) for side in (-1.0, 1.0))
        return [(b - a) / (2.0 * step) for a, b in zip(low, high, strict=True)]

    def require_times(self, shifts: Sequence[VariedNumber]) -> None:
        """Do nothing: histories alone have clocks."""

    def likeness(self, values: Mapping[Parameter, float]) -> Array | None:
        """Return ``None``: but modes have one."""
        return None

    def _linearise(self, values: Mapping[Parameter, float]) -> LinearModel:
        self.solved += 1
        other = self.run.variant(change_parameters(self.run.scene, values))
        require_like_meshes(self.run, other, values)
        return linearise_scene(other, self.inputs, self.outputs)

    def _read(self, linear: LinearModel) -> list[Array]:
        raise NotImplementedError


@dataclass
class ModeExperiment(_LinearExperiment):
    """Measured modes: frequencies, damping ratios and shapes."""

    # (n_modes, n_outputs): measured amplitudes of the outputs, by which modes are paired (modal assurance criterion;
    # Allemang & Brown, A correlation coefficient for modal vector analysis, IMAC 1982); without, they are paired in
    # their order
    shapes: Array | None = None
    has_modes = True

    @property
    def axis(self) -> tuple[str, Array]:
        """Numbers of the modes."""
        return "mode", np.arange(1.0, 1.0 + self.channels[0].values.size)

    def likeness(self, values: Mapping[Parameter, float]) -> Array | None:
        """Return the modal assurance criterion of each measured mode and the scene's beside it, (n_modes,)."""
        self.predict(values)
        _, alike = self._pair(self._known[tuple(values.values())])
        return alike

    def _read(self, linear: LinearModel) -> list[Array]:
        numbers, _ = self._pair(linear)
        found = {"frequency": linear.model.poles_hz, "damping": linear.model.damping}
        return [found[channel.name][numbers] for channel in self.channels]

    def _pair(self, linear: LinearModel) -> tuple[IntArray, Array | None]:
        """Return the number of the scene's mode beside each measured one, and how like they are."""
        from scipy.optimize import linear_sum_assignment

        n, there = self.channels[0].values.size, linear.model.poles_hz.size
        if there < n:
            raise AccuracyError(
                f"the scene has {there} oscillating modes, {n} are measured; count more modes of bodies"
            )
        if self.shapes is None:
            return np.arange(n), None
        alike = assurance(self.shapes, _mode_shapes(linear.model))
        rows, columns = linear_sum_assignment(alike, maximize=True)
        return np.asarray(columns, dtype=np.int64), np.asarray(alike[rows, columns])


def assurance(shapes: Array, others: Array) -> Array:
    """Return the modal assurance criterion of shapes (n, n_places) and others (m, n_places), complex too, (n, m)."""
    products = np.abs(shapes.conj() @ others.T) ** 2
    sizes = [(np.abs(each) ** 2).sum(axis=1) for each in (shapes, others)]
    return np.asarray(products / np.maximum(np.outer(*sizes), 1e-300))


def _mode_shapes(model: Any) -> Array:
    """Return the outputs' amplitudes in the oscillating modes by their frequency, complex, (n_modes, n_outputs)."""
    values, vectors = np.linalg.eig(model.A)
    chosen = np.flatnonzero(values.imag > model.slowest_pole)
    order = chosen[np.argsort(np.abs(values[chosen]))]
    return np.asarray((model.C @ vectors[:, order]).T)


@dataclass
class ResponseExperiment(_LinearExperiment):
    """Measured frequency responses: real and imaginary part of each pair, one after the other."""

    frequencies_hz: Array = field(default_factory=lambda: np.zeros(0))  # (n_frequencies,) [Hz]
    pairs: Sequence[tuple[int, int]] = ()  # number of the output and of the input of each response
    has_responses = True

    @property
    def axis(self) -> tuple[str, Array]:
        """Frequencies."""
        return "frequency [Hz]", self.frequencies_hz

    def _read(self, linear: LinearModel) -> list[Array]:
        found = linear.frequency_response(self.frequencies_hz)
        responses = [found[:, output, of] for output, of in self.pairs]
        return [part for response in responses for part in (response.real, response.imag)]
