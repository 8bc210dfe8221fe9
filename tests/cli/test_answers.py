"""Schemas of what commands print with ``--json``; the fixture ``fmd`` holds every answer of the tests against them."""

import json

import jsonschema
import pytest

from fmd.cli.answers import answer_schema, list_commands, main, read_answers
from fmd.core.errors import InputError


def test_each_command_has_a_schema() -> None:
    for command in list_commands():
        schema = answer_schema(command)
        jsonschema.Draft202012Validator.check_schema(schema)
        assert schema["title"] == f"fmd {command} --json"


def test_each_table_is_part_of_an_answer() -> None:
    used = {name for command in list_commands() for name in answer_schema(command)["$defs"]}
    assert used | {"commands", "found-modes"} == read_answers().keys()


def test_a_command_without_json_has_no_schema() -> None:
    with pytest.raises(InputError, match="prints no JSON"):
        answer_schema("new")
    with pytest.raises(InputError, match="prints no JSON"):
        answer_schema("commands")


def test_a_key_too_many_too_few_or_of_another_kind_is_seen() -> None:
    validator = jsonschema.Draft202012Validator(answer_schema("export"))
    assert validator.is_valid({"format": "sid", "files": ["a.SID_FEM"]})
    for wrong in ({"format": "sid"}, {"format": "sid", "files": [1]}, {"format": "sid", "files": [], "x": 1}):
        assert not validator.is_valid(wrong)


BEAM = ["beam-paper", "--set", "body.beam.mesh.divisions=[6,1,1]", "--set", "simulation.duration=2 ms"]
BEAM += ["--set", "simulation.output_step=0.1 ms", "--set", "output=[]"]


@pytest.mark.parametrize(
    "command",
    [
        ["view", *BEAM, "--no-browser"],
        ["run", *BEAM, "--explain"],
        ["run", *BEAM, "--dry-run"],
    ],
    ids=lambda command: command[0],
)
def test_what_a_command_prints_is_what_its_schema_says(
    command, fmd, capsys, tmp_path, monkeypatch
) -> None:  # fmd checks
    monkeypatch.chdir(tmp_path)
    assert fmd(*command, "--json") == 0  # it checks
    assert json.loads(capsys.readouterr().out)


def test_the_module_prints_a_schema_and_names_the_commands_that_have_one(capsys) -> None:
    assert main(["export"]) == 0
    assert json.loads(capsys.readouterr().out) == answer_schema("export")
    assert main([]) == 2
    assert f"COMMAND: takes one command; the commands that do: {', '.join(list_commands())}" in capsys.readouterr().err
    assert main(["exprot"]) == 2
    assert "prints no JSON; did you mean 'export'? the commands that do: " in capsys.readouterr().err
