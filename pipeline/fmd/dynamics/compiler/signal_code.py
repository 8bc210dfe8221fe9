"""Loads and motions as a program: value, rate and acceleration of each signal at a time."""

import hashlib
from collections.abc import Collection, Sequence

from fmd.dynamics.compiler.graph import Graph, Scalar, total
from fmd.dynamics.compiler.program import Output, Program
from fmd.dynamics.compiler.store import load_program
from fmd.dynamics.signals.signal import TABLE, Signal
from fmd.kernels.machine import LoadedObject


def digest_signals(signals: Sequence[Signal]) -> str:
    """Return the digest of all that the code of signals depends on."""
    return hashlib.blake2b(repr([signal.terms for signal in signals]).encode(), digest_size=16).hexdigest()


def load_signals(signals: Sequence[Signal]) -> LoadedObject:
    """Return the machine code of `trace_signals`."""
    return load_program("signals", digest_signals(signals), lambda: trace_signals(signals))


def trace_signals(signals: Sequence[Signal]) -> Program:
    """Trace the program ``signals`` of the argument ``time`` (1,), which fills three ``inputs`` for each signal."""
    graph = Graph()
    time = graph.scalar_input("time", 0)
    acting = [term.trace_activity(time) for signal in signals for term in signal.terms]
    guard = total(acting) if acting and all(x.constant is None for x in acting) else None
    return Program("signals", graph, ("time", "inputs"), _values(signals, time), guard=guard)


def trace_signals_ahead(signals: Sequence[Signal], motions: Collection[Signal]) -> Program:
    """Trace the program ``signals_ahead``, which does the same at eight steps, into eight entries for each input.

    Rates and accelerations are those of motions alone; nothing depends on a load's.
    ``start`` (2,) has the number of the first and the length of a step, ``numbers`` (8,) 0 … 7.
    """
    graph = Graph()
    time = (graph.scalar_input("start", 0) + graph.scalar_input("numbers", 0)) * graph.scalar_input("start", 1)
    arguments = ("start", "numbers", "inputs")
    values = _values(signals, time)
    used = tuple(values[3 * k + j] for k, signal in enumerate(signals) for j in range(3 if signal in motions else 1))
    return Program("signals_ahead", graph, arguments, used, lanes=arguments[1:])


def _values(signals: Sequence[Signal], time: Scalar) -> tuple[Output, ...]:
    values = [value for signal in signals for value in signal.trace(time)]
    return tuple(Output(value, ("inputs", (k,))) for k, value in enumerate(values))


def are_smooth(signals: Sequence[Signal]) -> bool:
    """Tell whether no signal has a table, whose pieces aren't found at eight times at once."""
    return not any(term.kind == TABLE for signal in signals for term in signal.terms)
