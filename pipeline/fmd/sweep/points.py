"""Points of a sweep: keys of the scene with the values or ranges that they take, and the scene at each combination.

Ranges are sampled by Latin hypercubes or random points.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from fmd.core.arrays import Array
from fmd.core.cache import stage_key
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError, as_input_error
from fmd.core.limits.memory import MOST_TABLES
from fmd.core.limits.scene import MOST_POINTS, RANGE_DIGITS
from fmd.core.recently_used import RecentlyUsed
from fmd.scene.reading import SceneTable
from fmd.scene.scene import Scene, SceneReader
from fmd.scene.source_files import digest_files
from fmd.scene.variants import with_first_run

_VARY = "--vary"
_OPENING, _CLOSING, _QUOTES = "[{(", "]})", "\"'"


@dataclass(frozen=True)
class Variation:
    """A key of the scene, dotted as for ``--set``, with its values as text, of a logarithmic range or not."""

    key: str
    values: tuple[str, ...]
    logarithmic: bool = False


@dataclass(frozen=True)
class Point:
    """One combination of values, with its scene or the reason why there is none."""

    values: tuple[str, ...]  # one for each varied key
    scene: Scene | None  # the scene with these values; ``None`` if it is refused
    key: str = ""  # digest of the scene, its files and the sources that compute it; empty if it is refused
    refusal: str = ""  # the reason, if it is refused
    left_out: int = 0  # number of the scene's runs that the point doesn't have


def parse_variations(texts: Sequence[str]) -> tuple[Variation, ...]:
    """Parse texts like ``simulation.step=1us,2us`` or ``joint.hinge.spring=1..4:7 N m/rad``, a range of values.

    A comma within brackets or quotes belongs to its value.

    Raises
    ------
    InputError
        A text isn't of this form, or a key or value is given twice.
    """
    variations: list[Variation] = []
    for text in texts:
        key, equals, given = (part.strip() for part in text.partition("="))
        parts = [part.strip() for part in split_at_commas(given)]
        if not key or not equals or not all(parts):
            raise InputError(_VARY, "", text, "must look like simulation.step=1us,2us,5us or simulation.step=1..5:9 us")
        ranges = [(part, _parse_range(key, part)) for part in parts]
        values = tuple(value for part, found in ranges for value in _expand(key, part, found))
        if len(set(values)) < len(values):
            raise InputError(_VARY, key, given, "has a value twice")
        if any(other.key == key for other in variations):
            raise InputError(_VARY, key, given, "is varied twice; give all its values in one list")
        variations.append(Variation(key, values, any(found is not None and found.logarithmic for _, found in ranges)))
    if not variations:
        raise InputError(_VARY, "", None, "is missing: what to vary, e.g. --vary simulation.step=1us,2us,5us")
    return tuple(variations)


def sample_variations(texts: Sequence[str], design: Design, points: int, seed: int) -> tuple[Variation, ...]:
    """Parse texts like ``joint.hinge.spring=1..4 N m/rad``, and take the values at the points of a design.

    Raises
    ------
    InputError
        A text is no range, a key is given twice, or there are too few or too many points.
    """
    require_points(points)
    ranges: dict[str, Range] = {}
    for text in texts:
        key, _, given = (part.strip() for part in text.partition("="))
        found = _parse_range(key, given)
        if found is not None and found.count:
            mend = f"counts its own values, where --design takes --points of all ranges: leave out :{found.count}"
            raise InputError(_VARY, key, given, mend)
        if not key or found is None or key in ranges:
            raise InputError(_VARY, "", text, "must be the only range of its key, like joint.hinge.spring=1..4 N m/rad")
        ranges[key] = found
    samples = sample_ranges([*ranges.values()], design, points, seed)
    pairs = zip(ranges.items(), samples, strict=True)
    return tuple(Variation(key, values, own.logarithmic) for (key, own), values in pairs)


def choose_values(
    texts: Sequence[str], design: Design | None, points: int | None, seed: int
) -> tuple[tuple[Variation, ...], list[tuple[str, ...]]]:
    """Parse what is varied, and return it with the combinations of values: all of them, or the points of a design."""
    if (design is None) != (points is None):
        raise InputError("--design", "", design, "goes with --points: give both or none")
    if design is None or points is None:
        variations = parse_variations(texts)
        return variations, combine(variations)
    variations = sample_variations(texts, design, points, seed)
    return variations, list(zip(*(variation.values for variation in variations), strict=True))


def _parse_range(key: str, text: str) -> Range | None:
    with as_input_error(_VARY, key, text):
        return parse_range(text)


def _expand(key: str, text: str, found: Range | None) -> tuple[str, ...]:
    """Return the values that a part of a list gives: itself, or those of the range that was found in it."""
    if found is not None and not found.count:
        raise InputError(
            _VARY, key, text, f"needs a number of values, like {found.low:g}..{found.high:g}:8, or --design"
        )
    return (text,) if found is None else found.values


def combine(variations: Sequence[Variation]) -> list[tuple[str, ...]]:
    """Return all combinations of values, the last key varying fastest.

    Raises
    ------
    InputError
        There are too many.
    """
    count = math.prod(len(v.values) for v in variations)
    if count > MOST_POINTS:
        raise InputError(_VARY, "", None, f"makes {count} points; at most {MOST_POINTS} in one sweep")
    return list(itertools.product(*(v.values for v in variations)))


def make_points(
    scene: str | Path,
    variations: Sequence[Variation],
    overrides: Sequence[str] = (),
    combinations: Sequence[tuple[str, ...]] | None = None,
    all_runs: bool = True,
) -> list[Point]:
    """Load the scene at combinations of values, all of them by default; with all of its runs, or the first alone.

    Raises
    ------
    InputError
        There is no such scene, or it is refused at every point; the message is that of the first.
    """
    points: list[Point] = []
    first: InputError | None = None
    reader = SceneReader(scene)
    for values in combine(variations) if combinations is None else combinations:
        try:
            own = [f"{v.key}={x}" for v, x in zip(variations, values, strict=True)]
            given = reader.load([*overrides, *own])
            loaded = given if all_runs else with_first_run(given)
            left_out = len(given.simulation.run) - len(loaded.simulation.run) if given.moves else 0
            points.append(Point(values, loaded, point_key(loaded), left_out=left_out))
        except InputError as error:
            refused = _naming_vary(error, variations)
            first = first or refused
            points.append(Point(values, None, refusal=str(refused)))
    if first is not None and all(point.scene is None for point in points):
        raise first
    return points


def point_key(scene: Scene) -> str:
    """Return the key of a scene's results: a digest of the scene, its files, the sources and packages.

    Raises
    ------
    InputError
        A file isn't there.
    """
    inputs = {"scene": {name: _digest(getattr(scene, name)) for name in type(scene).model_fields}}
    inputs["files"] = digest_files(scene)
    return stage_key("point", inputs, ("fmd", "fmd/meshes"), ("gmsh", "llvmlite", "numpy", "scikit-fem", "scipy"))


# Scenes of a sweep share the tables that aren't varied. By number, with the table, whose number stays its own.
_digests: RecentlyUsed[tuple[SceneTable, str]] = RecentlyUsed(MOST_TABLES)


def _digest(value: Any) -> Any:
    """Return a value of a scene with a digest in place of each table, which is made once for each."""
    if isinstance(value, SceneTable):
        return _digests.get(id(value), lambda: (value, _digest_table(value)))[1]
    if isinstance(value, Mapping):
        return {name: _digest(own) for name, own in value.items()}
    return [*map(_digest, value)] if isinstance(value, list | tuple) else value


def _digest_table(table: SceneTable) -> str:
    text = json.dumps(table.model_dump(mode="json"), sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def _naming_vary(error: InputError, variations: Sequence[Variation]) -> InputError:
    """Return the error of a varied value with ``--vary`` as its origin, where loading has put ``--set``."""
    if error.file == "--set" and any(error.key.startswith(v.key) for v in variations):
        return InputError(_VARY, error.key, error.value, error.mend)
    return error


def split_names(option: str, texts: Sequence[str]) -> list[str]:
    """Return names that are given with commas between them, or by several options."""
    names = [name.strip() for text in texts for name in split_at_commas(text)]
    if not all(names):
        raise InputError(option, "", ",".join(texts), "has an empty name; give names with commas between them")
    return names


def split_at_commas(text: str) -> list[str]:
    """Split a text at its commas, but for those within brackets or quotes."""
    parts, depth, quote = [""], 0, ""
    for character in text:
        if quote:
            quote = "" if character == quote else quote
        elif character in _QUOTES:
            quote = character
        else:
            depth += (character in _OPENING) - (character in _CLOSING)
        if character == "," and not quote and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return parts


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
