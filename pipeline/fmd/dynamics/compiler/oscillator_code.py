"""Steps of oscillators that don't couple in LLVM's language: what `Oscillators.take_steps` is compiled to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from fmd.core.limits.code import CHUNKS_AT_ONCE
from fmd.dynamics.compiler.chunks import Chunk, ChunkWriter, is_zero, zero
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.compiler.writer import literal

_End = tuple[str, str, str]
"""Values of positions, of an increment and of its change at the end, or what loads add to them."""


class OscillatorWriter:
    """Writes the steps of oscillators in LLVM's language, a few chunks side by side through each loop."""

    def __init__(
        self,
        out: ChunkWriter,
        data: tuple[str, tuple[int, ...]],
        scalars: Sequence[str],
        vectors: Sequence[list[Chunk]],
    ) -> None:
        self._out, (self._usual, self._n_inputs, n_damping, n_late, *self._numbers) = out, data[1]
        (self._h, count, varying, first), n_scalars = scalars[:4], 4 + len(self._numbers)
        self._begin, self._factors = scalars[4:n_scalars], scalars[n_scalars:]
        self._vectors, others = vectors[: 6 + n_damping], vectors[6 + n_damping :]
        self._late, self._levers = others[:n_late], others[n_late:]
        self._damped = n_damping > 0
        self._following = out.value(f"sub i64 {out.value(f'fptosi double {count} to i64')}, 1")
        self._varying = out.value(f"fptosi double {varying} to i64")
        self._first = out.value(f"fptosi double {first} to i64")
        self._square = out.value(f"fmul double {self._h}, {self._h}")
        self._per_step = out.value(f"fdiv double {literal(1.0)}, {self._h}")
        self._per_square = out.value(f"fmul double {self._per_step}, {self._per_step}")

    def write(self) -> tuple[list[Chunk], list[Chunk], list[Chunk]]:
        """Write all steps, and return positions, rates and accelerations."""
        widths = [width for _, width in self._vectors[0]]
        found: tuple[list[Chunk], list[Chunk], list[Chunk]] = ([], [], [])
        for first in range(0, len(widths), CHUNKS_AT_ONCE):
            for width, values in self._write_some(range(first, min(first + CHUNKS_AT_ONCE, len(widths))), widths):
                for each, value in zip(found, values, strict=True):
                    each.append((value, width))
        return found

    def _write_some(self, some: range, widths: list[int]) -> list[tuple[int, _End]]:
        groups = (self._vectors, self._late, self._levers)
        chunks = [_Chunk(self, widths[k], *([x[k][0] for x in group] for group in groups)) for k in some]
        if self._damped:
            ends = self._take_damped_steps(chunks)
            if self._levers:
                pairs = zip(chunks, ends, self._follow_loads(chunks), strict=True)
                ends = [chunk.added(end, more) for chunk, end, more in pairs]
        else:
            ends = self._sum_steps(chunks)
            if self._levers:
                ends = self._add_loads(chunks, ends)
        return [(chunk.width, chunk.end(end)) for chunk, end in zip(chunks, ends, strict=True)]

    def _sum_steps(self, chunks: list[_Chunk]) -> list[_End]:
        """Write the end by polynomials and their sums: of a whole cycle, or of any steps, one after the other."""
        start = [(value, chunk.width) for chunk in chunks for value in chunk.one_step]

        def follow(_: str, now: list[str]) -> list[str]:
            return [x for k, chunk in enumerate(chunks) for x in chunk.next_polynomial(now[4 * k : 4 * k + 4])]

        def take_any() -> list[str]:
            found = self._out.repeat(self._following, start, follow)
            return [x for k, chunk in enumerate(chunks) for x in chunk.sum_up(*found[4 * k : 4 * k + 4])]

        usual = self._out.value(f"icmp eq i64 {self._following}, {self._usual - 1}")
        return self._either(
            usual,
            chunks,
            lambda: [x for chunk in chunks for x in chunk.sum_up(*chunk.polynomials(self._usual))],
            take_any,
        )

    def _add_loads(self, chunks: list[_Chunk], ends: list[_End]) -> list[_End]:
        """Write what the loads' changes add, if any of them varies: their response from rest, without damping."""

        def respond() -> list[str]:
            found = self._respond(chunks)
            return [x for chunk, end, more in zip(chunks, ends, found, strict=True) for x in chunk.added(end, more)]

        still = self._out.value(f"icmp eq i64 {self._varying}, 0")
        return self._either(still, chunks, lambda: [x for end in ends for x in end], respond)

    def _respond(self, chunks: list[_Chunk]) -> list[_End]:
        levers = [chunk.levers() for chunk in chunks]
        alone = len(self._levers) == 1  # its lever is a factor of the response
        factors = [
            [self._out.splat(literal(1.0), chunk.width)] if alone else own
            for chunk, own in zip(chunks, levers, strict=True)
        ]
        start = [(zero(chunk.width), chunk.width) for chunk in chunks for _ in range(3)]

        def follow(number: str, now: list[str]) -> list[str]:
            forces, following = self._forces(chunks, factors, self._out.value(f"add i64 {number}, 1")), list[str]()
            for k, (chunk, force) in enumerate(zip(chunks, forces, strict=True)):
                way, before, _ = now[3 * k : 3 * k + 3]
                rest = chunk.binary("fsub", force, before)
                following += [self._out.accumulate(rest, chunk.two_less_z, way, chunk.width), way, force]
            return following

        found, ends = self._out.repeat(self._varying, start, follow), list[_End]()
        for k, chunk in enumerate(chunks):
            way, before, force = found[3 * k : 3 * k + 3]
            end = (way, chunk.binary("fsub", way, before), chunk.less_spring(force, before))
            ends.append(chunk.scaled(levers[k][0], end) if alone else end)
        return ends

    def _either(
        self, condition: str, chunks: list[_Chunk], first: Callable[[], list[str]], second: Callable[[], list[str]]
    ) -> list[_End]:
        found = self._out.either(condition, [chunk.width for chunk in chunks for _ in range(3)], first, second)
        return [(found[3 * k], found[3 * k + 1], found[3 * k + 2]) for k in range(len(chunks))]

    def _forces(self, chunks: list[_Chunk], levers: list[list[str]], step: str) -> list[str]:
        """Write the changes of forces by the loads' changes from the begin up to a step."""
        out, changes, forces = self._out, list[str](), list[str]()
        at = out.value(f"add i64 {step}, {self._first}")
        block, lane = out.value(f"and i64 {at}, {-LANES}"), out.value(f"and i64 {at}, {LANES - 1}")
        first = out.value(f"add i64 {out.value(f'mul i64 {block}, {self._n_inputs}')}, {lane}")
        for load, begin in zip(self._numbers, self._begin, strict=True):
            place = out.value(f"getelementptr double, ptr %ahead, i64 {out.value(f'add i64 {first}, {load * LANES}')}")
            changes.append(out.value(f"fsub double {out.value(f'load double, ptr {place}, align 8')}, {begin}"))
        for chunk, own in zip(chunks, levers, strict=True):
            force: str | None = None
            for change, lever in zip(changes, own, strict=True):
                force = out.accumulate(force, out.splat(change, chunk.width), lever, chunk.width)
            assert force is not None
            forces.append(force)
        return forces

    def _take_damped_steps(self, chunks: list[_Chunk]) -> list[_End]:
        forces = [chunk.damped_force for chunk in chunks]

        def step(number: str, now: list[str]) -> list[str]:
            time, following = self._out.value(f"sitofp i64 {self._out.value(f'add i64 {number}, 1')} to double"), []
            for k, (chunk, force) in enumerate(zip(chunks, forces, strict=True)):
                loaded = chunk.binary("fadd", force, chunk.binary("fmul", self._out.splat(time, chunk.width), chunk.g))
                following += chunk.step(loaded, now[3 * k : 3 * k + 3])
            return following

        start = [(value, chunk.width) for chunk in chunks for value in chunk.after_first]
        found = self._out.repeat(self._following, start, step)
        ends = [(found[3 * k], found[3 * k + 1], found[3 * k + 2]) for k in range(len(chunks))]
        return [(chunk.binary("fadd", chunk.x, way), d, b) for chunk, (way, d, b) in zip(chunks, ends, strict=True)]

    def _follow_loads(self, chunks: list[_Chunk]) -> list[_End]:
        """Write way, increment and its change by the loads' changes alone, with damping."""
        levers = [chunk.levers() for chunk in chunks]

        def step(number: str, now: list[str]) -> list[str]:
            forces = self._forces(chunks, levers, self._out.value(f"add i64 {number}, 1"))
            pairs = enumerate(zip(chunks, forces, strict=True))
            return [x for k, (chunk, force) in pairs for x in chunk.step(force, now[3 * k : 3 * k + 3])]

        start = [(zero(chunk.width), chunk.width) for chunk in chunks for _ in range(3)]
        found = self._out.repeat(self._varying, start, step)
        return [(found[3 * k], found[3 * k + 1], found[3 * k + 2]) for k in range(len(chunks))]


class _Chunk:
    """A chunk of oscillators in units of a step: what their steps need, written before any loop."""

    def __init__(
        self, of: OscillatorWriter, width: int, vectors: list[str], late: list[str], levers: list[str]
    ) -> None:
        self._out, self.width = of._out, width
        self.x, v, a, inverse_mass, by_positions, drift, *damping = vectors
        out, multiply = self._out, partial(self.binary, "fmul")
        h, square = out.splat(of._h, width), out.splat(of._square, width)
        per_mass = multiply(square, inverse_mass)
        self.z, self.d, self.b = multiply(per_mass, by_positions), multiply(h, v), multiply(square, a)
        self._negative = multiply(self.splat(-1.0), per_mass)
        per_slope = multiply(h, self._negative)
        self.g = zero(width) if is_zero(drift) else multiply(per_slope, drift)
        self.late = [multiply(per_slope, slope) for slope in late]
        self._levers = levers
        self._factors = [out.splat(factor, width) for factor in of._factors]
        self.two_less_z = self.binary("fsub", self.splat(2.0), self.z)
        self._three_less_z = self.binary("fsub", self.splat(3.0), self.z)
        self._per_step, self._per_square = of._per_step, of._per_square
        if damping:
            self._c = multiply(multiply(h, inverse_mass), damping[0])
            for factor, slope in zip(self._factors, self.late, strict=True):
                self.g = out.accumulate(self.g, factor, slope, width)
            self.damped_force = out.accumulate(self.b, self._c, multiply(h, damping[1]), width)
        self._damped = bool(damping)

    @property
    def one_step(self) -> tuple[str, str, str, str]:
        """Polynomials and sums after one step."""
        one, nothing = self.splat(1.0), zero(self.width)
        return one, nothing, one, nothing

    def levers(self) -> list[str]:
        """Write how the forces change with each load."""
        return [self.binary("fmul", self._negative, lever) for lever in self._levers]

    def polynomials(self, number: int) -> list[str]:
        """Write polynomials and sums after some steps, by those after half of them."""
        if number < 2:
            return list(self.one_step)
        if number < 4:
            one = self.splat(1.0)
            even = [self.two_less_z, one, self.binary("fadd", one, self.two_less_z), one]
        else:
            even = self._doubled(self.polynomials(number // 2))
        return self.next_polynomial(even) if number % 2 else even

    def _doubled(self, now: list[str]) -> list[str]:
        """Write polynomials and sums after twice as many steps."""
        add, subtract, multiply = (partial(self.binary, operation) for operation in ("fadd", "fsub", "fmul"))
        u, before, total, of_totals = now
        difference = subtract(multiply(self.two_less_z, u), add(before, before))
        following_sum = subtract(multiply(self._three_less_z, u), before)
        return [
            multiply(u, difference),
            multiply(subtract(u, before), add(u, before)),
            multiply(u, following_sum),
            add(add(of_totals, of_totals), multiply(u, subtract(add(total, total), u))),
        ]

    @property
    def after_first(self) -> list[str]:
        """Way, increment and its change after the first step."""
        d = self.binary("fadd", self.d, self.b)
        return [d, d, self.b]

    def binary(self, operation: str, a: str, b: str) -> str:
        return self._out.binary(operation, a, b, self.width)

    def splat(self, value: float) -> str:
        return self._out.splat(literal(value), self.width)

    def less_spring(self, force: str, way: str) -> str:
        return self.binary("fsub", force, self.binary("fmul", self.z, way))

    def step(self, force: str, now: list[str]) -> list[str]:
        """Write a step of way, increment and its change under a force."""
        e, d, b = now
        if self._damped:
            rate = self._out.accumulate(d, self.splat(0.5), b, self.width)
            force = self.binary("fsub", force, self.binary("fmul", self._c, rate))
        b = self.less_spring(force, e)
        d = self.binary("fadd", d, b)
        return [self.binary("fadd", e, d), d, b]

    def next_polynomial(self, now: list[str]) -> list[str]:
        """Write the next polynomial, the one before, and the sums."""
        u, before, total, of_totals = now
        of_totals = self.binary("fadd", of_totals, total)
        u, before = self.binary("fsub", self.binary("fmul", self.two_less_z, u), before), u
        return [u, before, self.binary("fadd", total, u), of_totals]

    def sum_up(self, u: str, before: str, total: str, of_totals: str) -> _End:
        """Write the end by the polynomials; what is known late, the accelerations, comes last."""
        multiply = self._out.accumulate

        def combine(start: str | None, by_d: str, by_b: str, by_g: str) -> str:
            value = multiply(multiply(start, self.d, by_d, self.width), self.b, by_b, self.width)
            value = value if is_zero(self.g) else multiply(value, self.g, by_g, self.width)
            for factor, slope in zip(self._factors, self.late, strict=True):
                ready = self.binary("fmul", slope, by_g)
                value = multiply(value, factor, ready, self.width)
            return value

        change = self.binary("fsub", u, before)
        of_way = self.binary("fmul", self.binary("fmul", self.splat(-1.0), self.z), before)
        return (
            combine(self.x, u, total, of_totals),
            combine(None, change, u, self.binary("fsub", total, u)),
            combine(None, of_way, change, before),
        )

    def added(self, one: _End, other: _End) -> _End:
        x, d, b = (self.binary("fadd", x, y) for x, y in zip(one, other, strict=True))
        return x, d, b

    def scaled(self, factor: str, one: _End) -> _End:
        x, d, b = (self.binary("fmul", factor, x) for x in one)
        return x, d, b

    def end(self, found: _End) -> _End:
        """Write positions, rates and accelerations."""
        x, d, b = found
        per_step, per_square = (self._out.splat(factor, self.width) for factor in (self._per_step, self._per_square))
        return x, self.binary("fmul", d, per_step), self.binary("fmul", b, per_square)
