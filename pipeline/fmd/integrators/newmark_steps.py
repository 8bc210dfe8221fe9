"""Newton's iteration for the end of a step by the generalised-α method.

Its unknowns are the accelerations there; its tangent comes from differences of the accelerations and is kept while it
converges fast.
"""

import math
from typing import Any

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.newton import (
    CONVERGED,
    DAMPED_ITERATIONS,
    LEAST_MOVED,
    MOST_HALVED,
    OF_GUESS,
    POSITION_ROUND_OFF,
    STALLED,
    STEP_ITERATIONS,
    VANISHED,
)
from fmd.core.newton import settles
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import (
    accelerate_answered,
    advance,
    answer_contacts,
    answer_remembered,
    project,
    remember_answered,
)
from fmd.kernels.arrays import clear, copy
from fmd.kernels.kernel import inlined, inner
from fmd.kernels.table import Table

_settles = inlined(settles)


@dataclass(frozen=True)
class NewmarkSteps(Table):
    """State of a march by the generalised-α method, and room for Newton's iteration."""

    h: float  # [s]
    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    contact_alpha_m: float  # the same weights for accelerations by contacts
    contact_alpha_f: float
    contact_beta: float
    contact_gamma: float
    nudge: float  # least move of positions, by which tangents are differences [rad or m]
    finest: float  # the same where one of these hasn't helped
    trials: int  # of finding a step's end: the first, one with shortened corrections where surfaces touch, the last
    q: Array
    v: Array
    a: Array  # (2 n,): auxiliary accelerations without contacts', and true ones with them
    contact: Array  # (2 n,): auxiliary and true accelerations by contacts
    tangent: Array  # (n_own, n_own): factors of Newton's tangent, of the motion alone
    marks: Array  # (2,): 1 while the tangent is valid, and the largest acceleration so far
    counts: Array  # (2,): evaluations, and the time at which Newton's iteration failed, or NaN [s]
    ahead: Any  # contacts whose points give way by all that their forces move over a step; 0 without
    new: Array  # (n,): trial accelerations, those that the equations of motion give for them, and room for the tangent
    found: Array
    shifted: Array
    base: Array
    answer: Array  # (n,): accelerations by these forces, which trial ones are without
    answer_base: Array  # where the tangent is differentiated
    v_new: Array  # rates at the step's end, and those that move the positions there
    mean: Array
    q_new: Array  # positions at the step's end


@inner
def factor_tangent(A: Array) -> None:
    """Factor a matrix into L and U in place, without pivoting: a tangent is the unit matrix and a step's change."""
    n = A.shape[0]
    for k in range(n):
        for i in range(k + 1, n):
            A[i, k] /= A[k, k]
            for j in range(k + 1, n):
                A[i, j] -= A[i, k] * A[k, j]


@inner
def _solve(A: Array, x: Array) -> None:
    """Solve for the motion's entries of x, then for those of its tangents, which are the last ones, in lanes."""
    solve_part(A, x, 0, 1)
    if x.size > A.shape[0]:
        for lane in range(LANES):
            solve_part(A, x, x.size - LANES * A.shape[0] + lane, LANES)


@inner
def solve_part(A: Array, x: Array, first: int, apart: int) -> None:
    """Solve for entries of x from the first on that are so far apart, with factors of a matrix, in place."""
    n = A.shape[0]
    for i in range(n):
        for j in range(i):
            x[first + apart * i] -= A[i, j] * x[first + apart * j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[first + apart * i] -= A[i, j] * x[first + apart * j]
        x[first + apart * i] /= A[i, i]


@inner
def _evaluate_end(m: NewmarkSteps, p: Any, end: float, found: Array) -> None:
    """Evaluate the accelerations at a step's ``end`` [s] for the trial ones.

    Where surfaces touch, trial ones are without forces of contacts, which are found with all that they move over the
    step: forces that follow from positions alone change by far more than these, and at states that nobody foresees.
    """
    clear(m.answer)
    _move_to_trial(m, p)
    if answer_contacts(m.ahead, p, end, m.q_new, m.v_new, m.answer):
        _move_to_trial(m, p)
    accelerate_answered(m.ahead, p, end, m.q_new, m.v_new, found)
    m.counts[0] += 1


@inner
def _move_to_trial(m: NewmarkSteps, p: Any) -> None:
    """Find rates and positions at a step's end for the trial accelerations and those by contacts."""
    n = m.v.size
    for i in range(n):
        ahead, pushed = _ahead(m, i), _pushed_ahead(m, i)
        by_contact = (0.5 - m.contact_beta) * m.contact[i] + m.contact_beta * pushed
        m.mean[i] = m.v[i] + m.h * ((0.5 - m.beta) * m.a[i] + m.beta * ahead + by_contact)
        by_contact = (1.0 - m.contact_gamma) * m.contact[i] + m.contact_gamma * pushed
        m.v_new[i] = m.v[i] + m.h * ((1.0 - m.gamma) * m.a[i] + m.gamma * ahead + by_contact)
    copy(m.q, m.q_new)
    advance(p, m.q_new, m.mean, m.h, 0, n)


@inlined
def _smooth(m: NewmarkSteps, i: int) -> float:
    """Return the true acceleration number i at the step's begin without contacts."""
    true: float = m.a[m.v.size + i] - m.contact[m.v.size + i]
    return true


@inlined
def _ahead(m: NewmarkSteps, i: int) -> float:
    """Return the auxiliary acceleration number i at the step's end without contacts."""
    ahead: float = (1.0 - m.alpha_f) * m.new[i] + m.alpha_f * _smooth(m, i) - m.alpha_m * m.a[i]
    return ahead / (1.0 - m.alpha_m)


@inlined
def _pushed_ahead(m: NewmarkSteps, i: int) -> float:
    """Return the auxiliary acceleration number i at the step's end by contacts."""
    true, alpha_f = m.contact[m.v.size + i], m.contact_alpha_f
    ahead: float = (1.0 - alpha_f) * m.answer[i] + alpha_f * true - m.contact_alpha_m * m.contact[i]
    return ahead / (1.0 - m.contact_alpha_m)


@inner
def split_contacts(m: NewmarkSteps, p: Any) -> None:
    """Take accelerations by contacts out of the auxiliary ones at the begin of a march, whose forces p has."""
    n = m.v.size
    answer_remembered(m.ahead, p, m.answer)
    for i in range(n):
        m.contact[i], m.contact[n + i] = m.answer[i], m.answer[i]
        m.a[i] -= m.answer[i]


@inner
def find_end(m: NewmarkSteps, p: Any, end: float) -> bool:
    """Find the accelerations at a step's ``end`` [s] by Newton's method; false if it does not converge."""
    n = m.v.size
    for trial in range(m.trials):  # a loop, since calls with constants would be compiled each
        for i in range(n):
            m.new[i] = _smooth(m, i)
            if trial == m.trials - 1:
                # The last accelerations, frozen over a long step, carry a stiff coordinate far out to where no tangent
                # is of use.
                ahead = -(m.v[i] / m.h + (0.5 - m.beta) * m.a[i]) / m.beta  # so that positions stay
                ahead = (1.0 - m.alpha_m) * ahead + m.alpha_m * m.a[i]
                m.new[i] = (ahead - m.alpha_f * _smooth(m, i)) / (1.0 - m.alpha_f)
        if _converges(m, p, end, trial):
            return m.tangent.shape[0] == n or _carry_tangents(m, p, end)
        m.marks[0] = 0.0
    return False


@inner
def _renew_tangent(m: NewmarkSteps, p: Any, end: float, least: float) -> None:
    """Factor the tangent at the trial accelerations, by differences over the least move of positions [rad or m].

    ``found`` are the accelerations there.
    """
    n, size = m.tangent.shape[0], VANISHED
    to_position = m.h * m.h * m.beta * (1.0 - m.alpha_f) / (1.0 - m.alpha_m)
    copy(m.found, m.base)
    copy(m.answer, m.answer_base)
    for i in range(n):
        size = max(size, abs(m.found[i]), abs(m.new[i]), abs(m.a[i]), OF_GUESS * abs(m.a[m.v.size + i]))
    for j in range(n):
        keep = m.new[j]
        nudge = max(1e-6 * (abs(keep) + 1e-3 * max(size, m.marks[1])), least / to_position)
        m.new[j] = keep + nudge
        _evaluate_end(m, p, end, m.shifted)
        m.new[j] = keep
        for i in range(n):
            answered = m.answer[i] - m.answer_base[i]
            m.tangent[i, j] = (1.0 if i == j else 0.0) - (m.shifted[i] - m.base[i] - answered) / nudge
    factor_tangent(m.tangent)
    m.marks[0] = 1.0
    copy(m.base, m.found)
    copy(m.answer_base, m.answer)


@inner
def _converges(m: NewmarkSteps, p: Any, end: float, trial: int) -> bool:
    """Iterate from the trial accelerations until they converge: at first only while corrections shrink.

    Between the first trial and the last corrections are shortened, each with a new tangent: whole ones go to and fro
    across states of points that begin to slip or part.
    Forces that balance leave an acceleration with their own round-off: a correction that no longer shrinks, or shrinks
    to the last, is good enough if it is small beside the largest one so far, or moves positions by their round-off.
    Beside a singular position of a loop it moves them by more, though the equations hold, and with a new tangent, too.
    """
    n, largest_before, peak = m.tangent.shape[0], math.inf, m.marks[1]
    to_position = m.h * m.h * m.beta * (1.0 - m.alpha_f) / (1.0 - m.alpha_m)
    damped = 0 < trial < m.trials - 1
    iterations = DAMPED_ITERATIONS if damped else STEP_ITERATIONS
    for iteration in range(iterations):
        _evaluate_end(m, p, end, m.found)
        size, largest, reached = VANISHED, 0.0, 1.0
        if damped or m.marks[0] == 0.0 or (iteration > 0 and iteration % 4 == 0):
            _renew_tangent(m, p, end, m.nudge if trial == 0 else m.finest)
        left = 0.0
        for i in range(n):
            left = max(left, abs(m.found[i] - m.new[i] - m.answer[i]))
        _correct(m)
        for i in range(n):
            if not (abs(m.found[i]) <= largest or math.isnan(largest)):  # keeps a NaN, which max would lose
                largest = abs(m.found[i])
            # Auxiliary ones too: their round-off is in what is found, and the guess's in new.
            size = max(size, abs(m.new[i]), abs(m.a[i]), OF_GUESS * abs(m.a[m.v.size + i]))
        for i in range(m.q.size):
            reached = max(reached, abs(m.q_new[i]))
        slow = largest > STALLED * largest_before
        moved = LEAST_MOVED if iteration > 4 and left <= CONVERGED * peak else POSITION_ROUND_OFF
        good_enough = max(CONVERGED * peak, moved * reached / to_position)
        last = iteration == iterations - 1  # beneath round-off it may shrink by a steady factor for long
        if _settles(largest, 0.0 if last else largest_before, CONVERGED * size, good_enough):
            m.marks[1] = max(peak, size)
            _evaluate_end(m, p, end, m.found)
            return True
        if trial == 0 and largest > largest_before:
            return False
        if damped:
            _shorten(m, p, end)
        if slow:
            m.marks[0] = 0.0  # too slow: a fresh tangent
        largest_before = largest
    return False


@inner
def _shorten(m: NewmarkSteps, p: Any, end: float) -> None:
    """Halve the correction that was made, which is in ``found``, until the next one by its tangent is shorter."""
    n, share = m.tangent.shape[0], 1.0
    for _ in range(MOST_HALVED):
        _evaluate_end(m, p, end, m.shifted)
        before, after = 0.0, 0.0
        for i in range(n):
            m.shifted[i] -= m.new[i] + m.answer[i]
        solve_part(m.tangent, m.shifted, 0, 1)
        for i in range(n):
            before += m.found[i] ** 2
            after += m.shifted[i] ** 2
        if math.sqrt(after) <= (1.0 - 0.25 * share) * math.sqrt(before):
            return
        share *= 0.5
        for i in range(n):
            m.new[i] -= share * m.found[i]


@inner
def _correct(m: NewmarkSteps) -> None:
    """Correct the trial accelerations by those that the equations of motion give for them."""
    for i in range(m.v.size):
        m.found[i] -= m.new[i] + m.answer[i]
    _solve(m.tangent, m.found)
    for i in range(m.v.size):
        m.new[i] += m.found[i]


@inner
def _carry_tangents(m: NewmarkSteps, p: Any, end: float) -> bool:
    """Find the tangents' accelerations where the motion's have been found, until round-off is left; or return false.

    Where forces balance, these are round-off: corrections that move tangents of positions by theirs are none.
    """
    n, before, size = m.tangent.shape[0], math.inf, VANISHED
    to_position = m.h * m.h * m.beta * (1.0 - m.alpha_f) / (1.0 - m.alpha_m)
    for _ in range(STEP_ITERATIONS):
        for i in range(n):
            m.base[i] = m.new[i]
        _correct(m)
        largest, reached = 0.0, 0.0
        for i in range(n):
            m.new[i] = m.base[i]
        for i in range(m.q.size - LANES * n, m.q.size):
            reached = max(reached, abs(m.q_new[i]))
        for i in range(n, m.v.size):
            largest = max(largest, abs(m.found[i]))
            size = max(size, abs(m.new[i]))
        _evaluate_end(m, p, end, m.found)
        little = max(OF_GUESS * CONVERGED * size, POSITION_ROUND_OFF * reached / to_position)
        if largest <= little or (largest <= CONVERGED * size and largest > STALLED * before):
            return True
        if largest > STALLED * before:
            _renew_tangent(m, p, end, m.nudge)
        before = largest
    return False


@inner
def move_to_end(m: NewmarkSteps, p: Any, end: float) -> None:
    """Move the state to a step's ``end`` [s], which has been found."""
    n = m.v.size
    for i in range(n):
        m.a[i], m.contact[i] = _ahead(m, i), _pushed_ahead(m, i)
        m.a[n + i], m.contact[n + i] = m.new[i] + m.answer[i], m.answer[i]
        m.v[i] = m.v_new[i]
    copy(m.q_new, m.q)
    project(p, end, m.q, m.v)
    remember_answered(m.ahead, p, end, m.q, m.v)
