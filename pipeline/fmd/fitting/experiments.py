"""Measured histories of a scene's first run, which the scene with other numbers has, too."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from fmd.core.arrays import Array
from fmd.fitting.frozen_run import FrozenMotion, FrozenRun
from fmd.fitting.measurements import MeasuredChannel, Measurements
from fmd.fitting.parameters import Parameter
from fmd.stages.pipeline import Pipeline


class Experiment(Protocol):
    """Measurements on a scene, and what the scene with other numbers would show in their place."""

    @property
    def solved(self) -> int:
        """Number of motions, or of linear models, that have been computed; eight tangents count as one."""

    @property
    def channels(self) -> tuple[MeasuredChannel, ...]:
        """Channels that are measured."""

    @property
    def axis(self) -> tuple[str, Array]:
        """Over what the values are measured: its name with its unit, and its values."""

    @property
    def in_time(self) -> bool:
        """True if values follow each other in time, so that residuals should be white."""

    @property
    def has_modes(self) -> bool:
        """True of measured modes, which a fit starts with."""

    @property
    def has_responses(self) -> bool:
        """True of frequency responses, which have false minima away from the right resonances."""

    def predict(self, values: Mapping[Parameter, float]) -> list[Array]:
        """Return what each channel would measure without noise at some numbers [SI]."""

    def slopes(self, values: Mapping[Parameter, float], parameter: Parameter) -> list[Array]:
        """Return the derivatives of that by a number [per SI unit]."""

    def likeness(self, values: Mapping[Parameter, float]) -> Array | None:
        """Return how like the modes that are compared are, by the modal assurance criterion; ``None`` without modes."""


@dataclass
class HistoryExperiment:
    """Measured histories of a scene's first run.

    Parameters
    ----------
    run : Pipeline
        Stages of the scene as it is computed.
    measured : Measurements
        What is measured.
    """

    run: Pipeline
    measured: Measurements
    _known: dict[tuple[float, ...], FrozenMotion] = field(default_factory=dict)

    def __post_init__(self) -> None:
        times = self.measured.times
        self._first = int(times[0] > 0.0)  # displacements count from the start
        self._frozen = FrozenRun(self.run, np.r_[0.0, times] if self._first else times)

    @property
    def solved(self) -> int:
        """Number of motions that have been computed."""
        return self._frozen.marches

    @property
    def channels(self) -> tuple[MeasuredChannel, ...]:
        """The histories."""
        return self.measured.channels

    @property
    def axis(self) -> tuple[str, Array]:
        """Times."""
        return "time [s]", self.measured.times

    in_time = True
    has_modes = has_responses = False

    def predict(self, values: Mapping[Parameter, float]) -> list[Array]:
        """Return the histories at some numbers [SI]; a motion is computed once."""
        return self._read(self._motion(values).run)

    def slopes(self, values: Mapping[Parameter, float], parameter: Parameter) -> list[Array]:
        """Return the derivatives of the histories by a number."""
        both = self._frozen.beside(self._motion(values), parameter)
        sides = zip(self._read(both.low), self._read(both.high), strict=True)
        return [(b - a) / (2.0 * both.step) for a, b in sides]

    def likeness(self, values: Mapping[Parameter, float]) -> None:
        """Return ``None``: histories have no modes."""

    def _motion(self, values: Mapping[Parameter, float]) -> FrozenMotion:
        key = tuple(values.values())
        if key not in self._known:
            self._known = {key: self._frozen.at(values)}
        return self._known[key]

    def _read(self, other: Pipeline) -> list[Array]:
        return [result.read(other)[self._first :] for result in self.measured.results]
