"""Grids that follow a contact along their faces: when they go on, and what becomes of points that do.

A rectangle that is left behind becomes one ahead, with the same number; all others keep their place on the body and
what they remember.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fmd.contact.columns import view_at
from fmd.contact.curved_grid import CurvedGrid, GridFrame
from fmd.contact.histories import BORDER
from fmd.contact.surfaces import ContactSurface
from fmd.contact.tables import MOVED, ContactTable
from fmd.contact.touching_body import TouchingBody
from fmd.core.arrays import Array, IntArray
from fmd.core.limits.contact import GRID_LAG
from fmd.kernels.kernel import inner
from fmd.kernels.vectors import call_native


@inner
def travel(c: ContactTable, rotations: Array) -> None:
    """Let grids follow the lowest places of their faces at the end of a step that has been remembered."""
    if c.travel == 0:
        return
    for s in range(c.slave.size):
        if c.per_slope[s, 0] > 0.0 or c.per_slope[s, 1] > 0.0:
            _find_way(c, s, rotations)
            far = abs(c.asked[1] - c.lag[s, 0]) > GRID_LAG or abs(c.asked[2] - c.lag[s, 1]) > GRID_LAG
            if far:
                c.asked[0] = s
                following = (c.shapes, c.yields, c.G, c.supple, c.box, c.reach, c.border, c.slot, c.n_chosen)
                call_native(c.travel, (c.asked, c.middle, c.along, c.lag, c.cells, c.x, *following))
                _forget(c, s)


@inner
def _find_way(c: ContactTable, s: int, rotations: Array) -> None:
    """Find how many rectangles a surface's lowest place is from the middle of its grid, along both directions.

    The lowest point tells, which deflections move, too; away from the plane the attitude of the body.
    """
    lowest, least = -1, math.inf
    for i in range(c.point[s], c.point[s + 1]):
        if c.seen[i, 0] == 1 and c.free[i, 0] < least:
            lowest, least = i, c.free[i, 0]
    for a in range(2):
        way = 0.0
        for b in range(3):
            along, normal = c.along[s, 1 + a, b], 0.0
            for d in range(3):
                normal += rotations[c.link[c.slave[s]], d, b] * c.plane[s, 0, d]
            if lowest >= 0:
                way += along * (c.x[c.node[lowest], b] - c.middle[s, b]) / c.side[s, a]
            else:
                way -= along * normal * c.per_slope[s, a]
        c.asked[1 + a] = way if c.per_slope[s, a] > 0.0 else 0.0


@inner
def _forget(c: ContactTable, s: int) -> None:
    """Let points that are elsewhere remember nothing."""
    for i in range(c.point[s], c.point[s + 1]):
        if c.cells[c.node[i], 2] == 1:
            if c.force[i, 0] > 0.0:
                c.sums[c.contact[s], BORDER] = 1.0
            c.seen[i, 0], c.seen[i, 1], c.slid[i] = 0, 0, 0.0
            for a in range(3):
                c.force[i, a], c.own[i, a], c.moved[i, a], c.known[i, a] = 0.0, 0.0, 0.0, 0.0
        c.placed[c.node[i]] = -1


def travelling_grids(
    bodies: Sequence[TouchingBody], surfaces: Sequence[ContactSurface], first: IntArray, point: IntArray
) -> dict[int, tuple[TouchingBody, CurvedGrid, slice, slice]]:
    """Return grids that travel by the numbers of their surfaces, with their bodies, nodes and points.

    Bodies have nodes, and surfaces points, from ``first`` and ``point`` on, one more of each.
    """
    found = {}
    for s, own in enumerate(surfaces):
        body = bodies[own.slave]
        grid = body.points.grids.get(own.of.face)
        if grid and any(grid.travels):
            places = slice(*first[own.slave : own.slave + 2]), slice(*point[s : s + 2])
            found[s] = (body, grid, *places)
    return found


def lattices(
    grids: Mapping[int, tuple[TouchingBody, CurvedGrid, slice, slice]], n: int, n_nodes: int
) -> dict[str, Any]:
    """Return members of a table of so many surfaces and nodes that tell where grids are."""
    cells, middle, along = np.zeros((n_nodes if grids else 0, 3), dtype=np.int64), np.zeros((n, 3)), np.zeros((n, 3, 3))
    per_slope, side = np.zeros((n, 2)), np.ones((n, 2))
    for s, (_, grid, nodes, _) in grids.items():
        middle[s], along[s], side[s], cells[nodes, :2] = grid.start.place, grid.start.axes, grid.cell, grid.cells
        per_slope[s] = np.array(grid.travels) / (np.maximum(grid.curvatures, np.finfo(float).tiny) * side[s])
    places = {"middle": middle, "along": along, "lag": np.zeros((n, 2)), "side": side, "per_slope": per_slope}
    return {**places, "cells": cells, "asked": np.zeros(3)}


def travelling_function(
    grids: Mapping[int, tuple[TouchingBody, CurvedGrid, slice, slice]], arrays: Mapping[str, Any]
) -> int:
    """Return the address of what moves grids in a table with such arrays, by the numbers of surfaces; 0 without any.

    Ways that aren't numbers let nodes stay, and all that depends on where they are be found anew.
    """
    if not grids:
        return 0
    shapes, group = [arrays[name].shape for name in MOVED], arrays["group"]  # what is kept keeps no table

    def move(*places: int) -> None:
        whole = ("cells", "border", "slot", "n_chosen")
        kinds = [ctypes.c_int64 if name in whole else ctypes.c_double for name in MOVED]
        v = {name: view_at(*own) for name, *own in zip(MOVED, places, kinds, shapes, strict=True)}
        s = int(v["asked"][0])
        body, grid, nodes, points = grids[s]
        frame = GridFrame(v["middle"][s].copy(), v["along"][s].copy())
        cells, x = v["cells"][nodes], v["x"][nodes]
        if np.isfinite(v["asked"][1:]).all():
            way = v["asked"][1:]
            wanted = (np.sign(way) * np.floor(np.abs(way) + 1.0 - GRID_LAG)).astype(np.int64)
            frame, steps = _go_on(grid, frame, wanted, cells, x)
            v["lag"][s], v["middle"][s], v["along"][s] = way - steps, frame.place, frame.axes
        weights = grid.weights(x)
        v["G"][nodes, : len(x)] = grid.flexibility(cells[:, :2], weights, frame.axes)
        n_modes = body.points.shapes.shape[2]
        v["shapes"][nodes, :, :n_modes] = np.einsum("ip,pam->iam", weights, grid.points.shapes)
        at = 0
        for name in body.felt:
            v["yields"][nodes, :, at : at + 6] = np.einsum("ip,pak->iak", weights, grid.points.yields[name])
            at += 6
        v["supple"][points] = np.einsum("iiaa->i", v["G"][nodes, : len(x)])
        v["border"][nodes] = grid.edge[grid.numbers(cells[:, :2])]
        ends = np.stack([x.min(axis=0), x.max(axis=0)])
        v["box"][s] = np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1).reshape(8, 3)
        v["reach"][s, 0] = np.sqrt((v["shapes"][nodes] ** 2).sum(axis=(1, 2))).max(initial=0.0)
        v["slot"][points] = -1  # D, and P of all points, are of G before
        v["n_chosen"][np.searchsorted(group, points.start)] = 0

    function = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * len(MOVED))(move)
    next(iter(grids.values()))[1].functions.append(function)
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


def _go_on(grid: CurvedGrid, frame: GridFrame, wanted: IntArray, cells: Any, x: Array) -> tuple[GridFrame, IntArray]:
    """Move a grid on as far as its face goes, and return where it is, and by how many rectangles.

    Places x of points that are elsewhere then are changed, and those in the grid, with a mark of which they are.
    """
    cells[:, 2] = 0
    for only in np.array([(1, 1), (1, 0), (0, 1)]):
        steps = wanted * only
        if not steps.any():
            continue
        there = grid.goes_on(frame, steps)
        own = cells[:, :2] - steps
        left = grid.numbers(own) < 0
        ahead = np.setdiff1d(np.arange(len(own)), grid.numbers(own[~left]))
        places = grid.places(there, grid.cells[ahead])
        if grid.is_on_face(places):
            own[left], x[left] = grid.cells[ahead], places
            cells[:, :2], cells[:, 2] = own, left
            return there, steps
    return frame, 0 * wanted
