"""A mechanism's equations as machine code: traced once, simplified, compiled when first wanted, kept on disk."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.memory import MOST_SHARED
from fmd.core.limits.rank import DEPENDENT_CONSTRAINT
from fmd.core.recently_used import RecentlyUsed
from fmd.dynamics.compiler.closures import ConstraintRow, trace_rows
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.digest import digest_mechanism
from fmd.dynamics.compiler.frames import MovingFrame, trace_frames
from fmd.dynamics.compiler.graph import Graph, Scalar
from fmd.dynamics.compiler.interpret import Evaluation, evaluation_of
from fmd.dynamics.compiler.program import LANES, Program
from fmd.dynamics.compiler.quantities import describe_structure
from fmd.dynamics.compiler.signal_code import digest_signals, load_signals, trace_signals_ahead
from fmd.dynamics.compiler.store import load_program
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import Signal
from fmd.kernels.machine import LoadedObject
from fmd.kernels.table import address_of

# By name and by the digest of what they are traced from: mechanisms that differ in joints' numbers share one.
_evaluations: RecentlyUsed[Evaluation] = RecentlyUsed(MOST_SHARED)


class CompiledMechanism:
    """Functions of a mechanism's state, each traced and compiled when it is first used; its constants are part of them.

    `fmd.dynamics.compiler.programs` lists them with their arguments, which `address` and `call` take as they are.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self._inputs = Coordinates(Graph(), mechanism)
        self._programs: dict[str, Program] = {}
        self._loaded: dict[str, LoadedObject] = {}
        self._loading = threading.RLock()  # two marches at once want the same functions

    @cached_property
    def _frames(self) -> list[MovingFrame]:
        return trace_frames(self._inputs)

    @cached_property
    def digest(self) -> str:
        """Digest of all constants that are part of the code."""
        return digest_mechanism(self._inputs)

    @cached_property
    def _signal_values(self) -> LoadedObject:
        return load_signals(self.signals)

    @cached_property
    def _signal_values_ahead(self) -> LoadedObject:
        motions = {link.motion for link in self.mechanism.links if link.motion is not None}
        motions |= {signal for effort in self.mechanism.functions for signal, order in effort.signals.items() if order}
        digest = digest_signals(self.signals) + "".join(str(int(signal in motions)) for signal in self.signals)
        return load_program("signals_ahead", digest, lambda: trace_signals_ahead(self.signals, motions))

    @cached_property
    def rows(self) -> list[ConstraintRow]:
        """Scalar constraints of a mechanism with loops, those that hold in every state left out."""
        return trace_rows(self._inputs, self._frames) if self.mechanism.closures else []

    def take_code_of(self, other: CompiledMechanism) -> None:
        """Take the functions of a mechanism that differs in `numbers` alone, traced and loaded, in place of its own."""
        self._programs, self._loaded, self._loading = other._programs, other._loaded, other._loading
        self._inputs.graph = other._inputs.graph  # of which the frames are, and programs that are still to be traced
        traced = ("_frames", "rows", "_signal_values", "_signal_values_ahead")
        vars(self).update({name: value for name, value in vars(other).items() if name in traced})

    def trace_like(self, other: CompiledMechanism) -> None:
        """Trace what another has traced, in its order: functions share a graph, on whose order their code depends."""
        for name in (*other._programs,):
            self.program(name)

    def with_numbers(self, numbers: Array) -> Mechanism:
        """Return the mechanism with other `numbers` of its joints."""
        links = [*self.mechanism.links]
        for (body, name), value in zip(self._inputs.numbers, numbers.tolist(), strict=True):
            change: dict[str, Any] = {name: value}
            if body >= 0:
                links[body] = replace(links[body], **change)
        return replace(self.mechanism, links=links)

    def program(self, name: str) -> Program:
        """Return a function as a traced program."""
        if name not in self._programs:
            from fmd.dynamics.compiler.programs import trace_program  # with all that traces, which kept code needs not

            self._programs[name] = trace_program(name, self._inputs, self._frames)
        return self._programs[name]

    def address(self, name: str) -> int:
        """Return the address of a function, valid while this object lives; compiles it, or reads it from disk."""
        return self._object(name).address(name)

    def n_bytes(self, name: str = "accelerations") -> int:
        """Return the size of a function's object file."""
        return self._object(name).n_bytes

    def _object(self, name: str) -> LoadedObject:
        with self._loading:
            if name == "signals":
                return self._signal_values
            if name == "signals_ahead":
                return self._signal_values_ahead
            if name not in self._loaded:
                self._loaded[name] = load_program(name, self.digest, lambda: self.program(name))
            return self._loaded[name]

    def call(self, name: str, *arrays: Array) -> None:
        """Call a function with its arrays, which have to be C-contiguous and of doubles."""
        _prototype(len(arrays))(self.address(name))(*map(address_of, arrays))

    def bound(self, name: str, *arrays: Array) -> Callable[[], None]:
        """Return a call of a function with arrays that stay where they are."""
        function, places = _prototype(len(arrays))(self.address(name)), [*map(address_of, arrays)]
        kept = (arrays, self._object(name))  # as long as the call is

        def call() -> None:
            function(*places[: len(kept[0])])

        return call

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Loads and motions that vary with time, in the order of the argument ``inputs``."""
        return self._inputs.signals

    @cached_property
    def numbers(self) -> Array:
        """Springs, rests and dampers of joints, then held values: what stands after the signals in ``inputs``."""
        return np.array(list(self._inputs.numbers.values()))

    def signal_values(self, t: float) -> Array:
        """Return the argument ``inputs`` at a time t [s], shape (3 n_signals + n_numbers,)."""
        out = np.concatenate([np.zeros(3 * len(self.signals)), self.numbers])
        if self.signals:
            self.call("signals", np.array([float(t)]), out)
        return out

    def accelerations(self, t: float, q: Array, v: Array) -> Array:
        """Return the accelerations, shape (n,), at a time t [s]."""
        a = np.zeros(self.mechanism.n)
        self.call("accelerations", self.signal_values(t), *_contiguous(q, v), a)
        return a

    def residual(self, t: float, q: Array, v: Array, a: Array) -> Array:
        """Return ``M̂ a − Q̂``, shape (n,), at a time t [s]."""
        r = np.zeros(self.mechanism.n)
        self.call("residual", self.signal_values(t), *_contiguous(q, v, a), r)
        return r

    def still_residuals(self, positions: Array) -> Array:
        """Return ``−Q̂`` at rest at time 0 at many positions (n_states, n_positions), shape (n_states, n)."""
        n, q = self.mechanism.n, np.zeros(positions.shape[1])
        found, r = np.empty((len(positions), n)), np.zeros(n)
        call = self.bound("residual", self.signal_values(0.0), q, np.zeros(n), np.zeros(n), r)
        for out, state in zip(found, positions, strict=True):
            q[:] = state
            call()
            out[:] = r
        return found

    def tangents(self, inputs: Array, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        """Return the residual's derivatives by q (n, n_positions), v (n, n) and a, which is ``M̂`` (n, n)."""
        found = self._tangents(inputs, q, v, a, slice(len(inputs), None))
        by_q, by_v, by_a = np.split(found, (len(q), len(q) + len(v)), axis=1)
        return by_q, by_v, by_a

    def input_tangents(self, inputs: Array, q: Array, v: Array, a: Array) -> Array:
        """Return the residual's derivatives by the argument ``inputs``, shape (n, 3 n_signals + n_numbers)."""
        return self._tangents(inputs, q, v, a, slice(len(inputs)))

    def _tangents(self, inputs: Array, q: Array, v: Array, a: Array, some: slice) -> Array:
        state = _contiguous(inputs, q, v, a)
        ends = np.cumsum([len(x) for x in state])

        def along(block: Array) -> Array:
            dr = np.zeros((len(v), LANES))
            self.call("tangents", *state, *np.split(block, ends[:-1]), dr)
            return dr

        return _in_blocks(along, np.eye(ends[-1])[:, some], len(v))

    def mass_matrix(self, inputs: Array, q: Array) -> Array:
        """Return ``M̂``, shape (n, n)."""
        (M,) = self.mass_matrices(inputs, np.asarray(q)[None])
        return np.asarray(M)

    def mass_matrices(self, inputs: Array, positions: Array) -> Array:
        """Return ``M̂`` at many positions (n_states, n_positions), shape (n_states, n, n)."""
        n, q = self.mechanism.n, np.zeros(positions.shape[1])
        units = np.eye(n, -(-n // LANES) * LANES)
        found, dr = np.empty((len(positions), *units.shape)), np.zeros((n, LANES))
        blocks = range(0, units.shape[1], LANES)
        calls = [self.bound("inertia", inputs, q, units[:, first : first + LANES].copy(), dr) for first in blocks]
        for M, state in zip(found, positions, strict=True):
            q[:] = state
            for first, call in zip(blocks, calls, strict=True):
                call()
                M[:, first : first + LANES] = dr
        return found[:, :, :n]

    def solve(self, t: float, q: Array, f: Array, name: str = "solve") -> Array:
        """Return ``M̂⁻¹ f`` for columns f (n, any), or by ``solve_fast`` or ``solve_slow``, all other rates frozen."""
        inputs, (positions,) = self.signal_values(t), _contiguous(q)

        def along(block: Array) -> Array:
            x = np.zeros(block.shape)
            self.call(name, inputs, positions, block, x)
            return x

        return _in_blocks(along, f, len(f))

    def residuals(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the constraints' residuals and rates, shape (n_rows,) each; lengths [m], angles [rad] or cosines."""
        g, rates = np.zeros((2, len(self.rows)))
        if len(g):
            self.call("residuals", self.signal_values(t), *_contiguous(q, v), g, rates)
        return g, rates

    def constraint_rates(self, t: float, q: Array) -> tuple[Array, Array]:
        """Return J of the constraints' rates ``J v + …``, shape (n_rows, n), and their rest (n_rows,).

        J is found by one rate after the other: by way of the inverse mass matrix, as `constraint_jacobian` finds it,
        massless combinations of modes spoil it.
        """
        n, g, rates = self.mechanism.n, *np.zeros((2, len(self.rows)))
        v, (positions,) = np.zeros(n), _contiguous(q)
        call = self.bound("residuals", self.signal_values(t), positions, v, g, rates)
        call()
        rest, J = rates.copy(), np.empty((len(rates), n))
        for k in range(n):
            v[k] = 1.0
            call()
            v[k], J[:, k] = 0.0, rates - rest
        return J, rest

    def multipliers(self, t: float, q: Array) -> tuple[Array, Array]:
        """Return ``M̂⁻¹ Jᵀ`` (n, n_rows) and ``J M̂⁻¹ Jᵀ`` (n_rows, n_rows) of the constraints."""
        n, inputs, (positions,) = self.mechanism.n, self.signal_values(t), _contiguous(q)

        def along(block: Array) -> Array:
            x, s = np.zeros((n, LANES)), np.zeros(block.shape)
            self.call("multipliers", inputs, positions, block, x, s)
            return np.concatenate([x, s])

        both = _in_blocks(along, np.eye(len(self.rows)), n + len(self.rows))
        return both[:n], both[n:]

    def compliances(self, q: Array) -> Array:
        """Return ``J M̂⁻¹ Jᵀ`` at positions (n_states, n_positions), shape (n_states, n_rows, n_rows).

        Nothing is compiled for it.
        """
        n_rows, n = len(self.rows), len(q) * len(self.rows)
        if not n_rows:
            return np.zeros((len(q), 0, 0))
        units = {"f": np.tile(np.eye(n_rows), (len(q), 1))}
        state = np.zeros(n), np.repeat(q, n_rows, axis=0), np.zeros((n, self.mechanism.n))
        return self._over("multipliers", *state, units)[:, -n_rows:].reshape(len(q), n_rows, n_rows).swapaxes(1, 2)

    def constraint_jacobian(self, t: float, q: Array) -> Array:
        """Return J of the constraints' rates ``J v + …``, shape (n_rows, n)."""
        X, _ = self.multipliers(t, q)
        return np.asarray(X.T @ self.mass_matrix(self.signal_values(t), q))

    def reactions(self, times: Array, q: Array, v: Array, multipliers: Array) -> Array:
        """Return force [N] and moment [N m] of joints that close loops, at many states, (n_times, n_joints, 2, 6).

        They act on the parent and on the child, in space, about the joint's places, by multipliers (n_times, n_rows).
        """
        return self._over("reactions", times, q, v, {"f": multipliers}).reshape(len(times), -1, 2, 6)

    def _over(self, name: str, times: Array, q: Array, v: Array, more: Mapping[str, Array]) -> Array:
        """Return what a program fills, in the order of its outputs, at many states by NumPy, (n_times, n_values)."""
        arguments = {**self._inputs.columns(times, q, v), **{key: values.T for key, values in more.items()}}

        def make() -> Evaluation:
            return evaluation_of([value for value, _ in self.program(name).outputs if isinstance(value, Scalar)])

        return _evaluations.get((name, self.digest), make).over(arguments, len(times))

    def constrained_accelerations(
        self, t: float, q: Array, v: Array, forces: Array | None = None, pushes: Sequence[Array] = ()
    ) -> tuple[Array, Array]:
        """Return accelerations (n,) that keep loops closed, and the smallest multipliers (n_rows,) that do it.

        Generalised forces (n,) may act beside those of the mechanism, and ``pushes`` of its contacts, on frames
        (n_bodies, 6), in their axes, and on modes (n,).
        """
        n_rows = len(self.rows)
        change = 0.0 if forces is None else self.solve(t, q, forces[:, None])[:, 0]
        state, a = (self.signal_values(t), *_contiguous(q, v)), np.zeros(self.mechanism.n)
        if not n_rows:
            self.call("pushed" if pushes else "accelerations", *state, *_contiguous(*pushes), a)
            return a + change, np.zeros(0)
        X, S = self.multipliers(t, q)
        units, room = np.zeros((n_rows, LANES)), np.zeros((n_rows, LANES))
        w, x = np.zeros(n_rows), np.zeros((self.mechanism.n, LANES))
        self.call("pushed_closed" if pushes else "closed", *state, units, *_contiguous(*pushes), a, w, x, room)
        if forces is not None:
            a, w = a + change, w + X.T @ forces
        scale = np.sqrt(np.maximum(S.diagonal(), 1e-300))
        smallest = -np.linalg.lstsq(S / np.outer(scale, scale), w / scale, rcond=DEPENDENT_CONSTRAINT)[0] / scale
        return a + X @ smallest, smallest

    def joint_loads(
        self, times: Array, q: Array, v: Array, a: Array, multipliers: Array, pushes: Sequence[Array] = ()
    ) -> tuple[Array, Array]:
        """Return accelerations of frames and loads of joints, (n_times, n_bodies, 6) and (n_times, n_bodies, 2, 6).

        Loads are force and moment on the parent, about the joint's place, and on the body, about its origin. All are in
        space [m/s², rad/s², N, N m], at states with accelerations and Lagrange multipliers (n_times, n_rows). Contacts
        push frames, in their axes, and modes: ``pushes``, (n_times, n_bodies, 6) and (n_times, n).
        """
        more = dict(zip(("push", "modal"), (own.reshape(len(times), -1) for own in pushes), strict=bool(pushes)))
        values = self._over("joint_loads", times, q, v, {"a": a, "f": multipliers, **more})
        values = values.reshape(len(times), -1, 3, 6)
        return values[:, :, 0], values[:, :, 1:]

    def frames(self, t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return the bodies' origins (n_bodies, 3), rotations (n_bodies, 3, 3) and angular velocities in space."""
        n = len(self.mechanism.links)
        origins, rotations, spins = np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3))
        self.call("frames", self.signal_values(t), *_contiguous(q, v), origins, rotations, spins)
        return origins, rotations, spins

    def energies(self, t: float, q: Array, v: Array) -> tuple[float, float]:
        """Return the kinetic and the potential energy [J]."""
        out = np.zeros(2)
        self.call("energies", self.signal_values(t), *_contiguous(q, v), out)
        return float(out[0]), float(out[1])

    def momenta(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the linear momentum and the angular momentum about the origin, in space."""
        out = np.zeros(6)
        self.call("momenta", self.signal_values(t), *_contiguous(q, v), out)
        return out[:3], out[3:]

    def flops(self, name: str = "accelerations") -> int:
        """Return the number of additions and multiplications of one call."""
        return self.program(name).flops

    @property
    def structure(self) -> list[str]:
        """Structure that simplification makes use of, a line each."""
        return describe_structure(self._inputs, self._frames, self.program("accelerations"))


def compile_mechanism(mechanism: Mechanism) -> CompiledMechanism:
    """Make the compiled functions of a mechanism; each compiles when it is first used, or is read from disk."""
    return CompiledMechanism(mechanism)


@cache
def _prototype(n_arrays: int) -> Any:
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * n_arrays)


def _contiguous(*arrays: Array) -> list[Array]:
    return [np.ascontiguousarray(array, dtype=float) for array in arrays]


def _in_blocks(along: Callable[[Array], Array], columns: Array, n_rows: int) -> Array:
    """Apply a function that takes eight columns, and returns them with so many rows, to any number of them."""
    n, n_columns = columns.shape
    filled = np.zeros((n, -(-n_columns // LANES) * LANES))
    filled[:, :n_columns] = columns
    blocks = [along(filled[:, first : first + LANES].copy()) for first in range(0, n_columns, LANES)]
    return np.concatenate([np.zeros((n_rows, 0)), *blocks], axis=1)[:, :n_columns]
