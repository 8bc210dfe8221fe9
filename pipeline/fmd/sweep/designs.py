"""Ranges of values, and designs that sample them: Latin hypercubes and random points."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.scene import MOST_POINTS, RANGE_DIGITS

Design = Literal["latin-hypercube", "random"]

_VALUE = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"({_VALUE})\s*\.\.\s*({_VALUE})(?::(\d+))?\s*([^:\d\s][^:]*?)?(\s+log)?")


@dataclass(frozen=True)
class Range:
    """A range of values as ``100..400:8 N/m`` gives it, or ``1..1000:7 N/m log`` with equal ratios."""

    low: float  # its ends, both of them values
    high: float  # its ends, both of them values
    count: int  # number of values; 0 for a range that a design samples
    unit: str  # unit of all values, or empty
    logarithmic: bool  # true if values have equal ratios

    def at(self, shares: Array) -> tuple[str, ...]:
        """Return values at shares of the way from the low end (0) to the high one (1)."""
        ends = np.array([self.low, self.high])
        low, high = np.log(ends) if self.logarithmic else ends
        values = low + shares * (high - low)
        values = np.exp(values) if self.logarithmic else values
        return tuple(f"{value:.{RANGE_DIGITS}g} {self.unit}".strip() for value in values)

    @property
    def values(self) -> tuple[str, ...]:
        """Values of the range, evenly spaced, both ends among them."""
        return self.at(np.linspace(0.0, 1.0, self.count))


def parse_range(text: str) -> Range | None:
    """Read a range such as ``100..400:8 N/m``; ``None`` for a text that is none.

    Raises
    ------
    ValueError
        Its ends or its number of values make no range.
    """
    match = _RANGE.fullmatch(text.strip())
    if match is None:
        return None
    low, high, count = float(match[1]), float(match[2]), int(match[3] or 0)
    unit, logarithmic = (match[4] or "").strip(), bool(match[5])
    if unit == "log":
        unit, logarithmic = "", True
    if not low < high < float("inf"):
        raise ValueError("must go from a lower to a higher value")
    if match[3] is not None and not 2 <= count <= MOST_POINTS:
        raise ValueError(f"must have 2 to {MOST_POINTS} values")
    if logarithmic and low <= 0.0:
        raise ValueError("has equal ratios, so its ends must be above 0")
    return Range(low, high, count, unit, logarithmic)


def sample_ranges(ranges: Sequence[Range], design: Design, points: int, seed: int) -> list[tuple[str, ...]]:
    """Return the values of each range, shape (n_ranges, points), at the points of a design.

    A Latin hypercube (McKay, Beckman & Conover, Technometrics 21, 1979) has one point in each of ``points`` equal parts
    of every range.
    """
    if design == "random":
        shares = np.random.default_rng(seed).random((points, len(ranges)))
    else:
        from scipy.stats.qmc import LatinHypercube

        shares = LatinHypercube(len(ranges), seed=seed).random(points)
    return [one.at(column) for one, column in zip(ranges, shares.T, strict=True)]


def require_points(points: int) -> None:
    """Raise ``InputError`` unless a design can have so many points."""
    if not 2 <= points <= MOST_POINTS:
        raise InputError("--points", "", points, f"must be 2 to {MOST_POINTS}")
