"""The page about the scene file: up to date, complete, and with examples that are right."""

import tomllib
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from docs.scene_reference.page import describe_table, list_keys, write_page
from docs.scene_reference.sections import SECTIONS
from docs.scene_reference.values import describe_values
from fmd.core.units import Length, PositiveTime
from fmd.scene.any_body import Body
from fmd.scene.curves import TimeFunction
from fmd.scene.force_elements import BearingTable, StiffnessTable
from fmd.scene.joints.any_joint import Joint
from fmd.scene.joints.revolute import Revolute
from fmd.scene.loads import Drive
from fmd.scene.outputs import Output
from fmd.scene.reading import SceneTable
from fmd.scene.runs import Run
from fmd.scene.scene import Scene
from fmd.scene.schema import read_docstring
from fmd.scene.state_loads import LoadOverTime, TorqueOverTime

PAGE = Path(__file__).parents[2] / "docs" / "scene.md"
TABLES = [section.table for section in SECTIONS if section.table is not None]


def subclasses_of(table: type) -> set[type]:
    return {table}.union(*(subclasses_of(below) for below in table.__subclasses__()))


def test_the_page_is_up_to_date():
    assert PAGE.read_text(encoding="utf-8") == write_page(), "python -m docs.scene_reference > docs/scene.md"


def test_the_page_describes_every_table_of_a_scene():
    same = {BearingTable, TimeFunction}  # whose keys those below them have
    alike = set().union(*(subclasses_of(table) for table in same)) - same
    ours = {table for table in subclasses_of(SceneTable) if table.__module__.startswith("fmd.")}
    bases = {table for table in ours if subclasses_of(table) != {table}}  # whose keys may stand with the tables
    assert ours - alike - bases == {*TABLES} - bases


def test_every_key_of_every_table_has_a_row_with_a_meaning():
    anchors = dict.fromkeys(TABLES, "#x")
    for table in TABLES:
        text = "\n".join(describe_table(table, "Kind.", anchors))
        for name, field in list_keys(table):
            (row,) = [line for line in text.splitlines() if line.startswith(f"| `{field.alias or name}` |")]
            assert len(row.split(" | ")[-1].strip(" |")) > 3, (table, name)


def test_a_key_without_a_meaning_is_an_error():
    class Undescribed(Revolute):
        """A joint with a key without a comment."""

        backlash: Length = 0.0

    with pytest.raises(ValueError, match="Undescribed doesn't say in a comment what backlash means"):
        list(describe_table(Undescribed, "", {}))


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.__name__)
def test_the_example_of_a_table_is_right(table: type[SceneTable]):
    example = read_docstring(table)[1]
    if not example:
        assert subclasses_of(table) != {table}, "only tables that others build on go without an example"
        return
    value: Any = tomllib.loads(example)
    kinds = {"body": Body, "joint": Joint, "drive": Drive, "output": Output}
    if table is Scene:
        Scene.model_validate(value)
        return
    header = example.splitlines()[0].strip("[]").split(".")
    for key in header:
        value = value[key]
    parts = 1 if header[0] == "output" else 2  # outputs have no names, so what follows is a table in one
    kind: Any = Run if header[:2] == ["simulation", "run"] else kinds.get(header[0]) if len(header) <= parts else table
    of_bases = {TimeFunction: TorqueOverTime, LoadOverTime: TorqueOverTime, BearingTable: StiffnessTable}
    kind = of_bases.get(table, kind or table)
    by_name = header[-1] in ("marker", "element", "link", "mass")
    values = value if isinstance(value, list) else value.values() if by_name else [value]
    for one in values:
        assert isinstance(TypeAdapter(kind).validate_python(one), table)


@pytest.mark.parametrize(
    ("annotation", "words", "unit"),
    [
        (PositiveTime, "time above 0", "s"),
        (PositiveTime | None, "time above 0", "s"),
        (tuple[Length, Length], "list of 2 lengths", "m"),
        (tuple[Length, ...], "list of lengths", "m"),
        (bool, "`true` or `false`", ""),
        (TorqueOverTime, "[torque over time](#here)", "N m"),
        (dict[str, Revolute], "[tables](#joint) by name", ""),
        (tuple[Revolute, ...], "list of [tables](#joint)", ""),
    ],
)
def test_values_are_described_by_their_types(annotation: Any, words: str, unit: str):
    found = describe_values(annotation, (), {TimeFunction: "#here", Revolute: "#joint"})
    assert (found.text, found.unit) == (words, unit)
