"""Formulas of time in a scene, parsed by a list of allowed operations into a postfix program."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable
from functools import lru_cache

from fmd.core.data_classes import dataclass
from fmd.core.limits.scene import FORMULAS_KEPT, LONGEST_FORMULA, MOST_DEPTH

# Codes of the postfix program. A constant takes the next of the constants.
CONSTANT, TIME, ADD, SUBTRACT, MULTIPLY, DIVIDE, POWER, NEGATE = range(8)
SIN, COS, TAN, EXP, LOG, SQRT, TANH, ABS, MINIMUM, MAXIMUM = range(8, 18)
BEFORE, UNTIL = 18, 19  # chooses by t < c or t <= c: pops c, the value until then, the value after

_FUNCTIONS: dict[str, tuple[int, int, Callable[..., float]]] = {
    "sin": (SIN, 1, math.sin),
    "cos": (COS, 1, math.cos),
    "tan": (TAN, 1, math.tan),
    "exp": (EXP, 1, math.exp),
    "log": (LOG, 1, math.log),
    "sqrt": (SQRT, 1, math.sqrt),
    "tanh": (TANH, 1, math.tanh),
    "abs": (ABS, 1, abs),
    "min": (MINIMUM, 2, min),
    "max": (MAXIMUM, 2, max),
}
_OPERATORS: dict[type[ast.operator], tuple[int, Callable[[float, float], float]]] = {
    ast.Add: (ADD, lambda a, b: a + b),
    ast.Sub: (SUBTRACT, lambda a, b: a - b),
    ast.Mult: (MULTIPLY, lambda a, b: a * b),
    ast.Div: (DIVIDE, lambda a, b: a / b),
    ast.Pow: (POWER, math.pow),
}
_CONSTANTS = {"pi": math.pi}
OF_TIME = frozenset({"t", *_CONSTANTS, *_FUNCTIONS})
_ALLOWED = f"t, pi, numbers, + - * / **, {', '.join(_FUNCTIONS)} and 'a if t < c else b'"
_CONDITION = "a condition compares t with a constant, e.g. t < 0.5; for two of them write one 'if' into the other"
# Refused before Python's parser sees them: quotes, brackets and comments, and a number that runs into a name, of which
# 0x1f, 1_000 and 2j are some and of which others only make Python warn.
_FOREIGN = re.compile(r"[^A-Za-z0-9_.+*/()<>=, \t\r\n-]")
_GLUED = re.compile(r"(?<![A-Za-z0-9_.])(?>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)[A-Za-z_]")
_BLANKS = str.maketrans("\t\r\n", "   ")


@dataclass(frozen=True, slots=True)
class Formula:
    """A formula of the time as a postfix program."""

    codes: tuple[int, ...]  # operations on the stack, in order; it never holds more than ``MOST_DEPTH`` values
    constants: tuple[float, ...]  # values of the codes ``CONSTANT``, in order
    # Times at which a condition switches [s], ascending; kinks of abs, min and max aren't looked for.
    breakpoints: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Part:
    """Piece of a program, with its value if it is constant, and the depth of stack that it needs."""

    codes: tuple[int, ...]
    constants: tuple[float, ...]
    value: float | None
    depth: int


@lru_cache(maxsize=FORMULAS_KEPT)
def parse_formula(text: str, variable: str = "t") -> Formula:
    """Parse a formula of the time t in seconds, or of another variable: ``"1.5*sin(2*pi*10*t) if t < 0.2 else 0"``.

    The syntax is Python's, but Python only parses and never runs it: any node of the tree that isn't on a list is
    refused. There are numbers, t, pi, ``+ - * / **``, sin, cos, tan, exp, log, sqrt, tanh, abs, min and max of two, and
    ``a if t < c else b`` with a constant c, in 500 characters at most. Angles are in radians. Parts that don't depend
    on t become one number.

    Raises
    ------
    ValueError
        The text is no formula; the message says where, and what works.
    """
    tree = parse_text(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and variable != "t":
            if node.id == "t":
                raise _refusal(node, f"there is no 't'; the formula's variable is {variable}")
            node.id = "t" if node.id == variable else node.id
    return TimeReader().formula(tree)


def parse_text(text: str) -> ast.expr:
    """Return the tree of a formula, its columns those of the text; raises as `parse_formula`."""
    if len(text) > LONGEST_FORMULA:
        raise ValueError(f"is longer than {LONGEST_FORMULA} characters; use a table")
    if not text.strip():
        raise ValueError(f"is empty; a formula is made of {_ALLOWED}")
    if match := _FOREIGN.search(text):
        power = "a power is written **, not ^"
        foreign = f"{match[0]!r} can't be in a formula; it is made of {_ALLOWED}"
        raise ValueError(f"at column {match.start() + 1}: {power if match[0] == '^' else foreign}")
    if match := _GLUED.search(text):
        raise ValueError(f"at column {match.start() + 1}: a number runs into a name; write 2*t, not 2t")
    line = text.translate(_BLANKS)
    indent = len(line) - len(line.lstrip())
    try:
        tree = ast.parse(line.strip(), mode="eval")
    except SyntaxError as error:
        raise ValueError(f"at column {indent + max(error.offset or 1, 1)}: {error.msg}") from None
    except (ValueError, RecursionError, MemoryError):
        raise ValueError(f"isn't a formula; it is made of {_ALLOWED}") from None
    for node in ast.walk(tree.body):
        if isinstance(node, ast.expr):
            node.col_offset += indent
    return tree.body


def read_guarded(reader: TimeReader, node: ast.expr) -> Part:
    """Read a tree, which must be neither too deep for Python nor for the stack of its program."""
    try:
        part = reader.read(node)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    if part.depth > MOST_DEPTH:
        raise ValueError(f"needs {part.depth} values at a time, {MOST_DEPTH} is the most; simplify or nest less")
    return part


class TimeReader:
    """Translates formulas of the time, and collects the times at which their conditions switch."""

    def __init__(self) -> None:
        self.breakpoints: set[float] = set()

    def formula(self, node: ast.expr) -> Formula:
        """Return the formula of a tree."""
        part = read_guarded(self, node)
        return Formula(part.codes, part.constants, tuple(sorted(self.breakpoints)))

    def read(self, node: ast.expr) -> Part:
        """Translate a node of Python's syntax tree and all below it."""
        match node:
            case ast.Constant(value=float() | int() as number) if not isinstance(number, bool):
                return _constant(node, lambda: float(number))
            case ast.Name(id="t"):
                return Part((TIME,), (), None, 1)
            case ast.Name(id=name) if name in _CONSTANTS:
                return _constant(node, lambda: _CONSTANTS[name])
            case ast.Name(id=name) if name in _FUNCTIONS:
                raise _refusal(node, f"{name} is a function; write {name}(...)")
            case ast.Name(id=name):
                raise _refusal(node, f"there is no {name!r}; a formula is made of {_ALLOWED}")
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.read(operand)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return _joined(node, NEGATE, lambda a: -a, self.read(operand))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                code, does = _OPERATORS[type(op)]
                return _joined(node, code, does, self.read(left), self.read(right))
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in _FUNCTIONS:
                code, count, does = _FUNCTIONS[name]
                if len(arguments) != count:
                    raise _refusal(node, f"{name} takes {count} value{'s' if count > 1 else ''}")
                return _joined(node, code, does, *(self.read(argument) for argument in arguments))
            case ast.Call(func=ast.Name(id=name)) if name not in _FUNCTIONS:
                raise _refusal(node, f"there is no function {name!r}; a formula is made of {_ALLOWED}")
            case ast.Compare():
                raise _refusal(node, "a comparison stands in 'a if t < c else b' only")
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return self.choose(test, self.read(body), self.read(orelse))
            case _:
                raise _refusal(node, f"this can't be in a formula; it is made of {_ALLOWED}")

    def choose(self, test: ast.expr, then: Part, other: Part) -> Part:
        """Translate ``then if t < c else other``, for the four comparisons of t with a constant."""
        match test:
            case ast.Compare(left=left, ops=[ast.Lt() | ast.LtE() | ast.Gt() | ast.GtE() as op], comparators=[right]):
                time, switch = TimeReader().read(left), TimeReader().read(right)
                before = isinstance(op, ast.Lt | ast.LtE)
                if time.value is not None:  # c < t
                    time, switch, before = switch, time, not before
                if time.codes != (TIME,) or switch.value is None:
                    raise _refusal(test, _CONDITION)
                # The later value begins at c itself for t < c and t >= c, and after it for t <= c and t > c.
                strict = isinstance(op, ast.Lt | ast.Gt) == before
                code = BEFORE if strict else UNTIL
                first, second = (then, other) if before else (other, then)
                self.breakpoints.add(switch.value)
                return Part(
                    second.codes + first.codes + switch.codes + (code,),
                    second.constants + first.constants + switch.constants,
                    None,
                    max(second.depth, 1 + first.depth, 3),
                )
            case _:
                raise _refusal(test, _CONDITION)


def _joined(node: ast.expr, code: int, does: Callable[..., float], *parts: Part) -> Part:
    """Append an operation to its operands; on constants alone it is done at once."""
    values = [part.value for part in parts]
    if None not in values:
        return _constant(node, lambda: does(*values))
    return Part(
        (*(c for part in parts for c in part.codes), code),
        tuple(c for part in parts for c in part.constants),
        None,
        max(number + part.depth for number, part in enumerate(parts)),
    )


def _constant(node: ast.expr, value: Callable[[], float]) -> Part:
    """Evaluate a part that doesn't depend on t."""
    try:
        number = float(value())
    except (ArithmeticError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise _refusal(node, "this constant has no finite value")
    return Part((CONSTANT,), (number,), number, 1)


def _refusal(node: ast.expr, why: str) -> ValueError:
    return ValueError(f"at column {node.col_offset + 1}: {why}")
