"""A whole major cycle by carried forces as one program: one evaluation, and a linear map of each coordinate.

``maps`` (17, any) has five rows for each of a coordinate's way, its rate at the end and its last acceleration: by rate,
position, the forces of the two cycles before, and acceleration at the begin. Then follow the diagonal stiffness, and
half of each coordinate's step. Slow coordinates have rows, too, so that bodies' vectors stay whole. Accelerations are
the last term of each sum, so that all else is ready when they are known.
"""

from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.cycle import in_places
from fmd.dynamics.compiler.forces import ActingForces
from fmd.dynamics.compiler.frames import trace_frames
from fmd.dynamics.compiler.graph import Graph, Vector, combine, total
from fmd.dynamics.compiler.oscillators import as_vector
from fmd.dynamics.compiler.program import Output
from fmd.dynamics.compiler.recursion import trace_accelerations
from fmd.kernels.table import whole_lines


def trace_carried_cycle(inputs: Coordinates) -> list[Output]:
    """Trace a cycle, the forces that it leaves in ``memory``, and the sum of the squares of its rates."""
    graph, carrying, outputs = inputs.graph, inputs.carrying, list[Output]()
    frames = trace_frames(carrying)
    for places, value in in_places(
        inputs.mechanism, trace_accelerations(frames, ActingForces(carrying, frames))
    ).items():
        graph.mark()
        outputs += _cross(graph, inputs.mechanism.n, places, as_vector(value))
    rates = [as_vector(output.value) for output in outputs if output.place[0] == "v"]
    return [*outputs, Output(total(v.dot(v) for v in rates), ("square", (0,)))]


def _cross(graph: Graph, n: int, places: tuple[int, ...], a: Vector) -> list[Output]:
    """Trace some coordinates over a cycle by their accelerations at its begin."""

    def read(name: str, first: int = 0) -> Vector:
        return graph.vector_input(name, [first + place for place in places])

    def times(row: int, x: Vector) -> tuple[float, Vector]:
        return 1.0, read("maps", row * whole_lines(n)).times(x)

    v, q, before = read("v"), read("q"), read("memory")
    known = (v, q, before, read("memory", n), a)
    way, rate, last = ([times(5 * part + k, x) for k, x in enumerate(known)] for part in range(3))
    ends = {"begin": a, "q": combine([(1.0, q), *way]), "v": combine(rate), "a": combine(last)}
    force = combine([(1.0, a), times(15, q)])
    following = Output(before, ("memory", tuple(n + place for place in places)))
    return [*(Output(x, (name, places)) for name, x in ends.items()), Output(force, ("memory", places)), following]
