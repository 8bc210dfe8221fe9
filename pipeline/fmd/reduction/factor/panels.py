"""Solutions by a factor of dense fronts, for as many loads at a time as a register of the processor holds.

A factor is read once for all of them, in one stream: of each 64 columns of a front the triangle comes in panels of four
columns, row by row, and what is below in tiles of eight rows, column by column. Rows are filled up with zeros to whole
tiles. Diagonals are kept as their inverses.
"""

from __future__ import annotations

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.memory import BLOCK, PANEL, TILE
from fmd.kernels.kernel import contracted, inlined, kernel
from fmd.kernels.machine import register_width
from fmd.kernels.vectors import fill_vector, read_vector, write_vector

LANES = register_width()  # loads at a time


@inlined
def padded(rows: int) -> int:
    """Return how many rows there are in the tiles of some."""
    return rows + (-rows) % TILE


def packed_entries(width: int, below: int) -> int:
    """Count what is kept of a front with this many columns, and this many rows below its own triangle."""
    own, under, count = padded(width), padded(below), 0
    for first in range(0, width, BLOCK):
        n = min(BLOCK, width - first)
        panels = (n + PANEL - 1) // PANEL
        count += PANEL**2 * panels * (panels + 1) // 2 + n * (own - first - padded(n) + under)
    return count


@kernel
def pack_front(D: Array, B: Array, L: Array, at: int) -> None:
    """Keep a front, whose columns are rows of D (w, w) and B (w, k), from ``L[at]`` on."""
    width, below = D.shape[0], B.shape[1]
    for first in range(0, width, BLOCK):
        last = min(first + BLOCK, width)
        for left in range(first, last, PANEL):
            for row in range(left, last + (first - last) % PANEL):
                for column in range(left, left + PANEL):
                    if row == column:
                        L[at] = 1.0 / D[row, row] if row < width else 1.0
                    else:
                        L[at] = D[column, row] if column < row < width else 0.0
                    at += 1
        if last == first + BLOCK:
            at = _pack_tiles(D, first, last, last, width, L, at)
        at = _pack_tiles(B, first, last, 0, below, L, at)


@inlined
def _pack_tiles(B: Array, first: int, last: int, begin: int, end: int, L: Array, at: int) -> int:
    """Keep rows of some columns in tiles; returns where they end."""
    n = B.shape[1]
    for top in range(begin, end, TILE):
        if top + TILE <= end:
            for column in range(first, last):
                write_vector(L, at, read_vector(B, n * column + top, TILE))
                at += TILE
        else:
            for column in range(first, last):
                for row in range(top, top + TILE):
                    L[at] = B[column, row] if row < end else 0.0
                    at += 1
    return at


@kernel
def solve_fronts(
    firsts: IntArray, widths: IntArray, ends: IntArray, rows: IntArray, begins: IntArray, L: Array, x: Array, z: Array
) -> None:
    """Solve ``L Lᵀ u = x`` in place, x (n, lanes); z (height, lanes) has room for any front's rows, filled up."""
    n = len(firsts)
    for k in range(n):
        first, width, below = firsts[k], widths[k], rows[ends[k] : ends[k + 1]]
        height = _gather(x, first, width, below, z)
        _forward(L, begins[k], z, width, height)
        _scatter(x, first, width, z)
        own = height - padded(len(below))
        for i in range(len(below)):
            write_vector(x, LANES * below[i], read_vector(z, LANES * (own + i), LANES))
    for k in range(n - 1, -1, -1):
        first, width = firsts[k], widths[k]
        height = _gather(x, first, width, rows[ends[k] : ends[k + 1]], z)
        _backward(L, begins[k + 1], z, width, height)
        _scatter(x, first, width, z)


@inlined
def _gather(x: Array, first: int, width: int, below: IntArray, z: Array) -> int:
    """Set z to a front's rows, its own and those below, both filled up with zeros; returns their number."""
    own = padded(width)
    height = own + padded(len(below))
    for i in range(width):
        write_vector(z, LANES * i, read_vector(x, LANES * (first + i), LANES))
    for i in range(width, own):
        write_vector(z, LANES * i, fill_vector(0.0, LANES))
    for i in range(len(below)):
        write_vector(z, LANES * (own + i), read_vector(x, LANES * below[i], LANES))
    for i in range(own + len(below), height):
        write_vector(z, LANES * i, fill_vector(0.0, LANES))
    return height


@inlined
def _scatter(x: Array, first: int, width: int, z: Array) -> None:
    for i in range(width):
        write_vector(x, LANES * (first + i), read_vector(z, LANES * i, LANES))


@contracted
def _forward(L: Array, at: int, z: Array, width: int, height: int) -> None:
    """Solve with a front's own triangle, and take off what its columns are in the rows below."""
    for first in range(0, width, BLOCK):
        n = min(BLOCK, width - first)
        end = first + n + (-n) % PANEL
        for left in range(first, end, PANEL):
            to = LANES * left
            y0 = L[at] * read_vector(z, to, LANES)
            y1 = L[at + 5] * (read_vector(z, to + LANES, LANES) - L[at + 4] * y0)
            y2 = L[at + 10] * (read_vector(z, to + 2 * LANES, LANES) - L[at + 8] * y0 - L[at + 9] * y1)
            y3 = read_vector(z, to + 3 * LANES, LANES) - L[at + 12] * y0 - L[at + 13] * y1
            y3 = L[at + 15] * (y3 - L[at + 14] * y2)
            write_vector(z, to, y0)
            write_vector(z, to + LANES, y1)
            write_vector(z, to + 2 * LANES, y2)
            write_vector(z, to + 3 * LANES, y3)
            at += PANEL * PANEL
            for i in range(left + PANEL, end):
                one = read_vector(z, LANES * i, LANES) - L[at] * y0 - L[at + 1] * y1
                write_vector(z, LANES * i, one - L[at + 2] * y2 - L[at + 3] * y3)
                at += PANEL
        for top in range(first + padded(n), height, TILE):
            to = LANES * top
            u0, u1 = read_vector(z, to, LANES), read_vector(z, to + LANES, LANES)
            u2, u3 = read_vector(z, to + 2 * LANES, LANES), read_vector(z, to + 3 * LANES, LANES)
            u4, u5 = read_vector(z, to + 4 * LANES, LANES), read_vector(z, to + 5 * LANES, LANES)
            u6, u7 = read_vector(z, to + 6 * LANES, LANES), read_vector(z, to + 7 * LANES, LANES)
            for j in range(first, first + n):
                y = read_vector(z, LANES * j, LANES)
                u0 = u0 - L[at] * y
                u1 = u1 - L[at + 1] * y
                u2 = u2 - L[at + 2] * y
                u3 = u3 - L[at + 3] * y
                u4 = u4 - L[at + 4] * y
                u5 = u5 - L[at + 5] * y
                u6 = u6 - L[at + 6] * y
                u7 = u7 - L[at + 7] * y
                at += TILE
            write_vector(z, to, u0)
            write_vector(z, to + LANES, u1)
            write_vector(z, to + 2 * LANES, u2)
            write_vector(z, to + 3 * LANES, u3)
            write_vector(z, to + 4 * LANES, u4)
            write_vector(z, to + 5 * LANES, u5)
            write_vector(z, to + 6 * LANES, u6)
            write_vector(z, to + 7 * LANES, u7)


@contracted
def _backward(L: Array, end: int, z: Array, width: int, height: int) -> None:
    """Solve with a front's transpose for its own rows, those below being known; the front ends before ``L[end]``."""
    for first in range((width - 1) // BLOCK * BLOCK, -1, -BLOCK):
        n = min(BLOCK, width - first)
        n_panels, below = (n + PANEL - 1) // PANEL, first + padded(n)
        end -= n * (height - below)
        at = end
        for top in range(below, height, TILE):
            to = LANES * top
            u0, u1 = read_vector(z, to, LANES), read_vector(z, to + LANES, LANES)
            u2, u3 = read_vector(z, to + 2 * LANES, LANES), read_vector(z, to + 3 * LANES, LANES)
            u4, u5 = read_vector(z, to + 4 * LANES, LANES), read_vector(z, to + 5 * LANES, LANES)
            u6, u7 = read_vector(z, to + 6 * LANES, LANES), read_vector(z, to + 7 * LANES, LANES)
            for j in range(first, first + n):
                y = read_vector(z, LANES * j, LANES) - L[at] * u0 - L[at + 1] * u1 - L[at + 2] * u2 - L[at + 3] * u3
                y = y - L[at + 4] * u4 - L[at + 5] * u5 - L[at + 6] * u6 - L[at + 7] * u7
                write_vector(z, LANES * j, y)
                at += TILE
        for panel in range(n_panels - 1, -1, -1):
            rows = PANEL * (n_panels - panel)
            end -= PANEL * rows
            left = first + PANEL * panel
            at, to = end + PANEL * PANEL, LANES * left
            y0, y1 = read_vector(z, to, LANES), read_vector(z, to + LANES, LANES)
            y2, y3 = read_vector(z, to + 2 * LANES, LANES), read_vector(z, to + 3 * LANES, LANES)
            for i in range(left + PANEL, left + rows):
                u = read_vector(z, LANES * i, LANES)
                y0 = y0 - L[at] * u
                y1 = y1 - L[at + 1] * u
                y2 = y2 - L[at + 2] * u
                y3 = y3 - L[at + 3] * u
                at += PANEL
            y3 = L[end + 15] * y3
            y2 = L[end + 10] * (y2 - L[end + 14] * y3)
            y1 = L[end + 5] * (y1 - L[end + 9] * y2 - L[end + 13] * y3)
            y0 = L[end] * (y0 - L[end + 4] * y1 - L[end + 8] * y2 - L[end + 12] * y3)
            write_vector(z, to, y0)
            write_vector(z, to + LANES, y1)
            write_vector(z, to + 2 * LANES, y2)
            write_vector(z, to + 3 * LANES, y3)
