"""Structure of a mechanism that saves its equations arithmetic, in words."""

from __future__ import annotations

from fmd.dynamics.compiler.bodies import trace_inertia
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.program import Program


def describe_structure(inputs: Coordinates, frames: list[MovingFrame], accelerations: Program) -> list[str]:
    """Return what saves a mechanism's equations arithmetic: plane motion, cyclic angles, constant inertia."""
    graph, lines = inputs.graph, list[str]()
    for axis, name in enumerate("xyz"):
        if all(x.is_zero for frame in frames for k, x in enumerate(frame.spin) if k != axis):
            lines.append(f"plane motion: every body turns about {name} alone")
            break
    reads = {node.data for node in (graph.nodes[k] for k in accelerations.nodes) if node.operation == "input"}
    for frame in frames:
        link, position = frame.link, int(inputs.mechanism.layout.position[frame.number])
        if link.joint.is_hinge and link.n_rates and ("q", (position,)) not in reads:
            lines.append(f"cyclic angle: accelerations don't depend on that of {link.name}")
        if not link.omega.size:
            continue
        inertia = trace_inertia(graph, frame)
        if all(row.constant is not None for row in inertia.W):
            lines.append(f"constant coupling of the frame of {link.name} with its modes")
        if all(x.constant is not None for row in inertia.J for x in row):
            lines.append(f"constant inertia of {link.name}")
    return lines
