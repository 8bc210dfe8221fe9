"""Scenes that build on others: tables of a base scene, and bodies that are like another."""

from collections.abc import Callable, Sequence
from copy import deepcopy
from os.path import relpath
from pathlib import Path
from typing import Any

from fmd.core.errors import InputError
from fmd.scene.reading import suggest_name

Tables = dict[str, Any]

_MATRICES = ("stiffness", "mass", "nodes", "stress", "geometric_stiffness")


def move_files(tables: Tables, folder: Path, to: Path) -> Tables:
    """Return tables whose files are named from another folder; absolute paths stay.

    Files are the keys ``file`` and ``cad`` of all tables but the outputs, and the matrices of bodies.
    """
    if folder.resolve() == to.resolve():
        return tables
    return _change_files(tables, lambda name: _rename(name, folder, to))


def list_files(tables: Tables) -> list[str]:
    """List the files that a scene's tables read, as they name them, each once."""
    found: list[str] = []

    def note(name: str) -> str:
        found.append(name)
        return name

    _change_files(tables, note)
    return list(dict.fromkeys(found))


def _change_files(tables: Tables, change: Callable[[str], str]) -> Tables:
    """Return tables in which the name of each file that is read is changed."""

    def walk(value: Any, names: Sequence[str] = ("file", "cad")) -> Any:
        if isinstance(value, list):
            return [walk(item) for item in value]
        if not isinstance(value, dict):
            return value
        return {
            key: change(item)
            if key in names and isinstance(item, str)
            else walk(item, _MATRICES if key == "matrices" else ("file", "cad"))
            for key, item in value.items()
        }

    return {key: value if key == "output" else walk(value) for key, value in tables.items()}


def _rename(name: str, folder: Path, to: Path) -> str:
    path = (folder / name).resolve()
    try:
        return relpath(path, to.resolve())
    except ValueError:  # on another drive
        return str(path)


def find_template(tables: Tables, name: str) -> Tables | None:
    """Return the table of a body with all that it has from the body that it is like; ``None`` if there is no such body.

    A body that leads back to itself has its own keys alone.
    """
    bodies, seen = tables.get("body"), set()
    found: Tables = {}
    while isinstance(bodies, dict) and isinstance(own := bodies.get(name), dict) and name not in seen:
        seen.add(name)
        found = _join({key: value for key, value in own.items() if key != "like"}, found)
        if not isinstance(own.get("like"), str):
            return found
        name = own["like"]
    return found or None


def complete_bodies(tables: Tables, file: str) -> Tables:
    """Return a scene's tables in which each body that is ``like`` another has the other's keys beside its own.

    Its own tables, such as ``mesh`` or ``marker``, are joined with the other's key by key.

    Raises
    ------
    InputError
        There is no such body, or a body is like itself.
    """
    bodies = tables.get("body")
    if not isinstance(bodies, dict) or not any(isinstance(own, dict) and "like" in own for own in bodies.values()):
        return tables
    for name in bodies:
        seen = [name]
        while isinstance(bodies[seen[-1]], dict) and "like" in bodies[seen[-1]]:
            key, other = f"body.{seen[-1]}.like", bodies[seen[-1]]["like"]
            if other in seen:
                raise InputError(file, key, other, "leads back to the same body; one of them must have keys of its own")
            if not isinstance(other, str) or not isinstance(bodies.get(other), dict):
                names = [body for body in bodies if body not in seen]
                raise InputError(file, key, other, f"no such body; {suggest_name(str(other), names, 'the others')}")
            seen.append(other)
    whole = {name: find_template(tables, name) if isinstance(own, dict) else own for name, own in bodies.items()}
    return tables | {"body": deepcopy(whole)}


def _join(template: Tables, own: Tables) -> Tables:
    """Return a body's keys with those of its template that it leaves out; tables in them are joined, too."""
    joined = template | own
    for key, value in own.items():
        if isinstance(value, dict) and isinstance(template.get(key), dict):
            joined[key] = template[key] | value
    return joined
