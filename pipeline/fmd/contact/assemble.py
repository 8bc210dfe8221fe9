"""The table of a mechanism's contacts, from its bodies that touch something."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fmd.contact.columns import growing_function
from fmd.contact.dense import ROUTINES, WORDS, lapack_addresses
from fmd.contact.histories import BEGIN, END, MOST_WORN, N_VALUES, WORN
from fmd.contact.round_laws import law_table
from fmd.contact.surfaces import ContactSurface, find_surfaces
from fmd.contact.tables import ContactTable
from fmd.contact.touching_body import ContactPlane, TouchingBody
from fmd.contact.travel import lattices, travelling_function, travelling_grids
from fmd.core.arrays import Array, IntArray
from fmd.core.limits.code import DOUBLES_IN_LINE
from fmd.core.limits.contact import KNOWN_RESPONSES, MOST_POINTS, NEAR_RADIUS, NEAR_TRIANGLES, NEWTON_ROUNDS


def contact_table(
    bodies: Sequence[TouchingBody], links: Sequence[int], modes: Sequence[IntArray], n_links: int, n: int, shift: int
) -> ContactTable:
    """Make the table of bodies that touch planes or one another.

    They have the numbers ``links`` among the mechanism's ``n_links`` bodies, and rates ``modes`` (n_modes,) of modal
    coordinates among n; ``shift`` is from a mode's rate to its position.
    """
    first = np.concatenate([[0], np.cumsum([len(body.points.x) for body in bodies])]).astype(np.int64)
    most = [MOST_POINTS if len(body.points.soft) else len(body.points.x) for body in bodies]
    numbered = find_surfaces(bodies)
    groups = _groups(len(bodies), [surface for _, surface in numbered])
    order = np.argsort(groups, kind="stable")
    surfaces = [numbered[k][1] for k in order]
    counts = np.array([len(own.points) for own in surfaces])
    point = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    group = np.append(point[np.searchsorted(groups[order], np.arange(groups.max() + 1))], point[-1])
    contact = np.array([numbered[k][0] for k in order], dtype=np.int64)
    large = [any(len(bodies[k].points.soft) for k in (own.slave, own.master) if k >= 0) for own in surfaces]
    width = np.diff(group)
    for g in set((np.searchsorted(group, point[:-1][large], side="right") - 1).tolist()):
        width[g] = min(width[g], MOST_POINTS)
    grids = travelling_grids(bodies, surfaces, first, point)
    arrays = {
        **_bodies(bodies, links, modes, first, np.append(0, np.cumsum(most)), shift),
        **_surfaces(surfaces, contact, point, bodies),
        **_points(surfaces, counts, first, bodies),
        **lattices(grids, len(surfaces), int(first[-1])),
        **_rooms(group, width, np.array([own.of.damping for own in surfaces])[np.searchsorted(point, group[:-1])]),
    }
    table = ContactTable(
        **arrays,
        travel=travelling_function(grids, arrays),
        **_triangles(surfaces, first),
        **_friction_rooms(width, any(own.of.friction and not own.of.law for own in surfaces)),
        **_results(bodies, links, n_links, n),
    )
    for own, begin, end in zip(surfaces, point[:-1], point[1:], strict=True):
        _anchor(table, bodies[own.slave], own, slice(begin, end))
        if own.of.friction and not own.of.law and own.master < 0:
            _choose_all(table, bodies[own.slave], own, begin, end)
    return table


def _choose_all(table: ContactTable, body: TouchingBody, surface: ContactSurface, begin: int, end: int) -> None:
    """Choose all points of a body that touches one plane with all of them: with friction D and P stay the same."""
    g = int(np.searchsorted(table.group, begin))
    n, size, stride = end - begin, 3 * (end - begin), int(table.stride[g])
    if (
        len(body.points.soft)
        or table.group[g] != begin
        or table.group[g + 1] != end
        or not np.array_equal(surface.points, np.arange(len(body.points.x)))
    ):
        return
    for X, entries in ((table.D, body.points.G), (table.P, body.points.held_stiffness)):
        at = int(table.first_entry[g, 0])
        X[at : at + size * stride].reshape(size, stride)[:, :size] = entries.reshape(size, size)
    table.chosen[begin:end], table.slot[begin:end] = np.arange(begin, end), np.arange(n)
    table.n_chosen[g], table.inverted[g] = n, 1


def _anchor(table: ContactTable, body: TouchingBody, surface: ContactSurface, at: slice) -> None:
    """Let points before a plane have their slip counted from where they are at the start, if they are set down."""
    if isinstance(surface.of, ContactPlane) and body.anchor is not None:
        (origin, R), points = body.anchor, surface.points
        table.tip[at] = origin + body.points.x[points] @ R.T - body.points.radii[points, None] * surface.of.normal
        table.before[at] = table.touched_then[at] = table.tip[at]
        table.frame_then[table.surface[at.start]] = np.concatenate([origin, R.ravel()])
        table.seen[at, 1] = 1


def _groups(n_bodies: int, surfaces: Sequence[ContactSurface]) -> IntArray:
    """Return the number of each surface's group; those with a body in common, but the ground, are in one.

    Round points don't feel each other: each surface with such has its own.
    """
    ends = np.array([(own.slave, own.slave if own.master < 0 else own.master) for own in surfaces])
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n_bodies, n_bodies))
    _, of_body = connected_components(graph, directed=False)
    own = [n_bodies + k if surface.of.law else of_body[ends[k, 0]] for k, surface in enumerate(surfaces)]
    _, group = np.unique(own, return_inverse=True)
    return np.asarray(group, dtype=np.int64)


def _bodies(
    bodies: Sequence[TouchingBody],
    links: Sequence[int],
    modes: Sequence[IntArray],
    first: IntArray,
    rows: IntArray,
    shift: int,
) -> dict[str, Any]:
    size = int(first[-1])
    most_modes = max(1, *(len(own) for own in modes))
    mode, shapes = np.zeros((len(bodies), most_modes), dtype=np.int64), np.zeros((size, 3, most_modes))
    felt = max(6 * len(body.felt) for body in bodies)
    row, column = np.full((2, size), -1, dtype=np.int64)
    G, yields = np.zeros((int(rows[-1]), int(np.diff(rows).max()), 3, 3)), np.zeros((size, 3, felt))
    for k, (body, own) in enumerate(zip(bodies, modes, strict=True)):
        at = slice(first[k], first[k + 1])
        mode[k, : len(own)] = own
        shapes[at, :, : len(own)] = body.points.shapes
        yields[at, :, : 6 * len(body.felt)] = body.felt_yields
        if not len(body.points.soft):
            column[at] = np.arange(len(body.points.x))
            row[at] = rows[k] + column[at]
            G[rows[k] : rows[k + 1], : len(body.points.x)] = body.points.G.transpose(0, 2, 1, 3)
    return {
        "link": np.array(links, dtype=np.int64),
        "first": first,
        "n_modes": np.array([len(own) for own in modes], dtype=np.int64),
        "mode": mode,
        "shift": shift,
        "x": np.concatenate([body.points.x for body in bodies]),
        "shapes": shapes,
        "yields": yields,
        "felt": np.zeros((len(bodies), felt)),
        "G": G,
        "row": row,
        "column": column,
        "wanted": np.zeros(size, dtype=np.int64),
        "grow": growing_function([body.points.columns for body in bodies], first, rows, G.shape),
        "place": np.zeros((size, 3)),
        "radii": np.concatenate([body.points.radii for body in bodies]),
        "border": np.concatenate([body.points.border for body in bodies]).astype(np.int64),
        "worn": np.zeros(size if any(body.wears for body in bodies) else 0),
        "placed": np.full(size, -1, dtype=np.int64),
    }


def _surfaces(
    surfaces: Sequence[ContactSurface], contact: IntArray, point: IntArray, bodies: Sequence[TouchingBody]
) -> dict[str, Any]:
    n, most_modes = len(surfaces), max(1, *(body.points.shapes.shape[2] for body in bodies))
    plane, position, box = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros((n, 8, 3))
    reach, radius = np.zeros((n, 2)), np.zeros(n)
    felt = np.zeros((n, 2, max(6 * len(body.felt) for body in bodies)))
    for k, own in enumerate(surfaces):
        if isinstance(own.of, ContactPlane):
            plane[k], position[k] = own.of.axes, own.of.position
        x, shapes = bodies[own.slave].points.x[own.points], bodies[own.slave].points.shapes[own.points]
        ends = np.stack([x.min(axis=0), x.max(axis=0)])
        box[k] = np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1).reshape(8, 3)
        reach[k, 0] = _reach(shapes)
        sides = [(bodies[own.slave], own.points), (bodies[own.master], own.triangles)][: 2 if len(own.triangles) else 1]
        for side, (body, at) in enumerate(sides):
            yields = body.felt_yields[at.ravel()]
            felt[k, side, : yields.shape[2]] = np.linalg.norm(yields, axis=1).max(axis=0, initial=0.0)
        if len(own.triangles):
            theirs = bodies[own.master].points
            reach[k, 1] = _reach(theirs.shapes[own.triangles])
            corners = theirs.x[own.triangles]
            sizes = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max()
            radius[k] = NEAR_RADIUS * sizes
    counts = [len(own.triangles) for own in surfaces]
    laws = [own.of.law for own in surfaces]
    return {
        "primitive": np.array([own.primitive.row if own.primitive else np.zeros(17) for own in surfaces]),
        "edges": np.array([own.edges.row if own.edges else np.zeros(17) for own in surfaces]),
        "rounded": np.array([law is not None for law in laws], dtype=np.int64),
        "law": law_table(laws),
        "ends": np.array([law.ends if law else np.inf for law in laws]),
        "loss": np.array([law.loss if law else 0.0 for law in laws]),
        "slide": np.array([own.of.slide for own in surfaces]),
        "frame": np.zeros((n, 12)),
        "frame_then": np.zeros((n, 12)),
        "slave": np.array([own.slave for own in surfaces], dtype=np.int64),
        "master": np.array([own.master for own in surfaces], dtype=np.int64),
        "point": point,
        "triangle": np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        "contact": contact,
        "sign": np.array([float(own.sign) for own in surfaces]),
        "softness": np.array([own.softness for own in surfaces]),
        "clearance": np.array([own.of.clearance for own in surfaces]),
        "friction": np.array([own.of.friction for own in surfaces]),
        "wear": np.array([own.of.wear for own in surfaces]),
        "plane": plane,
        "position": position,
        "reach": reach,
        "height": np.full((n, 2), np.inf),
        "pace": np.full(n, np.inf),
        "box": box,
        "radius": radius,
        "room": np.full(n, -1.0),
        "corners": np.zeros((n, 8, 3)),
        "ahead": np.zeros((n, 8, 3)),
        "modal_then": np.zeros((n, 2, most_modes)),
        "felt_reach": felt,
        "felt_then": np.zeros(felt.shape),
    }


def _reach(shapes: Array) -> float:
    return float(np.sqrt((shapes**2).sum(axis=(-2, -1))).max(initial=0.0))


def _triangles(surfaces: Sequence[ContactSurface], first: IntArray) -> dict[str, Any]:
    corner = np.concatenate([first[max(own.master, 0)] + own.triangles for own in surfaces])
    return {
        "corner": corner,
        "rim": np.concatenate([own.rim for own in surfaces]),
        "ball": np.zeros((len(corner), 4)),
        "ridge": np.zeros((9, 3)),
    }


def _points(
    surfaces: Sequence[ContactSurface], counts: IntArray, first: IntArray, bodies: Sequence[TouchingBody]
) -> dict[str, Any]:
    n, supple = int(counts.sum()), list[Array]()
    for own in surfaces:
        soft = (1.0 + own.softness) * bodies[own.slave].points.softness[own.points]
        if len(own.triangles):
            soft = soft + (1.0 + own.softness) * bodies[own.master].points.softness[own.triangles].max()
        supple.append(soft)
    vectors = ("weights", "spot", "free", "force", "own", "moved", "at", "known", "tip", "before")
    of_round = ("dent", "dent_then", "drag", "drag_then", "tangent_then", "touched", "touched_then")
    numbers = "slid", "gap_then", "speed", "speed_then", "soft", "soft_then", "shed", "stored"
    then = ("undamped", "viscous", "weights_then", "normal_then", "moved_then", "elastic_then", "viscous_then")
    return {
        "node": np.concatenate([first[own.slave] + own.points for own in surfaces]),
        "surface": np.repeat(np.arange(len(surfaces)), counts),
        "areas": np.concatenate([own.areas for own in surfaces]),
        "outward": np.concatenate([own.outward for own in surfaces]),
        "near": np.zeros((n, NEAR_TRIANGLES), dtype=np.int64),
        "n_near": np.zeros(n, dtype=np.int64),
        "below": np.full(n, -1, dtype=np.int64),
        "foot": np.zeros((n, 3), dtype=np.int64),
        "supple": np.concatenate(supple),
        "active": np.zeros(n, dtype=np.int64),
        "seen": np.zeros((n, 2), dtype=np.int64),
        **{name: np.zeros((n, 3, 3)) for name in ("axes", "turned", "Q", "Q_then")},
        **{name: np.zeros((n, 3)) for name in (*vectors, *of_round, *then)},
        **{name: np.zeros(n) for name in numbers},
        "peak": np.ones(n),
        "listed": np.full(n, -np.inf),
        "shares": np.concatenate([bodies[own.slave].points.shares[own.points] for own in surfaces]),
        "foot_then": np.zeros((n, 3), dtype=np.int64),
        "chosen": np.zeros(n, dtype=np.int64),
        "slot": np.full(n, -1, dtype=np.int64),
        "factored": np.zeros(n, dtype=np.int64),
    }


def _rooms(group: IntArray, counts: IntArray, damping: Array) -> dict[str, Any]:
    stride = DOUBLES_IN_LINE * -(-3 * counts // DOUBLES_IN_LINE)
    ends = np.stack([np.cumsum(3 * counts * stride), np.cumsum(counts**2)], axis=1)
    first = np.concatenate([np.zeros((1, 2), dtype=np.int64), ends[:-1]])
    most = int(stride.max())
    return {
        "group": group,
        "width": counts,
        "damping": damping,
        "share": np.ones(len(counts)),
        "noise": np.zeros(len(counts)),
        "band": np.zeros(len(counts)),
        "n_chosen": np.zeros(len(counts), dtype=np.int64),
        "first_entry": np.ascontiguousarray(first),
        "stride": stride,
        "D": np.zeros(ends[-1, 0]),
        "E": np.zeros(ends[-1, 0] // 3),
        "N": np.zeros(ends[-1, 1]),
        "L": np.zeros(ends[-1, 1]),
        "n_factored": np.full(len(counts), -1, dtype=np.int64),
        **{name: np.zeros(len(counts), dtype=np.int64) for name in ("n_known", "n_pressed")},
        **{name: np.zeros(most) for name in ("answer", "left")},
        "known_response": np.zeros(len(counts) * KNOWN_RESPONSES * 2 * most),
        "way": np.zeros((3, 3)),
        "edge": np.zeros((2, 4, 3)),
        "b": np.zeros(int(counts.max())),
        "block": np.zeros((3, 3)),
        "product": np.zeros((3, 3)),
    }


def _friction_rooms(width: IntArray, rubs: bool) -> dict[str, Any]:
    counts = width if rubs else np.ones(len(width), dtype=np.int64)
    stride = DOUBLES_IN_LINE * -(-3 * counts // DOUBLES_IN_LINE)
    most, points = int(stride.max()), int(counts.max())
    return {
        "P": np.zeros((3 * counts * stride).sum()),
        "M": np.zeros(3 * points * (most + DOUBLES_IN_LINE)),
        **{name: np.zeros(len(counts), dtype=np.int64) for name in ("inverted", "swept")},
        **{name: np.zeros(points, dtype=np.int64) for name in ("grip", "grip_then", "place_in")},
        **{name: np.zeros((points, 3)) for name in ("trial", "slack", "step", "settled")},
        **{name: np.zeros(most) for name in ("held", "response", "right", "mixed")},
        "steps": np.zeros(NEWTON_ROUNDS * most),
        "pivots": np.zeros(most, dtype=np.int64),
        "lapack": lapack_addresses() if rubs else np.zeros(len(ROUTINES), dtype=np.int64),
        "words": WORDS.copy(),
        "kept": np.full(2, -1, dtype=np.int64),
    }


def _results(bodies: Sequence[TouchingBody], links: Sequence[int], n_links: int, n: int) -> dict[str, Any]:
    centre, carrier = list[Array](), list[int]()
    names = [body.body for body in bodies]
    for k, body in enumerate(bodies):
        centre += [plane.position for plane in body.planes]
        carrier += [-1] * len(body.planes)
        for pair in body.pairs:
            on, face = (names.index(pair.other), pair.other_face) if pair.reported_on_other else (k, pair.face)
            points = bodies[on].points
            if face in points.primitives:
                centre.append(np.array(points.primitives[face].at))
            else:
                centre.append(np.average(points.x[points.faces[face]], axis=0, weights=points.areas[face]))
            carrier.append(links[on])
    sums = np.zeros((len(carrier), N_VALUES))
    sums[:, [BEGIN, END]] = np.nan
    contacts = [own for body in bodies for own in body.contacts]
    sums[[own.wear == 0.0 for own in contacts], WORN] = np.nan
    sums[[own.wear == 0.0 or own.law is not None for own in contacts], MOST_WORN] = np.nan
    return {
        "push": np.zeros((n_links, 6)),
        "modal": np.zeros(n),
        "centre": np.array(centre, dtype=float),
        "carrier": np.array(carrier, dtype=np.int64),
        "now": np.zeros((len(carrier), N_VALUES)),
        "sums": sums,
        "end_share": np.full(1, 0.5),
        "clock": np.array([np.nan, 0.0]),
        "state": np.zeros(1, dtype=np.int64),
    }
