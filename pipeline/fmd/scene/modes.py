"""Modes of a flexible body in a scene file: how they are computed, and how they are damped."""

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, ValidationInfo, WithJsonSchema

from fmd.core.units import NonNegative, Time, is_si_number, to_si
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import Count, Number, Text, Words


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

    Example:

        [body.beam.modes.damping]
        alpha = "12 1/s"
        beta = "2 us"
    """

    alpha: Rate = 0.0  # Factor of the mass [1/s].
    beta: Annotated[Time, NonNegative] = 0.0  # Factor of the stiffness [s].

    def _check(self) -> None:
        if not self.model_fields_set:  # a factor of 0 is no damping, as a ratio of 0 is
            raise FaultError("is missing: give alpha, e.g. '12 1/s', or beta, e.g. '2 us', or both", "alpha")

    def __bool__(self) -> bool:
        """Tell whether there is any, as a ratio does."""
        return bool(self.alpha or self.beta)


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


Enrichment = Literal["none", "inertia", "ritz", "residual"]


class ModeSettings(SceneTable):
    """The shapes that describe a flexible body's deformation, and how they are computed.

    Example:

        [body.beam.modes]
        count = 5
        family = "in-plane bending"
        enrich = "inertia"
        damping = 0.01
    """

    # Number of modes, above those of rigid motion. If the highest is one of a pair of equal frequency, the other is
    # taken, too.
    count: Count
    # Kind of motion that the modes are chosen from; the lowest ``count`` of that kind are taken. On a free joint it
    # takes ``enrich = "none"``, since static responses are of every kind.
    family: Literal["any", "in-plane bending", "out-of-plane bending", "torsion", "axial"] = "any"
    # How the body is held while it vibrates: only by its supports (``"free"``), also at the marker of the joint that
    # carries it (``"joint"``), or at its interface, whose static deflections are then added to the modes
    # (``"interface"``; Craig & Bampton).
    boundary: Literal["free", "joint", "interface"] = "free"
    # Markers that make up the interface; all of the body's markers, if none is named.
    interface: tuple[Annotated[Text, Words("name of a marker")], ...] = ()
    # Shapes that are added to the modes: the static responses to inertia loads, joint forces and loads (``"inertia"``),
    # without which stress and deflection are off, none (``"none"``), or four generations of load-dependent vectors
    # (``"ritz"``), each the responses to the inertia of the one before. ``"residual"`` are all static responses,
    # however little of them lies outside the modes, as linear answers take them; so stiff shapes need short steps. If
    # it is left out, ``"inertia"``; with an interface, whose deflections answer to joint forces already, and with free
    # modes of a body on joints with others, whose steps would be too short, ``"none"``.
    enrich: Enrichment | None = None
    # Damping ratio of every mode, 1 being critical; or a list of ratios, of the modes of the body on its joint, the
    # lowest first, whose last holds for all further ones; or factors of mass and stiffness.
    damping: Damping = 0.0
    # Program that factorises the stiffness: our own (``"multifrontal"``), by default (``"auto"``) SciPy's SuperLU for
    # small bodies; cvxopt's CHOLMOD (``"cholesky"``); or PETSc and SLEPc over several processes (``"slepc"``).
    solver: Literal["auto", "multifrontal", "cholesky", "slepc"] = "auto"
    # Number of processes for ``solver = "slepc"``; 2 if it is left out.
    ranks: Annotated[int, Field(strict=True, ge=1, le=100_000)] | None = None

    def _check(self) -> None:
        if self.ranks is not None and self.solver != "slepc":
            raise FaultError("belongs to solver = 'slepc'; the others are one process", "ranks")
        if self.boundary != "interface" and self.interface:
            raise FaultError('belongs to boundary = "interface"', "interface")
        if self.boundary == "interface" and self.family != "any":
            raise FaultError("can't be chosen: deflections by an interface are of every kind", "family")


class ReducedModes(SceneTable):
    """Damping of a body that was reduced by another program; its shapes are those of its file.

    Example:

        [body.arm.modes]
        damping = 0.01
    """

    count: ClassVar[int] = 0
    family: ClassVar[str] = "any"
    boundary: ClassVar[str] = "free"
    interface: ClassVar[tuple[str, ...]] = ()
    enrich: ClassVar[Enrichment] = "none"
    solver: ClassVar[Literal["auto"]] = "auto"
    ranks: ClassVar[None] = None

    damping: Ratio = 0.0  # Damping ratio of every mode in place of the file's own damping, which 0 keeps.


AnyModes = ModeSettings | ReducedModes
"""The shapes that describe a body's deformation, computed or of its file."""
