"""Machine code: functions of scalars, vectors of every length, objects on disk, several processes."""

import ctypes
import multiprocessing
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.core.formula import parse_formula
from fmd.core.limits.code import LONG_PROGRAM
from fmd.core.recently_used import RecentlyUsed
from fmd.dynamics.compiler import llvm, store
from fmd.dynamics.compiler.chunks import chunk_widths
from fmd.dynamics.compiler.compiled import compile_mechanism
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.digest import digest_mechanism
from fmd.dynamics.compiler.formulas import trace_table
from fmd.dynamics.compiler.functions import FUNCTIONS
from fmd.dynamics.compiler.graph import Graph, combine
from fmd.dynamics.compiler.program import LANES, Output, Program
from fmd.dynamics.compiler.store import kept_path, load_program
from fmd.dynamics.links import PointLoad
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import constant, formula
from fmd.kernels import machine
from fmd.kernels.machine import LoadedObject, compile_object
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from tests.dynamics.compiler.comparison import TIME, difference, interpret, interpreted, load_code
from tests.dynamics.compiler.mechanisms import random_mechanism


def run(program: Program, loaded: LoadedObject, *arrays: Array) -> None:
    prototype = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * len(arrays))
    prototype(loaded.address(program.name))(*(array.ctypes.data for array in arrays))


def function(name: str) -> Program:
    graph = Graph()
    return Program("f", graph, ("x", "y"), (Output(graph.scalar_input("x", 0).apply(name), ("y", (0,))),))


def values_of(name: str, at: Array) -> Array:
    program = function(name)
    loaded, out, y = load_code(program), np.empty(at.size), np.zeros(1)
    for k, x in enumerate(at):
        run(program, loaded, np.array([x]), y)
        out[k] = y[0]
    return out


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_sines_and_cosines_are_right_to_the_last_bit_but_one(name: str) -> None:
    rng = np.random.default_rng(0)
    at = np.concatenate([rng.uniform(-1, 1, 500), rng.uniform(-1e3, 1e3, 500), rng.uniform(-1e9, 1e9, 200)])
    at = np.concatenate([at, np.arange(-8, 9) * np.pi / 4, [0.0]])
    assert np.abs(values_of(name, at) - getattr(np, name)(at)).max() < 2.3e-16


def test_sines_of_what_is_no_number_are_none() -> None:
    assert np.isnan(values_of("sin", np.array([np.nan, np.inf]))).all()


WITHIN = {"arc": [0.0, 1e-9, 1e-3, 0.19, 0.21, 0.7, 0.999], "log": [1e-9, 0.3, 1.0, 7.0], "sqrt": [0.0, 0.3, 4.0]}
ANYWHERE = [-3.0, -1e-3, 0.0, 1e-3, 0.7, 3.99, 4.01, 9.0, 100.0]


@pytest.mark.parametrize("name", FUNCTIONS[2:])
def test_compiled_functions_are_those_of_the_interpreter(name: str) -> None:
    given = WITHIN.get(name.rstrip("0123456789"), ANYWHERE)
    graph, at = Graph(), np.array(given[2:] if name.startswith("stumpff") else given)
    node = graph.scalar_input("x", 0).apply(name).node
    expected = [interpret(graph, [node], {"x": np.array([x])})[0] for x in at]
    assert np.allclose(values_of(name, at), expected, rtol=1e-12)


def test_choices_in_lanes_are_those_of_the_interpreter() -> None:
    graph = Graph()
    x, y, z = (graph.scalar_input("x", k) for k in range(3))
    values = [x.select(y, z), y.below(x), x.moving(y), (x * x).power(z), x.apply("far_sin"), y.select(x, 2.0 * z)]
    values.append(trace_table((-0.5, 0.1, 0.6), ((0.0, 1.0, 2.0, 3.0), (0.5, -1.0, 0.0, 2.0), (1.0, 2.0, 0.0, 0.0)), x))
    outputs = tuple(Output(value, ("y", (k,))) for k, value in enumerate(values))
    program = Program("f", graph, ("x", "y"), outputs, lanes=("x", "y"))
    given, found = np.random.default_rng(3).normal(size=(3, LANES)), np.zeros((len(values), LANES))
    given[0, 0], given[1, 1] = 0.0, np.nan
    run(program, load_code(program), given, found)
    expected = np.array(interpret(graph, [value.node for value in values], {"x": given}))
    assert np.allclose(found, expected, rtol=1e-13, atol=1e-13, equal_nan=True)


@pytest.mark.parametrize("register", [4, 8])
@pytest.mark.parametrize("n", [*range(1, 10), 17, 33, 60])
def test_vectors_of_every_length(n: int, register: int) -> None:
    rng = np.random.default_rng(n)
    square, flat = rng.normal(size=(n, n)), rng.normal(size=(3, n))
    graph = Graph()
    u, w = graph.vector_input("x", range(n)), graph.vector_input("x", [n + (3 * k) % n for k in range(n)])
    outputs = [
        (u.multiplied_by(square), n),
        (combine([(u.dot(w), u), (1.0, w), (2.0, u.multiplied_by(np.diag(square.diagonal())))]), n),
        (w.multiplied_by(flat), 3),
        (u.entry(n - 1) * w.entry(n // 2), 1),
        (u.dot(graph.array(square[0])), 1),
    ]
    places = np.cumsum([0, *(size for _, size in outputs)])
    at = [tuple(range(first, last)) for first, last in pairwise(places)]
    named = tuple(Output(value, ("y", place)) for (value, _), place in zip(outputs, at, strict=True))
    program = Program("f", graph, ("x", "y"), named)
    x, y = rng.normal(size=2 * n), np.zeros(places[-1])
    run(program, load_code(program, register), x, y)
    expected = interpret(graph, [value.node for value, _ in outputs], {"x": x})
    assert np.allclose(y, np.concatenate([np.atleast_1d(value) for value in expected]), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("register", [4, 8])
@pytest.mark.parametrize("n", [17, 24, 27, 28, 31, 33])
def test_rows_that_share_columns_are_multiplied_together_and_come_to_their_places(n: int, register: int) -> None:
    rng = np.random.default_rng(n)
    row, column = rng.permutation(n + 2) % 5, rng.permutation(n) % 5  # blocks of four groups in two more rows; one is 0
    matrix = np.where((row[:, None] == column) & (row[:, None] < 4), rng.normal(size=(n + 2, n)), 0.0)
    graph = Graph()
    x = graph.vector_input("x", range(n))
    product = x.multiplied_by(matrix)
    square = product.dot(product)  # reads the last chunk's padding, too
    outputs = Output(square, ("y", (0,))), Output(product, ("y", tuple(range(1, n + 3))))
    program = Program("f", graph, ("x", "y"), outputs)
    assert "phi" not in llvm.emit(program, register)[0]  # no loop
    given, y = rng.normal(size=n), np.zeros(n + 3)
    run(program, load_code(program, register), given, y)
    assert np.allclose(y[1:], matrix @ given, rtol=1e-14, atol=1e-14)
    assert np.isclose(y[0], np.sum((matrix @ given) ** 2), rtol=1e-14)


def test_chunks_cover_a_vector_and_pad_it_by_no_more_than_they_spare() -> None:
    for register in (4, 8):
        for n in range(1, 70):
            widths = chunk_widths(n, register)
            assert 0 <= sum(widths) - n <= 1
            assert set(widths) <= {1, 2, 4, 8}


def test_an_object_without_the_function_is_refused() -> None:
    loaded = load_code(function("sin"))
    with pytest.raises(ValueError, match="the object has no function g"):
        loaded.address("g")


def load(name: str) -> LoadedObject:
    return load_program("f", name, lambda: function(name))


def test_objects_are_read_back_and_damaged_ones_made_anew(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(store, "kernel_folder", lambda: tmp_path)
    compiled = []
    monkeypatch.setattr(store, "compile_object", lambda text, **_: compiled.append(text) or compile_object(text))
    y, kept = np.zeros(1), list[Path]()
    for damage in (None, b"", b"nothing that was ever an object file"):
        for path in kept if damage is not None else ():
            path.write_bytes(damage)
        before = len(compiled)
        for _ in range(2):
            store._loaded.clear()  # as in another process
            run(function("cos"), load("cos"), np.zeros(1), y)
            assert y[0] == 1.0
        assert len(compiled) == before + 1
        kept = list(tmp_path.iterdir())
        # Names depend on the processor.
        assert sorted(path.suffix for path in kept) == [".constants", ".object", ".places"]


def test_structures_whose_code_is_the_same_are_compiled_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Two modes that change places move zeros of arrays."""
    monkeypatch.setattr(store, "kernel_folder", lambda: tmp_path)
    compiled = []
    monkeypatch.setattr(store, "compile_object", lambda text, **_: compiled.append(text) or compile_object(text))
    x, y = np.array([2.0, 3.0, 5.0]), np.zeros(1)
    for factors in ([4.0, 0.0, 7.0], [4.0, 7.0, 0.0]):
        graph = Graph()
        product = graph.vector_input("x", range(3)).dot(graph.array(np.array(factors)))
        program = Program("f", graph, ("x", "y"), (Output(product, ("y", (0,))),))
        for _ in range(2):
            store._loaded.clear()  # as in another process
            run(program, load_program("f", repr(factors), lambda own=program: own), x, y)
            assert y[0] == x @ factors
    assert len(compiled) == 1
    assert len([*tmp_path.glob("*.places")]) == 2


def test_a_process_loads_an_object_once_and_keeps_the_last_used(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(store, "kernel_folder", lambda: tmp_path)
    monkeypatch.setattr(store, "_loaded", RecentlyUsed(2))
    first, second = load("sin"), load("cos")
    assert load("sin") is first
    load("stumpff4")
    assert load("sin") is first
    assert load("cos") is not second
    assert len(store._loaded) == 2


def test_an_object_that_cannot_be_kept_serves_all_the_same(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(store, "kernel_folder", lambda: tmp_path / "missing")
    y = np.zeros(1)
    run(function("cos"), load("cos"), np.zeros(1), y)
    assert y[0] == 1.0


def test_another_processor_has_objects_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    here = [kept_path("f", b"sin", kind) for kind in ("constants", "places", "object")]
    monkeypatch.setattr(store, "processor", lambda: ("22.1.0", "another", "+avx2"))
    assert not {kept_path("f", b"sin", path.suffix[1:]) for path in here} & {*here}


def test_a_mechanism_whose_object_is_kept_is_not_traced(monkeypatch: pytest.MonkeyPatch) -> None:
    made = random_mechanism(2)
    a = compile_mechanism(made.mechanism).accelerations(TIME, *made.state(2))
    again = compile_mechanism(made.mechanism)
    monkeypatch.setattr(again, "program", lambda name: pytest.fail(f"{name} is traced"))
    assert np.array_equal(again.accelerations(TIME, *made.state(2)), a)


def with_other_numbers(mechanism: Mechanism, factor: float) -> Mechanism:
    """An equal mechanism of other lengths, stiffness, damping and inertia, whose gravity and loads are others too."""
    links = []
    for link in mechanism.links:
        integrals = replace(link.integrals, mass=factor * link.integrals.mass, S=factor * link.integrals.S)
        integrals = replace(integrals, G=factor * integrals.G) if not len(link.omega) else link.integrals
        place = replace(link.place, position=factor * link.place.position)
        own = replace(link, integrals=integrals, place=place, omega=factor * link.omega)
        links.append(replace(own, spring=factor * link.spring, rest=factor * link.rest, damper=factor * link.damper))
    points = [replace(load.marker, position=factor * load.marker.position) for load in mechanism.loads]
    loads = [replace(load, marker=point) for load, point in zip(mechanism.loads, points, strict=True)]
    return replace(mechanism, links=links, loads=loads, gravity=factor * mechanism.gravity)


@pytest.mark.parametrize("seed", range(2))
def test_mechanisms_that_differ_in_numbers_alone_share_their_code(
    seed: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(store, "kernel_folder", lambda: tmp_path)
    count = []
    monkeypatch.setattr(store, "compile_object", lambda text, **_: count.append(text) or compile_object(text))
    made = random_mechanism(seed)
    made_of = [compile_mechanism(with_other_numbers(made.mechanism, factor)) for factor in (1.1875, 1.0625, 0.9375)]
    q, v = made.state(seed)
    found = [compiled.accelerations(TIME, q, v) for compiled in made_of]
    codes = [text for text in count if "@accelerations" in text]
    assert len(codes) == 1
    for compiled, a in zip(made_of, found, strict=True):
        expected = interpreted(compiled, "accelerations", a.shape, q=q, v=v)
        assert difference(a, expected) < 1e-10
        assert np.array_equal(compiled.accelerations(TIME, q, v), a)  # each has constants of its own in memory
    assert not np.allclose(found[0], found[1], rtol=1e-6, atol=0.0)


def digest(mechanism: Mechanism) -> str:
    return digest_mechanism(Coordinates(Graph(), mechanism))


def changed(mechanism: Mechanism, **fields: object) -> Mechanism:
    """The first link with other fields."""
    return replace(mechanism, links=[replace(mechanism.links[0], **fields), *mechanism.links[1:]])


def test_every_constant_of_a_mechanism_is_in_its_digest() -> None:
    loads = [PointLoad("body 0", np.eye(3)[0], constant(1.0))]
    any_one = next(made for made in map(random_mechanism, range(50)) if len(made.mechanism.links[0].omega) > 1)
    one = changed(any_one.mechanism, name="body 0", load=constant(1.0), joint=REVOLUTE, motion=None)
    one = changed(replace(one, loads=loads, slow_modes={}, fast_joints=[]), spring=0.0, rest=0.0, damper=0.0)
    first = one.links[0]
    others = [
        changed(one, omega=1.01 * first.omega),
        changed(one, spring=1.0, damper=0.0),
        changed(one, spring=0.0, damper=1.0),
        changed(one, place=replace(first.place, position=first.place.position + 1e-9)),
        changed(one, axis=first.axis[::-1]),
        changed(one, integrals=replace(first.integrals, mass=first.integrals.mass + 1.0)),
        changed(one, load=constant(1.5)),
        changed(one, load=formula(parse_formula("sin(t)"))),
        changed(one, joint=PRISMATIC),
        replace(one, gravity=one.gravity + 1.0),
        replace(one, loads=[]),
        replace(one, loads=[replace(loads[0], torque=True)]),
        replace(one, loads=[replace(loads[0], size=constant(2.0))]),
        replace(one, fast_joints=["body 0"]),
        replace(one, slow_modes={"body 0": 1}),
    ]
    assert len({digest(mechanism) for mechanism in [one, *others]}) == 1 + len(others)


def test_what_is_an_input_or_a_name_is_not_in_the_digest() -> None:
    one = changed(random_mechanism(0).mechanism, joint=REVOLUTE, motion=None, load=formula(parse_formula("sin(t)")))
    one = replace(one, loads=[], fast_joints=[], slow_modes={})
    assert digest(changed(one, load=formula(parse_formula("2*cos(t)")))) == digest(one)
    assert digest(changed(one, name="another")) == digest(one)
    sprung = changed(one, spring=2.0, rest=0.1, damper=3.0)
    assert digest(changed(one, spring=1.0, rest=0.3, damper=4.0)) == digest(sprung) != digest(one)


def test_springs_and_dampers_are_read_from_the_inputs() -> None:
    one = changed(random_mechanism(0).mechanism, joint=REVOLUTE, motion=None, spring=2.0, rest=0.1, damper=3.0)
    q, v = np.full(one.n_positions, 0.2), np.full(one.n, 0.3)
    other = changed(one, spring=5.0, rest=0.4, damper=7.0)
    first, second = compile_mechanism(one), compile_mechanism(other)
    push = first.residual(TIME, q, v, np.zeros(one.n)) - second.residual(TIME, q, v, np.zeros(one.n))
    section = one.links[0].joint_rotation @ q[one.modes_of(0) + one.n_positions - one.n]
    rate = v[0] + one.links[0].joint_rotation @ v[one.modes_of(0)]
    x = q[0] + section
    assert push[0] == pytest.approx(2.0 * (x - 0.1) + 3.0 * rate - 5.0 * (x - 0.4) - 7.0 * rate, rel=1e-12)


def _accelerate(folder: Path) -> bytes:
    store.kernel_folder = lambda: folder
    made = random_mechanism(1)
    return compile_mechanism(made.mechanism).accelerations(TIME, *made.state(1)).tobytes()


@pytest.mark.slow
def test_processes_that_compile_at_once_agree(tmp_path: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        results = pool.map(_accelerate, [tmp_path] * 2)
    assert len(set(results)) == 1
    assert sorted(path.suffix for path in tmp_path.glob("accelerations.*")) == [".constants", ".object", ".places"]


def test_registers_are_as_wide_as_the_processor_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "processor", lambda: ("", "", "+avx2,+avx512f"))
    assert machine.register_width() == 8
    monkeypatch.setattr(machine, "processor", lambda: ("", "", "+avx2,-avx512f"))
    assert machine.register_width() == 4


def test_the_effort_of_compiling_falls_with_a_programs_length() -> None:
    """LLVM's most takes 3.9 s of a long program for 2.1 with little, whose calls take as long."""

    def effort_of(operations: int, seldom: bool = False) -> int:
        return store._effort(cast(Program, SimpleNamespace(seldom=seldom, operations=lambda width: operations)))

    assert effort_of(LONG_PROGRAM - 1) > effort_of(LONG_PROGRAM) > effort_of(1, seldom=True) == 0
