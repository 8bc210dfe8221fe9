"""How loads by a mechanism's own state change with it, in the reference state."""

from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.frames import trace_frames
from fmd.dynamics.compiler.graph import Graph
from fmd.dynamics.compiler.interpret import evaluation_of
from fmd.dynamics.compiler.residual import trace_residual
from fmd.dynamics.compiler.tangents import direction_inputs, flatten
from fmd.dynamics.mechanism import Mechanism

_ARGUMENTS = ("q", "v")


def effort_tangents(mechanism: Mechanism) -> tuple[Array, Array]:
    """Return stiffness and damping (n, n) by loads that depend on the state, as if they alone acted on the tree.

    They are the derivatives of ``−Q`` by positions and rates with all joints at their places in the undeformed
    mechanism, at rest at time 0. Turning in space has no stiffness here.
    """
    tree = replace(mechanism, closures=())
    bare = replace(
        tree,
        links=[replace(link, effort=None) for link in tree.links],
        loads=[replace(load, effort=None) for load in tree.loads],
    )
    with_them, without = _tangents(tree), _tangents(bare)
    by_q, by_v = (a - b for a, b in zip(with_them, without, strict=True))
    K, positions = np.zeros((mechanism.n, mechanism.n)), mechanism.position_of_rates
    moved = positions >= 0
    K[:, moved] = by_q[:, positions[moved]]
    return K, by_v


def _tangents(mechanism: Mechanism) -> tuple[Array, Array]:
    """Return the derivatives of the residual at rest by positions (n, n_positions) and rates (n, n)."""
    inputs = Coordinates(Graph(), mechanism)
    residual = trace_residual(inputs, trace_frames(inputs))
    slopes = differentiate(inputs.graph, flatten(residual), direction_inputs(inputs.graph, _ARGUMENTS))
    n, n_positions = mechanism.n, mechanism.n_positions
    along, rest = np.eye(n_positions + n), (mechanism.rest_positions[None], np.zeros((1, n)))
    arguments = {
        **{name: column[:, 0] for name, column in inputs.columns(np.zeros(1), *rest).items()},
        "a": np.zeros(n),
        "dq": along[:n_positions],
        "dv": along[n_positions:],
    }
    found = iter(evaluation_of(slopes).at(arguments))
    out = np.zeros((n, n_positions + n))
    for number, body in enumerate(residual):
        first = int(mechanism.layout.rate[number])
        for k in range(len(body.joint)):
            out[first + k] = next(found)
        out[mechanism.modes_of(number)] = next(found)
    return out[:, :n_positions], out[:, n_positions:]
