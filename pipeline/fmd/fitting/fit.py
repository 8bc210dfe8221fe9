"""Fits of a scene's numbers to measurements, with what these data can tell."""

from typing import Any

import numpy as np

from fmd.core.arrays import Array, BoolArray, IntArray
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.fitting import DETERMINED, FIRST_PARTS, FIT_TOLERANCE, MOST_EVALUATIONS
from fmd.core.progress import Monitor, silent
from fmd.fitting.experiments import Experiment
from fmd.fitting.fit_model import FitModel
from fmd.fitting.fit_result import Fit, Information, find_information
from fmd.fitting.varied import VariedNumber, spread_starts


def fit_scene(
    experiments: tuple[Experiment, ...],
    varied: tuple[VariedNumber, ...],
    starts: int = 1,
    monitor: Monitor = silent,
) -> Fit:
    """Fit numbers of a scene to measurements by least squares of the residuals over their noise.

    What the data can tell is found first: a number whose 95 % interval would be wider than ±50 % is refused. Where both
    modes and responses are measured, the first search is by the modes alone: responses have false minima. So have
    histories that swing many times: where more is left of them than noise, they are fitted part by part, too. One of
    ``starts`` searches is from the scene's values, others are from points of a Latin hypercube between the bounds. The
    method is SciPy's of Branch, Coleman & Li, SIAM J Sci Comput 21, 1999.

    Raises
    ------
    InputError
        The data can't tell a number, there are no bounds to start between, or shifts take data beyond the motion.
    AccuracyError
        The fit doesn't end, or a motion fails.
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
