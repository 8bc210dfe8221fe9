"""LLVM code for many directions or variants at once: what depends on inputs that have an entry for each lane.

Derivatives along a direction are linear in it, so eight directions share all that doesn't depend on them; eight
variants of a mechanism share what depends on none of their states. A scalar of theirs is one vector of eight doubles,
a modal vector a list of these.
"""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.code import UNROLLED
from fmd.dynamics.compiler.chunks import Chunk, ChunkWriter
from fmd.dynamics.compiler.functions import CHOICES, FUNCTIONS
from fmd.dynamics.compiler.program import LANES, Program
from fmd.dynamics.compiler.writer import literal, type_of

_KIND = type_of(LANES)


class LaneEmitter:
    """Writes the nodes that differ from lane to lane, by the program's ``lanes``, arguments with entries for each.

    Scalars and vectors are values of the other nodes by their numbers, ``functions`` those that its code calls.
    """

    def __init__(
        self, program: Program, out: ChunkWriter, scalars: dict[int, str], vectors: dict[int, list[Chunk]]
    ) -> None:
        self._graph, self._out = program.graph, out
        self._plain_scalars, self._plain_vectors = scalars, vectors
        self._scalars: dict[int, str] = {}
        self._vectors: dict[int, list[str]] = {}
        self._turns: dict[int, tuple[str, str]] = {}
        self._far_turns: dict[int, tuple[str, str]] = {}
        self._tables: dict[bytes, str] = {}
        self.functions: set[str] = set()

    def write(self, number: int) -> None:
        """Write a node's value in all lanes."""
        operation, arguments, data, _ = self._graph.nodes[number]
        if operation in ("input", "vector input"):
            argument, places = data  # type: ignore[misc]
            values = [self._load(argument, place) for place in places]
            if operation == "input":
                self._scalars[number] = values[0]
            else:
                self._vectors[number] = values
        elif operation in ("add", "subtract", "multiply"):
            instruction = {"add": "fadd", "subtract": "fsub", "multiply": "fmul"}[operation]
            a, b = (self._scalar(k) for k in arguments)
            self._scalars[number] = self._out.binary(instruction, a, b, LANES)
        elif operation == "negate":
            self._scalars[number] = self._out.value(f"fneg {_KIND} {self._scalars[arguments[0]]}")
        elif operation == "invert":
            one = self._out.splat(literal(1.0), LANES)
            self._scalars[number] = self._out.value(f"fdiv {_KIND} {one}, {self._scalars[arguments[0]]}")
        elif operation in ("sin", "cos"):
            self._scalars[number] = self._turn(arguments[0])[operation == "cos"]
        elif operation in ("far_sin", "far_cos"):
            self._scalars[number] = self._turn_far(arguments[0])[operation == "far_cos"]
        elif operation in FUNCTIONS:
            self.functions.add(operation)
            self._scalars[number] = self._call(operation, self._scalars[arguments[0]])
        elif operation == "power":
            self.functions.add(operation)
            self._scalars[number] = self._call(operation, *(self._scalar(k) for k in arguments))
        elif operation in CHOICES:
            self._scalars[number] = self._out.choose(operation, [self._scalar(k) for k in arguments], LANES)
        elif operation in ("piece", "pick"):
            self._scalars[number] = self._of_table(operation, self._scalars[arguments[0]], self._graph.arrays[data])  # type: ignore[index]
        elif operation == "entry":
            self._scalars[number] = self._vectors[arguments[0]][data]  # type: ignore[index]
        elif operation == "dot":
            self._scalars[number] = self._dot(*arguments)
        elif operation == "combine":
            self._vectors[number] = self._combine(arguments)
        elif operation in ("diagonal", "matrix"):
            constant = self._graph.arrays[data]  # type: ignore[index]
            self._vectors[number] = self._product(constant, arguments[0])
        else:
            raise ValueError(f"no code for {operation} in lanes")

    def _turn(self, argument: int) -> tuple[str, str]:
        """Write the sine and the cosine of a scalar, once."""
        if argument not in self._turns:
            self._turns[argument] = self._out.sine_and_cosine(self._scalars[argument], LANES)
        return self._turns[argument]

    def _turn_far(self, argument: int) -> tuple[str, str]:
        """Write a call for the sine and the cosine of a scalar however large, once."""
        if argument not in self._far_turns:
            out, room = self._out, self._out.name()
            self.functions |= {"turn", "turn_lanes"}
            out.room.append(f"{room} = alloca [2 x {_KIND}], align 64")
            out.lines.append(f"call void @of_turn_lanes({_KIND} {self._scalars[argument]}, ptr {room})")
            second = out.value(f"getelementptr {_KIND}, ptr {room}, i64 1")
            sine, cosine = (out.value(f"load {_KIND}, ptr {place}, align 64") for place in (room, second))
            self._far_turns[argument] = sine, cosine
        return self._far_turns[argument]

    def _call(self, function: str, *arguments: str) -> str:
        """Write a call of a function lane by lane."""
        value = "poison"
        for lane in range(LANES):
            given = [self._out.value(f"extractelement {_KIND} {x}, i32 {lane}") for x in arguments]
            one = self._out.value(f"call double @of_{function}({', '.join(f'double {x}' for x in given)})")
            value = self._out.value(f"insertelement {_KIND} {value}, double {one}, i32 {lane}")
        return value

    def _of_table(self, operation: str, x: str, values: Array) -> str:
        """Look a table up lane by lane."""
        out, value = self._out, "poison"
        key = values.tobytes()
        if key not in self._tables:
            self._tables[key] = out.table(values)
        for lane in range(LANES):
            one = out.value(f"extractelement {_KIND} {x}, i32 {lane}")
            if operation == "piece":
                self.functions.add("piece")
                one = out.value(f"call double @of_piece(double {one}, ptr {self._tables[key]}, i64 {values.size})")
            else:
                number = out.value(f"fptosi double {one} to i64")
                place = out.value(f"getelementptr double, ptr {self._tables[key]}, i64 {number}")
                one = out.load_constant(place)
            value = out.value(f"insertelement {_KIND} {value}, double {one}, i32 {lane}")
        return value

    def store(self, number: int, argument: str, places: tuple[int, ...]) -> None:
        """Write a node's value in all lanes to an argument."""
        size = self._graph.nodes[number].size
        values = [self._entry(number, k) for k in range(size)] if size else [self._scalar(number)]
        for value, place in zip(values, places, strict=True):
            self._out.lines.append(f"store {_KIND} {value}, ptr {self._address(argument, place)}, align 8")

    def _load(self, argument: str, place: int) -> str:
        return self._out.value(f"load {_KIND}, ptr {self._address(argument, place)}, align 8")

    def _address(self, argument: str, place: int) -> str:
        return self._out.address(argument, place * LANES)

    def _scalar(self, number: int) -> str:
        known = self._scalars.get(number)
        return self._out.splat(self._plain_scalars[number], LANES) if known is None else known

    def _entry(self, number: int, place: int) -> str:
        known = self._vectors.get(number)
        return self._out.entry(self._plain_vectors[number], place, LANES) if known is None else known[place]

    def _sum(self, products: list[tuple[str, str]]) -> str:
        """Sum products in four parts, which hide the latency of each other's ``fma``."""
        nothing = self._out.splat(literal(0.0), LANES)
        parts: list[str] = []
        for k, (a, b) in enumerate(pair for pair in products if nothing not in pair):
            if len(parts) < 4:
                parts.append(self._out.binary("fmul", a, b, LANES))
            else:
                parts[k % 4] = self._out.accumulate(parts[k % 4], a, b, LANES)
        while len(parts) > 1:
            parts.append(self._out.binary("fadd", parts.pop(0), parts.pop(0), LANES))
        return parts[0] if parts else nothing

    def _dot(self, a: int, b: int) -> str:
        size = self._graph.nodes[a].size
        return self._sum([(self._entry(a, k), self._entry(b, k)) for k in range(size)])

    def _combine(self, arguments: tuple[int, ...]) -> list[str]:
        size = self._graph.nodes[arguments[1]].size
        pairs = list(zip(arguments[::2], arguments[1::2], strict=True))
        return [self._sum([(self._scalar(s), self._entry(v, k)) for s, v in pairs]) for k in range(size)]

    def _product(self, constant: Array, vector: int) -> list[str]:
        if constant.ndim == 1:
            rows = [[(float(x), k)] for k, x in enumerate(constant)]
        elif constant.shape[1] <= UNROLLED:
            rows = [[(float(row[k]), int(k)) for k in np.flatnonzero(row)] for row in constant]
        else:
            return self._looped_product(constant, vector)
        return [
            self._sum([(self._out.splat(self._out.number(x), LANES), self._entry(vector, k)) for x, k in row])
            for row in rows
        ]

    def _looped_product(self, matrix: Array, vector: int) -> list[str]:
        """A loop over rows, each of which is summed without one."""
        out, (n_rows, n_columns) = self._out, matrix.shape
        table, result = out.table(matrix), out.name()
        out.room.append(f"{result} = alloca [{n_rows} x {_KIND}], align 64")
        columns = [self._entry(vector, k) for k in range(n_columns)]
        counter, following, label, after, before = out.name(), out.name(), *out.new_loop()
        out.lines.append(f"{counter} = phi i64 [ 0, %{before} ], [ {following}, %{label} ]")
        first, products = out.value(f"mul i64 {counter}, {n_columns}"), []
        for k, column in enumerate(columns):
            where = out.value(f"getelementptr double, ptr {table}, i64 {out.value(f'add i64 {first}, {k}')}")
            products.append((out.splat(out.load_constant(where), LANES), column))
        where = out.value(f"getelementptr {_KIND}, ptr {result}, i64 {counter}")
        out.lines.append(f"store {_KIND} {self._sum(products)}, ptr {where}, align 64")
        out.lines.append(f"{following} = add i64 {counter}, 1")
        out.end_loop(f"icmp slt i64 {following}, {n_rows}", label, after)
        places = [out.value(f"getelementptr {_KIND}, ptr {result}, i64 {k}") for k in range(n_rows)]
        return [out.value(f"load {_KIND}, ptr {place}, align 64") for place in places]
