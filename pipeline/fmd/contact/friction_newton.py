"""Forces with Coulomb's friction by Newton's method, from the stiffness ``P = D⁻¹`` of points that may close.

With y where points stand and u where they come to, forces are ``λ = P (u − y)``. Points that stick have ``u = 0``, so
that the others' u alone is unknown: open points have ``λ = 0``, those that slip ``u_n = 0`` and ``λ_t = μ p_n
p_t/|p_t|`` with ``p = λ − u/ρ``. Each round finds states anew by p (Alart & Curnier, Comput Methods Appl Mech Eng 92,
1991), and turns slip within the cone (Hüeber, Stadler & Wohlmuth, SIAM J Sci Comput 30, 2008).
"""

from __future__ import annotations

import math

from fmd.contact.tables import ContactTable
from fmd.core.limits.code import DOUBLES_IN_LINE
from fmd.core.limits.contact import KNOWN_RESPONSES, NEWTON_ROUNDS, SMALL_FORCE
from fmd.kernels.kernel import inlined, inner
from fmd.kernels.vectors import fill_vector, read_vector, write_vector

OPEN, STICKS, SLIPS = 0, 1, 2


@inner
def count_loose(c: ContactTable, g: int) -> int:
    """Return how many unknowns points have that didn't stick with the forces at hand, and note the points' states."""
    loose = 0
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        n, bound = c.force[i, 0], c.friction[c.surface[i]] * c.force[i, 0]
        size = math.sqrt(c.force[i, 1] ** 2 + c.force[i, 2] ** 2)
        c.grip[own] = STICKS
        c.trial[own, 0], c.trial[own, 1], c.trial[own, 2] = n, c.force[i, 1], c.force[i, 2]
        if n <= 0.0:
            c.grip[own] = OPEN
        elif size >= (1.0 - SMALL_FORCE) * bound:
            c.grip[own] = SLIPS
        loose += 3 if c.grip[own] == OPEN else 2 if c.grip[own] == SLIPS else 0
        for a in range(3):
            c.slack[own, a] = 0.0
    return loose


@inner
def find_forces_by_newton(c: ContactTable, g: int, least: float) -> bool:
    """Find forces and displacements of a group's chosen points from the states noted; false if they don't settle.

    The least own flexibility of a point tells what round-off of places may do to forces.
    """
    first, count = c.group[g], c.n_chosen[g]
    largest = 0.0
    for own in range(count):
        largest = max(largest, c.trial[own, 0])
    _respond(c, g, SMALL_FORCE * largest * least + c.noise[g])
    for _ in range(NEWTON_ROUNDS):
        if not _solve_loose(c, g):
            return False
        change, largest = 0.0, 0.0
        for own in range(count):
            i = c.chosen[first + own]
            bound = _try(c, g, i, own)
            p0, p1, p2 = c.trial[own, 0], c.trial[own, 1], c.trial[own, 2]
            n, size = max(0.0, p0), math.sqrt(p1 * p1 + p2 * p2)
            share = bound / size if size > bound else 1.0
            off0, off1, off2 = c.force[i, 0] - n, c.force[i, 1] - share * p1, c.force[i, 2] - share * p2
            change = max(change, abs(off0), abs(off1), abs(off2))
            largest = max(largest, n)
            c.force[i, 0], c.force[i, 1], c.force[i, 2] = n, share * p1, share * p2
        if change <= SMALL_FORCE * largest + c.noise[g] / least:
            _note_displacements(c, g)
            return True
    return False


@inner
def _note_displacements(c: ContactTable, g: int) -> None:
    """Write the displacements of chosen points in own axes."""
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        for k in range(3):
            c.answer[3 * own + k] = 0.0
            for a in range(3):
                c.answer[3 * own + k] += c.turned[i, a, k] * (c.slack[own, a] - c.free[i, a])


@inlined
def _try(c: ContactTable, g: int, i: int, own: int) -> float:
    """Find a point's λ by the displacements, its trial force p and its state, and return its bound."""
    soft = _rate(c, g, own)
    for a in range(3):
        c.force[i, a] = 0.0
        for k in range(3):
            c.force[i, a] += c.turned[i, a, k] * c.response[3 * own + k]
        c.trial[own, a] = c.force[i, a] - c.slack[own, a] / soft
    bound = c.friction[c.surface[i]] * max(0.0, c.trial[own, 0])
    c.grip[own] = STICKS
    if c.trial[own, 0] <= 0.0:
        c.grip[own] = OPEN
    elif math.sqrt(c.trial[own, 1] ** 2 + c.trial[own, 2] ** 2) > bound:
        c.grip[own] = SLIPS
    return float(bound)


@inlined
def _rate(c: ContactTable, g: int, own: int) -> float:
    """Return ρ of a point, its own flexibility."""
    at = c.first_entry[g, 0] + 3 * own * (c.stride[g] + 1)
    return float(max(c.D[at], c.D[at + c.stride[g] + 1], c.D[at + 2 * c.stride[g] + 2]))


@inner
def _respond(c: ContactTable, g: int, small: float) -> None:
    """Find ``−P y`` from what is known of P, and what is left of y by a product with P, which is then known, too.

    Points that stick on a plane stand at few combinations of their body's place, turn and modes, so that after some
    steps nothing is left.
    """
    n, most = 3 * c.n_chosen[g], c.response.size
    begin = 2 * KNOWN_RESPONSES * most * g
    if c.n_known[g] == KNOWN_RESPONSES:
        c.n_known[g] = 0
    for k in range(most):
        c.held[k], c.left[k] = 0.0, 0.0
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        for k in range(3):
            for a in range(3):
                c.left[3 * own + k] += c.turned[i, a, k] * c.free[i, a]
    for known in range(c.n_known[g]):
        at, there = begin + 2 * known * most, 0.0
        there = _product(c, at, n)
        _add(c, at, -there, n, False)
        _add(c, at + most, -there, n, True)
    size, largest = 0.0, 0.0
    for k in range(n):
        size += c.left[k] ** 2
        largest = max(largest, abs(c.left[k]))
    if largest > small:
        size = math.sqrt(size)
        at = begin + 2 * c.n_known[g] * most
        for k in range(most):
            c.known_response[at + k], c.known_response[at + most + k] = c.left[k] / size, 0.0
            c.response[k] = 0.0
        for k in range(n):
            _add_row(c, g, k, c.known_response[at + k])
        for k in range(n):
            c.known_response[at + most + k] = c.response[k]
        _add(c, at + most, -size, n, True)
        c.n_known[g] += 1


@inner
def _product(c: ContactTable, at: int, n: int) -> float:
    """Return the product of a known direction with what is left of y, in four sums that don't wait for one another."""
    s0, s1, s2, s3, k = 0.0, 0.0, 0.0, 0.0, 0
    while k < n:  # zeros stand behind
        s0 += c.known_response[at + k] * c.left[k]
        s1 += c.known_response[at + k + 1] * c.left[k + 1]
        s2 += c.known_response[at + k + 2] * c.left[k + 2]
        s3 += c.known_response[at + k + 3] * c.left[k + 3]
        k += 4
    return (s0 + s1) + (s2 + s3)


@inner
def _add(c: ContactTable, at: int, times: float, n: int, to_forces: bool) -> None:
    """Add a known direction to what is left of y, or a known response to the forces of held points."""
    k, many = 0, fill_vector(times, DOUBLES_IN_LINE)
    while k < n:
        more = many * read_vector(c.known_response, at + k, DOUBLES_IN_LINE)
        if to_forces:
            write_vector(c.held, k, read_vector(c.held, k, DOUBLES_IN_LINE) + more)
        else:
            write_vector(c.left, k, read_vector(c.left, k, DOUBLES_IN_LINE) + more)
        k += DOUBLES_IN_LINE


@inner
def _add_row(c: ContactTable, g: int, row: int, times: float) -> None:
    """Add a row of P to the response."""
    k, at, many = 0, c.first_entry[g, 0] + row * c.stride[g], fill_vector(times, DOUBLES_IN_LINE)
    while k < 3 * c.n_chosen[g]:
        more = many * read_vector(c.P, at + k, DOUBLES_IN_LINE)
        write_vector(c.response, k, read_vector(c.response, k, DOUBLES_IN_LINE) + more)
        k += DOUBLES_IN_LINE


@inner
def _solve_loose(c: ContactTable, g: int) -> bool:
    """Find the displacements of points that don't stick in their states, and all forces by these; false if it fails."""
    first, count, n = c.group[g], c.n_chosen[g], 0
    for own in range(count):
        for a in range(3):
            c.slack[own, a] = 0.0 if c.grip[own] == STICKS else c.slack[own, a]
        c.place_in[own] = n
        n += 3 if c.grip[own] == OPEN else 2 if c.grip[own] == SLIPS else 0
    width = DOUBLES_IN_LINE * ((n + DOUBLES_IN_LINE) // DOUBLES_IN_LINE)
    for own in range(count):
        if c.grip[own] != STICKS:
            _write_rows(c, g, own, n, width)
    if not _eliminate(c, n, width):
        return False
    for k in range(c.response.size):
        c.response[k] = c.held[k]
    for own in range(count):
        if c.grip[own] == STICKS:
            continue
        i, skipped = c.chosen[first + own], 1 if c.grip[own] == SLIPS else 0
        c.slack[own, 0] = 0.0
        for a in range(skipped, 3):
            c.slack[own, a] = c.M[(c.place_in[own] + a - skipped) * width + n]
        for k in range(3):
            moved = 0.0
            for a in range(3):
                moved += c.turned[i, a, k] * c.slack[own, a]
            _add_row(c, g, 3 * own + k, moved)
    return True


@inner
def _write_rows(c: ContactTable, g: int, own: int, n: int, width: int) -> None:
    """Write the equations of a point that doesn't stick: ``E λ + F u = r``, with λ by the displacements of all."""
    first, i, skipped = c.group[g], c.chosen[c.group[g] + own], 1 if c.grip[own] == SLIPS else 0
    E, F, r, soft = c.block, c.product, c.way, _rate(c, g, own)
    for a in range(3):
        r[0, a] = 0.0
        for b in range(3):
            E[a, b], F[a, b] = 1.0 if a == b else 0.0, 0.0
    if c.grip[own] == SLIPS:
        p0, p1, p2, mu = c.trial[own, 0], c.trial[own, 1], c.trial[own, 2], c.friction[c.surface[i]]
        size = math.sqrt(p1 * p1 + p2 * p2)
        t1, t2 = (p1 / size, p2 / size) if size > 0.0 else (0.0, 0.0)
        share = min(1.0, mu * p0 / size) if size > 0.0 else 0.0
        E[1, 0], E[2, 0] = -mu * t1, -mu * t2
        E[1, 1], E[1, 2] = 1.0 - share * (1.0 - t1 * t1), share * t1 * t2
        E[2, 1], E[2, 2] = share * t1 * t2, 1.0 - share * (1.0 - t2 * t2)
        F[1, 1], F[1, 2] = share * (1.0 - t1 * t1) / soft, -share * t1 * t2 / soft
        F[2, 1], F[2, 2] = -share * t1 * t2 / soft, share * (1.0 - t2 * t2) / soft
    for a in range(skipped, 3):  # E, turned to own axes
        for k in range(3):
            r[1, k] = 0.0
            for b in range(3):
                r[1, k] += E[a, b] * c.turned[i, b, k]
        row = (c.place_in[own] + a - skipped) * width
        p = c.first_entry[g, 0] + 3 * own * c.stride[g]
        for other in range(c.n_chosen[g]):
            if c.grip[other] == STICKS:
                continue
            j, at, left = c.chosen[first + other], p + 3 * other, 1 if c.grip[other] == SLIPS else 0
            for k in range(3):
                r[2, k] = r[1, 0] * c.P[at + k] + r[1, 1] * c.P[at + c.stride[g] + k]
                r[2, k] += r[1, 2] * c.P[at + 2 * c.stride[g] + k]
            for b in range(left, 3):
                entry = F[a, b] if other == own else 0.0
                for k in range(3):
                    entry += r[2, k] * c.turned[j, b, k]
                c.M[row + c.place_in[other] + b - left] = entry
        c.M[row + n] = -r[1, 0] * c.held[3 * own] - r[1, 1] * c.held[3 * own + 1] - r[1, 2] * c.held[3 * own + 2]


@inner
def _eliminate(c: ContactTable, n: int, width: int) -> bool:
    """Solve n equations, whose right side is the column behind, with row pivots; false if they are singular."""
    for k in range(n):
        best, at = 0.0, k
        for i in range(k, n):
            if abs(c.M[i * width + k]) > best:
                best, at = abs(c.M[i * width + k]), i
        if not 0.0 < best < math.inf:
            return False
        if at != k:
            for j in range(k, n + 1):
                c.M[k * width + j], c.M[at * width + j] = c.M[at * width + j], c.M[k * width + j]
        begin = DOUBLES_IN_LINE * (k // DOUBLES_IN_LINE)
        for i in range(k + 1, n):
            times = -c.M[i * width + k] / c.M[k * width + k]
            if times != 0.0:
                many, j = fill_vector(times, DOUBLES_IN_LINE), begin
                while j <= n:
                    more = many * read_vector(c.M, k * width + j, DOUBLES_IN_LINE)
                    write_vector(c.M, i * width + j, read_vector(c.M, i * width + j, DOUBLES_IN_LINE) + more)
                    j += DOUBLES_IN_LINE
    for back in range(n):
        k = n - 1 - back
        total = c.M[k * width + n]
        for j in range(k + 1, n):
            total -= c.M[k * width + j] * c.M[j * width + n]
        c.M[k * width + n] = total / c.M[k * width + k]
    return True
