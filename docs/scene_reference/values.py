"""Words for the values that a key of a scene file takes, read off the key's annotated type."""

import re
from collections.abc import Iterator, Mapping, Sequence
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import AfterValidator, BaseModel, BeforeValidator
from pydantic.fields import FieldInfo

from fmd.core.units import NonNegative, Positive, QuantityReader, read_share, si_unit
from fmd.scene.curves import TimeFunction
from fmd.scene.schema import to_markdown

_PLAIN = {float: "number", int: "whole number", str: "text", bool: "`true` or `false`"}
_PLURALS = {"frequency": "frequencies", "moment of inertia": "moments of inertia", "stress": "stresses"}


class ValueWords(NamedTuple):
    """Description of the values that a key takes.

    Attributes
    ----------
    noun : str
        Kind of value, as Markdown, e.g. ``"length"``.
    limits : str
        Limits of the value, e.g. ``"above 0"``; empty if there are none.
    unit : str
        SI unit of a quantity; empty for other values.
    """

    noun: str
    limits: str = ""
    unit: str = ""

    @property
    def text(self) -> str:
        """Noun and limits."""
        return f"{self.noun} {self.limits}".rstrip()


def describe_values(annotation: Any, metadata: Sequence[Any], anchors: Mapping[type, str]) -> ValueWords:
    """Describe the values of a type.

    Parameters
    ----------
    annotation : type
        Type of a field, e.g. ``PositiveLength | None``.
    metadata : sequence
        Validators and limits that stand beside it.
    anchors : mapping of type to str
        Places on the page where the tables are described.
    """
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return describe_values(inner[0], [*inner[1:], *metadata], anchors)
    if origin in (Union, UnionType):
        return _describe_alternatives(inner, anchors)
    checks = [*_flatten(metadata)]
    limits = " and ".join(_list_limits(checks))
    noun, unit = _read_noun(checks)
    if noun:
        return ValueWords(noun, limits, unit)
    if origin is Literal:
        return ValueWords(_join_words(_quote_words(annotation)))
    if origin is tuple:
        return _describe_list(inner, checks, anchors)
    if origin is dict:
        return ValueWords(f"{_make_plural(describe_values(inner[1], (), anchors).noun)} by name")
    if issubclass(annotation, TimeFunction):
        return ValueWords(f"[{annotation.kind} over time]({anchors[TimeFunction]})", unit=si_unit(annotation.kind))
    if issubclass(annotation, BaseModel):
        return ValueWords(f"[table]({next(anchors[kind] for kind in annotation.__mro__ if kind in anchors)})")
    return ValueWords(_PLAIN[annotation], limits)


def _describe_alternatives(kinds: Sequence[Any], anchors: Mapping[type, str]) -> ValueWords:
    """Describe values of several kinds; tables of several kinds are described in one place."""
    words: list[str] = []
    unit = ""
    for kind in kinds:
        if kind is NoneType:
            continue
        found = describe_values(kind, (), anchors)
        if found.noun.startswith("[table]") and any(word.startswith("[table]") for word in words):
            continue
        words += _quote_words(kind) if get_origin(kind) is Literal else [found.text]
        unit = unit or found.unit
    return ValueWords(_join_words(words), unit=unit)


def _describe_list(items: Sequence[Any], checks: Sequence[Any], anchors: Mapping[type, str]) -> ValueWords:
    """Describe a list of values of one kind, with its length."""
    item = describe_values(items[0], (), anchors)
    least = next((check.min_length for check in checks if isinstance(check, MinLen)), 0)
    most = next((check.max_length for check in checks if isinstance(check, MaxLen)), None)
    count = f"{least} to {most:,}" if most else "" if items[-1] is Ellipsis else str(len(items))
    return ValueWords(" ".join(["list of", count, _make_plural(item.noun)]).replace("  ", " "), item.limits, item.unit)


def _read_noun(checks: Sequence[Any]) -> tuple[str, str]:
    """Return the noun that validators and words give a value, and its SI unit; both empty if they give none."""
    nouns, unit = [], ""
    for check in checks:
        function = check.func if isinstance(check, AfterValidator | BeforeValidator) else check
        if isinstance(function, QuantityReader):
            nouns.append(function.kind)
            unit = si_unit(function.kind)
        elif function is read_share:
            nouns.append('percentage, e.g. `"1 %"`')
        elif hasattr(function, "description") and not isinstance(function, FieldInfo):
            nouns.append(to_markdown(function.description))
    return " ".join(nouns), unit


def _list_limits(checks: Sequence[Any]) -> Iterator[str]:
    least = next((check.ge for check in checks if isinstance(check, Ge)), None)
    most = next((check.le for check in checks if isinstance(check, Le)), None)
    if least is not None and most is not None:
        yield f"{least} or {most}" if (least, most) == (1, 2) else f"from {_write(least)} to {_write(most)}"
    elif least is not None or NonNegative in checks:
        yield f"at least {_write(least or 0)}"
    for check in checks:
        if check == Positive:
            yield "above 0"
        elif isinstance(check, Gt):
            yield f"above {_write(check.gt)}"
        elif isinstance(check, Lt):
            yield f"below {_write(check.lt)}"


def _write(number: Any) -> str:
    return f"{number:,}" if isinstance(number, int) else f"{number:g}"


def _flatten(metadata: Sequence[Any]) -> Iterator[Any]:
    """List validators and limits one by one, also those inside a ``Field(…)``."""
    for item in metadata:
        if isinstance(item, FieldInfo):
            yield from _flatten(item.metadata)
        else:
            yield item


def _quote_words(literal: Any) -> list[str]:
    return [f'`"{word}"`' for word in get_args(literal)]


def _make_plural(noun: str) -> str:
    if noun.startswith("`"):
        return noun
    noun = re.sub(r"^\[table\]", "[tables]", noun)
    noun = re.sub(r"^name of a (\w+)$", r"names of \1s", noun)
    noun = re.sub(r"^list of", "lists of", noun)
    return noun if noun.startswith(("[", "names", "lists")) else _PLURALS.get(noun, f"{noun}s")


def _join_words(words: Sequence[str]) -> str:
    return " or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
