"""JSON schema for editors: it lets right scenes through and flags misspelt ones."""

import json
import random
import tomllib
from collections.abc import Iterator
from copy import deepcopy
from importlib.resources import files
from typing import Any

import jsonschema
import pytest

from fmd.core.errors import InputError
from fmd.scene.scene import list_tables, load_scene
from fmd.scene.schema import read_docstring, write_schema
from fmd.scene.toml_files import list_ready_scenes
from fmd.scene.toml_lines import KeyPath

READY = {name: tomllib.loads((files("fmd.models") / f"{name}.toml").read_text()) for name in list_ready_scenes()}
TABLES_BY_NAME = ("body", "ground", "joint", "drive", "coupler", "spring", "bushing", "bearing", "marker", "element")


@pytest.fixture(scope="module")
def validator() -> jsonschema.Draft202012Validator:
    schema = json.loads(write_schema())
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("name", READY)
def test_each_ready_scene_is_valid(name: str, validator: jsonschema.Draft202012Validator) -> None:
    assert [f"{error.json_path}: {error.message}" for error in validator.iter_errors(READY[name])] == []


def test_numbers_may_have_tolerances(validator: jsonschema.Draft202012Validator) -> None:
    for mass, valid in (("0.4 kg ± 2 %", True), ("0.4 kg +/- 8 g", True), ("0.4 kg ±", False), ("0.4 kg ± x", False)):
        scene = READY["arm"] | {
            "body": READY["arm"]["body"] | {"gripper": READY["arm"]["body"]["gripper"] | {"mass": mass}}
        }
        assert validator.is_valid(scene) == valid, mass


def test_the_examples_of_the_reference_are_valid(validator: jsonschema.Draft202012Validator) -> None:
    """They are pieces of scenes, which may lack what others hold."""
    for name, table in list_tables().items():
        example = {"base": "beam"} | tomllib.loads(read_docstring(table)[1])
        if isinstance(example.get("output"), dict):  # a table within an output
            continue
        for error in validator.iter_errors(example):
            pieces = [found.validator for found in error.context or [error]]
            assert "required" in pieces, (name, error.message)


OWN = ("title", "source", "formula", "file", "parent", "child", "joint", "marker", "joints", "markers", "tip", "body")
OWN += (
    "like",
    "between",
    "face",
    "fast",
    "element",
    "elements",
    "nodes",
    "rack",
    "pinion",
    "driver",
    "input",
    "output",
)
OWN += (*TABLES_BY_NAME, "base", "part")


def keys_and_values(node: Any, path: KeyPath = ()) -> Iterator[KeyPath]:
    """List the paths of all keys and items below a value."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from keys_and_values(value, (*path, key))


def misspell(word: str, chance: random.Random) -> str:
    """Leave a letter out, double one, let two change places, or write another one."""
    at = chance.choice([k for k, letter in enumerate(word) if letter.isalpha()])
    others = [word[:at] + word[at + 1 :], word[:at] + word[at] + word[at:], word[:at] + "q" + word[at + 1 :]]
    return chance.choice([*others, word[:at] + word[at : at + 2][::-1] + word[at + 2 :]])


def misspelt_scenes(count: int, seed: int) -> Iterator[tuple[str, KeyPath, str, dict[str, Any]]]:
    """Misspell keys and values of ready scenes by turns, each so that a run refuses it.

    Texts and names of the user's own are left as they are: no schema can know what they should be.
    """
    chance = random.Random(seed)
    found = 0
    while found < count:
        name = chance.choice(sorted(READY))
        tables = deepcopy(READY[name])
        path = chance.choice([*keys_and_values(tables)])
        node: Any = tables
        for key in path[:-1]:
            node = node[key]
        names = [key for key in path if isinstance(key, str)]
        if found % 2 == 0:
            if not isinstance(path[-1], str) or (len(path) > 1 and path[-2] in TABLES_BY_NAME):
                continue
            word = misspell(path[-1], chance)
            node[word] = node.pop(path[-1])
        else:
            value = node[path[-1]]
            if not isinstance(value, str) or names[-1] in OWN or not any(map(str.isalpha, value)):
                continue
            word = node[path[-1]] = misspell(value, chance)
        try:
            load_scene(tables)
        except InputError:
            found += 1
            yield name, path, word, tables


def test_nearly_all_misspelt_keys_and_values_are_flagged(
    validator: jsonschema.Draft202012Validator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(str(files("fmd.models")))  # where files of the scenes are looked for
    missed = [found[:3] for found in misspelt_scenes(50, seed=0) if validator.is_valid(found[-1])]
    assert len(missed) <= 5, missed
