"""Forces and displacements that closed points have answered to gaps in some directions, which needn't be solved again.

Points on a plane stand at few combinations of their body's place, turn and modes: after some steps nothing is left.
"""

from __future__ import annotations

import math

from fmd.contact.dense import add_rows, add_times, dot, solve_active
from fmd.contact.tables import ContactTable
from fmd.core.limits.contact import KNOWN_RESPONSES
from fmd.kernels.kernel import inner


@inner
def respond_to_gaps(c: ContactTable, g: int) -> None:
    """Find forces on active points into b, and displacements of chosen ones, from those that gaps before these gave."""
    n, first, most, square, largest = c.n_factored[g], c.group[g], c.answer.size, 0.0, 0.0
    begin, moved, row = 2 * KNOWN_RESPONSES * most * g, 3 * c.n_chosen[g], c.first_entry[g, 0] // 3
    for k in range(moved):
        c.answer[k], c.left[k] = 0.0, 0.0
    for k in range(n):
        c.left[k] = -c.free[c.chosen[first + c.factored[first + k]], 0]
    for known in range(c.n_pressed[g]):
        at = begin + 2 * known * most
        there = dot(c.known_response, at, c.left, 0, n)
        add_times(c.left, 0, -there, c.known_response, at, n)
        add_times(c.left, n, there, c.known_response, at + n, n)
        add_times(c.answer, 0, there, c.known_response, at + most, moved)
    for k in range(n):
        c.b[k], square, largest = 0.0, square + c.left[k] ** 2, max(largest, abs(c.left[k]))
    if largest > c.noise[g]:
        c.n_known[g], c.n_pressed[g] = 0, c.n_pressed[g] % KNOWN_RESPONSES
        size, at = math.sqrt(square), begin + 2 * c.n_pressed[g] * most
        for k in range(n):
            c.b[k] = c.left[k] / size
            c.known_response[at + k] = c.b[k]
        solve_active(c, g)
        for k in range(moved):
            c.known_response[at + most + k] = 0.0
        for k in range(n):
            c.known_response[at + n + k] = c.b[k]
            c.b[k] *= size
            along = row + c.factored[first + k] * c.stride[g]
            add_times(c.known_response, at + most, c.known_response[at + n + k], c.E, along, moved)
        add_times(c.answer, 0, size, c.known_response, at + most, moved)
        c.n_pressed[g] += 1
    for k in range(n):
        c.b[k] += c.left[n + k]


@inner
def turn_places(c: ContactTable, g: int) -> None:
    """Turn where points stand into own axes."""
    for k in range(c.left.size):
        c.left[k] = 0.0
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        for k in range(3):
            for a in range(3):
                c.left[3 * own + k] += c.turned[i, a, k] * c.free[i, a]


@inner
def respond_to_places(c: ContactTable, g: int, small: float) -> None:
    """Find ``−P y`` from what is known of P, and what is left of y by a product with P, which is then known, too."""
    n, most = 3 * c.n_chosen[g], c.response.size
    begin = 2 * KNOWN_RESPONSES * most * g
    for k in range(most):
        c.held[k] = 0.0
    turn_places(c, g)
    for known in range(c.n_known[g]):
        at = begin + 2 * known * most
        there = dot(c.known_response, at, c.left, 0, n)
        add_times(c.left, 0, -there, c.known_response, at, n)
        add_times(c.held, 0, -there, c.known_response, at + most, n)
    size, largest = 0.0, 0.0
    for k in range(n):
        size += c.left[k] ** 2
        largest = max(largest, abs(c.left[k]))
    if largest > small:
        c.n_known[g], c.n_pressed[g] = c.n_known[g] % KNOWN_RESPONSES, 0
        size = math.sqrt(size)
        at = begin + 2 * c.n_known[g] * most
        for k in range(most):
            c.known_response[at + k], c.known_response[at + most + k] = c.left[k] / size, 0.0
            c.response[k] = 0.0
        for own in range(c.n_chosen[g]):
            on = at + 3 * own
            f0, f1, f2 = c.known_response[on], c.known_response[on + 1], c.known_response[on + 2]
            add_rows(c, c.P, g, own, f0, f1, f2, c.response)
        for k in range(n):
            c.known_response[at + most + k] = c.response[k]
        add_times(c.held, 0, -size, c.known_response, at + most, n)
        c.n_known[g] += 1
    turn_places(c, g)
