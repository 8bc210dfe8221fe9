"""Numbers of a scene that a fit or an optimisation varies, with their bounds."""

import re
from collections.abc import Sequence

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError, as_input_error
from fmd.core.units import parse_percentage, parse_quantity
from fmd.fitting.parameters import Parameter, find_parameter
from fmd.scene.reading import suggest_name
from fmd.stages.pipeline import Pipeline

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


@dataclass(frozen=True)
class VariedNumber:
    """A number of a scene that a fit varies.

    A fit counts in its logarithm if it and its bounds are above 0, else in shares of its value at the start, or of the
    distance between its bounds if that is 0.
    """

    parameter: Parameter
    low: float = -np.inf  # lower bound in the SI unit; infinite if there is none
    high: float = np.inf  # upper bound, likewise
    # Standard deviation of what is known of it beforehand, relative to its value in the scene; infinite if nothing.
    prior: float = np.inf

    @property
    def by_logarithm(self) -> bool:
        """True if a fit counts in the number's logarithm."""
        return self.parameter.value > 0.0 and (self.low > 0.0 or not np.isfinite(self.low))

    @property
    def scale(self) -> float:
        """Size that shares are of, where a fit doesn't count in the number's logarithm [SI]."""
        return abs(self.parameter.value) or self.high - self.low

    def to_share(self, value: float) -> float:
        """Return a value [SI] as a fit counts it: 0 is that in the scene."""
        if self.by_logarithm:
            return float(np.log(value / self.parameter.value)) if value > 0.0 else -np.inf
        return (value - self.parameter.value) / self.scale

    def from_share(self, share: float) -> float:
        """Return the value [SI] of what a fit counts."""
        if self.by_logarithm:
            return float(self.parameter.value * np.exp(share))
        return self.parameter.value + share * self.scale

    def per_share(self, value: float) -> float:
        """Return how fast the number [SI] changes with what a fit counts, at a value."""
        return value if self.by_logarithm else self.scale


def read_varied(run: Pipeline, vary: Sequence[str], priors: Sequence[str] = ()) -> tuple[VariedNumber, ...]:
    """Read numbers to vary, ``joint.elbow.spring=10..200`` or without bounds, and priors, ``body.arm.E=5 %``.

    Raises
    ------
    InputError
        A text isn't of this form, a key names no number, or bounds don't lie around its value.
    """
    known: dict[str, float] = {}
    for text in priors:
        key, _, given = (part.strip() for part in text.partition("="))
        try:
            known[key] = parse_percentage(given)
        except ValueError as error:
            raise InputError("--prior", key, given, f"{error}: the standard deviation of the scene's value") from None
    found: list[VariedNumber] = []
    for text in vary:
        key, equals, given = (part.strip() for part in text.partition("="))
        parameter = find_parameter(run.scene, key, "--vary")
        low, high = read_bounds(key, given, parameter.unit) if equals else (-np.inf, np.inf)
        if not low < high:
            raise InputError("--vary", key, given, "the first bound must be below the second")
        if not low <= parameter.value <= high:
            mend = f"must lie around the scene's value, {parameter.value:.6g} {parameter.unit}".rstrip()
            bare = parameter.unit and _NUMBER.fullmatch(given.rpartition("..")[2].strip())
            mend += f"; without a unit bounds are in {parameter.unit}" if bare else ""
            raise InputError("--vary", key, given, mend)
        if any(each.parameter.key == key for each in found):
            raise InputError("--vary", key, given, "is varied twice")
        found.append(VariedNumber(parameter, low, high, known.pop(key, np.inf)))
    if not found:
        mend = "is missing: numbers to vary, e.g. --vary joint.elbow.spring=10..200, or in the scene's table [fit]"
        raise InputError("--vary", "", None, mend)
    if known:
        raise InputError("--prior", next(iter(known)), None, "isn't varied: a prior belongs to a number of --vary")
    return tuple(found)


def read_shifts(texts: Sequence[str], channels: Sequence[str]) -> tuple[VariedNumber, ...]:
    """Read how much later clocks may start than the motion, ``elbow.position=-5 ms..5 ms``; ``time`` is that of all.

    Raises
    ------
    InputError
        There is no such channel, or a text isn't of this form, with 0 between the bounds.
    """
    found: dict[str, VariedNumber] = {}
    for text in texts:
        name, _, given = (part.strip() for part in text.partition("="))
        if name not in ("time", *channels):
            mend = f"no such history; {suggest_name(name, ['time', *channels], 'measured are')}"
            raise InputError("--shift", name, None, mend)
        low, high = read_bounds(name, given, "s", "--shift")
        if not low <= 0.0 <= high or not low < high or name in found:
            raise InputError("--shift", name, given, "must be given once, with two bounds around 0, e.g. -5 ms..5 ms")
        found[name] = VariedNumber(Parameter(f"shift of {name}", 0.0, "s", clock=name), low, high)
    return tuple(found.values())


def read_bounds(key: str, given: str, unit: str, option: str = "--vary") -> tuple[float, float]:
    """Read bounds, ``10..200`` in the SI unit or ``10..200 N mm``."""
    low, dots, high = (part.strip() for part in given.partition(".."))
    with as_input_error(option, key, given):
        if not dots:
            raise ValueError("must be two bounds, e.g. 10..200")
        end, end_unit = read_number(high, unit)
        begin = float(low) if _NUMBER.fullmatch(low) else None
        if begin is None:
            begin, _ = read_number(low, unit)
        elif end_unit:
            begin, _ = read_number(f"{low} {end_unit}", unit)
    return begin, end


def require_unit(text: str, unit: str) -> None:
    """Raise ``ValueError`` for a number without a unit of a result that has one."""
    if unit and _NUMBER.fullmatch(text.strip()):
        raise ValueError(f"needs a unit, such as {unit}")


def read_number(text: str, unit: str) -> tuple[float, str]:
    """Return a number [SI] and the unit that it is given in, if any."""
    if _NUMBER.fullmatch(text):
        return float(text), ""
    value, si = parse_quantity(text)
    if unit and si not in (unit, unit.removesuffix("/rad")):
        raise ValueError(f"must be in a unit of {unit}")
    match = _NUMBER.match(text)
    assert match is not None
    return value, text[match.end() :].strip()


def spread_starts(varied: Sequence[VariedNumber], count: int) -> list[Array]:
    """Return starts of searches: the scene's values, and points of a Latin hypercube between the bounds.

    Raises
    ------
    InputError
        There are no bounds to start between.
    """
    starts = [np.zeros(len(varied))]
    if count > 1:
        from scipy.stats.qmc import LatinHypercube

        bounds = np.array([[each.to_share(each.low), each.to_share(each.high)] for each in varied])
        if not np.isfinite(bounds).all():
            key = varied[int(np.flatnonzero(~np.isfinite(bounds).all(axis=1))[0])].parameter.key
            raise InputError("--starts", key, None, f"needs bounds, --vary {key}=low..high")
        points = LatinHypercube(len(varied), rng=np.random.default_rng(0)).random(count - 1)
        starts += [*(bounds[:, 0] + points * np.ptp(bounds, axis=1))]
    return starts
