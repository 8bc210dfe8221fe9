"""C code of programs agrees with their machine code to round-off, and is the same text each time."""

import ctypes
import shutil
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.dynamics.compiler.c_source import write_c
from fmd.dynamics.compiler.compiled import CompiledMechanism, compile_mechanism
from fmd.dynamics.compiler.functions import FUNCTIONS, evaluate_function
from fmd.dynamics.compiler.graph import Graph
from fmd.dynamics.compiler.program import LANES, Output, Program
from tests.dynamics.compiler.comparison import TIME, difference
from tests.dynamics.compiler.mechanisms import random_mechanism

COMPILER = shutil.which("cc") or shutil.which("gcc")
STRICT = ["-std=c99", "-O1", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
Built = Callable[[dict[str, Program]], ctypes.CDLL]

needs_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")


@pytest.fixture
def build(tmp_path: Path) -> Built:
    """Compile programs to a library."""

    def made(programs: dict[str, Program]) -> ctypes.CDLL:
        source, library = tmp_path / "f.c", tmp_path / "f.so"
        source.write_text(write_c(programs))
        assert COMPILER is not None
        subprocess.run([COMPILER, *STRICT, str(source), "-o", str(library), "-lm"], check=True)
        return ctypes.CDLL(str(library))

    return made


def call(function: object, read: list[Array], filled: list[Array]) -> None:
    lists = [(ctypes.c_void_p * len(side))(*(array.ctypes.data for array in side)) for side in (read, filled)]
    function(*lists)  # type: ignore[operator]


def arguments_of(compiled: CompiledMechanism, names: tuple[str, ...], lanes: tuple[str, ...]) -> dict[str, Array]:
    """Make arrays for a function's arguments, random ones but for the signals' values."""
    random, mechanism = np.random.default_rng(5), compiled.mechanism
    sizes = {"q": mechanism.n_positions, "dq": mechanism.n_positions, "step": 1, "energies": 2, "momenta": 6}
    n = len(mechanism.links)
    sizes |= {"origins": 3 * n, "spins": 3 * n, "rotations": 9 * max(n, sum(len(x.markers) for x in mechanism.links))}
    sizes |= dict.fromkeys(("inputs", "dinputs"), compiled.signal_values(TIME).size)
    made = {k: 0.1 * random.normal(size=(sizes.get(k, mechanism.n), LANES if k in lanes else 1)) for k in names}
    if "q" in made:  # unit quaternions where there are some
        size = np.full(mechanism.n_positions, 0.1)
        for body in range(n):  # deflections at which the mass matrix is positive definite
            size[mechanism.modes_of(body) + mechanism.n_positions - mechanism.n] = 0.001
        made["q"] = (mechanism.rest_positions + size * random.normal(size=mechanism.n_positions))[:, None].copy()
    return made | {"inputs": compiled.signal_values(TIME)}


ROUND_OFF = 1e-11  # of sums contracted in one and not in the other, through solutions of a condition of some thousands
NAMES = ("accelerations", "residual", "leap", "tangents", "solve", "frames", "energies", "momenta")


def compare(compiled: CompiledMechanism, build: Built, names: Sequence[str] = NAMES) -> None:
    slides = compiled.mechanism.n_positions == compiled.mechanism.n  # quaternions don't leap
    programs = {name: compiled.program(name) for name in names if slides or name != "leap"}
    library = build({f"c_{name}": program for name, program in programs.items()})
    for name, program in programs.items():
        arrays = arguments_of(compiled, program.arguments, program.lanes)
        by_c = {k: x.copy() for k, x in arrays.items()}
        compiled.call(name, *(arrays[k] for k in program.arguments))
        filled = {output.place[0] for output in program.outputs}
        nodes = [program.graph.nodes[k] for k in program.nodes]
        inputs = {node.data[0] for node in nodes if node.operation in ("input", "vector input")}  # type: ignore[index]
        read = [k for k in program.arguments if k in inputs or k not in filled]
        call(library[f"c_{name}"], [by_c[k] for k in read], [by_c[k] for k in program.arguments if k in filled])
        for k in filled:
            assert difference(by_c[k], arrays[k]) < ROUND_OFF, (name, k)


@needs_compiler
@pytest.mark.parametrize("seed", range(1))
def test_random_mechanisms_have_the_same_functions_in_c(seed: int, build: Built) -> None:
    compare(compile_mechanism(random_mechanism(seed).mechanism), build, ("accelerations", "leap", "energies"))


@needs_compiler
@pytest.mark.parametrize("scene", ["rod-slider", "arm"])
def test_ready_scenes_have_the_same_functions_in_c(scene: str, build: Built) -> None:
    compare(compile_mechanism(Pipeline(load_scene(scene)).mechanism), build)


@needs_compiler
def test_functions_agree_on_both_sides_of_their_branches(build: Built) -> None:
    programs = {}
    for name in FUNCTIONS:
        graph = Graph()
        outputs = (Output(graph.scalar_input("x", 0).apply(name), ("y", (0,))),)
        programs[f"f_{name}"] = Program("f", graph, ("x", "y"), outputs)
    library, compiled = build(programs), np.zeros(1)
    for name in FUNCTIONS:
        for x in (1e-3, 0.19, 0.21, 0.7, *(() if name.startswith("arc") else (3.99, 4.01, 100.0))):
            call(library[f"f_{name}"], [np.array([x])], [compiled])
            assert compiled[0] == pytest.approx(evaluate_function(name, x), rel=1e-12), (name, x)


def test_the_text_depends_on_the_mechanism_alone_and_has_no_state() -> None:
    texts = []
    for _ in range(2):
        compiled = compile_mechanism(random_mechanism(1).mechanism)
        texts.append(write_c({"a": compiled.program("accelerations"), "r": compiled.program("residual")}))
    assert texts[0] == texts[1]
    outside = [line for line in texts[0].splitlines() if line and line[0] not in " {}/#"]
    functions = [line for line in outside if not line.startswith("static const double m")]
    assert all(line.startswith(("void ", "static double ")) and line.endswith(")") for line in functions)


@pytest.mark.parametrize("name", ["", "2a", "a-b", "ä", "a b"])
def test_a_name_that_is_none_in_c_is_refused(name: str) -> None:
    graph = Graph()
    program = Program("f", graph, ("x", "y"), (Output(graph.scalar_input("x", 0), ("y", (0,))),))
    with pytest.raises(ValueError, match="no name of a C function"):
        write_c({name: program})


def test_what_has_no_c_is_refused() -> None:
    graph = Graph()
    x = graph.scalar_input("x", 0)
    odd = type(x)(graph, graph.add("tan", (x.node,)))
    with pytest.raises(ValueError, match="no C for tan"):
        write_c({"f": Program("f", graph, ("x", "y"), (Output(odd, ("y", (0,))),))})
