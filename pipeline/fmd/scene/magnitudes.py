"""Values of a scene that are possible but unusual, which are most often a wrong unit or a slip of the pen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin

import numpy as np

from fmd.core.limits.memory import MOST_TABLES
from fmd.core.limits.scene import PRESSED, USUAL_OF_BODIES, USUAL_OF_MOTION
from fmd.core.recently_used import RecentlyUsed
from fmd.core.units import QuantityReader
from fmd.scene.reading import SceneTable

if TYPE_CHECKING:
    from fmd.scene.joints.joint import JointTable
    from fmd.scene.scene import Scene

UNUSUAL = "unusual-value"  # code of the warning


def find_unusual(scene: Scene) -> Iterator[str]:
    """Write a sentence for each value of a scene that is far from usual ones: its key, it, and what is usual."""
    for name, shown, kinds in _kinds_of_fields(type(scene)):
        given = getattr(scene, name)
        tables = given.items() if isinstance(given, Mapping) else [("", given)]
        for own, table in tables:
            yield from _find_in_table(table, (shown, own) if own else (shown,), shown, kinds)
    for name in scene.carrying.values():
        yield from _find_pressed_stop(name, scene.joint[name])


# Scenes of a sweep share the tables that aren't varied. By number and path, with the table, whose number stays its own.
_known: RecentlyUsed[tuple[Any, tuple[str, ...]]] = RecentlyUsed(MOST_TABLES)


def _find_in_table(table: Any, path: tuple[str, ...], key: str, kinds: frozenset[str]) -> tuple[str, ...]:
    """Return the sentences about the values of a table, which are found once for each."""
    return _known.get((id(table), path), lambda: (table, tuple(_find_in(table, path, key, kinds))))[1]


def _find_in(table: Any, path: tuple[str, ...], key: str, kinds: frozenset[str]) -> Iterator[str]:
    """Write a sentence for each unusual value of a table."""
    for at, last, value, own in _walk(table, path, key, kinds):
        if (
            at[:1] == ("body",)
            and len(at) <= len(("body", "NAME", "material", "PART", "E"))
            and last in USUAL_OF_BODIES
        ):
            low, high, unit, examples = USUAL_OF_BODIES[last]
            if not low <= value <= high:
                yield f"{'.'.join(at)} is {value:.4g} {unit}".rstrip() + f", which is unusual: {examples}"
        for kind in own & USUAL_OF_MOTION.keys():
            most, unit, example = USUAL_OF_MOTION[kind]
            if abs(value) > most:
                yield f"{'.'.join(at)} is {value:.4g} {unit}, which is unusual: {example}"


def _find_pressed_stop(name: str, joint: JointTable) -> Iterator[str]:
    """Write a sentence about a joint that starts far beyond a stop of its own, which then throws what it carries."""
    for along in joint.along[:1]:
        if along.stop is None:
            continue
        unit, start = joint.kind.unit, joint.start(np.eye(3))[0][0]
        for side, sign in (("low", -1.0), ("high", 1.0)):
            at = getattr(along.stop, side)
            beyond = 0.0 if at is None else sign * (start - at)
            if beyond > PRESSED * along.stop.width:
                yield (
                    f"joint.{name} starts {beyond:.4g} {unit} beyond its stop.{side}, which is unusual: the stop holds "
                    f"{0.5 * along.stop.stiffness * beyond**2:.2g} J there; its ends count from the joint's zero"
                )


def _walk(
    value: Any, path: tuple[str, ...], key: str, kinds: frozenset[str] = frozenset()
) -> Iterator[tuple[tuple[str, ...], str, float, frozenset[str]]]:
    """Go through all numbers of a table and of those in it, with their paths, keys and kinds of quantity."""
    if isinstance(value, SceneTable):
        for name, shown, own in _kinds_of_fields(type(value)):
            if (inner := getattr(value, name)) is not None:
                yield from _walk(inner, (*path, shown), shown, own)
    elif isinstance(value, Mapping):
        for name, item in value.items():
            yield from _walk(item, (*path, str(name)), key, kinds)
    elif isinstance(value, tuple | list):
        for number, item in enumerate(value):
            yield from _walk(item, (*path, str(number)), key, kinds)
    elif isinstance(value, float):
        yield path, key, value, kinds


@cache
def _kinds_of_fields(table: type[SceneTable]) -> tuple[tuple[str, str, frozenset[str]], ...]:
    """Return name, key and kinds of quantities of each field of a table that may hold numbers with a fraction."""
    return tuple(
        (name, field.alias or name, frozenset(_kinds(field.annotation, field.metadata)))
        for name, field in table.model_fields.items()
        if _may_hold_numbers(field.annotation)
    )


def _may_hold_numbers(annotation: Any) -> bool:
    """Tell whether a field may hold numbers with a fraction; one of texts, whole numbers or choices doesn't."""
    if get_origin(annotation) is Literal:
        return False
    inner = get_args(annotation)[:1] if get_origin(annotation) is Annotated else get_args(annotation)
    return any(map(_may_hold_numbers, inner)) if inner else annotation not in (str, int, bool, type(None), ...)


def _kinds(annotation: Any, metadata: Any = ()) -> Iterator[str]:
    """List the kinds of quantities that a field's values may be."""
    inner = get_args(annotation)
    if get_origin(annotation) is Annotated:
        metadata, inner = (*metadata, *inner[1:]), inner[:1]
    yield from (check.kind for check in metadata if isinstance(check, QuantityReader))
    for item in inner:
        yield from _kinds(item)
