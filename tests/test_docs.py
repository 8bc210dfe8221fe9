"""README and pages agree with code and measurements: tables, commands, names of files."""

import ast
import re
import runpy
import shlex
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pytest

from docs.json_reference import write_page
from fmd.cli.app import app
from fmd.scene.result_names import require_results
from fmd.scene.scene import load_scene
from fmd.sweep.points import split_names

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
ROOMS = sorted({path.parent.name for path in (ROOT / "pipeline" / "fmd").glob("*/__init__.py")} - {"models"})
PAGES = sorted(chain(ROOT.glob("*.md"), DOCS.glob("*.md")))


def test_the_tables_of_the_pages_are_those_of_the_benchmarks() -> None:
    tables = runpy.run_path(str(ROOT / "benchmarks" / "tables.py"))
    used = set()
    for path in DOCS.glob("*.md"):
        page = path.read_text(encoding="utf-8")
        used |= {slot[1] for slot in tables["SLOT"].findall(page)}
        assert tables["fill_tables"](page) == page, f"{path.name}: run python benchmarks/tables.py"
    assert used == set(tables["TABLES"])


def test_the_page_of_answers_is_what_their_schemas_say() -> None:
    assert (DOCS / "json.md").read_text(encoding="utf-8") == write_page(), (
        "python -m docs.json_reference > docs/json.md"
    )


@pytest.mark.parametrize("path", [*PAGES, *DOCS.glob("jobs/*.md")], ids=lambda path: path.name)
def test_commands_of_a_page_have_their_options_and_results(path: Path) -> None:
    """Commands on scenes of a reader's own are read; of the ready ones results must be there, too."""
    blocks = re.findall(r"```bash\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL)
    for words in chain.from_iterable(map(_commands, blocks)):
        command, bound, _ = app.parse_args(words[1:], print_error=False, exit_on_error=False)
        assert command.__module__ == f"fmd.cli.{words[1]}"
        given = bound.arguments
        if given.get("of") and words[1] in ("sweep", "sensitivities") and "." not in given["scene"]:
            settings = given["options"].set_ if "options" in given else given.get("set_")
            require_results(load_scene(given["scene"], settings or ()), split_names("--of", given["of"]))


def _commands(block: str) -> Iterator[list[str]]:
    """Yield the words of each `fmd` command; one whose quotes are open goes on in the next line."""
    text = ""
    for line in block.replace("\\\n", " ").splitlines():
        text += line + "\n"
        if text.startswith("fmd ") and text.count("'") % 2:
            continue
        if text.startswith("fmd "):
            yield shlex.split(text, comments=True)
        text = ""


def test_the_readme_is_a_door() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 130


def test_the_commands_of_the_readme_are_those_of_the_command_line(fmd: Any, capsys: pytest.CaptureFixture[str]) -> None:
    rows = re.findall(r"^\| `fmd (\w+)(.*?)` \|", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    fmd("--help")
    commands = re.findall(r"^  ([a-z]+)  ", capsys.readouterr().out, re.MULTILINE)
    assert sorted(command for command, _ in rows) == sorted(commands)
    for command, text in rows:
        fmd(command, "--help")
        said = capsys.readouterr().out
        for option in re.findall(r"--[\w-]+", text):
            assert re.search(rf"{option}\b", said), f"fmd {command} has no {option}"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_files_that_a_page_names_exist(path: Path) -> None:
    page = path.read_text(encoding="utf-8")
    linked = [target.partition("#")[0] for target in re.findall(r"\]\(([^)\s]+)\)", page) if "://" not in target]
    missing = [target for target in linked if target and not (path.parent / target).exists()]
    for name in re.findall(r"`((?:[\w-]+/)+[\w*-]+\.(?:py|csv|md|toml))`", page):
        places = (ROOT, ROOT / "pipeline" / "fmd", DOCS)
        if not name.startswith("out/") and not any(list(place.glob(name)) for place in places):
            missing.append(name)
    for name in re.findall(r"`(fmd(?:\.\w+)+)`", page):
        module, _, last = name.replace(".", "/").rpartition("/")
        folder = ROOT / "pipeline" / module
        places = (folder / last, folder / f"{last}.py")
        sources = [source for source in (folder.with_suffix(".py"), folder / "__init__.py") if source.exists()]
        if not any(place.exists() for place in places) and not any(last in source.read_text() for source in sources):
            missing.append(name)
    assert not missing


def test_every_page_is_reached_from_the_index_and_is_in_the_menu() -> None:
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    reached, new = set[Path](), [DOCS / "index.md"]
    while new:
        page = new.pop()
        reached.add(page)
        links = re.findall(r"\]\(([^)\s#]+\.(?:md|ipynb))(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
        linked = {(page.parent / target).resolve() for target in links if "://" not in target}
        new += [path for path in linked if path.suffix == ".md" and path.is_relative_to(DOCS) and path not in reached]
        reached |= linked
    pages = [*DOCS.glob("*.md"), *DOCS.glob("api/*.md"), *DOCS.glob("*.ipynb")]
    assert not [path.name for path in pages if path not in reached]
    assert not [path.name for path in pages if path.suffix == ".md" and f": {path.relative_to(DOCS)}\n" not in menu]


def test_the_names_of_the_glossary_are_in_the_code() -> None:
    page = (DOCS / "glossary.md").read_text(encoding="utf-8")
    rows = [line.split("|")[3] for line in page.splitlines() if line.startswith("| ")]
    names = [name for place in rows for name in re.findall(r"`([\w.]+)`", place)]
    assert len(names) > 60
    assert not [name for name in names if not _is_there(f"fmd.{name}")]


def _is_there(name: str) -> bool:
    """Return true if a dotted name is a module, or what one defines; a field of a class counts."""
    owner, _, last = name.rpartition(".")
    try:
        found = resolve_name(owner)
    except (AttributeError, ImportError):
        return False
    return hasattr(found, last) or last in getattr(found, "__annotations__", {}) or _has_module(name)


def _has_module(name: str) -> bool:
    """Return true if a package has a module of a dotted name."""
    return (ROOT / "pipeline" / f"{name.replace('.', '/')}.py").exists()


def test_every_room_has_its_page_of_reference() -> None:
    stubs = {path.stem: path.read_text(encoding="utf-8") for path in (DOCS / "api").glob("*.md")}
    assert sorted(stubs) == ROOMS
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for room, stub in stubs.items():
        assert stub.endswith(f"::: fmd.{room}\n")
        assert f"{room}: api/{room}.md\n" in menu


def test_the_changelog_has_one_line_or_two_for_each_change() -> None:
    unreleased = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## ")[1]
    headings = re.findall(r"^### (.*)$", unreleased, re.MULTILINE)
    assert headings == ["Added", "Changed", "Fixed", "Removed"]


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


@pytest.mark.parametrize("home", ["fmd.core.data_classes", "dataclasses"])
def test_pages_have_the_arguments_of_data_classes(home: str) -> None:
    griffe = pytest.importorskip("griffe")
    code = f"from {home} import dataclass\n@dataclass\nclass Sizes:\n    length: float\n    width: float = 0.0\n"
    extensions = griffe.load_extensions("dataclasses", str(DOCS / "field_comments.py"))
    with griffe.temporary_visited_package("own", {"__init__.py": code}, extensions=extensions) as package:
        assert [each.name for each in package["Sizes"].parameters] == ["self", "length", "width"]


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
