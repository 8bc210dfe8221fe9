"""Best designs of a scene: the least of a result under limits on others, and what each limit costs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from fmd.core.arrays import Array, BoolArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, InputError, as_input_error
from fmd.core.limits.fitting import ENDLESS, MET, MOST_BANDS, MOST_DESIGNS, OPTIMUM, STATIONARY
from fmd.fitting.designs import Design, DesignSpace
from fmd.fitting.varied import VariedNumber, read_bounds, read_number, require_unit, spread_starts
from fmd.output.channels import find_channels
from fmd.scene.result_names import require_results
from fmd.stages.pipeline import Pipeline

_LIMIT = re.compile(r"\s*(\S+?)\s*(>=|<=)\s*(.+?)\s*")
_BAND = re.compile(r"\s*(\S+)\s+outside\s+(.+?)\s*")


class NoDesignError(AccuracyError):
    """No design that a search came to meets the limits."""


@dataclass(frozen=True)
class Limit:
    """Value that a result of a design must reach, or not exceed."""

    name: str
    sign: int  # 1 if it must reach the bound, -1 if it mustn't exceed it
    bound: float | None  # above 0, in the SI unit; none where the result is but to be told

    @property
    def sense(self) -> str:
        """The sign between the result and its bound."""
        return ">=" if self.sign > 0 else "<="

    @property
    def sides(self) -> tuple[Limit, ...]:
        """Limits of which one is to be met: this one."""
        return (self,)


@dataclass(frozen=True)
class ExcludedBand:
    """Values between which a result of a design mustn't lie, above 0, in the SI unit."""

    name: str
    low: float
    high: float

    @property
    def sides(self) -> tuple[Limit, ...]:
        """Limits of which one is to be met."""
        return Limit(self.name, -1, self.low), Limit(self.name, 1, self.high)


@dataclass(frozen=True)
class Optimum:
    """The best design between bounds, within the limits."""

    space: DesignSpace  # all designs; its first result is what is minimised, the others are those of the limits
    limits: tuple[Limit, ...]
    sign: int  # 1 if the first result is minimised, -1 if it is maximised
    shares: Array  # (n,): the numbers as the search counts them
    beside: tuple[Optimum, ...] = ()  # others on which it rests, whose warnings count

    @property
    def design(self) -> Design:
        """The best design."""
        return self.space.at(self.shares)

    @property
    def start(self) -> Design:
        """The scene's own design."""
        return self.space.at(np.zeros(len(self.shares)))

    @cached_property
    def at_bounds(self) -> Array:
        """1 where a number is at its upper bound, -1 at its lower, 0 between them, shape (n,)."""
        low, high = bounds_of(self.space.varied).T
        near = MET * np.maximum(high - low, 1e-300)
        return np.where(self.shares >= high - near, 1.0, np.where(self.shares <= low + near, -1.0, 0.0))

    @cached_property
    def active(self) -> BoolArray:
        """True for each limit that is met with nothing to spare, shape (n_limits,)."""
        return np.abs(margins(self.design, self.limits)) <= MET

    @cached_property
    def multipliers(self) -> tuple[Array, Array, float]:
        """Lagrange multipliers of the limits (n_limits,) and bounds (n,), and the part of the gradient that is left.

        Of logarithms: those of limits are per cent of the aim per per cent of the bound; 0 where a limit isn't active.
        What is left counts beside the larger gradient, here or at the start: inside all limits there is next to none.
        """
        from scipy.optimize import nnls

        scale = share_scale(self.space.varied, self.design)
        gradient = self.sign * self.design.sensitivities[0] * scale
        signs = np.array([limit.sign for limit in self.limits], dtype=float)[:, None]
        of_limits = (signs * self.design.sensitivities[1:] * scale)[self.active]
        of_bounds = -np.diag(self.at_bounds)[self.at_bounds != 0.0]
        columns = np.concatenate([of_limits, of_bounds]).T
        found, left = nnls(columns, gradient) if columns.size else (np.zeros(0), float(np.linalg.norm(gradient)))
        limits, bounds = np.zeros(len(self.limits)), np.zeros(len(gradient))
        limits[self.active] = found[: len(of_limits)]
        bounds[self.at_bounds != 0.0] = found[len(of_limits) :]
        first = self.start.sensitivities[0] * share_scale(self.space.varied, self.start)
        largest = max(float(np.linalg.norm(gradient)), float(np.linalg.norm(first)), 1e-300)
        return limits, bounds, float(left) / largest

    def warnings(self) -> list[dict[str, str]]:
        """Say where the search has not found a stationary design, and where modes have changed places."""
        found = []
        if (left := self.multipliers[2]) > STATIONARY:
            text = (
                f"{100 * left:.2g} % of the aim's gradient is balanced by no limit: where a largest value changes its "
                "place, or the steps that a run chooses make noise, a search ends early; look around it by fmd sweep"
            )
            found.append({"code": "not-stationary", "text": text})
        for channel, first in zip(self.design.channels, self.start.channels, strict=True):
            if channel.part and channel.mode != first.mode:
                lowest = self.design.run.wholes[channel.part].modes.frequencies_hz[0]
                text = (
                    f"modes have changed places: {first.name} is mode {channel.mode + 1} of the design, whose lowest "
                    f"has {lowest:.6g} Hz; limits on frequency.1, frequency.2 and so on hold for all of them"
                )
                found.append({"code": "modes-crossed", "text": text})
        for other in self.beside:
            name = other.design.channels[0].name
            found += [each | {"text": f"of the best in {name}: {each['text']}"} for each in other.warnings()]
        return found

    def summary(self) -> dict[str, Any]:
        """Return the figures by name."""
        of_limits, _, left = self.multipliers
        design, start = self.design, self.start
        parameters = [
            {
                "key": parameter.key,
                "value": value,
                "unit": parameter.unit,
                "start": parameter.value,
                "at_bound": {1: "upper", -1: "lower"}.get(int(side)),
            }
            for (parameter, value), side in zip(design.values.items(), self.at_bounds, strict=True)
        ]
        results = [
            {
                "name": channel.name,
                "unit": channel.unit,
                "value": _finite(value),
                "start": _finite(before),
                "limit": None if limit is None else limit.bound,
                "must": None if limit is None or limit.bound is None else limit.sense,
                "active": bool(active),
                "per_cent_of_aim": float(limit.sign * multiplier * self.sign) if limit is not None else None,
            }
            for channel, value, before, limit, active, multiplier in zip(
                design.channels,
                design.results,
                start.results,
                (None, *self.limits),
                (False, *self.active),
                (0.0, *of_limits),
                strict=True,
            )
        ]
        return {
            "aim": "minimise" if self.sign > 0 else "maximise",
            "parameters": parameters,
            "results": results,
            "gradient_left": left,
            "designs": self.space.solved,
            "warnings": self.warnings(),
        }


def read_limits(run: Pipeline, texts: Sequence[str]) -> tuple[Limit | ExcludedBand, ...]:
    """Read limits, ``life >= 1e7``, ``frequency.1 >= 40 Hz``, ``frequency.1 outside 40..60 Hz``.

    Raises
    ------
    InputError
        A text isn't of this form, or names no result, or there are too many bands.
    """
    read, found = list[tuple[str, str, str]](), list[Limit | ExcludedBand]()
    for text in texts:
        if match := _LIMIT.fullmatch(text):
            read.append((match[1], match[2], match[3]))
        elif match := _BAND.fullmatch(text):
            read.append((match[1], "outside", match[2]))
        else:
            mend = "must be a result and its bound, e.g. 'frequency.1 >= 40 Hz' or 'frequency.1 outside 40..60 Hz'"
            raise InputError("--subject", "", text, mend)
    bands = [name for name, sense, _ in read if sense == "outside"]
    if len(bands) > MOST_BANDS:
        mend = (
            f"{len(bands)} bands take {2 ** len(bands)} searches; {MOST_BANDS} at most: give sides that are known by >="
        )
        raise InputError("--subject", ", ".join(bands), None, mend)
    require_results(run.scene, [name for name, _, _ in read], "--subject")
    for name, sense, given in read:
        unit = find_channels(run, name, "--subject")[0].unit
        with as_input_error("--subject", name, given):
            require_unit(given.rpartition("..")[2], unit)
        if sense == "outside":
            low, high = read_bounds(name, given, unit, "--subject")
            if not 0.0 < low < high:
                raise InputError("--subject", name, given, "must go from a value above 0 to a higher one")
            found.append(ExcludedBand(name, low, high))
            continue
        with as_input_error("--subject", name, given):
            bound, _ = read_number(given, unit)
        if not bound > 0.0:
            raise InputError("--subject", name, given, "must be above 0")
        found.append(Limit(name, 1 if sense == ">=" else -1, bound))
    return tuple(found)


def optimise_scene(
    run: Pipeline,
    aim: str,
    limits: tuple[Limit | ExcludedBand, ...],
    varied: tuple[VariedNumber, ...],
    sign: int = 1,
    starts: int = 1,
) -> Optimum:
    """Find the least (sign 1), or the largest (-1), of a result above 0 under limits on others.

    The search starts from the scene as the run has it, and others, as `spread_starts` starts them; the best design is
    taken. All numbers that vary have bounds. The method is SciPy's sequential quadratic programming (Kraft, DFVLR-FB
    88-28, 1988).

    Raises
    ------
    InputError
        Bounds are missing, or a name is no such result.
    AccuracyError
        No design that the search came to meets the limits, or one can't be computed.
    """
    for each in varied:
        if not np.isfinite([each.low, each.high]).all() or not each.low * each.high > 0.0:
            mend = f"needs bounds of one sign, --vary {each.parameter.key}=low..high"
            raise InputError("--vary", each.parameter.key, None, mend)
    space = DesignSpace(run, (aim, *(limit.name for limit in limits)), varied)
    return search(space, limits, sign, spread_starts(varied, starts))


def search(space: DesignSpace, limits: tuple[Limit | ExcludedBand, ...], sign: int, starts: Sequence[Array]) -> Optimum:
    """Search the best design from some starts; parameters and errors are those of `optimise_scene`.

    Where results mustn't lie in a band, the best of the designs on either side of it is found: each band doubles the
    number of searches.
    """
    found, missed = [], list[AccuracyError | InputError]()
    for sides, start in product(product(*(limit.sides for limit in limits)), starts):
        try:
            found.append(_search(space, sides, sign, start))
        except (AccuracyError, InputError) as error:
            missed.append(error)
    if len(missed) == 1 and not found:
        raise missed[0]
    if not found:
        where = "from any start" if len(starts) > 1 else "on any side of the band"
        raise NoDesignError(f"no design was found {where}: {'; '.join(map(str, missed))}")
    return min(found, key=lambda optimum: sign * optimum.design.results[0])


def _search(space: DesignSpace, limits: tuple[Limit, ...], sign: int, start: Array) -> Optimum:
    """Search the best design within limits all of which must be met."""
    from scipy.optimize import minimize

    signs = np.array([limit.sign for limit in limits], dtype=float)[:, None]

    def slopes(shares: Array) -> Array:
        design = space.at(shares)
        return design.sensitivities * share_scale(space.varied, design)

    def met_by(shares: Array) -> Array:
        return margins(space.at(shares), limits)

    def slopes_of_limits(shares: Array) -> Array:
        found = signs * slopes(shares)[1:]
        low, high = bounds_of(space.varied).T
        gains = np.abs(found) * np.where(found > 0.0, high - shares, shares - low)
        _require_met(space.at(shares), limits, gains.sum(axis=1), np.abs(found) @ (high - low) <= MET)
        return found

    found = minimize(
        lambda x: sign * float(np.log(space.at(x).results[0])),
        start,
        jac=lambda x: sign * slopes(x)[0],
        bounds=bounds_of(space.varied),
        constraints=[{"type": "ineq", "fun": met_by, "jac": slopes_of_limits}] if limits else [],
        method="SLSQP",
        options={"ftol": OPTIMUM, "maxiter": MOST_DESIGNS},
    )
    optimum = Optimum(space, limits, sign, np.clip(found.x, *bounds_of(space.varied).T))
    _require_met(optimum.design, limits, np.zeros(len(limits)), np.zeros(len(limits), dtype=bool))
    return optimum


def _require_met(design: Design, limits: tuple[Limit, ...], gains: Array, flat: BoolArray) -> None:
    """Raise `NoDesignError` if a limit isn't met, and what margins may gain up to the bounds is next to nothing.

    Where slopes are next to nothing, ``flat``, as halfway between two mirrored designs, the bounds are not to blame.
    """
    known = zip(limits, margins(design, limits), gains, flat, design.results[1:], design.channels[1:], strict=True)
    for limit, margin, gain, is_flat, value, channel in known:
        if margin < -MET and gain <= MET:
            mend = "widen the bounds, ask for less, or start from numbers with which it is met"
            if is_flat:
                mend = "no number that varies changes it there at first: start from others, --starts tries some"
            place = ", ".join(f"{each.key} = {x:.6g} {each.unit}".rstrip() for each, x in design.values.items())
            unit = f" {channel.unit}".rstrip()
            raise NoDesignError(
                f"no design was found with {limit.name} {limit.sense} {limit.bound:.6g}{unit}: the search ended at "
                f"{place}, where it is {value:.6g}{unit}; {mend}"
            )


def margins(design: Design, limits: tuple[Limit, ...]) -> Array:
    """Return by how much limits are met, in logarithms of the bounds, (n_limits,); below 0 if they aren't.

    A result without end, such as a life without damage, counts as many times its bound.
    """
    found = [
        limit.sign * np.log(x / limit.bound) if limit.bound else ENDLESS
        for limit, x in zip(limits, design.results[1:], strict=True)
    ]
    return np.array([min(float(margin), ENDLESS) for margin in found])


def bounds_of(varied: Sequence[VariedNumber]) -> Array:
    """Return the bounds as a search counts them, (n, 2)."""
    return np.array([[each.to_share(each.low), each.to_share(each.high)] for each in varied])


def share_scale(varied: Sequence[VariedNumber], design: Design) -> Array:
    """Return the derivatives of the numbers' logarithms by what a search counts, (n,)."""
    return np.array([each.per_share(x) / x for each, x in zip(varied, design.values.values(), strict=True)])


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
