"""Nodes of an expression graph, each operation once, and the constant arrays that they name."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array, read_only

Place = tuple[str, tuple[int, ...]]
"""An argument's name and the places of an input's entries in it."""


class Node(NamedTuple):
    """One operation of a graph."""

    # Scalars: ``number``, ``input``, ``add``, ``subtract``, ``multiply``, ``negate``, ``invert``, one of
    # `functions.FUNCTIONS` or `functions.CHOICES`, ``piece`` of ascending constants that a scalar is in, ``pick`` of
    # constants by such a number, ``dot`` of two vectors, ``entry`` of one. Vectors: ``array``, ``vector input``,
    # ``combine`` (scalar, vector, scalar, vector, …: the sum of the products), ``products`` of two vectors' entries,
    # ``diagonal`` and ``matrix`` (constant, times a vector), and those of `oscillators.OSCILLATED`.
    operation: str
    arguments: tuple[int, ...]  # numbers of the nodes that it takes, all smaller than its own
    # The number; which entry; the number of the constant array in `Graph.arrays`; where an input is.
    data: float | int | Place | None
    size: int  # entries of a vector, 0 for a scalar


class NodeTable:
    """Nodes in an order in which they can be evaluated, and the constant arrays that they name.

    Ascending ``marks`` are nodes where something begins that others may be like: here a long program is cut.
    """

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.arrays: list[Array] = []
        self.marks: list[int] = []
        self._numbers: dict[tuple[str, tuple[int, ...], float | int | Place | None, int], int] = {}
        self._array_numbers: dict[tuple[tuple[int, ...], bytes], int] = {}

    def add(
        self, operation: str, arguments: tuple[int, ...] = (), data: float | int | Place | None = None, size: int = 0
    ) -> int:
        """Return the number of a node, which is new if no equal one exists."""
        key = (operation, arguments, data, size)
        number = self._numbers.get(key)
        if number is None:
            number = self._numbers[key] = len(self.nodes)
            self.nodes.append(Node(operation, arguments, data, size))
        return number

    def mark(self) -> None:
        """Mark that something begins with the next node that others may be like, such as a body's share."""
        if self.marks[-1:] != [len(self.nodes)]:
            self.marks.append(len(self.nodes))

    def add_array(self, values: Array) -> int:
        """Return the number of a constant array in `arrays`."""
        values = np.ascontiguousarray(values, dtype=float) + 0.0  # no negative zeros
        number = self._array_numbers.setdefault((values.shape, values.tobytes()), len(self.arrays))
        if number == len(self.arrays):
            self.arrays.append(read_only(values))
        return number

    def live(self, outputs: Iterable[int]) -> list[int]:
        """Return the nodes that the outputs depend on, in an order in which they can be evaluated.

        The order is depth first: what a node takes stands shortly before it, so that values live in registers.
        """
        order: dict[int, None] = {}
        visited: set[int] = set()
        for output in outputs:
            stack = [(output, False)]
            while stack:
                node, taken = stack.pop()
                if taken:
                    order[node] = None
                elif node not in visited:
                    visited.add(node)
                    stack.append((node, True))
                    stack += [(argument, False) for argument in reversed(self.nodes[node].arguments)]
        return list(order)

    def between_marks(self, numbers: Iterable[int]) -> list[list[int]]:
        """Return nodes ascending, from mark to mark."""
        found: dict[int, list[int]] = {}
        for number in sorted(numbers):
            found.setdefault(bisect_right(self.marks, number), []).append(number)
        return list(found.values())

    def live_by_marks(self, outputs: Iterable[int]) -> Iterator[int]:
        """Go through the nodes that the outputs depend on, and mark what is made meanwhile where they are marked."""
        for numbers in self.between_marks(self.live(outputs)):
            self.mark()
            yield from numbers
