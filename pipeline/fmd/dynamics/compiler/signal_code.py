"""LLVM code of loads and motions: value, rate and acceleration of each signal at a time.

A program is run on truncated Taylor series as in `fmd.dynamics.signals.evaluate`, with what is constant folded.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fmd.core import formula as codes
from fmd.core.arrays import Array
from fmd.core.limits.code import FAR_ANGLE, MOST_PRODUCTS
from fmd.dynamics.compiler.writer import Writer, literal
from fmd.dynamics.signals.signal import CONSTANT, PROGRAM, Signal, Term

Value = str | float
"""A value's name, or the number that it always is."""

_LIBRARY = ("sin", "cos", "tan", "exp", "log", "tanh", "pow")


class Series(NamedTuple):
    """Value, first and second derivative."""

    value: Value
    rate: Value = 0.0
    acceleration: Value = 0.0

    @property
    def stands_still(self) -> bool:
        """True if it never changes."""
        return self.rate == 0.0 and self.acceleration == 0.0


def digest_signals(signals: Sequence[Signal]) -> str:
    """Return the digest of all that the code of signals depends on."""
    return hashlib.blake2b(repr([signal.terms for signal in signals]).encode(), digest_size=16).hexdigest()


def emit_signals(signals: Sequence[Signal]) -> str:
    """Write ``void signals(double *time, double *inputs)``, which fills three places for each signal."""
    functions: list[str] = []
    main = Writer()
    time = main.value("load double, ptr %time, align 8")
    tables: list[str] = []
    for k, signal in enumerate(signals):
        for place in range(3):
            first = sum(term.numbers[0] for term in signal.terms if term.kind == CONSTANT) if place == 0 else 0.0
            main.lines.append(f"store double {literal(float(first))}, ptr {_place(main, 3 * k + place)}, align 8")
        for term in signal.terms:
            if term.kind == CONSTANT:
                continue
            name = f"@term{len(functions)}"
            functions.append(_term_function(name, term, tables))
            _call_within(main, name, term.support, time, _place(main, 3 * k))
    lines = [
        *_HEADER,
        *(f"declare double @{name}({', '.join(['double'] * (2 if name == 'pow' else 1))})" for name in _LIBRARY),
        _turning_function(),
        *tables,
        *functions,
        "define void @signals(ptr noalias %time, ptr noalias %inputs) nounwind {",
        "entry:",
        *main.lines,
        "ret void",
        "}",
    ]
    return "\n".join(lines) + "\n"


_HEADER = ("declare double @llvm.fma.f64(double, double, double)", "declare double @llvm.sqrt.f64(double)")


def _place(out: Writer, place: int) -> str:
    return out.value(f"getelementptr double, ptr %inputs, i64 {place}")


def _call_within(out: Writer, name: str, support: tuple[float, float], time: str, place: str) -> None:
    """Call a term's function, which adds to three places, while the term acts."""
    call = f"call void {name}(double {time}, ptr {place})"
    if support == (-math.inf, math.inf):
        out.lines.append(call)
        return
    begun = out.value(f"fcmp oge double {time}, {literal(support[0])}")
    lasts = out.value(f"fcmp ole double {time}, {literal(support[1])}")
    label = name.removeprefix("@")
    out.lines += [
        f"br i1 {out.value(f'and i1 {begun}, {lasts}')}, label %{label}, label %after_{label}",
        f"{label}:",
        call,
        f"br label %after_{label}",
        f"after_{label}:",
    ]


def _term_function(name: str, term: Term, tables: list[str]) -> str:
    if term.kind == PROGRAM:
        out = _ProgramWriter()
        series = out.run(term)
        body = [*out.lines, *_additions(out, series)]
    else:
        body = _table_body(name.removeprefix("@"), term, tables)
    return "\n".join([f"define internal void {name}(double %t, ptr %out) noinline nounwind {{", "entry:", *body, "}"])


def _additions(out: Writer, series: Sequence[Value]) -> list[str]:
    out.lines = []
    for k, value in enumerate(series):
        place = out.value(f"getelementptr double, ptr %out, i64 {k}")
        total = out.value(f"fadd double {out.value(f'load double, ptr {place}, align 8')}, {_name(value)}")
        out.lines.append(f"store double {total}, ptr {place}, align 8")
    return [*out.lines, "ret void"]


def _turning_function() -> str:
    """Sine and cosine: by a short reduction, or the library's for large angles."""
    near = Writer()
    sine, cosine = near.sine_and_cosine("%x")
    return "\n".join(
        [
            "define internal void @turn(double %x, ptr %out) noinline nounwind {",
            f"%small = fcmp olt double %x, {literal(FAR_ANGLE)}",
            f"%large = fcmp ogt double %x, {literal(-FAR_ANGLE)}",
            "%near_zero = and i1 %small, %large",
            "%second = getelementptr double, ptr %out, i64 1",
            "br i1 %near_zero, label %near, label %far",
            "near:",
            *near.lines,
            f"store double {sine}, ptr %out, align 8",
            f"store double {cosine}, ptr %second, align 8",
            "ret void",
            "far:",
            "%sine = call double @sin(double %x)",
            "%cosine = call double @cos(double %x)",
            "store double %sine, ptr %out, align 8",
            "store double %cosine, ptr %second, align 8",
            "ret void",
            "}",
        ]
    )


def _name(value: Value) -> str:
    return literal(value) if isinstance(value, float) else value


class _ProgramWriter(Writer):
    """Writes a postfix program on Taylor series."""

    def run(self, term: Term) -> Series:
        stack: list[Series] = []
        numbers = iter(term.numbers)
        for code in term.codes:
            if code == codes.CONSTANT:
                stack.append(Series(float(next(numbers))))
            elif code == codes.TIME:
                stack.append(Series("%t", 1.0))
            elif code in (codes.BEFORE, codes.UNTIL):
                switch, before, after = stack.pop().value, stack.pop(), stack.pop()
                relation = "olt" if code == codes.BEFORE else "ole"
                is_before = self.value(f"fcmp {relation} double %t, {_name(switch)}")
                stack.append(self.choose(is_before, before, after))
            elif code == codes.NEGATE or codes.SIN <= code <= codes.ABS:
                stack.append(self.apply(code, stack.pop()))
            else:
                b, a = stack.pop(), stack.pop()
                stack.append(self.combine(code, a, b))
        return stack.pop()

    def add(self, a: Value, b: Value) -> Value:
        if isinstance(a, float) and isinstance(b, float):
            return a + b
        return b if a == 0.0 else a if b == 0.0 else self.value(f"fadd double {_name(a)}, {_name(b)}")

    def subtract(self, a: Value, b: Value) -> Value:
        if isinstance(a, float) and isinstance(b, float):
            return a - b
        return a if b == 0.0 else self.value(f"fsub double {_name(a)}, {_name(b)}")

    def multiply(self, a: Value, b: Value) -> Value:
        """Multiply; a derivative that is always 0 stays so."""
        if isinstance(a, float) and isinstance(b, float):
            return a * b
        if a == 0.0 or b == 0.0:
            return 0.0
        return b if a == 1.0 else a if b == 1.0 else self.value(f"fmul double {_name(a)}, {_name(b)}")

    def divide(self, a: Value, b: Value) -> Value:
        return 0.0 if a == 0.0 and b != 0.0 else self.value(f"fdiv double {_name(a)}, {_name(b)}")

    def select(self, condition: str, a: Value, b: Value) -> Value:
        return a if a == b else self.value(f"select i1 {condition}, double {_name(a)}, double {_name(b)}")

    def choose(self, condition: str, a: Series, b: Series) -> Series:
        return Series(*(self.select(condition, x, y) for x, y in zip(a, b, strict=True)))

    def call(self, function: str, *arguments: Value) -> str:
        return self.value(f"call double @{function}({', '.join(f'double {_name(x)}' for x in arguments)})")

    def chain(self, a: Series, f: Value, f1: Value, f2: Value) -> Series:
        """Return f of a series, ``f' = f₁ a'`` and ``f'' = f₂ a'² + f₁ a''``; of what stands still, 0."""
        if a.stands_still:
            return Series(f)
        square = self.multiply(a.rate, a.rate)
        rate = self.multiply(f1, a.rate)
        acceleration = self.add(self.multiply(f2, square), self.multiply(f1, a.acceleration))
        if isinstance(a.rate, float) and a.rate != 0.0:
            return Series(f, rate, acceleration)
        moves = self.value(
            f"or i1 {self.value(f'fcmp une double {_name(a.rate)}, {literal(0.0)}')}, "
            f"{self.value(f'fcmp une double {_name(a.acceleration)}, {literal(0.0)}')}"
        )
        return Series(f, self.select(moves, rate, a.rate), self.select(moves, acceleration, a.acceleration))

    def apply(self, code: int, a: Series) -> Series:
        x = a.value
        if code == codes.NEGATE:
            return Series(*(self.multiply(-1.0, part) for part in a))
        if code in (codes.SIN, codes.COS):
            sine, cosine = self.turn(x)
            f, f1 = (sine, cosine) if code == codes.SIN else (cosine, self.multiply(-1.0, sine))
            return self.chain(a, f, f1, self.multiply(-1.0, f))
        if code == codes.EXP:
            f = self.call("exp", x)
            return self.chain(a, f, f, f)
        if code in (codes.TAN, codes.TANH):
            sign, f = (1.0, self.call("tan", x)) if code == codes.TAN else (-1.0, self.call("tanh", x))
            f1 = self.add(1.0, self.multiply(sign, self.multiply(f, f)))
            return self.chain(a, f, f1, self.multiply(2.0 * sign, self.multiply(f, f1)))
        if code == codes.LOG:
            inverse = self.divide(1.0, x)
            return self.chain(a, self.logarithm(x), inverse, self.multiply(-1.0, self.multiply(inverse, inverse)))
        if code == codes.SQRT:
            f = self.value(f"call double @llvm.sqrt.f64(double {_name(x)})")
            return self.chain(a, f, self.divide(0.5, f), self.divide(-0.25, self.multiply(f, x)))
        rises = self.value(f"fcmp oge double {_name(x)}, {literal(0.0)}")
        sign_of = self.select(rises, 1.0, -1.0)
        return self.chain(a, self.multiply(sign_of, x), sign_of, 0.0)

    def turn(self, x: Value) -> tuple[str, str]:
        """Sine and cosine."""
        room = self.value("alloca [2 x double], align 8")
        self.lines.append(f"call void @turn(double {_name(x)}, ptr {room})")
        sine = self.value(f"load double, ptr {room}, align 8")
        second = self.value(f"getelementptr double, ptr {room}, i64 1")
        return sine, self.value(f"load double, ptr {second}, align 8")

    def logarithm(self, x: Value) -> Value:
        positive = self.value(f"fcmp ogt double {_name(x)}, {literal(0.0)}")
        return self.select(positive, self.call("log", x), math.nan)

    def combine(self, code: int, a: Series, b: Series) -> Series:
        if code in (codes.ADD, codes.SUBTRACT):
            operation = self.add if code == codes.ADD else self.subtract
            return Series(*(operation(x, y) for x, y in zip(a, b, strict=True)))
        if code == codes.MULTIPLY:
            between = self.multiply(2.0, self.multiply(a.rate, b.rate))
            outer = self.add(self.multiply(a.acceleration, b.value), self.multiply(a.value, b.acceleration))
            rate = self.add(self.multiply(a.rate, b.value), self.multiply(a.value, b.rate))
            return Series(self.product(a.value, b.value), rate, self.add(outer, between))
        if code == codes.DIVIDE:
            return self.quotient(a, b)
        if code == codes.POWER:
            return self.power(a, b)
        relation = "olt" if code == codes.MINIMUM else "ogt"
        nearer = self.value(f"fcmp {relation} double {_name(b.value)}, {_name(a.value)}")
        unknown = self.value(f"fcmp uno double {_name(b.value)}, {_name(b.value)}")
        return self.choose(self.value(f"or i1 {nearer}, {unknown}"), b, a)

    def product(self, a: Value, b: Value) -> Value:
        """Multiply values: 0 times what is not finite is not a number."""
        if isinstance(a, float) and isinstance(b, float):
            return a * b
        return self.value(f"fmul double {_name(a)}, {_name(b)}")

    def quotient(self, a: Series, b: Series) -> Series:
        value = self.value(f"fdiv double {_name(a.value)}, {_name(b.value)}")
        rate = self.divide(self.subtract(a.rate, self.multiply(value, b.rate)), b.value)
        twice = self.multiply(2.0, self.multiply(rate, b.rate))
        bend = self.subtract(self.subtract(a.acceleration, twice), self.multiply(value, b.acceleration))
        return Series(value, rate, self.divide(bend, b.value))

    def power(self, a: Series, b: Series) -> Series:
        """Raise to a power; a constant exponent needs no logarithm, so that the base may be 0 or negative."""
        x, n = a.value, b.value
        fixed = self.fixed_power(a, n)
        if b.stands_still:
            return fixed
        logarithm = self.logarithm(x)
        over = self.divide(a.rate, x)
        slope = self.add(self.multiply(b.rate, logarithm), self.multiply(n, over))
        curve = self.subtract(self.divide(a.acceleration, x), self.multiply(over, over))
        bend = self.add(self.multiply(2.0, self.multiply(b.rate, over)), self.multiply(n, curve))
        bend = self.add(self.multiply(b.acceleration, logarithm), bend)
        varying = Series(
            fixed.value,
            self.multiply(fixed.value, slope),
            self.multiply(fixed.value, self.add(self.multiply(slope, slope), bend)),
        )
        moves = self.value(
            f"or i1 {self.value(f'fcmp une double {_name(b.rate)}, {literal(0.0)}')}, "
            f"{self.value(f'fcmp une double {_name(b.acceleration)}, {literal(0.0)}')}"
        )
        return self.choose(moves, varying, fixed)

    def fixed_power(self, a: Series, n: Value) -> Series:
        x = a.value
        if isinstance(n, float):
            first = self.multiply(n, self.raised(x, n - 1.0)) if n != 0.0 else 0.0
            second = self.multiply(n * (n - 1.0), self.raised(x, n - 2.0)) if n not in (0.0, 1.0) else 0.0
            return self.chain(a, self.raised(x, n), first, second)
        less = self.add(n, -1.0)
        none = self.value(f"fcmp oeq double {n}, {literal(0.0)}")
        one = self.value(f"fcmp oeq double {n}, {literal(1.0)}")
        first = self.select(none, 0.0, self.multiply(n, self.call("pow", x, less)))
        bend = self.multiply(self.multiply(n, less), self.call("pow", x, self.add(n, -2.0)))
        second = self.select(self.value(f"or i1 {none}, {one}"), 0.0, bend)
        return self.chain(a, self.call("pow", x, n), first, second)

    def raised(self, x: Value, n: float) -> Value:
        """Raise to a constant: small whole powers as products."""
        if not (n == int(n) and 0.0 <= n <= MOST_PRODUCTS):
            return self.call("pow", x, n)
        value: Value = 1.0
        for _ in range(int(n)):
            value = self.multiply(value, x) if value != 1.0 else x
        return value


def _global(name: str, values: Array) -> str:
    entries = ", ".join(f"double {literal(float(x))}" for x in values.ravel())
    return f"{name} = private unnamed_addr constant [{values.size} x double] [{entries}], align 64"


def _table_body(name: str, term: Term, tables: list[str]) -> list[str]:
    """Find the piece by bisection and evaluate its cubic; the first value holds before the first knot."""
    knots, cubics = np.array(term.knots), np.array(term.cubics)
    tables += [_global(f"@knots_{name}", knots), _global(f"@cubics_{name}", cubics)]
    out = Writer()
    lines = [
        f"%early = fcmp olt double %t, {literal(float(knots[0]))}",
        "br i1 %early, label %before, label %search",
        "before:",
        "%first_value = load double, ptr %out, align 8",
        f"%held = fadd double %first_value, {literal(float(cubics[0, 0]))}",
        "store double %held, ptr %out, align 8",
        "ret void",
        "search:",
        "%low = phi i64 [0, %entry], [%new_low, %halve]",
        f"%high = phi i64 [{len(knots)}, %entry], [%new_high, %halve]",
        "%width = sub i64 %high, %low",
        "%wide = icmp sgt i64 %width, 1",
        "br i1 %wide, label %halve, label %piece",
        "halve:",
        "%sum = add i64 %low, %high",
        "%middle = lshr i64 %sum, 1",
        f"%at_knot = getelementptr double, ptr @knots_{name}, i64 %middle",
        "%knot = load double, ptr %at_knot, align 8",
        "%passed = fcmp ole double %knot, %t",
        "%new_low = select i1 %passed, i64 %middle, i64 %low",
        "%new_high = select i1 %passed, i64 %high, i64 %middle",
        "br label %search",
        "piece:",
        f"%at_first = getelementptr double, ptr @knots_{name}, i64 %low",
        "%begin = load double, ptr %at_first, align 8",
        "%x = fsub double %t, %begin",
        "%row = mul i64 %low, 4",
    ]
    c = []
    for k in range(4):
        out.lines += [f"%place{k} = add i64 %row, {k}"]
        address = out.value(f"getelementptr double, ptr @cubics_{name}, i64 %place{k}")
        c.append(out.value(f"load double, ptr {address}, align 8"))
    third = out.value(f"fmul double {c[3]}, %x")
    value = out.fma("%x", out.fma("%x", out.value(f"fadd double {c[2]}, {third}"), c[1]), c[0])
    twice, thrice = (out.value(f"fmul double {literal(factor)}, {x}") for factor, x in ((2.0, c[2]), (3.0, third)))
    rate = out.fma("%x", out.value(f"fadd double {twice}, {thrice}"), c[1])
    bend = out.fma(literal(6.0), third, twice)
    return [*lines, *out.lines, *_additions(out, (value, rate, bend))]
