"""Arrays of a mechanism's contacts that kernels read and write."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fmd.contact.histories import BEGIN, END, N_VALUES
from fmd.core.arrays import Array, IntArray
from fmd.kernels.table import Table

if TYPE_CHECKING:
    from fmd.contact.touching_body import TouchingBody


@dataclass(frozen=True)
class ContactTable(Table):
    """Points of bodies that may touch planes, body after body, and the forces on them.

    Vectors of points are along the normal and the two tangents of their plane, but where it says otherwise.
    """

    link: IntArray  # (n_bodies,): each body's number in the mechanism
    first: IntArray  # (n_bodies + 1,): its first point
    n_modes: IntArray  # (n_bodies,)
    mode: IntArray  # (n_bodies, most modes): rate of each of its modal coordinates
    shift: int  # from there to its position
    x: Array  # (n, 3): undeformed points in their body's frame [m]
    shapes: Array  # (n, 3, most modes)
    reach: Array  # (n,): no modal coordinates of length 1 displace it farther
    areas: Array  # (n,)
    G: Array  # (n, most points of a body, 3, 3), the second from the body's first point on
    axes: Array  # (n, 3, 3): normal and tangents in space, a row each
    offset: Array  # (n, 3): the plane's position along them
    friction: Array  # (n,)
    contact: IntArray  # (n,): number of the plane
    positions: Array  # (n_planes, 3): moments are about these
    free: Array  # (n, 3): places without forces
    force: Array  # (n, 3): forces at the state looked at
    known: Array  # (n, 3): forces at the last step
    tip: Array  # (n, 3): places with forces, at the last step
    before: Array  # (n, 3): places without forces, at the last step
    noise: Array  # (n_bodies,): round-off of places [m]
    height: Array  # (n_bodies, 2): all points are above this, at the state looked at and at the last step [m]
    near: Array  # (n_bodies, 2): 1 if its points have been placed, at the same two
    own: Array  # (n, 3): forces in the body's axes
    moved: Array  # (n, 3): displacements by them, in the body's axes
    turned: Array  # (n, 3, 3): axes in those of the body, a row each
    active: IntArray  # (n,)
    A: Array  # (most, most), room to work in
    b: Array  # (most,)
    push: Array  # (n_links, 6): force and moment on each body's frame, in its axes
    modal: Array  # (n_rates,): forces on modes, in the order of rates
    now: Array  # (n_planes, N_VALUES): values at the state looked at
    sums: Array  # (n_planes, N_VALUES): those that add up, at the last step
    clock: Array  # (2,): time of the last step; 0 if forces were found, 1 if not

    @property
    def memory(self) -> Array:
        """What a march needs of its last step to go on."""
        return np.concatenate([own.ravel() for own in self._remembered])

    @property
    def is_lost(self) -> bool:
        """True if no forces were found at the last state."""
        return bool(self.clock[1])

    def recall(self, memory: Array) -> None:
        """Go on from the memory of another march."""
        for own, kept in zip(self._remembered, np.split(memory, self._ends), strict=True):
            own[:] = kept.reshape(own.shape)

    @property
    def _remembered(self) -> tuple[Array, ...]:
        return self.known, self.tip, self.before, self.sums, self.clock, self.height, self.near

    @property
    def _ends(self) -> IntArray:
        return np.cumsum([own.size for own in self._remembered])[:-1]


def contact_table(
    bodies: Sequence[TouchingBody], links: Sequence[int], modes: Sequence[IntArray], n_links: int, n: int, shift: int
) -> ContactTable:
    """Make the table of bodies that touch planes.

    Parameters
    ----------
    links : sequence of int
        Number of each body in the mechanism.
    modes : sequence of ndarray, shapes (n_modes,)
        Rates of each body's modal coordinates.
    n_links, n : int
        Numbers of bodies and of rates of the mechanism.
    shift : int
        From a mode's rate to its position.
    """
    counts = [len(body.points.x) for body in bodies]
    first = np.concatenate([[0], np.cumsum(counts)])
    size, most, most_modes = int(first[-1]), max(counts), max(1, *(len(own) for own in modes))
    mode, shapes = np.zeros((len(bodies), most_modes), dtype=np.int64), np.zeros((size, 3, most_modes))
    G, axes, offset = np.zeros((size, most, 3, 3)), np.zeros((size, 3, 3)), np.zeros((size, 3))
    friction, contact = np.zeros(size), np.zeros(size, dtype=np.int64)
    planes = [plane for body in bodies for plane in body.planes]
    number = 0
    for k, (body, own) in enumerate(zip(bodies, modes, strict=True)):
        points, at = body.points, slice(first[k], first[k + 1])
        mode[k, : len(own)] = own
        shapes[at, :, : len(own)] = points.shapes
        G[at, : counts[k]] = points.G.transpose(0, 2, 1, 3)
        for plane in body.planes:
            mine = first[k] + plane.points
            axes[mine], offset[mine] = plane.axes, plane.axes @ plane.position
            friction[mine], contact[mine] = plane.friction, number
            number += 1
    sums = np.zeros((len(planes), N_VALUES))
    sums[:, [BEGIN, END]] = np.nan
    return ContactTable(
        link=np.array(links, dtype=np.int64),
        first=first.astype(np.int64),
        n_modes=np.array([len(own) for own in modes], dtype=np.int64),
        mode=mode,
        shift=shift,
        x=np.concatenate([body.points.x for body in bodies]),
        shapes=shapes,
        reach=np.sqrt((shapes**2).sum(axis=(1, 2))),
        areas=np.concatenate([body.points.areas for body in bodies]),
        G=G,
        axes=axes,
        offset=offset,
        friction=friction,
        contact=contact,
        positions=np.array([plane.position for plane in planes]),
        **{name: np.zeros((size, 3)) for name in ("free", "force", "known", "tip", "before", "own", "moved")},
        noise=np.zeros(len(bodies)),
        height=np.full((len(bodies), 2), np.inf),
        near=np.zeros((len(bodies), 2)),
        turned=np.zeros((size, 3, 3)),
        active=np.zeros(size, dtype=np.int64),
        A=np.zeros((most, most)),
        b=np.zeros(most),
        push=np.zeros((n_links, 6)),
        modal=np.zeros(n),
        now=np.zeros((len(planes), N_VALUES)),
        sums=sums,
        clock=np.array([np.nan, 0.0]),
    )
