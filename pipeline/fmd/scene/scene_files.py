"""Scene files as they are read: on top of their base, with values from the command line, and with their errors."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from fmd.core.errors import InputError
from fmd.scene.inheritance import complete_bodies, find_template, move_files
from fmd.scene.reading import (
    FaultError,
    KeyPath,
    find_scene,
    list_ready_scenes,
    parse_value,
    read_tables,
    suggest_name,
)

_MOST_SHOWN = 80
_SET = "--set"
_TAG = re.compile(r"(literal|function-\w+)\[|\[key\]$")


@dataclass(frozen=True, slots=True)
class SceneFile:
    """Content of a scene file before its values are checked.

    Parameters
    ----------
    file : str
        Path that it was read from.
    data : dict
        Its tables, with the overrides in them.
    overridden : mapping of tuple to str
        Where single values were set, the command line or a scene's ``set``, by the path of their keys.
    origins : mapping of str to str
        Path of the base scene that a table of the first level comes from, by the table's name.
    """

    file: str
    data: dict[str, Any]
    overridden: Mapping[KeyPath, str]
    origins: Mapping[str, str]

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
        origin = self.origins.get(str(path[0]), self.file) if path else self.file
        for key, where in self.overridden.items():
            origin = where if path[: len(key)] == key else origin
        mend = _write_mend(first) + (f" (and {more} more)" if more else "")
        return InputError(origin, _join_path(path), self._value(path), mend)

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
    """Read a scene file and apply overrides; the arguments are those of ``fmd.scene.scene.load_scene``."""
    source = find_scene(str(name_or_path))
    file = str(source)
    data, origins, overridden = _read_with_base(source, ())
    overridden |= {_set_value(data, text, _SET): _SET for text in overrides}
    return SceneFile(file, complete_bodies(data, file), overridden, origins)


def _read_with_base(
    source: Traversable, heirs: tuple[Path, ...]
) -> tuple[dict[str, Any], dict[str, str], dict[KeyPath, str]]:
    """Read the tables of a scene and those of its base that it leaves out, and set the single values that it gives.

    Returns
    -------
    tuple of dict
        The tables, the files that tables of a base come from, and the files that have set single values.
    """
    file, place = str(source), Path(str(source))
    data = read_tables(source)
    changes = data.pop("set", [])
    if not isinstance(changes, list) or not all(isinstance(text, str) for text in changes):
        raise InputError(file, "set", None, "must be a list of texts, e.g. ['body.beam.length=300mm']")
    origins: dict[str, str] = {}
    overridden: dict[KeyPath, str] = {}
    if "base" in data:
        given = data.pop("base")
        heirs = (*heirs, place.resolve())
        base = _find_base(file, given)
        if Path(str(base)).resolve() in heirs:
            raise InputError(file, "base", given, "leads back to the same scene; one of them must have no base")
        tables, origins, overridden = _read_with_base(base, heirs)
        added = {key: value for key, value in tables.items() if key not in data}
        origins = {key: origins.get(key, str(base)) for key in added}
        overridden = {path: where for path, where in overridden.items() if path[0] in added}
        data = move_files(added, Path(str(base)).parent, place.parent) | data
    overridden |= {_set_value(data, text, file): file for text in changes}
    return data, origins, overridden


def _find_base(file: str, given: object) -> Traversable:
    """Find a ready scene by its name, or a scene by its path from the file that builds on it."""
    if isinstance(given, str) and (Path(given).name != given or Path(given).suffix):
        path = Path(file).parent / given
        if not path.is_file():
            raise InputError(file, "base", given, f"no such file; it is looked for at {path}")
        return path
    if not isinstance(given, str) or given not in list_ready_scenes():
        ready = suggest_name(str(given), list_ready_scenes(), "the ready scenes")
        raise InputError(file, "base", given, f"{ready}; your own needs its path, e.g. ./my-scene.toml")
    return files("fmd.models") / f"{given}.toml"


def _set_value(data: dict[str, Any], text: str, where: str) -> KeyPath:
    """Set a value given as ``body.beam.length=300mm`` in the tables and return the path of its key."""
    dotted, equals, given = (part.strip() for part in text.partition("="))
    *tables, last = dotted.split(".")
    if not equals or not all((*tables, last)):
        raise InputError(where, "" if where == _SET else "set", text, "must look like body.beam.length=300mm")
    node: Any = data
    path: KeyPath = ()
    template: Any = find_template(data, tables[1]) if tables[:1] == ["body"] and len(tables) > 1 else None
    for depth, part in enumerate(tables):
        if depth > 1 and isinstance(node, dict) and part not in node:
            _copy_from(template, node, part)  # a body that is like another has the other's keys
        path += (_find_key(where, dotted, node, part),)
        node = node[path[-1]]
        if depth > 1:
            template = template.get(part) if isinstance(template, dict) else None
    key = last if isinstance(node, dict) else _find_key(where, dotted, node, last)
    node[key] = parse_value(given)
    return (*path, key)


def _copy_from(template: object, node: dict[str, Any], part: str) -> None:
    """Give a table the place that a value is to be set in: a table of the same name, or a copy of a list."""
    if isinstance(template, dict) and part in template:
        node[part] = {} if isinstance(template[part], dict) else deepcopy(template[part])


def _find_key(where: str, dotted: str, node: object, part: str) -> str | int:
    """Return the key of a table, or the number in a list, that one part of a dotted path names."""
    if isinstance(node, dict):
        names = list(node)
    else:
        names = [str(number) for number in range(len(node))] if isinstance(node, list) else []
    if part not in names:
        raise InputError(where, dotted, None, f"there is no {part!r}; {suggest_name(part, names, 'the keys there')}")
    return part if isinstance(node, dict) else int(part)


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
