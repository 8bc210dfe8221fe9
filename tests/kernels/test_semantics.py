"""Compiled functions do what Python does with them: random expressions, and each rule on its edges."""

from __future__ import annotations

import importlib.util
import math
import random
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmd.kernels.kernel import inner, kernel

LARGEST = 2**63 - 1
WHOLE = st.one_of(st.integers(-9, 9), st.integers(-LARGEST - 1, LARGEST))
REAL = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.sampled_from([0.0, -0.0, 1.0, math.nan, math.inf]))


def wrapped(x: int) -> int:
    """Return an integer in two's complement of 64 bits."""
    return (x + 2**63) % 2**64 - 2**63


def same(x: Any, y: Any) -> bool:
    return type(x) is type(y) and (x == y or (math.isnan(x) and math.isnan(y)))


@kernel
def quotient(x, y):
    return x // y


@kernel
def remainder(x, y):
    return x % y


@kernel
def add(x, y):
    return x + y


@kernel
def multiply(x, y):
    return x * y - 3 * x


@kernel
def smaller(x, y):
    return min(x, y, 1.5)


@kernel
def larger(x, y):
    return max(x, y)


@kernel
def ordered(x, y):
    return (
        (1 if x < y else 0) + (2 if x <= y else 0) + (4 if x == y else 0) + (8 if x != y else 0) + (16 if x > y else 0)
    )


@kernel
def cut(x):
    return int(x)


@kernel
def power(x):
    return x**5 + 2.0**x


@given(WHOLE, WHOLE)
def test_integers_are_divided_as_in_python_and_wrap_around(x: int, y: int) -> None:
    assert quotient(x, y) == (wrapped(x // y) if y else 0)
    assert remainder(x, y) == (x % y if y else 0)
    assert add(x, y) == wrapped(x + y)
    assert multiply(x, y) == wrapped(x * y - 3 * x)
    assert ordered(x, y) == ordered.python(x, y)  # type: ignore[attr-defined]
    assert larger(x, y) == max(x, y)


@given(REAL, REAL)
def test_the_first_of_two_stays_where_one_is_not_a_number(x: float, y: float) -> None:
    assert same(larger(x, y), max(x, y))
    assert same(smaller(x, y), min(x, y, 1.5))
    assert ordered(x, y) == ordered.python(x, y)  # type: ignore[attr-defined]
    with np.errstate(all="ignore"):
        assert same(add(x, y), float(np.float64(x) + y))


@given(st.integers(-(2**52), 2**52), REAL)
def test_integers_beside_doubles_are_doubles(x: int, y: float) -> None:
    assert same(larger(x, y), float(max(x, y)))
    assert same(add(x, y), x + y)
    assert ordered(x, y) == ordered.python(x, y)  # type: ignore[attr-defined]


@given(REAL)
def test_a_double_is_cut_towards_0_and_kept_within_64_bits(x: float) -> None:
    expected = 0 if math.isnan(x) else min(max(x, -(2.0**63)), 2.0**63)
    assert cut(x) == min(int(expected), LARGEST)


@pytest.mark.parametrize("x", [0, 1, -2, 7])
def test_powers_are_those_of_python(x: int) -> None:
    assert power(x) == power.python(x)  # type: ignore[attr-defined]
    assert power(0.7 * x) == pytest.approx(power.python(0.7 * x), rel=1e-15)  # type: ignore[attr-defined]


@kernel
def where_ieee_knows_more(x):
    return 1.0 / x + math.sqrt(x) + math.log(x)


def test_what_python_refuses_follows_ieee_754() -> None:
    assert math.isnan(where_ieee_knows_more(-1.0))
    assert math.isnan(where_ieee_knows_more(0.0))  # ∞ + 0 − ∞


@inner
def both(x, n):
    return x * n, n + 1


@kernel
def loops(x, n):
    """Take every statement that there is."""
    total, last, k = 0.0, x[-1], 0
    for i in range(n - 1, -1, -2):
        if i == 2:
            continue
        if (x[i] > 0.9 and i < n - 1) or not x[i] > -5.0:
            break
        total += x[i] if i % 2 else -(x[i] ** 2)
        k = i
    while True:
        k += 1
        if k >= n:
            break
        row = x[k:]
        product, m = both(row[0], len(row))
        total += product / m
    low, high = (last, total) if last < total else (total, last)
    return high - low + (0.0 < low < high) + k


@given(st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=12))
def test_loops_and_branches_go_as_in_python(x: list[float]) -> None:
    entries = np.array(x)
    assert loops(entries, len(x)) == pytest.approx(loops.python(entries, len(x)), rel=1e-14)  # type: ignore[attr-defined]


class Random:
    """Writes a random function of two doubles, two integers and an array, in the subset of kernels."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.reals, self.wholes = ["a", "b"], ["i", "j"]

    def real(self, depth: int) -> str:
        pick = self.random.choice
        if depth == 0:
            return pick([*self.reals, "1.5", "-0.25", "x[2]", "x[-1]"])
        one, other, test = self.real(depth - 1), self.real(depth - 1), self.test(depth - 1)
        forms = [f"({one} {pick('+-*')} {other})", f"({one} / (2.5 + abs({other})))", f"min({one}, {other})"]
        forms += [f"max({one}, {self.whole(depth - 1)})", f"({one} if {test} else {other})", f"math.sin({one})"]
        forms += [f"({one} * {self.whole(depth - 1)})", f"x[{self.whole(depth - 1)} % 5]", f"-{one}"]
        return pick(forms)

    def whole(self, depth: int) -> str:
        pick = self.random.choice
        if depth == 0:
            return pick([*self.wholes, "3", "-7", "len(x)", "x.shape[0]"])
        one, other = self.whole(depth - 1), self.whole(depth - 1)
        forms = [f"({one} {pick('+-')} {other})", f"({one} // (1 + abs({other})))", f"({one} % -(1 + abs({other})))"]
        forms += [
            f"(({one} % 1000) * ({other} % 1000))",
            f"max({one}, {other})",
            f"({one} if {self.test(depth - 1)} else {other})",
        ]
        return pick([*forms, f"int(100 * math.sin({self.real(depth - 1)}))"])

    def test(self, depth: int) -> str:
        pick, kind = self.random.choice, self.random.choice([self.real, self.whole])
        one, other = kind(max(depth - 1, 0)), kind(max(depth - 1, 0))
        plain = f"{one} {pick(['<', '<=', '>', '>=', '==', '!='])} {other}"
        if depth == 0:
            return f"({plain})"
        return pick(
            [f"({plain})", f"({self.test(depth - 1)} {pick(['and', 'or'])} {plain})", f"(not {self.test(depth - 1)})"]
        )

    def function(self, name: str) -> str:
        lines = [f"@kernel\ndef {name}(a, b, i, j, x):"]
        for k in range(4):
            lines += [f"    r{k} = {self.real(3)}", f"    n{k} = {self.whole(3)}"]
            self.reals.append(f"r{k}")
            self.wholes.append(f"n{k}")
            lines += [f"    for k{k} in range({self.whole(1)} % 4):", f"        if {self.test(2)}:"]
            lines += [
                f"            r{k} = {self.real(2)}",
                "            continue",
                f"        n{k} += {self.whole(1)} % 7",
            ]
        return "\n".join([*lines, f"    return {self.real(2)} + {self.whole(2)}", ""])


@pytest.fixture(scope="module")
def functions(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """Random functions in a file, where the translator finds their source."""
    path: Path = tmp_path_factory.mktemp("random") / "random_functions.py"
    names = [f"function_{seed}" for seed in range(25)]
    written = [Random(seed).function(name) for seed, name in enumerate(names)]
    path.write_text("\n\n".join(["import math", "from fmd.kernels.kernel import kernel", *written]))
    spec = importlib.util.spec_from_file_location("random_functions", path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["random_functions"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return [getattr(module, name) for name in names]


def test_random_functions_find_what_they_find_in_python(functions: list[Any]) -> None:
    generator, compared = np.random.default_rng(5), 0
    for function in functions:
        for _ in range(12):
            a, b, x = *generator.normal(size=2).tolist(), generator.normal(size=5)
            i, j = generator.integers(-20, 20, 2).tolist()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # NumPy's own of overflows
                expected = float(function.python(a, b, i, j, x))
            found = function(a, b, i, j, x)
            if abs(expected) < 2.0**53:
                compared += 1
                assert found == pytest.approx(expected, rel=1e-12, abs=1e-12), function
    assert compared > 250
