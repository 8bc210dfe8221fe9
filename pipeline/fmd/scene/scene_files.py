"""Scenes as they are read: on top of their base, with values from the command line, and where each stands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy, deepcopy
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.scene.inheritance import complete_bodies, find_template, move_files
from fmd.scene.reading import Fault, Place, find_caller, join_errors, suggest_name
from fmd.scene.toml_files import find_scene, list_ready_scenes, parse_value, read_with_lines
from fmd.scene.toml_lines import KeyPath

_SET = "--set"
Places = dict[KeyPath, Place]
Replaced = dict[str, list[str]]


@dataclass(frozen=True, slots=True)
class SceneSource:
    """Content of a scene before its values are checked."""

    file: str  # path of the file that it was read from; empty for a scene that was made in Python
    folder: Path  # folder that the scene's files are relative to
    data: dict[str, Any]  # its tables, with the overrides in them
    places: Places  # file and line of each key, of a base scene or of this one, by the path of keys that leads to it
    replaced: Replaced  # names that tables of the base have and those in their place here haven't, by the tables' names

    def with_values(self, overrides: Sequence[str]) -> SceneSource:
        """Return a scene that was read, with values instead of its own, and with what bodies have from others."""
        data, places = dict(self.data), dict(self.places)
        for text in overrides:
            _place_value(places, _set_value(data, text, _SET), (_SET, None))
        whole = complete_bodies(data, self.file)
        for body, own in whole.get("body", {}).items() if whole is not data else ():
            _place_inherited(places, data["body"], body) if isinstance(own, dict) else None
        return SceneSource(self.file, self.folder, whole, places, self.replaced)

    def make_error(self, faults: Sequence[Fault]) -> InputError:
        """Make one error of all faults, each with its file and line, and of what tables in place of the base's lose."""
        unknown = any(fault.mend.startswith("no such") for fault in faults)
        lost = [
            Fault((table, names[0]), _mend_lost(table, names))
            for table, names in self.replaced.items()
            if unknown or any(fault.path[:1] == (table,) for fault in faults)
        ]
        return join_errors([*faults, *lost], self.data, self._find_place)

    def _find_place(self, path: KeyPath) -> Place:
        """Find where a value stands; one that is missing or inherited is laid to the table around it."""
        while path and path not in self.places:
            path = path[:-1]
        return self.places[path]


def _mend_lost(table: str, names: Sequence[str]) -> str:
    more = f" {', '.join(names[1:])}, too;" if names[1:] else ""
    return (
        f"is the base's alone, whose {table} this one replaces:{more} set = ['{table}.…'] changes single values of it"
    )


def read_unchanged(source: str | Path | Mapping[str, Any]) -> SceneSource:
    """Read a scene and its base; what its bodies have from others isn't in it yet."""
    if isinstance(source, Mapping):
        return SceneSource("", Path(), *_complete(deepcopy(dict(source)), {(): find_caller()}, Path(), ()))
    found = find_scene(str(source))
    return SceneSource(str(found), Path(str(found)).parent, *_read_with_base(found, ()))


def with_line(error: InputError, overrides: Sequence[str]) -> InputError:
    """Return an error that a stage has found in a scene file with the line on which its key stands, if one does."""
    if error.line is not None or not error.key or not error.file.endswith(".toml"):
        return error
    path = tuple(int(part) if part.isdigit() else part for part in error.key.split("."))
    try:
        file, line = read_unchanged(error.file).with_values(overrides)._find_place(path)
    except InputError:  # the file isn't there any more
        return error
    return InputError(file if line else error.file, error.key, error.value, error.mend, line, error.others)


def _read_with_base(source: Traversable, heirs: tuple[Path, ...]) -> tuple[dict[str, Any], Places, Replaced]:
    """Read the tables of a scene and those of its base that it leaves out, and set the single values that it gives.

    With the tables are returned the places of their keys, and what the base has in tables that are replaced.
    """
    file = str(source)
    data, lines = read_with_lines(source)
    places: Places = {path: (file, line) for path, line in lines.items()}
    return _complete(data, {(): (file, None)} | places, Path(file), heirs)


def _complete(
    data: dict[str, Any], places: Places, place: Path, heirs: tuple[Path, ...]
) -> tuple[dict[str, Any], Places, Replaced]:
    """Add the tables of a scene's base that it leaves out, and set the single values that it gives."""
    file, replaced = places[()][0], Replaced()
    changes = data.pop("set", [])
    if not isinstance(changes, list) or not all(isinstance(text, str) for text in changes):
        raise InputError(file, "set", None, "must be a list of texts, e.g. ['body.beam.length=300mm']")
    if "base" in data:
        given = data.pop("base")
        heirs = (*heirs, place.resolve())
        base = _find_base(file, place.parent, given)
        if Path(str(base)).resolve() in heirs:
            raise InputError(file, "base", given, "leads back to the same scene; one of them must have no base")
        tables, theirs, _ = _read_with_base(base, heirs)
        both = [key for key in tables if isinstance(tables[key], dict) and isinstance(data.get(key), dict)]
        replaced = {key: lost for key in both if (lost := [name for name in tables[key] if name not in data[key]])}
        added = {key: value for key, value in tables.items() if key not in data}
        places |= {path: where for path, where in theirs.items() if path[:1] and path[0] in added}
        data = move_files(added, Path(str(base)).parent, place.parent) | data
    for number, text in enumerate(changes):
        _place_value(places, _set_value(data, text, file), places.get(("set", number), (file, None)))
    return data, places, replaced


def _place_value(places: Places, path: KeyPath, where: Place) -> None:
    """Note where a value has been set, and all within it."""
    for below in [key for key in places if key[: len(path)] == path]:
        del places[below]
    places[path] = where


def _place_inherited(places: Places, bodies: Mapping[str, Any], name: str) -> None:
    """Note where the keys stand that a body has from one that it is like."""
    heir, seen = name, {name}
    while isinstance(bodies[heir], dict) and (heir := bodies[heir].get("like")) is not None and heir not in seen:
        seen.add(heir)
        for path in [path for path in places if path[:2] == ("body", heir)]:
            places.setdefault(("body", name, *path[2:]), places[path])


def _find_base(file: str, folder: Path, given: object) -> Traversable:
    """Find a ready scene by its name, or a scene by its path from the file that builds on it."""
    if isinstance(given, str) and (Path(given).name != given or Path(given).suffix):
        path = folder / given
        if not path.is_file():
            raise InputError(file, "base", given, f"no such file; it is looked for at {path}")
        return path
    if not isinstance(given, str) or given not in list_ready_scenes():
        ready = suggest_name(str(given), list_ready_scenes(), "the ready scenes")
        raise InputError(file, "base", given, f"{ready}; your own needs its path, e.g. ./my-scene.toml")
    return files("fmd.models") / f"{given}.toml"


def _set_value(data: dict[str, Any], text: str, where: str) -> KeyPath:
    """Set a value given as ``body.beam.length=300mm`` in copies of the tables that lead to it; return its path."""
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
        node[path[-1]] = copy(node[path[-1]])  # other points of a sweep have what the value is set in, too
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
