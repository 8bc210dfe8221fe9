"""Reading of scene files: finding the file, its TOML, its tables and their faults."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, model_validator

from fmd.core.errors import InputError

KeyPath = tuple[str | int, ...]

_MOST_BYTES = 1_000_000


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
        fields = sorted(cls.model_fields.items(), key=lambda item: item[0] not in cls.__annotations__)  # its own first
        known = [field.alias or name for name, field in fields]
        unknown = [key for key in table if key not in known] if isinstance(table, dict) else []
        if unknown:
            message = f"no such key; {suggest_name(unknown[0], known, 'the keys here')}"
            raise FaultError(message, unknown[0], more=len(unknown) - 1)
        return table


def list_ready_scenes() -> tuple[str, ...]:
    """List the names of the scenes that come with the package, in alphabetical order."""
    return tuple(sorted(Path(f.name).stem for f in files("fmd.models").iterdir() if f.name.endswith(".toml")))


def suggest_name(given: str, names: Iterable[str], what: str) -> str:
    """Write the names that exist for a message, the likeliest meaning of ``given`` first.

    ``suggest_name("hup", ["hub"], "the joints")`` is ``"did you mean 'hub'? the joints: hub"``.
    """
    names = list(names)
    near = difflib.get_close_matches(given, names, n=1)
    meant = f"did you mean {near[0]!r}? " if near else ""
    return f"{meant}{what}: {', '.join(names) or 'none'}"


def find_scene(name: str) -> Traversable:
    """Find a ready scene by its name, or a file by its path; raises ``InputError`` if no ready scene has the name."""
    path = Path(name)
    if path.name != name or path.suffix:
        return path
    if name not in list_ready_scenes():
        mend = f"no such ready scene; {suggest_name(name, list_ready_scenes(), 'the ready scenes')}"
        raise InputError(name or "scene", "", None, f"{mend}; your own needs its path, e.g. my-scene.toml")
    return files("fmd.models") / f"{name}.toml"


def read_tables(source: Traversable) -> dict[str, Any]:
    """Read the tables of a scene file.

    Raises
    ------
    InputError
        It can't be read, or isn't TOML; the message says what and where.
    """
    file = str(source)
    return _parse(file, _read(file, source))


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


def parse_value(text: str) -> object:
    """Parse a TOML value; text that isn't one is returned as a string."""
    try:
        table = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return table["value"] if len(table) == 1 else text
