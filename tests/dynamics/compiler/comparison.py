"""Values of compiled programs by the interpreter, and differences between arrays."""

from collections.abc import Mapping, Sequence
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.compiled import CompiledMechanism
from fmd.dynamics.compiler.graph import Graph
from fmd.dynamics.compiler.interpret import Evaluation
from fmd.dynamics.compiler.llvm import emit
from fmd.dynamics.compiler.program import Program
from fmd.kernels.machine import LoadedObject, compile_object

TIME = 0.37
_EVALUATIONS: WeakKeyDictionary[CompiledMechanism, dict[str, Evaluation]] = WeakKeyDictionary()


def interpret(graph: Graph, outputs: Sequence[int], arguments: Mapping[str, Array]) -> list[Any]:
    """Return the values of nodes at one state, or with an entry for each lane."""
    return Evaluation(graph, outputs).at(arguments)


def interpreted(compiled: CompiledMechanism, name: str, shape: tuple[int, ...], **arguments: Array) -> Array:
    """Return an array that a program fills, by the interpreter."""
    program = compiled.program(name)
    arguments["inputs"] = compiled.signal_values(TIME)
    known = _EVALUATIONS.setdefault(compiled, {})
    if name not in known:
        known[name] = Evaluation(program.graph, [output.value.node for output in program.outputs])
    out = np.zeros(shape)
    for value, (_, (_, places)) in zip(known[name].at(arguments), program.outputs, strict=True):
        out[list(places)] = value
    return out


def difference(a: Array, b: Array) -> float:
    """Return the largest difference over the largest value of b."""
    return float(np.abs(np.subtract(a, b)).max(initial=0.0) / max(np.abs(b).max(initial=0.0), 1e-300))


def load_code(program: Program, register: int = 4) -> LoadedObject:
    """Compile a program for registers of so many doubles, and load it with its constants."""
    source, constants = emit(program, register)
    return LoadedObject(compile_object(source), constants)
