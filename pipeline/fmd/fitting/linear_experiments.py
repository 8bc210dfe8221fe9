"""Measured small motions of a scene: modes, and frequency responses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError
from fmd.core.limits.fitting import DIFFERENCE
from fmd.fitting.frozen_run import require_like_meshes
from fmd.fitting.measurements import MeasuredChannel
from fmd.fitting.parameters import Parameter, change_parameters
from fmd.fitting.varied import VariedNumber
from fmd.stages.linear_model import LinearModel, linearise_scene
from fmd.stages.pipeline import Pipeline


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
