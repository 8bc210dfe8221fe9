"""Fits of a scene's numbers to measured histories, with what these data can tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.fitting import AT_BOUND, DETERMINED, FIT_TOLERANCE, MOST_EVALUATIONS, POOR_FIT, WHITE
from fmd.fitting.fit_model import FitModel
from fmd.fitting.information import Information, find_information, whiteness
from fmd.fitting.measurements import read_measurements
from fmd.fitting.varied import VariedNumber
from fmd.stages.pipeline import Pipeline


@dataclass(frozen=True)
class Fit:
    """Numbers of a scene that fit measurements best, and how well these tell them.

    Attributes
    ----------
    model : FitModel
        The scene as a function of the numbers.
    before, after : Information
        What the data can tell of them at the scene's own values, and at the fitted ones.
    shares : ndarray, shape (n,)
        The fitted numbers as the fit counts them.
    chi2 : float
        Sum of the squares of the residuals over their noise, priors included.
    evaluations, jacobians : int
        How often results, and their derivatives, were computed.
    """

    model: FitModel
    before: Information
    after: Information
    shares: Array
    chi2: float
    evaluations: int
    jacobians: int

    @property
    def values(self) -> list[float]:
        """The fitted numbers [SI]."""
        return self.model.values(self.shares)

    @property
    def intervals(self) -> list[tuple[float, float]]:
        """Their 95 % intervals [SI]."""
        half = self.after.half_widths
        ends = zip(self.model.values(self.shares - half), self.model.values(self.shares + half), strict=True)
        return [(min(pair), max(pair)) for pair in ends]

    @property
    def at_bounds(self) -> list[bool]:
        """Whether each number has come to one of its bounds."""
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
        """Probability of so large a chi-squared if the model is right and the noise as stated."""
        from scipy.stats import chi2

        return float(chi2.sf(self.chi2, self.n_free))

    @property
    def white(self) -> dict[str, float]:
        """Probability of so large correlations over time of each channel's residuals, by its name, if it is noise."""
        residuals = self.model.residuals(self.shares)[: self.model.n_data]
        channels = self.model.measured.channels
        rows = residuals.reshape(len(channels), -1)
        return {each.channel.name: whiteness(row) for each, row in zip(channels, rows, strict=True)}

    def warnings(self) -> list[dict[str, str]]:
        """Say what makes the intervals too narrow, or the numbers those of the bounds."""
        found = []
        ratio = np.sqrt(self.chi2 / max(self.n_free, 1))
        if self.probability < POOR_FIT:
            text = f"residuals are {ratio:.3g} times the noise: what the model lacks is not in the intervals"
            found.append({"code": "poor-fit", "text": text})
        for name, probability in self.white.items():
            if probability < WHITE:
                text = f"residuals of {name} are not white: the model misses something in it, or its noise isn't white"
                found.append({"code": "not-white", "text": text})
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
                self.after.half_widths,
                self.before.half_widths,
                strict=True,
            )
        ]
        channels = self.model.measured.channels
        noise = [
            {"channel": each.channel.name, "sigma": each.sigma, "unit": each.channel.unit, "estimated": not each.given}
            for each in channels
        ]
        return {
            "parameters": parameters,
            "correlation": self.after.correlation.tolist(),
            "chi2": self.chi2,
            "degrees_of_freedom": self.n_free,
            "probability": self.probability,
            "whiteness": self.white,
            "noise": noise,
            "evaluations": self.evaluations,
            "jacobians": self.jacobians,
            "motions": self.model.marches,
            "warnings": self.warnings(),
        }


def fit_scene(
    run: Pipeline, data: str, varied: tuple[VariedNumber, ...], sigmas: Mapping[str, float] | None = None
) -> Fit:
    """Fit numbers of a scene to measured histories by least squares of the residuals over their noise.

    What the data can tell is found first: a number whose 95 % interval would be wider than ±50 % is refused.

    Parameters
    ----------
    run : Pipeline
        Stages of the scene as it is computed, whose first run's method and steps are frozen.
    data : str
        File of measured histories, as `read_measurements` takes it.
    varied : tuple of VariedNumber
        Numbers to fit, which start from the scene's values.
    sigmas : mapping of str to float, optional
        Standard deviations of the noise by channel [SI]; others are estimated.

    Raises
    ------
    InputError
        The data can't tell a number, or can't be read.
    AccuracyError
        The fit doesn't end, or a motion fails.

    References
    ----------
    Branch, Coleman & Li, A subspace, interior, and conjugate gradient method for large-scale bound-constrained
    minimization problems, SIAM J Sci Comput 21, 1999, as SciPy has it.
    """
    from scipy.optimize import least_squares

    model = FitModel(run, read_measurements(run, data, sigmas or {}), varied)
    start = np.zeros(len(varied))
    before = find_information(model.jacobian(start))
    require_determined(model, before, data)
    # SciPy's first steps are as long as the start is from 0, in standard deviations: counted from 1 they are free.
    found = least_squares(
        lambda x: model.residuals(x - 1.0),
        start + 1.0,
        lambda x: model.jacobian(x - 1.0),
        (
            [1.0 + each.to_share(each.low) for each in varied],
            [1.0 + each.to_share(each.high) for each in varied],
        ),
        x_scale="jac",
        ftol=FIT_TOLERANCE,
        xtol=FIT_TOLERANCE,
        gtol=FIT_TOLERANCE,
        max_nfev=MOST_EVALUATIONS,
    )
    if not found.success:
        raise AccuracyError(f"the fit hasn't ended after {found.nfev} evaluations; start nearer, or narrow the bounds")
    after = find_information(found.jac)
    return Fit(model, before, after, found.x - 1.0, float(2.0 * found.cost), found.nfev, found.njev)


def require_determined(model: FitModel, information: Information, data: str) -> None:
    """Raise ``InputError`` if data can't tell a number to ±50 %; the message names each and what it goes with."""
    keys, lines = [each.parameter.key for each in model.varied], []
    for number, half in enumerate(information.half_widths):
        if half <= DETERMINED:
            continue
        size = f"±{100 * half:.3g} %" if np.isfinite(half) else "not determined"
        partners = " and ".join(keys[k] for k in information.partners(number))
        lines.append(f"{keys[number]} ({size}{f', it goes with {partners}' if partners else ''})")
    if lines:
        mend = (
            f"these data don't determine {', '.join(lines)}. Leave such a number out of --vary, so that it stays as it "
            "is, say what is known of it, e.g. --prior KEY=10%, or measure channels on which it acts"
        )
        raise InputError(data, "", None, mend)
