"""A scene as a function of some of its numbers: residuals against measurements, and their Jacobian."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fmd.core.arrays import Array, BoolArray
from fmd.core.errors import AccuracyError, StabilityError
from fmd.fitting.frozen_run import FrozenMotion, FrozenRun
from fmd.fitting.measurements import Measurements
from fmd.fitting.varied import VariedNumber
from fmd.stages.pipeline import Pipeline


@dataclass
class FitModel:
    """Residuals of a scene's first run against measurements, over their noise.

    Parameters
    ----------
    run : Pipeline
        Stages of the scene as it is computed.
    measured : Measurements
        What is measured.
    varied : tuple of VariedNumber
        Numbers that vary; all else, method and steps too, is frozen.

    Attributes
    ----------
    marches : int
        Number of motions that have been computed.
    """

    run: Pipeline
    measured: Measurements
    varied: tuple[VariedNumber, ...]
    marches: int = 0
    _known: dict[bytes, FrozenMotion] = field(default_factory=dict)

    def __post_init__(self) -> None:
        times = self.measured.times
        self._first = int(times[0] > 0.0)  # displacements count from the start
        self._frozen = FrozenRun(self.run, np.r_[0.0, times] if self._first else times)

    def histories(self, shares: Array) -> Array:
        """Return the results over the measured times at some numbers, shape (n_channels, n_times), in SI units."""
        return self._read(self._motion(shares).run)

    def residuals(self, shares: Array) -> Array:
        """Return results less measurements over their noise, and priors over theirs, shape (n_residuals,)."""
        scale = np.array([each.sigma for each in self.measured.channels])[:, None]
        apart = (self.histories(shares) / scale).ravel() - self.measured.values
        return np.concatenate([apart, np.asarray(shares)[self._with_prior] / self._priors])

    def jacobian(self, shares: Array) -> Array:
        """Return the residuals' derivatives by what a fit counts, (n_residuals, n_varied)."""
        scale = np.array([each.sigma for each in self.measured.channels])[:, None]
        motion, columns = self._motion(shares), []
        for each in self.varied:
            low, high, step = self._frozen.beside(motion, each.parameter)
            self.marches += 2
            slope = (self._read(high) - self._read(low)) / (2.0 * step)
            columns.append((slope * each.per_share(motion.values[each.parameter]) / scale).ravel())
        priors = np.diag(1.0 / np.array([each.prior for each in self.varied]))[self._with_prior]
        return np.concatenate([np.column_stack(columns), priors])

    @property
    def n_data(self) -> int:
        """Number of measured values."""
        return self.measured.values.size

    def values(self, shares: Sequence[float] | Array) -> list[float]:
        """Return the numbers [SI] of what a fit counts."""
        return [each.from_share(float(share)) for each, share in zip(self.varied, shares, strict=True)]

    @property
    def _with_prior(self) -> BoolArray:
        return np.array([np.isfinite(each.prior) for each in self.varied])

    @property
    def _priors(self) -> Array:
        return np.array([each.prior for each in self.varied if np.isfinite(each.prior)])

    def _motion(self, shares: Array) -> FrozenMotion:
        """Return the scene at some numbers, which is computed once."""
        key = np.asarray(shares, dtype=float).tobytes()
        if key not in self._known:
            values = self.values(shares)
            self.marches += 1
            try:
                motion = self._frozen.at(dict(zip([each.parameter for each in self.varied], values, strict=True)))
            except StabilityError as error:
                at = ", ".join(f"{each.parameter.key} = {x:.6g}" for each, x in zip(self.varied, values, strict=True))
                mend = "narrow the bounds or shorten the step"
                raise AccuracyError(f"the fit came to {at}, where {error}; {mend}") from error
            self._known = {key: motion}
        return self._known[key]

    def _read(self, other: Pipeline) -> Array:
        return np.array([each.channel.read(other)[self._first :] for each in self.measured.channels])
