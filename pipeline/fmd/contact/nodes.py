"""Nodes of bodies that touch something, as they move with their body's frame and modes."""

from __future__ import annotations

import math

from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array
from fmd.kernels.kernel import inner


@inner
def place_node(c: ContactTable, k: int, body: int, q: Array, origins: Array, rotations: Array) -> None:
    """Find a node's place in space at positions q, once a state."""
    if c.placed[k] == c.state[0]:
        return
    c.placed[k] = c.state[0]
    link = c.link[body]
    x0, x1, x2 = c.x[k, 0], c.x[k, 1], c.x[k, 2]
    for m in range(c.n_modes[body]):
        size = q[c.mode[body, m] + c.shift]
        x0 += c.shapes[k, 0, m] * size
        x1 += c.shapes[k, 1, m] * size
        x2 += c.shapes[k, 2, m] * size
    for j in range(c.felt.shape[1]):
        size = c.felt[body, j]
        x0 += c.yields[k, 0, j] * size
        x1 += c.yields[k, 1, j] * size
        x2 += c.yields[k, 2, j] * size
    for a in range(3):
        R0, R1, R2 = rotations[link, a, 0], rotations[link, a, 1], rotations[link, a, 2]
        c.place[k, a] = origins[link, a] + (R0 * x0 + R1 * x1 + R2 * x2)


@inner
def n_nodes_below(c: ContactTable, i: int) -> int:
    """Return how many nodes the other surface has below a point: a triangle's, none of a plane or a rigid surface."""
    s = c.surface[i]
    return 3 if c.master[s] >= 0 and c.primitive[s, 0] == 0.0 else 0


@inner
def farthest_deflected(c: ContactTable, s: int, side: int, body: int, q: Array) -> float:
    """Return a bound of how far modes at positions q and forces on markers deflect a surface's points or triangles."""
    far = c.reach[s, side] * modal_size(c, body, q, c.shift)
    for j in range(c.felt.shape[1]):
        far += c.felt_reach[s, side, j] * abs(c.felt[body, j])
    return float(far)


@inner
def modal_size(c: ContactTable, body: int, x: Array, shift: int) -> float:
    """Return the length of a body's modal coordinates, which stand shifted among positions, or of their rates."""
    size = 0.0
    for m in range(c.n_modes[body]):
        size += x[c.mode[body, m] + shift] ** 2
    return math.sqrt(size)
