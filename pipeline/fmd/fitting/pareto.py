"""Designs of which none is better in two aims at once."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.fitting import MET, SAME_AIM
from fmd.fitting.designs import DesignSpace
from fmd.fitting.optimise import ExcludedBand, Limit, NoDesignError, Optimum, optimise_scene, search
from fmd.fitting.varied import VariedNumber, spread_starts
from fmd.stages.pipeline import Pipeline


def find_front(
    run: Pipeline,
    aims: tuple[tuple[str, int], tuple[str, int]],
    limits: tuple[Limit | ExcludedBand, ...],
    varied: tuple[VariedNumber, ...],
    count: int,
    starts: int = 1,
) -> list[Optimum]:
    """Find designs along the Pareto front of two aims: the best in the first aim, for values of the second.

    Aims are results with 1 if they are minimised or -1 if maximised, of 3 designs at least. Each end is as good in one
    aim as any design, but for `MET`, and of such designs the best in the other. Between both the values have equal
    ratios, and each search starts from the design before it (ε-constraint method; Haimes, Lasdon & Wismer, *IEEE Trans
    Syst Man Cybern* 1, 1971), or the scene's, others as `spread_starts` starts them. Where one fails, on the wrong side
    of a resonance for instance, the rest is searched from the other end.

    Designs come from the end of the first aim to that of the second, which has the warnings of both best designs, too;
    limits of each end come with that of the second aim.

    Raises
    ------
    InputError
        There is no front: one design is the best in both aims.
    AccuracyError
        As `optimise_scene` raises it.
    """
    (first, sign), (second, other) = aims
    loose = Limit(second, -other, None)
    best = optimise_scene(run, first, (*limits, loose), varied, sign, starts)
    last = optimise_scene(run, second, (*limits, Limit(first, -sign, None)), varied, other, starts)
    more = spread_starts(varied, starts)[1:]
    begin = search(last.space, (*limits, Limit(first, -sign, _as_good(best))), other, [best.shares])
    worst, least = float(begin.design.results[0]), _as_good(last)
    if abs(np.log(worst / least)) < SAME_AIM:
        raise InputError("--minimise", second, None, f"has no front with {first}: one design is the best in both")
    bounds = np.geomspace(worst, least, count)
    found, missed = _walk(best.space, limits, loose, sign, [begin.shares, *more], bounds)
    if missed is not None:
        others, missed = _walk(best.space, limits, loose, sign, [last.shares, *more], bounds[len(found) :][::-1])
        found += others[::-1]
    if missed is not None:
        raise missed
    return [*found[:-1], replace(found[-1], beside=(best, last))]


def _walk(
    space: DesignSpace,
    limits: tuple[Limit | ExcludedBand, ...],
    loose: Limit,
    sign: int,
    starts: Sequence[Array],
    bounds: Array,
) -> tuple[list[Optimum], NoDesignError | None]:
    """Return the best designs for bounds of a limit, up to the first that fails.

    The first start of each search is the last one's end.
    """
    found = list[Optimum]()
    shares, *more = starts
    for bound in bounds:
        try:
            found.append(search(space, (*limits, replace(loose, bound=float(bound))), sign, [shares, *more]))
        except NoDesignError as error:
            return found, error
        shares = found[-1].shares
    return found, None


def _as_good(best: Optimum) -> float:
    """Return a bound of the aim of a best design that others which are as good meet, too."""
    return float(best.design.results[0] * np.exp(best.sign * MET))
