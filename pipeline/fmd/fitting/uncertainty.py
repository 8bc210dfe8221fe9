"""Uncertainty of results by tolerances of a scene's numbers, and which number most of it comes from."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.fitting import NORMAL_95
from fmd.fitting.frozen_run import FrozenRun
from fmd.fitting.parameters import Parameter
from fmd.fitting.sensitivities import Sensitivity, mean_change
from fmd.output.channels import ResultChannel
from fmd.stages.pipeline import Pipeline


@dataclass(frozen=True)
class Uncertainty:
    """Half-width of a result's 95 % interval by the tolerances of numbers that are independent of each other."""

    channel: ResultChannel
    value: float  # in its SI unit; of a history its root mean square over time, as all below
    shares: Mapping[str, float]  # change of the result by each number's tolerance, to first order, by the numbers' keys
    # (2,): ends of the interval of results of sampled numbers; of a history the root mean square of half its width
    sampled: Array | None = None

    @property
    def half_width(self) -> float:
        """Root of the sum of the squares of all changes (GUM, JCGM 100:2008, section 5.1)."""
        return float(np.sqrt(sum(share**2 for share in self.shares.values())))

    def row(self) -> dict[str, Any]:
        """Return the figures by name; contributions are parts of the variance."""
        half = self.half_width
        return {
            "of": self.channel.name,
            "value": self.value,
            "unit": self.channel.unit,
            "half_width": half,
            "sampled": None if self.sampled is None else [float(x) for x in self.sampled],
            "contributions": {key: (x / half) ** 2 if half else 0.0 for key, x in self.shares.items()},
        }


def combine_tolerances(
    found: Sequence[Sensitivity], tolerances: Mapping[str, float], sampled: Mapping[str, Array] | None = None
) -> list[Uncertainty]:
    """Combine sensitivities with tolerances, relative and of 95 %, of those numbers that have one."""
    results: dict[str, list[Sensitivity]] = {}
    for each in found:
        if each.parameter.key in tolerances:
            results.setdefault(each.channel.name, []).append(each)
    combined = []
    for name, rows in results.items():
        shares = {each.parameter.key: each.change * tolerances[each.parameter.key] for each in rows}
        known = None if sampled is None else sampled[name]
        combined.append(Uncertainty(rows[0].channel, mean_change(rows[0].value), shares, known))
    return combined


def sample_tolerances(
    run: Pipeline,
    channels: Sequence[ResultChannel],
    parameters: Sequence[Parameter],
    tolerances: Mapping[str, float],
    count: int,
) -> dict[str, Array]:
    """Return intervals that hold 95 % of the results of numbers that are drawn from normal distributions.

    Numbers are those of a Latin hypercube of ``count`` scenes (McKay, Beckman & Conover, Technometrics 21, 1979), with
    relative half-widths of 95 % by their keys; method and steps are frozen. Nothing is taken for linear. Each result
    has both ends, (2,), or of a history the root mean square over time of half the width, (1,).
    """
    from scipy.stats import norm
    from scipy.stats.qmc import LatinHypercube

    drawn = norm.ppf(LatinHypercube(len(parameters), rng=np.random.default_rng(0)).random(count)) / NORMAL_95
    frozen, moves = FrozenRun(run), any(channel.moves for channel in channels)
    found: dict[str, list[Array]] = {channel.name: [] for channel in channels}
    for row in drawn:
        sizes = [tolerances[each.key] * each.value for each in parameters]
        values = {each: each.value + x * size for each, x, size in zip(parameters, row.tolist(), sizes, strict=True)}
        other = frozen.at(values, moves).run
        for channel in channels:
            found[channel.name].append(np.asarray(channel.read(other)))
    intervals = {}
    for name, results in found.items():
        low, high = np.quantile(np.array(results), [0.025, 0.975], axis=0)
        intervals[name] = np.array([low, high]) if not low.ndim else np.array([mean_change(0.5 * (high - low))])
    return intervals
