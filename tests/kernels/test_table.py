"""Tables: kernels read the members that Python sees."""

import ast
import pickle
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from fmd.core.arrays import Array, IntArray
from fmd.kernels.kernel import kernel
from fmd.kernels.table import Table

ROOT = Path(__file__).parents[2] / "pipeline" / "fmd"


@dataclass(frozen=True)
class Inside(Table):
    weights: Array
    degree: int = 0


@dataclass(frozen=True)
class Outside(Table):
    scale: float
    flag: bool
    count: int
    numbers: IntArray
    cube: Array
    inside: Inside


@kernel
def _read(p: Outside, out: Array) -> None:
    out[0], out[1], out[2] = p.scale, 1.0 if p.flag else 0.0, p.count
    out[3], out[4], out[5] = p.numbers[1], p.numbers.size, p.cube.shape[2]
    layer = p.cube[1]
    for i in range(layer.shape[0]):
        for j in range(layer.shape[1]):
            out[6] += p.inside.weights[j] * layer[i, j]


def made() -> Outside:
    cube = np.random.default_rng(4).normal(size=(2, 3, 5))
    return Outside(-2.5, True, 7, np.array([3, 9]), cube, Inside(np.arange(5.0), 2))


def expected(p: Outside) -> list[float]:
    return [p.scale, float(p.flag), p.count, p.numbers[1], len(p.numbers), 5, (p.cube[1] @ p.inside.weights).sum()]


@pytest.mark.parametrize(
    "change", [{}, {"scale": 4.0, "flag": False}, {"inside": Inside(np.ones(5))}, {"cube": np.ones((4, 1, 5))}]
)
def test_kernels_read_what_python_sees(change: dict[str, object]) -> None:
    p, out = replace(made(), **change), np.zeros(7)
    _read(p, out)
    assert out == pytest.approx(expected(p), rel=1e-14)


def test_a_pickled_copy_has_memory_of_its_own() -> None:
    p = made()
    copy = pickle.loads(pickle.dumps(p))
    address, out = p.address, np.zeros(7)
    copy.inside.weights[:] = 1.0
    _read(copy, out)
    assert copy.address != address
    assert out == pytest.approx(expected(copy), rel=1e-14)
    assert p.inside.weights[2] == 2.0


@pytest.mark.parametrize("numbers", [np.arange(6)[::2], np.arange(3, dtype=np.int32)])
def test_arrays_that_kernels_could_not_read_are_refused(numbers: IntArray) -> None:
    with pytest.raises(ValueError, match="numbers must be a C-contiguous array of 64-bit numbers"):
        replace(made(), numbers=numbers)


def marks(function: ast.FunctionDef) -> set[str]:
    return {ast.unparse(mark).partition("(")[0] for mark in function.decorator_list}


def test_python_calls_nothing_that_is_for_kernels_alone() -> None:
    """It would run as plain Python, far slower: only kernels call functions that are `inlined`, say."""
    paths = [path for folder in ("dynamics", "integrators") for path in (ROOT / folder).rglob("*.py")]
    names = {path: ".".join(path.relative_to(ROOT.parent).with_suffix("").parts) for path in paths}
    trees = {names[path]: list(ast.walk(ast.parse(path.read_text(encoding="utf-8")))) for path in paths}
    functions = {name: [f for f in nodes if isinstance(f, ast.FunctionDef)] for name, nodes in trees.items()}
    only = {"inner", "inlined", "contracted", "unrolled"}
    inner = {name: {f.name for f in found if only & marks(f)} for name, found in functions.items()}
    assert {"step_all", "step_single"} <= inner["fmd.dynamics.compiled_system.frozen"]
    wrong = []
    for name, nodes in trees.items():
        imports = [node for node in nodes if isinstance(node, ast.ImportFrom) and node.module]
        known = {(str(at.module), alias.name) for at in imports for alias in at.names}
        reachable = inner[name] | {alias for module, alias in known if alias in inner.get(module, ())}
        for f in functions[name]:
            if not any(mark in {*only, "kernel"} or mark.endswith(".register") for mark in marks(f)):
                called = {ast.unparse(node.func) for node in ast.walk(f) if isinstance(node, ast.Call)}
                wrong += [f"{name}.{f.name} calls {other}" for other in called & reachable]
    assert wrong == []


def test_a_renewed_table_reads_alike_and_shares_no_array() -> None:
    p = made()
    copy, out = p.renewed(), np.zeros(7)
    _read(copy, out)
    assert out == pytest.approx(expected(p), rel=1e-14)
    copy.cube[1, 2, 3], copy.inside.weights[3] = 4.0, -1.0
    out[:] = 0.0
    _read(copy, out)
    assert out == pytest.approx(expected(copy), rel=1e-14)
    assert p.cube[1, 2, 3] != 4.0
    assert p.inside.weights[3] == 3.0
    assert not np.shares_memory(p.numbers, copy.numbers)


def test_arrays_of_a_renewed_table_begin_cache_lines() -> None:
    copy = made().renewed()
    assert [array.ctypes.data % 64 for array in (copy.numbers, copy.cube, copy.inside.weights)] == [0, 0, 0]


def test_a_renewed_table_can_be_renewed_and_pickled() -> None:
    copy = made().renewed()
    copy.numbers[1] = 5
    for other in (copy.renewed(), pickle.loads(pickle.dumps(copy))):
        assert other.numbers.tolist() == [3, 5]
        assert (other.scale, other.flag, other.count) == (-2.5, True, 7)
        assert other.inside.degree == 2  # not what its class has by default


def test_a_table_has_no_other_members() -> None:
    for table in (made(), made().renewed()):
        with pytest.raises(AttributeError, match="Outside has no member other"):
            _ = table.other
