"""How deep rigid surfaces go into faces of flexible bodies between the nodes, which alone touch them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.contact.primitives import BORE, BOX, PIN, Primitive
from fmd.core.limits.contact import BETWEEN_NODES, DEPTH_FRAMES, PLACES_ON_SIDE, PLACES_ON_SURFACE, UNSEEN_DEPTH

if TYPE_CHECKING:
    from fmd.contact.touching_body import ContactPair, TouchingBody
    from fmd.core.arrays import Array
    from fmd.recovery.motion import Motion
    from fmd.stages.pipeline import Pipeline


def distances_from(surface: Primitive, x: Array) -> Array:
    """Return how far places are from a rigid surface, negative in its body [m], (n,); infinite beyond ends of an axis.

    Places x (n, 3) are in the body's frame [m].
    """
    along, half = (x - np.array(surface.at)) @ np.array(surface.axes).T, np.array(surface.half)
    beside = along - np.clip(along, -half, half)
    apart = np.asarray(np.linalg.norm(beside, axis=1))
    if surface.kind == BOX:
        apart = np.where(apart > 0.0, apart, (np.abs(along) - half).max(axis=1))
    gaps = (surface.radius - apart) if surface.kind == BORE else apart - surface.radius
    return np.where(beside[:, 2] == 0.0, gaps, np.inf) if surface.kind >= PIN else np.asarray(gaps)


def describe_depths(run: Pipeline, motion: Motion) -> dict[str, str]:
    """Return warnings of contacts whose rigid surface goes deeper between a face's nodes than these tell, by name."""
    found = {}
    bodies = {own.body: own for own in motion.mechanism.contacts}
    for body in bodies.values():
        for pair in body.pairs:
            theirs = bodies[pair.other].points.primitives
            if body.body not in run.parts or pair.other_face not in theirs:
                continue
            surface = theirs[pair.other_face]
            size = surface.radius if surface.kind != BOX else 2.0 * (min(surface.half) + surface.radius)
            depth = _depth_between(run, motion, body, pair, surface, size)
            if depth > UNSEEN_DEPTH * size:
                found[pair.name] = (
                    f"contact.{pair.name}: {pair.other}.{pair.other_face} goes up to {depth:.3g} m deeper into "
                    f"{body.body}.{pair.face} between its nodes, which alone touch it; elements of at most "
                    f"{BETWEEN_NODES * surface.radius:.3g} m there help"
                )
    return found


def _depth_between(
    run: Pipeline, motion: Motion, body: TouchingBody, pair: ContactPair, surface: Primitive, size: float
) -> float:
    """Return by how much a face's triangles are deeper in a rigid surface of a size than its nodes are at most [m]."""
    part, reduced = run.parts[body.body], run.bodies[body.body]
    nodes, topology = part.markers[pair.face].nodes, part.surface
    triangles = topology.nodes[topology.triangles]
    triangles = triangles[np.isin(triangles, nodes).all(axis=1)]
    numbers = [motion.mechanism.number_of(name) for name in (body.body, pair.other)]
    own, other = (motion.kinematics.frames[k] for k in numbers)
    q, deepest = motion.modal(body.body), 0.0
    reach = float(np.linalg.norm(reduced.x[triangles[:, 0]] - reduced.x[triangles[:, 1]], axis=1).max(initial=0.0))
    weights = _weights(int(np.clip(PLACES_ON_SURFACE * reach / size, *PLACES_ON_SIDE)))
    for t in np.unique(np.linspace(0, len(motion.times) - 1, DEPTH_FRAMES).astype(int)):
        x = reduced.x + np.einsum("nam,m->na", reduced.shapes, q[t])
        there = (own.origin[t] + x @ own.rotation[t].T - other.origin[t]) @ other.rotation[t]
        gaps = distances_from(surface, there[triangles].reshape(-1, 3)).reshape(-1, 3) + pair.clearance
        near = gaps.min(axis=1, initial=np.inf) < reach
        if near.any():
            places = np.einsum("wc,nca->nwa", weights, there[triangles[near]]).reshape(-1, 3)
            between = float(distances_from(surface, places).min()) + pair.clearance
            deepest = max(deepest, min(0.0, float(gaps.min())) - between)
    return deepest


def _weights(count: int) -> Any:
    """Return weights of a triangle's corners at places spread over it, so many to a side."""
    return np.array([(i, j, count - i - j) for i in range(count + 1) for j in range(count + 1 - i)]) / count
