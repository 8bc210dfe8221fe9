"""Values that several tables of a scene share: names, counts, points, directions, units and files.

What stands beside a type as `Words` describes its values on the page about the scene file.
"""

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, WithJsonSchema
from pydantic_core import CoreSchema, core_schema

from fmd.core.data_classes import dataclass
from fmd.core.limits.scene import SHORTEST_DIRECTION
from fmd.core.units import Angle, AngularRate, Length, require_possible, to_si, unit_ratio

_NAME = "[A-Za-z][A-Za-z0-9_-]{0,39}"


@dataclass(frozen=True, slots=True)
class Words:
    """Words for the values of a type, for people; they check nothing."""

    description: str  # the words, e.g. ``"name of a joint"``


def _check_name(name: str) -> str:
    if not re.fullmatch(_NAME, name) or name == "ground":
        raise ValueError("a name is a letter and up to 39 letters, digits, '_' or '-'; 'ground' is taken")
    return name


def _check_poisson(nu: float) -> float:
    if not nu > -1:
        raise ValueError("must be above -1; most metals have about 0.3")
    if not nu < 0.5:
        raise ValueError("must be below 0.5 (0.5 is incompressible); 0.499 works")
    return nu


def _number_as_text(name: object) -> object:
    return str(name) if isinstance(name, int) and not isinstance(name, bool) else name


def _check_direction(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    if not SHORTEST_DIRECTION < max(map(abs, axis)) < 1 / SHORTEST_DIRECTION:  # else squares don't fit into numbers
        raise ValueError("has no direction; [0, 0, 1] is the z axis")
    return axis


def three_along(example: str) -> BeforeValidator:
    """Return a check that a value is a list, whose message has an example of the three values that it holds."""

    def check(value: object) -> object:
        if not isinstance(value, list | tuple):
            raise ValueError(f"must be a list of three, along x, y and z: {example}")
        return value

    return BeforeValidator(check)


def _read_plane(text: object) -> tuple[int, float]:
    match = re.fullmatch(r"\s*([xyz])\s*=\s*(.+?)\s*", text) if isinstance(text, str) and len(text) < 100 else None
    if match is None:
        raise ValueError("must look like 'x = 0' or 'z = 12 mm'")
    return "xyz".index(match[1]), 0.0 if re.fullmatch(r"[+-]?0+(\.0*)?", match[2]) else to_si(match[2], "length")


class TextCheck:
    """Check for texts that stands beside their type."""

    @property
    def schema(self) -> dict[str, Any]:
        """JSON schema of the texts, for editors."""
        raise NotImplementedError

    @property
    def description(self) -> str:
        """Words for the texts that pass."""
        raise NotImplementedError

    def __call__(self, text: str) -> str:
        """Return the text, or raise ``ValueError``."""
        raise NotImplementedError

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self, handler(source))

    def __get_pydantic_json_schema__(self, _: CoreSchema, __: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"type": "string", **self.schema}


@dataclass(frozen=True)
class UnitCheck(TextCheck):
    """Check for the name of a unit that converts to a given one."""

    si: str  # the unit that it must convert to, e.g. ``"m"``

    def __call__(self, unit: str) -> str:
        """Return the unit, or raise ``ValueError`` if it is unknown or of another dimension."""
        unit_ratio(self.si, unit)
        return unit

    @property
    def description(self) -> str:
        """Words for the values that pass the check."""
        return f"text: a unit that converts to {self.si}"

    @property
    def schema(self) -> dict[str, Any]:
        """Mark for `fmd.scene.schema`, which knows all units."""
        return {"$unit": True}


def check_file_name(file: str, *suffixes: str) -> str:
    """Return a file name, or raise ``ValueError`` if it holds a folder or has none of the suffixes."""
    plain = re.fullmatch(r"\w[\w .-]{0,99}", file.replace("{mode}", "1"))
    if not plain or ".." in file or not file.endswith(suffixes):
        raise ValueError(f"must be a plain file name without a folder, ending in {' or '.join(suffixes)}")
    return file


@dataclass(frozen=True)
class FileCheck(TextCheck):
    """Check for the plain name of one file with one of the given suffixes."""

    suffixes: tuple[str, ...]  # suffixes that are allowed, e.g. ``(".png", ".pdf")``

    def __call__(self, file: str) -> str:
        """Return the name, or raise ``ValueError`` if it isn't a plain one or stands for several files."""
        check_file_name(file, *self.suffixes)
        if "{mode}" in file:
            raise ValueError("'{mode}' belongs to an output of type 'modes'")
        return file

    @property
    def description(self) -> str:
        """Words for the values that pass the check."""
        return f"name of a {' or '.join(f'``{suffix}``' for suffix in self.suffixes)} file"

    @property
    def schema(self) -> dict[str, Any]:
        """Pattern of the names."""
        return {"pattern": f"({'|'.join(map(re.escape, self.suffixes))})$"}


@dataclass(frozen=True)
class OneOf(TextCheck):
    """Check for one of several words."""

    words: tuple[str, ...]  # the words

    def __call__(self, word: str) -> str:
        """Return the word, or raise ``ValueError``."""
        if word not in self.words:
            words = [f"'{known}'" for known in self.words]
            raise ValueError(f"must be {', '.join(words[:-1])} or {words[-1]}")
        return word

    @property
    def description(self) -> str:
        """Words that pass the check."""
        words = [f'``"{word}"``' for word in self.words]
        return f"{', '.join(words[:-1])} or {words[-1]}"

    @property
    def schema(self) -> dict[str, Any]:
        """List of the words."""
        return {"enum": [*self.words]}


Name = Annotated[str, AfterValidator(_check_name), WithJsonSchema({"type": "string", "pattern": f"^{_NAME}$"})]
Text = Annotated[str, Field(max_length=100)]
BodyName = Annotated[Text, Words("name of a body")]
JointName = Annotated[Text, Words("name of a joint")]
_IN_A_BODY = WithJsonSchema({"type": "string", "pattern": rf"^{_NAME}\.{_NAME}$"})
MarkerName = Annotated[Text, Words('``"body.marker"``'), _IN_A_BODY]
PlaceName = Annotated[
    Text,
    Words('``"body.marker"``, ``"ground"`` or ``"ground.place"``'),
    WithJsonSchema({"type": "string", "pattern": rf"^(ground|{_NAME}\.{_NAME})$"}),
]
Spin = tuple[AngularRate, AngularRate, AngularRate]
ElementName = Annotated[Text, Words('``"body.element"``'), _IN_A_BODY]
FaceName = Annotated[Text, Words("name of a face")]
PartName = Annotated[Text, Words("name of a part")]
LinkName = Annotated[
    Text, BeforeValidator(_number_as_text), Words("name of a link, or of a point of the deck: its set or its number")
]
SourceFile = Annotated[str, Field(min_length=1, max_length=1000), Words("path of a file")]
LengthUnit = Annotated[str, UnitCheck("m")]
MassUnit = Annotated[str, UnitCheck("kg")]
ForceUnit = Annotated[str, UnitCheck("N")]
Number = Annotated[float, Field(strict=True), AfterValidator(require_possible)]
Poisson = Annotated[Number, AfterValidator(_check_poisson), Words("number above -1 and below 0.5")]
Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Order = Annotated[int, Field(strict=True, ge=1, le=2)]
Formulation = Literal["enhanced", "plain"]
Point = Annotated[tuple[Length, Length, Length], three_along('["10 mm", "0 mm", "0 mm"]')]
Turn = tuple[Angle, Angle, Angle]
_Part = Annotated[float, Field(strict=True)]
Axis = Annotated[
    tuple[_Part, _Part, _Part],
    AfterValidator(_check_direction),
    three_along("[0, 0, 1]"),
    Words("list of 3 numbers, not all 0"),
]
Plane = Annotated[
    tuple[int, float],
    BeforeValidator(_read_plane),
    Words('plane, e.g. ``"x = 0"`` or ``"z = 12 mm"``'),
    WithJsonSchema({"type": "string", "pattern": r"^\s*[xyz]\s*="}),
]
