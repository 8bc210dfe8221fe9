"""Formulas of time: Python's own meaning where it is one, a message with its place where it isn't, and nothing run."""

import ast
import math
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmd.core import formula as code
from fmd.core.formula import Formula, parse_formula
from fmd.core.limits.scene import MOST_DEPTH

NAMES = {name: getattr(math, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh", "pi")}
NAMES |= {"abs": abs, "min": min, "max": max}
UNARY = {
    code.NEGATE: lambda a: -a,
    code.SIN: math.sin,
    code.COS: math.cos,
    code.TAN: math.tan,
    code.EXP: math.exp,
    code.LOG: math.log,
    code.SQRT: math.sqrt,
    code.TANH: math.tanh,
    code.ABS: abs,
}
BINARY = {
    code.ADD: lambda a, b: a + b,
    code.SUBTRACT: lambda a, b: a - b,
    code.MULTIPLY: lambda a, b: a * b,
    code.DIVIDE: lambda a, b: a / b,
    code.POWER: lambda a, b: a**b,
    code.MINIMUM: min,
    code.MAXIMUM: max,
}


def by_python(text: str, t: float) -> float:
    """What Python makes of a formula of ours: the meaning that `parse_formula` promises."""
    return eval(text, {"__builtins__": {}}, {"t": t, **NAMES})


def run(formula: Formula, t: float) -> float:
    """Run a program as its codes are described, on a stack of floats that may not grow beyond what is promised."""
    stack: list[float] = []
    constants = iter(formula.constants)
    for op in formula.codes:
        if op == code.CONSTANT:
            stack.append(next(constants))
        elif op == code.TIME:
            stack.append(t)
        elif op in UNARY:
            stack.append(UNARY[op](stack.pop()))
        elif op in BINARY:
            b, a = stack.pop(), stack.pop()
            stack.append(BINARY[op](a, b))
        else:
            switch, before, later = stack.pop(), stack.pop(), stack.pop()
            is_before = t < switch if op == code.BEFORE else t <= switch
            stack.append(before if is_before else later)
        assert len(stack) <= MOST_DEPTH
    assert next(constants, None) is None
    (result,) = stack
    return result


def combined(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    """Formulas made of formulas; every function stays where it is defined, and its argument small."""
    one = ["-{}", "+{}", "sin({})", "cos({})", "tan(sin({}))", "exp(sin({}))", "log(1 + abs({}))", "sqrt(abs({}))"]
    one += ["tanh({})", "abs({})", "sin({})**2", "cos({})**3", "({})", "2**-cos({})"]
    two = ["({} + {})", "({} - {})", "{}*({})", "({})/(1.5 + sin({}))", "min({}, {})", "max({}, {})"]
    two += ["(2 + sin({}))**cos({})"]
    two += [f"({{}} if {test} else {{}})" for test in ("t < .5", "t <= -1/4", "t > 2*(0.1 + .4)", "0.5 >= t", "pi<t")]
    return st.one_of(
        st.builds(str.format, st.sampled_from(one), inner),
        st.builds(str.format, st.sampled_from(two), inner, inner),
    )


FORMULAS = st.recursive(
    st.sampled_from(["t", "t", "pi", "2", "0.5", ".75", "3.", "1e-1", "2.5E+0"]), combined, max_leaves=9
)
TIMES = st.one_of(st.sampled_from([-0.25, 0.0, 0.5, 1.0]), st.floats(-4.0, 4.0))


@given(FORMULAS, TIMES)
def test_a_formula_means_what_it_means_in_python(text: str, t: float) -> None:
    if len(text) <= 500:
        assert run(parse_formula(text), t) == pytest.approx(by_python(text, t), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "1.5*sin(2*pi*10*t)*exp(-t/0.2)",
        "(6/15)*(t**2/2 + (15/(2*pi))**2*(cos(2*pi*t/15) - 1)) if t < 15 else 6*t - 45",
        "-t**2",
        "2**3**-t",
        "2**-t",
        "10 - t - 3",
        "12/t/3",
        "-2*-t",
        "\n  3*t\n  + 1\t",
        "(sin)(t)",
    ],
)
@pytest.mark.parametrize("t", [0.3, 2.0, 15.0, 20.0])
def test_precedence_and_layout_are_those_of_python(text: str, t: float) -> None:
    assert run(parse_formula(text), t) == pytest.approx(by_python(text.strip().replace("\n", " "), t), rel=1e-14)


@pytest.mark.parametrize("comparison", ["t < 0.5", "t <= 0.5", "t > 0.5", "t >= 0.5"])
@pytest.mark.parametrize("swapped", [False, True])
def test_each_comparison_switches_on_the_side_that_it_says(comparison: str, swapped: bool) -> None:
    t, sign, switch = comparison.split()
    mirror = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
    text = f"1 if {f'{switch} {mirror[sign]} {t}' if swapped else comparison} else 2"
    assert parse_formula(text).breakpoints == (0.5,)
    for at in (math.nextafter(0.5, 0.0), 0.5, math.nextafter(0.5, 1.0)):
        assert run(parse_formula(text), at) == by_python(f"1 if {comparison} else 2", at)


def test_breakpoints_of_chained_and_nested_conditions_ascend_without_repeats() -> None:
    text = "(1 if t > 3 else t) if t < 1/4 else 2 if t <= 2*pi else (t if t >= 0.25 else 5)"
    assert parse_formula(text).breakpoints == (0.25, 3.0, 2 * math.pi)
    assert parse_formula("1 if t < 8 else 2 if t < 32 else 3 if t < 1 else 4").breakpoints == (1.0, 8.0, 32.0)


def test_kinks_of_abs_min_and_max_are_not_looked_for() -> None:
    assert parse_formula("abs(t - 1) + min(t, 2) + max(t, 3)").breakpoints == ()


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2*3 + 4**0.5 - 6/4", 6.5),
        ("-(sqrt(16) - max(1, 2))", -2.0),
        ("cos(0) + abs(-3) + min(4, 5) + log(1) + tanh(0) + tan(0) + sin(0) + exp(0)", 9.0),
        ("+7", 7.0),
        ("2*pi", math.tau),
    ],
)
def test_what_does_not_depend_on_time_is_one_number(text: str, value: float) -> None:
    assert parse_formula(text) == Formula((code.CONSTANT,), (value,), ())
    assert parse_formula(f"t*({text})") == Formula((code.TIME, code.CONSTANT, code.MULTIPLY), (value,), ())


def test_an_expression_can_be_compared_and_hashed() -> None:
    assert parse_formula("2*t") == parse_formula("2 * t")
    assert len({parse_formula("2*t"), parse_formula(" 2.0*t"), parse_formula("t*2")}) == 2


def nested(depth: int) -> str:
    return "t+(" * (depth - 1) + "t" + ")" * (depth - 1)


def test_a_formula_that_fills_the_stack_runs_and_a_deeper_one_is_refused() -> None:
    assert run(parse_formula(nested(MOST_DEPTH)), 0.5) == MOST_DEPTH / 2
    with pytest.raises(ValueError, match=r"^needs 17 values at a time, 16 is the most; simplify or nest less$"):
        parse_formula(nested(MOST_DEPTH + 1))


def test_branches_and_the_time_of_their_switch_count_for_the_stack() -> None:
    text = "t+(" * (MOST_DEPTH - 3) + "1 if t < 1 else 2" + ")" * (MOST_DEPTH - 3)
    assert run(parse_formula(text), 0.5) == 0.5 * (MOST_DEPTH - 3) + 1
    with pytest.raises(ValueError, match=r"^needs 17 values"):
        parse_formula(f"t+({text})")


@pytest.mark.parametrize("sign", ["<", "<=", ">", ">="])
def test_what_holds_before_a_switch_lies_on_what_holds_later(sign: str) -> None:
    fits, deeper = nested(MOST_DEPTH - 1), nested(MOST_DEPTH)
    for t in (0.5, 1.5):
        text = f"{fits} if t {sign} 1 else {fits}"
        assert run(parse_formula(text), t) == by_python(text, t)
        text = f"({deeper}) if t {sign} 1 else t" if sign in (">", ">=") else f"t if t {sign} 1 else ({deeper})"
        assert run(parse_formula(text), t) == by_python(text, t)
    refused = f"t if t {sign} 1 else ({deeper})" if sign in (">", ">=") else f"({deeper}) if t {sign} 1 else t"
    with pytest.raises(ValueError, match=r"^needs 17 values"):
        parse_formula(refused)


def test_a_long_sum_is_no_deep_one() -> None:
    assert run(parse_formula("+".join(["t"] * 250)), 2.0) == 500.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        # what a user may get wrong
        ("", "is empty; a formula is made of t, pi, numbers"),
        (" \n", "is empty"),
        ("t + foo", "at column 5: there is no 'foo'; a formula is made of t, pi, numbers"),
        ("  t + foo", "at column 7: there is no 'foo'"),
        ("(\n1+foo)", "at column 5: there is no 'foo'"),
        ("T", "at column 1: there is no 'T'"),
        ("1 + asin(t)", "at column 5: there is no function 'asin'; a formula is made of"),
        ("t*sin", "at column 3: sin is a function; write sin(...)"),
        ("sin()", "at column 1: sin takes 1 value"),
        ("sin(t, t)", "at column 1: sin takes 1 value"),
        ("t + max(t)", "at column 5: max takes 2 values"),
        ("min(t, 1, 2)", "at column 1: min takes 2 values"),
        ("3*t^2", "at column 4: a power is written **, not ^"),
        ("1 + 2t", "at column 5: a number runs into a name; write 2*t, not 2t"),
        ("2pi*t", "at column 1: a number runs into a name"),
        ("1if t<1 else 2", "at column 1: a number runs into a name"),
        ("1 if t<.5else 2", "at column 8: a number runs into a name"),
        ("t*1e", "at column 3: a number runs into a name"),
        ("t*1.5e3x", "at column 3: a number runs into a name"),
        ("t*0x1f", "at column 3: a number runs into a name"),
        ("t*1_000", "at column 3: a number runs into a name"),
        ("t + 2j", "at column 5: a number runs into a name"),
        ("1 +* t", "at column 4: invalid syntax"),
        ("   1 +* t", "at column 7: invalid syntax"),
        ("(t", "at column 1: "),
        ("1 if t < 1", "at column 1: "),
        ("t < 1", "at column 1: a comparison stands in 'a if t < c else b' only"),
        ("1 if t else 2", "at column 6: a condition compares t with a constant, e.g. t < 0.5"),
        ("1 if t == 1 else 2", "at column 6: a condition compares t with a constant"),
        ("1 if 0 < t < 1 else 2", "for two of them write one 'if' into the other"),
        ("1 if t > 0 and t < 1 else 2", "for two of them write one 'if' into the other"),
        ("1 if 2*t < 1 else 2", "at column 6: a condition compares t with a constant"),
        ("1 if t < t else 2", "at column 6: a condition compares t with a constant"),
        ("1 if 1 < 2 else 2", "at column 6: a condition compares t with a constant"),
        ("1 if 1 < sin(t) else 2", "at column 6: a condition compares t with a constant"),
        ("1 if t < foo else 2", "at column 10: there is no 'foo'"),
        ("t + 1/0", "at column 5: this constant has no finite value"),
        ("t + log(0)", "at column 5: this constant has no finite value"),
        ("sqrt(-1)", "at column 1: this constant has no finite value"),
        ("(-8)**(1/3)", "at column 1: this constant has no finite value"),
        ("t if t < 1e400 else 1", "at column 10: this constant has no finite value"),
        ("t//2", "at column 1: this can't be in a formula; it is made of"),
        # numbers beyond all bounds
        ("9**9**9**9", "at column 4: this constant has no finite value"),
        ("exp(exp(exp(exp(9))))", "this constant has no finite value"),
        ("1e999", "at column 1: this constant has no finite value"),
        ("9" * 400, "at column 1: this constant has no finite value"),
        ("t*" + "t*" * 250, "is longer than 500 characters; use a table"),
        ("(" * 300, "at column 201: too many nested parentheses"),
    ],
)
def test_a_fault_is_told_with_its_place_and_what_works(text: str, message: str) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - the whole message is looked at
        parse_formula(text)
    assert message in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    "text",
    [
        *("t.real", "t.__class__", "sin.__self__", "(1.).real", "sin.__call__(t)", "print(t)", "exit()", "eval(t)"),
        *("__import__(t)", "open(t)", "sin(t)(t)", "sin(*t)", "sin(**t)", "sin(t=t)", "max(t, *t)", "sin(t, x=t)"),
        *("(t, t)", "()", "t,", "...", "True", "None", "not t", "t and t", "t or t", "t is t", "t in t"),
        *("1 if t is 1 else 2", "1 if t in t else 2", "1 if t != 1 else 2", "1 if True < t else 2", "True + t"),
        *("(t for t in t)", "sin(t for t in t)", "(yield)", "(yield t)", "await t", "t = 1", "import os", "t >> 1"),
        *("__debug__", "__builtins__", "t % 2", "t @ t", "~t", "t | 1", "t & 1", "t << 1"),
        *("lambda t: t", "(lambda: t)()", "(t := 1)", "[t]", "t[0]", "t[:]", "{t}", "{t: t}", "[t for t in t]"),
        *("'t'", '"t"', "f'{t}'", "b't'", "'t'*9", "t # comment", "t; t", "`t`", "$t", "t?", "t!", "t\\\n+1"),
        # another t, digit, sin, minus, blank, parenthesis; bytes that mean something to a parser or to a terminal
        *(
            "\uff54",
            "\uff12*t",
            "\u017fin(t)",
            "\U0001d601",
            "\u2212t",
            "t\u00a0+ 1",
            "t\u200b",
            "\uff08t\uff09",
            "π*t",
        ),
        *("t\x00", "\x00", "t\x0c+1", "t\x1b[31m", "\ufefft", "\u202et", "\ud800", "t\x85", "t\u2028+1"),
    ],
)
def test_whatever_is_no_formula_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"^at column \d+: .{10}") as caught:
        parse_formula(text)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "call",
    [
        "__import__('os').mkdir('made')",
        "(lambda: __import__('os').mkdir('made'))()",
        "[__import__('os').mkdir('made') for _ in [0]]",
        "f'{__import__(chr(111) + chr(115)).mkdir(chr(109))}'",
        "t if __import__('os').mkdir('made') else t",
        "sin(__import__('os').mkdir('made'))",
        "(x := __import__('os').mkdir('made'))",
        "eval(\"__import__('os').mkdir('made')\")",
    ],
)
def test_nothing_in_a_formula_is_run(call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="can't be in a formula"):
        parse_formula(call)
    assert list(tmp_path.iterdir()) == []
    eval(call, {"t": 0.0, "sin": lambda x: x})  # the attack is a real one
    assert len(list(tmp_path.iterdir())) == 1


WORDS = ["t", "pi", "sin", "max", "(", ")", "((", "))", "**", "*", "-", "+", "/", ",", " ", "if", " if ", " else ", "<"]
WORDS += [
    "<=",
    ">",
    "=",
    "1",
    ".",
    "1e9",
    "9**9",
    "_",
    "lambda ",
    "not ",
    "0x",
    "e",
    "j",
    "\n",
    "\t",
    "for t in",
    "[",
    "'",
]


@settings(max_examples=25)
@given(st.one_of(st.lists(st.sampled_from(WORDS), max_size=60).map("".join), st.text(max_size=60)))
def test_any_text_is_a_formula_or_a_fault(text: str) -> None:
    found = parse_formula("0")
    with suppress(ValueError):
        found = parse_formula(text)
    assert all(math.isfinite(c) for c in (*found.constants, *found.breakpoints))


@pytest.mark.parametrize("opening", ["-", "sin(", "t**", "t+(", "1 if t<1 else ", "(t)if t<(", "2**-"])
def test_as_much_nesting_as_there_is_room_for_is_a_formula_or_a_fault(opening: str) -> None:
    count = 499 // (len(opening) + opening.count("("))
    text = opening * count + "t" + ")" * (opening.count("(") * count)
    found = parse_formula("0")
    with suppress(ValueError):
        found = parse_formula(text)
    assert math.isfinite(run(found, 0.5))


def test_a_stack_of_calls_that_is_nearly_full_is_no_crash() -> None:
    def from_below(frames: int) -> Formula:
        return parse_formula("-" * 450 + "t") if frames == 0 else from_below(frames - 1)

    used = 0
    frame = sys._getframe()
    while frame := frame.f_back:
        used += 1
    with pytest.raises(ValueError, match=r"is nested too deeply|isn't a formula"):
        from_below(sys.getrecursionlimit() - used - 200)


@pytest.mark.parametrize("error", [MemoryError, RecursionError, ValueError])
def test_a_parser_that_gives_up_is_a_fault(error: type[Exception], monkeypatch: pytest.MonkeyPatch) -> None:
    def give_up(*_: object, **__: object) -> None:
        raise error

    with monkeypatch.context() as patched:
        patched.setattr(ast, "parse", give_up)
        with pytest.raises(ValueError, match=r"^isn't a formula; it is made of t, pi"):
            parse_formula("t + 0.123")  # which nothing has parsed before


def test_reading_a_formula_loads_nothing_heavy() -> None:
    script = "import sys; from fmd.core.formula import parse_formula; parse_formula('2*t'); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)
    assert "fmd.core.formula" in done.stdout.split()
    assert not {"llvmlite", "numpy", "scipy", "pydantic", "pint"} & set(done.stdout.split())
