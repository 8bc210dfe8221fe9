"""Information of data on numbers: bounds of their errors, correlations, and tests of residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.fitting import LAGS, NORMAL_95, STRONG_CORRELATION
from fmd.core.limits.rank import DEPENDENT_CONSTRAINT


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
