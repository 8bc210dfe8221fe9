"""Lines of keys in TOML files."""

import tomllib
from collections.abc import Iterator
from importlib.resources import files
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmd.scene.toml_files import list_ready_scenes
from fmd.scene.toml_lines import KeyPath, find_lines
from tests.scene.test_reading import TEXTS, TOML_VALUES, toml

ALL_FORMS = """\
a = 1 # comment with [brackets] and "quotes"
"quoted key" . 'b' = "text with # and ] and \\" in it"
c = [
  1, # one
  [2, 3], { d = "x", e.f = 4 },

  '''
lines ]''', ]

[ g . h ]
i = \"\"\"
two
lines\"\"\"\"
j = 1979-05-27 07:32:00

[[k]]
l = true
[[k.m]]
n = 1
[[k.m]]
n = 2
[k.o]
p = []
[[k]]
"""
LINES = {
    ("a",): 1,
    ("quoted key",): 2,
    ("quoted key", "b"): 2,
    ("c",): 3,
    ("c", 0): 4,
    ("c", 1): 5,
    ("c", 1, 0): 5,
    ("c", 1, 1): 5,
    ("c", 2): 5,
    ("c", 2, "d"): 5,
    ("c", 2, "e"): 5,
    ("c", 2, "e", "f"): 5,
    ("c", 3): 7,
    ("g",): 10,
    ("g", "h"): 10,
    ("g", "h", "i"): 11,
    ("g", "h", "j"): 14,
    ("k",): 16,
    ("k", 0): 16,
    ("k", 0, "l"): 17,
    ("k", 0, "m"): 18,
    ("k", 0, "m", 0): 18,
    ("k", 0, "m", 0, "n"): 19,
    ("k", 0, "m", 1): 20,
    ("k", 0, "m", 1, "n"): 21,
    ("k", 0, "o"): 22,
    ("k", 0, "o", "p"): 23,
    ("k", 1): 24,
}


def paths_of(node: Any, path: KeyPath = ()) -> Iterator[KeyPath]:
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from paths_of(value, (*path, key))


def test_keys_of_all_forms_are_found() -> None:
    assert set(paths_of(tomllib.loads(ALL_FORMS))) == set(LINES)
    assert find_lines(ALL_FORMS) == LINES


@pytest.mark.parametrize("name", list_ready_scenes())
def test_each_key_of_a_ready_scene_stands_on_its_line(name: str) -> None:
    text = (files("fmd.models") / f"{name}.toml").read_text()
    found, lines = find_lines(text), text.split("\n")
    assert set(found) == set(paths_of(tomllib.loads(text)))
    for path, line in found.items():
        assert next(str(key) for key in reversed(path) if isinstance(key, str)) in "\n".join(lines[:line])
        assert not isinstance(path[-1], str) or path[-1] in lines[line - 1]


@settings(max_examples=50)
@given(st.dictionaries(TEXTS, TOML_VALUES))
def test_every_key_of_any_file_has_a_line(tables: dict[str, Any]) -> None:
    text = "".join(f"{toml({key: value})[1:-1]}\n" for key, value in tables.items())
    try:
        data = tomllib.loads(text)
    except ValueError:
        return
    assert set(find_lines(text)) == set(paths_of(data))
