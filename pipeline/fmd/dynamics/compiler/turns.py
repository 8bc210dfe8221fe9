"""Turns of unit quaternions by rates about a body's own axes, and their tangents and adjoints: all of one graph.

A quaternion e, its real part last, has the rate ``½ e ∘ (ω, 0)``. In a time h it becomes ``e ∘ (c₁ u, c₀)`` with
``u = ½ h ω`` and the Stumpff functions of ``|u|²``, and is made a unit one again.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiler.algebra import add, cross, dot, scale
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.graph import Graph, Scalar
from fmd.dynamics.compiler.program import Output, Program
from fmd.dynamics.compiler.store import load_program
from fmd.kernels.machine import LoadedObject
from fmd.kernels.table import Table


@dataclass(frozen=True)
class Turns(Table):
    """Addresses of functions of a quaternion, 0 where none is wanted, and the time in which it turns.

    From that ``step``, ``q`` (4,) and rates ``v`` (3,) they fill ``end`` (4,), with the turned quaternion or its rate.
    Tangents are by ``dq`` (4, 8) and ``dv`` (3, 8), which come before it, and come after it. What goes back has weights
    of ``end`` instead, and adds what their sum changes by with rates to ``dv`` (3,), with ``q`` to ``dq`` (4,): of a
    turn in place of what is there. What is filled may be what is read.
    """

    step: Array  # (1,) [s]
    turn: int = 0
    rate: int = 0
    turn_tangents: int = 0
    rate_tangents: int = 0
    turn_back: int = 0
    rate_back: int = 0


def make_turns(quaternions: IntArray, *changes: str) -> Turns:
    """Return functions of quaternions if there are some: plain ones, "", or those along or back by their endings."""
    names = [kind + change for kind in ("turn", "rate") for change in changes if quaternions.size]
    return Turns(np.zeros(1), **{name: _load(name).address(name) for name in names})


@cache
def _load(name: str) -> LoadedObject:
    return load_program(name, "", lambda: _trace(name))


def _trace(name: str) -> Program:
    from fmd.dynamics.compiler.adjoints import differentiate_sum  # with all that traces, which kept code needs not
    from fmd.dynamics.compiler.tangents import direction_inputs

    graph, (kind, _, change) = Graph(), name.partition("_")
    arguments: tuple[str, ...] = ("step", "q", "v")
    q, v, w = ([graph.scalar_input(name, k) for k in range(n)] for name, n in (("q", 4), ("v", 3), ("weights", 4)))
    h, zero = graph.scalar_input("step", 0), graph.number(0.0)
    end = _turn(q, scale(0.5 * h, v)) if kind == "turn" else _product(q, [*scale(0.5, v), zero])
    if change == "back":
        outputs = []
        for number, value in differentiate_sum(graph, end, w).items():
            argument, place = graph.nodes[number].data  # type: ignore[misc]
            if argument in ("q", "v") and isinstance(value, Scalar):
                replaced = kind == "turn" and argument == "q"
                before = zero if replaced else graph.scalar_input(f"d{argument}", place[0])
                outputs.append(Output(before + value, (f"d{argument}", place)))
        return Program(name, graph, (*arguments, "weights", "dq", "dv"), tuple(outputs), in_place=True)
    lanes: tuple[str, ...] = ()
    outputs = [Output(x, ("end", (k,))) for k, x in enumerate(end)]
    if change == "tangents":
        slopes = differentiate(graph, end, direction_inputs(graph, ("q", "v")))
        outputs += [Output(x, ("dend", (k,))) for k, x in enumerate(slopes)]
        arguments, lanes = (*arguments, "dq", "dv"), ("dq", "dv", "dend")
    return Program(name, graph, (*arguments, "end", *lanes[2:]), tuple(outputs), lanes, in_place=True)


def _turn(e: Sequence[Scalar], u: Sequence[Scalar]) -> list[Scalar]:
    x = dot(u, u)
    c4, c5 = x.apply("stumpff4"), x.apply("stumpff5")
    c1 = 1.0 - x * (1.0 / 6.0 - x * c5)
    end = _product(e, [*scale(c1, u), 1.0 - x * (0.5 - x * c4)])
    size = dot(end, end).apply("sqrt").inverse()
    return scale(size, end)


def _product(e: Sequence[Scalar], f: Sequence[Scalar]) -> list[Scalar]:
    (*e_v, e_r), (*f_v, f_r) = e, f
    return [*add(scale(e_r, f_v), scale(f_r, e_v), cross(e_v, f_v)), e_r * f_r - dot(e_v, f_v)]
