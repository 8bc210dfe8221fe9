"""Structure of a program: all of it but the values of its constants, of which its code is the same for all."""

from math import isfinite

import numpy as np

from fmd.core.arrays import Array, BoolArray
from fmd.core.limits.code import FIRST_CONSTANT, STANDING
from fmd.dynamics.compiler.graph import Graph
from fmd.dynamics.compiler.program import Output, Program

_ARRAYS = ("array", "diagonal", "matrix", "piece", "pick")


def split_constants(program: Program) -> tuple[bytes, Array]:
    """Return all that the code of a program depends on, and its constants, (n_constants,)."""
    nodes, numbers = program.graph.nodes, _vary_numbers(program)
    arrays, values, varying = _vary_arrays(program)
    rank = {number: k for k, number in enumerate(sorted(program.nodes))}
    order = {number: k for k, number in enumerate(arrays)}
    described = []
    for number in program.nodes:
        operation, arguments, data, size = nodes[number]
        kept = None if number in numbers else order[data] if operation in _ARRAYS else data  # type: ignore[index]
        described.append((rank[number], operation, [rank[k] for k in arguments], kept, size))
    shapes = [program.graph.arrays[number].shape for number in arrays]
    outputs = [(rank[output.value.node], output.place) for output in program.outputs]
    how = program.arguments, program.lanes, program.in_place, program.seldom, program.guard and rank[program.guard.node]
    parts = [len(own) for own in program.graph.between_marks(program.nodes)]
    text = repr((how, outputs, parts, shapes, described)).encode()
    constants = np.concatenate([[nodes[number].data for number in numbers], values[varying]])
    return text + np.where(varying, np.nan, values).tobytes(), np.asarray(constants, dtype=float)


def number_constants(program: Program) -> Program:
    """Return a program of the same structure with numbers from 2 on in place of its constants, in their order."""
    graph, numbered, numbers = program.graph, Graph(), _vary_numbers(program)
    arrays, values, varying = _vary_arrays(program)
    numbered.nodes, numbered.arrays, numbered.marks = [*graph.nodes], [*graph.arrays], graph.marks
    for k, number in enumerate(numbers):
        numbered.nodes[number] = graph.nodes[number]._replace(data=FIRST_CONSTANT + k)
    values[varying] = FIRST_CONSTANT + len(numbers) + np.arange(np.count_nonzero(varying))
    ends = np.cumsum([graph.arrays[number].size for number in arrays])[:-1]
    for number, own in zip(arrays, np.split(values, ends), strict=True) if arrays else ():
        numbered.arrays[number] = own.reshape(graph.arrays[number].shape)
    outputs = tuple([Output(numbered.value_of(value.node), place) for value, place in program.outputs])
    guard = program.guard and numbered.value_of(program.guard.node)
    how = program.arguments, outputs, program.lanes, program.in_place, program.seldom
    return Program(program.name, numbered, *how, guard)  # type: ignore[arg-type]


def place_constants(places: Array, constants: Array) -> Array:
    """Return the constants that code reads, whose places (n,) hold numbers by `number_constants`."""
    out, varying = places.copy(), places >= FIRST_CONSTANT
    out[varying] = constants[(places[varying] - FIRST_CONSTANT).astype(np.int64)]
    return out


def _vary_numbers(program: Program) -> dict[int, None]:
    """Return the nodes of a program that are numbers whose value doesn't matter to its code."""
    nodes = ((number, program.graph.nodes[number]) for number in program.nodes)
    some = ((number, float(data)) for number, (operation, _, data, _) in nodes if operation == "number")  # type: ignore[arg-type]
    return dict.fromkeys(number for number, value in some if isfinite(value) and value not in STANDING)


def _vary_arrays(program: Program) -> tuple[list[int], Array, BoolArray]:
    """Return the numbers of a program's arrays, their entries, and which of these don't matter to its code."""
    nodes = (program.graph.nodes[number] for number in program.nodes)
    numbers = list(dict.fromkeys(node.data for node in nodes if node.operation in _ARRAYS))
    arrays = [program.graph.arrays[number].ravel() for number in numbers]  # type: ignore[index]
    values = np.concatenate([np.zeros(0), *arrays])
    return numbers, values, ~np.isin(values, STANDING)  # type: ignore[return-value]
