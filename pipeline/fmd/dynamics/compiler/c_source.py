"""C code of programs' graphs, for model exchange: functions in C99 without globals or other state.

Each is ``void name(const double *const *in, double *const *out)``: ``in`` points to the arrays that the program reads
and ``out`` to those that it fills, each in the order of its arguments, with the layout that the machine code's have.
One that it both reads and fills is in both, and may be the same memory: all stores come last. A program with lanes is
repeated for each of them. The text depends on the graphs alone.
"""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.functions import ARC, STUMPFF, series_of
from fmd.dynamics.compiler.graph import Graph
from fmd.dynamics.compiler.program import LANES, Program

_PER_LINE = 4
_WITH_TABLES = ("array", "diagonal", "matrix", "piece", "pick")


def write_c(programs: Mapping[str, Program]) -> str:
    """Write programs as a self-contained file of C functions, by the functions' names.

    Raises
    ------
    ValueError
        A name is no identifier of C.
    """
    tables, functions = write_c_parts(programs)
    return "\n".join(["#include <math.h>", *(["", *tables] if tables else []), *functions]) + "\n"


def write_c_parts(programs: Mapping[str, Program]) -> tuple[list[str], list[str]]:
    """Write programs as lines of constants that several functions may take, and as lines of the functions.

    Programs of one graph share their constants; those of several have their own within each function.

    Raises
    ------
    ValueError
        A name is no identifier of C.
    """
    tables, lines = list[str](), list[str]()
    shared = len({id(program.graph) for program in programs.values()}) == 1
    if shared:
        taken = set[int]().union(*(_tables(program) for program in programs.values()))
        tables = _table_lines(next(iter(programs.values())).graph, taken)
    for name, program in programs.items():
        if not (name.isascii() and name.isidentifier()):
            raise ValueError(f"{name!r} is no name of a C function")
        writer = _CWriter(program, name, not shared)
        body = writer.write()
        helpers = [line for helper in sorted(writer.helpers) for line in ("", *_helper(name, helper))]
        lines += [*helpers, "", f"/* in: {', '.join(writer.read)}; out: {', '.join(writer.filled)} */", *body]
    return tables, lines


class _CWriter:
    """Writes the statements of a program's nodes; node 12 is a number, or the double or the array ``x12``."""

    def __init__(self, program: Program, name: str, own_tables: bool = True) -> None:
        self._program, self._graph, self._name, self._own_tables = program, program.graph, name, own_tables
        self.helpers: set[str] = set()
        nodes = (self._graph.nodes[number] for number in program.nodes)
        places = [node.data for node in nodes if node.operation in ("input", "vector input")]
        reads = {place[0] for place in places}  # type: ignore[index]
        fills = {output.place[0] for output in program.outputs}
        self.read = [argument for argument in program.arguments if argument in reads or argument not in fills]
        self.filled = [argument for argument in program.arguments if argument in fills]

    def write(self) -> list[str]:
        """Write the function."""
        body = [line for number in self._program.nodes for line in self._node(number)]
        body += [line for value, place in self._program.outputs for line in self._store(value.node, *place)]
        if self._program.lanes:
            body = [f"for (int lane = 0; lane < {LANES}; ++lane) {{", *(f"    {line}" for line in body), "}"]
        tables = _table_lines(self._graph, _tables(self._program)) if self._own_tables else []
        lines = ["(void)in;", *([] if body else ["(void)out;"]), *tables, *body]
        return [
            f"void {self._name}(const double *const *in, double *const *out)",
            "{",
            *(f"    {line}" for line in lines),
            "}",
        ]

    def _node(self, number: int) -> list[str]:
        """Write what computes a node."""
        operation, arguments, data, _ = self._graph.nodes[number]
        if operation == "number":
            return []
        if operation == "array":
            return [f"const double *const x{number} = m{data};"]
        if operation == "vector input":
            argument, places = data  # type: ignore[misc]
            return [f"const double x{number}[] = {_braced(self._place('in', argument, place) for place in places)};"]
        if operation in ("combine", "diagonal", "matrix"):
            return self._vector(number)
        if operation == "dot":
            a, b = arguments
            n = self._graph.nodes[a].size
            return [f"double x{number} = 0.0;", f"{_each('k', n)} x{number} += x{a}[k] * x{b}[k];"]
        return [f"const double x{number} = {self._scalar(number)};"]

    def _scalar(self, number: int) -> str:
        operation, arguments, data, _ = self._graph.nodes[number]
        x = [self._named(k) for k in arguments]
        match operation:
            case "input":
                argument, (place,) = data  # type: ignore[misc]
                return self._place("in", argument, place)
            case "add" | "subtract" | "multiply":
                return f" {({'add': '+', 'subtract': '-', 'multiply': '*'})[operation]} ".join(x)
            case "negate":
                return f"-{x[0]}"
            case "invert":
                return f"1.0 / {x[0]}"
            case "entry":
                return f"{x[0]}[{data}]"
            case "sin" | "cos" | "sqrt" | "exp" | "log" | "tanh" | "floor":
                return f"{operation}({x[0]})"
            case "far_sin" | "far_cos":
                return f"{operation.removeprefix('far_')}({x[0]})"
            case "power":
                return f"sqrt({x[0]})" if self._graph.nodes[arguments[1]].data == 0.5 else f"pow({x[0]}, {x[1]})"
            case "below":
                return f"{x[0]} < {x[1]} || isnan({x[0]}) ? 1.0 : 0.0"
            case "select":
                return f"{x[0]} > 0.0 ? {x[1]} : {x[2]}"
            case "moving":
                return f"{x[1]} == 0.0 ? 0.0 : {x[0]} * {x[1]}"
            case "piece":
                self.helpers.add(operation)
                return f"{self._name}_piece({x[0]}, {self._graph.arrays[data].size}, m{data})"  # type: ignore[index]
            case "pick":
                return f"m{data}[(int){x[0]}]"
            case "positive" | "step":
                return f"{x[0]} > 0.0 ? {x[0] if operation == 'positive' else '1.0'} : 0.0"
        if operation not in (*STUMPFF, *ARC):
            raise ValueError(f"no C for {operation}")
        self.helpers.add(operation)
        return f"{self._name}_{operation}({x[0]})"

    def _named(self, number: int) -> str:
        """Return a node's name, or its number."""
        operation, _, data, _ = self._graph.nodes[number]
        if operation != "number":
            return f"x{number}"
        value = float(data)  # type: ignore[arg-type]
        return f"({write_number(value)})" if value < 0.0 else write_number(value)

    def _vector(self, number: int) -> list[str]:
        operation, arguments, data, size = self._graph.nodes[number]
        if operation == "combine":
            pairs = zip(arguments[::2], arguments[1::2], strict=True)
            terms = [
                f"x{v}[k]" if self._graph.nodes[s].data == 1.0 else f"{self._named(s)} * x{v}[k]" for s, v in pairs
            ]
            return [f"double x{number}[{size}];", f"{_each('k', size)} x{number}[k] = {' + '.join(terms)};"]
        (vector,) = arguments
        if operation == "diagonal":
            return [f"double x{number}[{size}];", f"{_each('k', size)} x{number}[k] = m{data}[k] * x{vector}[k];"]
        n = self._graph.nodes[vector].size
        product = f"{_each('j', n)} x{number}[k] += m{data}[{n} * k + j] * x{vector}[j];"
        return [f"double x{number}[{size}];", f"{_each('k', size)} {{ x{number}[k] = 0.0; {product} }}"]

    def _place(self, side: str, argument: str, place: int) -> str:
        """Return a place of an argument; ``side`` is in or out."""
        number = (self.read if side == "in" else self.filled).index(argument)
        if argument in self._program.lanes:
            return f"{side}[{number}][{LANES * place} + lane]"
        return f"{side}[{number}][{place}]"

    def _store(self, node: int, argument: str, places: tuple[int, ...]) -> list[str]:
        entries = [f"x{node}[{k}]" for k in range(len(places))] if self._graph.nodes[node].size else [self._named(node)]
        return [
            f"{self._place('out', argument, place)} = {entry};" for place, entry in zip(places, entries, strict=True)
        ]


def _tables(program: Program) -> set[int]:
    """Return the numbers of the constants that a program takes."""
    nodes = (program.graph.nodes[number] for number in program.nodes)
    return {int(node.data) for node in nodes if node.operation in _WITH_TABLES}  # type: ignore[arg-type]


def _table_lines(graph: Graph, numbers: set[int]) -> list[str]:
    return [f"static const double m{k}[] = {_braced(graph.arrays[k].ravel())};" for k in sorted(numbers)]


def _each(name: str, count: int) -> str:
    return f"for (int {name} = 0; {name} < {count}; ++{name})"


def write_number(value: float) -> str:
    """Return a double as C reads it, bit for bit."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0.0 else "-INFINITY"
    return repr(float(value))


def _braced(entries: Iterable[str] | Array) -> str:
    """Return an initialiser, a few entries a line."""
    texts = [write_number(float(x)) for x in entries] if isinstance(entries, np.ndarray) else list(entries)
    lines = [", ".join(texts[first : first + _PER_LINE]) for first in range(0, len(texts), _PER_LINE)]
    return "{" + ",\n        ".join(lines) + "}"


def _helper(name: str, function: str) -> list[str]:
    """Write a function that C's library hasn't."""
    if function == "piece":
        return _piece_function(name)
    k, limit, coefficients = series_of(function)
    *others, series = (write_number(c) for c in coefficients)
    for coefficient in reversed(others):  # Horner's rule
        series = f"{coefficient} + x * ({series})"
    far = _far_arc(k) if function in ARC else _far_stumpff(k)
    return [
        f"static double {name}_{function}(double x)",
        "{",
        f"    if (!(x < {write_number(limit)})) {{",
        *(f"        {line}" for line in far),
        "    }",
        f"    return {series};",
        "}",
    ]


def _piece_function(name: str) -> list[str]:
    """Write the search for the last of ascending knots that a number isn't below, or the first."""
    return [
        f"static double {name}_piece(double x, int n, const double *knots)",
        "{",
        "    int low = 0;",
        "    for (int high = n; high - low > 1;) {",
        "        const int middle = (low + high) / 2;",
        "        if (knots[middle] <= x)",
        "            low = middle;",
        "        else",
        "            high = middle;",
        "    }",
        "    return low;",
        "}",
    ]


def _far_arc(k: int) -> list[str]:
    """Write a function of a rotation's vector by the arc sine and a recurrence."""
    steps = []
    for j in range(k):
        rest = f"{write_number(2.0 * j * j)} * a{j - 1}" if j else "1.0"
        own = f"{rest} - {write_number(2.0 * j + 1.0)} * (1.0 - 2.0 * x) * a{j}"
        steps.append(f"const double a{j + 1} = ({own}) / (2.0 * p);")
    return [
        "const double p = x * (1.0 - x);",
        "const double a0 = asin(sqrt(x)) / sqrt(p);",
        *steps,
        f"return a{k};",
    ]


def _far_stumpff(k: int) -> list[str]:
    """Write a Stumpff function by sine and cosine."""
    steps = [f"y = ({write_number(1.0 / math.factorial(j))} - y) / x;" for j in range(k % 2, k, 2)]
    first = "sin(root) / root" if k % 2 else "cos(root)"
    return ["const double root = sqrt(x);", f"double y = {first};", *steps, "return y;"]
