"""Round-off that is left of equilibrium: much where elements are far stiffer than the part that they make up."""

from __future__ import annotations

from typing import Any

import numpy as np

from fmd.core.arrays import Array

THIN = "since elements are so thin: shorter elements, or a thicker part, have less of it"


def rounded_defect(K: Any, u: Array) -> Array:
    """Return a defect as round-off may leave it of ``K u``, of random signs.

    Parameters
    ----------
    K : sparse array, shape (n, n)
        Stiffness matrix.
    u : ndarray, shape (n,) or (n, k)
        Displacements [m].

    Returns
    -------
    ndarray, shape of ``u``
        Forces [N]: each is the machine epsilon times what the terms of its row add up to without their signs.
    """
    signs = np.random.default_rng(0).choice([-1.0, 1.0], u.shape)
    return np.asarray(np.finfo(float).eps * signs * (abs(K) @ np.abs(u)))
