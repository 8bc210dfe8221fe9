"""Reading of scene files: finding the file, its TOML, values from the command line, one message for a fault."""

from __future__ import annotations

import difflib
import re
import reprlib
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import ErrorDetails

from pipeline.core.errors import InputError

KeyPath = tuple[str | int, ...]

_MOST_BYTES = 1_000_000
_MOST_SHOWN = 80
_SET = "--set"
_TAG = re.compile(r"(literal|function-\w+)\[|\[key\]$")


class FaultError(ValueError):
    """A fault at a key below the table that is being checked.

    Parameters
    ----------
    message : str
        What is wrong and what would work.
    path : str or int
        The keys from the table to the value at fault.
    more : int
        How many other faults were found with it.
    """

    def __init__(self, message: str, *path: str | int, more: int = 0) -> None:
        self.path, self.more = path, more
        super().__init__(message)


class SceneTable(BaseModel):
    """A table of the scene file, immutable once read; an unknown key in it is a fault, never ignored."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _know_every_key(cls, table: Any) -> Any:
        known = [field.alias or name for name, field in cls.model_fields.items()]
        unknown = [key for key in table if key not in known] if isinstance(table, dict) else []
        if unknown:
            message = f"no such key; {suggest_name(unknown[0], known, 'the keys here')}"
            raise FaultError(message, unknown[0], more=len(unknown) - 1)
        return table


@dataclass(frozen=True, slots=True)
class SceneFile:
    """Content of a scene file before its values are checked.

    Parameters
    ----------
    file : str
        Path that it was read from.
    data : dict
        Its tables, with the overrides in them.
    overridden : tuple
        Paths of the keys that were set on the command line.
    """

    file: str
    data: dict[str, Any]
    overridden: tuple[KeyPath, ...]

    def make_error(self, error: ValidationError) -> InputError:
        """Turn pydantic's list of faults into one message about the first of them."""
        faults = [(_remove_tags(fault["loc"]), fault) for fault in error.errors(include_url=False)]
        path = faults[0][0]
        # A quantity that may also be a word has a fault for each; that of the quantity is the better message.
        here = [fault for place, fault in faults if place == path]
        first = next((fault for fault in here if fault["type"] != "literal_error"), here[0])
        fault = first.get("ctx", {}).get("error")
        more = len({place for place, _ in faults}) - 1
        if isinstance(fault, FaultError):
            path += fault.path
            more += fault.more
        if first["type"].startswith("union_tag"):
            path += (first["ctx"]["discriminator"].strip("'"),)
        given = any(path[: len(key)] == key for key in self.overridden)
        mend = _write_mend(first) + (f" (and {more} more)" if more else "")
        return InputError(_SET if given else self.file, _join_path(path), self._value(path), mend)

    def _value(self, path: KeyPath) -> object:
        """Return the value at a path; ``None`` if it is missing or too long for a message."""
        value: Any = self.data
        try:
            for key in path:
                value = value[key]
            return value if len(repr(value)) <= _MOST_SHOWN else None
        except (LookupError, TypeError, ValueError, RecursionError):  # repr refuses very large integers
            return None


def read_scene_file(name_or_path: str | Path, overrides: Sequence[str]) -> SceneFile:
    """Read a scene file and apply overrides; the arguments are those of ``pipeline.scene.scene.load_scene``."""
    source = _find(str(name_or_path))
    file = str(source)
    data = _parse(file, _read(file, source))
    if "base" in data:
        data = _add_base(file, data)
    return SceneFile(file, data, tuple(_set_value(data, text) for text in overrides))


def _add_base(file: str, data: dict[str, Any]) -> dict[str, Any]:
    """Add those tables of the ready scene named as the base that the file leaves out."""
    name = data.pop("base")
    if name not in list_ready_scenes():
        raise InputError(file, "base", name, suggest_name(str(name), list_ready_scenes(), "the ready scenes"))
    source = files("models") / f"{name}.toml"
    base = _parse(str(source), _read(str(source), source))
    if "base" in base:
        raise InputError(file, "base", name, f"has a base itself; take {base['base']!r}")
    return base | data


def list_ready_scenes() -> tuple[str, ...]:
    """List the names of the scenes that come with the package, in alphabetical order."""
    return tuple(sorted(Path(f.name).stem for f in files("models").iterdir() if f.name.endswith(".toml")))


def suggest_name(given: str, names: Iterable[str], what: str) -> str:
    """Write the names that exist for a message, the likeliest meaning of ``given`` first.

    ``suggest_name("hup", ["hub"], "the joints")`` is ``"did you mean 'hub'? the joints: hub"``.
    """
    names = list(names)
    near = difflib.get_close_matches(given, names, n=1)
    meant = f"did you mean {near[0]!r}? " if near else ""
    return f"{meant}{what}: {', '.join(names) or 'none'}"


def _find(name: str) -> Traversable:
    path = Path(name)
    if path.name != name or path.suffix:
        return path
    if name not in list_ready_scenes():
        mend = f"no such ready scene; {suggest_name(name, list_ready_scenes(), 'the ready scenes')}"
        raise InputError(name or "scene", "", None, f"{mend}; your own needs its path, e.g. my-scene.toml")
    return files("models") / f"{name}.toml"


def _read(file: str, source: Traversable) -> str:
    try:
        if source.is_dir():
            raise InputError(file, "", None, "is a folder; give the scene file in it")
        if not source.is_file():
            raise InputError(file, "", None, f"no such file; the ready scenes: {', '.join(list_ready_scenes())}")
        with source.open("rb") as stream:
            content = stream.read(_MOST_BYTES + 1)
    except (OSError, ValueError) as error:
        raise InputError(file, "", None, f"can't be read: {error}") from None
    if len(content) > _MOST_BYTES:
        raise InputError(file, "", None, "is over 1 MB; a scene file is text of a few kB")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(file, "", None, "isn't text in UTF-8; a scene file is TOML") from None


def _parse(file: str, text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        lines = text.split("\n")
        end = f"at line {len(lines)}, column {len(lines[-1]) + 1}"
        mend = f"isn't valid TOML: {error}".replace("at end of document", end)
        raise InputError(file, "", None, mend) from None


def _set_value(data: dict[str, Any], text: str) -> KeyPath:
    """Set a value given as ``body.beam.length=300mm`` in the tables and return the path of its key."""
    dotted, equals, given = (part.strip() for part in text.partition("="))
    *tables, last = dotted.split(".")
    if not equals or not all((*tables, last)):
        raise InputError(_SET, "", text, "must look like body.beam.length=300mm")
    node: Any = data
    path: KeyPath = ()
    for part in tables:
        path += (_find_key(dotted, node, part),)
        node = node[path[-1]]
    key = last if isinstance(node, dict) else _find_key(dotted, node, last)
    node[key] = parse_value(given)
    return (*path, key)


def _find_key(dotted: str, node: object, part: str) -> str | int:
    """Return the key of a table, or the number in a list, that one part of a dotted path names."""
    if isinstance(node, dict):
        names = list(node)
    else:
        names = [str(number) for number in range(len(node))] if isinstance(node, list) else []
    if part not in names:
        raise InputError(_SET, dotted, None, f"there is no {part!r}; {suggest_name(part, names, 'the keys there')}")
    return part if isinstance(node, dict) else int(part)


def parse_value(text: str) -> object:
    """Parse a TOML value; text that isn't one is returned as a string."""
    try:
        table = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return table["value"] if len(table) == 1 else text


def _remove_tags(location: KeyPath) -> KeyPath:
    """Remove what pydantic adds to a path: the kind of a table or value, and a mark for a fault in a key."""
    if location[:2] == ("simulation", "run"):
        location = location[:3] + location[4:]
    elif location[:1] in (("body",), ("joint",), ("drive",), ("output",)):
        location = location[:2] + location[3:]
    location = tuple(part for part in location if " " not in str(part))  # no key has a blank, but some kinds of values
    while location and _TAG.match(str(location[-1])):
        location = location[:-1]
    return location


def _join_path(path: KeyPath) -> str:
    return ".".join(str(k) if re.fullmatch(r"[\w-]{1,60}", str(k)) else reprlib.repr(k) for k in path)


def _write_mend(error: ErrorDetails) -> str:
    match error["type"]:
        case "value_error":
            return str(error["ctx"]["error"])
        case "missing" | "union_tag_not_found":
            return "is missing"
        case "union_tag_invalid":
            return f"must be one of {error['ctx']['expected_tags']}"
        case "model_type" | "model_attributes_type" | "dict_type":
            return "must be a table"
        case "tuple_type":
            return "must be a list"
        case _:
            return re.sub(r"^\w+ should", "must", error["msg"]).replace(" after validation", "")
