"""The points of a sweep: which keys of the scene take which values, and the scene at each combination."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.core.cache import stage_key
from pipeline.core.errors import InputError
from pipeline.scene.scene import Scene, load_scene
from pipeline.scene.source_files import digest_files

_VARY = "--vary"
_MOST_POINTS = 100_000
_OPENING, _CLOSING, _QUOTES = "[{(", "]})", "\"'"
_PACKAGES = ("gmsh", "numba", "numpy", "scikit-fem", "scipy")


@dataclass(frozen=True)
class Varied:
    """A key of the scene, dotted as for ``--set``, and the values that it takes, as text."""

    key: str
    values: tuple[str, ...]


@dataclass(frozen=True)
class Point:
    """One combination of values.

    Parameters
    ----------
    values : tuple of str
        One for each varied key.
    scene : Scene or None
        The scene there; ``None`` if it is refused.
    key : str
        Digest of the whole scene and of what computes it; empty if it is refused.
    refusal : str
        Why, if it is refused.
    """

    values: tuple[str, ...]
    scene: Scene | None
    key: str = ""
    refusal: str = ""


def varied_of(texts: Sequence[str]) -> tuple[Varied, ...]:
    """Read ``simulation.step=1us,2us``; a comma within brackets or quotes belongs to its value.

    Raises
    ------
    InputError
        A text isn't of this form, or a key or value is given twice.
    """
    varied: list[Varied] = []
    for text in texts:
        key, equals, given = (part.strip() for part in text.partition("="))
        values = tuple(value.strip() for value in _split(given))
        if not key or not equals or not all(values):
            raise InputError(_VARY, "", text, "must look like simulation.step=1us,2us,5us")
        if len(set(values)) < len(values):
            raise InputError(_VARY, key, given, "has a value twice")
        if any(other.key == key for other in varied):
            raise InputError(_VARY, key, given, "is varied twice; give all its values in one list")
        varied.append(Varied(key, values))
    if not varied:
        raise InputError(_VARY, "", None, "is missing: what to vary, e.g. --vary simulation.step=1us,2us,5us")
    return tuple(varied)


def points_of(scene: str | Path, varied: Sequence[Varied], overrides: Sequence[str] = ()) -> list[Point]:
    """Load the scene at each combination of values, the last key varying fastest.

    Raises
    ------
    InputError
        There is no such scene, or it is refused at every point; the message is that of the first.
    """
    count = math.prod(len(v.values) for v in varied)
    if count > _MOST_POINTS:
        raise InputError(_VARY, "", None, f"makes {count} points; at most {_MOST_POINTS} in one sweep")
    points: list[Point] = []
    first: InputError | None = None
    for values in itertools.product(*(v.values for v in varied)):
        try:
            found = load_scene(scene, [*overrides, *(f"{v.key}={x}" for v, x in zip(varied, values, strict=True))])
            points.append(Point(values, found, point_key(found)))
        except InputError as error:
            refused = _as_varied(error, varied)
            first = first or refused
            points.append(Point(values, None, refusal=str(refused)))
    if first is not None and all(point.scene is None for point in points):
        raise first
    return points


def point_key(scene: Scene) -> str:
    """Name what a scene leads to after its whole content, that of its files, and all that computes it.

    Raises
    ------
    InputError
        A file isn't there.
    """
    inputs = {"scene": scene.model_dump(mode="json"), "files": digest_files(scene)}
    return stage_key("point", inputs, ("meshes", "pipeline"), _PACKAGES)


def _as_varied(error: InputError, varied: Sequence[Varied]) -> InputError:
    """Say that a value came by ``--vary``, not by ``--set``, which is how the scene got it."""
    if error.file == "--set" and any(error.key.startswith(v.key) for v in varied):
        return InputError(_VARY, error.key, error.value, error.mend)
    return error


def _split(text: str) -> list[str]:
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
