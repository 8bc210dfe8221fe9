"""The order of the layers and a few habits of the house, read off the sources' syntax trees.

Each rule is a function from sources to a list of faults; a test shows all faults of the project at once, and the last
tests show each rule a small source with a fault.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("fmd", "fmd/meshes", "fmd/models")  # the last two are links to folders at the root
MOST_LINES = 420  # most files have less than 250

_PHYSICS = ["fem", "reduction", "contact", "dynamics", "integrators", "recovery", "stability", "responses"]
# The rooms of `fmd` that each may import, beside itself.
MAY_IMPORT: dict[str, set[str]] = {"core": set(), "kernels": {"core"}, "render": {"core"}}
MAY_IMPORT |= {folder: {"core", "kernels", *_PHYSICS[:k]} for k, folder in enumerate(_PHYSICS)}
MAY_IMPORT["scene"] = {"core", "integrators"}  # a run makes its integrator
MAY_IMPORT["meshes"] = set()
MAY_IMPORT["stages"] = {"core", "kernels", "scene", "meshes", *_PHYSICS}
MAY_IMPORT["accuracy"] = {"stages", *MAY_IMPORT["stages"]}
MAY_IMPORT["output"] = {"accuracy", "render", *MAY_IMPORT["accuracy"]}
MAY_IMPORT |= {folder: {"output", *MAY_IMPORT["output"]} for folder in ("verification", "sweep", "fitting")}
MAY_IMPORT["cli"] = {"verification", "sweep", "fitting", *MAY_IMPORT["sweep"]}

# Packages that only one place may load.
OWNERS = {
    "gmsh": "fmd.meshes",
    "skfem": "fmd.fem",
    "meshio": "fmd.fem",
    "pyvista": "fmd.render",
    "vtk": "fmd.render",
    "vtkmodules": "fmd.render",
    "matplotlib": "fmd.render",
    "petsc4py": "fmd.reduction.factor",
    "slepc4py": "fmd.reduction.factor",
}
# Packages that take 50 ms or more to load, so that an import inside a function pays; `fmd.meshes` brings Gmsh.
HEAVY = {
    *("ansys", "control", "cvxopt", "dask", "distributed", "filelock", "gmsh", "h5py", "imageio", "jinja2", "joblib"),
    *("fmpy", "llvmlite", "mcp"),
    *("matplotlib", "meshio", "petsc4py", "pint", "psutil", "pymetis", "pyvista", "rich", "scipy", "skfem"),
    *("slepc4py", "vtk", "vtkmodules", "xarray"),
}
# So many modules of the package, of half a millisecond to a whole one each, are worth an import inside a function, too.
MANY = 4
MISSING_ON_SOME_SYSTEMS = {"resource"}
# `fmd --help` and `import fmd` load nothing but the standard library and the command line's own package.
HEAVY_FOR_COMMANDS = HEAVY | {"numpy", "pydantic"}

# Numbers that decide stand by subject in modules of this package; so one is found, weighed and changed in one place.
LIMITS = "fmd.core.limits"
# Rooms whose numbers are data: of pictures, of shapes, of published problems, of experiments.
DATA_ROOMS = {"render", "meshes", "models", "verification", "bench"}
# Numbers elsewhere that decide nothing: facts of a file format, of a method, of a machine, or measures of one drawing.
FACTS = {
    "fmd.contact.friction_newton": {"OPEN", "STICKS", "SLIPS"},
    "fmd.contact.histories": {
        *("FORCE", "IMPULSE", "MOMENT", "AREA", "PRESSURE", "ENERGY", "FRICTION", "DAMPED", "ERROR"),
        *("BEGIN", "END", "BORDER", "N_VALUES", "MOST_FORCE", "MOST_AREA", "MOST_PRESSURE"),
        *("SLIP", "MEAN_SLIP", "WORN", "MOST_WORN", "FORCE_AT", "PRESSURE_AT"),
    },
    "fmd.core.cache": {"_DIGEST_BYTES"},
    "fmd.core.child": {"_PR_SET_PDEATHSIG"},
    "fmd.core.encoding": {"_LENGTH_BYTES"},
    "fmd.core.state_formula": {"CHOOSE", "CURVE", "VARIABLE"},
    "fmd.core.formula": {"BEFORE", "UNTIL"},
    "fmd.core.netcdf": {"_CHAR", "_DOUBLE", "_DIMENSION", "_VARIABLE", "_ATTRIBUTE", "_LARGEST"},
    "fmd.dynamics.compiler.c_source": {"_PER_LINE"},
    "fmd.dynamics.compiler.parts": {"SPACING"},
    "fmd.dynamics.compiler.program": {"LANES"},
    "fmd.dynamics.compiler.functions": {"FIRST_STUMPFF", "LAST_STUMPFF", "LAST_ARC", "SERIES_LIMITS"},
    "fmd.dynamics.compiler.writer": {"_ROUNDING"},
    "fmd.fem.formats.stl": {"_HEADER", "_RECORD"},
    "fmd.fem.local_markers": {"_POINTS"},
    "fmd.integrators.runge_kutta": {"DAMPED", "_E3", "_E5", "_D"},
    "fmd.integrators.runge_kutta_adjoint": {"_STAGES", "_OF_END"},
    "fmd.kernels.machine": {"DIGEST_BYTES"},
    "fmd.kernels.table": {"_WORD", "_LINE"},
    "fmd.output.campbell": {"RPM"},
    "fmd.output.fmu.build": {"_FAT_MAGIC", "_FAT_ALIGNMENT"},
    "fmd.output.fmu.equations": {"_THIRD", "_FIFTH", "_DENSE"},
    "fmd.output.joint_marks": {"_NEAR", "_COILS", "_PER_COIL", "_WIRE"},
    "fmd.output.report.view3d": {
        *("_COLOURS", "_LARGEST", "_MOST_EDGES", "_MOST_FRAMES", "_LEAST_FRAMES", "_MOST_BYTES", "_BYTES_A_POINT"),
        "_REACHED",
    },
    "fmd.output.mechanism_view": {"_SLENDER", "_BALL", "_SAME", "_FLAT", "_THIN"},
    "fmd.reduction.body_file": {"VERSION"},
    "fmd.reduction.factor.factor": {"_GIGA"},
    "fmd.reduction.formats.openfast_file": {"_INTERFACE"},
    "fmd.stages.meshing.cad_files": {"_TETRAHEDRON"},
}

Sources = Mapping[str, str]


class Import(NamedTuple):
    """A module that another imports: at the top, inside a function, or for types alone."""

    name: str
    line: int
    where: str


@cache
def read_sources(base: Path, *folders: str) -> dict[str, str]:
    """Return the sources of all modules in some folders below a base, by dotted name."""
    sources = {}
    for path in sorted(path for folder in folders for path in (base / folder).rglob("*.py")):
        parts = path.relative_to(base).with_suffix("").parts
        sources[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path.read_text(encoding="utf-8")
    return sources


@cache
def parse(source: str) -> ast.Module:
    return ast.parse(source)


def imports_of(sources: Sources, module: str) -> list[Import]:
    return _all_imports(sources[module], frozenset(sources))


@cache
def _all_imports(source: str, known: frozenset[str]) -> list[Import]:
    return [*_imports(parse(source), known, "top")]


def _imports(tree: ast.AST, known: frozenset[str], where: str) -> Iterator[Import]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            yield from (Import(alias.name, node.lineno, where) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            names = {f"{module}.{alias.name}" for alias in node.names}
            yield from (Import(name, node.lineno, where) for name in sorted(names & known) or [module])
        elif isinstance(node, ast.If) and _name_of(node.test) == "TYPE_CHECKING":
            yield from _imports(ast.Module(node.body, []), known, "types")
            yield from _imports(ast.Module(node.orelse, []), known, where)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from _imports(node, known, "function")
        elif not isinstance(node, ast.expr):
            yield from _imports(node, known, where)


def statements(node: ast.AST) -> Iterator[ast.stmt]:
    """All statements inside a node, also those inside others; expressions, most of a tree, aren't walked."""
    for field in ("body", "orelse", "finalbody", "handlers", "cases"):
        for inner in getattr(node, field, ()):
            if isinstance(inner, ast.stmt):
                yield inner
            yield from statements(inner)


def _name_of(node: ast.AST) -> str:
    """Return the last name of what is called or asked for, as of ``module.name``."""
    return str(getattr(node, "attr", getattr(node, "id", "")))


def inside(module: str, package: str) -> bool:
    return module == package or module.startswith(f"{package}.")


def folder_of(module: str) -> str:
    """The room of `fmd` that a module is in; empty for the package itself and what isn't of it."""
    parts = module.split(".")
    return parts[1] if parts[0] == "fmd" and len(parts) > 1 else ""


def breaches_of_layers(sources: Sources) -> Iterator[str]:
    for module in sources:
        folder = folder_of(module)
        for name, line, _ in imports_of(sources, module):
            other = folder_of(name)
            if name.startswith("."):
                yield f"{module}:{line} has a relative import; write it out"
            elif folder in MAY_IMPORT and other in MAY_IMPORT and other not in {folder, *MAY_IMPORT[folder]}:
                yield f"{module}:{line} imports {name}, which doesn't stand below it"


def breaches_of_ownership(sources: Sources) -> Iterator[str]:
    for module in sources:
        for name, line, _ in imports_of(sources, module):
            package = name.partition(".")[0]
            owner = OWNERS.get(package)
            if owner and not inside(module, owner) and not inside(module, package):
                yield f"{module}:{line} imports {name}, which belongs to {owner}"


def circles(sources: Sources) -> Iterator[str]:
    needs = {module: {i.name for i in imports_of(sources, module)} & sources.keys() - {module} for module in sources}
    while True:
        try:
            TopologicalSorter(needs).prepare()
        except CycleError as error:
            circle: list[str] = error.args[1]
            yield " <- ".join(circle)
            needs[circle[1]] -= {circle[0]}  # to find the others
        else:
            return


def needless_late_imports(sources: Sources) -> Iterator[str]:
    """An import stands inside a function only if it loads a heavy package, or many modules that aren't loaded yet."""
    loads = {module: {i.name for i in imports_of(sources, module) if i.where == "top"} for module in sources}
    for module in sources:
        heavy = MISSING_ON_SOME_SYSTEMS | (
            HEAVY_FOR_COMMANDS if module == "fmd" or folder_of(module) == "cli" else HEAVY
        )
        late = [(name, line) for name, line, where in imports_of(sources, module) if where == "function"]
        before = _loaded_with(module, loads) if late else set()
        for name, line in late:
            loaded = _loaded_with(name, loads)
            is_heavy = any(each.partition(".")[0] in heavy or inside(each, "fmd.meshes") for each in loaded)
            if not is_heavy and len(loaded & sources.keys() - before) < MANY:
                yield f"{module}:{line} imports {name} inside a function, which loads nothing heavy"


def _loaded_with(name: str, loads: Mapping[str, set[str]]) -> set[str]:
    """Return a module and all that its import loads in turn."""
    seen, waiting = {name}, [name]
    while waiting:
        waiting += loads.get(name := waiting.pop(), set()) - seen
        seen |= loads.get(name, set())
    return seen


def classes_of_one_name(sources: Sources) -> Iterator[str]:
    places = defaultdict(list)
    for module in sources:
        for node in statements(parse(sources[module])):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(module)
    yield from (f"{name} is a class of {' and of '.join(at)}" for name, at in places.items() if len(at) > 1)


def misplaced_modules(sources: Sources) -> Iterator[str]:
    for module in sources:
        folder = folder_of(module)
        if folder and folder not in (*MAY_IMPORT, "models", "__main__"):
            yield f"{module} is in no layer"
        elif folder in MAY_IMPORT and module == f"fmd.{folder}" and _statements(sources[module]) > 1:
            yield f"{module} holds more than its docstring"


def _statements(source: str) -> int:
    return len(parse(source).body)


def long_files(sources: Sources) -> Iterator[str]:
    for module, source in sources.items():
        if (lines := len(source.splitlines())) > MOST_LINES:
            yield f"{module} has {lines} lines"


def prints(sources: Sources) -> Iterator[str]:
    """A library returns and raises: only the command line, and what runs as a process of its own, prints and exits."""
    for module in sources:
        if folder_of(module) in ("cli", "__main__") or not {"print", "exit"} & {*re.findall(r"\w+", sources[module])}:
            continue
        body = [node for node in parse(sources[module]).body if not _is_main_guard(node)]
        for node in ast.walk(ast.Module(body, [])):
            printing = isinstance(node, ast.Call) and _name_of(node.func) in ("print", "exit")
            if printing and ast.unparse(node.func) in ("print", "exit", "sys.exit"):
                yield f"{module}:{node.lineno} calls {ast.unparse(node.func)}"


def loose_numbers(sources: Sources) -> Iterator[str]:
    """Numbers at the top of a module belong to `LIMITS`; tables of numbers, in brackets, are coefficients and stay."""
    for module, source in sources.items():
        if inside(module, LIMITS) or folder_of(module) in DATA_ROOMS:
            continue
        for node in parse(source).body:
            if names := _names_of_numbers(node) - FACTS.get(module, set()):
                yield f"{module}:{node.lineno} decides by {', '.join(sorted(names))}, which belongs to {LIMITS}"


def _names_of_numbers(node: ast.stmt) -> set[str]:
    """Names that a statement gives a number each, be it by arithmetic."""
    if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
        return set()
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    several = isinstance(targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple)
    pairs = zip(targets[0].elts, node.value.elts, strict=True) if several else [(targets[0], node.value)]
    arithmetic = ast.Constant | ast.BinOp | ast.UnaryOp | ast.Name | ast.operator | ast.unaryop | ast.expr_context
    return {
        ast.unparse(name)
        for name, value in pairs
        if all(isinstance(part, arithmetic | ast.Attribute) or _is_function(part) for part in ast.walk(value))
        and any(isinstance(part, ast.Constant) and type(part.value) in (int, float) for part in ast.walk(value))
    }


def _is_function(node: ast.AST) -> bool:
    """Tell a function of numbers, as a cosine, from other calls."""
    functions = ("np.cos", "np.deg2rad", "np.finfo", "np.sqrt", "math.cos", "math.radians", "math.sqrt", "float", "int")
    return isinstance(node, ast.Call) and ast.unparse(node.func) in functions


def unexplained_numbers(sources: Sources) -> Iterator[str]:
    """A number that decides has a comment with its meaning, behind it or in the lines before."""
    for module, source in sources.items():
        lines = source.splitlines()
        for node in parse(source).body if inside(module, LIMITS) else []:
            told = "  # " in lines[node.lineno - 1] or lines[node.lineno - 2].startswith("# ")
            if _names_of_numbers(node) and not told:
                yield f"{module}:{node.lineno} has no comment with its meaning"


def guessed_abilities(sources: Sources) -> Iterator[str]:
    """What a system can do it answers itself: integrators don't look for its attributes."""
    for module, source in sources.items():
        for node in ast.walk(parse(source)) if inside(module, "fmd.integrators") else []:
            if isinstance(node, ast.Call) and _name_of(node.func) in ("getattr", "hasattr"):
                yield f"{module}:{node.lineno} looks for an attribute; PlainSystem has the answer of most systems"


def undeferred_types(sources: Sources) -> Iterator[str]:
    """What is imported for types alone isn't there when annotations that aren't deferred are read; mypy misses it."""
    for module, source in sources.items():
        if "\nif TYPE_CHECKING:" in source and "from __future__ import annotations" not in source:
            yield f"{module} imports for types alone and doesn't defer its annotations"


def early_main_guards(sources: Sources) -> Iterator[str]:
    """What stands below the guard isn't there yet when the module is called by `python -m`."""
    for module, source in sources.items():
        body = parse(source).body if "__main__" in source else []
        for node in filter(_is_main_guard, body[:-1]):
            yield f"{module}:{node.lineno} runs before the functions below it are there"


def _is_main_guard(node: ast.stmt) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) == "__name__ == '__main__'"


def assertionless_tests(sources: Sources) -> Iterator[str]:
    """A test asserts, expects an error, or calls a function of the tests that does."""
    functions = [
        (module, node)
        for module in sources
        for node in statements(parse(sources[module]))
        if isinstance(node, ast.FunctionDef)
    ]
    calls = [(function.name, _calls(function)) for _, function in functions]
    asserting = {"assert", "raises", "warns", "check=True"}
    while more := {name for name, called in calls if not name.startswith("test_") and called & asserting} - asserting:
        asserting |= more
    for (module, function), (name, called) in zip(functions, calls, strict=True):
        if name.startswith("test_") and not called & asserting:
            yield f"{module}:{function.lineno} {name} asserts nothing"


def _calls(function: ast.FunctionDef) -> set[str]:
    """The word "assert" if a function holds one, else the names of what it calls, without what they belong to."""
    if any(isinstance(node, ast.Assert) for node in statements(function)):
        return {"assert"}
    called = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Call):
            name = _name_of(node.func)
            called.add("assert" if name.startswith("assert_") else name)
            called |= {ast.unparse(keyword) for keyword in node.keywords if keyword.arg == "check"}
    return called


RULES: list[Callable[[Sources], Iterator[str]]] = [
    breaches_of_layers,
    breaches_of_ownership,
    circles,
    needless_late_imports,
    classes_of_one_name,
    misplaced_modules,
    long_files,
    prints,
    loose_numbers,
    unexplained_numbers,
    guessed_abilities,
    undeferred_types,
    early_main_guards,
]


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_the_project_keeps_the_rule(rule: Callable[[Sources], Iterator[str]]) -> None:
    assert not (faults := [*rule(read_sources(ROOT / "pipeline", *PACKAGES))]), "\n".join(["", *faults])


def test_every_test_asserts() -> None:
    assert not (faults := [*assertionless_tests(read_sources(ROOT, "tests"))]), "\n".join(["", *faults])


@pytest.mark.parametrize(
    ("rule", "sources", "fault"),
    [
        (breaches_of_layers, {"fmd.fem.mesh": "import fmd.scene.scene"}, "doesn't stand below it"),
        (breaches_of_layers, {"fmd.core.a": "def f():\n    import fmd.fem.b"}, "fmd.core.a:2 imports"),
        (breaches_of_layers, {"fmd.render.a": "if TYPE_CHECKING:\n    import fmd.fem.b"}, "fmd.fem.b"),
        (breaches_of_layers, {"fmd.stages.a": "import fmd.render.b"}, "fmd.render.b"),
        (breaches_of_layers, {"fmd.meshes.bar": "import fmd.core.errors"}, "doesn't stand below it"),
        (breaches_of_layers, {"fmd.fem.a": "from . import b"}, "relative import"),
        (breaches_of_ownership, {"fmd.stages.meshing": "import gmsh"}, "gmsh, which belongs to fmd.meshes"),
        (breaches_of_ownership, {"fmd.output.a": "from matplotlib.figure import F"}, "belongs to fmd.render"),
        (circles, {"fmd.fem.a": "import fmd.fem.b", "fmd.fem.b": "import fmd.fem.a"}, " <- "),
        (
            circles,
            {"p.a": "import p.b", "p.b": "def f():\n    import p.c", "p.c": "if TYPE_CHECKING:\n    import p.a"},
            "p.a <- p.c <- p.b <- p.a",
        ),
        (needless_late_imports, {"fmd.fem.a": "def f():\n    import json"}, "json inside a function"),
        (
            needless_late_imports,
            {"fmd.fem.a": "def f():\n    from fmd.fem import b", "fmd.fem.b": "import numpy"},
            "fmd.fem.b inside a function",
        ),
        (classes_of_one_name, {"a": "class Row: ...", "b": "class Row: ..."}, "Row is a class of a and of b"),
        (misplaced_modules, {"fmd.tools": ""}, "fmd.tools is in no layer"),
        (misplaced_modules, {"fmd.fem": "'''Doc.'''\nimport fmd.fem.mesh"}, "more than its docstring"),
        (long_files, {"fmd.fem.a": "\n" * (MOST_LINES + 1)}, f"{MOST_LINES + 1} lines"),
        (prints, {"fmd.fem.a": "print(1)"}, "calls print"),
        (loose_numbers, {"fmd.fem.a": "_SMALL = 1e-9"}, "fmd.fem.a:1 decides by _SMALL"),
        (loose_numbers, {"fmd.fem.a": "import b\nfirst, _MOST = 3, 2 * b"}, "fmd.fem.a:2 decides by _MOST, first"),
        (loose_numbers, {"fmd.fem.a": "most: float = -(1 << 4)"}, "decides by most"),
        (loose_numbers, {"fmd.fem.a": "_SHARP = np.cos(np.deg2rad(40.0))"}, "decides by _SHARP"),
        (unexplained_numbers, {"fmd.core.limits.a": "# Of all.\n\nMOST = 3"}, "3 has no comment"),
        (guessed_abilities, {"fmd.integrators.a": "loops = hasattr(s, 'loops')"}, "a:1 looks for an attribute"),
        (undeferred_types, {"fmd.fem.a": "\nif TYPE_CHECKING:\n    import fmd.core.b"}, "a imports for types alone"),
        (early_main_guards, {"fmd.fem.a": "if __name__ == '__main__':\n    f()\ndef f(): pass"}, "a:1 runs before"),
        (assertionless_tests, {"tests.test_a": "def test_f(): g()\ndef g(): pass"}, "test_f asserts nothing"),
    ],
)
def test_a_rule_finds_its_fault(rule: Callable[[Sources], Iterator[str]], sources: Sources, fault: str) -> None:
    (found,) = rule(sources)
    assert fault in found


@pytest.mark.parametrize(
    "sources",
    [
        {"fmd.meshes.bar": "import gmsh\nfrom fmd.meshes.ring import cells"},
        {"fmd.stages.meshing": "def f():\n    import fmd.meshes.bar", "fmd.meshes.bar": "import gmsh"},
        {"fmd.render.film": "import pyvista\nfrom fmd.core.files import whole_file"},
        {"fmd.cli.a": "def f():\n    import fmd.stages.b", "fmd.stages.b": "import numpy"},
        {"fmd.output.a": "def f():\n    import fmd.recovery.b", "fmd.recovery.b": "import scipy.linalg"},
        {"fmd.cli.a": "print(1)"},
        {"fmd.core.limits.a": "MOST = 3  # tries\n# Of the largest.\nSMALL = 1e-9"},
        {"fmd.fem.a": "TABLE = (0.5, 0.25)\nPI = math.pi\nname = 'a'\nkind = Kind(8, 1.5)"},
        {"fmd.render.a": "WIDE = 0.3"},
        {"fmd.meshes.cad": "if __name__ == '__main__':\n    print(1)"},
        {"tests.test_a": "def test_f(): g()\ndef g(): h()\ndef h(): assert True"},
    ],
)
def test_what_keeps_the_rules_is_let_through(sources: Sources) -> None:
    assert [fault for rule in [*RULES, assertionless_tests] for fault in rule(sources)] == []
