"""Loads and motions as a program: value, rate and acceleration of each signal at a time."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from fmd.dynamics.compiler.graph import Graph, total
from fmd.dynamics.compiler.program import Output, Program
from fmd.dynamics.signals.signal import Signal


def digest_signals(signals: Sequence[Signal]) -> str:
    """Return the digest of all that the code of signals depends on."""
    return hashlib.blake2b(repr([signal.terms for signal in signals]).encode(), digest_size=16).hexdigest()


def trace_signals(signals: Sequence[Signal]) -> Program:
    """Trace the program ``signals`` of the argument ``time`` (1,), which fills three ``inputs`` for each signal."""
    graph = Graph()
    time = graph.scalar_input("time", 0)
    values = [value for signal in signals for value in signal.trace(time)]
    acting = [term.trace_activity(time) for signal in signals for term in signal.terms]
    guard = total(acting) if acting and all(x.constant is None for x in acting) else None
    outputs = tuple(Output(value, ("inputs", (k,))) for k, value in enumerate(values))
    return Program("signals", graph, ("time", "inputs"), outputs, guard=guard)
