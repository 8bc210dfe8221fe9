"""JSON schemas of all that commands print with ``--json``: ``python -m fmd.cli.answers frf``.

They are read from ``answers.toml``, from which ``docs/json.md`` is written, too. Tests hold all that commands print
against them.
"""

import json
import re
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

from fmd.cli.app import app
from fmd.core.errors import InputError
from fmd.scene.reading import suggest_name

_SIMPLE = {"number": "number", "integer": "integer", "text": "string", "truth": "boolean", "null": "null"}
_KEY = re.compile(r"(\w+)(\??)(?:\s+\(([^()]*)\))?")
_HEADS = ("about", "like", "more")
_WHAT = "the commands that do"


class Key(NamedTuple):
    """A key that a command prints: its name, its type in words, if it may be missing, and its meaning."""

    name: str
    kind: str
    may_be_missing: bool
    meaning: str


@cache
def read_answers() -> dict[str, dict[str, str]]:
    """Return the tables of ``answers.toml`` by name."""
    return tomllib.loads((files("fmd.cli") / "answers.toml").read_text(encoding="utf-8"))


def list_keys(name: str) -> list[Key]:
    """List the keys of a table, in its order, after those of the table that it is like."""
    table = read_answers()[name]
    own = [
        Key(key, kind, bool(mark), meaning)
        for kind, keys in table.items()
        if kind not in _HEADS
        for key, mark, meaning in _KEY.findall(keys)
    ]
    return [*(list_keys(table["like"]) if "like" in table else ()), *own]


def names_in(kind: str) -> list[str]:
    """Return the names of the tables that a type is made of."""
    return [word for word in re.findall(r"[a-z-]+", kind) if word in read_answers()]


def kind_of_answer(command: str) -> str:
    """Return the type of what a command prints.

    Raises
    ------
    InputError
        No command of this name prints JSON.
    """
    kind = read_answers()["commands"].get(command, command)
    if not names_in(kind) or command == "commands":
        raise InputError("COMMAND", "", command, f"prints no JSON; {suggest_name(command, list_commands(), _WHAT)}")
    return kind


def list_commands() -> list[str]:
    """List the commands that print JSON, in the order of ``fmd --help``."""
    return [name for name in app if not name.startswith("-") and name not in ("new", "mcp")]


def answer_schema(command: str) -> dict[str, Any]:
    """Return the JSON schema of what a command prints with ``--json``."""
    kind = kind_of_answer(command)
    found: dict[str, Any] = {}
    waiting = names_in(kind)
    while waiting:
        name = waiting.pop()
        if name not in found:
            found[name] = _table_schema(name)
            waiting += [inner for key in list_keys(name) for inner in names_in(key.kind)]
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"fmd {command} --json"}
    return head | _schema(kind) | {"$defs": found}


def _table_schema(name: str) -> dict[str, Any]:
    table, keys = read_answers()[name], list_keys(name)
    return {
        "type": "object",
        "description": table["about"],
        "properties": {key.name: _schema(key.kind) | _description(key.meaning) for key in keys},
        "required": [key.name for key in keys if not key.may_be_missing],
        "additionalProperties": _schema(table["more"]) if "more" in table else False,
    }


def _description(meaning: str) -> dict[str, str]:
    return {"description": " ".join(meaning.split())} if meaning else {}


def _schema(kind: str) -> dict[str, Any]:
    """Return the schema of a type in words, ``list of (number or null)``."""
    alternatives = [*_split(kind)]
    if len(alternatives) > 1:
        return {"anyOf": [_schema(each) for each in alternatives]}
    if kind.startswith("("):
        return _schema(kind[1:-1])
    if kind.startswith("list of "):
        return {"type": "array", "items": _schema(kind.removeprefix("list of "))}
    if kind.startswith("table of "):
        return {"type": "object", "additionalProperties": _schema(kind.removeprefix("table of "))}
    if kind == "anything":
        return {}
    return {"type": _SIMPLE[kind]} if kind in _SIMPLE else {"$ref": f"#/$defs/{kind}"}


def _split(kind: str) -> Iterator[str]:
    """Yield the alternatives of a type, those in brackets as one."""
    depth, found = 0, ""
    for word in kind.split(" "):
        depth += word.count("(") - word.count(")")
        if word == "or" and depth == 0:
            yield found
            found = ""
        else:
            found = f"{found} {word}".strip()
    yield found


def main(arguments: list[str]) -> int:
    """Print the schema of one command's answer; return the exit status, 2 without or with a wrong command."""
    try:
        if len(arguments) != 1:
            mend = f"takes one command; {_WHAT}: {', '.join(list_commands())}"
            raise InputError("COMMAND", "", " ".join(arguments) or None, mend)
        schema = answer_schema(arguments[0])
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write(json.dumps(schema, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
