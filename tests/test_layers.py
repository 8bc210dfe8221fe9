"""The layers: who may import whom, read off the source by its syntax tree; and a few habits of the house."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parent.parent
SOURCES = sorted(path for folder in ("meshes", "pipeline") for path in (ROOT / folder).rglob("*.py"))
MOST_LINES = 460

# Each layer imports from itself and from those above it in this list.
LAYERS = (
    {"units", "checks", "tensors", "expression", "folders", "files", "progress", "cache", "keeper", "html"},
    {"fem"},
    {"reduction"},
    {"dynamics"},
    {"integrators"},
    {"recovery"},
    {"studies"},
    {
        *{"scene", "scene_file", "scene_time", "scene_shapes", "scene_files"},
        *{"scene_parts", "scene_outputs", "scene_runs"},
        *{"mechanism", "methods", "inboard", "part", "attachments", "shapes", "sources", "spin"},
        *{"stages", "plan", "frequencies", "quantities", "outputs", "drawings", "picture_files", "exports"},
        *{"stability", "course", "stress_test", "stress_cases"},
        *{"neighbours", "observed", "coarse", "estimates", "budget", "accuracy"},
        *{"summary", "tables", "bench", "mode_study", "whole_runs", "doctor", "sweep", "verification"},
        *{"report", "notebook", "starting", "templates", "commands", "cli"},
        *{"__init__", "__main__"},
    },
)
# Pictures stand beside the calculation: they know nothing of it, and only the last layer knows them.
RENDER = "render"
TOP = len(LAYERS) - 1

# Packages that only one place may load.
OWNERS = {
    "gmsh": "meshes",
    "skfem": "pipeline.fem",
    "meshio": "pipeline.fem",
    "pyvista": "pipeline.render",
    "vtk": "pipeline.render",
    "vtkmodules": "pipeline.render",
    "matplotlib": "pipeline.render",
    "meshes": "pipeline.stages.meshing",
}


class Import(NamedTuple):
    """A module that is imported, and whether that happens as soon as the importer is: not for types, not later on."""

    name: str
    line: int
    at_once: bool


def imports(tree: ast.AST, at_once: bool = True) -> Iterator[Import]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            yield from (Import(alias.name, node.lineno, at_once) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            # `from pipeline.render import probe` imports a module, `from pipeline.core.errors import Array` doesn't
            whole = [f"{module}.{alias.name}" for alias in node.names if is_module(f"{module}.{alias.name}")]
            yield from (Import(name, node.lineno, at_once) for name in whole or [module])
        elif isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            for inner in node.body:
                yield from imports(ast.Module([inner], []), at_once=False)
            yield from imports(ast.Module(node.orelse, []), at_once)
        else:
            yield from imports(node, at_once and not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


def is_module(name: str) -> bool:
    path = ROOT.joinpath(*name.split("."))
    return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts if parts[-1] != "__init__" else parts[:-1])


def inside(module: str, package: str) -> bool:
    return module == package or module.startswith(f"{package}.")


def part(module: str) -> str:
    """Folder or file below ``pipeline`` that a module belongs to."""
    return module.split(".")[1] if "." in module else "__init__"


def layer(module: str) -> int:
    return next(k for k, names in enumerate(LAYERS) if part(module) in names)


def faults(module: str, source: str) -> list[str]:
    """Say what a module imports against the rules."""
    found = []
    for imported in imports(ast.parse(source)):
        name = imported.name
        if name.startswith("."):
            found.append(f"line {imported.line}: a relative import; write it out")
            continue
        owner = OWNERS.get(name.partition(".")[0])
        if owner and not inside(module, owner) and module.partition(".")[0] != name.partition(".")[0]:
            found.append(f"line {imported.line}: {name} belongs to {owner}")
        if not inside(name, "pipeline"):
            continue
        if not inside(module, "pipeline"):
            found.append(f"line {imported.line}: {name} is not for {module}")
        elif part(module) == RENDER:
            if part(name) != RENDER and (part(name) not in LAYERS[0]):
                found.append(f"line {imported.line}: pictures know nothing of {name}")
        elif part(name) == RENDER:
            if layer(module) != TOP:
                found.append(f"line {imported.line}: {module} knows nothing of pictures")
        elif layer(name) > layer(module):
            found.append(f"line {imported.line}: {name} stands below {module}")
    return found


@pytest.mark.parametrize("path", SOURCES, ids=module_of)
def test_a_module_imports_only_from_the_layers_above_it(path: Path) -> None:
    assert faults(module_of(path), path.read_text(encoding="utf-8")) == []


def test_every_module_has_its_layer() -> None:
    known = {RENDER}.union(*LAYERS)
    parts = {part(module_of(path)) for path in SOURCES if inside(module_of(path), "pipeline")}
    assert parts - known == set()


def test_modules_do_not_import_one_another_in_circles() -> None:
    needs = {}
    for path in SOURCES:
        found = imports(ast.parse(path.read_text(encoding="utf-8")))
        needs[module_of(path)] = {i.name for i in found if i.at_once and is_module(i.name)}
    needs["pipeline"] = set()  # it offers what is below it by name, when asked
    while free := {name for name, wanted in needs.items() if not wanted & needs.keys()}:
        needs = {name: wanted for name, wanted in needs.items() if name not in free}
    assert needs == {}


@pytest.mark.parametrize(
    ("module", "line", "fault"),
    [
        ("pipeline.fem.mesh", "import gmsh", "gmsh belongs to meshes"),
        ("pipeline.fem.mesh", "from meshes.bar import hexahedral_bar", "meshes.bar belongs to pipeline.stages.meshing"),
        ("pipeline.reduction.eigen", "def f():\n    import skfem.utils", "skfem.utils belongs to pipeline.fem"),
        (
            "pipeline.output.write",
            "from matplotlib.figure import Figure",
            "matplotlib.figure belongs to pipeline.render",
        ),
        (
            "pipeline.cli.doctor_checks",
            "import vtkmodules.vtkCommonCore",
            "vtkmodules.vtkCommonCore belongs to pipeline.render",
        ),
        ("meshes.bar", "from pipeline.core.errors import Array", "pipeline.core.errors is not for meshes.bar"),
        ("pipeline.fem.mesh", "from pipeline.reduction.modes import Modes", "pipeline.reduction.modes stands below"),
        (
            "pipeline.core.errors",
            "from pipeline.scene.scene import Scene",
            "pipeline.scene.scene stands below pipeline.core.errors",
        ),
        ("pipeline.recovery.stress", "from pipeline import stages", "pipeline.stages.pipeline stands below"),
        ("pipeline.dynamics.rotor.rotor", "if TYPE_CHECKING:\n    import pipeline.recovery.motion", "stands below"),
        ("pipeline.recovery.stress", "from pipeline.render.charts import Curve", "knows nothing of pictures"),
        ("pipeline.render.charts", "from pipeline.fem.mesh import SolidMesh", "pictures know nothing of"),
        ("pipeline.fem.mesh", "from .model import FEModel", "a relative import"),
        ("pipeline.fem.mesh", "from . import model", "a relative import"),
    ],
)
def test_what_is_against_the_rules_is_found(module: str, line: str, fault: str) -> None:
    found = faults(module, line)
    assert len(found) == 1
    assert fault in found[0]


@pytest.mark.parametrize(
    ("module", "line"),
    [
        ("meshes.gmsh_session", "import gmsh"),
        ("meshes.bar", "from meshes.gmsh_session import gmsh_model"),
        ("pipeline.stages.meshing", "from meshes.bar import hexahedral_bar"),
        ("pipeline.fem.model", "import skfem, meshio"),
        ("pipeline.recovery.stress", "from pipeline.fem.model import FEModel"),
        ("pipeline.cli.doctor_checks", "from pipeline.render import probe"),
        ("pipeline.render.film", "from pipeline.core.files import whole_file"),
    ],
)
def test_what_is_within_the_rules_is_let_through(module: str, line: str) -> None:
    assert faults(module, line) == []


@pytest.mark.parametrize("path", SOURCES, ids=module_of)
def test_a_file_is_not_too_long(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= MOST_LINES


@pytest.mark.parametrize(
    "path", [path for path in SOURCES if part(module_of(path)) not in ("cli", "commands")], ids=module_of
)
def test_the_library_prints_nothing(path: Path) -> None:
    calls = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
    assert [call.lineno for call in calls if ast.unparse(call.func) == "print"] == []
