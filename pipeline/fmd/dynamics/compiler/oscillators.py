"""Leapfrog steps of oscillators that don't couple, over a whole major cycle: an operation of a graph.

After a first step by the acceleration b at the cycle's begin, each goes on by
``a = b + slope τ + Σ lever δu − k e − c (w − w₀)``: e is its way since the begin, w its rate half a step later, δu how
far a load is from its value at the begin. In units of a step, with ``z = h² k`` and without damping, the way after j
steps is ``d u_j + b S_j + g R_j`` for the increment d that it came with and the slope g: u_j are Chebyshev's
polynomials of the second kind of ``1 − z/2``, by ``u_{j+1} = (2 − z) u_j − u_{j−1}``, S_j and R_j their sums and the
sums of these. So nothing is divided by k, which may be 0. The number of steps in a whole cycle is known when it is
compiled, and j is doubled up to it: ``u_{2j} = u_j (u_{j+1} − u_{j−1})``, ``S_{2j} = u_j (u_{j+1} + u_j)`` and
``R_{2j} = 2 R_j + u_j (2 S_j − u_j)``. A load that changes at step s adds ``u_{j−s}`` times the change, for which
the polynomials follow one after the other, as they do up to a sample. With damping a recurrence of three terms would
take as many operations as the steps themselves, so these are taken one by one, and what varying loads add is stepped
from rest beside them.
"""

from collections.abc import Mapping

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiler.graph import Scalar, Vector, combine
from fmd.dynamics.compiler.program import LANES


@dataclass(frozen=True)
class Oscillators:
    """Oscillators at a cycle's begin, vectors of one size; each force is one over the mass, but for its sign."""

    x: Vector  # positions
    v: Vector  # rates half a step before them
    a: Vector  # accelerations
    inverse_mass: Vector  # 1 over their masses
    by_positions: Vector  # how their residual changes with positions
    drift: Vector  # how it changes with time
    # Accelerations and how it changes with time by each of them beside the drift: they are known late, so that what
    # they are multiplied by is made ready first.
    late: tuple[tuple[Scalar, Vector], ...]
    damping: tuple[Vector, ...]  # how it changes with rates, and the rates w₀; empty without damping
    levers: tuple[tuple[int, Vector], ...]  # numbers of loads in the argument ``inputs``, and how it changes with each

    def take_steps(self, n_inputs: int, count: int) -> tuple[Vector, Vector, Vector]:
        """Return positions, rates and the last accelerations at the cycle's end; most cycles have ``count`` steps.

        The argument ``steps`` has the fast step, the cycle, the number of steps in it, through how many of them loads
        vary, which is none or all but the first, and which step the first one is of those whose loads the argument
        ``ahead`` has: ``n_inputs`` to eight steps.
        """
        graph = self.x.graph
        scalars = [graph.scalar_input("steps", k) for k in (0, 2, 3, 4)]
        scalars += [graph.scalar_input("inputs", number) for number, _ in self.levers]
        scalars += [factor for factor, _ in self.late]
        vectors = [self.x, self.v, self.a, self.inverse_mass, self.by_positions, self.drift, *self.damping]
        vectors += [vector for _, vector in (*self.late, *self.levers)]
        arguments = (*(x.node for x in scalars), *(x.node for x in vectors))
        data = ("ahead", (count, n_inputs, len(self.damping), len(self.late), *(number for number, _ in self.levers)))
        names = ("oscillated x", "oscillated v", "oscillated a")
        x, v, a = (Vector(graph, graph.add(name, arguments, data, self.x.size), self.x.size) for name in names)
        return x, v, a


OSCILLATED = ("oscillated x", "oscillated v", "oscillated a")
"""Operations of nodes that `Oscillators.take_steps` makes."""


def step_oscillators(
    which: str, data: tuple[str, tuple[int, ...]], arguments: Mapping[str, Array], *values: Array
) -> Array:
    """Evaluate one of `OSCILLATED` by its steps, one after the other, at one state."""
    _, n_inputs, n_damping, n_late, *numbers = data[1]
    h, count, varying, first = (float(np.ravel(x)[0]) for x in values[:4])
    n_scalars = 4 + len(numbers) + n_late
    begin, factors = values[4 : 4 + len(numbers)], values[4 + len(numbers) : n_scalars]
    vectors = [np.ravel(x) for x in values[n_scalars:]]
    x, v, a, inverse_mass, by_positions, drift, *rest = (
        np.broadcast_to(each, np.shape(vectors[0])) for each in vectors
    )
    damping, late, levers = rest[:n_damping], rest[n_damping : n_damping + n_late], rest[n_damping + n_late :]
    drift = drift + sum(np.ravel(factor)[0] * vector for factor, vector in zip(factors, late, strict=True))
    k, slope = inverse_mass * by_positions, -inverse_mass * drift
    c, w = (inverse_mass * damping[0], damping[1]) if damping else (0.0, 0.0)
    constant = a + k * x + c * w
    for step in range(int(count)):
        if step:
            a_before, a = a, constant + slope * step * h - k * x
            if damping:
                a = a - c * (v + 0.5 * h * a_before)
            for number, start, lever in zip(numbers, begin, levers, strict=True):
                if step <= varying:
                    block, lane = divmod(int(first) + step, LANES)
                    value = np.ravel(arguments["ahead"])[(block * n_inputs + number) * LANES + lane]
                    a = a - inverse_mass * lever * (value - np.ravel(start)[0])
        v = v + h * a
        x = x + h * v
    return np.asarray({"x": x, "v": v, "a": a}[which[-1]])[:, None]


def as_vector(value: Scalar | Vector) -> Vector:
    """Return a scalar as a vector with one entry, a vector as it is."""
    return value if isinstance(value, Vector) else combine([(value, value.graph.array([1.0]))])
