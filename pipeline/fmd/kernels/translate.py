"""A small subset of Python to LLVM's language.

A function is translated once for the types of its arguments, as a template is. It may hold numbers, C-contiguous arrays
with their rows and slices, members of a `Table`, tuples that are no arguments, arithmetic, comparisons, ``if``,
``while``, ``for`` over a ``range``, ``break``, ``continue``, ``return``, calls of other such functions, and those of
`library`. A variable keeps the type that it is first given; one that Python would miss is 0.
"""

import ast
import inspect
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import field
from functools import cache
from typing import Any

from fmd.core.data_classes import dataclass
from fmd.core.limits.code import ROUNDS_AT_ONCE
from fmd.kernels.arithmetic import compute, convert
from fmd.kernels.expressions import Expressions
from fmd.kernels.library import DECLARATIONS
from fmd.kernels.places import CHECKS, find_entry
from fmd.kernels.types import (
    NOTHING,
    TRUTH,
    WHOLE,
    ArrayType,
    Compiling,
    TableType,
    TupleType,
    Type,
    llvm_type,
    name_of,
)
from fmd.kernels.writer import BlockWriter, NotInSubset, Value, whole

METADATA = f"""!0 = !{{}}
!1 = distinct !{{!1, !2}}
!2 = !{{!"llvm.loop.unroll.count", i32 {ROUNDS_AT_ONCE}}}"""
UNROLLED = ", !llvm.loop !1"


@dataclass
class Module:
    """Functions in LLVM's language, each for the types of arguments that it is called with."""

    # Return how a function is compiled, None if it isn't marked as one for kernels.
    marks: Callable[[Any], Compiling | None]
    checked: bool = False  # whether indices are checked against the bounds of arrays
    checks: list[tuple[str, int]] = field(default_factory=list)  # file and line of each check
    tables: dict[str, str] = field(default_factory=dict)
    _functions: dict[Any, tuple[str, Type] | None] = field(default_factory=dict)
    _texts: list[str] = field(default_factory=list)

    def translate_entry(self, function: Any, types: tuple[Type, ...]) -> tuple[str, Type]:
        """Return the module's text with a function as the C function ``entry``, and the type of its result."""
        _, result = self.function(function, types, "entry")
        if isinstance(result, TupleType):
            raise NotInSubset(f"{function.__name__} returns several values; Python can take one")
        checks = CHECKS if self.checked else ""
        return "\n".join([DECLARATIONS, *self.tables.values(), checks, *self._texts, METADATA]), result

    def function(self, function: Any, types: tuple[Type, ...], entry: str = "") -> tuple[str, Type]:
        """Return the name of a function for types of arguments, and the type of its result."""
        key = function, types
        if key not in self._functions:
            self._functions[key] = None
            name = entry or f"{function.__name__}.{len(self._functions)}"
            marks = self.marks(function) or Compiling(inlined=True)  # else `singledispatch` has chosen it
            body = _Body(self, function, types, marks)
            self._texts.append(body.text(name, bool(entry), marks.inlined))
            self._functions[key] = name, body.result
        if (known := self._functions[key]) is None:
            raise NotInSubset(f"{function.__name__} calls itself")
        return known

    def is_marked(self, function: Any) -> bool:
        """Tell whether kernels may call a function."""
        return self.marks(function) is not None

    def constants(self, entry: str, texts: Sequence[str]) -> str:
        """Return the name of a constant array."""
        values = f"[{len(texts)} x {entry}] [{', '.join(f'{entry} {text}' for text in texts)}]"
        if values not in self.tables:
            self.tables[values] = f"@constants.{len(self.tables)} = private constant {values}"
        return self.tables[values].partition(" ")[0]


def _is_innermost(loop: ast.For) -> bool:
    return not any(isinstance(node, ast.For | ast.While) for part in loop.body for node in ast.walk(part))


@cache
def _tree(function: Any) -> ast.FunctionDef:
    tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assert isinstance(tree, ast.FunctionDef)
    return tree


def _parameter(kind: Type, name: str) -> Value:
    shape = tuple(f"{name}.{axis}" for axis in range(kind.n_axes)) if isinstance(kind, ArrayType) else ()
    return Value(kind, name, shape)


class _Body(Expressions):
    """Writes the statements of a function for some types of its arguments."""

    def __init__(self, module: Module, function: Any, types: tuple[Type, ...], marks: Compiling) -> None:
        super().__init__(module, function, BlockWriter(marks.contracted, module.checks if module.checked else None))
        self._tree, self._types, self._unrolled = _tree(function), types, marks.unrolled
        self.result: Type = NOTHING
        self._returned: Value | None = None
        self._loops: list[tuple[str, str]] = []
        self._left: set[str] = set()  # labels that a break leads to

    def text(self, name: str, public: bool, inlined: bool) -> str:
        """Return the function in LLVM's language."""
        w, values = self.w, [_parameter(kind, f"%p{k}") for k, kind in enumerate(self._types)]
        words = [word for x in values for word in x.words(" zeroext" if x.type == TRUTH else "")]
        arguments = self._tree.args
        if arguments.vararg or arguments.kwarg or arguments.kwonlyargs or len(arguments.args) != len(values):
            raise NotInSubset(f"{self.function.__name__} has {len(arguments.args)} plain parameters, not {len(values)}")
        for argument, value in zip(arguments.args, values, strict=True):
            self.assign(argument.arg, value)
        self._exit = w.new("exit")
        self._write(self._tree.body)
        if w.is_open and self._returned:
            raise NotInSubset(f"{self.where}: {self.function.__name__} may end without a return")
        w.jump(self._exit)
        w.label(self._exit)
        if self._returned:
            w.line(f"ret {llvm_type(self.result)} {self.packed(w.load(self._returned)).text}")
        else:
            w.line("ret void")
        kind = f"{'zeroext ' if self.result == TRUTH else ''}{llvm_type(self.result)}"
        attributes = "nounwind" + (" alwaysinline" if inlined and not public else "")
        head = f'define {"" if public else "internal "}{kind} @"{name}"({", ".join(words)}) {attributes} {{\nbegin:'
        return "\n".join([head, *w.variables, *w.lines, "}"])

    def _write(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            if not self.w.is_open:
                return  # after a return, a break or a continue
            self.w.place = place = self.function.__code__.co_filename, self.line_of(statement)
            write = getattr(self, f"_write_{type(statement).__name__.lower()}", None)
            try:
                if write is None:
                    raise NotInSubset("kernels have no such statement")
                write(statement)
            except NotInSubset as error:
                self.w.place = place
                if error.placed:
                    error.add_note(f"in {self.function.__name__}, {self.where}")
                else:
                    first = ast.unparse(statement).partition("\n")[0]
                    error.args, error.placed = (f"{self.where}: {error}: {first}",), True
                raise

    def _write_expr(self, statement: ast.Expr) -> None:
        if not isinstance(statement.value, ast.Constant):
            self.value(statement.value)

    def _write_assign(self, statement: ast.Assign) -> None:
        value = self.value(statement.value)
        for target in statement.targets:
            self._set(target, value)

    def _write_annassign(self, statement: ast.AnnAssign) -> None:
        if statement.value:
            self._set(statement.target, self.value(statement.value))

    def _write_augassign(self, statement: ast.AugAssign) -> None:
        old = self.value(statement.target)
        self._set(statement.target, compute(self.w, statement.op, old, self.value(statement.value)))

    def _set(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Name):
            self.assign(target.id, value)
        elif isinstance(target, ast.Tuple) and len(target.elts) == len(value.parts):
            for part, x in zip(target.elts, value.parts, strict=True):
                self._set(part, x)
        elif isinstance(target, ast.Subscript):
            array, indices = self.value(target.value), self.indices(target.slice)
            if not isinstance(array.type, ArrayType) or len(indices) != array.type.n_axes:
                raise NotInSubset("entries of arrays are set one by one")
            place = find_entry(self.w, array, indices)
            self.w.line(f"store {place.type} {convert(self.w, value, place.type).text}, ptr {place.text}, align 8")
        else:
            raise NotInSubset(f"{ast.unparse(target)} can't be set to {name_of(value.type)}")

    def _write_return(self, statement: ast.Return) -> None:
        value = Value(NOTHING, "") if statement.value is None else self.value(statement.value)
        kinds = value.type.members if isinstance(value.type, TupleType) else (value.type,)
        if any(isinstance(kind, ArrayType | TableType | TupleType) for kind in kinds):
            raise NotInSubset(f"functions return numbers, not {name_of(value.type)}")
        if value.type != NOTHING:
            if self._returned is None:
                self.result, self._returned = value.type, self.w.variable(value.type)
            self.w.store(self._returned, convert(self.w, value, self.result))
        elif self._returned:
            raise NotInSubset("returns nothing, and a value elsewhere")
        self.w.jump(self._exit)

    def _write_if(self, statement: ast.If) -> None:
        w, test = self.w, self.test(statement.test)
        if test.known is not None:
            return self._write(statement.body if test.known else statement.orelse)
        yes, no, after = w.new("yes"), w.new("no"), w.new("after")
        w.branch(test, yes, no)
        reached = False
        for label, body in ((yes, statement.body), (no, statement.orelse)):
            w.label(label)
            self._write(body)
            reached |= w.is_open
            w.jump(after)
        if reached:
            w.label(after)
        return None

    def _write_while(self, statement: ast.While) -> None:
        w, (head, body, after) = self.w, (self.w.new(name) for name in ("head", "body", "after"))
        w.jump(head)
        w.label(head)
        test = self.test(statement.test)
        if test.known:
            w.jump(body)
        else:
            w.branch(test, body, after)
        self._loop(statement, body, head, after)
        w.jump(head)
        if not test.known or after in self._left:
            w.label(after)

    def _write_for(self, statement: ast.For) -> None:
        call = statement.iter
        if not (isinstance(call, ast.Call) and self.outside(call.func) is range and not call.keywords):
            raise NotInSubset("loops are over a range")
        bounds = [self.value(x) for x in call.args]
        if any(bound.type != WHOLE for bound in bounds):
            raise NotInSubset("a range is of integers")
        start, stop = (whole(0), bounds[0]) if len(bounds) == 1 else bounds[:2]
        step = bounds[2].known if len(bounds) == 3 else 1
        if not step:
            raise NotInSubset("a range's step is a known number other than 0")
        w, place = self.w, self.w.reserve(WHOLE)
        head, body, again, after = (w.new(name) for name in ("head", "body", "again", "after"))
        w.line(f"store i64 {start.text}, ptr {place}")
        w.jump(head)
        w.label(head)
        i = w.value(WHOLE, f"load i64, ptr {place}")
        w.branch(w.value(TRUTH, f"icmp {'slt' if step > 0 else 'sgt'} i64 {i.text}, {stop.text}"), body, after)
        self._loop(statement, body, again, after, i)
        w.jump(again)
        w.label(again)
        w.line(f"store i64 {w.value(WHOLE, f'add nsw i64 {i.text}, {step}').text}, ptr {place}")
        w.jump(head, UNROLLED if self._unrolled and _is_innermost(statement) else "")
        w.label(after)

    def _loop(
        self, statement: ast.For | ast.While, body: str, again: str, after: str, number: Value | None = None
    ) -> None:
        if statement.orelse:
            raise NotInSubset("kernels have no else after a loop")
        self.w.label(body)
        if number is not None:
            self._set(statement.target, number)  # type: ignore[union-attr]
        self._loops.append((again, after))
        self._write(statement.body)
        self._loops.pop()

    def _write_break(self, statement: ast.Break) -> None:
        self._left.add(self._loops[-1][1])
        self.w.jump(self._loops[-1][1])

    def _write_continue(self, statement: ast.Continue) -> None:
        self.w.jump(self._loops[-1][0])
