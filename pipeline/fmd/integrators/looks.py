"""Contacts in steps that the error chooses: steps end where surfaces come to touch, or no longer do.

Within a step contacts are looked at in times that are no farther apart than steps of central differences; impulses are
summed up as the method sums up rates.
"""

from __future__ import annotations

import math
from typing import Any

from fmd.core.limits.contact import CHANGE_KNOWN, ROUNDED_FORCE
from fmd.dynamics.system import is_pressed, note_contacts, remember_contacts, set_impulses
from fmd.integrators.adaptive_march import AdaptiveMarch, prepare_samples, sample_step, set_state
from fmd.integrators.step_control import share_balance
from fmd.kernels.kernel import inner, kernel


@kernel
def begin_contacts(p: Any, s: AdaptiveMarch) -> None:
    """Let contacts remember the state that a march begins with, unless they have gone on from another one."""
    if s.clock[0] == 0.0:
        remember_contacts(p, 0.0, s.q, s.v)


@inner
def begin_impulses(s: AdaptiveMarch) -> None:
    """Begin a step with the impulses at the end of the last one."""
    for i in range(s.q.size + s.v.size, s.new.size):
        s.begin[i] = s.new[i]


@inner
def _count(s: AdaptiveMarch, h: float) -> int:
    """Return in how many equal parts contacts are looked at in a step h."""
    return math.ceil(h / s.apart) if s.apart > 0.0 else 1


@inner
def _set_within(m: Any, p: Any, s: AdaptiveMarch, t: float, ahead: float, h: float) -> None:
    """Set the state a time ``ahead`` [s] after the begin of a step h."""
    sample_step(m, p, s, ahead, h)
    set_state(p, t + ahead, s.out, s.q_within, s.v_within)


@inner
def _is_pressed_within(m: Any, p: Any, s: AdaptiveMarch, t: float, ahead: float, h: float) -> bool:
    _set_within(m, p, s, t, ahead, h)
    return is_pressed(p, t + ahead, s.q_within, s.v_within)


@inner
def time_of_change(m: Any, p: Any, s: AdaptiveMarch, t: float, h: float, pressed: bool) -> float:
    """Return the time within a trial step at which surfaces come to touch, or, if ``pressed``, no longer do.

    It is h where nothing changes, or only about the step's begin or end. The time that is returned is that of a state
    that is pressed, just behind the first touch or before the last one, so that contacts remember it.
    """
    if s.apart == 0.0:
        return h
    n, early, late = _count(s, h), 0.0, 0.0
    prepare_samples(m, p, s, t, h)
    for k in range(1, n + 1):
        late = h * k / n
        if _is_pressed_within(m, p, s, t, late, h) != pressed:
            break
        early = late
    if early == h:
        return h
    known = CHANGE_KNOWN * max(h, s.apart)
    while late - early > 0.25 * known:
        middle = 0.5 * (early + late)
        if _is_pressed_within(m, p, s, t, middle, h) != pressed:
            late = middle
        else:
            early = middle
    found = early if pressed else late
    return found if known < found < h - known else h


@inner
def count_looks(p: Any, s: AdaptiveMarch, reached: float, h: float, pressed: bool) -> int:
    """Return in how many parts contacts are looked at in a step h that is taken: one where nothing is pressed."""
    if s.apart == 0.0:
        return 1
    set_state(p, reached, s.new, s.q_within, s.v_within)
    return _count(s, h) if pressed or is_pressed(p, reached, s.q_within, s.v_within) else 1


@inner
def look_at_contacts(
    m: Any, p: Any, s: AdaptiveMarch, t: float, h: float, look: int, n_looks: int, until: float
) -> int:
    """Let contacts remember what is within a step from look number ``look`` on; return that of the first one later."""
    while look < n_looks and t + h * look / n_looks < until:
        _set_within(m, p, s, t, h * look / n_looks, h)
        remember_contacts(p, t + h * look / n_looks, s.q_within, s.v_within)
        look += 1
    return look


@inner
def note_sample(p: Any, s: AdaptiveMarch, k: int) -> None:
    """Note the values of contacts at an output time, whose state is in ``s.out`` and set."""
    if s.apart > 0.0:
        remember_contacts(p, s.times[k], s.sample_q[k], s.sample_v[k])
        set_impulses(p, s.out[s.q.size + s.v.size :])
        note_contacts(p, s.times[k], s.sample_q[k], s.sample_v[k], s.contacts[k])


@inner
def remember_end(p: Any, s: AdaptiveMarch, reached: float, h: float) -> None:
    """Let contacts remember the end of a step h that is taken, with impulses as the method has summed them up.

    Forces that balance, as those of a face that is pressed flat, leave their round-off in what they don't move.
    """
    if s.apart == 0.0:
        return
    both, force = s.q.size + s.v.size, 0.0
    remember_contacts(p, reached, s.q, s.v)
    set_impulses(p, s.new[both:])
    for i in range(both, s.new.size):
        force = max(force, abs(s.new[i] - s.begin[i]) / h)
    for i in range(s.v.size):
        group = s.groups[s.q.size + i]
        if group >= 0:
            s.balance[group] = max(s.balance[group], ROUNDED_FORCE * force * s.answers[i])
    share_balance(s.groups, s.q.size, s.balance)
