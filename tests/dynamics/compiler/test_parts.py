"""Long programs as calls of functions that like parts share."""

from dataclasses import replace

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.dynamics.compiler import llvm, parts
from fmd.dynamics.compiler.compiled import CompiledMechanism
from fmd.dynamics.compiler.program import LANES, Program
from fmd.dynamics.mechanism import Mechanism
from fmd.kernels.machine import LoadedObject, compile_object
from fmd.scene.joints.revolute import REVOLUTE
from tests.dynamics.compiler.comparison import TIME, difference, interpret
from tests.dynamics.compiler.mechanisms import random_mechanism
from tests.dynamics.compiler.test_machine_code import run


@pytest.fixture(autouse=True)
def all_are_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "LONG_PROGRAM", 0)
    monkeypatch.setattr(parts, "MOST_IN_PART", 150)


def chain(count: int) -> Mechanism:
    """Two random flexible bodies on hinges, of three modes each, and copies of the second, one on the other."""
    for seed in range(400):
        links = random_mechanism(seed, joints=(REVOLUTE,)).mechanism.links
        if len(links) > 1 and links[1].parent == 0 and len(links[0].omega) == len(links[1].omega) == 3 and seed % 5 < 4:
            break
    copies = [replace(links[1], name=f"copy{k}", joint_name=f"hinge{k}", parent=k) for k in range(1, count - 1)]
    return Mechanism([*links[:2], *copies], gravity=np.array([0.0, -9.8, 0.0]))


def filled(program: Program, name: str, n: int, **given: Array) -> tuple[Array, Array]:
    """An array that a program fills, by its parts and by the interpreter."""
    source, constants = llvm.emit(program, 4)
    assert "%plain = alloca" in source
    filling = np.zeros((n, LANES) if name in program.lanes else n)
    arrays = [given.get(argument, filling) for argument in program.arguments]
    run(program, LoadedObject(compile_object(source, effort=0), constants), *arrays)
    outputs = [(output.value.node, output.place[1]) for output in program.outputs if output.place[0] == name]
    expected = np.zeros_like(filling)
    for value, (_, places) in zip(interpret(program.graph, [node for node, _ in outputs], given), outputs, strict=True):
        expected[list(places)] = value
    return filling, expected


@pytest.mark.parametrize("first", [0, 10])
def test_parts_do_what_the_interpreter_does(first: int) -> None:
    for seed in range(first, first + 10):
        made = random_mechanism(seed, second_order=seed % 5 == 0)
        compiled, n = CompiledMechanism(made.mechanism), made.mechanism.n
        (q, v), inputs = made.state(seed), compiled.signal_values(TIME)
        directions = np.random.default_rng(seed).normal(size=(n, LANES))
        given = {"inputs": inputs, "q": q, "v": v}
        if seed % 2:
            found, expected = filled(compiled.program("damping"), "dr", n, dv=directions, **given)
        else:
            found, expected = filled(compiled.program("accelerations"), "a", n, **given)
        assert difference(found, expected) < 1e-12


def test_a_longer_chain_has_no_more_code() -> None:
    lengths = []
    for count in (7, 12):
        cut = parts.cut_program(CompiledMechanism(chain(count)).program("accelerations"), 4)
        assert cut is not None
        lengths.append((len(cut.functions), len(cut.calls)))
    (functions, calls), (of_longer, calls_of_longer) = lengths
    assert functions == of_longer
    assert calls_of_longer > calls + 10


def test_other_constants_have_the_same_code() -> None:
    mechanism = chain(6)
    lighter = [replace(link, spring=link.spring + 1.0) for link in mechanism.links[:3]]
    heavier = [replace(link, omega=1.5 * link.omega) for link in mechanism.links[3:]]
    other = replace(mechanism, links=[*lighter, *heavier])
    sources = [llvm.emit(CompiledMechanism(m).program("accelerations"), 4) for m in (mechanism, other)]
    assert sources[0][0] == sources[1][0]
    assert (sources[0][1] != sources[1][1]).any()


def test_values_that_no_part_takes_any_more_leave_room() -> None:
    program = CompiledMechanism(chain(12)).program("residual")
    cut = parts.cut_program(program, 4)
    assert cut is not None
    given = sum(len(cut.functions[call.function].outputs) for call in cut.calls)
    assert cut.sizes["plain"] < given


def test_a_program_in_lanes_counts_the_registers_that_they_take() -> None:
    program = CompiledMechanism(chain(6)).program("inertia")
    lanes = program.operations(4) - program.operations(LANES)
    assert program.operations(LANES) == program.flops
    assert 0 < lanes < program.flops  # what doesn't depend on the directions is computed once


def test_a_function_copies_a_bounded_number_of_registers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "MOST_COPIED", 6)
    made = CompiledMechanism(chain(6))
    program, n = made.program("inertia"), made.mechanism.n
    cut = parts.cut_program(program, 4)
    assert cut is not None
    for side in cut.after:  # of lanes alone, two registers each: a group ends with what goes beyond its bound
        registers = [2 * len(places) for _, (_, places) in side.outputs]
        assert sum(registers[:-1]) <= 6
    rng = np.random.default_rng(3)
    given = {"inputs": made.signal_values(TIME), "q": rng.normal(size=n), "da": rng.normal(size=(n, LANES))}
    found, expected = filled(program, "dr", n, **given)
    assert difference(found, expected) < 1e-12
