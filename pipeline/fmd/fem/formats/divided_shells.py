"""Shells of a file divided into four each: those with nodes at the middles of their sides, or all of them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.mesh import SHELL_FOLD
from fmd.fem.formats.import_shell import refuse_collapsed
from fmd.fem.formats.named_sets import PLANE, are_shells, corners_of, facets_of_solids
from fmd.fem.formats.raw_mesh import BlockShells, MeshFileError, RawMesh, at_all_nodes
from fmd.fem.mesh import three_corners
from fmd.fem.thicken import corner_normals

_WITH_MIDDLES = {"triangle": "triangle6", "quad": "quad8"}
_FOUR = {3: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)), 4: ((0, 4, 8, 7), (4, 1, 5, 8), (8, 5, 2, 6), (7, 8, 6, 3))}
_CENTRE = np.array([-0.25] * 4 + [0.5] * 4)  # serendipity functions there


def divide_shells_with_middles(raw: RawMesh, by_deck: bool) -> RawMesh:
    """Return a mesh whose shells of six, eight and nine nodes are four each, of three or four nodes.

    Those on facets of solids are their faces, unless sections of the deck, if these are asked for, make them shells.

    Raises
    ------
    MeshFileError
        Of one block of elements some are faces of solids and some are shells.
    """
    chosen, notes, on_solids = [], [], facets_of_solids(raw)
    for b, (kind, cells) in enumerate(raw.blocks):
        n = corners_of(kind)
        if not kind.startswith(PLANE) or cells.shape[1] == n or not len(cells):
            continue
        shells = are_shells(raw, b, on_solids, by_deck)
        if shells.any() and not shells.all():
            raise MeshFileError(
                f"of {len(cells)} {kind} some are faces of solids and some are shells; put them apart, or write them "
                "with nodes at their corners alone"
            )
        if shells.all():
            chosen.append(b)
            notes.append(f"{len(cells)} shells of {cells.shape[1]} nodes are divided into four of {n} nodes each")
    return replace(_divided(raw, chosen), notes=[*raw.notes, *notes]) if chosen else raw


def halve_shells(raw: RawMesh) -> RawMesh:
    """Return a mesh of shells of half the size, whose new nodes are on the curved midsurface.

    Raises
    ------
    MeshFileError
        There are other elements than shells of three and four nodes, or some are collapsed.
    """
    if any(kind not in (*_WITH_MIDDLES, "vertex") and len(cells) for kind, cells in raw.blocks):
        raise MeshFileError(f"mesh.halvings is of shells alone, and the elements are {raw.list_elements()}")
    shells = [b for b, (kind, cells) in enumerate(raw.blocks) if kind in _WITH_MIDDLES and len(cells)]
    corners = [raw.blocks[b][1] for b in shells]
    for own in corners:
        refuse_collapsed(own)
    sides = np.concatenate([np.stack([own, np.roll(own, -1, axis=1)], axis=2).reshape(-1, 2) for own in corners])
    ends, number = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    rise = _curve_of_sides(raw.points, corners)
    size = np.linalg.norm(rise, axis=1).clip(np.finfo(float).tiny)  # so a flat cap leaves its rim round
    total = np.stack([np.bincount(number.ravel(), size * each) for each in rise.T], axis=1)
    curve = total / np.bincount(number.ravel(), size)[:, None]
    new = len(raw.points) + number.reshape(-1)
    blocks, given, at = list(raw.blocks), list(raw.shells), 0
    for b, own in zip(shells, corners, strict=True):
        middles, at = new[at : at + own.size].reshape(own.shape), at + own.size
        blocks[b] = _WITH_MIDDLES[raw.blocks[b][0]], np.concatenate([own, middles], axis=1)
        if given:
            given[b] = given[b]._replace(thickness=at_all_nodes(given[b].thickness, 2 * own.shape[1]))
    points = np.concatenate([raw.points, raw.points[ends].mean(axis=1) + curve])
    whole = _with_nodes(replace(raw, points=points, blocks=blocks, shells=given), ends, len(raw.points))
    return _divided(whole, shells)


def _curve_of_sides(x: Array, blocks: Sequence[IntArray]) -> Array:
    """Return how far the middle of each element's sides is from its chord, by Hermite's curve across the end's normals.

    The normal of an element's node is the mean of those around the node, without those beyond a fold.
    """
    nodes = np.concatenate([own.ravel() for own in blocks])
    normals = np.concatenate([corner_normals(x[own]).reshape(-1, 3) for own in blocks])
    at = sp.csr_array((np.ones(len(nodes)), (np.arange(len(nodes)), nodes)))
    one, other = sp.coo_array(at @ at.T).coords
    lengths = np.linalg.norm(normals, axis=1).clip(np.finfo(float).tiny)
    cosine = np.einsum("ia,ia->i", normals[one], normals[other]) / (lengths[one] * lengths[other])
    smooth = np.where(np.abs(cosine) > np.cos(np.radians(SHELL_FOLD)), np.sign(cosine), 0.0)
    normals = sp.csr_array((smooth, (one, other))) @ normals
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(np.finfo(float).tiny)
    places = np.split(np.arange(len(nodes)), np.cumsum([own.size for own in blocks])[:-1])
    ends = np.concatenate(
        [np.roll(k.reshape(own.shape), -1, axis=1).ravel() for k, own in zip(places, blocks, strict=True)]
    )
    side = x[nodes[ends]] - x[nodes]
    rise = [np.einsum("ia,ia->i", side, each)[:, None] * each for each in (normals[ends], normals)]
    return np.asarray(rise[0] - rise[1]) / 8


def _with_nodes(raw: RawMesh, around: IntArray, first: int) -> RawMesh:
    """Add nodes, numbered from the first, to sets, rigid links, areas and ties that have all of those around each."""

    def also(points: IntArray) -> IntArray:
        held = np.zeros(first + len(around), dtype=bool)
        held[points] = True
        return np.concatenate([points, first + np.flatnonzero(held[around].all(axis=1))])

    given = raw.connections
    connections = replace(
        given,
        rigid=tuple(replace(each, points=also(each.points)) for each in given.rigid),
        mean=tuple(
            replace(each, points=(points := also(each.points)), weights=np.ones(len(points) - 1))
            if each.facets
            else each
            for each in given.mean
        ),
        ties=tuple(
            replace(each, points=also(each.points), face=also(each.face), onto=also(each.onto)) for each in given.ties
        ),
    )
    sets = {name: np.sort(also(own)) for name, own in raw.point_sets.items()}
    return replace(raw, point_sets=sets, connections=connections)


def _divided(raw: RawMesh, chosen: Sequence[int]) -> RawMesh:
    """Return a mesh with four shells in place of each of some blocks, all of which have nodes between their corners."""
    points, blocks, given = [raw.points], list(raw.blocks), list(raw.shells)
    around, four_of = [np.zeros((0, 8), dtype=np.int64)], dict[tuple[int, ...], IntArray]()  # by a shell's corners
    n_points = len(raw.points)
    for b in chosen:
        kind, cells = raw.blocks[b]
        n = corners_of(kind)
        t = given[b].thickness if given else np.zeros(cells.shape)
        if cells.shape[1] == 8:
            points.append(np.einsum("k,eka->ea", _CENTRE, raw.points[cells]))
            around.append(cells)
            cells = np.concatenate([cells, n_points + np.arange(len(cells))[:, None]], axis=1)
            t = np.concatenate([t, t @ _CENTRE[:, None]], axis=1)
            n_points += len(cells)
        four = cells[:, _FOUR[n]]
        four_of |= zip(map(tuple, three_corners(cells[:, :n]).tolist()), four, strict=True)
        blocks[b] = kind.rstrip("689"), four.reshape(-1, n)
        if given:
            of, at_nodes = given[b], t[:, _FOUR[n]].reshape(-1, n)
            offset, direction = np.repeat(of.offset, 4), np.repeat(of.direction, 4, axis=0)
            given[b] = BlockShells(at_nodes, offset, np.repeat(of.stack, 4), direction)

    def split(facets: IntArray) -> IntArray:
        keys = [*map(tuple, three_corners(facets).tolist())]
        left = facets[[key not in four_of for key in keys]]
        smaller = [four_of[key] for key in keys if key in four_of]
        return np.concatenate(
            [left, *(own if own.shape[1] == facets.shape[1] else three_corners(own) for own in smaller)]
        )

    sets = {
        name: [(4 * own[:, None] + np.arange(4)).ravel() if b in chosen else own for b, own in enumerate(each)]
        for name, each in raw.cell_sets.items()
    }
    whole = _with_nodes(replace(raw, points=np.concatenate(points)), np.concatenate(around), len(raw.points))
    c = whole.connections
    mean = tuple(replace(each, facets=tuple(map(split, each.facets))) for each in c.mean)
    return replace(
        whole,
        blocks=blocks,
        shells=given,
        cell_sets=sets,
        facet_sets={name: list(map(split, facets)) for name, facets in raw.facet_sets.items()},
        connections=replace(c, mean=mean),
    )
