"""Forces with Coulomb's friction by Newton's method, from the flexibility D of points that may close or its inverse P.

With y where points stand and u where they come to, ``u = y + D λ`` and ``λ = P (u − y)``. Points that stick have
``u = 0``, open ones ``λ = 0``, those that slip ``u_n = 0`` and ``λ_t = μ p_n p_t/|p_t|`` with ``p = λ − u/ρ``. Unknown
are λ of closed points, or u of those that don't stick, whichever are fewer. Each round finds states anew by p (Alart &
Curnier, Comput Methods Appl Mech Eng 92, 1991), and turns slip within the cone (Hüeber, Stadler & Wohlmuth, SIAM J Sci
Comput 30, 2008). Factors of the equations stay as long as states do and rounds settle by them; steps by factors of an
earlier round are corrected as of Broyden.
"""

from __future__ import annotations

import math

from fmd.contact.dense import add_rows, dot, factor_equations, solve_equations
from fmd.contact.known_responses import respond_to_places, turn_places
from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array
from fmd.core.limits.code import DOUBLES_IN_LINE
from fmd.core.limits.contact import MOST_CORRECTED, NEWTON_ROUNDS, SLOW_ROUND, SMALL_FORCE, TRIED_RATE
from fmd.kernels.kernel import inlined, inner

OPEN, STICKS, SLIPS = 0, 1, 2


@inner
def find_forces_by_newton(c: ContactTable, g: int, least: float) -> bool:
    """Find forces and displacements of a group's chosen points from those at hand; false if they don't settle.

    The least own flexibility of a point tells what round-off of places may do to forces. Where P isn't known, more
    closed points than a third of all are left to others.
    """
    count, largest, change = c.n_chosen[g], 0.0, math.inf
    for own in range(count):
        largest = max(largest, c.force[c.chosen[c.group[g] + own], 0])
    _note_states(c, g, largest == 0.0)
    turn_places(c, g)
    responded, anew, changed, flexible, kept = False, True, False, False, 0
    for _ in range(NEWTON_ROUNDS):
        closed, loose = 0, 0
        for own in range(count):
            closed += 0 if c.grip[own] == OPEN else 3
            loose += 3 if c.grip[own] == OPEN else 2 if c.grip[own] == SLIPS else 0
        if c.inverted[g] != 1 and closed > count:
            return False
        anew = anew or flexible != (c.inverted[g] != 1 or closed < loose)
        flexible = c.inverted[g] != 1 or closed < loose
        if not (flexible or responded):
            respond_to_places(c, g, SMALL_FORCE * largest * least + c.noise[g])
            responded = True
        if anew:
            _begin(c, g, flexible)
        elif changed:
            _let_go(c, g, flexible)
        kept = 0 if anew or changed else kept
        fresh = _solve_states(c, g, flexible, kept)
        kept = 1 if fresh == 1 else kept + 1
        if fresh < 0:
            return False
        before, change, largest, anew, changed = change, 0.0, 0.0, False, False
        for own in range(count):
            i, grip = c.chosen[c.group[g] + own], c.grip[own]
            bound = _try(c, g, i, own)
            p0, p1, p2 = c.trial[own, 0], c.trial[own, 1], c.trial[own, 2]
            n, size = max(0.0, p0), math.sqrt(p1 * p1 + p2 * p2)
            share = bound / size if size > bound else 1.0
            off0, off1, off2 = c.force[i, 0] - n, c.force[i, 1] - share * p1, c.force[i, 2] - share * p2
            if not abs(off0) + abs(off1) + abs(off2) < math.inf:  # which max passes over
                return False
            change = max(change, abs(off0), abs(off1), abs(off2))
            largest, changed = max(largest, n), changed or c.grip[own] != grip
        rounded = change <= c.noise[g] / least and (fresh == 1 or change > 0.5 * before)
        if rounded or change <= SMALL_FORCE * largest:
            _note_displacements(c, g)
            return True
        if fresh == 0 and change > SLOW_ROUND * before:
            c.kept[0] = -1
    return False


@inner
def _note_states(c: ContactTable, g: int, touches: bool) -> None:
    """Note the states of points by the forces at hand; where there are none, what has come below its plane sticks."""
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        n, bound, soft = c.force[i, 0], c.friction[c.surface[i]] * c.force[i, 0], _rate(c, g, own)
        size = math.sqrt(c.force[i, 1] ** 2 + c.force[i, 2] ** 2)
        c.grip[own] = STICKS
        if n <= 0.0:
            c.grip[own] = STICKS if touches and c.free[i, 0] < 0.0 else OPEN
        elif size >= (1.0 - SMALL_FORCE) * bound:
            c.grip[own] = SLIPS
        for a in range(3):
            c.slack[own, a] = c.slack[own, a] if c.kept[0] == g and c.grip[own] != STICKS else 0.0
            c.trial[own, a] = c.force[i, a] - c.slack[own, a] / soft


@inner
def _note_displacements(c: ContactTable, g: int) -> None:
    """Bring forces into their cones, and write the displacements of chosen points in own axes."""
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        p0, p1, p2 = c.trial[own, 0], c.trial[own, 1], c.trial[own, 2]
        n, size = max(0.0, p0), math.sqrt(p1 * p1 + p2 * p2)
        bound = c.friction[c.surface[i]] * n
        share = bound / size if size > bound else 1.0
        c.force[i, 0], c.force[i, 1], c.force[i, 2] = n, share * p1, share * p2
        for k in range(3):
            c.answer[3 * own + k] = 0.0
            for a in range(3):
                c.answer[3 * own + k] += c.turned[i, a, k] * (c.slack[own, a] - c.free[i, a])


@inlined
def _try(c: ContactTable, g: int, i: int, own: int) -> float:
    """Find a point's trial force p and its state, and return its bound."""
    soft = _rate(c, g, own)
    for a in range(3):
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
    """Return ρ of a point, its own flexibility, where P is known no more than a few times that with all others held."""
    on = c.stride[g] + 1
    at = c.first_entry[g, 0] + 3 * own * on
    soft = max(c.D[at], c.D[at + on], c.D[at + 2 * on])
    if c.inverted[g] == 1:
        soft = min(soft, TRIED_RATE / max(c.P[at], c.P[at + on], c.P[at + 2 * on]))
    return float(soft)


@inlined
def _first_unknown(c: ContactTable, own: int, flexible: bool) -> int:
    """Return which of a point's forces, or displacements, is its first unknown; 3 without."""
    if flexible:
        return 3 if c.grip[own] == OPEN else 0
    return 0 if c.grip[own] == OPEN else 1 if c.grip[own] == SLIPS else 3


@inner
def _begin(c: ContactTable, g: int, flexible: bool) -> None:
    """Find displacements by the forces of closed points, or forces by the displacements of those that don't stick."""
    for k in range(c.response.size):
        c.response[k] = c.left[k] if flexible else c.held[k]
    for own in range(c.n_chosen[g]):
        i, first = c.chosen[c.group[g] + own], _first_unknown(c, own, flexible)
        for a in range(3):
            c.step[own, a] = 0.0
            if a >= first:
                c.step[own, a] = c.force[i, a] if flexible else c.slack[own, a]
            if flexible:
                c.force[i, a] = 0.0
            else:
                c.slack[own, a] = 0.0
    _move(c, g, flexible)


@inner
def _let_go(c: ContactTable, g: int, flexible: bool) -> None:
    """Let forces of points that have come to open be zero, or displacements of those that have come to stick."""
    for own in range(c.n_chosen[g]):
        i, first = c.chosen[c.group[g] + own], _first_unknown(c, own, flexible)
        for a in range(3):
            c.step[own, a] = 0.0
            if a < first:
                c.step[own, a] = -c.force[i, a] if flexible else -c.slack[own, a]
    _move(c, g, flexible)


@inner
def _move(c: ContactTable, g: int, flexible: bool) -> None:
    """Add a step of the unknowns to them, and what follows from it to forces and displacements of all."""
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        s0, s1, s2 = c.step[own, 0], c.step[own, 1], c.step[own, 2]
        f0 = c.turned[i, 0, 0] * s0 + c.turned[i, 1, 0] * s1 + c.turned[i, 2, 0] * s2
        f1 = c.turned[i, 0, 1] * s0 + c.turned[i, 1, 1] * s1 + c.turned[i, 2, 1] * s2
        f2 = c.turned[i, 0, 2] * s0 + c.turned[i, 1, 2] * s1 + c.turned[i, 2, 2] * s2
        if (f0 != 0.0 or f1 != 0.0 or f2 != 0.0) and flexible:
            add_rows(c, c.D, g, own, f0, f1, f2, c.response)
        elif f0 != 0.0 or f1 != 0.0 or f2 != 0.0:
            add_rows(c, c.P, g, own, f0, f1, f2, c.response)
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        for a in range(3):
            total = 0.0
            for k in range(3):
                total += c.turned[i, a, k] * c.response[3 * own + k]
            if flexible:
                c.force[i, a], c.slack[own, a] = c.force[i, a] + c.step[own, a], total
            else:
                c.force[i, a], c.slack[own, a] = total, c.slack[own, a] + c.step[own, a]


@inner
def _solve_states(c: ContactTable, g: int, flexible: bool, kept: int) -> int:
    """Take a step towards forces and displacements that suit the states.

    Returns 1 with equations factored for it, 0 with those kept, -1 if they are singular.
    """
    n, same = 0, c.kept[0] == g and c.kept[1] == (1 if flexible else 0)
    for own in range(c.n_chosen[g]):
        c.place_in[own] = n
        n += 3 - _first_unknown(c, own, flexible)
        same = same and c.grip[own] == c.grip_then[own]
    width = DOUBLES_IN_LINE * ((n + DOUBLES_IN_LINE - 1) // DOUBLES_IN_LINE)
    for own in range(c.n_chosen[g]):
        c.grip_then[own] = c.grip[own]
        if _first_unknown(c, own, flexible) < 3:
            _find_equations(c, g, own)
            _find_fault(c, g, own, flexible)
            if not same and flexible:
                _write_rows(c, c.D, c.product, c.block, g, own, width, flexible)
            elif not same:
                _write_rows(c, c.P, c.block, c.product, g, own, width, flexible)
    if n > 0 and not same:
        c.kept[0] = -1
        if not factor_equations(c, n, width):
            return -1
        c.kept[0], c.kept[1] = g, 1 if flexible else 0
    if n > 0:
        solve_equations(c, n, width)
        _correct_step(c, n, kept if same else 0)
    for own in range(c.n_chosen[g]):
        first = _first_unknown(c, own, flexible)
        for a in range(3):
            c.step[own, a] = c.right[c.place_in[own] + a - first] if a >= first else 0.0
    _move(c, g, flexible)
    return 0 if same else 1


@inner
def _correct_step(c: ContactTable, n: int, kept: int) -> None:
    """Correct a step by what earlier ones with the same factors have changed (Broyden, Math Comput 19, 1965).

    As in Kelley, Iterative Methods for Linear and Nonlinear Equations, SIAM 1995, from steps alone.
    """
    most, share = c.response.size, 0.0
    for j in range(kept):
        at = j * most
        share = dot(c.steps, at, c.right, 0, n) / dot(c.steps, at, c.steps, at, n)
        for k in range(n if j + 1 < kept else 0):
            c.right[k] += share * c.steps[at + most + k]
    times = 1.0 / (1.0 - min(share, MOST_CORRECTED))
    for k in range(n):
        c.right[k] *= times
        c.steps[kept * most + k] = c.right[k]


@inner
def _find_equations(c: ContactTable, g: int, own: int) -> None:
    """Find a point's equations in its state, ``E λ + F u = 0``, along its axes: E in the block, F in the product."""
    E, F, soft, mu = c.block, c.product, _rate(c, g, own), c.friction[c.surface[c.chosen[c.group[g] + own]]]
    for a in range(3):
        for b in range(3):
            same = 1.0 if a == b else 0.0
            E[a, b] = same if c.grip[own] == OPEN else 0.0
            F[a, b] = same / soft if c.grip[own] != OPEN else 0.0
    if c.grip[own] == SLIPS:
        p0, p1, p2 = c.trial[own, 0], c.trial[own, 1], c.trial[own, 2]
        size = math.sqrt(p1 * p1 + p2 * p2)
        t1, t2 = (p1 / size, p2 / size) if size > 0.0 else (0.0, 0.0)
        share = min(1.0, mu * p0 / size) if size > 0.0 else 0.0
        E[1, 0], E[2, 0] = -mu * t1, -mu * t2
        E[1, 1], E[1, 2] = 1.0 - share * (1.0 - t1 * t1), share * t1 * t2
        E[2, 1], E[2, 2] = share * t1 * t2, 1.0 - share * (1.0 - t2 * t2)
        F[1, 1], F[1, 2] = share * (1.0 - t1 * t1) / soft, -share * t1 * t2 / soft
        F[2, 1], F[2, 2] = -share * t1 * t2 / soft, share * (1.0 - t2 * t2) / soft


@inlined
def _find_fault(c: ContactTable, g: int, own: int, flexible: bool) -> None:
    """Write what is missing in a point's equations as their right sides."""
    i, first = c.chosen[c.group[g] + own], _first_unknown(c, own, flexible)
    for a in range(first, 3):
        total = 0.0
        for b in range(3):
            total -= c.block[a, b] * c.force[i, b] + c.product[a, b] * c.slack[own, b]
        c.right[c.place_in[own] + a - first] = total


@inner
def _write_rows(
    c: ContactTable, X: Array, of_all: Array, of_own: Array, g: int, own: int, width: int, flexible: bool
) -> None:
    """Write a point's equations for all unknowns: X times one part, by what follows from these, plus the other."""
    i, first, r = c.chosen[c.group[g] + own], _first_unknown(c, own, flexible), c.way
    for a in range(first, 3):
        for k in range(3):  # turned to own axes
            r[0, k] = 0.0
            for b in range(3):
                r[0, k] += of_all[a, b] * c.turned[i, b, k]
        for k in range(c.mixed.size):
            c.mixed[k] = 0.0
        add_rows(c, X, g, own, r[0, 0], r[0, 1], r[0, 2], c.mixed)
        row = (c.place_in[own] + a - first) * width
        for other in range(c.n_chosen[g]):
            left = _first_unknown(c, other, flexible)
            if left < 3:
                j, at = c.chosen[c.group[g] + other], 3 * other
                x0, x1, x2 = c.mixed[at], c.mixed[at + 1], c.mixed[at + 2]
                for b in range(left, 3):
                    entry = x0 * c.turned[j, b, 0] + x1 * c.turned[j, b, 1] + x2 * c.turned[j, b, 2]
                    c.M[row + c.place_in[other] + b - left] = entry
        for b in range(first, 3):
            c.M[row + c.place_in[own] + b - first] += of_own[a, b]
