"""Errors of contacts' figures by time integration, from a march of the same run with another step.

After a contact two motions part whatever their errors, since a vibration's phase decides what comes next. Impulse,
largest force, pressure and heat of contacts converge with the step, to order 2, and with damping to order 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.errors import AccuracyError, StabilityError
from fmd.core.limits.contact import LARGEST_STEP
from fmd.core.limits.errors import SAFETY

if TYPE_CHECKING:
    from fmd.contact.histories import ContactHistory
    from fmd.stages.pipeline import Pipeline

BY_STEP = "contact errors"
_OF_ITSELF = {"energy_error_j": "it is an error itself"}


def step_errors(run: Pipeline) -> Mapping[str, Mapping[str, float | str]]:
    """Return the errors of the first run's contacts by its step, by contact and figure, or why there is none.

    A march with twice the step differs by 2^p − 1 times the error of ours, of order p, or, where contact doesn't allow
    that, one with half the step by 1 − 2^-p of it. Times are known to a step. They are found once.
    """
    if BY_STEP not in run.results:
        run.results[BY_STEP] = _compare(run)
    found: Mapping[str, Mapping[str, float | str]] = run.results[BY_STEP]
    return found


def _compare(run: Pipeline) -> dict[str, dict[str, float | str]]:
    plan = next(iter(run.plans.values()))
    method: Any = plan.integrator
    longer = 2.0 * method.step <= LARGEST_STEP * min(method.largest_step(plan.system), plan.system.largest_step)
    other = replace(plan, integrator=replace(method, step=method.step * (2.0 if longer else 0.5)))
    try:
        histories = run.motion_by(other, other.march(run.output_times)).contacts
    except (StabilityError, AccuracyError) as error:
        why = f"the march with {'twice' if longer else 'half'} the step failed: {error}"
        return {name: {**dict.fromkeys(own.figures, why), **_OF_ITSELF} for name, own in run.motion.contacts.items()}
    change = 2.0 if any(body.loses_energy for body in plan.mechanism.contacts) else 4.0
    share, step = SAFETY / (change - 1.0) * (1.0 if longer else change), method.step
    return {name: _differences(own, histories[name], share, step) for name, own in run.motion.contacts.items()}


def _differences(own: ContactHistory, other: ContactHistory, share: float, step: float) -> dict[str, float | str]:
    found, theirs = dict[str, float | str](_OF_ITSELF), other.figures
    for key, value in own.figures.items():
        if key in _OF_ITSELF:
            continue
        if value is None or theirs[key] is None:
            found[key] = "nothing touches" if value is None else "by the other step nothing touches"
            continue
        change = share * float(np.linalg.norm(np.subtract(value, theirs[key])))
        found[key] = change + (step if key in ("begin_s", "end_s") else 0.0)
    return found
