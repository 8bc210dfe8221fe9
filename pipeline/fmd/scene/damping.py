"""Damping of a flexible body's modes in a scene file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, Field, Tag, ValidationInfo, WithJsonSchema, model_validator

from fmd.core.units import NonNegative, Time, is_si_number, to_si
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import Number, Words


def _read_rate(value: object, info: ValidationInfo) -> float:
    """Read a rate, "12 1/s" [1/s]; it has the unit of a frequency, but no factor 2π belongs to it."""
    if is_si_number(value, info):
        return float(value)
    if isinstance(value, str) and value.rstrip().endswith("1/s"):
        return to_si(f"{value.rstrip().removesuffix('1/s')} Hz", "frequency")
    raise ValueError("needs a number and the unit 1/s, e.g. '12 1/s'")


Rate = Annotated[
    float,
    BeforeValidator(_read_rate),
    NonNegative,
    Words("number with 1/s, at least 0"),
    WithJsonSchema({"type": "string", "pattern": r"^.*\d.*1/s\s*$"}),
]


class RayleighDamping(SceneTable):
    """Damping proportional to mass and stiffness, ``C = α M + β K``: a ratio of ``α/2ω + β ω/2`` for each mode.

    Parameters
    ----------
    alpha : float
        Factor of the mass [1/s].
    beta : float
        Factor of the stiffness [s].

    Examples
    --------
    ::

        [body.beam.modes.damping]
        alpha = "12 1/s"
        beta = "2 us"
    """

    alpha: Rate = 0.0
    beta: Annotated[Time, NonNegative] = 0.0

    @model_validator(mode="after")
    def _damps(self) -> RayleighDamping:
        if not (self.alpha or self.beta):
            raise FaultError("is missing: give alpha, e.g. '12 1/s', or beta, e.g. '2 us', or both", "alpha")
        return self


Ratio = Annotated[Number, Field(ge=0.0, lt=1.0)]
Ratios = Annotated[tuple[Ratio, ...], Field(min_length=1, max_length=1000)]


def _kind(value: Any) -> str:
    """Return which of the three a value is meant to be."""
    if isinstance(value, dict | RayleighDamping):
        return "Rayleigh damping"
    return "damping ratios" if isinstance(value, list | tuple) else "damping ratio"


Damping = Annotated[
    Annotated[Ratio, Tag("damping ratio")]
    | Annotated[Ratios, Tag("damping ratios")]
    | Annotated[RayleighDamping, Tag("Rayleigh damping")],
    Discriminator(_kind),
]


def damping_ratios(damping: float | tuple[float, ...] | RayleighDamping, omega: Sequence[float]) -> list[float]:
    """Return the damping ratio of each mode of angular frequencies [rad/s], ascending.

    Of a list of ratios the last holds for all further modes.
    """
    if isinstance(damping, RayleighDamping):
        return [damping.alpha / (2 * w) + damping.beta * w / 2 if w else 0.0 for w in omega]
    ratios = damping if isinstance(damping, tuple) else (damping,)
    return [ratios[min(k, len(ratios) - 1)] for k in range(len(omega))]
