"""Equations of motion and constraints at a state, differentiated exactly and evaluated without compiling them.

With Lagrange multipliers λ the equations are ``r = M̂ a − Q̂ − Jᵀ λ = 0``, ``ġ = 0`` and ``g̈ = J a + … = 0``. Their
derivatives are those of the same graph that is compiled for a march; one state is evaluated faster than code is made of
it.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.rank import REDUNDANT_EQUATION
from fmd.dynamics.compiler.closures import ConstrainedForces, ConstraintRow, trace_rows
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.forces import ActingForces
from fmd.dynamics.compiler.frames import MovingFrame, trace_frames
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector
from fmd.dynamics.compiler.interpret import Evaluation, evaluation_of
from fmd.dynamics.compiler.recursion import BodyValues
from fmd.dynamics.compiler.residual import trace_motion, trace_residual
from fmd.dynamics.compiler.tangents import direction_inputs
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import Signal

_ARGUMENTS = ("inputs", "q", "v", "a", "f")


class Tangents(NamedTuple):
    """Accelerations at a state, and the derivatives of the equations and of the constraints there."""

    a: Array  # (n,): accelerations
    M: Array  # (n, n): ∂r/∂a
    by_v: Array  # (n, n): ∂r/∂v
    by_q: Array  # (n, n_positions): ∂r/∂q
    by_signals: Array  # (n, n_signals): ∂r by the values of the varying signals, in their order
    J: Array  # (n_rows, n): ∂g̈/∂a
    rates_by_q: Array  # (n_rows, n_positions): ∂ġ/∂q
    accelerations_by_q: Array  # (n_rows, n_positions): ∂g̈/∂q
    accelerations_by_v: Array  # (n_rows, n): ∂g̈/∂v


class LinearisedMechanism:
    """A mechanism whose equations can be differentiated at any state, with some rates' accelerations given.

    It has no prescribed motions: their joints are coordinates whose accelerations are given.
    """

    def __init__(self, mechanism: Mechanism, given: IntArray) -> None:
        self.mechanism, self.given = mechanism, given
        inputs = Coordinates(Graph(), mechanism)
        frames = trace_frames(inputs)
        rows = trace_rows(inputs, frames) if mechanism.closures else []
        acting = ConstrainedForces(inputs, frames, rows) if rows else ActingForces(inputs, frames)
        self.n_rows, self.signals = len(rows), inputs.signals
        self._numbers = np.array(list(inputs.numbers.values()))
        values, self._places = _trace(inputs, frames, acting, rows)
        self._values = evaluation_of(values)
        self._slopes, self._slopes_by_a = (
            evaluation_of(differentiate(inputs.graph, values, direction_inputs(inputs.graph, names)))
            for names in (_ARGUMENTS, ("a",))
        )

    def accelerations(
        self, q: Array, v: Array, signals: Mapping[Signal, Sequence[float]], given: Array
    ) -> tuple[Array, Array]:
        """Return accelerations (n,) and the constraints' multipliers (n_rows,) at a state, given as for `tangents`."""
        n, m = self.mechanism.n, self.n_rows
        a, f = np.zeros(n), np.zeros(m)
        a[self.given] = given
        state = (self._inputs(signals), q, v, a, f)
        left = self._evaluate(self._values, dict(zip(_ARGUMENTS, state, strict=True)), ())
        by_a = self._derivatives(self._slopes_by_a, ("a",), state)
        return self._solve(by_a[:n], by_a[n + m :], left[:n], left[n + m :], a)

    def tangents(
        self, q: Array, v: Array, signals: Mapping[Signal, Sequence[float]], given: Array, frozen: Array | None = None
    ) -> Tangents:
        """Return accelerations and derivatives at positions (n_positions,) and rates (n,).

        Varying signals have values, rates and accelerations, which loads by the state may depend on; ``given`` are the
        accelerations of the rates that are given. ``frozen`` are those of all rates (n,), if forces that don't vary
        keep a mechanism without loops so.
        """
        n, m = self.mechanism.n, self.n_rows
        a, f = self.accelerations(q, v, signals, given) if frozen is None or m else (frozen, np.zeros(m))
        state = (self._inputs(signals), q, v, a, f)
        by_all = self._derivatives(self._slopes, _ARGUMENTS, state)
        by = dict(zip(_ARGUMENTS, np.split(by_all, np.cumsum([len(x) for x in state])[:-1], axis=1), strict=True))
        r, rates, second = slice(0, n), slice(n, n + m), slice(n + m, n + 2 * m)
        return Tangents(
            a,
            by["a"][r],
            by["v"][r],
            by["q"][r],
            by["inputs"][r, : 3 * len(self.signals) : 3],
            by["a"][second],
            by["q"][rates],
            by["q"][second],
            by["v"][second],
        )

    def _solve(self, M: Array, J: Array, r: Array, w: Array, a: Array) -> tuple[Array, Array]:
        """Solve for the accelerations that aren't given and the smallest multipliers."""
        free = np.setdiff1d(np.arange(self.mechanism.n), self.given)
        if not free.size:
            return a, np.zeros(len(w))
        scale = 1.0 / np.sqrt(M.diagonal()[free])
        own, rows = M[np.ix_(free, free)] * np.outer(scale, scale), J[:, free] * scale
        sizes = np.maximum(np.linalg.norm(rows, axis=1), 1e-300)
        rows = rows / sizes[:, None]
        whole = np.block([[own, -rows.T], [rows, np.zeros((len(w), len(w)))]])
        x = np.linalg.lstsq(whole, -np.concatenate([r[free] * scale, w / sizes]), rcond=REDUNDANT_EQUATION)[0]
        out = a.copy()
        out[free] = x[: len(free)] * scale
        return out, x[len(free) :] / sizes

    def _inputs(self, signals: Mapping[Signal, Sequence[float]]) -> Array:
        """Return what inputs of the equations read: values of signals with two derivatives each, and numbers."""
        values = [value for signal in self.signals for value in signals[signal]]
        return np.concatenate([np.array(values, dtype=float), self._numbers])

    def _derivatives(self, slopes: Evaluation, names: Sequence[str], state: Sequence[Array]) -> Array:
        """Return the derivatives of all values by the entries of some arguments at a state, one after the other."""
        arguments = dict(zip(_ARGUMENTS, state, strict=True))
        sizes = [len(arguments[name]) for name in names]
        blocks = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1])
        directions = {f"d{name}": block for name, block in zip(names, blocks, strict=True)}
        return self._evaluate(slopes, arguments | directions, (sum(sizes),))

    def _evaluate(self, values: Evaluation, arguments: Mapping[str, Array], lanes: tuple[int, ...]) -> Array:
        """Return values in the order of rates, rates of residuals, accelerations of residuals."""
        out = np.zeros((self.mechanism.n + 2 * self.n_rows, *lanes))
        for place, value in zip(self._places, values.at(arguments), strict=True):
            out[place] = value
        return out


def _trace(
    inputs: Coordinates, frames: list[MovingFrame], acting: ActingForces, rows: list[ConstraintRow]
) -> tuple[list[Scalar | Vector], list[int | IntArray]]:
    """Trace residual, rates and accelerations of residuals, with the place of each value among all."""
    mechanism = inputs.mechanism
    values: list[Scalar | Vector] = []
    places: list[int | IntArray] = []
    for number, body in enumerate(trace_residual(inputs, frames, acting)):
        first = int(mechanism.layout.rate[number])
        values += body.joint
        places += [first + k for k in range(len(body.joint))]
        if body.modes.size:
            values.append(body.modes)
            places.append(mechanism.modes_of(number))
    x = trace_motion(inputs, frames, acting) if rows else []
    motion = [
        BodyValues(inputs.inputs_of_joint(k, "a"), inputs.inputs_of_modes(k, "a"), body) for k, body in enumerate(x)
    ]
    values += [row.rate(inputs) for row in rows]
    values += [row.acceleration(inputs, acting.ground, motion) + row.bias for row in rows]
    places += [mechanism.n + k for k in range(2 * len(rows))]
    return values, places
