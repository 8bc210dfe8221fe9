"""Designs of which none is better in two aims at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmd.core.errors import InputError
from fmd.core.limits.fitting import SAME_AIM
from fmd.fitting.optimise import ExcludedBand, Limit, Optimum, optimise_scene, search
from fmd.fitting.varied import VariedNumber
from fmd.stages.pipeline import Pipeline


def find_front(
    run: Pipeline,
    aims: tuple[tuple[str, int], tuple[str, int]],
    limits: tuple[Limit | ExcludedBand, ...],
    varied: tuple[VariedNumber, ...],
    count: int,
) -> list[Optimum]:
    """Find designs along the Pareto front of two aims: the best in the first aim, for values of the second.

    Between the best designs of each aim alone these values have equal ratios, and each search starts from the design
    before it (ε-constraint method; Haimes, Lasdon & Wismer, *IEEE Trans Syst Man Cybern* 1, 1971).

    Parameters
    ----------
    run, limits, varied
        As `optimise_scene` takes them.
    aims : tuple of tuple
        Results, each with 1 if it is minimised or -1 if it is maximised.
    count : int
        Number of designs, 3 at least.

    Returns
    -------
    list of Optimum
        The first is the best in the first aim alone, the last that in the second. The limits of each end with that of
        the second aim.

    Raises
    ------
    InputError
        There is no front: one design is the best in both aims.
    AccuracyError
        As `optimise_scene` raises it.
    """
    (first, sign), (second, other) = aims
    loose = Limit(second, -other, None)
    begin = optimise_scene(run, first, (*limits, loose), varied, sign)
    last = optimise_scene(run, second, limits, varied, other)
    worst, best = begin.design.results[-1], last.design.results[0]
    if abs(np.log(worst / best)) < SAME_AIM:
        raise InputError("--minimise", second, None, f"has no front with {first}: one design is the best in both")
    found = [begin]
    for bound in np.geomspace(worst, best, count)[1:]:
        own = replace(loose, bound=float(bound))
        found.append(search(begin.space, (*limits, own), sign, found[-1].shares))
    return found
