"""Response of a rotor to a force that goes round: an unbalance, or a harmonic of any order, forward or backward.

A force across the axis that goes round in space at ν stands still in the axes that turn at Ω, or goes round there at
``w = ν − Ω``: with the axes ``e₁, e₂`` across, ``f = Re[(e₁ − i e₂) F exp(iwt)]``. What answers at a point, ``u₁`` and
``u₂``, has a part ``a = (u₁ + i u₂)/2`` that goes round with the force, and ``b`` with ``b̄ = (u₁ − i u₂)/2`` that goes
round at −w, in space at ``2 Ω − ν``; the latter is 0 where the rotor, as its supports, is the same all around (Genta,
Dynamics of Rotating Systems, 2005, chapter 4).
"""

from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.responses import LEAST_SEEN, LOOSE_STATE, LOOSE_TURN
from fmd.responses.whirl import state_scale


def circular_response(A: Array, B: Array, C: tuple[Array, Array], omega: float) -> tuple[Any, Array]:
    """Return the response of points to a force of size 1 that goes round with w [rad/s] in the turning axes.

    A (n, n) is the state matrix there; B (n, 2) is what unit forces along the two axes across do, and C has
    displacements (n_points, n) along each. The first result is the complex displacement with the force, whose angle is
    ahead of it, the second the size of that against it, (n_points,) [m/N]. A force that stands still, as an unbalance
    does, w = 0, has the direction in which it does most.
    """
    scale = state_scale(A)
    scaled, forces = scale[:, None] * A / scale, scale[:, None] * B
    if omega == 0.0:  # what turns or shifts as a whole isn't moved by it: the smallest answer
        left, sizes, right = np.linalg.svd(-scaled)
        seen = np.linalg.norm(np.concatenate(C) / scale @ right.T, axis=0)
        held = (sizes > LOOSE_STATE * sizes[0]) & ((sizes > LOOSE_TURN * sizes[0]) | (seen > LEAST_SEEN * seen.max()))
        x = (right[held].T / sizes[held]) @ (left.T[held] @ forces) / scale[:, None]
        both = np.stack([C[0] @ x, C[1] @ x], axis=1)  # (n_points, 2, 2)
        left, sizes, right = np.linalg.svd(both)
        moved, force = left[:, :, 0] @ [1.0, 1.0j], right[:, 0] @ [1.0, 1.0j]
        return sizes[:, 0] * moved / force, np.zeros(len(both))
    moving = np.linalg.solve(1j * omega * np.eye(len(A)) - scaled, forces @ [1.0, -1.0j]) / scale
    first, second = C[0] @ moving, C[1] @ moving
    return 0.5 * (first + 1j * second), np.abs(0.5 * (first - 1j * second))
