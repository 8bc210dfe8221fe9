"""Arithmetic and comparisons of kernels.

Integers have 64 bits and wrap around; their quotient is rounded down as in Python, and 0 where they are divided by 0.
Doubles follow IEEE 754 where Python would raise: 1/0 is infinite, and the root of −1 not a number. A number in
arithmetic with a vector stands for all of its entries.
"""

import ast
import operator
from collections.abc import Sequence

from fmd.core.limits.code import MOST_FACTORS
from fmd.kernels.types import REAL, TRUTH, WHOLE, Type, name_of, width_of
from fmd.kernels.writer import BlockWriter, NotInSubset, Value, real, whole

_NAMES: dict[type[ast.operator], str] = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
_FOLDED = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul}

COMPARISONS: dict[type[ast.cmpop], str] = {
    ast.Lt: "lt",
    ast.LtE: "le",
    ast.Gt: "gt",
    ast.GtE: "ge",
    ast.Eq: "eq",
    ast.NotEq: "ne",
}
_FOLDED_COMPARISONS = {name: getattr(operator, name) for name in COMPARISONS.values()}


def common_type(one: Type, other: Type) -> Type:
    """Return the type that holds values of both types."""
    if one == other:
        return one
    if {one, other} <= {REAL, WHOLE, TRUTH}:
        return REAL if REAL in (one, other) else WHOLE
    for vector, number in ((one, other), (other, one)):
        if width_of(vector) and number in (REAL, WHOLE):
            return vector
    raise NotInSubset(f"{name_of(one)} and {name_of(other)} have no common type")


def convert(w: BlockWriter, x: Value, kind: Type) -> Value:
    """Return a value as one of another type; an integer and a truth are numbers, but a double is no integer."""
    if x.type == kind:
        return x
    if x.type == TRUTH and kind in (WHOLE, REAL):
        number = whole(x.known) if x.known is not None else w.value(WHOLE, f"zext i1 {x.text} to i64")
        return convert(w, number, kind)
    if x.type == WHOLE and kind == REAL:
        return real(float(x.known)) if x.known is not None else w.value(REAL, f"sitofp i64 {x.text} to double")
    if (width := width_of(kind)) and x.type in (REAL, WHOLE):
        one = w.value(kind, f"insertelement {kind} poison, double {convert(w, x, REAL).text}, i32 0")
        return w.value(kind, f"shufflevector {kind} {one.text}, {kind} poison, <{width} x i32> zeroinitializer")
    raise NotInSubset(f"{name_of(x.type)} where there was {name_of(kind)}")


def truth(w: BlockWriter, x: Value) -> Value:
    """Return whether a number isn't 0."""
    return x if x.type == TRUTH else compare(w, "ne", x, whole(0))


def compare(w: BlockWriter, name: str, x: Value, y: Value) -> Value:
    """Compare two numbers; nothing but "ne" is true of what is not a number."""
    if x.known is not None and y.known is not None:
        return Value(TRUTH, str(_FOLDED_COMPARISONS[name](x.known, y.known)).lower())
    kind = WHOLE if common_type(x.type, y.type) in (WHOLE, TRUTH) else REAL
    x, y = convert(w, x, kind), convert(w, y, kind)
    if kind == REAL:
        return w.value(TRUTH, f"fcmp {'une' if name == 'ne' else 'o' + name} double {x.text}, {y.text}")
    return w.value(TRUTH, f"icmp {name if name in ('eq', 'ne') else 's' + name} i64 {x.text}, {y.text}")


def all_of(w: BlockWriter, tests: Sequence[Value]) -> Value:
    """Return whether all of some truths are."""
    result = tests[0]
    for test in tests[1:]:
        result = w.value(TRUTH, f"and i1 {result.text}, {test.text}")
    return result


def negate(w: BlockWriter, x: Value) -> Value:
    """Return a number with the other sign."""
    if x.type in (WHOLE, TRUTH):
        return compute(w, ast.Sub(), whole(0), x)
    return w.value(x.type, f"fneg{w.flags} {x.type} {x.text}")


def compute(w: BlockWriter, op: ast.operator, x: Value, y: Value) -> Value:
    """Return ``x op y`` of numbers or vectors."""
    kind = common_type(x.type, y.type)
    if isinstance(op, ast.Pow):
        return _power(w, x, y)
    if kind == TRUTH or isinstance(op, ast.Div):
        kind = WHOLE if not isinstance(op, ast.Div) else REAL if kind in (WHOLE, TRUTH) else kind
    if not isinstance(kind, str):
        raise NotInSubset(f"arithmetic with {name_of(x.type)} and {name_of(y.type)}")
    x, y = convert(w, x, kind), convert(w, y, kind)
    if isinstance(op, ast.Div):
        return w.value(kind, f"fdiv{w.flags} {kind} {x.text}, {y.text}")
    if kind == WHOLE and isinstance(op, ast.FloorDiv | ast.Mod):
        return _floored(w, x, y, isinstance(op, ast.Mod))
    if (name := _NAMES.get(type(op))) is None:
        raise NotInSubset(f"{type(op).__name__} of {name_of(x.type)} and {name_of(y.type)}")
    if x.known is not None and y.known is not None:
        return whole(_FOLDED[type(op)](x.known, y.known))
    return w.value(
        kind, f"{name} i64 {x.text}, {y.text}" if kind == WHOLE else f"f{name}{w.flags} {kind} {x.text}, {y.text}"
    )


def _power(w: BlockWriter, x: Value, y: Value) -> Value:
    """Return a power: products of squares for a small known exponent, else that of the C library."""
    if y.known is not None and y.type == WHOLE and 1 <= y.known <= MOST_FACTORS:
        rest, square, result = y.known, x, None
        while rest:
            if rest % 2:
                result = square if result is None else compute(w, ast.Mult(), result, square)
            rest //= 2
            square = compute(w, ast.Mult(), square, square) if rest else square
        assert result is not None
        return result
    if REAL not in (x.type, y.type):
        raise NotInSubset(f"integers have powers with exponents of 1 … {MOST_FACTORS} alone")
    x, y = convert(w, x, REAL), convert(w, y, REAL)
    return w.value(REAL, f"call double @pow(double {x.text}, double {y.text})")


def _floored(w: BlockWriter, x: Value, y: Value, rest: bool) -> Value:
    """Return the quotient of integers rounded down, or what it leaves; 0 where y is.

    LLVM's division stops the process where y is 0, and where it is −1 and the quotient has no 64 bits.
    """
    zero, minus = compare(w, "eq", y, whole(0)), compare(w, "eq", y, whole(-1))
    special = w.value(TRUTH, f"or i1 {zero.text}, {minus.text}")
    divisor = y if y.known not in (None, 0, -1) else w.value(WHOLE, f"select i1 {special.text}, i64 1, i64 {y.text}")
    quotient = w.value(WHOLE, f"sdiv i64 {x.text}, {divisor.text}")
    left = compute(w, ast.Sub(), x, compute(w, ast.Mult(), quotient, divisor))
    apart = compare(w, "lt", w.value(WHOLE, f"xor i64 {left.text}, {divisor.text}"), whole(0))
    down = w.value(TRUTH, f"and i1 {apart.text}, {compare(w, 'ne', left, whole(0)).text}")
    if rest:
        more = w.value(WHOLE, f"select i1 {down.text}, i64 {divisor.text}, i64 0")
        return compute(w, ast.Add(), left, more)  # 0 for both special divisors, since 1 stands in their place
    lower = compute(w, ast.Sub(), quotient, convert(w, down, WHOLE))
    lower = w.value(WHOLE, f"select i1 {minus.text}, i64 {negate(w, x).text}, i64 {lower.text}")
    return w.value(WHOLE, f"select i1 {zero.text}, i64 0, i64 {lower.text}")
