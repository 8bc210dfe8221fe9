"""Leapfrog steps of oscillators that don't couple, eight, four, two or one of them in a vector register.

Each waits for a step's result before the next one, so that several at once cost what one does. They are read and
written in the pieces in which compiled equations read them: where single numbers have just been written, a processor
waits before it can read a vector.
"""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fmd.core.arrays import Array
from fmd.dynamics.jit.compiled import inlined

# isort: split
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

_WORD = ir.IntType(64)


class _Vectors:
    """Arithmetic of so many doubles at once in a function that is being built; products and sums may contract."""

    def __init__(self, builder: Any, width: int) -> None:
        self.builder, self.width = builder, width
        self.kind = ir.VectorType(ir.DoubleType(), width)

    def _place(self, data: Any, at: Any) -> Any:
        return self.builder.bitcast(self.builder.gep(data, [at]), self.kind.as_pointer())

    def load(self, data: Any, at: Any) -> Any:
        value = self.builder.load(self._place(data, at))
        value.align = 8
        return value

    def store(self, value: Any, data: Any, at: Any) -> None:
        self.builder.store(value, self._place(data, at)).align = 8

    def spread(self, number: Any) -> Any:
        nothing = ir.Constant(self.kind, ir.Undefined)
        one = self.builder.insert_element(nothing, number, ir.IntType(32)(0))
        mask = ir.Constant(ir.VectorType(ir.IntType(32), self.width), [0] * self.width)
        return self.builder.shuffle_vector(one, nothing, mask)

    def add(self, x: Any, y: Any) -> Any:
        return self.builder.fadd(x, y, flags=["contract"])

    def subtract(self, x: Any, y: Any) -> Any:
        return self.builder.fsub(x, y, flags=["contract"])

    def multiply(self, x: Any, y: Any) -> Any:
        return self.builder.fmul(x, y, flags=["contract"])

    def repeat(self, count: Any, start: list[Any], step: Callable[[Any, list[Any]], list[Any]]) -> list[Any]:
        """Replace values by those that ``step`` makes of its number, from 0 on, and them; so often, or not at all."""
        builder, before = self.builder, self.builder.block
        head, body, after = (builder.append_basic_block(name) for name in ("head", "body", "after"))
        builder.branch(head)
        builder.position_at_end(head)
        number = builder.phi(_WORD)
        number.add_incoming(_WORD(0), before)
        values = [builder.phi(value.type) for value in start]
        for phi, value in zip(values, start, strict=True):
            phi.add_incoming(value, before)
        builder.cbranch(builder.icmp_signed("<", number, count), body, after)
        builder.position_at_end(body)
        for phi, value in zip(values, step(number, values), strict=True):
            phi.add_incoming(value, builder.block)
        number.add_incoming(builder.add(number, _WORD(1)), builder.block)
        builder.branch(head)
        builder.position_at_end(after)
        return values


def _arrays(context: Any, builder: Any, kinds: Any, values: Any) -> list[Any]:
    return [context.make_array(kind)(context, builder, x).data for kind, x in zip(kinds, values, strict=True)]


def _undamped(width: int) -> Any:
    @intrinsic
    def step(typing_context: Any, arrays: Any, i: Any, offset: Any, count: Any, begins: Any, times: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            do, unpack = _Vectors(builder, width), lambda tuple_: [builder.extract_value(tuple_, k) for k in range(4)]
            members = [builder.extract_value(values[0], k) for k in range(len(arrays))]
            constants, slopes, stiffness, q, v, a, increments, loads = _arrays(context, builder, arrays, members)
            at, place, count, begins = values[1], builder.add(values[1], values[2]), values[3], values[4]
            h, over, since, until = (do.spread(number) for number in unpack(values[5]))
            square = do.multiply(h, h)
            constant, slope, k = (do.load(data, at) for data in (constants, slopes, stiffness))
            x, ki, more = do.load(q, place), do.multiply(square, k), do.multiply(square, do.multiply(h, slope))
            first = do.multiply(square, do.add(constant, do.multiply(since, slope)))
            d = builder.select(begins, do.multiply(h, do.load(v, at)), do.load(increments, at))
            load = builder.select(begins, first, do.load(loads, at))

            def change(d: Any, load: Any, x: Any) -> Any:
                return do.subtract(do.add(d, load), do.multiply(ki, x))

            def advance(_: Any, now: list[Any]) -> list[Any]:
                d, load, x = now
                d = change(d, load, x)
                return [d, do.add(load, more), do.add(x, d)]

            d, load, x = do.repeat(builder.sub(count, _WORD(1)), [d, load, x], advance)
            forced = do.add(constant, do.multiply(until, slope))
            do.store(do.subtract(forced, do.multiply(k, x)), a, at)
            d = change(d, load, x)
            do.store(do.multiply(over, d), v, at)
            do.store(do.add(x, d), q, place)
            do.store(d, increments, at)
            do.store(do.add(load, more), loads, at)
            return context.get_dummy_value()

        integer, real = types.intp, types.float64
        return types.none(arrays, integer, integer, integer, types.boolean, types.UniTuple(real, 4)), generate

    return step


def _damped(width: int) -> Any:
    @intrinsic
    def step(typing_context: Any, arrays: Any, i: Any, offset: Any, count: Any, first: Any, times: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            do = _Vectors(builder, width)
            members = [builder.extract_value(values[0], k) for k in range(len(arrays))]
            constants, slopes, stiffness, damping, q, v, a = _arrays(context, builder, arrays, members)
            at, place, count, first = values[1], builder.add(values[1], values[2]), values[3], values[4]
            step, start = (builder.extract_value(values[5], k) for k in range(2))
            h, half = do.spread(step), do.spread(builder.fmul(step, ir.DoubleType()(0.5)))
            constant, slope, k, c = (do.load(data, at) for data in (constants, slopes, stiffness, damping))

            def advance(number: Any, now: list[Any]) -> list[Any]:
                x, rate, acceleration = now
                time = builder.fmul(builder.sitofp(builder.add(first, number), ir.DoubleType()), step)
                tau = do.spread(builder.fsub(time, start))
                middle = do.add(rate, do.multiply(half, acceleration))
                forced = do.subtract(do.add(constant, do.multiply(tau, slope)), do.multiply(c, middle))
                acceleration = do.subtract(forced, do.multiply(k, x))
                rate = do.add(rate, do.multiply(h, acceleration))
                return [do.add(x, do.multiply(h, rate)), rate, acceleration]

            x, rate, acceleration = do.repeat(count, [do.load(q, place), do.load(v, at), do.load(a, at)], advance)
            for value, data, where in ((x, q, place), (rate, v, at), (acceleration, a, at)):
                do.store(value, data, where)
            return context.get_dummy_value()

        integer, real = types.intp, types.float64
        return types.none(arrays, integer, integer, integer, integer, types.UniTuple(real, 2)), generate

    return step


_undamped_eight, _undamped_four, _undamped_two, _undamped_one = (_undamped(width) for width in (8, 4, 2, 1))
_damped_eight, _damped_four, _damped_two, _damped_one = (_damped(width) for width in (8, 4, 2, 1))


@inlined
def step_undamped(
    n_slow: int,
    constant: Array,
    slope: Array,
    k: Array,
    q: Array,
    v: Array,
    a: Array,
    d: Array,
    load: Array,
    first: int,
    start: float,
    h: float,
    count: int,
    begins: bool,
) -> None:
    """Take ``count`` leapfrog steps h with ``a = constant + slope τ − k q`` from the rate ``n_slow`` on.

    They go in increments ``d = h v``, for which each oscillator waits for two operations a step instead of four.

    Parameters
    ----------
    constant, slope, k, v, a : ndarray, shape (n,)
        In the places of the rates; positions are the last ones of q.
    d, load : ndarray, shape (n,)
        Increments and their loads, with which a later call goes on as they are, not by way of v.
    first, start : int, float
        The first step is at a time ``first · h``, and τ is counted from ``start`` [s].
    begins : bool
        True if ``d`` and ``load`` aren't known yet.
    """
    arrays, n, at, offset = (constant, slope, k, q, v, a, d, load), v.size, n_slow, q.size - v.size
    times = (h, 1.0 / h, first * h - start, (first + count - 1) * h - start)
    while at + 8 <= n:
        _undamped_eight(arrays, at, offset, count, begins, times)
        at += 8
    if at + 4 <= n:
        _undamped_four(arrays, at, offset, count, begins, times)
        at += 4
    if at + 2 <= n:
        _undamped_two(arrays, at, offset, count, begins, times)
        at += 2
    if at < n:
        _undamped_one(arrays, at, offset, count, begins, times)


@inlined
def step_damped(
    n_slow: int,
    constant: Array,
    slope: Array,
    k: Array,
    c: Array,
    q: Array,
    v: Array,
    a: Array,
    first: int,
    start: float,
    h: float,
    count: int,
) -> None:
    """Take ``count`` leapfrog steps h with ``a = constant + slope τ − k q − c (v + ½ h a)``, as `step_undamped` does.

    Increments don't help here: the rates are needed themselves.
    """
    arrays, n, at, offset, times = (constant, slope, k, c, q, v, a), v.size, n_slow, q.size - v.size, (h, start)
    while at + 8 <= n:
        _damped_eight(arrays, at, offset, count, first, times)
        at += 8
    if at + 4 <= n:
        _damped_four(arrays, at, offset, count, first, times)
        at += 4
    if at + 2 <= n:
        _damped_two(arrays, at, offset, count, first, times)
        at += 2
    if at < n:
        _damped_one(arrays, at, offset, count, first, times)
