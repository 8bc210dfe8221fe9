"""Comments of data classes' fields, which the site and the schema of scenes show, are read and stand once."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def test_comments_of_fields_are_for_one_field_each_and_not_for_tools() -> None:
    griffe = pytest.importorskip("griffe")
    code = """
class Sizes:
    length: float  # of the bar [m]
    width: float = field()  # [m]  # type: ignore[assignment]
    # Of the bar
    # at rest [kg].
    mass: float  # noqa: E501
    q: Array  # positions and rates
    v: Array
    name: str
"""
    with griffe.temporary_visited_module(
        code, extensions=griffe.load_extensions(str(DOCS / "field_comments.py"))
    ) as module:
        texts = {name: field.docstring and field.docstring.value for name, field in module["Sizes"].members.items()}
    expected = {"length": "Of the bar [m]", "width": "[m]", "mass": "Of the bar at rest [kg].", "q": None, "v": None}
    assert texts == expected | {"name": None}


def test_fields_of_data_classes_have_comments_of_their_own_and_no_entries_in_docstrings() -> None:
    """Arrays of kernels' tables and keys of scenes may share one."""
    pytest.importorskip("griffe")
    from fmd.scene.schema import comments_of_fields

    sources = {path: path.read_text(encoding="utf-8") for path in (ROOT / "pipeline").rglob("*.py")}
    trees = {
        path: ast.parse(source) for path, source in sources.items() if "@dataclass" in source or "SceneTable" in source
    }
    classes = [(path, node) for path, tree in trees.items() for node in tree.body if isinstance(node, ast.ClassDef)]
    tables = {"Table", "SceneTable"}
    for _ in range(4):
        tables |= {node.name for _, node in classes if tables & {ast.unparse(base) for base in node.bases}}
    wrong = []
    for path, node in classes:
        entries = re.findall(r"^(\w+(?:, \w+)*) : ", ast.get_docstring(node) or "", re.MULTILINE)
        said = {name for entry in entries for name in entry.split(", ")}
        is_table = node.name in tables
        for field, text, is_shared in comments_of_fields(node, sources[path].splitlines()):
            if (is_shared and not is_table) or (field.target.id in said and (is_table or _is_data_class(node))):
                wrong.append(f"{path.name}: {node.name}.{field.target.id}: {text}")
    assert wrong == []


def _is_data_class(node: ast.ClassDef) -> bool:
    return any("dataclass" in ast.unparse(decorator) for decorator in node.decorator_list)
