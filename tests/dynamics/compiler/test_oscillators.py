"""Steps of uncoupled oscillators over a cycle, compiled, are those of the plain formula one after the other."""

import ctypes

import numpy as np
import pytest

from fmd.dynamics.compiler.graph import Graph
from fmd.dynamics.compiler.llvm import emit
from fmd.dynamics.compiler.oscillators import Oscillators
from fmd.dynamics.compiler.program import LANES, Output, Program
from fmd.kernels.machine import LoadedObject, compile_object, register_width
from tests.dynamics.compiler.comparison import interpret

H = 0.01
USUAL = (2, 3, 5, 10, 20)  # steps of a cycle that is known when it is compiled
NAMES = ("x", "v", "a", "inverse_mass", "by_positions", "drift", "by_rates", "w", "late", "lever", "other")


def program_of(n: int, damped: bool, n_loads: int, is_late: bool, usual: int) -> Program:
    graph = Graph()
    x, v, a, mass, k, drift, c, w, slope, *levers = (graph.vector_input(name, range(n)) for name in NAMES)
    late = ((graph.scalar_input("factor", 0), slope),) if is_late else ()
    loads = tuple(zip((0, 2), levers, strict=True))[:n_loads]
    made = Oscillators(x, v, a, mass, k, drift, late, (c, w) if damped else (), loads).take_steps(3, usual)
    outputs = tuple(Output(value, (f"new_{name}", tuple(range(n)))) for name, value in zip("xva", made, strict=True))
    filled = tuple(f"new_{name}" for name in "xva")
    return Program("steps", graph, ("steps", "inputs", "ahead", "factor", *NAMES, *filled), outputs)


def arguments_of(n: int, count: int, varying: bool, seed: int) -> dict[str, np.ndarray]:
    random, first = np.random.default_rng(seed), 3
    given = {name: random.normal(size=n) for name in NAMES}
    for name in ("inverse_mass", "by_positions", "by_rates"):
        given[name] = np.abs(given[name])
    given["by_positions"][0] = 0.0  # a rigid motion
    given["by_positions"] *= 1e4  # up to about two radians a step, the limit
    given["inverse_mass"] = np.minimum(given["inverse_mass"], 1.0)
    ahead = random.normal(size=(-(-(first + count) // LANES), 3, LANES))
    inputs = ahead[first // LANES, :, first % LANES].copy()
    steps = np.array([H, count * H, count, float(count - 1) if varying else 0.0, float(first)])
    given["w"] = given["v"] + 0.5 * H * random.normal(size=n)
    return given | {"steps": steps, "inputs": inputs, "ahead": ahead.ravel(), "factor": random.normal(size=1)}


def by_formula(given: dict[str, np.ndarray], damped: bool, n_loads: int, is_late: bool) -> list[np.ndarray]:
    h, _, count, varying, first = given["steps"]
    over, x, v, a = given["inverse_mass"], given["x"].copy(), given["v"].copy(), given["a"].copy()
    slope = -over * (given["drift"] + (given["factor"] * given["late"] if is_late else 0.0))
    begin, rate_begin, a_begin = x.copy(), given["w"], a.copy()
    ahead = given["ahead"].reshape(-1, 3, LANES)
    for step in range(int(count)):
        if step:
            rate = v + 0.5 * h * a
            a = a_begin + slope * step * h - over * given["by_positions"] * (x - begin)
            if damped:
                a = a - over * given["by_rates"] * (rate - rate_begin)
            for number, lever in list(zip((0, 2), ("lever", "other"), strict=True))[:n_loads]:
                place = int(first) + step
                change = ahead[place // LANES, number, place % LANES] - given["inputs"][number]
                a = a - over * given[lever] * (change if step <= varying else 0.0)
        v = v + h * a
        x = x + h * v
    return [x, v, a]


@pytest.mark.parametrize(("n_loads", "damped"), [(0, False), (1, True), (2, False), (2, True)])
@pytest.mark.parametrize("n", [1, 5, 9, 40])
def test_a_cycle_is_its_steps(n: int, n_loads: int, damped: bool) -> None:
    for is_late in (False, True):
        usual = USUAL[(n + is_late) % len(USUAL)]
        program = program_of(n, damped, n_loads, is_late, usual)
        source, constants = emit(program, register_width())
        loaded = LoadedObject(compile_object(source), constants)
        address, n_arrays = loaded.address("steps"), len(program.arguments)
        function = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * n_arrays)(address)
        for count in (1, 2, 3, 5, 10, 20):
            for varying in (False, True):
                given = arguments_of(n, count, varying, seed=count)
                want = by_formula(given, damped, n_loads, is_late)
                rooms = {f"new_{name}": np.zeros(n) for name in "xva"}
                arrays = [np.ascontiguousarray((given | rooms)[name]) for name in program.arguments]
                function(*(array.ctypes.data for array in arrays))
                interpreted = interpret(program.graph, [output.value.node for output in program.outputs], given)
                for name, one, other in zip("xva", want, interpreted, strict=True):
                    largest = np.abs(one).max()
                    assert np.abs(rooms[f"new_{name}"] - one).max() < 1e-12 * largest
                    assert np.abs(other - one).max() < 1e-12 * largest
