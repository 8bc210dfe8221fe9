"""heyoka's Taylor method beside our integrators: run time against error on the same equations of motion.

`work_precision.py` and ``fmd bench --peer`` ask for its rows; it needs the extra ``bench``. heyoka
(Biscani & Izzo, Mon Not R Astron Soc 504, 2021) compiles a Taylor method of adaptive order and step for equations that
it gets as expressions. They are our own: the graph of a mechanism's accelerations, node by node, after simplification.
Compact mode is on, without which large mechanisms compile for minutes; seconds are of the march alone.
"""

import time
from collections.abc import Callable, Iterator
from itertools import pairwise
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
from fmd.output.work_precision import Errors, WorkPrecisionRow, errors_of

HERE = Path(__file__).parent
CASES = {"rod-slider": "rod-slider", "beam": "beam-paper", "arm": "arm", "robot": str(HERE / "scenes" / "robot.toml")}
TOLERANCES = [10.0**-k for k in range(2, 17, 2)]
INTERVALS = 100


def import_heyoka() -> Any:
    try:
        import heyoka
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("the peer needs heyoka: pip install heyoka==7.13.2") from error
    return heyoka


def signal_expression(signal: Signal, at: float) -> Any:
    """Return a signal's value as an expression of time, of the terms that act at a time [s]."""
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
        if not term.support[0] <= at <= term.support[1]:
            continue
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


def acceleration_expressions(system: Any, q: list[Any], v: list[Any], at: float) -> list[Any]:
    """Return the accelerations of a mechanism for expressions of its positions and rates, by loads about a time [s]."""
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
        value = signal_expression(system.compiled.signals[signal], at)
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


def taylor_marches(run: Pipeline) -> Iterator[tuple[Errors, int, Callable[[], float]]]:
    """March a scene with ever smaller tolerances, from each of its loads' breakpoints to the next.

    Yields errors and steps of each march, and what marches so once more and returns its seconds.
    """
    hy, system, (q0, v0) = import_heyoka(), run.system, run.start
    n, duration, errors = system.n, run.scene.simulation.duration, errors_of(run)
    ends = [*(t for t in system.breakpoints if 0.0 < t < duration), duration]
    times = np.linspace(0.0, duration, INTERVALS + 1)
    exact = RungeKutta(1e-13).march(system, q0, v0, times)
    variables = hy.make_vars(*(f"q{k}" for k in range(n)), *(f"v{k}" for k in range(n)))
    q, v, start = list(variables[:n]), list(variables[n:]), np.concatenate([q0, v0])
    pieces = [
        list(zip(variables, [*v, *acceleration_expressions(system, q, v, 0.5 * (first + last))], strict=True))
        for first, last in pairwise([0.0, *ends])
    ]
    for tolerance in TOLERANCES:
        methods = [hy.taylor_adaptive(piece, start.tolist(), tol=tolerance, compact_mode=True) for piece in pieces]

        def march(methods: list[Any] = methods) -> float:
            tick, time_now, state = time.perf_counter(), 0.0, start
            for method, end in zip(methods, ends, strict=True):
                method.time, method.state[:] = time_now, state
                method.propagate_until(end)
                time_now, state = end, method.state
            return time.perf_counter() - tick

        found, steps, state, first = [], 0, start, 0.0
        for method, last in zip(methods, ends, strict=True):
            grid = np.unique(np.r_[first, times[(first < times) & (times <= last)], last])
            method.time, method.state[:] = first, state
            *_, taken, _, states = method.propagate_grid(grid)
            found.append(states[np.isin(grid, times) & ((grid > first) | (first == 0.0))])
            steps, state, first = steps + taken, states[-1], last
        q_found, v_found = np.split(np.concatenate(found), 2, axis=1)
        no_state = State(0, q0, v0, v0)
        trajectory = Trajectory("heyoka", 0.0, 1, times, q_found, v_found, steps, 0, 0.0, no_state)
        yield errors(trajectory, exact), steps, march


def measure(name: str, repeats: int = 5) -> Iterator[WorkPrecisionRow]:
    """March a scene by heyoka, coarse to fine, timed as our own benchmark does it."""
    run = Pipeline(load_scene(CASES[name], few_modes(name)))
    for error, steps, march in taylor_marches(run):
        seconds: list[float] = []
        while len(seconds) < repeats or (sum(seconds) < REPEATED_SECONDS and len(seconds) < MOST_REPEATS):
            seconds.append(march())
        figures = (min(seconds), error.tip, steps, error.modal, error.joint)
        yield WorkPrecisionRow("heyoka", run.scene.simulation.duration / steps, 1, *figures)
