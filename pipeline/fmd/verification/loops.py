"""Cases of mechanisms with loops."""

import numpy as np

from fmd.core.cache import Cache
from fmd.verification.case import Figure, VerificationCase, open_scene


def _four_bar(cache: Cache | None) -> list[Figure]:
    motion = open_scene("four-bar", cache).motion
    places = 1e3 * motion.tip_position[:, 2]
    # Of geometrically exact beams, three meshes, extrapolated; the beams' sections are those of the bars.
    return [
        Figure(f"C out of the plane at {time:g} s [mm]", float(np.interp(time, motion.times, places)), published, 0.02)
        for time, published in {1.0: -2.0439, 2.0: -3.8349, 10.0: 0.89939}.items()
    ]


_BAUCHAU = "Bauchau, Flexible Multibody Dynamics (2011); geometrically exact beams"
CASES = (VerificationCase("four-bar", "four-bar with a misaligned joint", _BAUCHAU, _four_bar),)
