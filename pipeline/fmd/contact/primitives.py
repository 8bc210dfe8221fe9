"""Surfaces of rigid bodies: points with a radius, and balls, boxes, pins and bores that points may touch."""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass

PLANE, BALL, BOX, PIN, BORE = range(5)
"""Kinds of primitives, as kernels know them; those from `PIN` on have an axis."""


@dataclass(frozen=True)
class Primitive:
    """A surface of a rigid body that points may touch, known by its distance from any place."""

    kind: int  # `BALL`, `BOX`, `PIN` or `BORE`
    at: tuple[float, float, float]  # its middle in the body's frame [m]
    # Rows: directions in the body's frame, the last one along the axis of a pin or a bore.
    axes: tuple[tuple[float, float, float], ...]
    # Half extents of what is round about it along these [m]: a box without its rounding, an axis, a point.
    half: tuple[float, float, float]
    radius: float  # distance of the surface from that [m]

    @property
    def edge_middles(self) -> Array:
        """Middles of a box's edges in the body's frame, shape (12, 3), without its rounding.

        Number e is along axis ``e // 4``, on the side of the two next ones that its last two bits say.
        """
        corners = np.zeros((12, 3))
        for e in range(12):
            for step in (1, 2):
                axis = (e // 4 + step) % 3
                corners[e, axis] = self.half[axis] * (1.0 if e & step else -1.0)
        return np.asarray(np.array(self.at) + corners @ np.array(self.axes))

    @property
    def row(self) -> Array:
        """All numbers that kernels read, shape (17,)."""
        return np.concatenate([[self.kind], self.at, np.ravel(self.axes), self.half, [self.radius]])


@dataclass(frozen=True)
class RoundPoints:
    """Points of a rigid body, each the centre of a ball or of a piece of a pin."""

    x: Array  # (n, 3): centres in the body's frame [m]
    radius: float  # distance of the surface from them [m]
    shares: Array  # (n,): part of the law's force that each has at a depth: 1 of a ball, less of the pieces of a pin
    length: float = 0.0  # length of a pin [m]; 0 of balls
    of_edges: bool = False  # true if they are on edges of a box, wherever these cross edges of another
