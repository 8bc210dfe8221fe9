"""Result of a fit of a scene's numbers to measurements: values, intervals, and what speaks against them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.fitting import AT_BOUND, DOUBTFUL, LAGS, NORMAL_95, POOR_FIT, SAME_MODE, STRONG_CORRELATION, WHITE
from fmd.core.limits.rank import DEPENDENT_CONSTRAINT
from fmd.fitting.fit_model import FitModel
from fmd.fitting.measurements import noise_spread


@dataclass(frozen=True)
class Information:
    """Information in residuals with unit noise on the numbers that they depend on."""

    # (n, n): smallest covariance of any unbiased estimate, of which infinite entries of the diagonal aren't determined
    # at all (Cramér–Rao; Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, 1993, chapter 3);
    # between two such entries stands how they go together where residuals stay as they are, from -1 to 1
    covariance: Array

    @property
    def half_widths(self) -> Array:
        """Half-widths of the 95 % intervals, shape (n,)."""
        return NORMAL_95 * np.sqrt(self.covariance.diagonal())

    @property
    def correlation(self) -> Array:
        """Correlations, (n, n); 0 between a number that is determined and one that isn't."""
        whole = np.where(np.isinf(self.covariance), 1.0, self.covariance)
        sizes = np.sqrt(whole.diagonal())
        return np.asarray(whole / np.outer(sizes, sizes))

    def partners(self, number: int) -> list[int]:
        """Return the numbers that are strongly correlated with one, strongest first."""
        sizes = np.abs(self.correlation[number])
        sizes[number] = 0.0
        return [int(k) for k in np.argsort(-sizes) if sizes[k] > STRONG_CORRELATION]


def find_information(J: Array) -> Information:
    """Return the inverse of ``Jᵀ J``, with infinite variances where columns of J depend on each other or are 0.

    J (n_residuals, n) has the derivatives of residuals over their noise.
    """
    sizes = np.linalg.norm(J, axis=0)
    determined = sizes > 0.0
    scaled = J / np.where(determined, sizes, 1.0)
    lacking = max(len(sizes) - len(J), 0)  # fewer residuals than numbers leave directions free
    _, values, V = np.linalg.svd(np.pad(scaled, ((0, lacking), (0, 0))), full_matrices=False)
    kept = values > DEPENDENT_CONSTRAINT * max(values.max(initial=0.0), 1e-300)
    free = V[~kept].T @ V[~kept]
    undetermined = ~determined | (V[~kept] ** 2 > DEPENDENT_CONSTRAINT).any(axis=0)
    alone = np.sqrt(np.where(undetermined, free.diagonal(), 1.0))
    half = V[kept] / values[kept, None]
    covariance = (half.T @ half) / np.outer(np.where(determined, sizes, 1.0), np.where(determined, sizes, 1.0))
    covariance[undetermined, :] = covariance[:, undetermined] = 0.0
    covariance += np.where(np.outer(undetermined, undetermined), free / np.outer(alone, alone), 0.0)
    covariance[undetermined, undetermined] = np.inf
    return Information(covariance)


def probability_of(chi2: float, n_free: int, spread: float) -> float:
    """Return the probability of so large a chi-squared, whose variance is so many times that of known noise."""
    from scipy.stats import chi2 as known
    from scipy.stats import f as ratio

    if n_free < 1 or spread <= 1.0:
        return float(known.sf(chi2, n_free)) if n_free > 0 else 1.0
    return float(ratio.sf(chi2 / n_free, n_free, n_free / (spread - 1.0)))


def whiteness(residuals: Array) -> float:
    """Return the probability that white noise has correlations over time as large as those of residuals (n_times,).

    Ljung & Box, On a measure of lack of fit in time series models, Biometrika 65, 1978.
    """
    from scipy.stats import chi2

    n, apart = len(residuals), residuals - residuals.mean()
    lags = np.arange(1, min(LAGS, n // 4) + 1)
    if not lags.size or not apart.any():
        return 1.0
    r = np.array([apart[lag:] @ apart[:-lag] for lag in lags]) / (apart @ apart)
    return float(chi2.sf(n * (n + 2) * np.sum(r**2 / (n - lags)), len(lags)))


@dataclass(frozen=True)
class Fit:
    """Numbers of a scene that fit measurements best, and how well these tell them."""

    model: FitModel
    before: Information  # what the data can tell of the numbers at the scene's own values
    after: Information  # what the data can tell of them at the fitted values
    shares: Array  # (n,): the fitted numbers as the fit counts them
    chi2: float  # sum of the squares of the residuals over their noise, priors included
    evaluations: int  # how often results were computed
    jacobians: int  # how often their derivatives were computed
    starts: Sequence[tuple[float, Array]] = ()  # chi-squared and the numbers where each start ended, the best first
    stopped: str = ""  # why the search by parts of histories didn't come to its end, where one was needed
    unlike: str = ""  # which history varies far more or less than at the scene's own values

    @property
    def values(self) -> list[float]:
        """The fitted numbers [SI]."""
        return self.model.values(self.shares)

    @property
    def half_widths(self) -> Array:
        """Half-widths of their 95 % intervals as the fit counts them, shape (n,).

        Where the noise of all channels is estimated from them, the residuals tell it, too, and better: where they are
        larger than it, the intervals are wider in proportion.
        """
        if self.n_free < 1 or any(channel.given for channel in self.model.channels):
            return self.after.half_widths
        return self.after.half_widths * max(1.0, float(np.sqrt(self.chi2 / self.n_free)))

    @property
    def intervals(self) -> list[tuple[float, float]]:
        """95 % intervals of the fitted numbers [SI]."""
        half = self.half_widths
        ends = zip(self.model.values(self.shares - half), self.model.values(self.shares + half), strict=True)
        return [(min(pair), max(pair)) for pair in ends]

    @property
    def at_bounds(self) -> list[bool]:
        """True for each number that has come to one of its bounds."""
        found = []
        for varied, share in zip(self.model.varied, self.shares, strict=True):
            ends = np.array([varied.to_share(varied.low), varied.to_share(varied.high)])
            span = np.ptp(ends) if np.isfinite(ends).all() else 1.0
            found.append(bool((np.abs(ends - share) < AT_BOUND * span).any()))
        return found

    @property
    def n_free(self) -> int:
        """Degrees of freedom of chi-squared: residuals, priors included, less numbers."""
        return len(self.model.residuals(self.shares)) - len(self.shares)

    @property
    def probability(self) -> float:
        """Probability of so large a chi-squared if the model is right and the noise as stated.

        It is 1 without degrees of freedom: as many numbers as values fit anything.
        """
        spreads = [np.full(len(each.values), 1.0 if each.given else noise_spread()) for each in self.model.channels]
        return probability_of(self.chi2, self.n_free, float(np.concatenate(spreads).mean()))

    @property
    def white(self) -> dict[str, float]:
        """Probability of so large correlations over time of each channel's residuals, by its name, if it is noise."""
        found: dict[str, float] = {}
        for experiment, results in zip(self.model.experiments, self.model.predict(self.shares), strict=True):
            if experiment.in_time:
                for channel, result in zip(experiment.channels, results, strict=True):
                    white = whiteness(result - channel.values)
                    found[channel.name] = min(white, found.get(channel.name, 1.0))
        return found

    @property
    def doubtful(self) -> bool:
        """True if residuals of histories are so large that another minimum may be lower.

        Chi-squared shows it where the noise is given. Noise that is estimated from swift histories may be too large, so
        that chi-squared isn't; correlations show it then.
        """
        white = self.white
        estimated = [white[each.name] for each in self.model.channels if not each.given and each.name in white]
        return bool(white) and min([self.probability, *estimated]) < DOUBTFUL

    @property
    def likeness(self) -> dict[str, list[float]]:
        """How like measured modes and the fitted scene's are, by the modal assurance criterion, by the experiment."""
        values = dict(zip([each.parameter for each in self.model.varied], self.values, strict=True))
        found = [each.likeness(values) for each in self.model.experiments]
        return {str(k): [float(x) for x in each] for k, each in enumerate(found, start=1) if each is not None}

    def warnings(self) -> list[dict[str, str]]:
        """Say what makes the intervals too narrow, or the numbers those of the bounds."""
        found = []
        ratio = np.sqrt(self.chi2 / max(self.n_free, 1))
        if self.probability < POOR_FIT:
            text = f"residuals are {ratio:.3g} times the noise: what the model lacks is not in the intervals"
            found.append({"code": "poor-fit", "text": text})
        if self.n_free < 1:
            text = "there are no more values than numbers: that they fit says nothing of the model"
            found.append({"code": "no-freedom", "text": text})
        for name, probability in self.white.items():
            if probability < WHITE:
                text = f"residuals of {name} are not white: the model misses something in it, or its noise isn't white"
                if len(self.starts) < 2:
                    text += ", or another minimum is lower, which --starts 6 looks for"
                found.append({"code": "not-white", "text": text})
        if self.unlike:
            found.append({"code": "unlike-size", "text": self.unlike})
        if self.stopped:
            text = f"another minimum may be lower: the search by parts of the histories stopped, {self.stopped}"
            found.append({"code": "parts-stopped", "text": text})
        for alike in self.likeness.values():
            for number, value in enumerate(alike, start=1):
                if value < SAME_MODE:
                    text = (
                        f"measured mode {number} is like none of the scene's (modal assurance criterion {value:.2g}): "
                        "leave it out, or check places and signs of its shape"
                    )
                    found.append({"code": "unlike-mode", "text": text})
        for varied, at_bound in zip(self.model.varied, self.at_bounds, strict=True):
            if at_bound:
                text = f"{varied.parameter.key} is at its bound, and its interval is that without bounds"
                found.append({"code": "at-bound", "text": text})
        return found

    def summary(self) -> dict[str, Any]:
        """Return the figures by name."""
        parameters = [
            {
                "key": varied.parameter.key,
                "value": value,
                "unit": varied.parameter.unit,
                "interval": [*interval],
                "at_bound": at_bound,
                "start": varied.parameter.value,
                "share": float(half),
                "share_at_start": float(before) if np.isfinite(before) else None,
            }
            for varied, value, interval, at_bound, half, before in zip(
                self.model.varied,
                self.values,
                self.intervals,
                self.at_bounds,
                self.half_widths,
                self.before.half_widths,
                strict=True,
            )
        ]
        noise = [
            {"channel": each.name, "sigma": each.noise[0], "unit": each.noise[1], "estimated": not each.given}
            for each in self.model.channels
        ]
        return {
            "parameters": parameters,
            "correlation": self.after.correlation.tolist(),
            "chi2": self.chi2,
            "degrees_of_freedom": self.n_free,
            "probability": self.probability,
            "whiteness": self.white,
            "assurance": self.likeness,
            "noise": noise,
            "evaluations": self.evaluations,
            "jacobians": self.jacobians,
            "motions": self.model.solved,
            "starts": [{"chi2": chi2, "values": self.model.values(shares)} for chi2, shares in self.starts],
            "warnings": self.warnings(),
        }
