"""Normal forces on points by active sets: ``g = y + D λ ≥ 0``, ``λ ≥ 0``, ``gᵀ λ = 0``, D positive definite."""

from __future__ import annotations

import math

from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array
from fmd.core.limits.contact import BLOCK_CHANGES, SET_CHANGES, SMALL_FORCE
from fmd.kernels.kernel import inlined, inner


@inlined
def compliance(c: ContactTable, first: int, i: int, j: int, a: int, b: int) -> float:
    """Return how far point i moves along its axis a by a unit force on point j along its axis b."""
    total = 0.0
    for k in range(3):
        for m in range(3):
            total += c.turned[i, a, k] * c.G[i, j - first, k, m] * c.turned[j, b, m]
    return float(total)


@inner
def spread_forces(c: ContactTable, body: int) -> None:
    """Turn the forces on a body's points into its axes, and find the displacements by them."""
    first, last = c.first[body], c.first[body + 1]
    for i in range(first, last):
        for k in range(3):
            c.own[i, k], c.moved[i, k] = 0.0, 0.0
            for a in range(3):
                c.own[i, k] += c.force[i, a] * c.turned[i, a, k]
    for j in range(first, last):
        if c.force[j, 0] != 0.0:
            for i in range(first, last):
                for k in range(3):
                    for m in range(3):
                        c.moved[i, k] += c.G[i, j - first, k, m] * c.own[j, m]


@inlined
def place_now(c: ContactTable, i: int, a: int) -> float:
    """Return where a point stands along an axis of its plane with the displacement by forces."""
    total = c.free[i, a]
    for k in range(3):
        total += c.turned[i, a, k] * c.moved[i, k]
    return float(total)


@inner
def find_normal_forces(c: ContactTable, body: int) -> bool:
    """Find the forces on a body's points from those that were active before; false if that has no end.

    All points that are wrong change sides at once (Kunisch & Rendl, SIAM J Optim 14, 2003); if they go on doing so,
    the worst alone.
    """
    first, last = c.first[body], c.first[body + 1]
    for change in range(SET_CHANGES):
        count = 0
        for i in range(first, last):
            if c.active[i] != 0:
                c.b[count] = -c.free[i, 0]
                row = 0
                for j in range(first, i + 1):
                    if c.active[j] != 0:
                        c.A[count, row] = compliance(c, first, i, j, 0, 0)
                        row += 1
                count += 1
        if not _solve(c.A, c.b, count):
            return False
        count, largest = 0, 0.0
        for i in range(first, last):
            c.force[i, 0] = 0.0
            if c.active[i] != 0:
                c.force[i, 0] = c.b[count]
                largest = max(largest, abs(c.b[count]))
                count += 1
        spread_forces(c, body)
        worst, at, wrong = 0.0, -1, 0
        for i in range(first, last):
            own = compliance(c, first, i, i, 0, 0)
            fault = -c.force[i, 0] * own if c.active[i] != 0 else -place_now(c, i, 0)
            if fault > SMALL_FORCE * largest * own + c.noise[body]:
                wrong += 1
                if fault > worst:
                    worst, at = fault, i
                if change < BLOCK_CHANGES:
                    c.active[i] = 1 - c.active[i]
        if wrong == 0:
            return True
        if change >= BLOCK_CHANGES:
            c.active[at] = 1 - c.active[at]
    return False


@inner
def _solve(A: Array, b: Array, n: int) -> bool:
    """Solve ``A x = b`` of size n by Cholesky's method into b, from the lower half of A, in its place."""
    for j in range(n):
        pivot = A[j, j]
        for k in range(j):
            pivot -= A[j, k] * A[j, k]
        if not pivot > 0.0:
            return False
        A[j, j] = math.sqrt(pivot)
        for i in range(j + 1, n):
            entry = A[i, j]
            for k in range(j):
                entry -= A[i, k] * A[j, k]
            A[i, j] = entry / A[j, j]
    for i in range(n):
        for k in range(i):
            b[i] -= A[i, k] * b[k]
        b[i] /= A[i, i]
    for back in range(n):
        i = n - 1 - back
        for k in range(i + 1, n):
            b[i] -= A[k, i] * b[k]
        b[i] /= A[i, i]
    return True
