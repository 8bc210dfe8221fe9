"""Constants of vector algebra."""

from __future__ import annotations

import numpy as np

from pipeline.checks import Array, read_only

EPSILON: Array = np.zeros((3, 3, 3))
"""The permutation tensor ε_abc."""
for _a in range(3):
    _b, _c = (_a + 1) % 3, (_a + 2) % 3
    EPSILON[_a, _b, _c], EPSILON[_a, _c, _b] = 1.0, -1.0
read_only(EPSILON)
