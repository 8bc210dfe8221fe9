"""LLVM's intermediate language for a program's graph: straight-line code, but for products with large matrices."""

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.chunks import Chunk, ChunkWriter
from fmd.dynamics.compiler.functions import CHOICES, DECLARATIONS, FUNCTIONS, function_code
from fmd.dynamics.compiler.lanes import LaneEmitter
from fmd.dynamics.compiler.oscillator_code import OscillatorWriter
from fmd.dynamics.compiler.oscillators import OSCILLATED
from fmd.dynamics.compiler.parts import PLAIN, SPACING, WIDE, Parts, cut_program
from fmd.dynamics.compiler.program import LANES, Program
from fmd.dynamics.compiler.writer import literal


def emit(program: Program, register: int) -> tuple[str, Array]:
    """Write a program as a module of LLVM's language, for vector registers of so many doubles, and its constants.

    The code reads these from an array ``@constants`` that it is loaded with. So it depends on the structure of the
    program's graph alone, in which 0, 1 and -1 are simplified: other numbers give the same code. A long program is
    written as calls of functions that parts share which are alike.
    """
    module, parts = _Module(register), cut_program(program, register)
    own = "" if program.in_place else "noalias "
    arguments = ", ".join(f"ptr {own}%{name}" for name in program.arguments)
    body = module.body_of(program) if parts is None else module.calls_of(program, parts)
    module.add(f"define void @{program.name}({arguments}) {_attributes(program)}", body)
    return module.text(), np.array(module.constants)


def _attributes(program: Program) -> str:
    """Return how LLVM is to compile a function: lanes are spilled to whole lines of the cache.

    LLVM would keep them across two lines where the stack happens to be, which takes the arm's step from 594 to 707 ns.
    """
    return f"nounwind alignstack({8 * LANES})" if program.lanes else "nounwind"


class _Module:
    """A module under construction; the constants of each of its functions begin a line of the cache."""

    def __init__(self, register: int) -> None:
        self._register = register
        self.constants: list[float] = []
        self._functions: set[str] = set()
        self._lines: list[str] = []

    def text(self) -> str:
        """Return all of it."""
        functions = sorted(self._functions)
        lines = [
            "declare double @llvm.fma.f64(double, double, double)",
            "declare <8 x double> @llvm.fma.v8f64(<8 x double>, <8 x double>, <8 x double>)",
            "declare double @llvm.sqrt.f64(double)",
            *(DECLARATIONS if functions else ()),
            f"@constants = external constant [{len(self.constants)} x double], align 64",
            *(function_code(name) for name in functions),
            *self._lines,
            "!0 = !{}",
        ]
        return "\n".join(lines) + "\n"

    def add(self, head: str, body: list[str]) -> None:
        """Add a function that returns nothing."""
        self._lines += [f"{head} {{", "entry:", *body, "ret void", "}"]

    def body_of(self, program: Program) -> list[str]:
        """Write a program's statements, with constants of its own."""
        first = len(self.constants)
        at = f"getelementptr (double, ptr @constants, i64 {first})" if first else "@constants"
        out = ChunkWriter(self._register, at)
        body = self._statements(program, out)
        self.constants += out.constants
        return body

    def _statements(self, program: Program, out: ChunkWriter) -> list[str]:
        emitter = _Emitter(program, out)
        emitter.write_nodes()
        emitter.write_outputs()
        self._functions |= emitter.functions | emitter.lanes.functions
        return [*out.room, *out.lines]

    def calls_of(self, program: Program, parts: Parts) -> list[str]:
        """Write a program's parts, and return the statements that call them."""
        templates = []
        for function in parts.functions:
            out = PartWriter(self._register)
            body = self._statements(function, out)
            self.add(f"define internal void @{function.name}({PartWriter.HEAD}) {_attributes(function)}", body)
            templates.append(np.array(out.constants))
        places, calls = list[int](), list[str]()
        for call in parts.calls:
            template = templates[call.function]
            constants, varying = template.copy(), template >= 2.0
            constants[varying] = call.constants[template[varying].astype(int) - 2]
            first = f"ptr getelementptr (double, ptr @constants, i64 {len(self.constants)})"
            at = f"ptr getelementptr (i32, ptr @places, i64 {len(places)})"
            calls.append(f"call void @{parts.functions[call.function].name}(ptr %plain, ptr %wide, {first}, {at})")
            self.constants += constants.tolist()
            places += call.places
        arguments = ", ".join(f"ptr %{name}" for name in (*program.arguments, PLAIN, WIDE))
        for side in (*parts.before, *parts.after):
            self.add(f"define internal void @{side.name}({arguments}) nounwind", self.body_of(side))
        table = ", ".join(f"i32 {place}" for place in places)
        self._lines.append(f"@places = internal constant [{len(places)} x i32] [{table}]")
        rooms = [f"%{name} = alloca [{size} x double], align 64" for name, size in parts.sizes.items()]
        copies = [[f"call void @{side.name}({arguments})" for side in sides] for sides in (parts.before, parts.after)]
        return [*rooms, *copies[0], *calls, *copies[1]]


class PartWriter(ChunkWriter):
    """Writes a function that parts of a program share: each call brings its constants, and places of what it takes."""

    HEAD = "ptr %plain, ptr %wide, ptr noalias %constants, ptr noalias %places"

    def __init__(self, register: int) -> None:
        super().__init__(register, constants="%constants")
        self._begin: dict[int, str] = {}

    def address(self, argument: str, place: int) -> str:
        """Write the address of a place of an array, which counts from where the call has the value."""
        number, offset = divmod(place, SPACING * (LANES if argument == WIDE else 1))
        if number not in self._begin:
            at = self.value(f"getelementptr i32, ptr %places, i64 {number}")
            first = self.value(f"load i32, ptr {at}, align 4, !invariant.load !0")
            first = self.value(f"zext i32 {first} to i64")
            self._begin[number] = self.value(f"getelementptr double, ptr %{argument}, i64 {first}")
        begin = self._begin[number]
        return self.value(f"getelementptr double, ptr {begin}, i64 {offset}") if offset else begin


class _Emitter:
    """Writes a program's nodes in their order, and keeps the values of scalars and vectors by node."""

    def __init__(self, program: Program, out: ChunkWriter) -> None:
        self._program, self._graph, self.out = program, program.graph, out
        self.functions: set[str] = set()
        self._scalars: dict[int, str] = {}
        self._vectors: dict[int, list[Chunk]] = {}
        self._turns: dict[int, tuple[str, str]] = {}
        self._far_turns: dict[int, tuple[str, str]] = {}
        self._tables: dict[bytes, str] = {}
        self._oscillated: dict[tuple[int, ...], tuple[list[Chunk], ...]] = {}
        self.lanes = LaneEmitter(program, self.out, self._scalars, self._vectors)

    def write_nodes(self) -> None:
        """Write all nodes."""
        wide = self._program.in_lanes
        for number in self._program.nodes:
            node = self._graph.nodes[number]
            if number in wide:
                self.lanes.write(number)
            elif node.size or node.operation == "array":
                self._vectors[number] = self._vector(number)
            else:
                self._scalars[number] = self._scalar(number)
            if self._program.guard is not None and self._program.guard.node == number:
                self._leave_at_rest(self._scalars[number])

    def _leave_at_rest(self, guard: str) -> None:
        places = [(argument, place) for _, (argument, places) in self._program.outputs for place in places]
        at = [self.out.value(f"getelementptr double, ptr %{argument}, i64 {place}") for argument, place in places]
        stores = [f"store double {literal(0.0)}, ptr {place}, align 8" for place in at]
        self.out.leave_unless(f"fcmp ogt double {guard}, {literal(0.0)}", stores)

    def write_outputs(self) -> None:
        """Write the stores of all outputs."""
        for value, (argument, places) in self._program.outputs:
            if argument in self._program.lanes:
                self.lanes.store(value.node, argument, places)
            elif value.node in self._vectors:
                self.out.store(self._vectors[value.node], argument, places)
            else:
                self.out.store([(self._scalars[value.node], 1)], argument, places)

    def _scalar(self, number: int) -> str:
        operation, arguments, data, _ = self._graph.nodes[number]
        out, scalars = self.out, self._scalars
        if operation == "number":
            return out.number(float(data))  # type: ignore[arg-type]
        if operation == "input":
            return out.load(*data)[0][0]  # type: ignore[misc]
        if operation in ("add", "subtract", "multiply"):
            instruction = {"add": "fadd", "subtract": "fsub", "multiply": "fmul"}[operation]
            return out.binary(instruction, scalars[arguments[0]], scalars[arguments[1]])
        if operation == "negate":
            return out.value(f"fneg double {scalars[arguments[0]]}")
        if operation == "invert":
            return out.value(f"fdiv double {literal(1.0)}, {scalars[arguments[0]]}")
        if operation == "entry":
            return out.entry(self._vectors[arguments[0]], data, 1)  # type: ignore[arg-type]
        if operation == "dot":
            return out.dot(*(self._vectors[k] for k in arguments))
        if operation in CHOICES:
            return self._choice(operation, arguments)
        if operation in ("piece", "pick"):
            return self._of_table(operation, scalars[arguments[0]], self._graph.arrays[data])  # type: ignore[index]
        if operation not in FUNCTIONS:
            raise ValueError(f"no code for {operation}")
        return self._function(operation, arguments[0])

    def _choice(self, operation: str, arguments: tuple[int, ...]) -> str:
        values = [self._scalars[k] for k in arguments]
        if operation != "power":
            return self.out.choose(operation, values)
        if self._graph.nodes[arguments[1]].data == 0.5:
            return self.out.value(f"call double @llvm.sqrt.f64(double {values[0]})")
        self.functions.add(operation)
        return self.out.value(f"call double @of_power(double {values[0]}, double {values[1]})")

    def _of_table(self, operation: str, x: str, values: Array) -> str:
        key = values.tobytes()
        if key not in self._tables:
            self._tables[key] = self.out.table(values)
        table = self._tables[key]
        if operation == "piece":
            self.functions.add("piece")
            return self.out.value(f"call double @of_piece(double {x}, ptr {table}, i64 {values.size})")
        number = self.out.value(f"fptosi double {x} to i64")
        place = self.out.value(f"getelementptr double, ptr {table}, i64 {number}")
        return self.out.load_constant(place)

    def _function(self, operation: str, argument: int) -> str:
        x = self._scalars[argument]
        if operation in ("sin", "cos"):
            if argument not in self._turns:
                self._turns[argument] = self.out.sine_and_cosine(x)
            return self._turns[argument][operation == "cos"]
        if operation in ("far_sin", "far_cos"):
            self.functions.add("turn")
            if argument not in self._far_turns:
                self._far_turns[argument] = self.out.sine_or_cosine_far(x)
            return self._far_turns[argument][operation == "far_cos"]
        self.functions.add(operation)
        return self.out.value(f"call double @of_{operation}(double {x})")

    def _vector(self, number: int) -> list[Chunk]:
        operation, arguments, data, _ = self._graph.nodes[number]
        if operation == "vector input":
            return self.out.load(*data)  # type: ignore[misc]
        if operation == "combine":
            pairs = zip(arguments[::2], arguments[1::2], strict=True)
            return self.out.combine([(self._scalars[s], self._vectors[v]) for s, v in pairs])
        if operation == "products":
            return self.out.multiply_entries(*(self._vectors[k] for k in arguments))
        if operation in OSCILLATED:
            if arguments not in self._oscillated:
                scalars = [self._scalars[k] for k in arguments if k in self._scalars]
                vectors = [self._vectors[k] for k in arguments if k in self._vectors]
                self._oscillated[arguments] = OscillatorWriter(self.out, data, scalars, vectors).write()  # type: ignore[arg-type]
            return self._oscillated[arguments][OSCILLATED.index(operation)]
        constant = self._graph.arrays[data]  # type: ignore[index]
        if operation == "array":
            return self.out.constant(constant)
        if operation == "diagonal":
            return self.out.multiply_diagonal(constant, self._vectors[arguments[0]])
        return self.out.multiply_matrix(constant, self._vectors[arguments[0]])
