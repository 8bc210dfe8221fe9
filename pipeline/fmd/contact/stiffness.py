"""Stiffness of points that may close, ``P = D⁻¹``, by Gauss–Jordan's method, some rows at a time."""

from __future__ import annotations

import math

from fmd.contact.tables import ContactTable
from fmd.core.limits.code import DOUBLES_IN_LINE
from fmd.kernels.kernel import inner
from fmd.kernels.vectors import fill_vector, read_vector, write_vector


@inner
def invert_flexibility(c: ContactTable, g: int) -> bool:
    """Fill P of a group's chosen points; false if D isn't positive definite."""
    n, stride, at = 3 * c.n_chosen[g], c.stride[g], c.first_entry[g, 0]
    end = DOUBLES_IN_LINE * ((n + DOUBLES_IN_LINE - 1) // DOUBLES_IN_LINE)
    c.n_known[g] = 0
    for i in range(n):
        for k in range(end):
            c.P[at + i * stride + k] = c.D[at + i * stride + k] if k < n else 0.0
    first = 0
    while first < n:
        width = min(DOUBLES_IN_LINE, n - first)
        if not _invert_pivots(c, at + first * (stride + 1), stride, width):
            return False
        _take_rows(c, at + first * stride, stride, width, end)
        for i in range(n):
            if i < first or i >= first + width:
                _reduce_row(c, at + i * stride, first, width, end)
        for a in range(width):
            row = at + (first + a) * stride
            for k in range(end):
                c.pivot_rows[a * end + k] = c.pivot_rows[a * end + k] if k < n else 0.0
                c.P[row + k] = c.pivot_rows[a * end + k]
            for b in range(width):
                c.P[row + first + b] = c.pivots[a, b]
        first += DOUBLES_IN_LINE
    return True


@inner
def _invert_pivots(c: ContactTable, at: int, stride: int, width: int) -> bool:
    """Invert a square block on the diagonal of P into the pivots, with zeros around."""
    A = c.pivots
    for a in range(DOUBLES_IN_LINE):
        for b in range(DOUBLES_IN_LINE):
            A[a, b] = c.P[at + a * stride + b] if a < width and b < width else 0.0
    for k in range(width):
        if not 0.0 < A[k, k] < math.inf:
            return False
        pivot = 1.0 / A[k, k]
        for a in range(width):
            if a != k:
                times = A[a, k] * pivot
                for b in range(width):
                    if b != k:
                        A[a, b] -= times * A[k, b]
                A[a, k] = -times
        for b in range(width):
            A[k, b] = pivot if b == k else A[k, b] * pivot
    return True


@inner
def _take_rows(c: ContactTable, at: int, stride: int, width: int, end: int) -> None:
    """Fill the rows that all others are reduced by: the inverse pivots times their own."""
    for a in range(DOUBLES_IN_LINE):
        for k in range(end):
            c.pivot_rows[a * end + k] = 0.0
        for b in range(width if a < width else 0):
            k, many = 0, fill_vector(c.pivots[a, b], DOUBLES_IN_LINE)
            while k < end:
                more = many * read_vector(c.P, at + b * stride + k, DOUBLES_IN_LINE)
                write_vector(c.pivot_rows, a * end + k, read_vector(c.pivot_rows, a * end + k, DOUBLES_IN_LINE) + more)
                k += DOUBLES_IN_LINE


@inner
def _reduce_row(c: ContactTable, row: int, first: int, width: int, end: int) -> None:
    """Take from a row its part in the pivots' columns times their rows, eight at once."""
    at, R, k = row + first, c.pivot_rows, 0
    for a in range(DOUBLES_IN_LINE):
        c.lead[a] = c.P[at + a] if a < width else 0.0
    f0, f1 = fill_vector(c.lead[0], DOUBLES_IN_LINE), fill_vector(c.lead[1], DOUBLES_IN_LINE)
    f2, f3 = fill_vector(c.lead[2], DOUBLES_IN_LINE), fill_vector(c.lead[3], DOUBLES_IN_LINE)
    f4, f5 = fill_vector(c.lead[4], DOUBLES_IN_LINE), fill_vector(c.lead[5], DOUBLES_IN_LINE)
    f6, f7 = fill_vector(c.lead[6], DOUBLES_IN_LINE), fill_vector(c.lead[7], DOUBLES_IN_LINE)
    while k < end:
        one = f0 * read_vector(R, k, DOUBLES_IN_LINE) + f1 * read_vector(R, end + k, DOUBLES_IN_LINE)
        two = f2 * read_vector(R, 2 * end + k, DOUBLES_IN_LINE) + f3 * read_vector(R, 3 * end + k, DOUBLES_IN_LINE)
        one = (
            one + f4 * read_vector(R, 4 * end + k, DOUBLES_IN_LINE) + f5 * read_vector(R, 5 * end + k, DOUBLES_IN_LINE)
        )
        two = (
            two + f6 * read_vector(R, 6 * end + k, DOUBLES_IN_LINE) + f7 * read_vector(R, 7 * end + k, DOUBLES_IN_LINE)
        )
        write_vector(c.P, row + k, read_vector(c.P, row + k, DOUBLES_IN_LINE) - (one + two))
        k += DOUBLES_IN_LINE
    for b in range(width):
        total = 0.0
        for a in range(width):
            total -= c.lead[a] * c.pivots[a, b]
        c.P[at + b] = total
