"""Cases of contact: a bar that bounces, and a block that slides down a slope or sticks on it."""

from __future__ import annotations

import numpy as np

from fmd.core.cache import Cache
from fmd.verification.case import Figure, VerificationCase, open_scene


def _bar(cache: Cache | None) -> list[Figure]:
    floor = open_scene("verification/bouncing-bar", cache).motion.contacts["floor"]
    begin, end = floor.span
    return [
        Figure("impulse [N s]", float(floor.impulse[-1, 0]), 800 / 3, 0.01),
        Figure("begin of the contact [s]", begin or 0.0, 1.0, 0.005),
        Figure("its end [s]", end or 0.0, 5 / 3, 0.005),
    ]


def _slope(cache: Cache | None) -> list[Figure]:
    found = []
    for friction in (0.5, 0.57):
        motion = open_scene("verification/slope", cache, [f"contact.slope.friction={friction}"]).motion
        later = motion.times > 0.5 * motion.times[-1]
        fit = np.polyfit(motion.times[later], motion.trajectory.v[later, 0], 1)
        exact = -10 * (0.5 - friction * np.sqrt(0.75))
        found.append(Figure(f"acceleration, friction {friction} [m/s²]", float(fit[0]), exact, 0.001))
    return found


_DOYEN = "Doyen, Ern & Piperno, SIAM J Sci Comput 33 (2011)"
CASES = (
    VerificationCase("bouncing-bar", "contact of a bar that bounces", _DOYEN, _bar),
    VerificationCase("slope", "friction on a slope of 30°", "−g (sin 30° − μ cos 30°)", _slope),
)
