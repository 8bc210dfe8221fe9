"""Places of a part where stress has no limit: around points and edges through which forces enter it.

Under a force on a point stress grows as 1/r², beside one on an edge as 1/r (Kelvin; Flamant), so each finer mesh shows
more of it. The largest stress is that of the rest of the surface.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import BoolArray
from fmd.core.limits.recovery import BESIDE_POINT
from fmd.scene.places import MarkerPlace

if TYPE_CHECKING:
    from fmd.scene.scene import Scene
    from fmd.stages.part import FlexiblePart


def loaded_points(scene: Scene, part: FlexiblePart) -> tuple[str, ...]:
    """Return the names of a part's markers at points and on edges that joints, loads or force elements act on."""
    places = scene.loaded_places
    return tuple(
        name
        for name, place in part.shape.marker.items()
        if f"{part.name}.{name}" in places
        and isinstance(place, MarkerPlace)
        and not place.is_face
        and place.link is None  # whose forces enter through a face
    )


def limitless_nodes(scene: Scene, part: FlexiblePart) -> BoolArray:
    """Return for each node of a part's surface whether its stress grows with each refinement, shape (n_nodes,).

    These are the nodes of the elements around loaded points and edges, and those within half the edge of a cube of the
    part's volume, so that meshes of any size leave out the same.
    """
    nodes, names = part.surface.nodes, loaded_points(scene, part)
    if not names:
        return np.zeros(len(nodes), dtype=bool)
    around = np.zeros(len(part.space.x), dtype=bool)
    radius = BESIDE_POINT * float(part.space.volumes.sum()) ** (1 / 3)
    for name in names:
        marker = part.markers[name]
        seeds = marker.nodes[marker.translation_weights != 0.0]
        for own in part.space.members:
            nodes_of = own.first + own.space.element_nodes
            around[nodes_of[np.isin(nodes_of, seeds).any(axis=1)]] = True
        distance = np.linalg.norm(part.space.x[:, None] - part.space.x[seeds], axis=2).min(axis=1)
        around |= distance < radius
    return np.zeros(len(nodes), dtype=bool) if around[nodes].all() else around[nodes]
