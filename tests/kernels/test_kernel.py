"""Kernels as Python sees them: what they refuse, how they fail, and where they run."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.kernels.kernel import contracted, inlined, inner, kernel, unrolled
from fmd.kernels.machine import LoadedObject, compile_object
from fmd.kernels.table import Table
from fmd.kernels.types import REAL, WHOLE, array_type, type_of
from fmd.kernels.vectors import call_native, read_entries, read_vector, write_vector
from fmd.kernels.writer import NotInSubset


@kernel
def total(x: Array, n: int) -> float:
    result = 0.0
    for i in range(n):
        result += x[i]
    return result


@pytest.mark.parametrize("x", [np.ones((4, 4))[:, 1], np.ones(4)[::2], np.ones(4, dtype=np.float32), "text", None])
def test_an_argument_that_kernels_cannot_take_is_named(x: Any) -> None:
    with pytest.raises(TypeError, match=r"^total: x must be a (C-contiguous array|number, an array or a Table)"):
        total(x, 1)


def test_a_wrong_number_of_arguments_is_refused() -> None:
    with pytest.raises(NotInSubset, match="total has 2 plain parameters, not 1"):
        total(np.ones(1))  # type: ignore[call-arg]


# Faults, a few lines below the begin of each.
# ruff: noqa: RET503
@kernel
def makes_a_list(x):
    y = [x]
    return y[0]


@kernel
def changes_a_type(x):
    n = 1
    if x > 0.0:
        n = x
    return n


@kernel
def adds_a_text(x):
    return x + "1"


@kernel
def calls_what_is_not_for_kernels(x):
    return print(x)


@kernel
def strides(x):
    y = x[::2]
    return y[0]


@kernel
def has_an_else(x):
    for _ in range(3):
        if x > 2.0:
            break
        x += 1.0
    else:
        x = 0.0
    return x + 1.0


@kernel
def ands_numbers(x):
    return (x and 1.0) + 1.0


@kernel
def may_not_return(x):
    while x > 0.0:
        return 1.0


@kernel
def gives_names(x):
    return math.sqrt(x=x)


@kernel
def returns_two(x):
    return x, x


@inner
def first_of(pair):
    return pair[0]


@kernel
def hands_over_two(x):
    return first_of((x, x))


@inner
def goes_round(x):
    return goes_round(x - 1) if x > 0 else 0


@kernel
def recurs(x):
    return goes_round(x)


@pytest.mark.parametrize(
    ("function", "argument", "reason"),
    [
        (makes_a_list, 1.0, r"no such expression as \[x\]: y = \[x\]"),
        (changes_a_type, 1.0, r"n: float where there was int: n = x"),
        (adds_a_text, 1.0, r"'1' is neither a variable nor a number"),
        (calls_what_is_not_for_kernels, 1.0, r"print is no function for kernels"),
        (strides, np.ones(3), r"without a step"),
        (has_an_else, 1.0, r"no else after a loop"),
        (ands_numbers, 1.0, r"x is no truth"),
        (may_not_return, 1.0, r"may end without a return"),
        (gives_names, 1.0, r"given by their places"),
        (returns_two, 1.0, r"returns several values"),
        (hands_over_two, 1.0, r"a tuple is no argument"),
        (recurs, 1, r"goes_round calls itself"),
    ],
)
def test_what_kernels_cannot_hold_is_refused_with_file_and_line(function: Any, argument: Any, reason: str) -> None:
    with pytest.raises(NotInSubset, match=reason) as caught:
        function(argument)
    if function is not returns_two:
        file, line, _ = str(caught.value).split(":", 2)
        assert file == __file__
        first = (
            function.python.__code__.co_firstlineno if function is not recurs else goes_round.__code__.co_firstlineno
        )
        assert first < int(line) <= first + 5
    if function is recurs:
        assert caught.value.__notes__[-1].startswith("in recurs, ")


def test_bounds_are_checked_where_that_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FMD_KERNELS", "checked")

    @kernel
    def sum_of(x: Array, n: int) -> float:
        result = 0.0
        for i in range(n):
            result += x[i]
        return result

    @kernel
    def last_of_part(x: Array, first: int) -> float:
        return x[first:][0] + read_and_write(x, first)

    assert sum_of(np.arange(5.0), 5) == 10.0
    line = sum_of.python.__code__.co_firstlineno + 4  # type: ignore[attr-defined]
    with pytest.raises(IndexError, match=rf"test_kernel\.py:{line}: index 5 is out of bounds for size 5"):
        sum_of(np.arange(5.0), 9)
    assert sum_of(np.arange(5.0), 5) == 10.0
    assert last_of_part(np.arange(5.0), 1) == 4.0
    with pytest.raises(IndexError, match="index 0 is out of bounds for size 0"):
        last_of_part(np.arange(3.0), 3)
    with pytest.raises(IndexError, match="index 3 is out of bounds for size 3"):
        last_of_part(np.arange(3.0), 2)  # a vector of two


@contracted
def read_and_write(x: Array, at: int) -> float:
    pair = 2.0 * read_vector(x, at, 2)
    write_vector(x, at, pair + read_entries(x, at, 2))
    return x[at]


@unrolled
def sum_of_products(x: Array, most: float) -> float:
    """Of all pairs in order, until the sum is beyond the most."""
    total = 0.0
    for i in range(x.size):
        for j in range(i, x.size):
            total = total + x[i] * x[j]
            if total > most:
                return total
    return total


@kernel
def sums_of_products(x: Array, most: float) -> float:
    return sum_of_products(x, most)


def test_unrolled_loops_end_after_any_number_of_rounds() -> None:
    text, _ = sums_of_products.translate(tuple(type_of(each) for each in (np.zeros(1), 0.0)))  # type: ignore[attr-defined]
    assert text.count("!llvm.loop !1") == 1  # the innermost
    for size in range(12):
        x = np.random.default_rng(size).normal(size=size)
        for most in (np.inf, 0.5):
            expected = sums_of_products.python(x, most)  # type: ignore[attr-defined]
            assert sums_of_products(x, most) == pytest.approx(expected, rel=1e-13, abs=1e-13)


@singledispatch
def area(p: Any, scale: float) -> float:
    """Return the area of a shape."""
    raise NotImplementedError


@dataclass(frozen=True)
class Square(Table):
    side: float
    hollow: bool


@dataclass(frozen=True)
class Disc(Table):
    radius: float


@area.register(Square)
def _area_of_square(p: Square, scale: float) -> float:
    return 0.0 if p.hollow else scale * p.side * p.side


@area.register(Disc)
def _area_of_disc(p: Disc, scale: float) -> float:
    return scale * math.pi * p.radius**2


@inlined
def twice(x: float) -> float:
    return 2.0 * x


@kernel
def two_areas(p: Any, factors: Array) -> float:
    factors[0] = twice(factors[0])
    return area(p, factors[0])


@pytest.mark.parametrize("mode", ["compiled", "checked", "python"])
def test_a_function_does_what_is_registered_for_its_table(mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FMD_KERNELS", mode)
    function = kernel(two_areas.python)  # type: ignore[attr-defined]
    assert function(Square(3.0, False), np.array([1.0])) == 18.0
    assert function(Square(3.0, True), np.array([1.0])) == 0.0
    assert function(Disc(1.0), np.array([0.5])) == pytest.approx(math.pi)


def test_a_table_for_which_nothing_is_registered_is_refused() -> None:
    @dataclass(frozen=True)
    class Other(Table):
        x: float

    with pytest.raises(NotInSubset, match="area is not registered for Other"):
        two_areas(Other(1.0), np.ones(1))


@pytest.mark.parametrize("mode", ["compiled", "checked", "python"])
def test_vectors_do_in_python_what_they_do_compiled(mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FMD_KERNELS", mode)

    @kernel
    def double_pairs(x: Array) -> float:
        return read_and_write(x, 1) + read_and_write(x, 3)

    x = np.arange(6.0)
    assert double_pairs(x) == 12.0
    assert x.tolist() == [0.0, 3.0, 6.0, 9.0, 12.0, 5.0]


def test_python_calls_machine_code_by_its_address() -> None:
    code = LoadedObject(compile_object("define void @set(ptr %x) {\n  store double 2.5, ptr %x\n  ret void\n}\n"))
    x = np.zeros(2)
    call_native(code.address("set"), (x,))
    assert x.tolist() == [2.5, 0.0]
    with pytest.raises(TypeError, match="C-contiguous arrays of 64-bit numbers"):
        call_native(code.address("set"), (np.ones(3, dtype=np.float32),))


@kernel
def wait_for(nothing: int, flag: Array, most: int) -> int:
    for k in range(most):
        call_native(nothing, (flag,))  # for all that LLVM knows it sets the flag
        if flag[0] != 0.0:
            return k
    return -1


def test_a_kernel_lets_other_threads_run_meanwhile() -> None:
    """It ends before its patience does only because this thread sets the flag that it waits for."""
    code, flag, found = LoadedObject(compile_object("define void @nothing(ptr %x) {\n  ret void\n}\n")), np.zeros(1), []
    nothing = code.address("nothing")
    assert wait_for(nothing, flag, 10) == -1
    thread = threading.Thread(target=lambda: found.append(wait_for(nothing, flag, 10**11)))
    thread.start()
    time.sleep(0.05)
    flag[0] = 1.0
    thread.join(30.0)
    assert len(found) == 1
    assert found[0] > 0


def test_threads_that_call_a_new_kernel_at_once_all_find_its_result() -> None:
    @kernel
    def square_sum(x: Array) -> float:
        result = 0.0
        for i in range(x.size):
            result += x[i] * x[i]
        return result

    results: list[float] = []
    threads = [
        threading.Thread(target=lambda k=k: results.append(square_sum(np.full(100, float(k))))) for k in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    assert sorted(results) == [100.0 * k * k for k in range(8)]


@pytest.mark.parametrize(
    ("triple", "begin"),
    [
        ("aarch64-unknown-linux-gnu", b"\x7fELF"),
        ("arm64-apple-darwin", b"\xcf\xfa\xed\xfe"),
        ("x86_64-pc-windows-msvc", b"\x64\x86"),
        ("aarch64-pc-windows-msvc", b"\x64\xaa"),
    ],
)
def test_kernels_compile_for_other_machines(triple: str, begin: bytes) -> None:
    types = (array_type(np.dtype(float), 1), WHOLE)
    text, result = total.translate(types)  # type: ignore[attr-defined]
    assert result == REAL
    assert compile_object(text, 2, triple).startswith(begin)
