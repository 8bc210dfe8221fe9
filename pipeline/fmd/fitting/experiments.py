"""Measured histories of a scene's first run, which the scene with other numbers has, too."""

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Protocol

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.core.limits.fitting import CLOCK_DIFFERENCE
from fmd.core.limits.round_off import SUMMED
from fmd.fitting.frozen_run import FrozenMotion, FrozenRun
from fmd.fitting.measurements import MeasuredChannel, Measurements
from fmd.fitting.parameters import Parameter
from fmd.fitting.varied import VariedNumber
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

    def require_times(self, shifts: Sequence[VariedNumber]) -> None:
        """Raise ``InputError`` for shifts of clocks by which histories leave the motion."""

    def predict(self, values: Mapping[Parameter, float]) -> list[Array]:
        """Return what each channel would measure without noise at some numbers [SI]."""

    def slopes(self, values: Mapping[Parameter, float], parameter: Parameter) -> list[Array]:
        """Return the derivatives of that by a number [per SI unit]."""

    def likeness(self, values: Mapping[Parameter, float]) -> Array | None:
        """Return how like the modes that are compared are, by the modal assurance criterion; ``None`` without modes."""


@dataclass
class HistoryExperiment:
    """Measured histories of a scene's first run."""

    run: Pipeline  # stages of the scene as it is computed
    measured: Measurements
    solved: int = 0
    _frozen: dict[bytes, FrozenRun] = field(default_factory=dict)
    _known: dict[tuple[float, ...], FrozenMotion] = field(default_factory=dict)

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
        return self._read(self._motion(values).run, values)

    def slopes(self, values: Mapping[Parameter, float], parameter: Parameter) -> list[Array]:
        """Return the derivatives of the histories by a number, or by a shift of clocks."""
        motion = self._motion(values)
        if parameter.clock:
            early, late = (self._read(motion.run, values, side) for side in (-1.0, 1.0))
            apart = [
                self._times(values, each.name, 1.0) - self._times(values, each.name, -1.0) for each in self.channels
            ]
            rates = [(b - a) / span for a, b, span in zip(early, late, apart, strict=True)]
            moved = [parameter.clock in ("time", channel.name) for channel in self.channels]
            return [rate if moves else 0.0 * rate for rate, moves in zip(rates, moved, strict=True)]
        frozen = self._run(values)
        before = frozen.marches
        both = frozen.beside(motion, parameter)
        self.solved += frozen.marches - before
        sides = zip(self._read(both.low, values), self._read(both.high, values), strict=True)
        return [(b - a) / (2.0 * both.step) for a, b in sides]

    def likeness(self, values: Mapping[Parameter, float]) -> None:
        """Return ``None``: histories have no modes."""

    def _motion(self, values: Mapping[Parameter, float]) -> FrozenMotion:
        key = tuple(values.values())
        if key not in self._known:
            frozen = self._run(values)
            before = frozen.marches
            own = {parameter: value for parameter, value in values.items() if not parameter.clock}
            self._known = {key: frozen.at(own)}
            self.solved += frozen.marches - before
        return self._known[key]

    def _run(self, values: Mapping[Parameter, float]) -> FrozenRun:
        """Return the run with the output times at which histories are read."""
        sides = (-1.0, 0.0, 1.0) if any(parameter.clock for parameter in values) else (0.0,)
        read = [self._times(values, channel.name, side) for channel in self.channels for side in sides]
        times = np.unique(np.concatenate([[0.0], *read]))  # displacements count from the start
        if times.tobytes() not in self._frozen:
            self._frozen = {times.tobytes(): FrozenRun(self.run, times)}
        return self._frozen[times.tobytes()]

    def require_times(self, shifts: Sequence[VariedNumber]) -> None:
        """Raise ``InputError`` for shifts of clocks that are known by no slope, or by which data leave the motion."""
        if shifts and len(self.measured.times) < 2:
            raise InputError("--shift", "", None, f"needs more than {len(self.measured.times)} rows of a history")
        for bounds in ([each.low for each in shifts], [each.high for each in shifts]):
            values = {each.parameter: bound for each, bound in zip(shifts, bounds, strict=True)}
            for channel in self.channels:
                self._times(values, channel.name, 0.0)

    def _times(self, values: Mapping[Parameter, float], name: str, side: float) -> Array:
        """Return the times of the motion at which a channel is read, or a little before or after [s].

        Raises
        ------
        InputError
            They lie outside the motion.
        """
        own, end = self.measured.times, float(self.run.scene.simulation.duration)
        shift = sum(value for parameter, value in values.items() if parameter.clock in ("time", name))
        if not -SUMMED * end <= own[0] + shift or not own[-1] + shift <= end * (1.0 + SUMMED):
            mend = f"moves times from {own[0]:g} s to {own[-1]:g} s beyond the motion, which ends at {end:g} s"
            raise InputError("--shift", name, shift, f"{mend}; leave out rows at both ends, or narrow the bounds")
        little = CLOCK_DIFFERENCE * (own[-1] - own[0]) / max(len(own) - 1, 1)
        return np.asarray(np.clip(own + shift + side * little, 0.0, end))

    def _read(self, other: Pipeline, values: Mapping[Parameter, float], side: float = 0.0) -> list[Array]:
        found, there = [], self._run(values).times
        for channel, result in zip(self.channels, self.measured.results, strict=True):
            chosen = np.searchsorted(there, self._times(values, channel.name, side))
            found.append(result.read(other)[chosen])
        return found
