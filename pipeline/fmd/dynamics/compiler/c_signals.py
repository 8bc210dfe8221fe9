"""C code of loads and motions: value, rate and acceleration of each signal at a time.

The code runs programs on truncated Taylor series, by functions ``series_…`` that its reader provides; they do what
those of `fmd.dynamics.signals.evaluate` do.
"""

from __future__ import annotations

from collections.abc import Sequence

from fmd.core import formula as codes
from fmd.dynamics.compiler.c_source import write_number
from fmd.dynamics.signals.signal import ALWAYS, CONSTANT, PROGRAM, Signal, Term

_OF_ONE = {
    codes.NEGATE: "negate",
    codes.SIN: "sin",
    codes.COS: "cos",
    codes.TAN: "tan",
    codes.EXP: "exp",
    codes.LOG: "log",
    codes.SQRT: "sqrt",
    codes.TANH: "tanh",
    codes.ABS: "abs",
}
_OF_TWO = {
    codes.ADD: "add",
    codes.SUBTRACT: "subtract",
    codes.MULTIPLY: "multiply",
    codes.DIVIDE: "divide",
    codes.POWER: "power",
    codes.MINIMUM: "minimum",
    codes.MAXIMUM: "maximum",
}


def write_c_signals(name: str, signals: Sequence[Signal]) -> str:
    """Write ``void name(double time, double *inputs)``, which fills three places for each signal."""
    tables: list[str] = []
    body = []
    for k, signal in enumerate(signals):
        first = sum(term.numbers[0] for term in signal.terms if term.kind == CONSTANT)
        body.append(f"s = series_number({write_number(float(first))});")
        for term in signal.terms:
            if term.kind == CONSTANT:
                continue
            addition = f"s = series_add(s, {_term(term, tables)});"
            if term.support != ALWAYS:
                low, high = (write_number(bound) for bound in term.support)
                addition = f"if (time >= {low} && time <= {high}) {addition}"
            body.append(addition)
        body.append(f"inputs[{3 * k}] = s.f; inputs[{3 * k + 1}] = s.d; inputs[{3 * k + 2}] = s.dd;")
    lines = [
        *tables,
        f"void {name}(double time, double *inputs)",
        "{",
        *(["    Series s;"] if body else ["    (void)time; (void)inputs;"]),
        *(f"    {line}" for line in body),
        "}",
    ]
    return "\n".join(lines) + "\n"


def _term(term: Term, tables: list[str]) -> str:
    return _program(term) if term.kind == PROGRAM else _table(term, tables)


def _program(term: Term) -> str:
    stack: list[str] = []
    numbers = iter(term.numbers)
    for code in term.codes:
        if code == codes.CONSTANT:
            stack.append(f"series_number({write_number(next(numbers))})")
        elif code == codes.TIME:
            stack.append("series_time(time)")
        elif code in (codes.BEFORE, codes.UNTIL):
            switch, before, after = stack.pop(), stack.pop(), stack.pop()
            relation = "before" if code == codes.BEFORE else "until"
            stack.append(f"series_{relation}(time, {switch}.f, {before}, {after})")
        elif code in _OF_ONE:
            stack.append(f"series_{_OF_ONE[code]}({stack.pop()})")
        else:
            b, a = stack.pop(), stack.pop()
            stack.append(f"series_{_OF_TWO[code]}({a}, {b})")
    return stack.pop()


def _table(term: Term, tables: list[str]) -> str:
    number = len(tables) // 2
    knots = ", ".join(write_number(x) for x in term.knots)
    cubics = ", ".join("{" + ", ".join(write_number(x) for x in row) + "}" for row in term.cubics)
    tables.append(f"static const double knots{number}[] = {{{knots}}};")
    tables.append(f"static const double cubics{number}[][4] = {{{cubics}}};")
    return f"series_table(time, {len(term.knots)}, knots{number}, cubics{number})"
