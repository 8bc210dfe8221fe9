"""A scene as a function of some of its numbers: residuals against measurements, and their Jacobian."""

from collections.abc import Sequence
from dataclasses import field

import numpy as np

from fmd.core.arrays import Array, BoolArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits.fitting import UNLIKE_SIZE
from fmd.core.limits.round_off import SUMMED
from fmd.core.progress import Monitor, silent
from fmd.fitting.experiments import Experiment
from fmd.fitting.measurements import MeasuredChannel
from fmd.fitting.parameters import Parameter
from fmd.fitting.varied import VariedNumber


@dataclass
class FitModel:
    """Residuals of a scene's results against measurements, over their noise."""

    experiments: tuple[Experiment, ...]  # what is measured, and the scene that it is measured on
    varied: tuple[VariedNumber, ...]  # numbers that vary; all else, method and steps too, is frozen
    monitor: Monitor = field(default=silent, repr=False)  # listener to progress

    @property
    def channels(self) -> list[MeasuredChannel]:
        """All that is measured."""
        return [channel for each in self.experiments for channel in each.channels]

    @property
    def solved(self) -> int:
        """Number of motions and of linear models that have been computed."""
        return sum(each.solved for each in self.experiments)

    def residuals(self, shares: Array) -> Array:
        """Return results less measurements over their noise, and priors over theirs, shape (n_residuals,)."""
        values = self._numbers(shares)
        with self.monitor("fit: results"):
            found = [result for each in self.experiments for result in self._try(each, values)]
        pairs = zip(found, self.channels, strict=True)
        apart = [(result - channel.values) / channel.sigma for result, channel in pairs]
        return np.concatenate([*apart, np.asarray(shares)[self._with_prior] / self._priors])

    def jacobian(self, shares: Array) -> Array:
        """Return the residuals' derivatives by what a fit counts, (n_residuals, n_varied)."""
        values, columns = self._numbers(shares), []
        sigmas = [channel.sigma for channel in self.channels]
        with self.monitor("fit: derivatives") as advance:
            for varied in self.varied:
                slopes = [slope for each in self.experiments for slope in each.slopes(values, varied.parameter)]
                scale = varied.per_share(values[varied.parameter])
                columns.append(np.concatenate([slope * scale / s for slope, s in zip(slopes, sigmas, strict=True)]))
                advance(len(columns) / len(self.varied))
        priors = np.diag(1.0 / np.array([each.prior for each in self.varied]))[self._with_prior]
        return np.concatenate([np.column_stack(columns), priors])

    def rows_until(self, share: float) -> BoolArray:
        """Return which residuals belong to the first part of each history, (n_residuals,), priors among them."""
        found = []
        for each in self.experiments:
            at = each.axis[1]
            early = at <= at[0] + share * (at[-1] - at[0]) if each.in_time else np.zeros(len(at), dtype=bool)
            found += [np.resize(early, channel.values.shape) for channel in each.channels]
        return np.concatenate([*found, np.ones(len(self._priors), dtype=bool)])

    def values(self, shares: Sequence[float] | Array) -> list[float]:
        """Return the numbers [SI] of what a fit counts."""
        return [each.from_share(float(share)) for each, share in zip(self.varied, shares, strict=True)]

    def predict(self, shares: Array) -> list[list[Array]]:
        """Return what each experiment would measure without noise, channel by channel."""
        values = self._numbers(shares)
        return [each.predict(values) for each in self.experiments]

    def unlike_size(self) -> str:
        """Return which channel was measured far larger or smaller than the scene has it at first; nothing if none."""
        for experiment, results in zip(self.experiments, self.predict(np.zeros(len(self.varied))), strict=True):
            for channel, result in zip(experiment.channels, results, strict=True):
                values = np.stack([channel.values, result])
                sizes = values.std(axis=1)
                moves = (sizes > SUMMED * np.abs(values).max(axis=1)).all()  # what rests has no size
                if experiment.in_time and moves and sizes.max() > UNLIKE_SIZE * sizes.min():
                    ratio = f"{sizes[0] / sizes[1]:.3g}"
                    return f"{channel.name} varies {ratio} times as much as the scene has it at first: check its unit"
        return ""

    def _numbers(self, shares: Array) -> dict[Parameter, float]:
        return dict(zip([each.parameter for each in self.varied], self.values(shares), strict=True))

    @property
    def _with_prior(self) -> BoolArray:
        return np.array([np.isfinite(each.prior) for each in self.varied])

    @property
    def _priors(self) -> Array:
        return np.array([each.prior for each in self.varied if np.isfinite(each.prior)])

    @staticmethod
    def _try(experiment: Experiment, values: dict[Parameter, float]) -> list[Array]:
        try:
            return experiment.predict(values)
        except AccuracyError as error:
            at = ", ".join(f"{parameter.key} = {value:.6g}" for parameter, value in values.items())
            raise AccuracyError(
                f"the fit came to {at}, where {error}; narrow the bounds or shorten the step"
            ) from error
