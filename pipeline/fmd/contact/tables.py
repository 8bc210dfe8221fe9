"""Arrays of a mechanism's contacts that kernels read and write."""

import numpy as np

from fmd.contact.histories import IMPULSE
from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.contact import MOST_POINTS, ROUNDED_PLACE
from fmd.kernels.table import Table
from fmd.kernels.vectors import call_native

_PLACED = "middle", "along", "lag", "cells", "x"
_FOLLOWING = "shapes", "yields", "G", "supple", "box", "reach", "border", "slot", "n_chosen"
MOVED = ("asked", *_PLACED, *_FOLLOWING)
"""Arrays that what moves such a grid takes and changes: all others follow from where its points are."""

_LAST = "known", "tip", "before", "slid", "moved_then", "elastic_then", "viscous_then", "seen"
_OF_ROUND = "dent_then", "drag_then", "tangent_then", "touched_then", "gap_then", "speed_then", "soft_then"
REMEMBERED = (*_LAST, *_OF_ROUND, "frame_then", "sums", "worn", "clock", "height")
"""What contacts remember of the last step."""


@dataclass(frozen=True)
class ContactTable(Table):
    """Points that may touch planes of the ground or triangles of other bodies, and the forces on them.

    The **nodes** are points of bodies, with their displacements by modes and their flexibility. A **point** of contact
    is a node and what it may touch; its vectors are along the normal out of that and along two tangents, in the frame
    of its own body ("own axes") or in that of the other one, which is the ground for a plane. Points are sorted by
    **surface**, a face before a plane or before another face, and surfaces by **group**: points of a group share
    bodies, and so their forces depend on one another.
    """

    # Bodies.
    link: IntArray  # (n_bodies,): each body's number in the mechanism
    first: IntArray  # (n_bodies + 1,): its first node
    n_modes: IntArray  # (n_bodies,)
    mode: IntArray  # (n_bodies, most modes): rate of each of its modal coordinates
    shift: int  # from there to its position
    felt: Array  # (n_bodies, most felt): forces and moments on markers that its nodes feel, in its axes
    # Nodes.
    x: Array  # (n_nodes, 3): undeformed, in their body's frame [m]
    shapes: Array  # (n_nodes, 3, most modes)
    yields: Array  # (n_nodes, 3, most felt): displacements by unit forces on markers, beside the modes [m/N]
    # (n_rows, most of a body, 3, 3): of nodes that have a row and, counted in their body, a column
    G: Array
    row: IntArray  # (n_nodes,): -1 without
    column: IntArray  # (n_nodes,)
    wanted: IntArray  # (n_nodes,): 1 of nodes that have to have one
    grow: int  # address of the function that finds those, 0 if all have
    place: Array  # (n_nodes, 3): deformed, in space [m]
    radii: Array  # (n_nodes,): of round points [m]; 0 of others
    # Grids that travel.
    travel: int  # address of the function that moves one, 0 without
    middle: Array  # (n_surfaces, 3): place of the face that it is about [m]
    along: Array  # (n_surfaces, 3, 3): inward normal and two directions along the face there
    lag: Array  # (n_surfaces, 2): by how many rectangles it is behind the lowest place, as its face ends
    side: Array  # (n_surfaces, 2): of a rectangle [m]
    per_slope: Array  # (n_surfaces, 2): rectangles by which a slope of 1 moves that; 0 where the grid stays
    cells: IntArray  # (n_nodes, 3): rectangle of a node, and 1 if it is there since the grid was moved last
    asked: Array  # (3,): surface whose grid is to be moved, and by how many rectangles
    border: IntArray  # (n_nodes,): 1 at the border of a grid that is smaller than its face
    worn: Array  # (n_nodes,): volume lost by wear [m³]; empty where nothing wears
    placed: IntArray  # (n_nodes,): number of the state at which it was found
    # Surfaces.
    slave: IntArray  # (n_surfaces,): the body of its points
    master: IntArray  # (n_surfaces,): the body with the triangles, -1 for the ground
    point: IntArray  # (n_surfaces + 1,): its first point
    triangle: IntArray  # (n_surfaces + 1,): its first triangle
    contact: IntArray  # (n_surfaces,): number of the contact
    sign: Array  # (n_surfaces,): 1 if the contact's values are of the force on the body of its points, else -1
    softness: Array  # (n_surfaces,): more of the own flexibility of each point
    clearance: Array  # (n_surfaces,): what is added to gaps [m]
    friction: Array  # (n_surfaces,)
    wear: Array  # (n_surfaces,): depth by pressure and slip [1/Pa]
    edges: Array  # (n_surfaces, 17): the same of the points' own box, if its edges touch; 0 else
    primitive: Array  # (n_surfaces, 17): kind, place, axes, half extents and radius of a rigid body's surface
    rounded: IntArray  # (n_surfaces,): 1 if its points are centres of balls or pieces of pins, with laws of their own
    law: Array  # (n_surfaces, most rows, 7): their force over depth, as `fmd.contact.round_laws` has it
    ends: Array  # (n_surfaces,): depth up to which it is known [m]
    loss: Array  # (n_surfaces,): share of the force at the speed of the approach
    slide: Array  # (n_surfaces,): how much softer it is aside
    frame: Array  # (n_surfaces, 12): origin and axes of the points' body in the other's frame, of round points
    frame_then: Array  # (n_surfaces, 12): at the last step
    plane: Array  # (n_surfaces, 3, 3): normal and tangents of the ground's plane in space, a row each
    position: Array  # (n_surfaces, 3): a point of it
    reach: Array  # (n_surfaces, 2): no modal coordinates of length 1 displace points, or triangles, farther
    # (n_surfaces, 2): all points are above a plane by this, or have moved before a rigid surface by this at most since
    # gaps were listed, now and at the last step [m]
    height: Array
    pace: Array  # (n_surfaces,): how much that changes in a step [m]
    box: Array  # (n_surfaces, 8, 3): corners of a box around its points
    radius: Array  # (n_surfaces,): distance up to which triangles are kept [m]
    # (n_surfaces,): what surfaces may move before these are to be found again [m], or how many points before a rigid
    # surface have been placed since gaps were listed; negative at first
    room: Array
    corners: Array  # (n_surfaces, 8, 3): the box in the master's frame when they were found
    ahead: Array  # (n_surfaces, 8, 3): the same, or before a plane in space, some time ahead
    modal_then: Array  # (n_surfaces, 2, most modes): modal coordinates of both bodies then
    felt_reach: Array  # (n_surfaces, 2, most felt): no unit force displaces points, or triangles, farther
    felt_then: Array  # (n_surfaces, 2, most felt): forces on markers of both bodies then
    # Triangles.
    corner: IntArray  # (n_triangles, 3): nodes
    rim: IntArray  # (n_triangles, 6): 1 for each side, then each corner, that is on its face's rim
    ball: Array  # (n_triangles, 4): centre in space and radius
    ridge: Array  # (9, 3): normals at a triangle's sides and corners, how near these are, and means by that
    # Points.
    node: IntArray  # (n,)
    surface: IntArray  # (n,)
    areas: Array  # (n,): force by a pressure of 1; 0 for those on edges [m²]
    outward: Array  # (n, 3): unit normal of its face, in own axes
    peak: Array  # (n,): largest over mean pressure
    shares: Array  # (n,): of a round point in the law's force
    near: IntArray  # (n, NEAR_TRIANGLES)
    n_near: IntArray  # (n,)
    below: IntArray  # (n,): the nearest of these at the last state; -1 if none is known
    foot: IntArray  # (n, 3): nodes at the corners of the triangle below it
    weights: Array  # (n, 3): of these
    axes: Array  # (n, 3, 3): normal and tangents in space, a row each
    turned: Array  # (n, 3, 3): in own axes
    Q: Array  # (n, 3, 3): turns vectors in the other body's frame into own axes
    seen: IntArray  # (n, 2): 1 if there is something below it, now and at the last step
    spot: Array  # (n, 3): place without forces relative to what it may touch, in the other's undeformed frame [m]
    listed: Array  # (n,): gap before a rigid surface when all were listed [m]; -inf without
    free: Array  # (n, 3): gap without forces, and slip since the last step
    force: Array  # (n, 3)
    own: Array  # (n, 3): forces in own axes
    moved: Array  # (n, 3): displacements by forces against what it touches, in own axes
    supple: Array  # (n,): no force of 1 moves it farther against what it touches, without others [m/N]
    at: Array  # (n, 3): where the force acts, in space [m]
    active: IntArray  # (n,)
    known: Array  # (n, 3): force at the last step, in the other's frame
    tip: Array  # (n, 3): spot with displacement by forces, at the last step
    before: Array  # (n, 3): spot at the last step
    slid: Array  # (n,): way that the point has slipped while it was pressed, up to the last step [m]
    # Points of damped groups.
    undamped: Array  # (n, 3): gap without forces, and slip, while others stand in their place
    viscous: Array  # (n, 3): the damper's part of forces, in own axes
    moved_then: Array  # (n, 3): displacements at the last step
    elastic_then: Array  # (n, 3): the elastic part of forces at the last step
    viscous_then: Array  # (n, 3): the damper's
    # Round points, along the contact's axes.
    dent: Array  # (n, 3): deflection [m]
    dent_then: Array  # (n, 3): at the last step
    drag: Array  # (n, 3): damper's part of the force [N]
    drag_then: Array  # (n, 3)
    tangent_then: Array  # (n, 3): first tangent along which these two are, in the other's frame
    touched: Array  # (n, 3): place, in the other's frame [m]
    touched_then: Array  # (n, 3)
    gap_then: Array  # (n,) [m]
    speed: Array  # (n,): fastest approach since they touch [m/s]; 0 away from contact
    speed_then: Array  # (n,)
    soft: Array  # (n,): how far a force of 1 moves it aside [m/N]; 0 away from contact
    soft_then: Array  # (n,): at the last step
    shed: Array  # (n,): energy that the change of that takes [J]
    stored: Array  # (n,): energy beyond that of a constant stiffness [J]
    # Groups.
    damping: Array  # (n_groups,): time β [s]
    share: Array  # (n_groups,): part of new forces that is elastic at once, h/(h + β)
    group: IntArray  # (n_groups + 1,): its first point
    width: IntArray  # (n_groups,): points that may be chosen, and entries in a row of N and L
    noise: Array  # (n_groups,): round-off of places [m]
    band: Array  # (n_groups,): gaps below this may close [m]
    chosen: IntArray  # (n,): points that may close, from the group's first entry on
    n_chosen: IntArray  # (n_groups,)
    slot: IntArray  # (n,): place of a point among these, -1 without
    first_entry: IntArray  # (n_groups, 2): where the group's part of D and of N begins
    stride: IntArray  # (n_groups,): entries in a row of D
    D: Array  # flexibility between chosen points in own axes, a row for each component of each
    Q_then: Array  # (n, 3, 3): what D was found with
    weights_then: Array  # (n, 3)
    foot_then: IntArray  # (n, 3)
    E: Array  # displacements of all chosen points by a force of 1 along the normal of each, a row each
    N: Array  # flexibility between chosen points along their normals
    normal_then: Array  # (n, 3): what E and N were found with
    P: Array  # the inverse of D, where friction had it found; nothing without friction
    inverted: IntArray  # (n_groups,): 1 where it is, -1 where D has none
    swept: IntArray  # (n_groups,): sweeps of Gauss–Seidel with this D
    M: Array  # equations of the unknowns of Newton's method, a row each, or their factors
    right: Array  # (most rows of D,): their right sides, then what solves them
    steps: Array  # (NEWTON_ROUNDS, as many), flat: steps by the same factors
    pivots: IntArray  # (as many,): rows that were exchanged, as LAPACK has them
    lapack: IntArray  # (4,): addresses of its routines
    words: IntArray  # (6,): what these are called with
    kept: IntArray  # (2,): group whose factors these are, -1 without; 1 if forces are unknown, 0 if displacements are
    grip_then: IntArray  # (most points of a group,): states that they are of
    step: Array  # (most points, 3): of the unknowns
    grip: IntArray  # (most points of a group,): state of each: open, sticks, slips
    place_in: IntArray  # (most points,): its first unknown in them
    trial: Array  # (most points, 3): force that its state follows from
    slack: Array  # (most points, 3): gap and slip with displacements by forces
    settled: Array  # (most points, 3): the last forces that Newton's method has found, or began with
    left: Array  # (most rows of D,): gaps and slips without these, in own axes
    held: Array  # (as many): forces if no point moved
    response: Array  # (as many): rows of P, summed up
    mixed: Array  # (as many): rows of a point, summed up
    # (n_groups, known ones, 2, as many), flat: directions, and P times them; without friction gaps' directions, what
    # forces on active points they take, and the displacements by these
    known_response: Array
    n_known: IntArray  # (n_groups,): how many
    n_pressed: IntArray  # (n_groups,): how many of those without friction
    L: Array  # factor of the active part of N
    factored: IntArray  # (n,): places of points in it, from the group's first entry on
    n_factored: IntArray  # (n_groups,): how many; -1 if it isn't to be used, -2 if N isn't, either
    answer: Array  # (as many): displacements by them
    way: Array  # (3, 3)
    edge: Array  # (2, 4, 3): middle, direction and two outward directions of an edge each of two boxes, in space
    b: Array  # (most points of a group,)
    block: Array  # (3, 3)
    product: Array  # (3, 3)
    # Results.
    push: Array  # (n_links, 6): force and moment on each body's frame, in its axes
    modal: Array  # (n_rates,): forces on modes, in the order of rates
    centre: Array  # (n_contacts, 3): moments are about this point of the carrier's frame
    carrier: IntArray  # (n_contacts,): link, -1 for the ground
    now: Array  # (n_contacts, N_VALUES): values at the state looked at
    sums: Array  # (n_contacts, N_VALUES): those that add up, at the last step
    end_share: Array  # (1,): of the force at a step's end in the mean over the step
    # (2,): time of the last step; 0 if forces were found, 1 if not, 2 where a point is deep at first, 3 and 4 where
    # too many are near, or the flexibility of those wasn't found
    clock: Array
    state: IntArray  # (1,): number of the state looked at

    @property
    def memory(self) -> Array:
        """State of the contacts after a step, from which a march goes on."""
        return np.concatenate([own.ravel() for own in self._remembered])

    @property
    def lost(self) -> str:
        """Why no forces were found at the last state; empty if they were."""
        if self.clock[1] == 2.0:
            return (
                "a point came deep into a body past the edge of its face; a marker with the faces around it, or a "
                "shorter step, helps"
            )
        if self.clock[1] == 3.0:
            near = f"more than {MOST_POINTS} points come near at once"
            if self.damping.any():
                return f"{near}, with damping all before a plane; a smaller face, larger elements or no damping helps"
            return f"{near}; a smaller face or larger elements help"
        if self.clock[1] == 4.0:
            return "the flexibility of points that came near wasn't found, as told before"
        remedy = "modes.enrich = 'none', a shorter step or less friction helps"
        return f"their iterations don't settle; {remedy}" if self.clock[1] else ""

    @property
    def unrounded_force(self) -> float:
        """Force that would deflect a point of elements by as much as places are the sum of, whose round-off it has."""
        sizes, soft = self.noise / ROUNDED_PLACE, self.supple[self.rounded[self.surface] == 0]
        return float(sizes.max() / soft.min()) if len(soft) else 0.0

    @property
    def impulses(self) -> Array:
        """Impulses of contacts since the start, three each, shape (3 n_contacts,) [N s]."""
        return self.sums[:, IMPULSE : IMPULSE + 3].ravel()

    def deepest(self, contact: int) -> float:
        """Return how deep points of a contact are at the last state, beyond what is wanted or loads may do [m].

        Wanted is an interference; loads on markers deflect points at once.
        """
        mine = (self.contact[self.surface] == contact) & (self.seen[:, 0] == 1)
        wanted = np.minimum(self.clearance, 0.0)
        for side, body in ((0, self.slave), (1, self.master)):
            wanted = wanted - (self.felt_reach[:, side] * np.abs(self.felt[body])).sum(axis=1)
        return -float((self.free[:, 0] - wanted[self.surface])[mine].min(initial=0.0))

    def recall(self, memory: Array) -> None:
        """Go on from the memory of another march."""
        x = self.x.copy()
        for own, kept in zip(self._remembered, np.split(memory, self._ends), strict=True):
            own[:] = kept.reshape(own.shape)
        self.room[:] = -1.0
        for s in np.flatnonzero(self.per_slope.any(axis=1) & (self.x != x).any()):
            self.asked[:] = s, np.nan, np.nan
            call_native(self.travel, tuple(getattr(self, name) for name in MOVED))

    @property
    def _remembered(self) -> tuple[Array | IntArray, ...]:
        return tuple(getattr(self, name) for name in (*REMEMBERED, *(_PLACED if self.travel else ())))

    @property
    def _ends(self) -> IntArray:
        return np.cumsum([own.size for own in self._remembered])[:-1]
