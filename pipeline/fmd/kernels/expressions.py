"""Expressions of kernels in LLVM's language, and the variables and names outside that they read."""

import ast
import builtins
from collections.abc import Callable
from typing import Any

import numpy as np

from fmd.kernels.arithmetic import COMPARISONS, all_of, common_type, compare, compute, convert, negate, truth
from fmd.kernels.library import FUNCTIONS
from fmd.kernels.places import find_entry, row_of, size_of, slice_of
from fmd.kernels.types import NOTHING, TRUTH, WHOLE, ArrayType, TableType, TupleType, llvm_type, name_of
from fmd.kernels.writer import BlockWriter, NotInSubset, Value, real, tuple_of, whole


class Expressions:
    """Writes the expressions of a function, whose names that aren't its variables are what they are to it.

    The module, that of `fmd.kernels.translate`, translates what is called; lines go to the writer.
    """

    def __init__(self, module: Any, function: Any, writer: BlockWriter) -> None:
        self.module, self.function, self.w = module, function, writer
        self._variables: dict[str, Value] = {}
        cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
        self._outside = {**vars(builtins), **function.__globals__, **{name: cell.cell_contents for name, cell in cells}}

    @property
    def where(self) -> str:
        """File and line of the present statement."""
        file, line = self.w.place
        return f"{file}:{line}"

    def line_of(self, node: ast.stmt) -> int:
        """Return the line of a statement in its file."""
        return int(self.function.__code__.co_firstlineno) + node.lineno - 1

    def assign(self, name: str, value: Value) -> None:
        """Set a variable, which keeps the type that it is first given."""
        if value.type == NOTHING:
            raise NotInSubset("a function that returns nothing has no value")
        if name not in self._variables:
            self._variables[name] = self.w.variable(value.type)
        variable = self._variables[name]
        try:
            converted = convert(self.w, value, variable.type)
        except NotInSubset as error:
            raise NotInSubset(f"{name}: {error}") from error
        self.w.store(variable, converted)

    def outside(self, node: ast.expr) -> Any:
        """Return what a name is outside of the function, such as ``math.inf``; None for a variable."""
        if isinstance(node, ast.Name):
            return None if node.id in self._variables else self._outside.get(node.id)
        if isinstance(node, ast.Attribute) and (owner := self.outside(node.value)) is not None:
            return getattr(owner, node.attr)
        return None

    def value(self, node: ast.expr) -> Value:
        """Write an expression, and return its value."""
        write = getattr(self, f"_write_{type(node).__name__.lower()}_value", None)
        if write is None:
            raise NotInSubset(f"kernels have no such expression as {ast.unparse(node)}")
        value: Value = write(node)
        return value

    def test(self, node: ast.expr) -> Value:
        """Write an expression that decides, and return its truth."""
        if isinstance(node, ast.BoolOp):
            return self._decide(node, self.test)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return self._not(self.test(node.operand))
        return truth(self.w, self.value(node))

    def _constant(self, x: Any, name: str) -> Value:
        if isinstance(x, bool | np.bool_):
            return Value(TRUTH, str(bool(x)).lower())
        if isinstance(x, int | np.integer):
            return whole(int(x))
        if isinstance(x, float):
            return real(float(x))
        if isinstance(x, tuple):
            return tuple_of(tuple(self._constant(part, name) for part in x))
        raise NotInSubset(f"{name} is neither a variable nor a number")

    def _write_constant_value(self, node: ast.Constant) -> Value:
        return self._constant(node.value, ast.unparse(node))

    def _write_name_value(self, node: ast.Name) -> Value:
        if node.id in self._variables:
            return self.w.load(self._variables[node.id])
        return self._constant(self._outside.get(node.id), node.id)

    def _write_tuple_value(self, node: ast.Tuple) -> Value:
        parts: tuple[Value, ...] = ()
        for part in node.elts:
            value = self.value(part.value if isinstance(part, ast.Starred) else part)
            parts += value.parts if isinstance(part, ast.Starred) else (value,)
        return tuple_of(parts)

    def _write_attribute_value(self, node: ast.Attribute) -> Value:
        if (known := self.outside(node)) is not None:
            return self._constant(known, ast.unparse(node))
        x = self.value(node.value)
        if isinstance(x.type, ArrayType) and node.attr == "size":
            return size_of(self.w, x)
        if isinstance(x.type, ArrayType) and node.attr == "shape":
            return tuple_of(tuple(Value(WHOLE, n) for n in x.shape))
        if not isinstance(x.type, TableType):
            raise NotInSubset(f"{name_of(x.type)} has no {node.attr}")
        return self._member(x, x.type, node.attr)

    def _member(self, x: Value, table: TableType, name: str) -> Value:
        """Load a member; nothing in a table changes while a kernel runs, so that a loop needs it once."""
        try:
            word, kind = table.find(name)
        except AttributeError as error:
            raise NotInSubset(str(error)) from error
        if isinstance(kind, bool):
            return Value(TRUTH, str(kind).lower())

        def load(number: int, as_type: str) -> str:
            place = self.w.value("ptr", f"getelementptr i64, ptr {x.text}, i64 {word + number}").text
            return self.w.value(as_type, f"load {as_type}, ptr {place}, align 8, !invariant.load !0").text

        shape = tuple(load(1 + axis, WHOLE) for axis in range(kind.n_axes)) if isinstance(kind, ArrayType) else ()
        return Value(kind, load(0, llvm_type(kind)), shape)

    def indices(self, node: ast.expr) -> list[Value]:
        """Return the indices of an array, in the order of its axes."""
        return [self.value(k) for k in (node.elts if isinstance(node, ast.Tuple) else [node])]

    def _write_subscript_value(self, node: ast.Subscript) -> Value:
        x = self.value(node.value)
        if isinstance(x.type, TupleType):
            return self._part(x, self.value(node.slice))
        if not isinstance(x.type, ArrayType):
            raise NotInSubset(f"{name_of(x.type)} has no entries")
        *first, last = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if isinstance(last, ast.Slice):
            row = row_of(self.w, x, [self.value(k) for k in first]) if first else x
            if last.step or len(first) >= x.type.n_axes:
                raise NotInSubset("slices are of an array's own axes, and without a step")
            bounds = (None if bound is None else self.value(bound) for bound in (last.lower, last.upper))
            return slice_of(self.w, row, *bounds)
        indices = self.indices(node.slice)
        if len(indices) < x.type.n_axes:
            return row_of(self.w, x, indices)
        place = find_entry(self.w, x, indices)
        return self.w.value(place.type, f"load {place.type}, ptr {place.text}, align 8")

    def _part(self, x: Value, number: Value) -> Value:
        """Return a part of a tuple; one of a number that isn't known is read from a table of constants."""
        if number.known is not None:
            return x.parts[number.known]
        kinds = {part.type for part in x.parts}
        if len(kinds) != 1 or not all(part.text.startswith("0x") or part.known is not None for part in x.parts):
            raise NotInSubset("only constants of one type have a number that isn't known")
        (kind,) = kinds
        name = self.module.constants(llvm_type(kind), [part.text for part in x.parts])
        table = Value(ArrayType(str(kind), 1), name, (str(len(x.parts)),))
        place = find_entry(self.w, table, [number])
        return self.w.value(kind, f"load {kind}, ptr {place.text}, align 8")

    def _write_binop_value(self, node: ast.BinOp) -> Value:
        return compute(self.w, node.op, self.value(node.left), self.value(node.right))

    def _write_unaryop_value(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return self._not(self.test(node.operand))
        if isinstance(node.op, ast.USub):
            return negate(self.w, self.value(node.operand))
        raise NotInSubset(f"kernels have no such expression as {ast.unparse(node)}")

    def _not(self, x: Value) -> Value:
        if x.known is not None:
            return Value(TRUTH, str(not x.known).lower())
        return self.w.value(TRUTH, f"xor i1 {x.text}, true")

    def _write_compare_value(self, node: ast.Compare) -> Value:
        left, results = self.value(node.left), []
        for op, other in zip(node.ops, node.comparators, strict=True):
            if type(op) not in COMPARISONS:
                raise NotInSubset(f"kernels have no such comparison as {ast.unparse(node)}")
            right = self.value(other)
            results.append(compare(self.w, COMPARISONS[type(op)], left, right))
            left = right
        return all_of(self.w, results)

    def _write_boolop_value(self, node: ast.BoolOp) -> Value:
        """Write ``and`` or ``or`` of truths; of numbers they would be one of these, and are only in tests."""

        def only_truth(part: ast.expr) -> Value:
            value = self.value(part)
            if value.type != TRUTH:
                raise NotInSubset(f"{ast.unparse(part)} is no truth")
            return value

        return self._decide(node, only_truth)

    def _decide(self, node: ast.BoolOp, write: Callable[[ast.expr], Value]) -> Value:
        """Write ``and`` or ``or``: the later ones are evaluated only if they are needed, and none if one is known."""
        w, ends, unknown = self.w, isinstance(node.op, ast.Or), False
        place, after = w.reserve(TRUTH), w.new("after")
        w.line(f"store i1 {str(ends).lower()}, ptr {place}")
        for part in node.values:
            value = write(part)
            if value.known == ends and not unknown:
                return value
            if value.known != (not ends):
                unknown, more = True, w.new("more")
                w.branch(value, *((after, more) if ends else (more, after)))
                w.label(more)
        if not unknown:
            return value
        w.line(f"store i1 {str(not ends).lower()}, ptr {place}")
        w.jump(after)
        w.label(after)
        return w.value(TRUTH, f"load i1, ptr {place}")

    def _write_ifexp_value(self, node: ast.IfExp) -> Value:
        w, test = self.w, self.test(node.test)
        if test.known is not None:
            return self.value(node.body if test.known else node.orelse)
        yes, no, after = w.new("yes"), w.new("no"), w.new("after")
        w.branch(test, yes, no)
        ends = []
        for label, part in ((yes, node.body), (no, node.orelse)):
            with w.aside() as lines:
                w.label(label)
                ends.append((lines, self.value(part)))
        result = w.variable(common_type(*(value.type for _, value in ends)))
        for lines, value in ends:
            w.lines += lines
            w.store(result, convert(w, value, result.type))
            w.jump(after)
            w.is_open = True
        w.label(after)
        return w.load(result)

    def packed(self, value: Value) -> Value:
        """Return a tuple as one value of LLVM's, which a function can return."""
        kind, text = llvm_type(value.type), "poison"
        if not value.parts:
            return value
        for k, part in enumerate(value.parts):
            text = self.w.value(kind, f"insertvalue {kind} {text}, {llvm_type(part.type)} {part.text}, {k}").text
        return Value(value.type, text)

    def _write_call_value(self, node: ast.Call) -> Value:
        function = self.outside(node.func)
        function = getattr(function, "python", function)
        if node.keywords:
            raise NotInSubset("arguments are given by their places")
        arguments = [self.value(x) for x in node.args]
        if function.__hash__ and (write := FUNCTIONS.get(function)):
            return write(self.w, arguments)
        if (registered := getattr(function, "dispatch", None)) is not None:
            first = arguments[0].type
            chosen = registered(first.table if isinstance(first, TableType) else object)
            if chosen is registered(object) and not self.module.is_marked(chosen):
                raise NotInSubset(f"{function.__name__} is not registered for {name_of(first)}")
            function = chosen
        elif not self.module.is_marked(function):
            raise NotInSubset(f"{ast.unparse(node.func)} is no function for kernels")
        return self._call(function, arguments)

    def _call(self, function: Any, arguments: list[Value]) -> Value:
        name, result = self.module.function(function, tuple(x.type for x in arguments))
        call = f'call {llvm_type(result)} @"{name}"({", ".join(word for x in arguments for word in x.words())})'
        if result == NOTHING:
            self.w.line(call)
            return Value(NOTHING, "")
        value = self.w.value(result, call)
        if not isinstance(result, TupleType):
            return value
        return tuple_of(
            tuple(
                self.w.value(member, f"extractvalue {llvm_type(result)} {value.text}, {k}")
                for k, member in enumerate(result.members)
            )
        )
