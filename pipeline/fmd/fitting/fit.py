"""Fits of a scene's numbers to measurements, with what these data can tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmd.core.arrays import Array, BoolArray, IntArray
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.fitting import (
    AT_BOUND,
    DETERMINED,
    DOUBTFUL,
    FIRST_PARTS,
    FIT_TOLERANCE,
    MOST_EVALUATIONS,
    POOR_FIT,
    SAME_MODE,
    WHITE,
)
from fmd.core.progress import Monitor, silent
from fmd.fitting.experiments import Experiment
from fmd.fitting.fit_model import FitModel
from fmd.fitting.information import Information, find_information, probability_of, whiteness
from fmd.fitting.measurements import noise_spread
from fmd.fitting.varied import VariedNumber, spread_starts


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


def fit_scene(
    experiments: tuple[Experiment, ...],
    varied: tuple[VariedNumber, ...],
    starts: int = 1,
    monitor: Monitor = silent,
) -> Fit:
    """Fit numbers of a scene to measurements by least squares of the residuals over their noise.

    What the data can tell is found first: a number whose 95 % interval would be wider than ±50 % is refused. Where both
    modes and responses are measured, the first search is by the modes alone: responses have false minima. So have
    histories that swing many times: where more is left of them than noise, they are fitted part by part, too.

    Parameters
    ----------
    experiments : tuple of Experiment
        What is measured, as `read_experiments` reads it.
    varied : tuple of VariedNumber
        Numbers to fit, which start from the scene's values.
    starts : int
        Number of searches: one from the scene's values, others from points of a Latin hypercube between the bounds.

    Raises
    ------
    InputError
        The data can't tell a number, there are no bounds to start between, or shifts take data beyond the motion.
    AccuracyError
        The fit doesn't end, or a motion fails.

    References
    ----------
    Branch, Coleman & Li, A subspace, interior, and conjugate gradient method for large-scale bound-constrained
    minimization problems, SIAM J Sci Comput 21, 1999, as SciPy has it.
    """
    for experiment in experiments:
        experiment.require_times([each for each in varied if each.parameter.clock])
    model = FitModel(experiments, varied, monitor)
    begins = spread_starts(varied, starts)
    unlike = model.unlike_size()
    before = find_information(model.jacobian(begins[0]))
    require_determined(model, before, unlike)
    try:
        tried, stopped = zip(*(_search_from(model, before, begin) for begin in begins), strict=True)
    except AccuracyError as error:
        raise AccuracyError(f"{error}; {unlike}" if unlike else str(error)) from error
    found = sorted((min(each, key=_rank) for each in tried), key=_rank)
    best = found[0]
    if not best.success:
        raise AccuracyError(f"the fit hasn't ended after {best.nfev} evaluations; start nearer, or narrow the bounds")
    ends = [(float(2.0 * each.cost), each.x - 1.0) for each in found]
    evaluations, jacobians = (sum(getattr(one, name) for each in tried for one in each) for name in ("nfev", "njev"))
    why = next((why for each, why in zip(tried, stopped, strict=True) if any(one is best for one in each)), "")
    after = find_information(best.jac)
    return Fit(model, before, after, best.x - 1.0, ends[0][0], evaluations, jacobians, ends, why, unlike)


def _rank(found: Any) -> tuple[bool, float]:
    """Return what the best search has the least of: it has ended, and then its cost."""
    return not found.success, float(found.cost)


def _search_from(model: FitModel, before: Information, begin: Array) -> tuple[list[Any], str]:
    """Return the searches from a start: if the first ends where another minimum may be lower, also those by parts.

    With why these stopped on the way, at a motion that fails or data beyond it: then the first search stands.
    """
    first = _search(model, _start_by_modes(model, begin))
    ended = Fit(model, before, find_information(first.jac), first.x - 1.0, 2.0 * first.cost, first.nfev, first.njev)
    if not ended.doubtful:
        return [first], ""
    try:
        return [first, *_search_by_parts(model, begin)], ""
    except (AccuracyError, InputError) as error:
        return [first], str(error)


def _search_by_parts(model: FitModel, start: Array) -> list[Any]:
    """Fit histories' first part, then longer ones from where that ends: a short one hasn't swung past the minimum.

    Each varies what it tells; the last is that of all. Earlier ones count as evaluations alone, at infinite cost.
    """
    found = []
    for part in FIRST_PARTS:
        rows = model.rows_until(part)
        told = np.flatnonzero(find_information(model.jacobian(start)[rows]).half_widths <= DETERMINED)
        if told.size and np.count_nonzero(rows) > told.size:
            found.append(_search(model, start, told, rows))
            start, found[-1].cost, found[-1].success = found[-1].x - 1.0, np.inf, False
    return [*found, _search(model, start)] if found else []


def _start_by_modes(model: FitModel, start: Array) -> Array:
    """Return a start that fits measured modes, where there are responses too: with what modes tell, others held."""
    modes = tuple(each for each in model.experiments if each.has_modes)
    if not modes or not any(each.has_responses for each in model.experiments):
        return start
    alone = FitModel(modes, model.varied, model.monitor)
    J = alone.jacobian(start)
    told = np.flatnonzero(find_information(J).half_widths <= DETERMINED)
    if not told.size:
        return start
    part = _search(alone, start, told)
    return np.asarray(part.x - 1.0)


def _search(model: FitModel, start: Array, chosen: IntArray | None = None, rows: BoolArray | None = None) -> Any:
    """Search the least squares of all residuals, or some, from a start, by all numbers or chosen ones; from 1."""
    from scipy.optimize import least_squares

    numbers = np.arange(len(start)) if chosen is None else chosen
    kept = np.ones(len(model.residuals(start)), dtype=bool) if rows is None else rows

    def whole(x: Array) -> Array:
        shares = start.copy()
        shares[numbers] = x - 1.0
        return shares

    # SciPy's first steps are as long as the start is from 0, in standard deviations: counted from 1 they are free.
    found = least_squares(
        lambda x: model.residuals(whole(x))[kept],
        start[numbers] + 1.0,
        lambda x: model.jacobian(whole(x))[kept][:, numbers],
        (
            [1.0 + model.varied[k].to_share(model.varied[k].low) for k in numbers],
            [1.0 + model.varied[k].to_share(model.varied[k].high) for k in numbers],
        ),
        x_scale="jac",
        ftol=FIT_TOLERANCE,
        xtol=FIT_TOLERANCE,
        gtol=FIT_TOLERANCE,
        max_nfev=MOST_EVALUATIONS,
    )
    found.x = whole(found.x) + 1.0
    return found


def require_determined(model: FitModel, information: Information, unlike: str = "") -> None:
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
        raise InputError("--to", "", None, f"{mend}; {unlike}" if unlike else mend)
