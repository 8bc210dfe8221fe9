"""heyoka's Taylor method beside our integrators: run time against error on the same equations of motion.

`work_precision.py` and ``fmd bench --peer`` ask for its rows; it needs the extra ``bench``. heyoka
(Biscani & Izzo, Mon Not R Astron Soc 504, 2021) compiles a Taylor method of adaptive order and step for equations that
it gets as expressions. They are our own: the graph of a mechanism's accelerations, node by node, after simplification.
Compact mode is on, without which large mechanisms compile for minutes; seconds are of the march alone.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from few_modes import few_modes

from fmd import Pipeline, load_scene
from fmd.core import formula as codes
from fmd.core.limits.stepping import MOST_REPEATS, REPEATED_SECONDS
from fmd.dynamics.compiler.functions import series_of
from fmd.dynamics.signals.signal import CONSTANT, PROGRAM, Signal
from fmd.integrators.protocol import State, Trajectory
from fmd.integrators.runge_kutta import RungeKutta
from fmd.output.work_precision import WorkPrecisionRow, errors_of

HERE = Path(__file__).parent
CASES = {"rod-slider": "rod-slider", "arm": "arm", "robot": str(HERE / "scenes" / "robot.toml")}
TOLERANCES = [10.0**-k for k in range(2, 17, 2)]
INTERVALS = 100


def import_heyoka() -> Any:
    try:
        import heyoka
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("the peer needs heyoka: pip install heyoka==7.13.2") from error
    return heyoka


def signal_expression(signal: Signal) -> Any:
    """Return a signal's value as an expression of time."""
    hy = import_heyoka()
    binary = {
        codes.ADD: lambda a, b: a + b,
        codes.SUBTRACT: lambda a, b: a - b,
        codes.MULTIPLY: lambda a, b: a * b,
        codes.DIVIDE: lambda a, b: a / b,
    }
    unary = {codes.SIN: hy.sin, codes.COS: hy.cos, codes.EXP: hy.exp, codes.NEGATE: lambda a: -a}
    total: Any = 0.0
    for term in signal.terms:
        if term.kind == CONSTANT:
            total = total + term.numbers[0]
            continue
        if term.kind != PROGRAM:
            raise ValueError("a table isn't smooth enough for Taylor's method")
        stack: list[Any] = []
        numbers = iter(term.numbers)
        for code in term.codes:
            if code == codes.CONSTANT:
                stack.append(hy.expression(next(numbers)))
            elif code == codes.TIME:
                stack.append(hy.time)
            elif code in unary:
                stack.append(unary[code](stack.pop()))
            else:
                b, a = stack.pop(), stack.pop()
                stack.append(binary[code](a, b))
        total = total + stack.pop()
    return total


def acceleration_expressions(system: Any, q: list[Any], v: list[Any]) -> list[Any]:
    """Return the accelerations of a mechanism for expressions of its positions and rates."""
    hy = import_heyoka()
    program = system.compiled.program("accelerations")
    graph, known = program.graph, {"q": q, "v": v}
    values: dict[int, Any] = {}

    def read(name: str, place: int) -> Any:
        if name in known:
            return known[name][place]
        signal, derivative = divmod(place, 3)
        if signal >= len(system.compiled.signals):  # masses, springs and others
            return float(system.compiled.numbers[place - 3 * len(system.compiled.signals)])
        value = signal_expression(system.compiled.signals[signal])
        for _ in range(derivative):
            value = hy.diff(value, hy.time)
        return value

    def add_up(terms: list[Any]) -> Any:
        terms = [term for term in terms if not (isinstance(term, float) and term == 0.0)]
        return hy.sum([hy.expression(x) if isinstance(x, float) else x for x in terms]) if terms else 0.0

    for number in program.nodes:
        operation, taken, data, size = graph.nodes[number]
        x = [values[k] for k in taken]
        value: Any
        if operation == "number":
            value = float(data)
        elif operation == "input":
            value = read(data[0], data[1][0])
        elif operation == "vector input":
            value = [read(data[0], place) for place in data[1]]
        elif operation == "array":
            value = [float(entry) for entry in graph.arrays[data]]
        elif operation == "entry":
            value = x[0][data]
        elif operation in ("add", "subtract", "multiply"):
            value = x[0] + x[1] if operation == "add" else x[0] - x[1] if operation == "subtract" else x[0] * x[1]
        elif operation in ("negate", "invert"):
            value = -x[0] if operation == "negate" else 1.0 / x[0]
        elif operation in ("sin", "cos"):
            value = hy.sin(x[0]) if operation == "sin" else hy.cos(x[0])
        elif operation == "dot":
            value = add_up([a * b for a, b in zip(*x, strict=True)])
        elif operation == "combine":
            value = [add_up([s * w[k] for s, w in zip(x[::2], x[1::2], strict=True)]) for k in range(size)]
        elif operation in ("diagonal", "matrix"):
            constant = np.diag(graph.arrays[data]) if operation == "diagonal" else graph.arrays[data]
            value = [add_up([float(row[k]) * x[0][k] for k in np.flatnonzero(row)]) for row in constant]
        else:  # a Stumpff function: its series, of small rotations
            value = 0.0
            for coefficient in reversed(series_of(operation)[2]):
                value = coefficient + x[0] * value
        values[number] = value
    out: list[Any] = [None] * system.n
    for result, (_, places) in program.outputs:
        found = values[result.node]
        for place, entry in zip(places, found if isinstance(found, list) else [found], strict=True):
            out[place] = entry
    return out


def measure(name: str, repeats: int = 5) -> Iterator[WorkPrecisionRow]:
    """March a scene by heyoka, coarse to fine, timed as our own benchmark does it."""
    hy, run = import_heyoka(), Pipeline(load_scene(CASES[name], few_modes(name)))
    system, (q0, v0) = run.system, run.start
    n, duration, errors = system.n, run.scene.simulation.duration, errors_of(run)
    times = np.linspace(0.0, duration, INTERVALS + 1)
    exact = RungeKutta(1e-13).march(system, q0, v0, times)
    names = [f"q{k}" for k in range(n)] + [f"v{k}" for k in range(n)]
    variables = hy.make_vars(*names)
    q, v = list(variables[:n]), list(variables[n:])
    equations = list(zip(variables, [*v, *acceleration_expressions(system, q, v)], strict=True))
    start = np.concatenate([q0, v0])
    for tolerance in TOLERANCES:
        taylor = hy.taylor_adaptive(equations, start.tolist(), tol=tolerance, compact_mode=True)
        grid = taylor.propagate_grid(times)
        states, steps = grid[-1], grid[3]
        found = Trajectory("heyoka", 0.0, 1, times, states[:, :n], states[:, n:], steps, 0, 0.0, State(0, q0, v0, v0))
        seconds: list[float] = []
        while len(seconds) < repeats or (sum(seconds) < REPEATED_SECONDS and len(seconds) < MOST_REPEATS):
            taylor.time, taylor.state[:] = 0.0, start
            tick = time.perf_counter()
            taylor.propagate_until(duration)
            seconds.append(time.perf_counter() - tick)
        error = errors(found, exact)
        figures = (min(seconds), error.tip, steps, error.modal, error.joint)
        yield WorkPrecisionRow("heyoka", duration / steps, 1, *figures)
