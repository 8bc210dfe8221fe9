"""Write the page about ``--json``: ``python -m docs.json_reference > docs/json.md``."""

import sys
from collections.abc import Iterator

from fmd.cli.answers import answer_schema, kind_of_answer, list_commands, list_keys, names_in, read_answers

_INTRODUCTION = """# JSON of the commands

All commands but `new` and `mcp` print one JSON object with `--json`, and nothing else to standard output; errors and
progress go to standard error, and the exit status is that without it. Quantities are in SI units, with their unit at
the end of the key (`value_pa`, `time_s`) or beside them in `unit`; numbers are finite or `null`. Keys are added from
version to version, and neither renamed nor removed.

`python -m fmd.cli.answers COMMAND` prints the JSON schema of a command. A key with a question mark may be missing; a
table of something has names of the scene as keys."""


def write_page() -> str:
    """Return the page as Markdown."""
    blocks, seen = [_INTRODUCTION], dict[str, None]()
    for command in list_commands():
        own = names_in(kind_of_answer(command))
        blocks.append(f"## fmd {command}")
        for name in own:
            blocks += _describe(name) if name not in seen else [f"As [`fmd {_first(name)}`](#fmd-{_first(name)})."]
        seen |= dict.fromkeys(own)
        assert answer_schema(command)
    inner = dict.fromkeys(n for name in seen for n in _within(name))
    blocks.append("## Tables within")
    for name in sorted(set(inner) - set(seen)):
        blocks += [f"### {name}", *_describe(name)]
    return "\n\n".join(blocks) + "\n"


def _first(name: str) -> str:
    return next(command for command in list_commands() if name in names_in(kind_of_answer(command)))


def _within(name: str) -> Iterator[str]:
    for key in list_keys(name):
        for inner in names_in(key.kind):
            yield inner
            yield from _within(inner)


def _describe(name: str) -> list[str]:
    rows = [
        f"| `{key.name}`{'?' if key.may_be_missing else ''} | {_linked(key.kind)} | {' '.join(key.meaning.split())} |"
        for key in list_keys(name)
    ]
    return [f"{read_answers()[name]['about']}.", "\n".join(["| key | holds | |", "|---|---|---|", *rows])]


def _linked(kind: str) -> str:
    return " ".join(f"[{word}](#{word})" if word in names_in(kind) else word for word in kind.split(" "))


if __name__ == "__main__":
    sys.stdout.write(write_page())
