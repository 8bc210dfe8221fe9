"""Programs: what of a graph a compiled function computes, and where its arguments hold it."""

from dataclasses import field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fmd.core.data_classes import dataclass
from fmd.dynamics.compiler.functions import CHOICES, FUNCTIONS
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector
from fmd.dynamics.compiler.nodes import Place

LANES = 8
"""Directions that a program with lanes takes at once."""


class Output(NamedTuple):
    """A value that a program computes, and where it goes."""

    value: Scalar | Vector
    place: Place


@dataclass(frozen=True)
class Program:
    """A function of arrays of doubles, as part of a graph."""

    name: str
    graph: Graph
    arguments: tuple[str, ...]  # names of its arrays in their order, those that it fills last
    # What it fills them with; places that none names are left as they are.
    outputs: tuple[Output, ...] = field(repr=False)
    # Arguments that have `LANES` entries in each place: the directions of derivatives, and these.
    lanes: tuple[str, ...] = ()
    in_place: bool = False  # outputs replace inputs
    seldom: bool = False  # marches hardly call it: it is to be compiled fast rather than to run fast
    guard: Scalar | None = None  # all outputs are 0 unless it is above 0, so that code may leave there

    @cached_property
    def nodes(self) -> list[int]:
        """Numbers of the nodes that it evaluates, in order."""
        first = [] if self.guard is None else [self.guard.node]
        return self.graph.live([*first, *(output.value.node for output in self.outputs)])

    @cached_property
    def flops(self) -> int:
        """Number of additions and multiplications; a division, a sine or a cosine counts as one."""
        return sum(_flops(self.graph, number) for number in self.nodes)

    @cached_property
    def in_lanes(self) -> set[int]:
        """Numbers of the nodes that differ from lane to lane."""
        wide = set[int]()
        for number in self.nodes if self.lanes else ():
            operation, arguments, data, _ = self.graph.nodes[number]
            inputs = operation in ("input", "vector input")
            if data[0] in self.lanes if inputs else not wide.isdisjoint(arguments):  # type: ignore[index]
                wide.add(number)
        return wide

    def operations(self, register: int) -> int:
        """Return `flops`, those in lanes as often as lanes take vector registers of so many doubles."""
        times = LANES // register
        return self.flops + (times - 1) * sum(_flops(self.graph, number) for number in self.in_lanes)


_OF_ONE = {"add", "subtract", "multiply", "invert", *FUNCTIONS, *CHOICES}


def _flops(graph: Graph, number: int) -> int:
    operation, arguments, data, size = graph.nodes[number]
    if operation in _OF_ONE:
        return 1
    if operation == "dot":
        return 2 * graph.nodes[arguments[0]].size - 1
    if operation == "combine":
        ones = sum(graph.nodes[k].data == 1.0 for k in arguments[::2])
        return size * (len(arguments) - 1 - ones)
    if operation in ("diagonal", "products"):
        return size
    if operation == "matrix":
        return 2 * int(np.count_nonzero(graph.arrays[data])) - size  # type: ignore[index]
    return 0
