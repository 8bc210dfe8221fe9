"""Long programs cut into parts, of which those that are alike share one function.

A chain's bodies differ in constants and in where their inputs are. So the code of one serves all of a kind: it takes
and gives values through two arrays, at places that each call brings along, and has constants of its own in each call.
Functions of bounded size compile in a time that is linear in the number of bodies, and one that is called again is in
the processor's nearest cache.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import field
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from fmd.core.arrays import Array, BoolArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.code import LONG_PROGRAM, MOST_COPIED, MOST_IN_PART, MOST_ON_STACK, STANDING
from fmd.dynamics.compiler.chunks import chunk_widths
from fmd.dynamics.compiler.graph import Graph
from fmd.dynamics.compiler.nodes import Node, Place
from fmd.dynamics.compiler.oscillators import OSCILLATED
from fmd.dynamics.compiler.program import LANES, Output, Program

PLAIN, WIDE = "plain", "wide"
"""Arrays through which parts give values to others: of one entry, and of one for each lane."""
SPACING = 1 << 20
"""From one value to the next in a shared function's numbering of places; each call says where they are."""

_T = TypeVar("_T")
_INPUTS, _CONSTANTS = ("input", "vector input"), ("number", "array")


@dataclass(frozen=True)
class Call:
    """A call of a shared function."""

    function: int
    # Where the values that it takes, and then those that it gives, begin in their arrays [doubles].
    places: tuple[int, ...]
    constants: Array = field(repr=False)  # what its k-th constant is; the function has the number k + 2 in its place


@dataclass(frozen=True)
class Parts:
    """A program as calls of shared functions."""

    before: list[Program]  # copy inputs to the arrays
    after: list[Program]  # copy outputs from the arrays
    functions: list[Program]  # functions of the two arrays
    calls: list[Call]
    sizes: dict[str, int]  # of the arrays [doubles]


def cut_program(program: Program, register: int) -> Parts | None:
    """Cut a long program at the marks of its graph; return None for one that is to stay whole.

    That is also one whose parts would give each other more than a stack holds.
    """
    nodes = program.graph.nodes
    if program.operations(register) < LONG_PROGRAM or program.guard is not None:
        return None
    if any(nodes[number].operation in OSCILLATED for number in program.nodes):
        return None
    parts = _Cutter(program, register).cut()
    return parts if sum(parts.sizes.values()) < MOST_ON_STACK else None


class _Cutter:
    """Cuts a program, and places the values that parts give to others in the two arrays."""

    def __init__(self, program: Program, register: int) -> None:
        self._program, self._graph, self._register = program, program.graph, register
        self._wide = program.in_lanes
        self._first: dict[int, int] = {}
        self._varying: dict[int, tuple[BoolArray, Array]] = {}
        self._free: dict[tuple[str, int], list[int]] = {}
        self._sizes = {PLAIN: 0, WIDE: 0}

    def cut(self) -> Parts:
        """Return the program as calls."""
        nodes, results = self._graph.nodes, [output.value.node for output in self._program.outputs]
        parts = self._parts()
        home = {number: k for k, part in enumerate(parts) for number in part}
        taken = [
            list(dict.fromkeys(
                a for number in part for a in nodes[number].arguments
                if home.get(a) != k and nodes[a].operation not in _CONSTANTS
            ))
            for k, part in enumerate(parts)
        ]  # fmt: skip
        last = {number: k for k, numbers in enumerate(taken) for number in numbers} | dict.fromkeys(results, len(parts))
        inputs = [number for number in self._program.nodes if number in last and nodes[number].operation in _INPUTS]
        for number in inputs:
            self._place(number)
        numbers, functions, calls = dict[object, int](), list[Program](), list[Call]()
        for k, part in enumerate(parts):
            given = [number for number in part if number in last]
            for number in given:
                self._place(number)
            copy = self._copy(part, taken[k], given)
            if (key := copy.key) not in numbers:
                numbers[key] = len(functions)
                functions.append(copy.program(f"part{len(functions)}", (PLAIN, WIDE), (WIDE,)))
            places = tuple([self._first[number] for number in (*taken[k], *given)])
            calls.append(Call(numbers[key], places, np.array(copy.constants)))
            for number in taken[k]:
                if last[number] == k and number in home:
                    self._free.setdefault(self._room(number), []).append(self._first[number])
        before = [self._before(f"before{k}", own) for k, own in enumerate(self._in_groups(inputs, int))]
        groups = self._in_groups(self._program.outputs, lambda output: output.value.node)
        after = [self._after(f"after{k}", own) for k, own in enumerate(groups)]
        return Parts(before, after, functions, calls, self._sizes)

    def _parts(self) -> list[list[int]]:
        """Return the nodes that are computed between two marks, in order, and no more than a part may have."""
        out, nodes = [], self._graph.nodes
        for found in self._graph.between_marks(self._program.nodes):
            numbers = [number for number in found if nodes[number].operation not in (*_INPUTS, *_CONSTANTS)]
            size = -(-len(numbers) // max(1, -(-len(numbers) // MOST_IN_PART)))
            out += [numbers[first : first + size] for first in range(0, len(numbers), size or 1)]
        return out

    def _in_groups(self, copied: Sequence[_T], node_of: Callable[[_T], int]) -> list[Sequence[_T]]:
        """Divide what is copied into groups of a bounded number of vector registers."""
        ends = np.cumsum([-(-self._room(node_of(each))[1] // self._register) for each in copied]) // MOST_COPIED
        firsts = [0, *(np.flatnonzero(np.diff(ends)) + 1).tolist(), len(copied)]
        return [copied[first:end] for first, end in pairwise(firsts) if first < end]

    def _room(self, number: int) -> tuple[str, int]:
        """Return the array that a value goes to, and how many doubles it takes there."""
        size = self._graph.nodes[number].size or 1
        if number in self._wide:
            return WIDE, size * LANES
        return PLAIN, sum(chunk_widths(size, self._register))

    def _place(self, number: int) -> None:
        array, size = room = self._room(number)
        if free := self._free.get(room):
            self._first[number] = free.pop()
        else:
            self._first[number] = self._sizes[array]
            self._sizes[array] += size

    def _entries(self, number: int, first: int) -> Place:
        """Return a value's place, which begins at a number of doubles; padding of whole chunks comes along."""
        array, size = self._room(number)
        lanes = LANES if array == WIDE else 1
        return array, tuple(range(first // lanes, (first + size) // lanes))

    def _copy(self, part: Sequence[int], taken: Sequence[int], given: Sequence[int]) -> _Copy:
        """Return a part with numbers in place of its constants and places: that of parts that are alike is equal."""
        copy = _Copy(self._graph, self._find_varying)
        places = {}
        for k, number in enumerate((*taken, *given)):
            places[number] = self._entries(number, SPACING * k * (LANES if number in self._wide else 1))
        for number in taken:
            copy.take(number, places[number])
        for number in part:
            copy.add(number)
        for number in given:
            copy.give(number, places[number])
        return copy

    def _find_varying(self, number: int) -> tuple[BoolArray, Array]:
        """Return where a constant array's entries don't matter to the code, and these entries."""
        if number not in self._varying:
            values = self._graph.arrays[number]
            varying = ~np.isin(values, STANDING)
            self._varying[number] = varying, values[varying]
        return self._varying[number]

    def _before(self, name: str, inputs: Sequence[int]) -> Program:
        copy = _Copy(self._graph)
        for number in inputs:
            copy.take(number, self._graph.nodes[number].data)  # type: ignore[arg-type]
            copy.give(number, self._entries(number, self._first[number]))
        return self._beside(copy, name)

    def _after(self, name: str, outputs: Sequence[Output]) -> Program:
        copy = _Copy(self._graph)
        for value, place in outputs:
            if value.node in self._first:
                copy.take(value.node, self._entries(value.node, self._first[value.node]))
            copy.give(value.node, place)
        return self._beside(copy, name)

    def _beside(self, copy: _Copy, name: str) -> Program:
        arguments, lanes = self._program.arguments, self._program.lanes
        return copy.program(name, (*arguments, PLAIN, WIDE), (*lanes, WIDE))


class _Copy:
    """Nodes of a graph copied to one of their own, where numbers may take the place of constants.

    ``varying`` returns where numbers take the place of a constant array's entries, and these; no constant is replaced
    without. What is replaced is in ``constants``.
    """

    def __init__(self, graph: Graph, varying: Callable[[int], tuple[BoolArray, Array]] | None = None) -> None:
        self.constants = list[float]()
        self._of, self._varying = graph, varying
        self._nodes, self._arrays, self._outputs = list[tuple[Any, ...]](), list[Array](), list[tuple[int, Place]]()
        self._numbers, self._array_numbers = dict[int, int](), dict[int, int]()

    @property
    def key(self) -> object:
        """Key that is the same for equal copies."""
        arrays = [(values.shape, values.tobytes()) for values in self._arrays]
        return tuple(self._nodes), tuple(arrays), tuple(self._outputs)

    def program(self, name: str, arguments: tuple[str, ...], lanes: tuple[str, ...]) -> Program:
        """Return the copy as a program."""
        graph = Graph()
        graph.nodes, graph.arrays = [Node(*node) for node in self._nodes], self._arrays
        outputs = tuple([Output(graph.value_of(number), place) for number, place in self._outputs])
        return Program(name, graph, arguments, outputs, lanes)

    def take(self, number: int, place: Place) -> None:
        """Take a value as an input from a place."""
        size = self._of.nodes[number].size
        self._append(number, ("vector input" if size else "input", (), place, size))

    def give(self, number: int, place: Place) -> None:
        """Give a value, which is copied unless it has been, to a place."""
        self._outputs.append((self._numbers[number] if number in self._numbers else self.add(number), place))

    def add(self, number: int) -> int:
        """Copy a node whose arguments have been copied or are constants, and return its number."""
        operation, arguments, data, size = self._of.nodes[number]
        numbers = self._numbers
        copied = tuple([numbers[k] if k in numbers else self.add(k) for k in arguments])
        if operation in ("add", "multiply", "dot", "products"):
            copied = copied if copied[0] < copied[1] else copied[::-1]
        elif operation == "number":
            data = self._replace_number(data)  # type: ignore[arg-type]
        elif operation in ("array", "diagonal", "matrix", "piece", "pick"):
            data = self._copy_array(data)  # type: ignore[arg-type]
        return self._append(number, (operation, copied, data, size))

    def _append(self, number: int, node: tuple[Any, ...]) -> int:
        self._numbers[number] = len(self._nodes)
        self._nodes.append(node)
        return self._numbers[number]

    def _replace_number(self, value: float) -> float:
        if self._varying is None or value in STANDING or not math.isfinite(value):
            return value
        self.constants.append(value)
        return len(self.constants) + 1.0

    def _copy_array(self, number: int) -> int:
        """Return the number of an array's copy."""
        if number not in self._array_numbers:
            self._array_numbers[number] = len(self._arrays)
            values = self._of.arrays[number]
            if self._varying is not None:
                varying, own = self._varying(number)
                values, first = values.copy(), len(self.constants) + 2.0
                values[varying] = np.arange(first, first + len(own))
                self.constants += own.tolist()
            self._arrays.append(values)
        return self._array_numbers[number]
